"""The ladder of laws, against closed forms and independent computation; no simulation."""

# ruff: noqa: N806 - numbers bear the letters of the laws

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import InputError, Machine, Servo
from gantrysim.servo.gains import Gains
from gantrysim.servo.inverse import zero_phase
from gantrysim.servo.laws import ADDITIONS, BASES, LAW_PARAMETERS, ZV, ZVD
from gantrysim.servo.laws.contour import error_across, tangents
from gantrysim.servo.laws.friction import friction_torque
from gantrysim.servo.laws.observer import low_pass, torque_taps
from gantrysim.servo.laws.p_pi import as_pid, cascaded_torque
from gantrysim.servo.laws.selection import law_names
from gantrysim.servo.laws.zv import impulses
from gantrysim.servo.laws.zvd import three_impulses
from gantrysim.servo.stability.linear_system import Compensator
from gantrysim.servo.stability.margins import margins_of

from support.runs import PERIOD, ramp

EXACT = 1e-9  # relative
LUGRE = 2e-3  # of the Coulomb torque: what the damping of the bristles and the speed within a tick change
SHAPERS = {"zv": impulses, "zvd": three_impulses}  # weights by law
SHARED = 1 / 8  # of (w T)^2, the residue of an impulse that is shared by two ticks


@pytest.fixture(scope="module")
def axes():
    return Machine("xy").axes


def test_names_come_in_one_order_whatever_order_they_are_given_in():
    assert law_names("friction") == ("pid", "friction")
    assert law_names(["zvd", "observer", "p-pi"]) == ("p-pi", "observer", "zvd")


@pytest.mark.parametrize(
    ("law", "text"),
    [
        ("pidd", "unknown law 'pidd': did you mean pid?"),
        (["pd", "pid"], "must have at most one of pd, pid, p-pi"),
        (["zv", "zvd"], "must have at most one of zv, zvd"),
        (["friction", "friction"], "must name each law once"),
        ([["pid"]], "unknown law"),
        ([], None),
    ],
)
def test_names_that_are_wrong_are_refused_in_one_line(axes, law, text):
    if text is None:
        assert Servo.derive(axes, law=law).laws.names == ("pid",)
        return
    with pytest.raises(InputError, match="law") as caught:
        Servo.derive(axes, law=law)
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"law": "pid", "observer_bandwidth": 5.0}, "has no effect without law = 'observer'"),
        ({"law": "observer", "observer_bandwidth": 600.0}, "below half the servo's, 500 Hz"),
        ({"law": "observer", "observer_bandwidth": 0.0}, "must be above 0"),
        ({"law": "observer", "observer_bandwidth": [5.0, 0.0]}, "observer_bandwidth = 5, 0 Hz: must be above 0"),
        ({"law": "zv", "shaper_frequency": 0.0}, "shaper_frequency = 0 Hz: must be above 0"),
        ({"law": "preview", "preview_bandwidth": -1.0}, "must be at least 0"),
        ({"law": "pd", "ki": 1.0}, "ki = 1.0: must be 0 in law 'pd'"),
        ({"law": "zv", "shaper_damping": 1.0}, "must be below 1"),
        ({"law": "learning", "learning_repeats": 0}, "must be at least 1"),
        ({"law": "learning", "learning_repeats": 1.5}, "must be a whole number"),
        ({"law": "friction", "friction_torque": math.nan}, "must be finite"),
        ({"law": "contour", "contour_gain": [1.0]}, "has 1 values"),
    ],
)
def test_parameters_out_of_bounds_are_refused(axes, given, text):
    with pytest.raises(InputError) as caught:
        Servo.derive(axes, **given)
    assert text in str(caught.value)


def test_an_axis_without_a_mode_needs_no_shaper_beside_one_that_has(axes):
    servo = Servo.derive(axes, law="zv", shaper_frequency=[20.0, 0.0], shaper_damping=0.1)
    sent = ZV.sent(servo.laws.by_name(), ramp(50.0, 20.0))
    plain = ramp(50.0, 20.0)
    added = len(impulses(20.0, 0.1, servo.period)) - 1
    assert len(sent.position) == len(plain.position) + added  # both axes wait for the one


def test_without_a_position_gain_p_pi_is_a_velocity_loop():
    """kp = 0: no speed for an error, and no integral, whose rate is ki / kp; the demand's own torques remain."""
    gains = Gains(kd=0.4, velocity_ff=0.01, acceleration_ff=0.002, output_velocity=-0.03)
    torque, total = cascaded_torque(5.0, 0.7, 30.0, 200.0, 28.0, gains, 1e-3)
    assert torque == pytest.approx(0.4 * (30 - 28) + 0.01 * 30 + 0.002 * 200 - 0.03 * 28, rel=1e-12)
    assert total == pytest.approx(0.7 + 1e-3 * 0.4 * (30 - 28), rel=1e-12)
    assert as_pid(gains) == gains


