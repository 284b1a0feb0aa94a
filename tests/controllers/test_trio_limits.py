"""The Move Spiral within its controller's limits, against that controller stepped servo tick by servo tick."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from gantrysim.base.errors import InputError
from gantrysim.controllers.trio import MoveSpiral

from support.soaked import examples
from support.stepped import NEVER_BELOW, POSITION, RELATIVE, SPEED, STEPPED, WHOLE_MS, Controller, end_of, note, places


@st.composite
def jobs(draw, accelerated=True):
    """Arguments of a spiral that its controller's limits shape, without its ratio ever falling to zero."""
    diameter = draw(st.floats(20, 60))
    turns = draw(st.integers(1, 4))
    speed = draw(st.floats(30, 200))
    servo_period = draw(st.sampled_from([0.0005, 0.001, 0.002]))
    period = max(math.pi * diameter * turns / speed / draw(st.floats(15, 200)), 4 * servo_period)
    job = {
        "diameter": diameter,
        "turns": turns,
        "thickness": diameter * (1 - draw(st.floats(0.35, 0.95))) / (2 * turns),
        "speed": speed,
        "servo_period": servo_period,
        "loop_period": period,
        "interpreter_time": period * draw(st.sampled_from([0.0, 0.013, 0.1])),
        "start": draw(st.tuples(st.floats(-50, 50), st.floats(-50, 50))),
        "clockwise": draw(st.booleans()),
        "wait_resolution": draw(st.sampled_from([0.0, WHOLE_MS])) if period > 20 * WHOLE_MS else 0.0,
        "ratio_bits": draw(st.sampled_from([None, 16])),
    }
    if accelerated:
        job["acceleration"] = speed / draw(st.floats(0.01, 0.3))
        job["deceleration"] = draw(st.sampled_from([None, 0.3, 2.0, math.inf]))
        if job["deceleration"] is not None:
            job["deceleration"] *= job["acceleration"]
    return job


def built(job):
    try:
        return MoveSpiral(**job)
    except InputError:
        assume(False)


@pytest.mark.validates(
    "Move Spiral with the limits of the controller",
    "a controller stepped tick by tick",
    "1e-9 mm",
)
@given(jobs(accelerated=False))
@examples(25)
def test_setpoints_agree_with_the_stepped_controller_without_accel(job):
    spiral, stepped = built(job), Controller(**job).run()
    commanded = places(spiral.setpoints(job["servo_period"]))
    assert np.abs(len(commanded) - len(stepped.places)) <= 1  # the end may round either way
    n = min(len(commanded), len(stepped.places)) - 1
    assert commanded[:n] == pytest.approx(np.array(stepped.places)[:n], abs=POSITION)
    assert commanded[-1] == pytest.approx(stepped.places[-1], abs=POSITION)
    assert spiral.ratios == pytest.approx(np.array(stepped.ratios), abs=RELATIVE)


@given(jobs())
@examples(30)
def test_setpoints_agree_with_the_stepped_controller_with_an_exact_profile_within_a_tick(job):
    spiral, stepped = built(job), Controller(**job).run()
    assume(stepped.ratios[-1] > 1e-3)
    commanded = places(spiral.setpoints(job["servo_period"]))
    assert np.abs(len(commanded) - len(stepped.places)) <= 1
    n = min(len(commanded), len(stepped.places)) - 1
    assert commanded[:n] == pytest.approx(np.array(stepped.places)[:n], abs=POSITION)
    assert commanded[-1] == pytest.approx(stepped.places[-1], abs=POSITION)
    time = np.arange(n) * job["servo_period"]
    if math.isfinite(spiral.deceleration or 0):  # else the speed may jump to zero within the last tick
        assert spiral.passes.profile.position(time) == pytest.approx(np.array(stepped.ways)[:n], abs=POSITION)
        assert spiral.passes.profile.velocity(time) == pytest.approx(np.array(stepped.speeds)[:n], abs=1e-6)


