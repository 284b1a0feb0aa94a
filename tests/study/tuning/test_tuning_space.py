"""The search space, its gains and bounds, and the stability margin that limits it."""

import dataclasses
import itertools
import math
import tomllib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import InputError, Job, Machine, Servo
from gantrysim.machine.perturbation import Perturbation
from gantrysim.servo.stability.margins import Plant
from gantrysim.study.tuning.candidates import TrialResult
from gantrysim.study.tuning.objective import RIPPLE, trial_result
from gantrysim.study.tuning.servo import servo_toml, tuned_toml
from gantrysim.study.tuning.space import SEARCHED_GAINS, SPACES, SearchSpace
from gantrysim.study.tuning.stability import Fastest, Stability, phase_margin

from support.soaked import examples, suite_runs

PERIOD = 1e-3
ROUNDED = 5.1e-4  # relative, of four digits
NEAR = 0.012  # of the logarithm of the peak of |S| at the edge of the margin
AXES = Machine("xyz").axes
DERIVED = Servo.derive(AXES, PERIOD)


def scaled(servo, **factors):
    return servo.with_values(
        **{name: tuple(factor * gain for gain in servo.per_axis(name)) for name, factor in factors.items()}
    )


def space(law="pid", start=None, per_axis=False, axes=AXES, derived=DERIVED):
    start = start or Servo.derive(axes, PERIOD, integral_time=0.03)
    return SearchSpace(law, axes, derived, start, per_axis)


factor = st.floats(0.03, 30.0)


@examples(60)
@given(st.tuples(*[factor] * 5), st.sampled_from(list(SPACES)), st.booleans())
def test_the_start_has_a_point_that_gives_it_back(factors, law, per_axis):
    names = ("kp", "ki", "kd", "velocity_ff", "acceleration_ff")
    start = scaled(Servo.derive(AXES, PERIOD, integral_time=0.03), **dict(zip(names, factors, strict=True)))
    if law == "pd":
        start = scaled(start, ki=0.0)
    own = space(law, start, per_axis)
    found = own.servo(*own.begin)
    for name in names:
        np.testing.assert_allclose(found.per_axis(name), start.per_axis(name), rtol=2 * ROUNDED)
    assert (own.begin[1] >= own.bounds[:, 0]).all()
    assert (own.begin[1] <= own.bounds[:, 1]).all()


def test_the_point_of_zeros_and_ones_is_the_derived_servo():
    own = space("pd")
    assert own.begin[1].size == 3
    found = own.servo(np.zeros(1), np.array([0.0, 1.0, 1.0]))
    for name in ("kp", "ki", "kd", "velocity_ff", "acceleration_ff", "output_velocity"):
        np.testing.assert_allclose(found.per_axis(name), DERIVED.per_axis(name), rtol=ROUNDED)


def test_the_gains_follow_from_the_numbers():
    """kp = J w^2, kd = 2 zeta J w, ki = kp w / n, velocity_ff = v b, acceleration_ff = a J."""
    own = space("pid")
    u, zeta, n = 0.2, -0.3, 0.1
    found = own.servo(np.array([u]), np.array([zeta, n, 0.0, 2.0]))
    for a, axis in enumerate(AXES):
        w = math.sqrt(DERIVED.gains[a].kp / axis.inertia) * 10**u
        assert found.gains[a].kp == pytest.approx(axis.inertia * w**2, rel=ROUNDED)
        assert found.gains[a].kd == pytest.approx(2 * 10**zeta * axis.inertia * w, rel=ROUNDED)
        assert found.gains[a].ki == pytest.approx(axis.inertia * w**3 / (5 * 10**n), rel=ROUNDED)
        assert found.gains[a].velocity_ff == 0
        assert found.gains[a].acceleration_ff == pytest.approx(math.sinh(4) / math.sinh(2) * axis.inertia, rel=ROUNDED)


