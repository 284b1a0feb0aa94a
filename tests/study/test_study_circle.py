"""Circular tests of machines."""

import csv

import numpy as np
import pytest

from gantrysim.base.errors import InputError
from gantrysim.metrics import Trace, circle_row
from gantrysim.study import OK, run_study
from gantrysim.study.circle import CircleStudy
from gantrysim.study.run import NoValuesError

from support.distinct import unaccounted

ROUND = 2e-4  # [mm], of a frictionless machine whose axes have one frequency


@pytest.fixture(scope="module")
def tested(tmp_path_factory):
    """A circular test of the built-in gantry."""
    folder = tmp_path_factory.mktemp("circle") / "out"
    study = CircleStudy("xy", 40.0, 80.0)
    return study, run_study(study, folder, workers=1), folder


def measured(study):
    """The rows of a study without its report."""
    return [{**dict(case.tags), **study.measure(case)} for cases in study.rounds() for case in cases]


def test_a_frictionless_machine_runs_the_ellipse_of_its_axes_responses(rigid):
    """x = A cos(wt + a), y = B sin(wt + b): a wave of two lobes with G^2 = (A - B)^2 + R^2 (a - b)^2."""
    settings = ("servo.resolution=0", "feedforward=0.0", "integral_time=inf")
    study = CircleStudy(str(rigid().source), 30.0, 90.0, settings)
    rows = measured(study)
    run = study.job.run()
    late = (run.time > run.time[-1] / 3) & (run.time < run.time[-1] / 2)
    wt = 90.0 / 30.0 * run.time[late]
    swing = np.column_stack([np.cos(wt), np.sin(wt), np.ones(wt.size)])
    (c, d), (e, f), _ = np.linalg.lstsq(swing, run.nozzle[late, :2], rcond=None)[0]
    size, lag = np.hypot([c, d], [e, f]), np.unwrap([np.arctan2(-e, c), np.arctan2(d, f)])
    deviation = np.hypot(size[0] - size[1], 30.0 * (np.diff(lag)[0]))
    assert deviation > 5 * ROUND
    for row in rows:
        assert row["circular_deviation_um"] == pytest.approx(1e3 * deviation, abs=1e3 * ROUND)
    assert abs(size.mean() - 30) > 10 * ROUND
    values = study.report(rows).tables[0]
    assert values.rows[-1][-1] == pytest.approx(1e3 * (size.mean() - 30), abs=0.1)


def test_friction_spikes_stand_outward_after_every_reversal_and_both_ways_alike(tested):
    _, outcome, _ = tested
    for row in outcome.rows:
        for name in ("x_0", "y_90", "x_180", "y_270"):
            assert 20 < row[f"reversal_{name}_spike_um"] < 80
            assert 0 < row[f"reversal_{name}_spike_at_deg"] < 10
            assert abs(row[f"reversal_{name}_step_um"]) < 3
    one, other = outcome.rows
    assert one["circular_deviation_um"] == pytest.approx(other["circular_deviation_um"], rel=0.02)
    assert one["reversal_y_90_spike_um"] == pytest.approx(other["reversal_y_270_spike_um"], rel=0.05)


def test_the_curves_hold_the_whole_circle_and_its_values(tested):
    _, outcome, folder = tested
    with (folder / "curves.csv").open() as stream:
        lines = list(csv.DictReader(stream))
    for number, row in enumerate(outcome.rows, 1):
        own = [line for line in lines if line["case"] == str(number)]
        angle = np.radians([float(line["angle_deg"]) for line in own])
        deviation = np.array([float(line["radial_deviation_um"]) for line in own])
        assert len(own) == pytest.approx(2 * np.pi * 40 / 80 / 1e-3, abs=2)
        assert deviation.max() == pytest.approx(row["radial_deviation_max_um"], abs=1e-5)
        out = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        trace = Trace((40 + 1e-3 * deviation)[:, None] * out, (0.0, 0.0), 40.0)
        assert trace.clockwise is (row["direction"] == "clockwise")
        assert 1e3 * trace.circular_deviation == pytest.approx(row["circular_deviation_um"], abs=1e-4)
    with (folder / "study.csv").open() as stream:
        assert "angle_deg" not in next(csv.reader(stream))


