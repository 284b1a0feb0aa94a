"""Efficiency and accuracy class of a table's transmissions in the simulation: closed forms and energy."""

import math
import re

import numpy as np
import pytest

from gantrysim import InputError, Job, Machine, Servo, simulate
from gantrysim.job.causes import causes_of
from gantrysim.machine.geometry import Geometry, typical
from gantrysim.machine.ideal import without_friction
from gantrysim.metrics.budget import Budget
from gantrysim.record.setpoints import Setpoints

from support.runs import ramp
from support.soaked import suite_runs
from support.tables import EXAMPLES, SCREW, ideal

LEAD, LOAD, NUT = 0.020, 1.0, 0.25
TURNING = 2e-5 + math.pi * 7850 * 0.6 * 0.016**4 / 32  # rotor and screw [kg·m²]
GEAR = 2 * math.pi / LEAD
PERIOD = 2.5e-4


def built(tmp_path, way=SCREW, edit=lambda text: text):
    file = tmp_path / "machine.toml"
    file.write_text(edit(ideal(way)))
    return Machine(file)


def lossy(efficiency, way=SCREW):
    return way.replace("damping_ratio = 0", f"damping_ratio = 0.5\nefficiency = {efficiency}")


def moved(machine, length=40.0, time=0.4):
    """A move of x whose acceleration is a sine, closely followed; the machine stands still after it."""
    at = np.arange(0, 1.5 * time, PERIOD)
    u = np.clip(at / time, 0, 1)
    position = np.zeros((at.size, 2))
    position[:, 0] = length * (u - np.sin(2 * np.pi * u) / (2 * np.pi))
    setpoints = Setpoints(PERIOD, machine.axis_names, position, np.zeros(at.size, bool), ramp(50.0).requested)
    servo = Servo.derive(machine.axes, PERIOD, resolution=0.0, frequency=25.0)
    acceleration = 1e-3 * length * np.where(u < 1, np.sin(2 * np.pi * u), 0.0) * 2 * np.pi / time**2
    return simulate(machine, servo, setpoints), acceleration


@pytest.mark.parametrize("efficiency", [0.9, 0.5])
def test_torque_passes_the_transmission_with_its_efficiency(tmp_path, efficiency):
    """T = (J gear + m_nut / gear) a + m a / (e gear) while it drives its load, (2 - 1/e) m a / gear while it brakes."""
    run, a = moved(built(tmp_path, lossy(efficiency)))
    share = np.where(a > 0, 1 / efficiency, 2 - 1 / efficiency)
    expected = (TURNING * GEAR + NUT / GEAR) * a + share * LOAD / GEAR * a
    turned = np.abs(np.gradient(run.motor[:, 0], PERIOD)) > 5  # the friction
    fast = turned & (np.abs(a) > 0.3 * np.abs(a).max())
    size = LOAD / GEAR * np.abs(a).max()
    np.testing.assert_allclose(run.torque[fast, 0], expected[fast], atol=0.06 * size)


def test_what_is_lost_is_the_share_of_the_work_on_the_load(tmp_path):
    """(1/e - 1) of m v² / 2 when it is accelerated, and again when it is braked."""
    efficiency = 0.8
    run, _ = moved(built(tmp_path, lossy(efficiency)))
    angle = 1e-3 * run.motor[:, 0] * GEAR
    work = np.concatenate([[0], np.cumsum(0.5 * (run.torque[1:, 0] + run.torque[:-1, 0]) * np.diff(angle))])
    speed = 1e-3 * np.gradient(run.motor[:, 0], PERIOD)
    own, load = 0.5 * (TURNING * GEAR**2 + NUT) * speed.max() ** 2, 0.5 * LOAD * speed.max() ** 2
    assert work[speed.argmax()] == pytest.approx(own + load / efficiency, rel=0.01)
    assert work[-1] == pytest.approx(2 * (1 / efficiency - 1) * load, rel=0.03)


def test_a_transmission_below_one_half_holds_its_load(tmp_path):
    """Below 50 % a force on the load does not turn the motor back; above it does, with 2 - 1/e of its torque."""
    force = 20.0
    for efficiency, slips in ((0.45, False), (0.8, True)):
        machine = built(tmp_path, lossy(efficiency))

        def tilt(spec):
            spec.option.gravity = [force / LOAD, 0, 0]
            for body in spec.bodies:
                body.gravcomp = float("nut" in body.name)

        tilted = machine.edited(tilt)
        off = Servo.derive(tilted.axes, PERIOD, kp=0, ki=0, kd=0, velocity_ff=0, acceleration_ff=0, resolution=0.0)
        position = np.zeros((400, 2))
        run = simulate(tilted, off, Setpoints(PERIOD, ("x", "y"), position, np.zeros(400, bool), ramp(50.0).requested))
        assert bool(run.motor[-1, 0] > 1.0) is slips
        if slips:
            inertia = TURNING * GEAR**2 + NUT
            a = 1e3 * force * (2 - 1 / efficiency) / (inertia + (2 - 1 / efficiency) * LOAD)  # the load falls too
            assert run.motor[-1, 0] == pytest.approx(0.5 * a * run.time[-1] ** 2, rel=0.03)


