"""Each lever with a job where it must help, and one where it must not apply, with its reason."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gantrysim import Job
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.glue.dispenser.needle import Needle
from gantrysim.glue.dispenser.piston import Piston
from gantrysim.remedy.improvement import bound_of, controller_words
from gantrysim.remedy.lever import State, scaled_numbers
from gantrysim.remedy.levers import LEVERS
from gantrysim.remedy.levers.dispenser import compensations
from gantrysim.remedy.levers.program import ACCELERATION, CORNERS, SLOWER, speed_changes
from gantrysim.results.score import usage_of

from support.remedies import (
    ACROSS,
    AREA,
    CIRCLE,
    DOTS,
    LAG,
    SIDES,
    content_of,
    fixed_flow,
    lagging,
    lines_job,
    outcome,
    rubbing,
    sliced_job,
    spiral_job,
)
from support.soaked import suite_runs

BY_NAME = {lever.name: lever for lever in LEVERS}
LATE = {"area": 0.0, "flow": 200.0, "dead_time": 0.04}


def coarse():
    """Friction is compensated, and counts of 0.1 mm remain."""
    return lines_job(CIRCLE, servo={"resolution": 0.1, "law": ["pid", "friction"]})


PISTON = {
    "kind": "piston",
    "needle": {"bore": 0.84, "length": 12.0, "consistency": 8.0, "index": 1.0},
    "piston": {"charge": math.inf, "compliance": 0.02},
}


def soft():
    """A piston that lags by its compliance."""
    return lines_job(SIDES, dispenser={"area": AREA, **PISTON})


def extruded(before=""):
    """A square whose E drives the piston."""
    words = "".join(f"G1 X{x} Y{y} E0.4\n" for x, y in ((40, 0), (40, 40), (0, 40), (0, 2)))
    text = f"{before}M83\nM204 S1000\nM205 X5 Y5\nF3000\n{words}"
    return Job.of_content(content_of({"controller": "slicer.Program", "text": text}, dispenser=PISTON), "job small")


def crooked():
    return lines_job(CIRCLE, geometry={"accuracy": "C7"})


def across():
    return lines_job(ACROSS, machine="xyz")


def ideal_valve():
    return lines_job(SIDES)


def dry():
    return lines_job(SIDES, dispenser={})


def late():
    return lines_job(SIDES, dispenser=LATE)


def by_hand():
    """Gains of the loop's own."""
    return lines_job(CIRCLE, servo={"kp": 1.0, "kd": 0.02})


def compensated():
    return lines_job(CIRCLE, servo={"law": ["pid", "friction", "observer", "learning"]})


def in_text():
    program = {"controller": "trio.Basic", "text": "BASE(0,1)\nSPEED=50\nMOVE(20,0)\nWAIT IDLE\nSTOP"}
    return Job.of_content(content_of(program), "job small")


def exact_spiral():
    return spiral_job(wait_resolution=0.0)


def finest():
    return lines_job(CIRCLE, geometry={"accuracy": "C0"})


# lever: job, row of the verdict, label of the setting, largest share of the usage that remains
HELPS = {
    "flow by speed": (fixed_flow, "glue", "area 2 mm²", 0.5),
    "lag compensation": (lagging, "glue", "20 ms", 0.5),
    "pressure advance": (soft, "glue", "157.1 ms", 0.2),
    "friction compensation": (rubbing, "path", "", 0.2),
    "disturbance observer": (rubbing, "path", "", 0.7),
    "learning": (rubbing, "path", "", 0.1),
    "integral time": (rubbing, "path", "9 ms", 0.7),
    "loop gains": (rubbing, "path", "× 1.2", 0.8),
    "acceleration": (fixed_flow, "glue", "× 4", 0.6),
    "loop period": (exact_spiral, "path", "20 ms", 0.5),
    "faster": (sliced_job, "glue", "× 1.41", 0.9),
    "exact waits": (lambda: spiral_job(loop_period=0.01), "path", "instead of WA", 0.6),
    "corner rounding": (sliced_job, "path", "× 0.5", 0.6),
    "lift": (across, "glue", "3 mm", 0.01),
    "needle height": (sliced_job, "glue", "× 0.8", 0.97),
    "slower": (rubbing, "path", "× 0.5", 0.8),
    "faster valve": (lagging, "glue", "× 0.25", 0.7),
    "servo period": (rubbing, "path", "0.25 ms", 0.3),
    "encoder": (coarse, "path", "counts / 16", 0.5),
    "accuracy class": (crooked, "path", "C3", 0.8),
}

