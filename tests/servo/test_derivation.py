"""Gains that keep their margins whatever the period, notches at the modes, and what bounds the loop in words."""

import dataclasses
import math
from functools import cache

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy import signal

from gantrysim import InputError, Machine, Servo
from gantrysim.machine.machine import builtin_models
from gantrysim.servo import notch
from gantrysim.servo.axis_dynamics import Lags
from gantrysim.servo.derivation import LARGEST_PEAK, LEAST_GAIN_MARGIN, LoopTask, NoLoopError, loop, natural_frequency
from gantrysim.servo.notch import NOTCH_DEPTH, NOTCH_WIDTH
from gantrysim.servo.request import ServoRequest
from gantrysim.servo.servo_design import check_margins, margins_at
from gantrysim.servo.stability.margins import Margins, Plant, margins_of
from gantrysim.servo.stability.motion import Motion

from support.closed_loops import shortfall
from support.soaked import examples, suite_runs
from support.tables import EXAMPLES

EXACT = 1e-9
MACHINES = builtin_models()
FASTEST, SLOWEST = 2.5e-4, 4e-3  # servo periods [s]


@cache
def machine(name):
    return Machine(name)


def derived(name, period=1e-3, frequency=None, damping=1.0, integral_time=math.inf, delay=0.0):
    return loop(LoopTask(machine(name).axes, period, Lags(delay), damping, integral_time), frequency)


@pytest.mark.validates(
    "gain margin and peak of abs(S) of derived gains, servo periods of 0.25 to 4 ms",
    "the limits of the design",
    "at least 2; at most 2",
)
@examples(30)
@given(name=st.sampled_from(MACHINES), period=st.floats(FASTEST, SLOWEST), share=st.sampled_from([0.0, 0.3, 1.0]))
@example(name="stage", period=SLOWEST, share=0.0)
@example(name="stage", period=2e-3, share=1.0)
@example(name="xyzr", period=FASTEST, share=0.0)
@example(name="xyzr", period=5e-4, share=1.0)
def test_derived_loops_keep_their_margins_at_every_period(name, period, share):
    """With the delay a share of the period; coupled axes also with a factor on the gains of all of them."""
    servo = Servo.derive(machine(name).axes, period, delay=share * period)
    for one in margins_of(machine(name), servo):
        assert one.gain >= LEAST_GAIN_MARGIN * (1 - 1e-6)
        assert one.together >= LEAST_GAIN_MARGIN * (1 - 1e-6)
        assert one.sensitivity <= LARGEST_PEAK * (1 + 1e-6)


ON_THE_LOAD = {"feedback": "load", "integral_time": 0.03}


def keeps(machine, servo, **tolerance):
    return not shortfall(machine, servo, **tolerance)


@pytest.mark.soak
def test_a_servo_whose_integral_term_leaves_no_loop_is_refused_with_the_time_that_does():
    """Slower loops are the less stable: at a thousandth of the speed this one would swing up at 0.03 Hz."""
    with pytest.raises(InputError) as caught:
        Servo.derive(machine("delta").axes, **ON_THE_LOAD)
    message = str(caught.value)
    assert message.startswith("servo integral_time = 0.03 s, feedback = 'load': no loop keeps a gain margin of 2")
    assert "(at 26.9 Hz a1 has a gain margin of 0.306 (at least 2)" in message
    assert "at 0.0276 Hz a1 is unstable): an integral term makes slow loops unstable;" in message
    assert "; use integral_time = 0.05 s (2.66 Hz) or feedback = 'motor' (21.1 Hz), each tried" in message
    assert "\n" not in message
    assert keeps(machine("delta"), Servo.derive(machine("delta").axes, **(ON_THE_LOAD | {"integral_time": 0.05})))


@pytest.mark.soak
def test_the_time_proposed_is_the_shortest_of_its_series():
    with pytest.raises(InputError, match=r"use integral_time = 0\.05 s"):
        Servo.derive(machine("delta").axes, **(ON_THE_LOAD | {"integral_time": 0.04}))