def test_the_report_holds_the_values_of_the_rows(tested):
    _, outcome, folder = tested
    one, other = (row["circular_deviation_um"] for row in outcome.rows)
    result = (
        f"circular deviation G = {one:.1f} µm clockwise and {other:.1f} µm counter-clockwise, bidirectional G(b) = "
    )
    assert result in outcome.findings[0]
    closest = max(row["path_limit_use_percent"] for row in outcome.rows)
    assert (
        f"Yes, both directions keep the limits of path, stability and machine, with {closest:.3g} % of "
        in (outcome.findings[0])
    )
    spikes = [row[key] for row in outcome.rows for key in row if key.endswith("spike_um")]
    reversals = outcome.report.tables[1]
    assert [row[4] for row in reversals.rows] == pytest.approx(spikes)
    assert "ISO 230-4:2005" in outcome.report.details.notes[0]
    assert {path.name for path in (folder / "plots").iterdir()} == {"chart.png", "deviation.png"}


WAVES = {  # mean and amplitude of the nozzle's deviation, amplitude of the motors' [µm]
    "clockwise": (7.0, 30.0, 11.0),
    "counter-clockwise": (-5.0, 20.0, 13.0),
}


@pytest.fixture(scope="module")
def waved():
    """The report of two circles with a wave of two lobes each; G of a small wave is twice its amplitude."""
    study = CircleStudy("xy", 40.0, 80.0)
    angle = np.arange(0, 360, 0.25)
    wave = np.cos(2 * np.radians(angle))
    rows = []
    for name, (mean, amplitude, motor) in WAVES.items():
        order = slice(None, None, -1 if name == "clockwise" else 1)
        curves = {
            "angle_deg": angle[order],
            "radial_deviation_um": mean + amplitude * wave[order],
            "motor_deviation_um": motor * wave[order],
        }
        rows.append({"direction": name, "status": OK, **{key: curve.tolist() for key, curve in curves.items()}})
    return study.report(rows)


def test_every_value_of_a_known_pair_of_circles_is_shown_where_it_belongs(waved):
    values = {row[0]: dict(zip(waved.tables[0].heads[1:], row[1:], strict=True)) for row in waved.tables[0].rows}
    for name, (mean, amplitude, motor) in WAVES.items():
        assert [values[name][head] for head in ("G [µm]", "motors' G [µm]", "Fmax [µm]", "Fmin [µm]")] == pytest.approx(
            [2 * amplitude, 2 * motor, mean + amplitude, mean - amplitude], abs=0.05
        )
        assert (values[name]["G(b) [µm]"], values[name]["D [µm]"]) == (None, None)
    both = values["both"]
    assert (both["G(b) [µm]"], both["D [µm]"]) == pytest.approx((37 + 25, (7 - 5) / 2), abs=0.05)
    assert waved.answer == (
        "Not judged by a tolerance: circular deviation G = 60.0 µm clockwise and 40.0 µm counter-clockwise, "
        "bidirectional G(b) = 62.0 µm, for a radius of 40 mm at 80 mm/s on xy."
    )
    legend = [text.get_text() for text in waved.plots[0].figure.legends[0].texts]
    # a tenth of the needle's 0.82 mm; the largest deviation is 7 + 30
    assert legend == [
        "clockwise, G = 60.0 µm",
        "counter-clockwise, G = 40.0 µm",
        "minimum zone, G(b) = 62.0 µm",
        "nominal, radius 40 mm",
        "largest, +37.0 µm",
        "limit ± 82 µm",
    ]
    (largest,) = (line for line in waved.plots[0].figure.axes[0].lines if line.get_label().startswith("largest"))
    assert largest.get_ydata() == pytest.approx([37], abs=0.05)
    # of the two lobes
    assert np.degrees(largest.get_xdata()) % 180 == pytest.approx([0])
    for panel in waved.plots[1].figure.axes[:2]:
        limits = [line.get_ydata()[0] for line in panel.lines if line.get_linestyle() == "--"]
        assert limits == pytest.approx([82, -82])
        assert panel.get_ylim()[1] > 82


def test_every_number_of_the_answer_is_in_a_table(tested):
    study, outcome, _ = tested
    report = outcome.report
    result = report.answer[report.answer.index("circular deviation") :]
    assert unaccounted(result, report.tables, study.radius, study.speed) == []
    assert unaccounted(result, report.tables) == ["40", "80"]


def test_the_spikes_of_both_directions_are_marked_on_the_curve(tested):
    """Where the motion goes, at the spike's own deviation: the largest within a degree."""
    _, outcome, _ = tested
    panels = outcome.report.plots[1].figure.axes[:2]
    for panel, row in zip(panels, outcome.rows, strict=True):
        angle, deviation = (np.array(row[key]) for key in ("angle_deg", "radial_deviation_um"))
        sense = -1 if row["direction"] == "clockwise" else 1
        marks = [line.get_xydata()[0] for line in panel.lines if line.get_marker() in ("v", "^")]
        expected = [
            (turned + sense * row[f"reversal_{name}_spike_at_deg"]) % 360
            for name, turned in (("x_0", 0), ("y_90", 90), ("x_180", 180), ("y_270", 270))
        ]
        assert sorted(at for at, _ in marks) == pytest.approx(sorted(expected))
        for at, top in marks:
            near = np.abs((angle - at + 180) % 360 - 180) < 1.0
            assert top == pytest.approx(deviation[near].max(), abs=1.0)
        words = sorted(text.get_text() for text in panel.texts)
        assert words == sorted(f"{row[key]:+.1f}" for key in row if key.endswith("spike_um"))