@pytest.mark.parametrize("servo_period", [0.0005, 0.001, 0.002])
@pytest.mark.parametrize(("acceleration", "deceleration"), [(1000, None), (120, None), (1000, 300), (300, 1000)])
def test_a_controller_of_whole_ticks_agrees_to_half_a_ticks_distance(servo_period, acceleration, deceleration):
    """Its virtual speed is changed at ticks alone, so that it agrees to the first order in the servo period."""
    job = {"diameter": 120, "turns": 4, "thickness": 10, "speed": 100, "servo_period": servo_period}
    job |= {"acceleration": acceleration, "deceleration": deceleration}
    spiral, stepped = MoveSpiral(**job), Controller(**job, exact=False).run()
    commanded = places(spiral.setpoints(servo_period))
    n = min(len(commanded), len(stepped.places)) - 1
    error = np.abs(commanded[:n] - np.array(stepped.places)[:n]).max()
    assert 0.3 * 100 * servo_period <= error <= STEPPED * 100 * servo_period
    assert commanded[-1] == pytest.approx(stepped.places[-1], abs=STEPPED * 100 * servo_period)
    lag = np.abs(spiral.passes.profile.position(np.arange(n) * servo_period) - np.array(stepped.ways)[:n]).max()
    assert lag <= STEPPED * max(stepped.speeds) * servo_period


@pytest.mark.parametrize(("acceleration", "end", "places"), [(1000, 40.02 - 0.14j, 0.005), (120, 43.8 - 4.7j, 0.05)])
def test_the_application_notes_end_points_at_finite_accel(acceleration, end, places):
    found = end_of(note(acceleration=acceleration))
    assert found.real == pytest.approx(end.real, abs=places)
    assert found.imag == pytest.approx(end.imag, abs=places)
    # without the limit it ends where the table of loop periods says
    assert end_of(note()) == pytest.approx(40.0001 - 0.0036j, abs=1e-4)


def test_the_virtual_speed_must_rise_by_the_notes_figure_at_a_third():
    """The law is dv/dt = V change / (T x^3); over a pass it is V change / (T x_k^2 x_k+1)."""
    spiral = note(loop_period=1e-3)
    x, time = spiral.passes.ratio, spiral.passes.time
    rise = np.diff(spiral.passes.profile.velocity(time)) / np.diff(time)
    law = 100 * spiral.change / (1e-3 * x**3)
    assert rise == pytest.approx(law[:-1], rel=2e-4)  # change / x, the difference of x_k and x_k+1
    assert law[-1] == pytest.approx(119.4, abs=0.05)
    assert rise[-1] == pytest.approx(119.4, abs=0.1)


@pytest.mark.parametrize("acceleration", [30.0, 60.0, 100.0])
def test_the_speed_is_reached_within_a_pass_where_the_need_is_below_accel(acceleration):
    passes = note(acceleration=acceleration, deceleration=math.inf).passes
    x = passes.ratio
    need = 100 * 0.004420971 / (0.1 * x[:-2] * x[1:-1] ** 2)  # within pass k, from V / x_k-1 to V / x_k
    lack = 100 / x[1:-1] - passes.profile.velocity(passes.time[2:] - 1e-9)
    caught_up = int(np.flatnonzero(lack < 1e-6)[0])  # after the start from rest
    enough = need[caught_up:] < acceleration
    assert 20 < enough.sum() < enough.size - 5
    assert np.array_equal(lack[caught_up:] < 1e-6, enough)


def accelerations(law, n=40001):
    """Slopes of the virtual speed by finite differences within phases' ends."""
    t = np.unique(np.concatenate([np.linspace(0, law.duration, n), law.time]))
    t = t[np.diff(t, prepend=-1) > 1e-9]
    return np.diff(law.velocity(t)) / np.diff(t), t