@pytest.mark.soak
@pytest.mark.parametrize("name", suite_runs(["corexy", "tandem"], 0))
def test_belts_and_two_drives_lose_it_too(tmp_path, name):
    """The work of all motors between two rests is what is lost: more with less efficiency, about by its share."""
    text = (EXAMPLES / f"{name}.toml").read_text()
    lost = []
    for efficiency in (1.0, 0.9, 0.8):
        file = tmp_path / f"{name}.toml"
        file.write_text(re.sub(r"efficiency = [0-9.]+", f"efficiency = {efficiency}", text))
        machine = Machine(file)
        run = Job.load("an225", ["turns=1"], machine=str(file)).run(machine=machine)
        speed = np.gradient(np.radians(run.motor) if name == "corexy" else 1e-3 * run.motor, run.period, axis=0)
        gears = machine.physics.actuator_gear[:, 0]
        moved = [a for a, axis in enumerate(machine.axis_names) if axis != "x"]
        lost.append((run.torque * speed * gears)[:, moved].sum() * run.period)
    assert lost[0] < lost[1] < lost[2]


def test_without_friction_there_is_no_loss(tmp_path):
    machine = built(tmp_path, lossy(0.7))
    assert [axis.efficiency for axis in machine.axes] == [0.7, 1.0]
    free = without_friction(machine)
    assert all(axis.efficiency == 1 for axis in free.axes)
    lossless = moved(built(tmp_path, lossy(1.0)))[0]
    np.testing.assert_allclose(moved(free)[0].torque, lossless.torque, atol=1e-9)


def test_full_efficiency_changes_no_bit(tmp_path):
    plain = SCREW.replace("damping_ratio = 0", "damping_ratio = 0.5")
    first, second = (moved(built(tmp_path, way))[0] for way in (plain, lossy(1.0)))
    np.testing.assert_array_equal(first.nozzle, second.nozzle)


def test_guides_cost_the_motor_more(tmp_path):
    """Friction F and d of the guides take F / e and d / e from the motor."""
    machines = []
    for efficiency in (1.0, 0.8):
        text = ideal(lossy(efficiency)).replace("speed = 9000", "speed = 9000\nguides = { friction = 5, viscous = 10 }")
        file = tmp_path / "guides.toml"
        file.write_text(text)
        machines.append(Machine(file).axes[0])
    assert machines[1].coulomb == pytest.approx(machines[0].coulomb / 0.8)
    assert machines[1].viscous == pytest.approx(machines[0].viscous / 0.8)


def test_the_accuracy_class_displaces_the_nozzle(tmp_path):
    """E x / 300 mm + e sin(2 pi x / lead) along the axis, by the class."""
    machine = built(tmp_path, SCREW + '\naccuracy = "C7"')
    run, _ = moved(machine)
    x, allowed = run.motor[:, 0], typical("C7")
    expected = allowed["travel_error"] * x / 300 + allowed["periodic_error"] * np.sin(2 * np.pi * x / 20)
    np.testing.assert_allclose((run.geometric_tip - run.motor_tip)[:, 0], expected, atol=1e-9)
    np.testing.assert_allclose((run.geometric_tip - run.motor_tip)[:, 1:], 0, atol=1e-12)
    assert built(tmp_path).geometry is None


@pytest.mark.soak
def test_a_job_s_geometry_takes_the_place_of_the_table_s(tmp_path):
    file = str(EXAMPLES / "cantilever.toml")
    own, other = Job.load("an225", ["turns=1"], machine=file), Job.load("an225", ["turns=1", "play=0.01"], machine=file)
    assert own.built_machine.geometry == Geometry(travel_error=(0.05, 0.04), periodic_error=(0.006, 0.0))
    assert other.built_machine.geometry == Geometry(play=0.01)
    assert Budget(own.run()).values.parts["geometry"].rms > 0
    (effect,) = (one for one in causes_of(own).effects if one.cause.name == "geometry")
    assert effect.without["geometry"].rms == 0


def test_corexy_has_no_accuracy_class(tmp_path):
    file = tmp_path / "corexy.toml"
    file.write_text((EXAMPLES / "corexy.toml").read_text().replace("efficiency", "accuracy = 40, efficiency"))
    with pytest.raises(InputError, match="accuracy: does not apply to CoreXY, whose motors are not slides"):
        Machine(file)


def test_an_efficiency_that_is_none_is_refused(tmp_path):
    with pytest.raises(InputError, match="efficiency = 0"):
        built(tmp_path, lossy(0))
    machine = built(tmp_path)
    with pytest.raises(InputError, match=r"custom numeric efficiency = 1\.5: must be above 0 and at most 1"):
        machine.edited(lambda spec: setattr(spec.numeric("efficiency"), "data", [1.5, 1.0]))