def test_the_curves_are_those_of_nozzle_and_motors(tested):
    study, _, _ = tested
    run = study.job.run()
    row = circle_row(run, (0.0, 0.0), study.radius, study.lead, study.reach)
    angle = np.degrees(np.arctan2(run.commanded_tip[:, 1], run.commanded_tip[:, 0]))
    passed = np.abs(np.degrees(np.unwrap(np.radians(angle))))
    ticks = (passed >= study.lead) & (passed < study.lead + 360)
    for key, tip in (("radial", run.nozzle), ("motor", run.motor_tip)):
        deviation = 1e3 * (np.hypot(tip[ticks, 0], tip[ticks, 1]) - study.radius)
        assert row[f"{key}_deviation_um"] == pytest.approx(deviation, abs=1e-3)
    assert np.ptp(np.subtract(row["radial_deviation_um"], row["motor_deviation_um"])) > 0.1


def test_the_stage_moves_the_work_around_the_needle():
    study = CircleStudy("stage", 20.0, 40.0)
    assert study.centre == pytest.approx((-200.0, 0.0))
    rows = measured(study)
    assert [row["status"] for row in rows] == [OK, OK]
    assert all(abs(row["radial_deviation_max_um"]) < 100 for row in rows)


@pytest.mark.parametrize(("speed", "lead"), [(10.0, 225.0), (100.0, 225.0), (500.0, 225.0 + 360.0)])
def test_the_lead_gives_time_to_start_and_to_settle(speed, lead):
    study = CircleStudy("xy", 20.0, speed)
    assert study.lead == lead
    way = np.radians(lead) * 20.0
    assert way - speed**2 / (2 * 3000.0) >= 0.3 * speed


def test_spikes_are_searched_within_their_decay_at_most_40_degrees():
    assert CircleStudy("xy", 50.0, 100.0).reach == 15
    study = CircleStudy("xy", 20.0, 100.0)
    assert study.reach == pytest.approx(np.degrees(0.5))
    assert CircleStudy("xy", 10.0, 100.0).reach == 40


def test_a_fault_is_reported(tmp_path):
    study = CircleStudy("xy", 40.0, 80.0, ("following_error_limit=0.01",))
    assert study.report(measured(study)).answer.startswith(
        "Not known: the circle run clockwise has no values: fault: following error on axis"
    )
    with pytest.raises(NoValuesError, match="none of the study's 2 cases has values: fault: following error on axis"):
        run_study(study, tmp_path / "out", workers=1)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("build", "text"),
    [
        (lambda: CircleStudy("xy", 0.0), "radius = 0 mm: must be greater than 0 mm"),
        (lambda: CircleStudy("xy", 10.0, -1.0), "speed = -1 mm/s: must be greater than 0 mm/s"),
        (
            lambda: CircleStudy("xy", 0.001),
            r"radius = 0\.001 mm: must be at least 1\.91 mm, for 120 servo periods of 0\.001 s on the circle at",
        ),
        (lambda: CircleStudy("xz"), "unknown model 'xz'"),
        (lambda: CircleStudy("xy", overrides=("perod=1",)), r"unknown key 'perod': did you mean"),
    ],
)
def test_invalid_circles_are_refused(build, text):
    with pytest.raises(InputError, match=text):
        build()


def test_a_circle_needs_axes_x_and_y(rigid):
    file = rigid().source
    file.write_text(file.read_text().replace('"y"', '"v"'))
    with pytest.raises(InputError, match="machine rigid has the axes x, v: must have x and y"):
        CircleStudy(str(file))


def test_the_smallest_circle_has_values():
    least = CircleStudy("xy", 1.92, 100.0)
    rows = measured(least)
    assert [row["status"] for row in rows] == [OK, OK]
    assert len(rows[0]["angle_deg"]) == pytest.approx(120, abs=1)


def test_a_circle_beyond_the_travel_is_refused(tmp_path):
    with pytest.raises(InputError, match="must lie in the travel"):
        run_study(CircleStudy("xy", 151.0), tmp_path / "out", workers=1)