# lever: job to which it does not apply, and why
DOES_NOT_APPLY = {
    "flow by speed": (lagging, "proportional to the path speed"),
    "lag compensation": (ideal_valve, "no lag"),
    "pressure advance": (ideal_valve, "a valve, which no motor drives"),
    "leads": (dry, "lays no bead"),
    "friction compensation": (compensated, "in the law already"),
    "disturbance observer": (compensated, "in the law already"),
    "learning": (compensated, "in the law already"),
    "integral time": (by_hand, "given in the job"),
    "loop gains": (by_hand, "given in the job"),
    "acceleration": (in_text, "text sets the accelerations"),
    "loop period": (rubbing, "without a loop"),
    "exact waits": (exact_spiral, "exact"),
    "corner rounding": (rubbing, "no corner of the program is rounded without a tolerance"),
    "lift": (lambda: lines_job(ACROSS), "no axis z"),
    "needle height": (dry, "lays no bead"),
    "faster valve": (ideal_valve, "at once"),
    "encoder": (lambda: lines_job(CIRCLE, servo={"resolution": 0.0}), "exact"),
    "accuracy class": (finest, "C0 is the finest"),
}

# levers that always apply: job and row that they do not improve by a hundredth, and the setting
DOES_NOT_HELP = {
    "faster": (rubbing, "path", "× 1.41"),
    "slower": (lambda: lines_job(SIDES), "stability", "× 0.5"),
    "servo period": (fixed_flow, "glue", "0.5 ms"),
}


def settings_of(name, job):
    return BY_NAME[name].settings(State(job, outcome))


def changed(name, job, label):
    settings = settings_of(name, job)
    assert not isinstance(settings, str), settings
    (setting,) = [setting for setting in settings if setting.label == label]
    return job.changed(setting.changes)


def usage(job, row):
    shown = outcome(job)
    assert not shown.failure, shown.failure
    return usage_of(shown.verdict[row])


def test_every_lever_is_in_the_tables():
    names = [lever.name for lever in LEVERS]
    assert len(set(names)) == len(names)
    assert {*HELPS, "leads"} == set(names) == {*DOES_NOT_APPLY, *DOES_NOT_HELP}


@pytest.mark.parametrize("name", HELPS)
def test_a_lever_helps_where_it_must(name):
    build, row, label, share = HELPS[name]
    job = build()
    assert usage(changed(name, job, label), row) < share * usage(job, row)


@pytest.mark.parametrize("name", DOES_NOT_APPLY)
def test_a_lever_says_why_it_does_not_apply(name):
    build, reason = DOES_NOT_APPLY[name]
    assert reason in settings_of(name, build())


@pytest.mark.parametrize("name", DOES_NOT_HELP)
def test_a_lever_does_not_help_where_it_cannot(name):
    build, row, label = DOES_NOT_HELP[name]
    job = build()
    assert usage(changed(name, job, label), row) > 0.99 * usage(job, row)


@pytest.mark.parametrize("label", ["of the dead time", "of the measured ends"])
def test_leads_shorten_the_starts_and_stops_of_a_late_valve(label):
    def ends(job):
        checks = outcome(job).verdict["glue"].checks
        return max(check.usage for check in checks if check.name in ("start_length", "stop_length"))

    assert ends(late()) > 1
    assert ends(changed("leads", late(), label)) < 0.05


def test_the_leads_of_the_dead_time_are_those_of_opening_and_closing():
    job = lines_job(SIDES, dispenser=LATE | {"closing_dead_time": 0.015})
    settings = {setting.label: setting.changes for setting in settings_of("leads", job)}
    expected = {"dispenser.start_lead": 0.04, "dispenser.stop_lead": 0.015}
    assert settings["of the dead time"] == expected
    # where there is no lag, the ends of the bead say the same
    assert settings["of the measured ends"] == pytest.approx(expected, abs=1e-3)


def test_the_measured_leads_are_the_dead_time_of_a_valve_without_lag():
    """At a speed of 100 mm/s the glue of 40 ms is missing, and in excess."""
    settings = {setting.label: setting.changes for setting in settings_of("leads", late())}
    for name in ("dispenser.start_lead", "dispenser.stop_lead"):
        assert settings["of the measured ends"][name] == pytest.approx(0.04, abs=1e-3)


def test_missing_and_excess_glue_are_means_over_the_ends():
    """A dead time of 40 ms is 4 mm at 100 mm/s, and 2 mm at half of it."""
    fast = "M62 P0\nG1 X40 F6000\nM63 P0\nG0 Y20\n"
    slow = "M62 P0\nG1 X0 F3000\nM63 P0\nG0 Y40\n"
    both = outcome(lines_job(f"G21 G90 G64\n{fast}{slow}M2\n", dispenser={"area": AREA, "dead_time": 0.04}))
    assert [both.missing, both.excess] == pytest.approx([3.0, 3.0], rel=1e-4)


