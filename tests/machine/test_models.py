"""The built-in machines against the theory of their drives."""

import math
import xml.etree.ElementTree as ET
from importlib.resources import files

import mujoco
import numpy as np
import pytest
from scipy.stats import qmc

from gantrysim import Machine, Servo, simulate
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.machine.machine import builtin_models
from gantrysim.record.setpoints import Setpoints

from support.runs import smooth
from support.soaked import suite_runs

MACHINES = ("xy", "xyz", "xyzr", "stage")
AXES = [
    (name, axis) for name, axes in zip(MACHINES, ("xy", "xyz", "xyzr", ("th", "x", "y")), strict=True) for axis in axes
]
THEORY = 1e-9  # relative
# maxon RE 40, 24 V, order number 148867, and RE 25, 118752: K [N·m/A], R [ohm], L [H], J [kg·m²], the drive's peak [A]
RE_40 = {"K": 0.0302, "R": 0.299, "L": 0.0823e-3, "J": 1.42e-5, "peak": 30.0}
RE_25 = {"K": 0.0234, "R": 2.32, "L": 0.24e-3, "J": 1.03e-6, "peak": 4.0}
BUS = 24.0  # [V]
SI = {"mm": 1e-3, "deg": math.radians(1)}
# Energy balance of a job, relative to the electrical energy: what the physics step of 0.25 ms leaves.
BALANCE = 1.2e-2


def motor(axis):
    return RE_25 if axis == "r" else RE_40


def frictionless(name):
    """The machine without LuGre, the axes' viscous damping and hard stops."""
    machine = Machine(name)
    model = machine.model
    model.dof_damping[axis_dofs(machine)] = 0
    model.actuator_damping[:] = 0
    model.actuator_dynprm[:, 6] = 0  # LuGre damping
    model.actuator_biasprm[:, 3:5] = 1e-15  # Coulomb and static friction
    model.jnt_limited[:] = 0
    return model


def axis_dofs(machine):
    return [int(machine.model.joint(name).dofadr[0]) for name in machine.axis_names]


@pytest.mark.validates(
    "no-load speed",
    "motor theory",
    "1e-9 relative",
)
@pytest.mark.parametrize(("name", "axis"), suite_runs(AXES, 0, 4, 8, 9))
def test_no_load_speed_is_the_bus_voltage_over_the_motor_constant(name, axis):
    machine, model = Machine(name), frictionless(name)
    data = mujoco.MjData(model)
    a = machine.axis_names.index(axis)
    moving = [int(model.joint(joint).dofadr[0]) for joint in (axis, f"{axis}_flex")]
    model.dof_damping[np.setdiff1d(np.arange(model.nv), moving)] = 1e12  # the others are held
    data.ctrl[a] = 1e6  # more torque than there is: the bus voltage rules
    mujoco.mj_step(model, data, 25_000)
    speed = BUS / motor(axis)["K"] / model.actuator_gear[a, 0]
    assert data.qvel[axis_dofs(machine)[a]] == pytest.approx(speed, rel=THEORY)
    assert machine.axes[a].no_load_speed == pytest.approx(speed / SI[machine.axes[a].unit], rel=1e-12)
    assert machine.axes[a].speed_limit <= machine.axes[a].no_load_speed


@pytest.mark.validates(
    "stall force",
    "motor theory",
    "1e-9 relative",
)
@pytest.mark.parametrize("name", MACHINES)
def test_stall_force_is_peak_torque_through_the_gear(name):
    machine, model = Machine(name), frictionless(name)
    data = mujoco.MjData(model)
    data.ctrl[:] = 1e6
    for _ in range(200):  # the winding's current settles while the axes are held
        data.qpos[:], data.qvel[:] = 0, 0
        mujoco.mj_step(model, data)
    data.qpos[:], data.qvel[:] = 0, 0
    mujoco.mj_forward(model, data)
    for axis, dof, gear in zip(machine.axes, axis_dofs(machine), model.actuator_gear[:, 0], strict=True):
        stall = motor(axis.name)["K"] * min(BUS / motor(axis.name)["R"], motor(axis.name)["peak"])
        assert data.qfrc_actuator[dof] == pytest.approx(stall * gear, rel=THEORY)
        assert axis.peak_torque == pytest.approx(stall, rel=1e-12)


def below(model, body):
    """A body and those that it carries."""
    carried = [body]
    for other in range(body + 1, model.nbody):
        if model.body_parentid[other] in carried:
            carried.append(other)
    return carried