@given(st.lists(st.sampled_from([0.0, 0.5, -0.3, 1.2]), min_size=5, max_size=5))
def test_a_compensator_through_any_filter_has_the_product_of_both_responses(coefficients):
    """Also where coefficients are zero, alone or together, as of a delay, a gain or one pole."""
    b0, b1, b2, a1, a2 = coefficients
    law = Compensator(np.array([[0.3, 0.1], [0.0, -0.4]]), np.array([1.0, 2.0]), np.array([0.5, -1.0]), 0.7)
    z = np.exp(1j * np.linspace(0.05, np.pi, 25)) * 1.7  # outside of the poles
    assert np.abs(1 + a1 / z + a2 / z**2).min() > 0.01
    expected = law.response(z) * (b0 + b1 / z + b2 / z**2) / (1 + a1 / z + a2 / z**2)
    np.testing.assert_allclose(law.then((b0, b1, b2, a1, a2)).response(z), expected, rtol=1e-9, atol=1e-12)


def test_every_parameter_has_a_default_with_its_law_and_none_without(axes):
    everything = Servo.derive(axes, law=[*ADDITIONS.keys() - {"zv"}])
    assert all(min(everything.per_axis(one.name)) > 0 for one in LAW_PARAMETERS if one.name != "shaper_damping")
    for base in BASES:
        plain = Servo.derive(axes, law=base)
        assert not any(any(plain.per_axis(one.name)) for one in LAW_PARAMETERS)


@pytest.mark.parametrize("law", [["p-pi"], ["observer"], ["p-pi", "observer", "contour"], ["pd"]])
def test_a_law_that_is_derived_keeps_the_margins_of_all(law):
    machine = Machine("xyz")
    for period in (5e-4, 2e-3):
        servo = Servo.derive(machine.axes, period, law=law, integral_time=0.1)
        for margins in margins_of(machine, servo):
            assert margins.gain >= 2
            assert margins.sensitivity <= 2


def response(servo, axis, z):
    """What stands between error and torque, written anew."""
    T, kp, ki, kd = servo.period, servo.gains[axis].kp, servo.gains[axis].ki, servo.gains[axis].kd
    rate, total = (1 - 1 / z) / T, T / (1 - 1 / z)
    more = 1 + servo.laws.parameters[axis].contour_gain
    if "p-pi" in servo.laws.names:
        law = (more * kp + kd * rate) * (1 + ki / kp * total)
    else:
        law = more * (kp + ki * total + kd * rate)
    b0, b1, b2, a1, a2 = servo.filters[axis]
    law *= (b0 + b1 / z + b2 / z**2) / (1 + a1 / z + a2 / z**2)
    if "observer" in servo.laws.names:
        # prewarped bilinear Butterworth, and a hold that is late by `late` periods before a double integrator
        w = 2 / T * math.tan(math.pi * servo.laws.parameters[axis].observer_bandwidth * T)
        s = 2 / T * (z - 1) / (z + 1)
        Q = w**2 / (s**2 + math.sqrt(2) * w * s + w**2)
        J, b = servo.laws.parameters[axis].observer_inertia, servo.laws.parameters[axis].observer_viscous
        late = servo.delay / T + servo.feedback_delay + servo.laws.parameters[axis].observer_lag / T
        whole, part = divmod(late, 1)
        moved = (1 - part) ** 2 / 2 / z + (0.5 + part - part**2) / z**2 + part**2 / 2 / z**3
        law = (law + Q * (J * rate**2 + b * rate)) / (1 - Q * moved * z**-whole)
    return law * z**-servo.feedback_delay


@pytest.mark.parametrize(
    "law", [["pid"], ["p-pi"], ["observer"], ["p-pi", "observer"], ["contour"], ["p-pi", "contour"]]
)
@pytest.mark.parametrize("late", [{}, {"delay": 4e-4, "feedback_delay": 2}])
def test_the_compensator_of_every_law_is_its_transfer_function(axes, law, late):
    servo = Servo.derive(axes, law=law, integral_time=0.05, **late)
    z = np.exp(1j * np.linspace(0.01, np.pi, 40))
    for axis, compensator in enumerate(servo.compensators()):
        np.testing.assert_allclose(compensator.response(z), response(servo, axis, z), rtol=EXACT)