@given(jobs())
@examples(60)
def test_virtual_speed_is_continuous_within_accel_and_decel_and_ends_at_rest_at_the_end(job):
    spiral = built({**job, "deceleration": job["deceleration"] if job["deceleration"] != math.inf else None})
    law = spiral.passes.profile
    slope, t = accelerations(law)
    up = spiral.acceleration
    down = up if spiral.deceleration is None else spiral.deceleration
    noise = 1e-9 * law.velocity(t).max() / np.diff(t).min()
    assert slope.max() <= up + noise
    assert slope.min() >= -down - noise
    assert law.velocity(0.0) == 0
    # a rounding of 1e-10 mm of the way makes sqrt(2 deceleration 1e-10) of the speed
    assert law.velocity(law.duration) == pytest.approx(0, abs=1e-3)
    assert np.all(law.velocity([-1e-3, law.duration + 1e-3]) == 0)
    # v dt adds up to the way (the trapezoid's rule is exact within phases), which ends with the circles
    way = np.sum(0.5 * (law.velocity(t)[1:] + law.velocity(t)[:-1]) * np.diff(t))
    assert way == pytest.approx(law.length, rel=1e-8)
    assert law.length == pytest.approx(math.pi * spiral.diameter * spiral.turns, rel=1e-12)
    turned = abs(spiral.generated.heading(spiral.generated.length)[0] - 0.5 * math.pi)
    assert turned == pytest.approx(2 * math.pi * spiral.turns, rel=1e-9)
    assert np.all(np.diff(law.position(t)) >= 0)


@pytest.mark.parametrize("limit", ["acceleration", "deceleration"])
def test_a_single_limit_applies_at_its_own_end_only(limit):
    law = note(**{"acceleration": math.inf, "deceleration": math.inf, limit: 400.0}).passes.profile
    assert law.velocity(0.0) == (0.0 if limit == "acceleration" else pytest.approx(100 / note().ratios[0]))
    last = law.velocity(law.duration)
    assert last == pytest.approx(0, abs=1e-6) if limit == "deceleration" else last > 290
    slope, _ = accelerations(law)
    if limit == "acceleration":
        assert slope.max() == pytest.approx(400, rel=1e-6)
        assert slope.min() >= -1e-3
    else:
        assert slope.min() == pytest.approx(-400, rel=1e-6)
        assert law.velocity(law.duration - 0.1) == pytest.approx(40, rel=1e-6)


def test_braking_uses_decel():
    for deceleration in (200.0, 1000.0, 5000.0):
        law = note(acceleration=1000, deceleration=deceleration).passes.profile
        slope, _ = accelerations(law)
        assert slope.max() == pytest.approx(1000, rel=1e-6)
        assert slope.min() == pytest.approx(-deceleration, rel=1e-6)
        assert law.velocity(law.duration - 0.01) == pytest.approx(0.01 * deceleration, rel=1e-6)
    same, default = note(acceleration=700, deceleration=700), note(acceleration=700)
    assert np.array_equal(same.passes.distance, default.passes.distance)


@pytest.mark.parametrize("deceleration", np.geomspace(100, 3000, 60))
def test_a_speed_too_high_to_brake_is_not_reached(deceleration):
    """Without ACCEL a command jumps the speed, but for the last one to no more than DECEL can stop."""
    law = note(loop_period=1.0, deceleration=deceleration).passes.profile
    t = np.linspace(0, law.duration, 4001)
    assert np.all(law.velocity(t) ** 2 <= 2 * deceleration * (law.length - law.position(t)) * (1 + 1e-9) + 1e-3)
    assert law.velocity(law.duration - 1e-3) == pytest.approx(1e-3 * deceleration, rel=1e-6)


def test_braking_curls_the_tail_in():
    """x goes on falling with time while the circles end more slowly: the longer the braking the further in."""
    ends = [end_of(note(deceleration=deceleration)) for deceleration in (math.inf, 3000.0, 1000.0, 300.0)]
    x = [note(deceleration=deceleration).ratios[-1] for deceleration in (math.inf, 3000.0, 1000.0, 300.0)]
    assert np.all(np.diff(x) < 0)
    assert np.all(np.diff([end.imag for end in ends]) < 0)


