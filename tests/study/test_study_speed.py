"""The search for the fastest within a tolerance."""

import csv
import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.base.errors import InputError
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.job.job import Job
from gantrysim.metrics.analysis import Analysis
from gantrysim.study import OK, Report, measure, run_study
from gantrysim.study.acceptance import Criterion
from gantrysim.study.cases import Case
from gantrysim.study.speed import SpeedAnswer, SpeedStudy, answer, next_speeds
from gantrysim.study.speed.study import speed_changes

from support.distinct import unaccounted
from support.remedies import SIDES, lines_job
from support.soaked import examples

pytestmark = pytest.mark.usefixtures("blank_pictures")

MOST_ROUNDS = 40


def search(within, own=100.0, resolution=0.01):
    """Carry the search out on a function of the speed; return what was tried, and the rounds."""
    tried, rounds = {}, []
    while speeds := next_speeds(tried, own, resolution):
        assert not set(speeds) & set(tried)
        rounds.append(speeds)
        tried |= {speed: within(speed) for speed in speeds}
        assert len(rounds) < MOST_ROUNDS
    return tried, rounds


@pytest.mark.parametrize("limit", [7.0, 26.0, 63.1, 99.9, 100.0, 333.0, 1234.0])
def test_the_search_brackets_a_limit_as_closely_as_asked(limit):
    tried, _ = search(lambda speed: speed <= limit)
    found = answer(tried)
    assert found.fastest <= limit < found.above <= found.fastest * 1.01
    assert found.islands == ()


def test_the_first_round_sweeps_four_octaves_about_the_programs_own_speed():
    _, rounds = search(lambda speed: speed <= 60)
    assert rounds[0] == pytest.approx(100 * 2.0 ** np.arange(-2, 2.1, 0.5), rel=1e-3)
    assert 100.0 in rounds[0]


def test_a_finer_search_takes_more_rounds_and_is_nearer():
    coarse, fine = (search(lambda speed: speed <= 61.7, resolution=r) for r in (0.1, 0.001))
    assert len(coarse[1]) < len(fine[1])
    assert answer(fine[0]).above <= answer(fine[0]).fastest * 1.001


def test_the_search_ends_at_thirty_two_times_the_speed_if_all_are_within():
    tried, _ = search(lambda speed: True)
    assert max(tried) == pytest.approx(3200)
    assert answer(tried) == SpeedAnswer(max(tried), None)


def test_the_search_ends_at_a_thirty_second_of_the_speed_if_none_is_within():
    tried, _ = search(lambda speed: False)
    assert min(tried) == pytest.approx(100 / 32, rel=1e-3)
    assert answer(tried) == SpeedAnswer(None, min(tried))


def test_an_island_beyond_the_limit_is_reported_and_is_not_the_answer():
    tried, _ = search(lambda speed: speed <= 60 or 180 < speed < 220)
    found = answer(tried)
    assert found.fastest <= 60 < found.above
    assert found.islands == (200.0,)


@examples(60)
@given(st.lists(st.floats(2.0, 5000.0), min_size=0, max_size=6), st.booleans(), st.floats(1.0, 900.0))
def test_every_speed_tried_below_the_answer_is_within_for_any_metric(edges, begins, own):
    edges = sorted(edges)

    def within(speed):
        return begins ^ (np.searchsorted(edges, speed) % 2 == 1)

    tried, _ = search(within, own)
    found = answer(tried)
    if found.fastest is not None:
        assert all(good for speed, good in tried.items() if speed <= found.fastest)
    if found.above is not None:
        assert not tried[found.above]
        assert found.fastest is None or found.above <= found.fastest * 1.01
    assert all(tried[speed] and speed > found.above for speed in found.islands)


def synthetic(case, knee=130.0, fault=350.0):
    """An error of speed^2 / knee, and a fault beyond a speed."""
    speed = case.settings.get("program.speed", 100.0)  # the job's own where it is not changed
    if speed > fault:
        return {"status": "fault: overspeed on axis x"}
    size = 50 * (speed / knee) ** 2
    links = {"program": 0.1 * size, "servo": 0.9 * size, "encoder": 0.0, "structure": 0.2}
    row = {f"{link}_rms_um": value for link, value in links.items()}
    row |= {
        "contour_rms_um": size,
        "contour_max_um": size,
        "speed_mean_mm_s": speed,
        "duration_s": max(10 / speed, 0.05),
    }
    return {"status": OK, **row}


def resonant(case):
    """An error that is large between 40 and 70 mm/s, where a mode is excited, and above 250 mm/s."""
    row = synthetic(case, knee=250.0)
    shaken = 40 < row.get("speed_mean_mm_s", 0.0) < 70  # a fault has no values
    return row | ({"contour_max_um": 90.0} if shaken else {})


