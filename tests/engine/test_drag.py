"""A constant torque and viscous friction by direction that a machine carries: closed forms, in both engines."""

import numpy as np
import pytest

from gantrysim import InputError, Machine, Perturbation, Servo, simulate
from gantrysim.machine.axis import CONSTANT_TORQUE, VISCOUS_DIFFERENCE
from gantrysim.machine.ideal import without_compliance, without_friction, without_winding
from gantrysim.machine.sizing import Sizing
from gantrysim.record.setpoints import Setpoints

from support.runs import ramp

PERIOD = 1e-3
ENGINES = ("mujoco", "loop")


def carrying(**numerics):
    """A gantry without dry friction, winding and compliance whose axes carry values [N·m] and [N·s/m]."""
    plain = without_compliance(without_winding(without_friction(Machine("xy"))))

    def edit(spec):
        for name, values in numerics.items():
            spec.add_numeric(name=name, size=2, data=values)

    return plain.edited(edit)


def pushed(machine, torque, ticks, engine):
    """The run of the machine with its loops open, under a torque of each motor [N·m]."""
    off = dict.fromkeys(("kp", "ki", "kd", "velocity_ff", "acceleration_ff", "resolution"), 0)
    servo = Servo.derive(machine.axes, PERIOD, following_error_limit=1e3, **off)
    torques = np.tile(torque, (ticks, 1))
    position = np.zeros((ticks, 2))
    setpoints = Setpoints(PERIOD, ("x", "y"), position, np.zeros(ticks, bool), ramp(50.0).requested, torque=torques)
    return simulate(machine, servo, setpoints, engine=engine)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_constant_torque_accelerates_a_free_axis(engine):
    machine = carrying(**{CONSTANT_TORQUE: [2e-3, -1e-3]})
    run = pushed(machine, (0.0, 0.0), 100, engine)
    for a, torque in enumerate((2e-3, -1e-3)):
        axis = machine.axes[a]
        # J v' = T - b v from rest
        rate = axis.viscous / axis.inertia
        t = run.time[-1]
        travel = torque / axis.viscous * (t - (1 - np.exp(-rate * t)) / rate)
        assert run.motor[-1, a] == pytest.approx(travel, rel=0.01)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("way", [1, -1])
def test_viscous_friction_by_direction_gives_each_direction_its_speed(engine, way):
    plain = carrying().axes
    share = np.array([0.4, -0.3])
    per_joint = [1e6 / axis.scale for axis in plain]  # N·m·s/mm at the motor to N·s/m at the slide
    machine = carrying(
        **{VISCOUS_DIFFERENCE: [d * axis.viscous * k for d, axis, k in zip(share, plain, per_joint, strict=True)]}
    )
    torque = way * np.array([axis.viscous * 40.0 for axis in plain])
    run = pushed(machine, torque, 1500, engine)
    for a, axis in enumerate(plain):
        # J v' = T - b v from rest
        b = axis.viscous * (1 + way * share[a])
        t = run.time[-1]
        expected = torque[a] / b * (t - axis.inertia / b * (1 - np.exp(-b / axis.inertia * t)))
        assert run.motor[-1, a] == pytest.approx(expected, rel=0.01)


def test_both_engines_agree_and_a_machine_without_is_unchanged():
    machine = Machine("xy")

    def edit(spec):
        spec.add_numeric(name=CONSTANT_TORQUE, size=2, data=[5e-3, -5e-3])
        spec.add_numeric(name=VISCOUS_DIFFERENCE, size=2, data=[20.0, -10.0])

    carried = machine.edited(edit)
    servo = Servo.derive(machine.axes, PERIOD)
    setpoints = ramp(50.0)
    runs = [simulate(carried, servo, setpoints, engine=engine) for engine in ENGINES]
    np.testing.assert_allclose(runs[0].motor, runs[1].motor, atol=1e-9)
    zero = machine.edited(lambda spec: spec.add_numeric(name=CONSTANT_TORQUE, size=2, data=[0.0, 0.0]))
    plain = [simulate(m, servo, setpoints) for m in (machine, zero)]
    np.testing.assert_array_equal(plain[0].motor, plain[1].motor)
    assert np.abs(runs[0].motor - plain[0].motor).max() > 1e-4


def test_what_a_machine_carries_is_read_scaled_sized_and_refused():
    machine = carrying(**{CONSTANT_TORQUE: [2e-3, 0.0], VISCOUS_DIFFERENCE: [12.0, 0.0]})
    axis = machine.axes[0]
    assert (axis.constant_torque, machine.axes[1].constant_torque) == (2e-3, 0.0)
    assert axis.viscous_difference == pytest.approx(12.0 * axis.scale / 1e6)
    doubled = machine.perturbed(Perturbation(viscous=2.0)).axes[0]
    assert doubled.viscous_difference == pytest.approx(2 * axis.viscous_difference)
    assert doubled.constant_torque == axis.constant_torque
    assert machine.axes[0].viscous_difference == axis.viscous_difference
    plain, sized = (Sizing.of(m).axes[0] for m in (carrying(), machine))
    back = -axis.constant_torque + axis.viscous_difference * axis.speed_limit
    assert sized.friction_at_speed - plain.friction_at_speed == pytest.approx(abs(back))
    assert sized.acceleration == pytest.approx(plain.acceleration - 2e-3 / axis.inertia)
    with pytest.raises(InputError, match=f"custom numeric {CONSTANT_TORQUE} = nan: must be finite"):
        carrying(**{CONSTANT_TORQUE: [np.nan, 0.0]})


def test_it_is_part_of_the_file_that_is_written(tmp_path):
    machine = Machine("xy").edited(lambda spec: spec.add_numeric(name=CONSTANT_TORQUE, size=2, data=[2e-3, 1e-3]))
    file = tmp_path / "machine.xml"
    file.write_text(machine.spec.to_xml())
    assert [axis.constant_torque for axis in Machine(str(file)).axes] == [2e-3, 1e-3]