@pytest.mark.parametrize(
    ("values", "blamed", "proposal"),
    suite_runs(
        [
            (
                {"damping": 0.1, "integral_time": 1e-3},
                "integral_time = 0.001 s, damping = 0.1",
                "or integral_time = 0.005 s with damping = 1 \\(26.9 Hz\\)",
            ),
            (
                {"mode": "velocity", "velocity_bandwidth": 1e3},
                "velocity_bandwidth = 1000 Hz, drive_period = 0.000125 s",
                "\\(around velocity loops of .* use velocity_bandwidth = 500 Hz \\([0-9.]+ Hz\\) or drive_period",
            ),
            (
                {"feedback_delay": 16, "integral_time": 0.05},
                "integral_time = 0.05 s, feedback_delay = 16, period = 0.001 s",
                "or feedback_delay = 8 \\([0-9.]+ Hz\\) or period = 0.0005 s",
            ),
            (
                {"current_bandwidth": 2.0, "integral_time": 0.1},
                "integral_time = 0.1 s, current_bandwidth = 2 Hz",
                "or current_bandwidth = 8 Hz",
            ),
            (
                {"law": ["pid", "observer"], "integral_time": 1e-3},
                "integral_time = 0.001 s",
                "use integral_time = 0.005 s",
            ),
            ({"period": 0.2, "integral_time": 1.7e308}, "integral_time = 1.7e\\+308 s", "use integral_time = inf"),
        ],
        0,
        1,
        3,
    ),
)
def test_whatever_keeps_a_loop_from_its_margins_is_named_with_a_value_that_does(values, blamed, proposal):
    with pytest.raises(InputError, match=f"^servo {blamed}: .*{proposal}.*, each tried$"):
        Servo.derive(machine("xy").axes, **values)


def test_a_servo_that_nothing_helps_is_refused_with_what_was_tried():
    """Motors wired the wrong way round: every loop pushes its axis away."""
    wrong = [
        dataclasses.replace(axis, motion=dataclasses.replace(axis.motion, B=-axis.motion.B))
        for axis in machine("xy").axes
    ]
    with pytest.raises(InputError, match=r": tried in vain: damping = 1 with period = 0\.000125 s; give the gains$"):
        Servo.derive(wrong, damping=0.5)


@pytest.mark.parametrize("mode", ["torque", "velocity", "position"])
def test_gains_that_are_all_given_are_never_refused(mode):
    given_gains = {"kp": 1.0, "ki": 0.0, "kd": 0.01, "mode": mode}
    if mode == "velocity":
        given_gains |= {"velocity_gain": 0.01, "velocity_time": 0.02}
    servo = Servo.derive(machine("delta").axes, **ON_THE_LOAD, **given_gains)
    assert servo.per_axis("kp") == (1.0,) * 4
    assert servo.per_axis("notch_frequency") == (0.0,) * 4


@pytest.mark.parametrize("name", ["xy", "stage", "delta"])
def test_a_servo_that_is_not_as_it_was_derived_is_noticed(name):
    request = ServoRequest(machine(name).axes)
    servo = Servo.derive(machine(name).axes)
    check_margins(request, margins_at(request.axes, servo))
    stronger = {gain: tuple(4 * value for value in servo.per_axis(gain)) for gain in ("kp", "kd")}
    with pytest.raises(NoLoopError, match="in the servo derived"):
        check_margins(request, margins_at(request.axes, servo.with_values(**stronger)))


@pytest.mark.parametrize("change", [{"gain": 1.99}, {"together": 1.99}, {"sensitivity": 2.02}])
def test_either_margin_below_what_derived_loops_keep_is_noticed(change):
    request = ServoRequest(machine("xy").axes)
    kept = Margins(2.0, 0.0, 60.0, 0.01, 2.0, 20.0, stable=True, together=2.0)
    check_margins(request, (kept, kept))
    with pytest.raises(NoLoopError, match=r": y has a .* in the servo derived"):
        check_margins(request, (kept, dataclasses.replace(kept, **change)))


def test_one_gain_for_all_is_none_for_a_stepper_and_one_for_each_is_taken_as_it_is():
    axes = Machine(EXAMPLES / "stepper.toml").axes
    assert Servo.derive(axes, kp=3.0).per_axis("kp") == (0.0, 3.0, 0.0)
    assert Servo.derive(axes, kp=(0.0, 4.0, 0.0)).per_axis("kp") == (0.0, 4.0, 0.0)
    with pytest.raises(InputError, match="kp = 3 in mode 'stepper': must be 0"):
        Servo.derive(axes, kp=(3.0, 3.0, 0.0))


def test_a_frequency_that_is_given_is_taken_whatever_its_margins():
    servo = Servo.derive(machine("delta").axes, **ON_THE_LOAD, frequency=5.0)
    assert not keeps(machine("delta"), servo)


COUPLED = {"mode": "position", "feedback": "load", "current_bandwidth": 1500.0}