def test_gains_have_four_digits():
    found = space().servo(np.array([0.12345]), np.array([0.1, -0.2, 0.777, 1.333]))
    for name in ("kp", "ki", "kd", "velocity_ff", "acceleration_ff"):
        assert all(gain == float(f"{gain:.4g}") > 0 for gain in found.per_axis(name))


def test_axes_share_their_numbers_or_have_their_own():
    crooked = DERIVED.with_values(
        kp=tuple(f * kp for f, kp in zip((4.0, 1.0, 0.25), DERIVED.per_axis("kp"), strict=True))
    )
    shared, own = space("pd", crooked), space("pd", crooked, per_axis=True)
    assert (shared.groups, shared.begin[1].size, own.groups, own.begin[1].size) == (1, 3, 3, 9)
    assert shared.begin[0] == pytest.approx([0.0], abs=1e-12)  # the mean of the logarithms
    assert own.begin[0] == pytest.approx(np.log10([2.0, 1.0, 0.5]))
    np.testing.assert_allclose(own.servo(*own.begin).per_axis("kp"), crooked.per_axis("kp"), rtol=ROUNDED)
    np.testing.assert_allclose(shared.servo(*shared.begin).per_axis("kp"), DERIVED.per_axis("kp"), rtol=ROUNDED)
    moved = own.begin[1] + np.eye(9)[4]  # the damping of none, or the velocity's share of the second axis
    changed = own.servo(own.begin[0], moved)
    assert [
        a != b
        for a, b in zip(changed.per_axis("velocity_ff"), own.servo(*own.begin).per_axis("velocity_ff"), strict=True)
    ] == [
        False,
        True,
        False,
    ]


def test_damping_by_the_measured_velocity_is_read_as_damping():
    """kd dE + velocity_ff dDPOS + output_velocity dMPOS is a law in dDPOS and dMPOS; its two factors stay."""
    kd, velocity = DERIVED.per_axis("kd"), DERIVED.per_axis("velocity_ff")
    start = DERIVED.with_values(
        kd=tuple(0.25 * d for d in kd),
        output_velocity=tuple(-0.75 * d for d in kd),
        velocity_ff=tuple(v + 0.75 * d for v, d in zip(velocity, kd, strict=True)),
    )
    own = space("pd", start)
    found = own.servo(*own.begin)
    of_demand = np.add(found.per_axis("kd"), found.per_axis("velocity_ff"))
    of_measured = np.subtract(found.per_axis("output_velocity"), found.per_axis("kd"))
    np.testing.assert_allclose(of_demand, np.add(start.per_axis("kd"), start.per_axis("velocity_ff")), rtol=2 * ROUNDED)
    np.testing.assert_allclose(
        of_measured, np.subtract(start.per_axis("output_velocity"), start.per_axis("kd")), rtol=2 * ROUNDED
    )
    assert found.per_axis("output_velocity") == (0.0,) * 3


def test_gains_of_zero_begin_at_their_natural_numbers():
    none = scaled(DERIVED, kp=0.0, kd=-1.0, velocity_ff=-1.0, acceleration_ff=0.0)
    own = space("pid", none)
    frequencies, shape = own.begin
    assert frequencies == pytest.approx([0.0])
    assert shape == pytest.approx([0.0, 0.0, 0.0, 0.0])
    found = own.servo(frequencies, shape)
    np.testing.assert_allclose(found.per_axis("kd"), DERIVED.per_axis("kd"), rtol=ROUNDED)
    assert found.per_axis("velocity_ff") == found.per_axis("acceleration_ff") == (0.0,) * 3


def test_an_axis_without_viscous_torque_has_a_unit_for_its_feedforward():
    axes = [dataclasses.replace(axis, viscous=0.0) for axis in AXES]
    own = space("pd", Servo.derive(axes, PERIOD), axes=axes)
    found = own.servo(np.zeros(1), np.array([0.0, 1.0, 1.0]))
    np.testing.assert_allclose(found.per_axis("velocity_ff"), 0.01 * np.array(DERIVED.per_axis("kd")), rtol=ROUNDED)