@pytest.mark.parametrize(
    ("before", "line"),
    suite_runs(
        [
            ("", "M900 K0.157"),
            ("; gcode_flavor = klipper\n", "SET_PRESSURE_ADVANCE ADVANCE=0.157"),
            (";FLAVOR:RepRap\n", "M572 D0 S0.157"),
        ],
        0,
    ),
)
def test_an_extruder_s_advance_is_proposed_in_the_words_of_its_firmware(before, line):
    job = extruded(before)
    (setting,) = settings_of("pressure advance", job)
    assert setting.changes == {"program.pressure_advance": pytest.approx(0.1571)}
    better = job.changed(setting.changes)
    assert usage(better, "glue") < 0.2 * usage(job, "glue")
    assert controller_words(job, better).startswith(line)
    # what is pasted is what was run: the line in the program gives the same motion of the motor
    pasted = extruded(before + controller_words(job, better).split(";")[0] + "\n")
    np.testing.assert_array_equal(pasted.setpoints.extruder, better.setpoints.extruder)
    assert settings_of("pressure advance", pasted) == "the program sets its pressure advance itself"


def test_a_shear_thinning_glue_has_several_lags():
    """Of Q = C p^(1/n), the lag of small changes is n times that of the rise from rest."""
    needle = Needle(bore=0.84, length=12.0, consistency=30.0, index=0.5)
    drive = Dispenser(area=AREA, kind="piston", needle=needle, piston=Piston(charge=math.inf)).drive
    small, whole = drive.lags(50.0)
    assert small == pytest.approx(0.5 * whole, rel=1e-5)
    assert whole == pytest.approx(0.05 * needle.pressure(50.0) / 50.0, rel=1e-9)


def test_dots_keep_their_flow():
    job = lines_job(DOTS, dispenser={"flow": 40.0})
    assert "dots" in settings_of("flow by speed", job)
    (dot,) = outcome(job).dots
    assert dot == pytest.approx(0.1 * 40.0, rel=0.02)
    # a valve that opens and closes late feeds as much, partly into a string
    text = "G21 G90\nG0 X25\nM62 P0\nG4 P0.1\nM63 P0\nG0 X60\nG4 P0.2\nM2\n"
    (dot,) = outcome(lines_job(text, dispenser={"flow": 40.0, **LAG})).dots
    assert dot == pytest.approx(0.1 * 40.0, rel=0.02)


def test_the_speed_keeps_the_section_of_a_fixed_flow():
    job = changed("slower", fixed_flow(), "× 0.5")
    assert job.controller.programmed_speed == pytest.approx(50)
    assert job.dispenser.flow == pytest.approx(100)
    assert outcome(job).nominal == pytest.approx(AREA, rel=1e-6)


def test_factors_are_numbers_that_people_type():
    """A feed of 15 mm/s at 10.65 mm/s in floating point is 0.7100000000000001."""
    text = "G21 G90 G1 X20 F900"
    job = Job.of_content(content_of({"controller": "linuxcnc.Program", "text": text, "rapid": 100.0}), "job small")
    settings = {setting.label: setting.changes for setting in settings_of("slower", job)}
    assert str(settings["× 0.71"]["program.feed_override"]) == "0.71"


NEEDLE = {"bore": 0.84, "length": 25.0, "consistency": 2.0}


@pytest.mark.parametrize("factor", [0.5, 1.3])
def test_another_speed_keeps_the_section_whatever_meters_the_flow(factor):
    """A pump's flow goes with the speed, a pressure is that which drives the flow, an area does by itself."""
    speed = factor * 100.0
    pumped = lines_job(SIDES, dispenser={"flow": 200.0, "needle": NEEDLE})
    assert speed_changes(pumped, speed)["dispenser.flow"] == pytest.approx(factor * 200.0)
    assert "dispenser.pressure" not in speed_changes(pumped, speed)
    pressed = lines_job(SIDES, dispenser={"pressure": 300.0, "metering": "time-pressure", "needle": NEEDLE})
    needle = pressed.dispenser.needle
    pressure = speed_changes(pressed, speed)["dispenser.pressure"]
    assert needle.flow(pressure) == pytest.approx(factor * needle.flow(300.0), rel=1e-3)
    assert "dispenser.flow" not in speed_changes(pressed, speed)
    by_area = lines_job(SIDES)
    assert not [key for key in speed_changes(by_area, speed) if key.startswith("dispenser")]