def about_the_origin(model, data, bodies):
    """Moment of inertia of bodies about the vertical through the origin of the work frame at rest [kg·m²]."""
    total = 0.0
    for body in bodies:
        axes = data.ximat[body].reshape(3, 3)
        own = axes @ np.diag(model.body_inertia[body]) @ axes.T
        total += own[2, 2] + model.body_mass[body] * (data.xipos[body, :2] @ data.xipos[body, :2])
    return total


@pytest.mark.parametrize("name", MACHINES)
def test_reflected_inertia_is_what_the_axis_carries_and_the_rotor_through_the_gear(name):
    machine = Machine(name)
    model, data = machine.model, mujoco.MjData(machine.model)
    mujoco.mj_forward(model, data)
    matrix = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, matrix)
    for i, (axis, dof) in enumerate(zip(machine.axes, axis_dofs(machine), strict=True)):
        gear = model.actuator_gear[i, 0]
        bodies = below(model, int(model.dof_bodyid[dof]))
        carried = model.body_mass[bodies].sum() if axis.unit == "mm" else about_the_origin(model, data, bodies)
        rotating = model.actuator_armature[i]
        assert rotating > motor(axis.name)["J"]  # the rotor, and a screw and a coupling with it
        assert matrix[dof, dof] == pytest.approx(carried + rotating * gear**2, rel=THEORY)
        assert axis.inertia == pytest.approx((rotating + carried / gear**2) / axis.scale, rel=THEORY)


@pytest.mark.parametrize("name", MACHINES)
def test_the_motor_is_the_one_of_the_datasheet(name):
    for axis in Machine(name).axes:
        data = motor(axis.name)
        assert axis.motor_constant == pytest.approx(data["K"])
        assert axis.resistance == pytest.approx(data["R"])
        assert axis.lag == pytest.approx(data["L"] / data["R"])
        assert axis.bus_voltage == BUS
        assert axis.peak_torque == pytest.approx(data["peak"] * data["K"])


@pytest.mark.parametrize("name", MACHINES)
def test_declared_speed_can_be_reached_with_friction_within_the_bus_voltage(name):
    for axis in Machine(name).axes:
        torque = axis.coulomb + axis.viscous * axis.speed_limit
        data = motor(axis.name)
        voltage = data["R"] * torque / data["K"] + data["K"] * axis.speed_limit / axis.scale
        assert voltage < 0.95 * BUS


@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.parametrize("hold", suite_runs([1, 20, 400], 0))
def test_quasi_random_control_raises_no_warning(name, hold):
    machine = Machine(name)
    model, data = machine.model, mujoco.MjData(machine.model)
    peak = [axis.peak_torque for axis in machine.axes]
    count = 8192 if hold == 1 else 256
    for demand in qmc.Sobol(model.nu, seed=1).random(count) * 2 - 1:
        data.ctrl[:] = demand * peak
        mujoco.mj_step(model, data, hold)
    assert [int(warning.number) for warning in data.warning] == [0] * len(data.warning)
    assert np.isfinite(data.qpos).all()
    assert np.isfinite(data.qvel).all()


@pytest.mark.parametrize("name", MACHINES)
def test_a_machine_at_rest_stays_at_rest(name):
    machine = Machine(name)
    servo = Servo.derive(machine.axes)
    run = simulate(machine, servo, MoveSpiral(60, 1, 10, 100).setpoints(1e-3).hold(1.0))
    resting = run.time > run.time[-1] - 0.3
    assert np.ptp(run.nozzle[resting], axis=0).max() < 2e-4  # below a micrometre: friction holds it


@pytest.mark.parametrize("name", MACHINES)
def test_static_friction_holds_and_breaks_away(name):
    machine = Machine(name)
    model = machine.model
    static = model.actuator_biasprm[:, 4]
    bristles = static / model.actuator_dynprm[:, 5] / model.actuator_gear[:, 0]  # their deflection at the axis
    for share, moves in ((0.9, False), (1.1, True)):
        data = mujoco.MjData(model)
        data.ctrl[:] = share * static
        mujoco.mj_step(model, data, 4000)
        travelled = np.abs(data.qpos[axis_dofs(machine)])
        assert (travelled > 1000 * bristles).all() == moves
        assert moves or (travelled < 10 * bristles).all()


def to_and_fro(distances, duration):
    """All axes at once from zero to a distance and back [mm or deg]."""
    there = smooth(0.5 * duration)
    motion = np.concatenate([there, there[-2::-1]])
    position = motion[:, None] * np.array(list(distances.values()))
    return Setpoints(1e-3, tuple(distances), position, np.ones(len(motion), bool), MoveSpiral(60, 1, 10, 100).requested)