def test_x_is_held_above_the_least_ratio_while_the_axes_brake():
    spiral = note(thickness=14, deceleration=100.0)
    x, law = spiral.ratios, spiral.passes.profile
    assert NEVER_BELOW <= x[-1] < x[-2]
    assert x[-1] - spiral.change < NEVER_BELOW  # the next would fall below
    assert law.duration > spiral.passes.time[-1] + 2 * 0.1 * x[-1]  # so that the last pass lasts, with x held
    assert law.length == pytest.approx(math.pi * 480)
    # a rounding of 1e-10 mm of the way makes sqrt(2 deceleration 1e-10) of the speed
    assert law.velocity(law.duration) == pytest.approx(0, abs=1e-3)
    # and tick by tick
    job = {"diameter": 120, "turns": 4, "thickness": 14, "speed": 100, "deceleration": 100.0, "servo_period": 1e-3}
    stepped = Controller(**job).run()
    commanded = places(MoveSpiral(**job).setpoints(1e-3))
    n = min(len(commanded), len(stepped.places)) - 1
    assert commanded[:n] == pytest.approx(np.array(stepped.places)[:n], abs=POSITION)


LEAST = r"must be at least 2\^-16, the resolution of CONNECT; "


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        (
            {"thickness": 14.9, "loop_period": 1.0},
            r"ratio x = -0\.05396 on pass 16 of 16: "
            + LEAST
            + r"inner_diameter 0\.8 mm is too small for loop_period 1 s, "
            r"use fewer turns, a smaller thickness or a shorter loop_period",
        ),
        (
            {"acceleration": 6, "deceleration": math.inf},
            r"ratio x = -0\.00356 on pass 227 of 151: "
            + LEAST
            + r"the virtual axes are late, use a greater acceleration, fewer turns or a smaller thickness",
        ),
        (
            {"loop_period": 0.001, "wait_resolution": WHOLE_MS},
            r"ratio x = -2\.356e-05 on pass 22620 of 15080: "
            + LEAST
            + r"the virtual axes are late, use a loop_period longer against wait_resolution, "
            r"fewer turns or a smaller thickness",
        ),
        (
            {"height": 4000, "mhelical_mode": 0, "turns": 5},
            r"ratio x = -0\.00356 on pass 227 of 189: "
            + LEAST
            + r"the virtual axes are late, use mhelical_mode 1, fewer turns or a smaller thickness",
        ),
    ],
)
def test_a_ratio_that_falls_below_before_braking_names_the_remedies_that_help(changed, text):
    with pytest.raises(InputError, match=f"^{text}$"):
        note(**changed)


@pytest.mark.parametrize(
    ("changed", "remedy"),
    [
        ({"thickness": 14.9, "loop_period": 1.0}, {"loop_period": 0.01}),
        ({"acceleration": 6, "deceleration": math.inf}, {"acceleration": 100}),
        ({"loop_period": 0.001, "wait_resolution": WHOLE_MS}, {"loop_period": 0.1}),
        ({"height": 4000, "mhelical_mode": 0, "turns": 5}, {"mhelical_mode": 1}),
    ],
)
def test_the_remedies_help(changed, remedy):
    assert note(**{**changed, **remedy}).ratios[-1] > 0


def test_wa_truncates_to_whole_milliseconds():
    free, cut = note(), note(wait_resolution=WHOLE_MS)
    waits = np.diff(cut.passes.time)
    assert np.round(waits / WHOLE_MS) * WHOLE_MS == pytest.approx(waits, abs=1e-9)
    lost = 0.1 * cut.ratios[:-1] - waits
    assert np.all((lost > -1e-9) & (lost < WHOLE_MS))
    assert lost.max() > 0.9 * WHOLE_MS
    # a shorter pass turns the circle by less while x falls as ever: the pitch is thickness T x / floor(T x)
    step = np.diff(cut.ratios * 60) / np.diff(cut.passes.distance[:-1]) * 2 * math.pi * 60
    assert -step == pytest.approx(10 * 0.1 * cut.ratios[:-1] / waits, rel=RELATIVE)
    assert cut.ratios.size > free.ratios.size
    assert end_of(cut).real > end_of(free).real + 0.1