def test_axes_in_series_that_move_each_other_keep_their_margins_with_all_loops_closed():
    """The arm of a cantilever yaws when x moves its carriage, and when y moves the arm."""
    cantilever = Machine(EXAMPLES / "cantilever.toml")
    servo = Servo.derive(cantilever.axes, **COUPLED)
    assert keeps(cantilever, servo)
    alone = [dataclasses.replace(axis, coupled=None) for axis in cantilever.axes]
    assert not keeps(cantilever, Servo.derive(alone, **COUPLED))
    with pytest.raises(InputError, match="axes x, y move each other: must have one mode, not 'position' and 'torque'"):
        Servo.derive(cantilever.axes, mode=["torque", "position"])


def test_axes_that_move_no_other_are_in_no_group():
    assert [axis.coupled for axis in machine("xyz").axes] == [None] * 3
    coupled = [axis.coupled is not None for axis in machine("xyzr").axes]
    assert coupled == [False, True, False, True]  # the column of r is off its axis, y moves it


def test_axes_coupled_by_inertia_alone_are_found():
    """Two masses in one frame, no spring, no damping, no winding: what couples them is in the mass matrix alone."""
    coupled = np.array([[2.0, 0.3, 0.0], [0.3, 1.0, 0.0], [0.0, 0.0, 5.0]])
    rates = np.eye(6, k=3)
    for mass, groups in ((coupled, [[0, 1], [2]]), (np.diag([2.0, 1.0, 5.0]), [[0], [1], [2]])):
        torques = np.concatenate([np.zeros((3, 3)), np.linalg.inv(mass)])
        motion = Motion(rates, torques, np.eye(3, 6))
        assert sorted(axes for _, axes in motion.groups()) == groups


@pytest.mark.parametrize("name", MACHINES)
def test_a_notch_stands_where_the_axis_would_not_keep_its_margins_and_nowhere_else(name):
    axes = machine(name).axes
    servo = Servo.derive(axes)
    assert any(servo.per_axis("notch_frequency"))  # the axis that carries the bridge, or the table
    for a, frequency in enumerate(servo.per_axis("notch_frequency")):
        others = tuple(0.0 if b == a else f for b, f in enumerate(servo.per_axis("notch_frequency")))
        margins = margins_of(machine(name), servo.with_values(notch_frequency=others))[a]
        kept = margins.gain >= LEAST_GAIN_MARGIN and margins.sensitivity <= LARGEST_PEAK
        assert (frequency == 0) is kept


@pytest.mark.parametrize("given", [0, (0.0, 0.0)])
def test_a_servo_that_may_have_no_notch_is_derived_to_keep_its_margins_without(given):
    axes = machine("xy").axes
    plain = Servo.derive(axes, notch_frequency=given)
    notched = Servo.derive(axes)
    # the same gains without their notch would not do
    assert min(m.gain for m in margins_of(machine("xy"), notched.with_values(notch_frequency=(0.0, 0.0)))) < 2
    assert min(m.gain for m in margins_of(machine("xy"), plain)) >= 2
    assert plain.per_axis("notch_frequency") == (0.0, 0.0)
    assert plain.gains[0].kp < notched.gains[0].kp


def test_a_notch_is_at_the_mode_of_two_masses_on_a_spring():
    """Free motor and load: w^2 = k (1/m + 1/M), with the machine's own damping far below."""
    model = machine("xy").physics
    load, motor = 3.6 + 0.15 + 1.0, 0.2  # bridge with all it carries; nut [kg]
    rotor = model.dof_armature[model.joint("y").dofadr[0]] + model.actuator_armature[1] * model.actuator_gear[1, 0] ** 2
    stiffness = model.jnt_stiffness[model.joint("y_flex").id]
    expected = math.sqrt(stiffness * (1 / load + 1 / (motor + rotor))) / (2 * math.pi)
    assert Servo.derive(machine("xy").axes).per_axis("notch_frequency") == (0.0, pytest.approx(expected, rel=2e-3))


@pytest.mark.parametrize("period", [FASTEST, 1e-3, 2e-3])
def test_where_the_lags_bind_the_frequency_is_the_one_they_leave_room_for(period):
    found = derived("xyz", period)
    lag = machine("xyz").axes[0].lag + period
    assert found.frequency == pytest.approx(natural_frequency(lag, 1.0))
    assert f"the lags of sampling, output and winding, {1e3 * lag:.3g} ms" in found.reason


