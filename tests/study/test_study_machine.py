"""Many machines that differ: their yield, and the influence of every factor."""

import csv
import itertools

import numpy as np
import pytest
from matplotlib.colors import to_hex
from scipy.stats import spearmanr

from gantrysim.base.errors import InputError
from gantrysim.job.job import Job
from gantrysim.metrics.analysis import Analysis
from gantrysim.results.colours import GOOD
from gantrysim.study import OK, Report, measure, run_study
from gantrysim.study.machine import MachineStudy, Tolerances
from gantrysim.study.machine.report import _draw_scatter, _draw_yield, influences, yield_of

from support.distinct import unaccounted
from support.soaked import suite_runs

pytestmark = pytest.mark.usefixtures("blank_pictures")

NEWCOMBE = {  # Wilson 95 % intervals as R. G. Newcombe prints them, Statistics in Medicine 17 (1998), table I
    (81, 263): (0.2553, 0.3662),
    (15, 148): (0.0624, 0.1605),
    (0, 20): (0.0000, 0.1611),
    (1, 29): (0.0061, 0.1718),
}
PRINTED = 5e-5  # half a unit of the last digit
FALSE_ALARMS = 0.12  # share of studies of nothing in which a factor seems to matter; 0.05 is meant
SMALL = Tolerances(payload=0.0, friction=0.5, viscous=0.0, stiffness=0.0, motor_constant=0.0)


@pytest.mark.parametrize(("counts", "interval"), NEWCOMBE.items())
def test_the_wilson_interval_is_the_published_one(counts, interval):
    found = yield_of(*counts)
    assert (found.low, found.high) == pytest.approx(interval, abs=PRINTED)
    assert found.share == counts[0] / counts[1]


def test_the_wilson_interval_of_all_mirrors_that_of_none():
    none, every = yield_of(0, 50), yield_of(50, 50)
    assert every.high == 1
    assert every.low == pytest.approx(1 - none.high, abs=1e-12)


def factors(count, names="abcdef", seed=0):
    generator = np.random.default_rng(seed)
    return {name: generator.uniform(0.5, 2.0, count) for name in names}


def test_influences_have_the_order_and_sign_of_the_factors():
    drawn = factors(100)
    figure = np.exp(2 * drawn["b"] - drawn["e"] + 0.02 * drawn["a"])
    found, explained = influences(drawn, figure)
    assert [one.factor for one in found[:2]] == ["b", "e"]
    assert found[0].coefficient > 0.8
    assert -0.6 < found[1].coefficient < -0.3
    assert [one.clear for one in found[:2]] == [True, True]
    assert not any(one.clear for one in found[2:])
    assert explained > 0.9
    again, _ = influences(drawn, np.log(figure))  # ranks alone count
    assert [one.coefficient for one in again] == pytest.approx([one.coefficient for one in found])


def test_the_coefficient_of_a_single_factor_is_spearmans_rank_correlation():
    drawn = factors(40, "a")
    figure = drawn["a"] + np.random.default_rng(5).normal(0, 0.5, 40)
    found, explained = influences(drawn, figure)
    assert found[0].coefficient == pytest.approx(spearmanr(drawn["a"], figure).statistic, abs=1e-12)
    assert explained == pytest.approx(found[0].coefficient ** 2, abs=1e-12)


def test_a_small_influence_is_significant_if_a_large_one_explains_the_rest():
    drawn = factors(64)
    found, _ = influences(drawn, 10 * drawn["a"] + 2 * drawn["c"])
    assert [(one.factor, one.clear) for one in found[:2]] == [("a", True), ("c", True)]
    assert abs(found[1].coefficient) < 0.35  # which by itself, of 64 and six factors, could be chance


def test_with_few_machines_for_many_factors_a_dominant_one_is_still_significant():
    """Sixteen machines, fourteen factors: a regression alone has one degree of freedom left."""
    drawn = factors(16, "abcdefghijklmn", seed=4)
    metric = drawn["c"] + 0.1 * np.random.default_rng(1).normal(size=16)
    found, _ = influences(drawn, metric)
    assert [one.factor for one in found if one.clear] == ["c"]
    assert spearmanr(drawn["c"], metric).statistic > 0.85