def test_a_whole_number_of_milliseconds_loses_nothing():
    """x falls by 1/64 a pass and T = 64 ms: every wait is a whole number of milliseconds."""
    speed = math.pi * 120**2 / (2 * 30 * 0.064 * 64)
    changed = {"thickness": 30, "speed": speed, "turns": 1, "loop_period": 0.064}
    free, cut = note(**changed), note(**changed, wait_resolution=WHOLE_MS)
    assert free.change == pytest.approx(1 / 64)
    assert cut.passes.time == pytest.approx(free.passes.time, abs=1e-9)
    assert end_of(cut) == pytest.approx(end_of(free), abs=1e-6)


@given(jobs(accelerated=False), st.sampled_from([8, 12, 16, 20]))
@examples(40)
def test_ratio_bits_cost_at_most_half_a_bit_of_every_radius(job, bits):
    job.pop("ratio_bits")
    job |= {"servo_period": 0.0, "wait_resolution": 0.0}
    exact, held = built(job), built({**job, "ratio_bits": bits})
    half = 2.0 ** -(bits + 1)
    assert np.array_equal(held.passes.ratio, exact.passes.ratio)
    assert np.abs(held.passes.connected - exact.passes.connected).max() <= half
    assert np.all(held.passes.connected * 2**bits == np.round(held.passes.connected * 2**bits))
    radii = [1 / np.abs(spiral.generated.parameters()["curvature"]) for spiral in (held, exact)]
    assert np.abs(radii[0] - radii[1]).max() <= half * exact.radius * (1 + 1e-9) + 1e-9
    # the places differ by no more than half a bit of the way of the virtual axes
    assert abs(end_of(held) - end_of(exact)) <= half * exact.virtual_length + 1e-9
    assert held.duration == exact.duration


def test_the_error_of_ratio_bits_is_measurable():
    assert abs(end_of(note(ratio_bits=8)) - end_of(note())) > 1e-3
    assert 0 < abs(end_of(note(ratio_bits=16)) - end_of(note())) < 60 * 2**-16


@given(jobs(accelerated=False))
@examples(40)
def test_commands_take_effect_at_the_next_servo_tick(job):
    ticked, free = built(job), built({**job, "servo_period": 0.0})
    n = min(ticked.ratios.size, free.ratios.size)
    late = ticked.passes.time[:n] - free.passes.time[:n]
    assert np.all((late >= -1e-9) & (late < job["servo_period"]))
    ticks = ticked.passes.time / job["servo_period"]
    assert ticks == pytest.approx(np.round(ticks), abs=1e-6)


def test_the_servo_period_shows_and_vanishes():
    exact = end_of(note())
    errors = [abs(end_of(note(servo_period=period)) - exact) for period in (0.002, 0.0005, 1e-5)]
    assert errors[0] > 1e-3
    assert errors[2] < 1e-3
    assert errors[2] < errors[0]


def test_a_wait_cut_to_nothing_takes_a_servo_tick():
    """T x falls below a millisecond long before the end; the program then makes a pass a tick."""
    job = {"diameter": 120, "turns": 1, "thickness": 59.9, "speed": 100, "loop_period": 0.02, "servo_period": 5e-4}
    spiral = MoveSpiral(**job, wait_resolution=WHOLE_MS, acceleration=3000)
    waits = np.diff(spiral.passes.time)
    short = 0.02 * spiral.ratios[:-1] < WHOLE_MS
    assert short.sum() >= 5
    assert waits[short] == pytest.approx(np.full(short.sum(), 5e-4), abs=1e-9)
    stepped = Controller(**job, wait_resolution=WHOLE_MS, acceleration=3000).run()
    assert places(spiral.setpoints(5e-4))[:-1] == pytest.approx(np.array(stepped.places)[:-1], abs=POSITION)