def test_learning_needs_a_base_law_that_it_knows_whatever_is_added_to_it():
    for law in (["support.own_laws:pd"], ["support.own_laws:pd", "friction"]):
        reason = settings_of("learning", lines_job(CIRCLE, servo={"law": law}))
        assert reason == "needs a base law whose answer it knows, not one of your own"
    (setting,) = settings_of("learning", lines_job(CIRCLE, servo={"law": ["pid", "friction"]}))
    assert setting.changes == {"servo.law": ["pid", "friction", "learning"]}


def test_a_faster_valve_keeps_what_is_fitted_to_it():
    job = lines_job(SIDES, dispenser={"area": AREA, **LAG, "advance": 0.025, "stop_lead": 0.004})
    dispenser = changed("faster valve", job, "× 0.5").dispenser
    assert (dispenser.dead_time, dispenser.opening, dispenser.advance) == (0.0025, 0.01, 0.0125)
    assert dispenser.stop_lead == 0.002


def test_a_needle_that_touches_nothing_or_is_lifted_by_its_program_is_not_lifted():
    assert settings_of("lift", lines_job(SIDES, machine="xyz")) == "the needle does not touch its bead"
    text = ACROSS.replace("M2", "G0 Z5\nM2")
    assert settings_of("lift", lines_job(text, machine="xyz")) == "the program itself sets the height of the needle"


def test_the_needle_is_up_between_the_codes_of_the_valve():
    job = changed("lift", across(), "3 mm")
    setpoints = job.controller.setpoints(1e-3)
    z = setpoints.position[:, setpoints.axes.index("z")]
    moves = abs(setpoints.position[:, 1]) > 1e-6  # y moves in the dry moves alone
    assert z[setpoints.dispense].max() == pytest.approx(0, abs=1e-9)
    assert z[moves].min() > 1  # the corner between lifting and moving is rounded
    assert z.max() == pytest.approx(3)


def test_a_loop_in_a_text_is_named_where_no_key_varies_it():
    text = "SPEED=50\nMOVE(20,0)\nREPEAT\n  WA(50)\nUNTIL MTYPE=0"
    job = Job.of_content(content_of({"controller": "trio.Basic", "text": text}), "job small")
    for name in ("loop period", "exact waits"):
        assert settings_of(name, job) == "the program's own loop, line 3, REPEAT, stands in its text"


def test_a_compensation_may_be_each_time_constant_itself():
    """Opening 30 ms, closing 15 ms, dead time 6 ms: both, the longer with the dead time, and a mean of the extremes."""
    dispenser = Dispenser(area=1.7, dead_time=0.006, opening=0.03, closing=0.015)
    assert compensations(dispenser) == [0.015, 0.0255, 0.03, 0.036]
    assert compensations(replace(dispenser, advance=0.03)) == [0.015, 0.0255, 0.036]


def in_hertz():
    return lines_job(CIRCLE, servo={"frequency": 20.0})


def in_class(name):
    return lambda: lines_job(CIRCLE, geometry={"accuracy": name})


# lever, job, and all its settings: label and new values, by hand
SETTINGS = [
    (
        "needle height",
        lambda: lines_job(SIDES, bead={"gap": 0.4}),
        {"× 0.8": {"bead.gap": 0.32}, "× 1.25": {"bead.gap": 0.5}, "× 1.5": {"bead.gap": 0.6}},
    ),
    (
        "loop gains",
        in_hertz,
        {
            "× 0.8": {"servo.frequency": 16.0},
            "× 1.2": {"servo.frequency": 24.0},
            "× 1.4": {"servo.frequency": 28.0},
        },
    ),
    (
        "integral time",
        lambda: lines_job(CIRCLE, servo={"integral_time": 0.04}),
        {"20 ms": {"servo.integral_time": 0.02}, "12 ms": {"servo.integral_time": 0.012}},
    ),
    (
        "servo period",
        lambda: lines_job(CIRCLE, servo={"period": 2e-3}),
        {"1 ms": {"servo.period": 1e-3}, "0.5 ms": {"servo.period": 5e-4}},
    ),
    (
        "encoder",
        lambda: lines_job(CIRCLE, servo={"resolution": [0.08, 0.008]}),
        {
            "counts / 4": {"servo.resolution": [0.02, 0.002]},
            "counts / 16": {"servo.resolution": [0.005, 0.0005]},
        },
    ),
    ("accuracy class", in_class("C7"), {"C5": {"geometry.accuracy": "C5"}, "C3": {"geometry.accuracy": "C3"}}),
    (
        "faster valve",
        lambda: lines_job(SIDES, dispenser={"area": AREA, "opening": 0.04, "closing": 0.02, "start_lead": 0.004}),
        {
            "× 0.5": {"dispenser.opening": 0.02, "dispenser.closing": 0.01, "dispenser.start_lead": 0.002},
            "× 0.25": {"dispenser.opening": 0.01, "dispenser.closing": 0.005, "dispenser.start_lead": 0.001},
        },
    ),
]