def energies(machine, setpoints, step):
    """Energy put in, taken out and stored over a job, stepped one by one [J]."""
    servo = Servo.derive(machine.axes)
    demand = simulate(machine, servo, setpoints, physics_step=step).demand
    model = machine.stepping(step)
    data = mujoco.MjData(model)
    rows = []
    currents = [address.current for address in machine.addresses]
    bristles = [address.current - 1 for address in machine.addresses]
    constant, resistance, inductance = (np.array([motor(name)[key] for name in machine.axis_names]) for key in "KRL")
    damping = model.dof_damping
    spring = model.jnt_stiffness[model.dof_jntid]
    gear, dofs = model.actuator_gear[:, 0], axis_dofs(machine)
    matrix = np.zeros((model.nv, model.nv))
    stiffness, micro = model.actuator_dynprm[:, 5], model.actuator_dynprm[:, 6]
    for torque in demand[:-1]:
        data.ctrl[:] = torque
        for _ in range(round(1e-3 / step)):
            mujoco.mj_forward(model, data)
            mujoco.mj_fullM(model, data, matrix)
            v, speed, i = data.qvel.copy(), data.qvel[dofs] * gear, data.act[currents].copy()
            z, z_dot = data.act[bristles].copy(), data.act_dot[bristles].copy()
            voltage = np.clip(resistance / constant * torque + constant * speed, -BUS, BUS)
            rows.append(
                [
                    voltage @ i,  # electrical power in
                    resistance @ i**2,  # copper loss
                    (stiffness * z + micro * z_dot) @ speed,  # into the bristles of the friction
                    damping @ v**2 + model.actuator_damping @ speed**2,  # viscous, in guides, shafts and structure
                    0.5 * inductance @ i**2 + 0.5 * v @ matrix @ v + 0.5 * spring @ data.qpos**2,  # stored
                ]
            )
            mujoco.mj_step(model, data)
    table = np.array(rows)
    spent = np.trapezoid(table[:, :4], dx=step, axis=0)
    return spent, table[-1, 4] - table[0, 4]


JOBS = {
    "xyz": lambda: MoveSpiral(60, 2, 10, 200).setpoints(1e-3),
    "xyzr": lambda: to_and_fro({"x": 40.0, "y": -30.0, "r": 300.0}, 1.0),
    "stage": lambda: to_and_fro({"th": 120.0, "x": 180.0, "y": -150.0}, 1.5),
}


@pytest.mark.validates(
    "electrical energy over a motion",
    "work and losses",
    "1.2 %",
)
@pytest.mark.parametrize("name", suite_runs(list(JOBS), 0))
def test_electrical_energy_is_mechanical_work_and_losses(name):
    machine, setpoints, gaps = Machine(name), JOBS[name](), []
    for step in (2.5e-4, 1.25e-4):
        (electrical, copper, friction, viscous), stored = energies(machine, setpoints, step)
        assert electrical > 1.0
        assert min(copper, friction, viscous) > 0
        gaps.append(abs(electrical - copper - friction - viscous - stored) / electrical)
    assert gaps[0] < BALANCE
    assert gaps[1] < 0.75 * gaps[0]  # and it is the step's: a smaller one leaves less


def test_structural_modes_are_those_of_screws_and_of_a_worm():
    lowest = {"stage": (60, 90)}  # about its table
    for name in MACHINES:
        machine = Machine(name)
        model, data = machine.model, mujoco.MjData(machine.model)
        mujoco.mj_forward(model, data)
        matrix = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, matrix)
        spring = model.jnt_stiffness[model.dof_jntid]
        flexible = np.flatnonzero(spring)
        assert len(flexible) == len(machine.axes)
        squared = np.linalg.eigvals(np.linalg.solve(matrix[np.ix_(flexible, flexible)], np.diag(spring[flexible])))
        frequencies = np.sqrt(squared.real) / (2 * math.pi)
        low, high = lowest.get(name, (100, 400))
        assert low < frequencies.min() < high
        assert frequencies.max() * 2 * math.pi * model.opt.timestep < 1.5  # resolved by the physics step


def test_every_name_the_engine_needs_and_no_collision():
    for name in builtin_models():
        machine = Machine(name)
        model = machine.model
        for camera in ("overview", "top", "nozzle", "side"):
            assert mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, camera) >= 0
        assert not model.geom_contype.any()
        assert not model.geom_conaffinity.any()
        assert model.nuser_jnt == model.nuser_sensor == 1


def test_mjcf_files_parse_and_name_their_motor():
    folder = files("gantrysim.models")
    for name in builtin_models():
        root = ET.fromstring((folder / f"{name}.xml").read_text(encoding="utf-8"))
        assert root.tag == "mujoco"
    sources = (folder / "README.md").read_text(encoding="utf-8")
    assert "148867" in sources
    assert "118752" in sources