def test_interpreter_time_adds_to_the_truncated_wait():
    """With WA cut to whole ms a pass lasts floor(100 x) ms + d."""
    d = 0.0004
    spiral = note(wait_resolution=WHOLE_MS, interpreter_time=d)
    expected = np.floor(100 * spiral.ratios[:-1] + 1e-6) * WHOLE_MS + d
    assert np.diff(spiral.passes.time) == pytest.approx(expected, abs=1e-9)
    # half a millisecond is lost on the average: d of as much makes up for it
    lone, both = (abs(end_of(note(**c)).real - 40) for c in ({"interpreter_time": d}, {"wait_resolution": WHOLE_MS}))
    assert abs(end_of(spiral).real - 40) < 0.5 * min(lone, both)


@pytest.mark.validates(
    "path speed where no limit bites",
    "the command",
    "1e-6 relative",
)
@given(jobs(accelerated=False))
@examples(40)
def test_path_speed_of_the_setpoints_is_constant_where_no_limit_bites(job):
    """Where the ratio is exact; x times SPEED = V / x is V."""
    spiral = built({**job, "ratio_bits": None})
    setpoints = spiral.setpoints(job["servo_period"])
    chord = np.abs(np.diff(places(setpoints)))[:-1]
    arc = job["speed"] * job["servo_period"]
    at = np.searchsorted(spiral.passes.time, setpoints.time[:-2] + 0.5 * job["servo_period"]) - 1
    radius = spiral.radius * spiral.ratios[at]
    chord_of_arc = 2 * radius * np.sin(0.5 * arc / radius)
    assert chord == pytest.approx(chord_of_arc, rel=SPEED)


def test_path_speed_is_v_but_for_the_ramps_with_accel():
    setpoints = note(acceleration=2000, servo_period=1e-3).setpoints(1e-3)
    speed = np.abs(np.diff(places(setpoints))) / 1e-3
    assert speed.max() <= 100 * (1 + 1e-6)
    assert speed[:10].max() < 20
    assert speed[-10:].max() < 20
    # but for the ramps, and those after every command, the speed is V
    full = np.isclose(speed, 100, rtol=1e-4)
    assert full[60:-200].mean() > 0.85


@given(jobs())
@examples(30)
def test_real_speed_is_the_ratio_times_the_virtual_speed(job):
    passes = built(job).passes
    law = passes.connect(passes.connected * np.diff(passes.distance))
    t = np.linspace(0, law.duration, 2003)[1:-1]
    at = np.searchsorted(passes.time, t, side="right") - 1
    inside = np.abs(t - passes.time[at]) > 1e-6
    driven = passes.connected[at] * passes.profile.velocity(t)
    assert law.velocity(t)[inside] == pytest.approx(driven[inside], rel=1e-6)
    # and the way's derivative
    whole = inside & (at == np.searchsorted(passes.time, t + 1e-6, side="right") - 1)
    slope = (law.position(t + 1e-6) - law.position(t)) / 1e-6
    assert slope[whole] == pytest.approx(law.velocity(t)[whole], abs=1e-3 + 1e-4 * job["speed"])
    assert np.all(law.velocity([-1.0, law.duration + 1.0]) == 0)


def test_setpoints_of_another_period_than_the_servo_period_are_refused():
    text = (
        r"^servo_period = 0\.001 s of the controller: must be that of the servo, 0\.0005 s, "
        r"or 0 s for a program that acts between ticks$"
    )
    with pytest.raises(InputError, match=text):
        note(servo_period=1e-3).setpoints(5e-4)
    assert note(servo_period=1e-3).setpoints(1e-3).period == 1e-3
    assert note().setpoints(5e-4).period == 5e-4