@pytest.mark.parametrize(("name", "build", "settings"), SETTINGS, ids=[row[0] for row in SETTINGS])
def test_the_settings_of_a_lever_are_the_present_values_times_their_factors(name, build, settings):
    found = {setting.label: setting.changes for setting in settings_of(name, build())}
    assert list(found) == list(settings)
    for label, changes in settings.items():
        assert set(found[label]) == set(changes)
        for key, value in changes.items():
            assert found[label][key] == (value if isinstance(value, str) else pytest.approx(value, rel=1e-3))


def test_the_speeds_that_are_tried_are_those_of_their_labels():
    """At 100 mm/s; the flow goes with the speed."""
    for name, factors in (("slower", (0.84, 0.71, 0.5)), ("faster", (1.41,))):
        settings = settings_of(name, fixed_flow())
        assert [setting.label for setting in settings] == [f"× {factor:g}" for factor in factors]
        for setting, factor in zip(settings, factors, strict=True):
            assert setting.changes == speed_changes(fixed_flow(), 100.0 * factor)
            assert setting.changes["dispenser.flow"] == pytest.approx(factor * 200.0)


def test_a_height_that_the_job_leaves_open_is_that_of_the_machine():
    job = lines_job(SIDES)
    assert job.bead.gap is None
    gap = job.built_machine.gap
    changes = [setting.changes["bead.gap"] for setting in settings_of("needle height", job)]
    assert changes == pytest.approx([0.8 * gap, 1.25 * gap, 1.5 * gap], rel=1e-3)


def test_what_binds_a_driven_dispenser_is_the_pressure_of_its_glue():
    job = soft()
    assert bound_of(job, "glue") == "the dispenser, whose motor works against the pressure of the glue"
    assert bound_of(lagging(), "glue").startswith("the dispenser, which lags by ")
    fed = extruded()
    assert bound_of(fed, "glue").startswith("the dispenser, whose motor")


def test_corners_rounded_as_far_as_lines_reach_get_a_tolerance():
    job = lines_job("M62 P0\nG1 F1200 X30\nG1 X30 Y20\nM63 P0\nG0 X0 Y0", tolerance={"path_max": 0.1})
    state = State(job, outcome)
    (path,) = (row for row in state.outcome.verdict.rows if row.name == "path")
    assert path.checks[0].usage > 1
    tolerances = {}
    for setting in BY_NAME["corner rounding"].settings(state):
        (key,) = setting.changes
        assert key == "program.corner_tolerance"
        tolerances[setting.label] = setting.changes[key]
        rounded = job.changed(setting.changes)
        # the command leaves the corner by no more than what G64 P admits
        assert rounded.controller.corner_cut == 0
        distance = np.linalg.norm(rounded.setpoints.position[:, :2] - [30.0, 0.0], axis=1).min()
        # at the nearest of ticks that are at most 0.02 mm apart, at 20 mm/s
        assert 0 < distance <= math.hypot(setting.changes[key], 0.01)
    assert tolerances == {
        "within 0.08 mm by G64 P": 0.08,
        "within 0.05 mm by G64 P": 0.05,
        "within 0.025 mm by G64 P": 0.025,
    }


@pytest.mark.parametrize(
    ("lever", "label", "cost"),
    [
        (ACCELERATION, "× 4", "torque"),
        (ACCELERATION, "× 0.25", "time"),
        (CORNERS, "× 2", "shape of the corners"),
        (CORNERS, "within 0.05 mm by G64 P", "time"),
        (SLOWER, "× 0.5", "cycle time"),
    ],
)
def test_a_cost_goes_with_the_direction_of_a_factor(lever, label, cost):
    assert lever.cost_of(label) == cost


def test_limits_of_all_axes_are_scaled_one_by_one():
    assert scaled_numbers([200.0, (50, 80.0)], 2.0) == [400.0, [100.0, 160.0]]
    assert scaled_numbers([200.0, None], 2.0) is scaled_numbers(True, 2.0) is scaled_numbers("fast", 2.0) is None