@pytest.mark.soak
def test_false_alarms_are_about_one_study_in_twenty():
    generator = np.random.default_rng(2)
    alarms = [
        any(one.clear for one in influences(factors(40, seed=k + 10), generator.normal(size=40))[0]) for k in range(200)
    ]
    assert 0 < np.mean(alarms) < FALSE_ALARMS


def test_failed_machines_rank_worst():
    drawn = factors(50)
    figure = drawn["a"].copy()
    figure[drawn["a"] > 1.5] = np.inf
    assert influences(drawn, figure)[0][0].factor == "a"
    same, explained = influences(drawn, np.full(50, np.inf))
    assert not any(one.clear or one.coefficient for one in same)
    assert explained == 0


def test_a_latin_hypercube_has_one_machine_in_each_part_of_every_range():
    study = MachineStudy(Job.load("an225"), 50.0, samples=32)
    machines = study.machines
    assert list(machines) == [
        "payload_kg",
        *(f"{name}_{axis}" for name in ("friction", "viscous", "stiffness", "motor_constant") for axis in "xy"),
    ]
    for name, values in machines.items():
        spread = getattr(study.spread, name.removesuffix("_kg").removesuffix("_x").removesuffix("_y"))
        unit = values / spread if name == "payload_kg" else 0.5 * (np.log(values) / np.log1p(spread) + 1)
        assert np.sort((32 * unit).astype(int)).tolist() == list(range(32))
    assert np.median(machines["friction_x"]) == pytest.approx(1, abs=0.05)
    again = MachineStudy(Job.load("an225"), 50.0, samples=32).machines
    other = MachineStudy(Job.load("an225"), 50.0, samples=32, seed=2).machines
    assert np.array_equal(machines["friction_x"], again["friction_x"])
    assert not np.array_equal(machines["friction_x"], other["friction_x"])


def test_a_sample_perturbs_every_axis_on_its_own():
    study = MachineStudy(Job.load("an225-3d"), 50.0, samples=20, spread=Tolerances(viscous=0.0))
    perturbation, machines = study.perturbation(3), study.machines
    assert perturbation.payload == machines["payload_kg"][2]
    for name in ("friction", "stiffness", "motor_constant"):
        assert getattr(perturbation, name) == tuple(machines[f"{name}_{axis}"][2] for axis in "xyz")
    assert perturbation.viscous == 1.0


def test_springs_above_all_axes_have_one_factor(rigid, tmp_path):
    file = rigid().source
    spring = '<body name="base"><joint name="base" stiffness="1e6" damping="10"/><geom size="0.01" mass="1"/>'
    text = file.read_text().replace('<body name="bridge">', spring + '<body name="bridge">')
    file.write_text(text.replace("</worldbody>", "</body></worldbody>"))
    job = Job.load("an225", machine=str(file))
    study = MachineStudy(job, 50.0, samples=20)
    assert "stiffness" in study.machines
    assert "stiffness_x" not in study.machines
    assert study.perturbation(1).stiffness == study.machines["stiffness"][0]


def synthetic(case):
    """The figure is 50 times the friction of x; the stiffest motors trip."""
    perturbation = case.perturbation
    if perturbation is None:
        return {"status": OK, "contour_max_um": 50.0}
    if perturbation.motor_constant[0] > 1.09:
        return {"status": "fault: oscillation on axis x"}
    return {"status": OK, "contour_max_um": 50 * perturbation.friction[0]}


