"""Fewest levers that pass, and one lever for one value: on sums that are known, and on a real job."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import Job
from gantrysim.engine.simulate import records_in_parts
from gantrysim.remedy.bench import Bench
from gantrysim.remedy.combination import MOST_MOTIONS, Combinations, Pick, fewest_levers, merged_picks
from gantrysim.remedy.course import Course, Prospect
from gantrysim.remedy.improve import improve
from gantrysim.remedy.lever import Lever, Setting, State
from gantrysim.remedy.levers.dispenser import LAG_COMPENSATION
from gantrysim.remedy.levers.program import FASTER, SLOWER
from gantrysim.remedy.outcome import Motion
from gantrysim.results.score import row_burden
from gantrysim.results.verdict import MotionRows

from support.remedies import AREA, LAG, SIDES, lines_job, outcome


class SumJob:
    """A job that is the sum of its settings."""

    def __init__(self, values=()):
        self.values = values

    def changed(self, changes):
        return SumJob((*self.values, *changes.values()))


def lever(name, *values):
    return Lever(name, "", "", ("path",), lambda state: [Setting(str(value), {name: value}) for value in values])


def sums(passes, duration=lambda values: 1.0, runs=None):
    """Combinations of levers that pass by their values."""

    def measure(job):
        if runs is not None:
            runs.append(job.values)
        burden = 0.0 if passes(job.values) else 1.0
        return SimpleNamespace(burden=burden, duration=duration(job.values), verdict=None)

    return Combinations(
        State(SumJob(), measure),
        lambda jobs, limit: [measure(job) for job in jobs],
        lambda _: {"path"},
        lambda job: job,
    )


def none_fails(jobs):
    return [False] * len(jobs)


def prospect_of(job):
    return Prospect(job, Course(), "")


def labels(picks):
    return [(pick.lever.name, pick.setting) for pick in picks]


ONE, TWO, THREE = lever("one", 1, 4), lever("two", 2, 8), lever("three", 3)
GREEDY = [Pick(ONE, "1"), Pick(TWO, "2"), Pick(THREE, "3")]


def test_fewer_levers_with_other_settings_replace_a_combination():
    """1 + 2 + 3 passes from 6 on, as 8 alone does."""
    combinations = sums(lambda values: sum(values) >= 6)
    assert labels(fewest_levers(combinations, GREEDY, repr, none_fails)) == [("two", "8")]


def test_of_as_few_levers_the_shortest_run_is_taken():
    combinations = sums(lambda values: sum(values) >= 11, duration=lambda values: 1.0 + 0.2 * (3 in values))
    picks = [Pick(ONE, "4"), Pick(TWO, "8"), Pick(THREE, "3")]
    assert labels(fewest_levers(combinations, picks, repr, none_fails)) == [("one", "4"), ("two", "8")]


def test_fewer_levers_that_take_longer_are_not_taken():
    combinations = sums(lambda values: sum(values) >= 6, duration=lambda values: 2.0 - 0.1 * len(values))
    assert labels(fewest_levers(combinations, GREEDY, repr, none_fails)) == labels(GREEDY)


def test_a_combination_that_does_not_pass_stays():
    assert labels(fewest_levers(sums(lambda values: False), GREEDY, repr, none_fails)) == labels(GREEDY)


def test_too_many_motions_are_not_simulated():
    runs = []
    many = lever("many", *range(1, MOST_MOTIONS + 2))
    combinations = sums(lambda values: sum(values) >= 100, runs=runs)
    picks = [Pick(many, "60"), Pick(lever("other", 40), "40")]
    assert labels(fewest_levers(combinations, picks, lambda job: str(job.values), none_fails)) == labels(picks)
    # of all in smaller numbers; one setting after the other is tried in place of the lever's
    assert not [values for values in runs if len(values) == 1]
    assert len(runs) <= MOST_MOTIONS + 4


def real(text=SIDES, **tables):
    job = lines_job(text, **tables)
    return Combinations(
        State(job, outcome), lambda jobs, limit: list(map(outcome, jobs)), lambda _: {"glue"}, lambda job: job
    )


@pytest.mark.parametrize(("first", "second", "shown"), [("1.41", "0.84", "× 1.184"), ("1.41", "0.5", "× 0.705")])
def test_two_factors_of_the_speed_are_one(first, second, shown):
    combinations = real()
    picks = [Pick(FASTER, f"× {first}"), Pick(SLOWER, f"× {second}")]
    (pick,) = merged_picks(combinations, picks)
    assert (pick.setting, pick.lever.name) == (shown, "faster" if float(shown[2:]) > 1 else "slower")
    job = combinations.state_of([pick]).job
    assert job.program["feed_override"] == float(shown[2:])
    assert job.program["feed_override"] == pytest.approx(combinations.state_of(picks).job.program["feed_override"])


def test_two_levers_of_a_compensation_are_one():
    """The second sets what the first compensates already."""

    def settings(state):
        return [
            Setting(f"{advance} s", {"dispenser.area": AREA, "dispenser.advance": advance}) for advance in (0.02, 0.025)
        ]

    both = Lever("both", "", "", ("glue",), settings)
    combinations = real(dispenser={"flow": 0.0, "area": 1.0, **LAG})
    picks = merged_picks(combinations, [Pick(both, "0.02 s"), Pick(LAG_COMPENSATION, "25 ms")])
    assert labels(picks) == [("both", "0.025 s")]


def test_levers_of_different_values_stay():
    combinations = real(dispenser={"area": AREA, **LAG})
    picks = [Pick(LAG_COMPENSATION, "20 ms"), Pick(SLOWER, "× 0.5")]
    assert labels(merged_picks(combinations, picks)) == labels(picks)


ROUNDED = """
Move G1 {25, 10}
Circle G1 Angle=-150 CircleCenter={25, -5}
Move G1 {-10, -30}
Move G1 {-30, 10}
"""


def test_a_real_job_passes_with_two_levers():
    """A fixed flow through a valve that opens in 30 ms: in proportion to the speed and compensated, with faster ramps.

    A greedy combination has five levers, and runs at 0.71 of the speed.
    """
    program = {"controller": "softmc.Program", "start": [-30.0, 10.0], "program": ROUNDED}
    program["group"] = {"velocity": 95.0, "acceleration": 1800.0}
    valve = {"flow": 160.0, "dead_time": 0.006, "opening": 0.03, "closing": 0.015}
    content = {"name": "valve", "machine": "xy", "program": program, "servo": {"period": 0.001}, "dispenser": valve}
    result = improve(Job.of_content(content, "job valve"))
    assert result.improved.state == "pass"
    assert [trial.lever.name for trial in result.combination] == ["flow by speed", "acceleration"]
    assert result.after.duration < result.before.duration


def test_levers_that_leave_a_row_alone_are_not_tried_without_others():
    """Of two rows that fail, each lever acts on one: no lever alone can do."""
    runs = []
    combinations = sums(lambda values: sum(values) >= 6, runs=runs)
    two_rows = Combinations(
        combinations.state_of([]), combinations.promising, lambda _: {"path", "glue"}, lambda job: job
    )
    glue = Lever("glue lever", "", "", ("glue",), lambda state: [Setting("5", {"glue": 5})])
    picks = [Pick(ONE, "1"), Pick(glue, "5")]
    assert labels(fewest_levers(two_rows, picks, repr, none_fails)) == labels(picks)
    assert (5,) not in runs


def test_a_motion_that_fails_is_not_tried_with_another_glue():
    """A job of three leads, with one motion: alone none is measured where it fails, all are where it does not."""
    for fails, count in ((True, 0), (False, 4)):
        runs = []
        combinations = sums(lambda values: sum(values) >= 35, runs=runs)
        picks = [Pick(lever("leads", 10, 20, 30), "30"), Pick(lever("other", 5), "5")]
        assert combinations.state_of(picks).outcome.burden == 0
        runs.clear()
        fewest_levers(combinations, picks, lambda job: "one motion", lambda jobs, fails=fails: [fails] * len(jobs))
        assert len([values for values in runs if len(values) == 1]) == count


def glue_lever():
    return Lever("glue", "", "", ("path",), lambda state: [Setting(str(k), {"dispenser.area": k}) for k in range(1, 5)])


def test_the_glue_is_varied_for_motions_alone_that_do_not_fail():
    """Of a lever of the glue and one that moves, four settings each: the one motion that holds leaves four runs.

    A third lever, which the other two can do without, makes it two of three.
    """
    runs = []
    asked = []
    combinations = sums(lambda values: sum(values) >= 72, runs=runs)
    moving = lever("moving", 10, 20, 30, 70)
    picks = [Pick(glue_lever(), "4"), Pick(moving, "70"), Pick(lever("spare", 0), "0")]

    def motions_fail(jobs):
        asked.append([job.values for job in jobs])
        return [70 not in job.values for job in jobs]

    assert combinations.state_of(picks).outcome.burden == 0
    runs.clear()
    fewest = fewest_levers(combinations, picks, lambda job: str([v for v in job.values if v >= 10]), motions_fail)
    assert labels(fewest) == [("glue", "2"), ("moving", "70")]
    # alone, where the glue's settings share the motion of the job as it is, and two together
    one, two = asked
    assert one == [(), (10,), (20,), (30,), (70,)]
    assert two == [(10,), (20,), (30,), (70,), (0,)]
    assert [values for values in runs if len(values) == 2 and 70 in values and 0 not in values] == [
        (k, 70) for k in range(1, 5)
    ]


@given(seed=st.integers(0, 2**32 - 1))
def test_where_all_levers_are_needed_no_single_exchange_is_better(seed):
    """Random levers and durations: of the combinations that pass, none with one other setting has a shorter run."""
    random = np.random.default_rng(seed)
    levers = [lever(f"lever {k}", *(10**k * np.arange(1, 4)).tolist()) for k in range(3)]
    every = [(x, y, z) for x in (1, 2, 3) for y in (10, 20, 30) for z in (100, 200, 300)]
    share = random.choice([0.6, 1.0])
    passes = {values for values in every if random.random() < share}
    durations = {values: float(random.integers(1, 6)) for values in every}
    if not passes:
        return
    begin = min(passes, key=lambda values: (-durations[values], values))
    combinations = sums(passes.__contains__, duration=lambda values: durations.get(values, 1.0))
    picks = [Pick(one, str(value)) for one, value in zip(levers, begin, strict=True)]
    found = fewest_levers(combinations, picks, lambda job: str(job.values), none_fails)
    values = tuple(int(pick.setting) for pick in found)
    assert values in passes
    assert durations[values] <= durations[begin]
    # what failed beside others is not tried again, so that these need not be known
    near = [other for other in passes if sum(a != b for a, b in zip(other, values, strict=True)) == 1]
    if passes == set(every):
        assert all(durations[other] >= durations[values] for other in near)


def test_of_settings_that_are_as_good_the_first_is_taken():
    """The glue's first setting is the plainest; that of a motion with a shorter run comes before it."""
    runs = []
    combinations = sums(
        lambda values: len(values) == 2 and sum(values) >= 40,
        duration=lambda values: 2.0 if 70 in values else 1.0,
        runs=runs,
    )
    picks = [Pick(glue_lever(), "4"), Pick(lever("moving", 10, 50, 70), "70")]
    found = fewest_levers(combinations, picks, lambda job: str(job.values), none_fails)
    assert labels(found) == [("glue", "1"), ("moving", "50")]
    # the motion of 10 fails beside one glue, and is not tried beside others
    assert len([values for values in runs if 10 in values and len(values) == 2]) == 1


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"tolerance.path_max": 1e-3},
        {"tolerance.least_gain_margin": 100.0},
        {"tolerance.torque_reserve": 99.9},
        {"dispenser.dead_time": 0.2},
    ],
)
def test_a_motion_fails_as_its_verdict_says(changes):
    """Without the bead and the links, as with them: path, stability or machine fail, or the glue alone."""
    job = lines_job(SIDES, dispenser={"area": AREA, **LAG}).changed(changes)
    motion = Motion.of(job)
    verdict = motion.outcome(job).verdict
    rows = [row for row in verdict.rows if row.name != "glue"]
    assert list(MotionRows.of(job, motion.budget)) == rows
    is_of_motion = bool(changes) and "dispenser.dead_time" not in changes
    assert motion.outcome(job).motion_burden == sum(map(row_burden, rows))
    assert (Motion.of(job).burden > 0) == is_of_motion
    prospect = prospect_of(job)
    judged = prospect.judge_motion()
    assert (prospect.course.burden > 0) == is_of_motion
    # a path that is left ends the run early, and loops without margins need none
    assert (judged is None) == bool({"tolerance.path_max", "tolerance.least_gain_margin"} & set(changes))
    if judged is not None:
        np.testing.assert_array_equal(judged.run.nozzle, motion.run.nozzle)