@given(st.floats(0.0, 30.0))
def test_a_torque_that_is_late_moves_an_inertia_by_its_taps(lag):
    """The positions of an inertia of 1 under random torques, each held for a period of 1, integrated piece by piece."""
    shift, taps = torque_taps(lag)
    rng = np.random.default_rng(1)
    torque = rng.normal(size=40)
    # breakpoints at which the torque changes, and the samples
    at = np.unique(np.concatenate([np.arange(40) + lag, np.arange(0, 40.0)]))
    x = v = 0.0
    seen = {}
    for begin, end in itertools.pairwise(at):
        if begin == int(begin):
            seen[int(begin)] = x
        k = math.floor(begin - lag + 1e-9)
        u, h = (torque[k] if k >= 0 else 0.0), end - begin
        x, v = x + v * h + u * h**2 / 2, v + u * h
    for k in range(34, 38):
        change = seen[k] - 2 * seen[k - 1] + seen[k - 2]
        acted = sum(tap * torque[k - 1 - shift - j] for j, tap in enumerate(taps) if k - 1 - shift - j >= 0)
        assert change == pytest.approx(acted, abs=1e-7)


def test_a_torque_that_is_later_than_the_observer_remembers_counts_as_32_periods_late():
    assert torque_taps(31.5) == (31, pytest.approx((0.125, 0.75, 0.125)))
    assert torque_taps(32.0) == torque_taps(40.5) == (32, pytest.approx((0.5, 0.5, 0.0)))


@given(st.floats(1.0, 400.0))
def test_the_filters_pass_rest_and_halve_at_their_bandwidth(bandwidth):
    b0, b1, b2, a1, a2 = low_pass(bandwidth, PERIOD)
    assert (b0 + b1 + b2) / (1 + a1 + a2) == pytest.approx(1, rel=1e-9)
    z = np.exp(2j * np.pi * bandwidth * PERIOD)
    assert abs((b0 + b1 / z + b2 / z**2) / (1 + a1 / z + a2 / z**2)) == pytest.approx(math.sqrt(0.5), rel=1e-6)
    theta = np.array([1e-9, 2 * np.pi * bandwidth * PERIOD, np.pi])
    assert zero_phase(theta, bandwidth, PERIOD) == pytest.approx([1, 0.5, 0], abs=1e-6)


def lugre(demand, friction, steps=400):
    """LuGre's friction without the damping of its bristles, by Euler's method with many steps per tick, (n,)."""
    coulomb, static, speed, stiffness = friction
    z, torques = 0.0, []
    for travel in demand:
        v, h = travel / PERIOD, PERIOD / steps
        level = coulomb + (static - coulomb) * math.exp(-((v / speed) ** 2))
        for _ in range(steps):
            z += h * (v - stiffness * abs(v) * z / level)
        torques.append(stiffness * z)
    return np.array(torques)


def test_the_friction_is_lugre_s_at_starts_reversals_and_rest(axes):
    friction = axes[1].friction
    assert friction.coulomb == 0.0189
    assert friction.static == 0.0227
    t = np.arange(600) * PERIOD
    position = np.where(t < 0.45, 2 * np.sin(2 * np.pi * 4 * t) * np.minimum(t / 0.02, 1), np.nan)
    position = np.where(np.isnan(position), position[449], position)
    travel = np.diff(position)
    own, last = [], 0.0
    for step in travel:
        last = friction_torque(last, step / PERIOD, step, tuple(friction))
        own.append(last)
    np.testing.assert_allclose(own, lugre(travel, friction), atol=LUGRE * friction.coulomb)
    assert own[-1] == own[-100] != 0  # the bristles stay bent at rest
    assert max(own) > friction.coulomb  # Stribeck


def test_an_axis_without_friction_has_none_to_compensate():
    for stiffness in (0.0, 10.0):
        assert friction_torque(0.0, 5.0, 5e-3, (0.0, 0.0, 1.0, stiffness)) == 0.0


@given(st.floats(5.0, 40.0), st.floats(0.0, 0.3), st.sampled_from(["zv", "zvd"]))
def test_shaping_leaves_nothing_at_its_mode_and_passes_rest(frequency, damping, law):
    """What an impulse leaves swinging in a mode is its transform at the mode's complex frequency."""
    weights = SHAPERS[law](frequency, damping, PERIOD)
    assert weights.sum() == pytest.approx(1, rel=1e-12)
    assert weights.min() >= 0
    w = 2 * math.pi * frequency
    s = complex(-damping * w, w * math.sqrt(1 - damping**2))
    left = abs(np.sum(weights * np.exp(-s * PERIOD * np.arange(len(weights)))))
    grown = math.exp(damping * w * PERIOD * (len(weights) - 1))
    assert left < SHARED * (w * PERIOD) ** 2 * grown + 1e-12