@pytest.mark.parametrize("off", [1 / 30, 0.1, 10.0, 30.0])
@pytest.mark.parametrize("gain", ["kp", "kd", "ki", "velocity_ff", "acceleration_ff"])
def test_the_derived_gains_lie_within_the_bounds_of_a_start_that_is_far_off(off, gain):
    start = scaled(Servo.derive(AXES, PERIOD, integral_time=0.03), **{gain: off})
    own, right = space("pid", start), space("pid")
    low, high = own.bounds.T
    assert (right.begin[1] >= low).all()
    assert (right.begin[1] <= high).all()


def peak(machine, servo):
    return max(own.sensitivity for own in Plant.of(machine, PERIOD).margins(servo))


@pytest.fixture(scope="module")
def machines(xyz):
    return [xyz, xyz.perturbed(Perturbation(payload=0.5, stiffness=0.6)), xyz.perturbed(Perturbation(viscous=2.0))]


@pytest.mark.parametrize(
    ("margin", "per_axis", "guess"),
    # a case of each margin, of each guess, and of axes together and apart
    suite_runs(list(itertools.product([1.6, 2.0, 3.0], [False, True], [-0.6, 0.0, 0.5])), 0, 10, 14),
)
def test_the_fastest_loops_are_at_the_edge_of_the_margin_on_the_hardest_machine(machines, margin, per_axis, guess):
    stability = Stability(machines, PERIOD, 0.0, margin)
    own = space("pid", per_axis=per_axis, axes=machines[0].axes, derived=Servo.derive(machines[0].axes, PERIOD))
    shape = np.repeat([-0.15, 0.1, 1.0, 1.0], own.groups)
    found = stability.fastest(own, shape, Fastest(np.full(own.groups, guess)))
    bound = margin / (margin - 1)
    servo = own.servo(found.frequencies, shape)
    worst = [
        max(Plant.of(machine, PERIOD).margins(servo)[a].sensitivity for machine in machines) for a in range(servo.axes)
    ]
    assert found.excess <= 0
    assert max(worst) <= bound
    at_edge = [math.log(bound / own_worst) < NEAR for own_worst in worst]
    assert all(at_edge) if per_axis else any(at_edge)
    assert max(peak(machine, own.servo(found.frequencies + 0.02, shape)) for machine in machines) > bound


def test_a_shape_that_keeps_the_margin_at_no_frequency_has_its_least_excess(machines):
    stability = Stability(machines, PERIOD, 0.0, 2.0)
    own = space("pid", axes=machines[0].axes)
    excess = [
        stability.fastest(own, np.array([zeta, 0.0, 1.0, 1.0]), Fastest(np.zeros(1))).excess
        for zeta in (-0.9, -0.7, -0.15)
    ]
    assert excess[0] > excess[1] > 0 >= excess[2]


def test_the_margin_in_every_direction_is_at_least_the_margins_of_gain_and_phase(machines):
    for margin in (1.5, 2.0, 4.0):
        stability = Stability(machines, PERIOD, 0.0, margin)
        own = space("pid", axes=machines[0].axes)
        shape = np.array([0.1, 0.3, 1.0, 1.0])
        found = stability.fastest(own, shape, Fastest(np.zeros(1)))
        assert found.excess <= 0
        servo = own.servo(found.frequencies, shape)
        for machine in range(len(machines)):
            for one in stability.margins(servo, machine):
                assert one.gain >= margin
                assert one.gain_lower <= 1 / (2 - 1 / margin)  # where L crosses the real axis beyond -1
                assert one.phase >= phase_margin(margin)
    assert phase_margin(2.0) == pytest.approx(28.955, abs=1e-3)


def test_the_excess_grows_from_stable_to_unstable_loops(machines):
    stability = Stability(machines, PERIOD, 0.0, 2.0)
    base = Servo.derive(machines[0].axes, PERIOD)
    excess = [float(stability.excess(scaled(base, kp=f * f, kd=f)).max()) for f in (0.3, 0.7, 4.0, 20.0)]
    assert excess[0] < 0 < excess[1] < 10 < excess[2] < excess[3]  # from 10 on the loop is not stable
    assert stability.excess(scaled(base, kd=20.0), [0]).shape == (3,)