def test_where_a_mode_binds_more_would_be_too_much():
    """The stage at 4 ms: its table's mode is at 122 Hz, half the servo's frequency at 125."""
    found = derived("stage", SLOWEST)
    assert found.notches == (0.0, 0.0, 0.0)
    assert found.frequency < 0.6 * natural_frequency(machine("stage").axes[0].lag + SLOWEST, 1.0)
    assert "at more, th has a peak of |S|" in found.reason
    assert "its mode of 122 Hz is too near half the servo's, 125 Hz" in found.reason
    faster = Servo.derive(machine("stage").axes, SLOWEST, frequency=found.frequency / 0.97)
    plant = Plant.of(machine("stage"), SLOWEST)
    assert plant.margins(faster)[0].sensitivity > LARGEST_PEAK
    assert plant.margins(Servo.derive(machine("stage").axes, SLOWEST))[0].sensitivity <= LARGEST_PEAK


def test_the_reason_names_notches_and_what_they_are_for():
    reason = derived("xyzr").reason
    assert "; notch of y at its mode of 291 Hz, without it y has a gain margin of 0.94" in reason
    assert reason.count("notch of") == 1
    assert "even with a notch at its mode of 122 Hz" in derived("stage", 5e-4).reason
    assert derived("xy", frequency=20.0).reason.startswith("natural frequency 20 Hz, as given")


def test_a_notch_lifts_the_margin_and_a_mode_off_by_a_tenth_leaves_it_stable():
    """The machine's spring a fifth softer or stiffer moves its mode by a tenth."""
    from gantrysim.machine.perturbation import Perturbation

    servo = Servo.derive(machine("xyzr").axes)
    plain = servo.with_values(notch_frequency=(0.0,) * 4)
    assert margins_of(machine("xyzr"), plain)[1].gain < 1
    for factor in (0.8, 1.0, 1.2):
        off = machine("xyzr").perturbed(Perturbation(stiffness=factor))
        assert margins_of(off, servo)[1].gain > 1.3


@examples(50)
@given(
    period=st.floats(1e-4, 8e-3),
    share=st.floats(0.01, 0.95),
    width=st.floats(0.05, 2.0),
    depth=st.floats(0.01, 1.0),
)
def test_a_notch_has_the_depth_at_its_frequency_and_leaves_what_is_slow_and_fast(period, share, width, depth):
    frequency = share * 0.5 / period
    b0, b1, b2, a1, a2 = notch.coefficients(frequency, width, depth, period)
    _, answer = signal.freqz([b0, b1, b2], [1, a1, a2], [0.0, 2 * math.pi * frequency * period, math.pi])
    assert np.abs(answer) == pytest.approx([1.0, depth, 1.0], rel=1e-6)
    assert np.abs(np.roots([1, a1, a2])).max() < 1


def test_the_notch_filters_as_scipy_does():
    given_in = np.random.default_rng(3).normal(size=200)
    found = notch.coefficients(150.0, 0.35, 0.1, 1e-3)
    first = second = 0.0
    out = []
    for value in given_in:
        one, first, second = notch.filtered_output(value, found, first, second)
        out.append(one)
    expected = signal.lfilter(found[:3], [1.0, *found[3:]], given_in)
    np.testing.assert_allclose(out, expected, rtol=0, atol=1e-12)


def test_no_notch_passes_what_it_gets():
    assert notch.coefficients(0.0, NOTCH_WIDTH, NOTCH_DEPTH, 1e-3) == (1, 0, 0, 0, 0)
    assert notch.filtered_output(3.5, notch.Coefficients(), 0.0, 0.0) == (3.5, 0.0, 0.0)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"notch_frequency": 500.0}, "notch_frequency = 500 Hz: must be below half the servo's, 500 Hz, or 0"),
        ({"notch_frequency": -1.0}, "notch_frequency = -1 Hz: must be below half"),
        ({"notch_frequency": 100.0, "notch_width": 0.0}, "notch_width = 0: must be greater than 0"),
        ({"notch_frequency": 100.0, "notch_depth": -1.0}, "notch_depth = -1: must be greater than 0"),
        ({"notch_frequency": math.nan}, "notch_frequency = nan"),
    ],
)
def test_bad_notches_are_refused(change, text):
    with pytest.raises(InputError, match=text):
        Servo.derive(machine("xy").axes, **change)


def test_a_servo_without_notch_fields_has_none():
    servo = Servo.derive(machine("xy").axes, notch_frequency=0.0)
    values = {field.name: getattr(servo, field.name) for field in dataclasses.fields(servo)}
    bare = Servo(**{name: value for name, value in values.items() if name != "notches"})
    assert bare.filters == (notch.Coefficients(),) * 2
    assert bare == servo