def test_zvd_bears_a_wrong_frequency_better_than_zv():
    def left(law, ratio):
        weights = SHAPERS[law](20.0, 0.0, 1e-4)
        return abs(np.sum(weights * np.exp(2j * np.pi * 20.0 * ratio * 1e-4 * np.arange(len(weights)))))

    assert left("zv", 1.1) == pytest.approx(math.sin(math.pi / 2 * 0.1), rel=0.01)
    assert left("zvd", 1.1) == pytest.approx(math.sin(math.pi / 2 * 0.1) ** 2, rel=0.02)


def test_shaped_setpoints_end_where_they_should_at_each_gate_and_at_the_end(axes):
    servo = Servo.derive(axes, law="zvd", shaper_frequency=[20.0, 33.3], shaper_damping=0.05)
    plain = dataclasses.replace(ramp(50.0, 20.0), gates=np.array([100, 250]))
    sent = ZVD.sent(servo.laws.by_name(), plain)
    assert len(sent.position) > len(plain.position)
    for gate, old in zip(sent.gates, plain.gates, strict=True):
        np.testing.assert_allclose(sent.position[gate], plain.position[old], atol=1e-12)
        assert len(sent.position) - gate > len(plain.position) - old
    np.testing.assert_allclose(sent.position[-1], plain.position[-1], atol=1e-12)
    np.testing.assert_allclose(sent.position[0], plain.position[0], atol=1e-12)
    # a constant speed is sent late by the mean delay of the two shapers together, and so is the dispenser
    delay = sum(np.arange(len(w)) @ w for w in (three_impulses(f, 0.05, PERIOD) for f in (20.0, 33.3)))
    steady = dataclasses.replace(ramp(50.0, 20.0))
    late = ZVD.sent(servo.laws.by_name(), steady).position[200, 0]
    assert late == pytest.approx(steady.position[200, 0] - 50.0 * PERIOD * delay, abs=1e-9)
    off = dataclasses.replace(steady, dispense=np.arange(len(steady.dispense)) >= 10)
    assert np.argmax(ZVD.sent(servo.laws.by_name(), off).dispense) == 10 + round(delay)


def test_the_error_across_the_path_is_what_is_left_without_the_part_along_it():
    """A path along (3, 4) / 5: an error of (1, 7) has 6.2 along it, which is (3.72, 4.96); a rotary axis has none."""
    linear = np.array([1.0, 1.0, 0.0])
    tangent = np.zeros(3)
    error = np.array([1.0, 7.0, 9.0])
    tangents(np.zeros(3), linear, tangent, 3)
    assert [error_across(error, tangent, linear, axis, 3) for axis in range(3)] == [0, 0, 0]  # it has not moved yet
    tangents(np.array([30.0, 40.0, 500.0]), linear, tangent, 3)
    assert tangent == pytest.approx([0.6, 0.8, 0.0], rel=EXACT)
    across = [error_across(error, tangent, linear, axis, 3) for axis in range(2)]
    assert across == pytest.approx([1 - 3.72, 7 - 4.96], rel=EXACT)
    tangents(np.array([0.0, 0.0, 500.0]), linear, tangent, 3)
    assert tangent == pytest.approx([0.6, 0.8, 0.0], rel=EXACT)  # at rest, that of the last motion
    tangents(np.array([0.0, -2.0, 0.0]), linear, tangent, 3)
    assert tangent == pytest.approx([0.0, -1.0, 0.0], abs=EXACT)


def test_laws_that_invert_the_machine_have_its_motion_and_no_others_need_it():
    """A machine without a linear motion, as with a delay in its actuators, has all other laws."""
    axes = Machine("xy").axes
    delayed = [dataclasses.replace(axis, motion=None) for axis in axes]
    for law in ADDITIONS:
        inverts = law in ("preview", "learning")
        assert bool(Servo.derive(axes, law=["pid", law]).laws.motions) == inverts
        if inverts:
            with pytest.raises(InputError, match=law):
                Servo.derive(delayed, law=["pid", law], frequency=20.0)
        else:
            # a shaper's frequency is else that of the motion's mode
            known = {"shaper_frequency": 50.0} if law in ("zv", "zvd") else {}
            assert law in Servo.derive(delayed, law=["pid", law], frequency=20.0, **known).laws.names
    servo = Servo.derive(axes, law=["pid", "preview"])
    bare = dataclasses.replace(servo.laws, motions=())
    with pytest.raises(InputError, match=r"^laws 'preview' and 'learning' need motions"):
        dataclasses.replace(servo, laws=bare)