def test_the_yield_of_a_known_metric(tmp_path):
    study = MachineStudy(Job.load("an225"), 60.0, samples=64, measure=synthetic)
    outcome = run_study(study, tmp_path / "out", workers=1)
    machines = study.machines
    good = (machines["friction_x"] <= 1.2) & (machines["motor_constant_x"] <= 1.09)
    faults = int((machines["motor_constant_x"] > 1.09).sum())
    assert faults > 0
    within = int(good.sum())
    answer, failed, _ = outcome.findings
    limit = "the tolerance of 60 µm (largest contour error)"
    share = f"a yield of {100 * within / 64:.1f} % (95 % confidence: "
    assert answer.startswith(f"{within} of 64 machines keep {limit}, {share}")
    low = machines["friction_x"] <= np.median(machines["friction_x"])
    shares = f"{100 * good[low].mean():.0f} % of the machines below its median keep the limit"
    assert answer.endswith(
        f"the lever is friction of x, to be kept low: {shares}, {100 * good[~low].mean():.0f} % above."
    )
    assert failed.startswith(f"{faults} runs failed, such as machine ")
    assert failed.endswith(": fault: oscillation on axis x.")
    influence, distribution, variation = outcome.report.tables
    assert distribution.rows[0] == ["nominal", 50.0]
    assert distribution.rows[-1][1] is None  # the worst machine failed
    assert influence.rows[0][0] == "friction of x"
    assert influence.rows[0][2] == "yes"
    assert ["friction", "0.667 to 1.5"] in variation.rows
    with (tmp_path / "out" / "study.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [int(row["sample"]) for row in rows] == list(range(65))
    assert float(rows[0]["friction_x"]) == 1
    assert float(rows[0]["payload_kg"]) == 0
    assert [float(row["friction_x"]) for row in rows[1:]] == machines["friction_x"].tolist()
    drawn = {path.name for path in (tmp_path / "out" / "plots").iterdir()}
    assert drawn == {"yield.png", "influence.png", "scatter.png"}
    report = (tmp_path / "out" / "report.html").read_text()
    assert "The worst machines" in report


def test_every_value_of_known_machines_is_shown_where_it_belongs():
    study = MachineStudy(Job.load("an225"), 60.0, samples=64)
    (cases,) = study.rounds()
    rows = [{**dict(case.tags), "status": OK} for case in cases]
    for row, value in zip(rows, (33.0, *range(101, 165)), strict=True):
        row["contour_max_um"] = 0.5 * value
    report = study.report(rows)
    influence, distribution, variation = report.tables
    # the smallest value that at least 5, 50 and 95 % of the 64 machines do not exceed: numbers 4, 32 and 61
    assert distribution.rows == [
        ["nominal", 16.5],
        ["5 % quantile", 52.0],
        ["median", 66.0],
        ["95 % quantile", 80.5],
        ["worst, number 64", 82.0],
    ]
    limit = "the tolerance of 60 µm (largest contour error)"
    assert report.answer.startswith(f"20 of 64 machines keep {limit}, a yield of 31.2 % (95 % confidence: ")
    interval = yield_of(20, 64)
    known = (31.25, 95, 100 * interval.low, 100 * interval.high, 20, 64, 60)
    assert unaccounted(report.answer.partition(";")[0], [], *known) == []
    worst = report.plots[0].tables[0]
    assert [row[:2] for row in worst.rows] == [[64 - k, 0.5 * (164 - k)] for k in range(5)]
    for machine, _, *shown in worst.rows:
        assert shown == [values[machine - 1] for values in study.machines.values()]
    words = [text.get_text() for text in report.plots[0].figure.axes[0].texts]
    assert words == ["yield 31.2 %"]
    (axes,) = report.plots[1].figure.axes
    shown = zip(axes.get_yticklabels(), axes.texts, axes.patches, influence.rows, strict=True)
    for label, text, bar, (name, coefficient, *_) in shown:
        assert label.get_text() == name
        assert text.get_text() == f"{round(coefficient, 2) + 0.0:+.2f}".replace("-", "−")
        assert bar.get_width() == coefficient
        # beyond the bar's end
        way = 1 if coefficient >= 0 else -1
        assert way * text.get_position()[0] > way * coefficient
        assert text.get_ha() == ("left" if coefficient >= 0 else "right")
    # the first, which is the largest, on top
    assert axes.yaxis_inverted()
    labels = [text.get_text() for text in report.plots[0].figure.legends[0].texts]
    assert labels == ["tolerance 60", "nominal machine 16.5"]
    assert variation.rows == [
        ["payload", "0 to 0.3 kg"],
        *(
            [name, f"{1 / (1 + spread):.3g} to {1 + spread:.3g}"]
            for name, spread in (
                ("friction", study.spread.friction),
                ("viscous friction", study.spread.viscous),
                ("stiffness", study.spread.stiffness),
                ("motor constant", study.spread.motor_constant),
            )
        ),
    ]


def test_without_an_influence_no_lever_is_named():
    study = MachineStudy(Job.load("an225"), 60.0, samples=64)
    (cases,) = study.rounds()
    rows = [{**dict(case.tags), "status": OK} for case in cases]
    for row, value in zip(rows, (33.0, *np.random.default_rng(4).permutation(np.arange(101, 165))), strict=True):
        row["contour_max_um"] = 0.5 * float(value)
    report = study.report(rows)
    assert report.answer.endswith(
        "; no factor of the build has a significant influence, so none is known to be a lever."
    )
    assert [row[2] for row in report.tables[0].rows] == ["no"] * len(report.tables[0].rows)
    assert report.details.notes[0] == "No factor has a significant influence."
    assert {bar.get_alpha() for bar in report.plots[1].figure.axes[0].patches} == {0.25}
    for k in (1, 2):
        rows[k]["status"] = "refused: no"
    assert "2 runs failed, such as machine 1: refused: no." in study.report(rows).details.notes


def test_curve_histogram_and_points_count_every_machine():
    """Of 40 values from 1 to 40 and 10 failed machines, 12 are at most 12.5."""
    values = np.append(np.arange(1.0, 41.0), np.full(10, np.inf))
    above, below = _draw_yield(values, 3.0, 12.5, "error [µm]").axes
    curve = max(above.lines, key=lambda line: len(line.get_xdata()))
    assert curve.get_xdata().tolist() == [1, *range(1, 41)]
    assert curve.get_ydata() == pytest.approx(np.arange(41) * 2)
    assert [text.get_text() for text in above.texts] == ["yield 24.0 %"]
    good = [bar for bar in below.patches if to_hex(bar.get_facecolor()) == to_hex(GOOD)]
    assert sum(bar.get_height() for bar in below.patches) == 40
    assert sum(bar.get_height() for bar in good) == 12
    assert max(bar.get_x() + bar.get_width() for bar in good) == pytest.approx(12.5)
    factors = {"payload": np.arange(50.0), "friction of x": -np.arange(50.0), "stiffness": np.ones(50)}
    panels = _draw_scatter(factors, values, 12.5, "error [µm]").axes
    for panel, factor in zip(panels, factors.values(), strict=False):
        within, beyond, _ = panel.lines
        assert within.get_xydata().tolist() == [[factor[k], k + 1] for k in range(12)]
        assert beyond.get_xydata().tolist() == [[factor[k], k + 1] for k in range(12, 40)]
    assert [panel.get_xlabel() for panel in panels[:2]] == ["payload [kg]", "friction of x, factor"]
    assert [panel.get_visible() for panel in panels] == [True] * 3 + [False]


@pytest.mark.parametrize(("tolerance", "shares"), [(1.0, [0, 0]), (50.0, [0, 100]), (1e3, [100, 100])])
def test_the_yield_is_given_above_and_below_the_median_of_a_factor(tolerance, shares):
    study = MachineStudy(Job.load("an225"), tolerance, samples=64)
    (cases,) = study.rounds()
    rows = [{**dict(case.tags), **synthetic(case)} for case in cases]
    rows = [{**row, "status": OK, "contour_max_um": 50 * row["friction_x"]} for row in rows]
    table = study.report(rows).table
    assert [getattr(column, "head", column) for column in table.columns][:3] == [
        "factor",
        "rank coefficient",
        "significant",
    ]
    factor, coefficient, significant, *yields = table.rows[0]
    assert (factor, significant) == ("friction of x", "yes")
    assert coefficient > 0.9
    assert yields == pytest.approx(shares, abs=5)


@pytest.mark.parametrize(
    ("tolerance", "power"),
    # a tolerance below, among and above the errors
    suite_runs(list(itertools.product([5.0, 11.0, 14.0, 20.0, 29.0, 35.0], [0.2, 1.0, 5.0])), 0, 4, 11, 16),
)
def test_the_label_of_the_yield_does_not_overlap_the_curve(tolerance, power):
    figure = 10 + 20 * np.linspace(0, 1, 65) ** power
    drawing = _draw_yield(figure, 12.0, tolerance, "error [µm]")
    drawing.draw_without_rendering()
    (axes, _), renderer = drawing.axes, drawing.canvas.get_renderer()
    (words,) = (text for text in axes.texts if text.get_text().startswith("yield"))
    box = words.get_window_extent(renderer)
    curve = max(axes.lines, key=lambda line: len(line.get_xdata()))
    places = axes.transData.transform(np.column_stack([curve.get_xdata(), curve.get_ydata()]))
    corners = np.insert(places, slice(1, None), np.column_stack([places[1:, 0], places[:-1, 1]]), axis=0)  # "post"
    step = np.concatenate([np.linspace(a, b, 50) for a, b in itertools.pairwise(corners)])
    inside = (step > [box.x0, box.y0]) & (step < [box.x1, box.y1])
    assert not inside.all(axis=1).any()
    frame = axes.get_window_extent(renderer)
    assert frame.y0 < box.y0
    assert box.y1 < frame.y1


def test_the_report_where_no_machine_runs():
    study = MachineStudy(Job.load("an225"), 60.0, samples=20)
    rows = [{"sample": k, "status": "refused: no"} for k in range(21)]
    text = "Not known: none of the 21 machines gives a run with values: refused: no."
    assert study.report(rows) == Report("How many machines of this build will meet the tolerance?", text)


def test_machines_with_more_friction_are_worse_in_real_runs():
    job = Job.load("softmc-arc", ["integral_time=inf"])
    study = MachineStudy(job, 60.0, samples=8, spread=SMALL)
    (cases,) = study.rounds()
    rows = [{**dict(case.tags), **measure(case)} for case in cases]
    figure = np.array([row["contour_max_um"] for row in rows[1:]])
    assert np.corrcoef(study.machines["friction_x"], figure)[0, 1] > 0.9
    assert figure.min() < rows[0]["contour_max_um"] < figure.max()
    assert study.report(rows).table.rows[0][0] == "friction of x"
    assert study.report(rows).table.rows[0][2] == "yes"
    # the row of a machine is that of a run of it, with the nominal machine's gains
    run = job.run(machine=job.built_machine.perturbed(study.perturbation(1)))
    assert figure[0] == pytest.approx(1e3 * Analysis(run).nozzle.distance.max())


@pytest.mark.parametrize(
    ("build", "text"),
    [
        (lambda: Tolerances(friction=-0.1), "tolerance of friction = -0.1: must be at least 0"),
        (lambda: Tolerances(payload=-1), "tolerance of payload = -1 kg: must be at least 0 kg"),
        (lambda: Tolerances.parse("frictoin=1"), r"unknown tolerance 'frictoin': did you mean friction\?"),
        (lambda: Tolerances.parse("friction"), "tolerance friction: must be friction= and a number"),
        (lambda: Tolerances.parse("friction=much"), "tolerance friction=much: must be friction= and a number"),
        (
            lambda: MachineStudy(Job.load("an225"), 50.0, spread=Tolerances(0, 0, 0, 0, 0)),
            "spread: must be above 0 for at least one factor",
        ),
        (lambda: MachineStudy(Job.load("an225"), 50.0, samples=11), "samples = 11: must be at least 12, for 9 factors"),
        (
            lambda: MachineStudy(Job.load("an225"), 50.0, samples=10**12),
            "samples = 1000000000000: must be at most 10000",
        ),
        (lambda: MachineStudy(Job.load("an225"), -1.0), "tolerance = -1: must be greater than 0"),
    ],
)
def test_invalid_studies_are_refused(build, text):
    with pytest.raises(InputError, match=text):
        build()


def test_a_parsed_spread_keeps_the_defaults():
    assert Tolerances.parse(" friction = 0.2, payload=1 ") == Tolerances(payload=1.0, friction=0.2)
    assert Tolerances.parse("") == Tolerances()