def test_a_job_that_is_refused_has_no_motion_whose_failure_counts():
    """An unstable servo: as a trial, its outcome tells why; simulated, it would fail as a path that is left does."""
    job = lines_job(SIDES, servo={"kp": 100.0, "kd": 0.0})
    assert prospect_of(job).judge_motion() is None
    assert Bench(job, workers=1).motions_fail([job]) == [False]


@pytest.mark.parametrize("share", [0.5, 1.22, 1.28, 2.0])
def test_a_run_ends_early_only_beyond_the_limit_of_its_path(share):
    """The limit is a share of the largest distance in the whole run, which a part of the run has already."""
    job = lines_job(SIDES, dispenser={"area": AREA, **LAG})
    largest = float(Motion.of(job).budget.contour_values.max)
    at_limit = job.changed({"tolerance.path_max": share * largest, "tolerance.path_p95": 2 * largest})
    prospect = prospect_of(at_limit)
    judged = prospect.judge_motion()
    assert (prospect.course.burden > 0) == (Motion.of(at_limit).burden > 0)
    # a warning counts, from 80 % of the limit on
    assert (judged is None) == (share < 1.25)


def test_a_trial_needs_no_links_of_its_budget():
    """They are for the check of the errors against one another, which the run that is shown has."""
    job = lines_job(SIDES, dispenser={"area": AREA, **LAG})
    trial = Motion.of(job)
    shown = Motion.of(job, "loop")
    assert trial.outcome(job).verdict == shown.outcome(job).verdict
    assert "contradictions" not in vars(trial.budget)
    assert shown.budget.contradictions == ()