NO_LOOP = "where loop_period is 0 s, the continuous limit"


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        ({"acceleration": 100}, f"acceleration = 100 mm/s²: must be inf mm/s² {NO_LOOP}"),
        ({"deceleration": 50}, f"deceleration = 50 mm/s²: must be inf mm/s² {NO_LOOP}"),
        ({"wait_resolution": 0.001}, f"wait_resolution = 0.001 s: must be 0 s {NO_LOOP}"),
        ({"servo_period": 0.001}, f"servo_period = 0.001 s: must be 0 s {NO_LOOP}"),
        ({"interpreter_time": 0.01}, f"interpreter_time = 0.01 s: must be 0 s {NO_LOOP}"),
        ({"ratio_bits": 16}, f"ratio_bits = 16: must be none {NO_LOOP}"),
        ({"as_published": True}, "as_published = true: must have a loop_period greater than 0 s"),
        ({"height": 10, "mhelical_mode": 0}, "mhelical_mode = 0: must have a loop_period greater than 0 s"),
    ],
)
def test_the_continuous_limit_has_no_limits(changed, text):
    with pytest.raises(InputError) as error:
        note(loop_period=0, **changed)
    assert str(error.value) == text
    assert note(loop_period=0, acceleration=math.inf, deceleration=math.inf).duration == pytest.approx(
        10.0531, abs=5e-5
    )


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        ({"acceleration": 0}, "acceleration = 0 mm/s²: must be greater than 0 mm/s²"),
        ({"acceleration": math.nan}, "acceleration = nan mm/s²: must be finite"),
        ({"acceleration": -math.inf}, "acceleration = -inf mm/s²: must be finite"),
        ({"deceleration": -5}, "deceleration = -5 mm/s²: must be greater than 0 mm/s²"),
        ({"wait_resolution": -0.001}, "wait_resolution = -0.001 s: must be at least 0 s"),
        ({"servo_period": math.nan}, "servo_period = nan s: must be finite"),
        ({"ratio_bits": 7}, "ratio_bits = 7: must be at least 8"),
        ({"ratio_bits": 16.5}, "ratio_bits = 16.5: must be a whole number"),
        ({"ratio_bits": 53}, "ratio_bits = 53: must be at most 52, or none for an exact ratio"),
        ({"height": math.inf}, "height = inf mm: must be finite"),
        ({"mhelical_mode": 2}, "mhelical_mode = 2: must be 0 (SPEED in space) or 1 (of the circle)"),
    ],
)
def test_a_limit_out_of_its_bound_is_named(changed, text):
    with pytest.raises(InputError) as error:
        note(**changed)
    assert str(error.value) == text


def test_defaults_are_the_method_without_limits():
    free = note(
        acceleration=math.inf,
        deceleration=math.inf,
        wait_resolution=0,
        ratio_bits=None,
        servo_period=0,
        as_published=False,
        height=0,
        mhelical_mode=1,
    )
    assert np.array_equal(free.setpoints(1e-3).position, note().setpoints(1e-3).position)
    assert free.duration == note().duration == pytest.approx(10.0197, abs=5e-5)
    assert free.notes == note().notes == ()
    assert free.axes == ("x", "y")
    ends = np.cumsum(note().ratios * 0.1)
    assert note().passes.time == pytest.approx(np.concatenate([[0], ends[:-1]]), abs=1e-9)


def test_an_accel_too_small_for_the_loop_to_end_is_refused(monkeypatch):
    for module in ("loop", "spiral"):
        monkeypatch.setattr(f"gantrysim.controllers.trio.{module}.MAX_PASSES", 2000)
    with pytest.raises(InputError, match=r"^ratio x = 0\.99\d+ at .* s: the circles must end within 2000 passes; use "):
        note(thickness=1e-4, acceleration=1e-3)