def test_coupled_axes_keep_the_margin_together():
    stage = Machine("stage")
    axes = stage.axes
    derived = Servo.derive(axes, PERIOD)
    own = SearchSpace("pd", axes, derived, derived, per_axis=True)
    stability = Stability([stage, stage.perturbed(Perturbation(payload=1.0))], PERIOD, 0.0, 2.0)
    shape = np.repeat([-0.1, 1.0, 1.0], len(axes))
    found = stability.fastest(own, shape, Fastest(np.zeros(len(axes))))
    servo = own.servo(found.frequencies, shape)
    assert found.excess <= 0
    assert float(stability.excess(servo).max()) <= 0
    assert float(stability.excess(servo).max()) > -0.1


@pytest.mark.parametrize("margin", [1.0, 0.5, -2.0, math.nan, math.inf])
def test_a_margin_below_one_is_refused(xyz, margin):
    with pytest.raises(InputError, match="margin = "):
        Stability([xyz], PERIOD, 0.0, margin)


@pytest.mark.parametrize(
    ("gains", "law"),
    [({}, ["pd"]), ({"ki": (3.0, 0.0)}, ["pid"]), ({"velocity_ff": (0.0, 0.1)}, ["pid"])],
)
def test_a_tuned_servo_is_written_with_a_law_that_has_its_gains(gains, law):
    """A search from PD that has found an integral or a feed-forward is PID; one that has not stays PD."""
    job = Job.load("softmc-arc")
    servo = Servo.derive(job.built_machine.axes, PERIOD, law="pd").with_values(**gains)
    written = tomllib.loads(servo_toml(job, servo, ["by hand"]))["servo"]
    assert written["law"] == law
    assert written["kp"] == list(servo.per_axis("kp"))
    assert written["ki"] == list(servo.per_axis("ki"))


@pytest.mark.parametrize("law", ["pd", "pid"])
def test_tuned_values_laid_over_the_job_give_the_tuned_servo(tmp_path, law):
    """A job whose own gains, damping by the measured velocity and law differ from what the search has found."""
    own = ["servo.kp=0.3", "servo.kd=0.004", "servo.output_velocity=-0.001", "servo.delay=0.0005", 'servo.law="pd"']
    job = Job.load("softmc-arc", own)
    gains = SEARCHED_GAINS if law == "pid" else [name for name in SEARCHED_GAINS if name != "ki"]
    tuned = {name: (0.01 * k, 0.02 * k) for k, name in enumerate(gains, 1)} | {"output_velocity": (0.0, 0.0)}
    servo = job.built_servo.with_values(**tuned)
    text = tuned_toml(job, servo, gains, ["by hand"])
    further = ["output_velocity"]
    assert list(tomllib.loads(text)["servo"]) == ["law", *gains, *further]
    (tmp_path / "tuned.toml").write_text(text)
    (tmp_path / "job.toml").write_text(job.toml())
    again = Job.load(tmp_path / "job.toml", servo=tmp_path / "tuned.toml").built_servo
    assert again.values() == servo.values() | {"law": ("pid",)}
    assert again.delay == 0.0005


@pytest.mark.parametrize(
    ("row", "expected"),
    [
        ({"status": "ok", "contour_rms_um": 7.5, RIPPLE: 2.0}, TrialResult(7.5, 0.02)),
        ({"status": "fault", "fault_time_s": 0.35}, TrialResult(math.inf, math.inf, 0.35)),
        ({"status": "fault", "fault_time_s": 0.0}, TrialResult(math.inf, math.inf, 0.0)),
        ({"status": "refused"}, TrialResult(math.inf, math.inf, 0.0)),  # not run at all: behind every fault
    ],
)
def test_the_result_of_a_trial_is_that_of_its_row(row, expected):
    assert trial_result(row, "contour_rms") == expected