def test_a_programmed_speed_beyond_a_resonance_is_kept(tmp_path):
    study = SpeedStudy(Job.load("an225"), 50.0, measure=resonant)
    outcome = run_study(study, tmp_path / "out", workers=1)
    found = answer({row["speed_mm_s"]: study.criterion.within(row) for row in outcome.rows})
    assert found.fastest <= 40 < found.above
    assert 100 in found.islands
    assert outcome.report.answer == (
        "Keep the programmed speed: 100 mm/s keeps the tolerance of 50 µm (largest contour error), and the fastest "
        f"speed tried that does is {max(found.islands):g} mm/s; but slower is not always better: from "
        f"{found.fastest:g} mm/s down every speed tried keeps the tolerance of 50 µm (largest contour error), "
        f"{found.above:g} mm/s does not (largest contour error 90 µm, at most 50 µm)."
    )
    islands = ", ".join(f"{speed:g}" for speed in found.islands)
    first = f"Not monotonic: faster runs are within the tolerance again, at {islands} mm/s."
    assert outcome.report.details.notes[0] == first


def test_the_study_reports_a_known_limit(tmp_path):
    study = SpeedStudy(Job.load("an225"), 50.0, measure=synthetic)
    outcome = run_study(study, tmp_path / "out", workers=1)
    found = answer({row["speed_mm_s"]: study.criterion.within(row) for row in outcome.rows})
    assert found.fastest <= 130 < found.above <= 1.01 * found.fastest
    size = 50 * (found.above / 130) ** 2
    flow = 2 * found.fastest  # 2 mm² at any speed
    assert outcome.report.answer == (
        f"Set program.speed = {found.fastest:g}, dispenser.flow = {flow:g}: {found.fastest:g} mm/s, "
        f"{found.fastest / 100:.3g} times the programmed 100 mm/s, is the fastest speed that keeps "
        "the tolerance of 50 µm (largest contour error); "
        f"{found.above:g} mm/s does not (largest contour error {size:.4g} µm, at most 50 µm)."
    )
    (table,) = outcome.report.tables
    assert [row[:2] for row in table.rows] == [
        ["fastest", found.fastest], ["next", found.above], ["programmed", 100], ["slowest", 25]
    ]  # fmt: skip
    assert table.rows[0][2] <= 50 < table.rows[1][2]
    (axes,) = outcome.report.plots[0].figure.axes
    assert axes.get_title(loc="right") == f"within the tolerance up to {found.fastest:g} mm/s"
    factor = found.fastest / 100
    assert unaccounted(outcome.report.answer, [table], 50, factor, size, flow) == []
    for _, speed, *shown in table.rows:
        size = 50 * (speed / 130) ** 2
        assert shown == pytest.approx([size, "servo", 0.9 * size, speed, max(10 / speed, 0.05)])
    assert table.rows[0][3] == "servo"
    assert (
        "From 200 mm/s on, ramps, clamps and axis limits keep the duration at 0.05 s." in outcome.report.details.notes
    )
    with (tmp_path / "out" / "study.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["speed_mm_s"]) for row in rows] == [row["speed_mm_s"] for row in outcome.rows]
    assert {path.name for path in (tmp_path / "out" / "plots").iterdir()} == {"speed.png", "links.png"}
    assert "Failed cases" in (tmp_path / "out" / "report.html").read_text()


def hurried(case):
    """All speeds keep the tolerance, and from 200 mm/s on the duration stays."""
    return synthetic(case, knee=1e4, fault=math.inf)


def test_the_table_has_the_run_of_the_speed_that_is_proposed(tmp_path):
    study = SpeedStudy(Job.load("an225"), 50.0, measure=hurried)
    report = run_study(study, tmp_path / "out", workers=1).report
    assert report.answer.startswith("Set program.speed = 200, dispenser.flow = 400: every speed tried, from 25 to ")
    (table,) = report.tables
    rows = {name: row for name, *row in table.rows}
    assert list(rows) == ["fastest tried", "proposed", "programmed", "slowest"]
    assert rows["proposed"][0] == 200
    assert rows["proposed"][1] == pytest.approx(50 * (200 / 1e4) ** 2)
    assert rows["proposed"][-1] == rows["fastest tried"][-1] == 0.05


def never(case):
    return {"status": "refused: no"}


def hopeless(case):
    return {**synthetic(case), "contour_max_um": 999.0 * case.settings["program.speed"] / 50}


def test_the_report_where_no_speed_is_within_the_tolerance():
    study = SpeedStudy(Job.load("an225"), 50.0)
    rows = [{"speed_mm_s": speed, **never(None)} for speed in (50.0, 100.0)]
    text = "Not known: none of the 2 speeds tried gives a run with values: refused: no."
    assert study.report(rows) == Report("How fast can this job run within its tolerance?", text)
    rows = [
        {"speed_mm_s": speed, **hopeless(type("C", (), {"settings": {"program.speed": speed}}))}
        for speed in (50.0, 99.0)
    ]
    report = study.report(rows)
    limit = "the tolerance of 50 µm (largest contour error)"
    assert report.answer == (
        f"No speed tried, from 50 to 99 mm/s, keeps {limit}: 50 mm/s comes nearest (largest contour error 999 µm, at "
        "most 50 µm), so speed is not the lever; gantrysim improve an225 tries the others."
    )
    assert report.tables[0].rows[-1][:3] == ["slowest", 50, 999]


def test_a_real_search_agrees_with_runs_at_its_answer():
    job = Job.load("an225", ["diameter=60.0", "turns=1"])
    study = SpeedStudy(job, 300.0, resolution=0.4)
    rows, rounds = [], study.rounds()
    cases = next(rounds)
    while cases:
        new = [{**dict(case.tags), **measure(case)} for case in cases]
        rows += new
        try:
            cases = rounds.send(new)
        except StopIteration:
            break
    found = answer({row["speed_mm_s"]: study.criterion.within(row) for row in rows})
    assert found.fastest is not None
    run = job.changed(study.overrides(found.fastest)).run()
    largest = 1e3 * Analysis(run).nozzle.distance.max()
    assert largest <= 300.0
    assert next(row for row in rows if row["speed_mm_s"] == found.fastest)["contour_max_um"] == pytest.approx(largest)


def test_glue_that_fails_at_every_speed_of_real_runs_is_the_answer():
    """A valve that opens for 80 ms: faster, more is missing, and no speed of these mends it."""
    study = SpeedStudy(lines_job(SIDES, dispenser={"area": 2.0, "opening": 0.08, "closing": 0.08}))
    cases = [Case.of(study.job, study.overrides(speed), round=1, speed_mm_s=speed) for speed in (50.0, 100.0, 200.0)]
    rows = [{**dict(case.tags), **measure(case)} for case in cases]
    assert [row["glue_verdict"] for row in rows] == ["fail"] * 3
    least = min(rows, key=lambda row: row["glue_limit_use_percent"])
    text = study.report(rows).answer
    assert text.startswith("No speed tried, from 50 to 200 mm/s, keeps the job's tolerance: ")
    assert f"{least['speed_mm_s']:g} mm/s comes nearest" in text
    assert f"glue: {least['glue_check']}" in text
    assert "Run with" not in text


ROW = {
    "tolerance_mm": 3.0,
    "status": OK,
    "contour_max_um": 12.5,
    "spacing_std_mm": 0.1,
    "spacing_mean_mm": 9.0,
    "bead_width_mean_mm": 4.0,
    "volume_error_percent": -2.0,
}


def test_a_criterion_takes_a_metric_with_or_without_its_unit():
    for name in ("contour_max", "contour_max_um"):
        criterion = Criterion(name, 12.5)
        assert criterion.value(ROW) == 12.5
        assert criterion.within(ROW)
        assert criterion.unit(ROW) == "µm"
        assert criterion.label == "largest contour error"
    assert not Criterion("contour_max", 12.4).within(ROW)
    assert Criterion("spacing_std", 1).label == "standard deviation of turn spacing"
    assert Criterion("spacing_std", 1).unit(ROW) == "mm"


@pytest.mark.parametrize("row", [{"status": "fault: x"}, {**ROW, "status": "refused: y"}])
def test_a_run_without_values_is_never_within(row):
    criterion = Criterion("contour_max", 1e9)
    assert criterion.value(row) == math.inf
    assert not criterion.within(row)


@pytest.mark.parametrize(
    ("build", "text"),
    [
        (lambda: Criterion("contour_max", 0), "tolerance = 0: must be greater than 0"),
        (
            lambda: Criterion("contour_maxi", 1).key(ROW),
            "unknown metric 'contour_maxi': did you mean contour_max? known",
        ),
        (lambda: Criterion("tolerance", 1).key(ROW), "known: contour_max, spacing_std$"),
        (lambda: SpeedStudy(Job.load("an225"), 50.0, resolution=1e-4), "resolution = 0.0001: must be at least 0.001"),
    ],
)
def test_invalid_searches_are_refused(build, text):
    with pytest.raises(InputError, match=text.replace("?", r"\?")):
        build()


def test_an_unknown_metric_is_refused_before_any_case(tmp_path):
    with pytest.raises(InputError, match="unknown metric 'contour_mx'"):
        run_study(SpeedStudy(Job.load("an225"), 50.0, "contour_mx", measure=synthetic), tmp_path / "out", workers=1)


def test_a_flow_by_an_output_keeps_its_section_at_another_speed():
    """The program's set points stay, so that each unit of them is a flow in proportion to the speed."""
    job = Job.load("softmc-arc")
    changed = speed_changes(job.changed({"dispenser.flow": 0.0, "dispenser.area": 0.0}), 25.0)
    assert not any(key.startswith("dispenser.") for key in changed)
    factor = 25.0 / job.controller.programmed_speed
    for name in ("per_output", "flow"):
        fed = SimpleNamespace(controller=job.controller, dispenser=Dispenser(**{name: 8.0}))
        assert speed_changes(fed, 25.0)[f"dispenser.{name}"] == pytest.approx(8.0 * factor, rel=1e-3)
