"""Causes of a bead's error against records whose error has one cause."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gantrysim import Dispenser, Job
from gantrysim.glue.bead import Bead
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.report.causes import glue_causes_section, glue_causes_summary
from gantrysim.report.headline import headline
from gantrysim.results.glue_causes import (
    GLUE_CAUSES,
    at_constant_speed,
    glue_causes_of,
    told_check,
    value_of,
    without_dead_time,
    without_lag,
)
from gantrysim.results.run_results import RunResults

FLOW = 200.0  # [mm³/s]
SPEED = 100.0  # [mm/s]
# one line; its second half at half the speed
SLOWER = """G21 G17 G90 G94 G64
G0 X-80 Y0
M62 P0
G1 X0 F6000
G1 X80 F3000
M63 P0
M2
"""


EVEN = SLOWER.replace("F3000", "F6000")


def line_job(text=EVEN, **tables):
    content = {
        "name": "line",
        "machine": "xyz",
        "program": {"controller": "linuxcnc.Program", "text": text},
        "dispenser": {"flow": FLOW},
        "bead": {"squashed": False},
        **tables,
    }
    return Job.of_content(content, "job line")


def causes_of(job, run):
    return glue_causes_of(job, Bead(run, job.bead, Analysis(run)))


def worths(causes):
    return {effect.cause.name: causes.worth(effect) for effect in causes.effects}


def test_a_fixed_flow_at_half_the_speed_is_too_wide_by_the_root_of_two_and_speed_is_its_cause():
    job = line_job(SLOWER)
    run = job.follow()
    causes = causes_of(job, run)
    # twice the section or half of it: width goes with its root
    wide = max(100 * (math.sqrt(2) - 1), 100 * (1 - math.sqrt(0.5)))
    assert causes.check.name == "bead_width"
    assert causes.check.value >= 100 * (1 - math.sqrt(0.5)) - 1
    by_name = worths(causes)
    assert max(by_name, key=by_name.get) == "speed changes"
    rest = value_of(next(e.row for e in causes.effects if e.cause.name == "speed changes"), "bead_width")
    assert rest < 0.02 * wide
    for name in ("valve delay", "lag", "path error", "needle gap"):
        assert by_name[name] == 0
    results = RunResults(job, job.built_machine, Budget(Analysis(run)), Bead(run, job.bead), glue_causes=causes)
    text = headline(results)
    assert text.startswith(f"Glue: {causes.check.brief}")
    assert "due to speed changes (which the flow does not follow)." in text
    # nothing else is left
    assert not causes.second_effects or all(
        abs(effect.value("bead_width") - rest) < 0.02 * wide for effect in causes.second_effects
    )


def test_drops_that_a_jet_loses_are_the_cause_of_a_narrow_bead():
    """Twice as many drops come due as the jet can shoot: half of them are lost, and width goes with the root."""
    jet = {"drop": 0.02, "top_rate": 2000.0}
    job = line_job(dispenser={"kind": "jet", "area": 2 * 0.02 * 2000.0 / SPEED, "jet": jet})
    run = job.follow()
    causes = causes_of(job, run)
    narrow = 100 * (1 - math.sqrt(0.5))
    kept = next(effect for effect in causes.effects if effect.cause.name == "shot rate")
    assert value_of(causes.row, "bead_width") == pytest.approx(narrow, abs=1.0)
    # drops are whole: in the ramps a tick has one more or less than its share
    assert kept.value("bead_width") < 5.0
    # a start lacks drops, too, and whichever of them is the worst has this cause
    by_name = worths(causes)
    assert max(by_name, key=by_name.get) == "shot rate"
    results = RunResults(job, job.built_machine, Budget(Analysis(run)), Bead(run, job.bead), glue_causes=causes)
    assert "shot rate (of the jet, which loses drops)" in headline(results)
    # a jet that keeps up loses none
    slower = line_job(dispenser={"kind": "jet", "area": 20.0 / SPEED, "jet": jet})
    kept_up = causes_of(slower, slower.follow())
    assert kept_up is None or worths(kept_up)["shot rate"] == pytest.approx(0.0, abs=1.0)


def test_at_constant_speed_a_flow_without_lag_lays_the_nominal_section_everywhere():
    job = line_job(SLOWER)
    bead = Bead(job.follow(), job.bead)
    run = at_constant_speed(job, bead)
    inside = bead.run.dispense[:-1] & (np.diff(bead.length) > 0)
    section = run.flow[:-1][inside] * run.period / np.diff(bead.length)[inside]
    # but for the ticks that the ends share with what is not dispensed
    assert np.median(section) == pytest.approx(bead.nominal, rel=0.02)
    assert np.ptp(section[2:-2]) < 1e-6 * bead.nominal


@pytest.mark.parametrize("lead", [0.0, 0.01])
def test_a_dead_time_is_worth_the_way_that_the_nozzle_goes_meanwhile(lead):
    job = line_job(dispenser={"area": 2.0, "dead_time": 0.05, "start_lead": lead, "stop_lead": lead})
    causes = causes_of(job, job.follow())
    delay = next(effect for effect in causes.effects if effect.cause.name == "valve delay")
    for name in ("missing_at_start", "excess_at_stop"):
        key = {"missing_at_start": "start_length", "excess_at_stop": "stop_length"}[name]
        before = value_of(causes.row, key)
        assert before > 0.5
        assert value_of(delay.row, key) == pytest.approx(0, abs=0.05)
    assert worths(causes)["lag"] == 0


def test_a_lag_is_worth_what_it_withholds():
    """A flow that rises with time constant T from a fixed demand withholds flow × T: a length of nominal bead."""
    job = line_job(dispenser={"flow": FLOW, "opening": 0.04, "closing": 0.04})
    causes = causes_of(job, job.follow())
    lag = next(effect for effect in causes.effects if effect.cause.name == "lag")
    missing = value_of(causes.row, "start_length")
    assert missing - value_of(lag.row, "start_length") == pytest.approx(0.04 * SPEED, rel=0.05)
    assert worths(causes)["valve delay"] == 0


def test_an_error_of_the_path_between_turns_and_one_of_the_height_are_told_apart():
    job = line_job(dispenser={"area": 2.0}, bead={"squashed": True, "gap": 0.4}, tolerance={"bead_width": 1.0})
    run = job.follow()
    middle = (run.nozzle[:, 0] > -20) & (run.nozzle[:, 0] < 20)
    nozzle = np.array(run.nozzle)
    nozzle[middle, 2] -= 0.1
    causes = causes_of(job, run.replaced(nozzle=nozzle))
    by_name = worths(causes)
    assert max(by_name, key=by_name.get) == "needle gap"
    assert by_name["needle gap"] == pytest.approx(causes.check.value, abs=1.0)
    assert abs(by_name["path error"]) < 0.1 * by_name["needle gap"]


def test_a_change_of_speed_is_the_cause_of_a_wide_bead_beside_dots_too():
    """The dots, which are laid at rest, stay as they are."""
    job = line_job(SLOWER.replace("M2\n", "G0 X-80 Y20\nM62 P0\nG4 P0.2\nM63 P0\nM2\n"))
    run = job.follow()
    bead = Bead(run, job.bead, Analysis(run))
    (dot,) = bead.dots
    steady = at_constant_speed(job, bead)
    (same,) = Bead(steady, job.bead, bead.analysis).dots
    assert (same.volume, same.demand, same.place) == (dot.volume, dot.demand, dot.place)
    causes = glue_causes_of(job, bead)
    by_name = worths(causes)
    assert max(by_name, key=by_name.get) == "speed changes"
    assert by_name["speed changes"] > 0.9 * causes.check.value


def test_what_is_left_without_the_main_cause_is_found_without_a_second_one_as_well():
    """A fixed flow that lags: at one speed the lag still lacks glue at the start, without both the bead is right."""
    job = line_job(SLOWER, dispenser={"flow": FLOW, "opening": 0.05, "closing": 0.05})
    causes = causes_of(job, job.follow())
    check = told_check(causes.row)
    values = {effect.cause.name: effect.value(check.name) for effect in causes.effects}
    assert min(values, key=values.get) == "speed changes"
    assert values["speed changes"] > 5
    # the dispenser has neither dead time nor leads, and the nozzle no error
    (both,) = causes.second_effects
    assert both.cause.name == "lag"
    assert both.value(check.name) < 1e-6


def test_glue_that_passes_has_no_causes():
    job = line_job(dispenser={"area": 2.0}, tolerance={"bead_width": 90.0, "start_length": 20, "stop_length": 20})
    assert causes_of(job, job.follow()) is None


def test_a_dispenser_without_dead_time_or_lag_has_no_compensation_of_it_either():
    base = Dispenser(flow=FLOW, dead_time=0.25, opening=0.5, closing=0.125, start_lead=0.75, stop_lead=0.125)
    assert without_dead_time(base) == replace(base, dead_time=0.0, start_lead=0.5, stop_lead=0.0)
    lagless = without_lag(replace(base, advance=0.5))
    assert lagless == replace(base, opening=0.0, closing=0.0, start_lead=0.25, stop_lead=0.125)
    both = without_lag(without_dead_time(base))
    assert both == Dispenser(flow=FLOW)
    ideal = Dispenser(flow=FLOW, start_lead=0.01)
    assert without_lag(ideal) is ideal
    assert without_dead_time(ideal) is ideal
    # a valve that closes later than it opens: each lead makes up for its own dead time
    late = replace(base, closing_dead_time=0.0625)
    assert without_dead_time(late) == replace(base, dead_time=0.0, start_lead=0.5, stop_lead=0.0625)
    assert without_lag(late) == replace(late, opening=0.0, closing=0.0, start_lead=0.25, stop_lead=0.0625)


def test_table_and_summary_have_every_cause_and_check():
    job = line_job(SLOWER)
    causes = causes_of(job, job.follow())
    section = glue_causes_section(causes)
    assert [row[0] for row in section.table.rows] == ["nothing", *(cause.name for cause in GLUE_CAUSES)]
    assert section.table.rows[0][1] == f"{causes.check.value:.1f}"
    for row in section.table.rows[1:]:
        assert float(row[2]) == pytest.approx(causes.check.value - float(row[1]), abs=0.11)
    content = glue_causes_summary(causes)
    assert list(content) == [cause.name for cause in GLUE_CAUSES]
    assert content["lag"]["worth"] == 0


def test_at_constant_speed_glue_of_a_lead_before_the_first_motion_is_laid_too():
    text = EVEN.replace("G0 X-80 Y0\n", "")
    program = {"controller": "linuxcnc.Program", "text": text, "start": [-80.0, 0.0, 0.0]}
    job = line_job(program=program, dispenser={"flow": FLOW, "start_lead": 0.1})
    run = job.follow()
    constant = at_constant_speed(job, Bead(run, job.bead))
    assert constant.flow.sum() * run.period == pytest.approx(FLOW * (160 / SPEED + 0.1), rel=5e-3)


@pytest.mark.parametrize(
    ("dispenser", "meaning"),
    [({"flow": FLOW}, "which the flow does not follow"), ({"area": FLOW / SPEED}, "which the flow follows late")],
)
def test_a_flow_by_speed_follows_speed_changes_late(dispenser, meaning):
    job = line_job(SLOWER, dispenser={**dispenser, "opening": 0.2, "closing": 0.2})
    causes = causes_of(job, job.follow())
    (speed,) = (effect.cause for effect in causes.effects if effect.cause.name == "speed changes")
    assert speed.meaning == meaning