def test_a_record_in_parts_begins_as_the_complete_one():
    job = lines_job(SIDES, dispenser={"area": AREA, **LAG})
    *parts, last = records_in_parts(job.prepared_simulation(), (0.1, 0.5))
    whole = job.run(engine="loop")
    assert [round(len(part.time) / len(whole.time), 1) for part in parts] == [0.1, 0.5]
    for run in (*parts, last):
        np.testing.assert_array_equal(run.nozzle, whole.nozzle[: len(run.time)])
    assert len(last.time) == len(whole.time)


def test_a_motion_does_not_fail_by_the_load_that_the_glue_makes():
    """A piston of 20 N that cannot press 2 mm² through its needle presses 0.02 mm²: the motion is the same."""
    needle = {"bore": 0.84, "length": 12.0, "consistency": 8.0, "index": 1.0}
    piston = {"kind": "piston", "needle": needle, "piston": {"charge": math.inf, "compliance": 0.02, "force": 20.0}}
    jobs = [lines_job(SIDES, dispenser={"area": area, **piston}) for area in (2.0, 0.02)]
    motion = Motion.of(jobs[0])
    outcomes = [motion.outcome(job) for job in jobs]
    burdens = [row_burden(outcome.verdict["machine"]) for outcome in outcomes]
    assert burdens[0] > burdens[1] == 0
    assert motion.burden == 0
    assert [outcome.motion_burden for outcome in outcomes] == [0, 0]
