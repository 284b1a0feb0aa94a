"""The programs with speeds by place in docs/by-place, run as a reader would, give the figures of docs/improve.md."""

import re
from pathlib import Path

import pytest

from gantrysim.job.job import Job
from gantrysim.remedy.outcome import Motion

DOCS = Path(__file__).parent.parent.parent / "docs"
PAGE = (DOCS / "improve.md").read_text(encoding="utf-8")
TABLE = re.search(r"<!-- parts written by .*? -->\n(.*?)<!-- end -->", PAGE, re.DOTALL)[1]
ROWS = {
    re.search(r"by-place/([\w-]+)-by-place\.toml", line)[1]: [cell.strip() for cell in line.strip("|\n ").split("|")]
    for line in TABLE.splitlines()
    if "-by-place.toml" in line
}


def numbers(cell):
    return [float(number) for number in re.findall(r"[0-9]+(?:\.[0-9]+)?", cell)]


def outcome_of(job):
    return Motion.of(job, "mujoco").outcome(job)


def p95(outcome):
    return next(check.value for check in outcome.verdict["path"].checks if check.name == "path_p95")


def test_four_parts_are_shown_each_faster_than_with_levers_that_act_everywhere_alike():
    assert list(ROWS) == ["an225", "softmc-helical", "gasket", "frame"]
    for _, before, after, by_place, *_ in ROWS.values():
        assert after.endswith("pass")
        assert by_place.endswith("pass")
        assert not before.endswith("pass")
        assert numbers(by_place)[0] < 0.9 * numbers(after)[0]


@pytest.mark.parametrize("name", ROWS)
def test_the_job_gives_the_promised_figures(name):
    *_, by_place, speeds, contour = ROWS[name]
    job = Job.load(str(DOCS / "by-place" / f"{name}-by-place.toml"))
    outcome = outcome_of(job)
    assert outcome.passes
    assert f"{outcome.duration:.2f}" == f"{numbers(by_place)[0]:.2f}"
    assert p95(outcome) == pytest.approx(numbers(contour)[2], abs=0.06)
    stretches = job.controller.stretches(job.servo.period)
    slowest, fastest = numbers(speeds)[1:]
    laid = stretches.speeds[stretches.speeds > 0]
    assert laid.min() == pytest.approx(slowest, rel=5e-3)
    assert laid.max() == pytest.approx(fastest, rel=5e-3)


@pytest.mark.parametrize(
    ("name", "suffix", "key"),
    [("gasket", ".ngc", "text"), ("frame", ".nc", "program"), ("softmc-helical", ".prg", "program")],
)
def test_the_program_is_that_of_the_job(name, suffix, key):
    stem = DOCS / "by-place" / f"{name}-by-place"
    program = stem.with_suffix(suffix).read_text(encoding="utf-8")
    assert program == Job.load(str(stem.with_suffix(".toml"))).program[key]


@pytest.mark.parametrize(("name", "suffix"), [("gasket", ".ngc"), ("frame", ".nc")])
def test_the_program_in_place_of_the_reader_s_own_gives_the_promised_figures(name, suffix, tmp_path):
    own = (DOCS / "by-place" / f"{name}.toml").read_text(encoding="utf-8")
    (tmp_path / f"{name}.toml").write_text(own, encoding="utf-8")
    program = (DOCS / "by-place" / f"{name}-by-place{suffix}").read_text(encoding="utf-8")
    (tmp_path / f"{name}{suffix}").write_text(program, encoding="utf-8")
    promised = Job.load(str(DOCS / "by-place" / f"{name}-by-place.toml"))
    # the glue is part of the proposal
    job = Job.load(str(tmp_path / f"{name}.toml"), {"dispenser.advance": promised.dispenser.advance})
    outcome = outcome_of(job)
    assert outcome.passes
    assert f"{outcome.duration:.2f}" == f"{numbers(ROWS[name][3])[0]:.2f}"
    assert p95(outcome) == pytest.approx(numbers(ROWS[name][5])[2], abs=0.06)


def test_the_spiral_s_listing_gives_the_promised_figures_on_the_controller_s_interpreter():
    promised = Job.load(str(DOCS / "by-place" / "an225-by-place.toml"))
    dispenser = promised.dispenser
    names = ("flow", "area", "advance", "dead_time", "opening", "closing")
    settings = {f"dispenser.{name}": getattr(dispenser, name) for name in names}
    settings["program.spiral"] = {"diameter": 120.0, "turns": 4, "thickness": 10.0}
    settings["servo.integral_time"] = promised.servo.integral_time
    job = Job.load(str(DOCS / "by-place" / "an225-by-place.bas"), settings, "xy")
    outcome = outcome_of(job)
    assert outcome.passes
    assert outcome.duration == pytest.approx(numbers(ROWS["an225"][3])[0], abs=0.02)
    # the listing acts at ticks of the servo, the closed form between them
    assert p95(outcome) == pytest.approx(numbers(ROWS["an225"][5])[2], abs=3.0)
