"""The closed forms of the loop study against perfect followers, simulations and plain geometry."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import InputError, Servo, simulate
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.controllers.trio.theory import SteppedArcs, involute_radius, local_pitch, loop_error
from gantrysim.engine.simulate import perfect_follower
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.paths.spirals import Involute
from gantrysim.record.setpoints import Setpoints
from gantrysim.study.loop.sampling import circle_response, quantisation, sample_and_hold

from support.runs import PERIOD
from support.soaked import examples, suite_runs

AGREE, LEAST = 0.01, 1e-4  # of a prediction with what is measured: 1 % or 0.1 µm [mm]
NOTE = {"diameter": 120, "turns": 4, "thickness": 10, "speed": 100}
FINE_STEP = 3.125e-5  # of the physics, so that its own lag does not matter [s]
SERVO = 0.03  # of the response of a sampled servo, at that step
COUNTS = 0.05  # of the counts' rms: they are not quite evenly distributed


def near(measured, predicted):
    assert measured == pytest.approx(predicted, rel=AGREE, abs=LEAST)


def followed(machine, **changed):
    spiral = MoveSpiral(**{**NOTE, **changed})
    return Analysis(perfect_follower(machine, spiral.setpoints(PERIOD)))


def check(machine, changed):
    """Generation error and spacing of a perfect follower, against the arcs in closed form."""
    analysis, arcs = followed(machine, **changed), SteppedArcs(**{**NOTE, **changed})
    measured = analysis.values
    near(measured.program.rms, arcs.program.rms)
    near(measured.program.max, arcs.program.max)
    assert measured.spacing.mean == pytest.approx(arcs.spacings.mean, abs=max(LEAST, AGREE * arcs.spacings.std))
    for name in ("std", "min", "max"):
        asked = 0.0 if name == "std" else NOTE["thickness"]
        near(getattr(measured.spacing, name) - asked, getattr(arcs.spacings, name) - asked)


@pytest.mark.validates(
    "program error and spacing for loop periods of 0.2 ms to 2 s",
    "stepped arcs in closed form",
    "1 % or 0.1 µm",
)
@pytest.mark.parametrize("period", [2e-4, 1e-3, 3e-3, 0.01, 0.03, 0.1, 0.3, 1.0, 2.0])
def test_loop_periods_of_four_decades(xy, period):
    check(xy, {"loop_period": period})


@pytest.mark.parametrize("time", [1e-4, 5e-4, 1e-3, 5e-3, 0.02])
def test_interpreter_time(xy, time):
    check(xy, {"loop_period": 0.1, "interpreter_time": time})


@pytest.mark.parametrize("period", [0.01, 0.02, 0.05, 0.1, 1.0])
def test_waits_in_whole_milliseconds(xy, period):
    check(xy, {"loop_period": period, "wait_resolution": 1e-3})


def test_waits_that_are_whole_milliseconds_are_kept():
    """x falls by 1/64 a pass and T = 64 ms, so that each wait is one, but for the rounding of x."""
    changed = NOTE | {"thickness": 30, "turns": 1, "loop_period": 0.064}
    changed["speed"] = math.pi * 120**2 / (2 * 30 * 0.064 * 64)
    exact = SteppedArcs(**changed)
    assert exact.change == pytest.approx(1 / 64)
    whole = SteppedArcs(**changed, wait_resolution=1e-3)
    end = 2 * math.pi
    assert complex(whole.position(end)) == pytest.approx(complex(exact.position(end)), abs=1e-6)


def test_ratio_of_few_bits(xy):
    check(xy, {"loop_period": 0.1, "ratio_bits": 8})
    exact, cut = (SteppedArcs(**NOTE, loop_period=0.1, ratio_bits=bits).program.rms for bits in (None, 8))
    assert cut > (1 + 4 * AGREE) * exact


@examples(12)
@given(
    st.floats(30, 140),
    st.integers(1, 5),
    st.floats(0.2, 0.7),  # one that comes near its centre ends beside the requested path's end
    st.floats(20, 200),
    st.floats(-2.7, -0.7).map(lambda e: 10**e),
    st.floats(0, 2e-3),
)
def test_any_spiral(xy, diameter, turns, share, speed, period, time):
    changed = {
        "diameter": diameter,
        "turns": turns,
        "thickness": share * diameter / 2 / turns,
        "speed": speed,
        "loop_period": period,
        "interpreter_time": time,
    }
    try:
        arcs = SteppedArcs(**changed)
    except InputError:
        return
    measured = followed(xy, **changed).values.program
    # the last way is as long as a servo period lets it be, and the feet of the path's end are its end
    slack = 2 * LEAST + 1e-3 * measured.max
    assert measured.rms == pytest.approx(arcs.program.rms, rel=2 * AGREE, abs=slack)
    assert measured.max == pytest.approx(arcs.program.max, rel=2 * AGREE, abs=slack)


@pytest.mark.parametrize(("period", "end"), [(0.01, (40.0, 0.0)), (0.1, (40.0001, -0.0036)), (1.0, (39.9599, -0.1649))])
def test_end_points_of_the_note(period, end):
    place = complex(SteppedArcs(**NOTE, loop_period=period).position(8 * math.pi))
    assert (place.real, place.imag) == pytest.approx(end, abs=5.1e-5)


def test_distance_from_the_involute_is_the_shortest():
    arcs = SteppedArcs(**NOTE, loop_period=1.0, interpreter_time=0.01)
    phi = np.linspace(0, 2 * np.pi * 4, 400_001)
    a, rho = arcs.a, 60 - arcs.a * phi
    involute = (60 - a * np.sin(phi) - rho * np.cos(phi)) + 1j * (a - a * np.cos(phi) + rho * np.sin(phi))
    at = np.linspace(1.0, 24.0, 40)
    shortest = []
    for point in arcs.position(at):
        k = int(np.abs(involute - point).argmin())
        before, here, after = np.abs(involute[k - 1 : k + 2] - point) ** 2
        shortest.append(math.sqrt(here - (before - after) ** 2 / 8 / (before - 2 * here + after)))  # of their parabola
    np.testing.assert_allclose(np.abs(arcs.error(at)), shortest, rtol=0, atol=1e-9)
    assert np.sign(arcs.error(at)).min() < 0  # inside the path asked for


def test_arcs_are_tangent_and_as_long_as_their_time_at_the_path_speed():
    arcs = SteppedArcs(**NOTE, loop_period=0.3)
    phi = np.linspace(0, 8 * np.pi - 1e-6, 200_001)
    step = np.diff(arcs.position(phi))
    heading = np.unwrap(np.angle(step))
    np.testing.assert_allclose(heading, 0.5 * np.pi - 0.5 * (phi[1:] + phi[:-1]), rtol=0, atol=1e-6)
    assert np.abs(step).sum() == pytest.approx(
        MoveSpiral(**NOTE, loop_period=0.3).passes.profile.duration * 100, rel=1e-6
    )


@pytest.mark.parametrize("period", [1e-4, 1e-3, 0.01, 0.1])
def test_law_of_first_order(period):
    arcs, law = SteppedArcs(**NOTE, loop_period=period), loop_error(10, 60, 100, period, math.inf)
    assert law.rms == pytest.approx(arcs.program.rms, rel=1e-3)
    assert law.max == pytest.approx(arcs.program.max, rel=2e-3)


@pytest.mark.parametrize("acceleration", [500.0, 2000.0])
def test_a_loop_period_of_v_over_accel_has_the_error_of_accel(acceleration):
    fast = SteppedArcs(**NOTE, loop_period=1e-3, acceleration=acceleration).program.rms
    assert fast == pytest.approx(loop_error(10, 60, 100, 1e-3, acceleration).rms, rel=0.02)
    same = SteppedArcs(**NOTE, loop_period=100 / acceleration).program.rms
    assert fast == pytest.approx(same, rel=0.03)


def test_acceleration_of_a_perfect_follower(xy):
    limits = {"loop_period": 0.1, "acceleration": 1000.0, "wait_resolution": 1e-3, "ratio_bits": 16}
    measured = followed(xy, **limits).values.program
    arcs = SteppedArcs(**NOTE, **limits)
    assert measured.max == pytest.approx(arcs.program.max, rel=1e-3)
    assert measured.rms == pytest.approx(arcs.program.rms, rel=0.01)  # but for the braking at the end


@pytest.mark.parametrize(("time", "resolution"), [(2e-4, 0.0), (1e-3, 0.0), (0.0, 1e-3), (5e-4, 1e-3)])
def test_local_pitch(time, resolution):
    arcs = SteppedArcs(**NOTE, loop_period=0.1, interpreter_time=time, wait_resolution=resolution)
    phi = np.linspace(0, 6 * np.pi, 500)
    radius = np.abs(arcs.position(phi + np.pi) - (60 + 1j * arcs.a))  # half way to the next turn
    law = local_pitch(10, 0.1, radius / 60, time, resolution)
    assert arcs.spacing(phi).mean() == pytest.approx(law.mean(), abs=5e-3)
    np.testing.assert_allclose(arcs.spacing(phi), law, rtol=0, atol=0.03)


def test_an_interpreter_time_of_half_the_resolution_offsets_wa():
    pitch = [
        SteppedArcs(**NOTE, loop_period=0.1, wait_resolution=1e-3, interpreter_time=d).spacings.mean for d in (0, 5e-4)
    ]
    assert pitch[0] - 10 > 0.07
    assert abs(pitch[1] - 10) < 0.002


def test_a_spiral_that_reaches_its_centre_is_refused():
    with pytest.raises(InputError, match=r"ratio x = 0 after [\d.]+ of 4 turns: must be above 0 to the end"):
        SteppedArcs(**NOTE, loop_period=4e-3, wait_resolution=1e-3)


def test_one_turn_has_no_spacing():
    assert SteppedArcs(**{**NOTE, "turns": 1}, loop_period=0.1).spacings is None


def test_no_spacing_where_a_normal_misses_the_next_turn():
    wild = SteppedArcs(30, 2, 5, 200, 0.0651, wait_resolution=1e-3, acceleration=1000.0)
    distance = wild.spacing(np.linspace(0, 2 * np.pi, 7000))
    assert 0 < np.isnan(distance).mean() < 0.1
    assert np.isfinite([wild.spacings.mean, wild.spacings.std]).all()


def test_radius_of_the_involute():
    path = Involute(60, 10, 4)
    share = np.linspace(0, 1, 9)
    np.testing.assert_allclose(
        involute_radius(120, 4, 10, share), 1 / np.abs(path.curvature(share * path.length)), rtol=1e-9
    )


def responses(machine, servo, circle, speed, radius):
    """E/R of each axis over the last of three turns, and the rms along the path and square to it."""
    setpoints = Setpoints.along(circle(radius, 3.0), speed, servo.period)
    run = simulate(machine, servo, setpoints, physics_step=FINE_STEP)
    turn = round(2 * np.pi * radius / speed / servo.period)
    last = slice(len(run.time) - 1 - turn, len(run.time) - 1)
    error, angle = (run.commanded - run.encoder)[last], speed / radius * run.time[last]
    phase = np.exp(-1j * (angle[:, None] - [0, 0.5 * np.pi]))
    along = error[:, 1] * np.cos(angle) - error[:, 0] * np.sin(angle)
    normal = error[:, 0] * np.cos(angle) + error[:, 1] * np.sin(angle)
    return 2 * (error * phase).mean(axis=0) / radius, [np.sqrt(np.mean(e**2)) for e in (along, normal)]


@pytest.mark.parametrize(
    ("period", "gains"),
    suite_runs(
        [
            (1e-3, {}),
            (4e-3, {}),
            (1e-3, {"integral_time": 0.03}),
            (1e-3, {"feedforward": 0.0}),
            (1e-3, {"delay": 5e-4}),
            (1e-3, {"output_velocity": -1e-5}),
        ],
        0,
        2,
        4,
    ),
)
def test_following_error_of_sampling_and_winding(rigid, circle, period, gains):
    machine = rigid()
    speed, radius = 100.0, 20.0
    servo = Servo.derive(machine.axes, period, resolution=0.0, **gains)
    measured, (along, normal) = responses(machine, servo, circle, speed, radius)
    predicted = [circle_response(servo, a, axis, speed / radius) for a, axis in enumerate(machine.axes)]
    for a in range(2):
        assert abs(measured[a] - predicted[a]) < SERVO * abs(predicted[a])
    error = sample_and_hold(servo, machine.axes, (0, 1), speed, radius)
    assert along == pytest.approx(error.along, rel=SERVO)
    assert normal == pytest.approx(error.normal, rel=SERVO)


@pytest.mark.parametrize("period", [5e-4, 1e-3, 2e-3])
def test_late_feed_forward_leaves_its_lag_times_the_jerk(xy, period):
    axis, servo = xy.axes[0], Servo.derive(xy.axes, period)
    rate, radius = 2.0, 50.0
    jerk = rate**3 * radius
    lag = 1.5 * period + axis.lag
    assert radius * abs(circle_response(servo, 0, axis, rate)) == pytest.approx(
        lag * jerk * axis.inertia / servo.gains[0].kp, rel=0.05
    )


def test_axes_that_differ_turn_a_part_of_their_error_against_the_path(xy):
    servo, speed, radius = Servo.derive(xy.axes, 4e-3, feedforward=0.5), 150.0, 30.0
    angle = np.linspace(0, 2 * np.pi, 3600, endpoint=False)
    x, y = (
        radius * (circle_response(servo, a, axis, speed / radius) * np.exp(1j * (angle - phase))).real
        for a, (axis, phase) in enumerate(zip(xy.axes, (0, 0.5 * np.pi), strict=True))
    )
    error = sample_and_hold(servo, xy.axes, (0, 1), speed, [radius, radius])
    assert error.along == pytest.approx(np.sqrt(np.mean((y * np.cos(angle) - x * np.sin(angle)) ** 2)), rel=1e-9)
    assert error.normal == pytest.approx(np.sqrt(np.mean((x * np.cos(angle) + y * np.sin(angle)) ** 2)), rel=1e-9)
    other = sample_and_hold(servo, xy.axes, (1, 0), speed, radius)
    assert (other.along, other.normal) == pytest.approx((error.along, error.normal), rel=1e-9)


@pytest.mark.parametrize("resolution", [1e-3, 1e-2])
def test_quantisation(xy, resolution):
    servo = Servo.derive(xy.axes, PERIOD, resolution=resolution)
    run = simulate(xy, servo, MoveSpiral(80, 2, 10, 100).setpoints(PERIOD))
    measured = Budget(Analysis(run)).parts["encoder"].size
    assert np.sqrt(np.mean(measured**2)) == pytest.approx(float(quantisation(resolution)), rel=COUNTS)
