"""The machines that come with gantrysim, against the theory of their drives."""

import math
import xml.etree.ElementTree as ET
from importlib.resources import files

import mujoco
import numpy as np
import pytest
from scipy.stats import qmc

from gantrysim import Machine, Servo, simulate
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.machine import builtin_models

MACHINES = ("xy", "xyz")
THEORY = 1e-9  # relative
# maxon RE 40, 24 V, order number 148867: K [N·m/A], R [ohm], L [H], J [kg·m²]
MOTOR = {"K": 0.0302, "R": 0.299, "L": 0.0823e-3, "J": 1.42e-5}
BUS = 24.0  # [V]
PEAK_CURRENT = 30.0  # [A]
# Energy balance of a job, relative to the electrical energy: what the physics step of 0.25 ms leaves.
BALANCE = 2e-3


def frictionless(name):
    """The machine without LuGre, viscous damping and hard stops."""
    model = Machine(name).model
    model.dof_damping[:] = 0
    model.actuator_damping[:] = 0
    model.actuator_dynprm[:, 6] = 0  # LuGre damping
    model.actuator_biasprm[:, 3:5] = 1e-15  # Coulomb and static friction
    model.jnt_limited[:] = 0
    return model


def axis_dofs(machine):
    return [int(machine.model.joint(name).dofadr[0]) for name in machine.axis_names]


@pytest.mark.parametrize("name", MACHINES)
def test_no_load_speed_is_the_bus_voltage_over_the_motor_constant(name):
    machine, model = Machine(name), frictionless(name)
    data = mujoco.MjData(model)
    data.ctrl[:] = 1e6  # more torque than there is: the bus voltage rules
    mujoco.mj_step(model, data, 100_000)
    for axis, dof, gear in zip(machine.axes, axis_dofs(machine), model.actuator_gear[:, 0], strict=True):
        assert data.qvel[dof] == pytest.approx(BUS / MOTOR["K"] / gear, rel=THEORY)
        assert axis.no_load_speed == pytest.approx(1e3 * BUS / MOTOR["K"] / gear, rel=1e-12)
        assert axis.speed_limit <= axis.no_load_speed


@pytest.mark.parametrize("name", MACHINES)
def test_stall_force_is_peak_torque_through_the_lead(name):
    machine, model = Machine(name), frictionless(name)
    data = mujoco.MjData(model)
    data.ctrl[:] = 1e6
    for _ in range(200):  # the winding's current settles while the axes are held
        data.qpos[:], data.qvel[:] = 0, 0
        mujoco.mj_step(model, data)
    data.qpos[:], data.qvel[:] = 0, 0
    mujoco.mj_forward(model, data)
    stall = MOTOR["K"] * min(BUS / MOTOR["R"], PEAK_CURRENT)
    for axis, dof, gear in zip(machine.axes, axis_dofs(machine), model.actuator_gear[:, 0], strict=True):
        assert data.qfrc_actuator[dof] == pytest.approx(stall * gear, rel=THEORY)
        assert axis.peak_torque == pytest.approx(stall, rel=1e-12)


@pytest.mark.parametrize("name", MACHINES)
def test_reflected_inertia_is_the_mass_and_the_rotor_through_the_lead(name):
    machine = Machine(name)
    model, data = machine.model, mujoco.MjData(machine.model)
    mujoco.mj_forward(model, data)
    matrix = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, matrix)
    for i, (axis, dof) in enumerate(zip(machine.axes, axis_dofs(machine), strict=True)):
        gear = model.actuator_gear[i, 0]
        carried = model.body_subtreemass[model.dof_bodyid[dof]]
        rotating = model.actuator_armature[i]
        assert rotating > MOTOR["J"]  # the rotor, and a screw and a coupling with it
        assert matrix[dof, dof] == pytest.approx(carried + rotating * gear**2, rel=THEORY)
        assert axis.inertia == pytest.approx((rotating + carried / gear**2) / axis.scale, rel=THEORY)


@pytest.mark.parametrize("name", MACHINES)
def test_the_motor_is_the_one_of_the_datasheet(name):
    for axis in Machine(name).axes:
        assert axis.motor_constant == pytest.approx(MOTOR["K"])
        assert axis.resistance == pytest.approx(MOTOR["R"])
        assert axis.lag == pytest.approx(MOTOR["L"] / MOTOR["R"])
        assert axis.bus_voltage == BUS
        assert axis.peak_torque == pytest.approx(PEAK_CURRENT * MOTOR["K"])


@pytest.mark.parametrize("name", MACHINES)
def test_declared_speed_can_be_reached_with_friction_within_the_bus_voltage(name):
    for axis in Machine(name).axes:
        torque = axis.coulomb + axis.viscous * axis.speed_limit
        voltage = MOTOR["R"] * torque / MOTOR["K"] + MOTOR["K"] * axis.speed_limit / axis.scale
        assert voltage < 0.95 * BUS


@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.parametrize("hold", [1, 20, 400])
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
    for share, moves in ((0.9, False), (1.1, True)):
        data = mujoco.MjData(model)
        data.ctrl[:] = share * static
        mujoco.mj_step(model, data, 4000)
        travelled = np.abs(data.qpos[axis_dofs(machine)])
        assert (travelled > 1e-3).all() == moves
        assert moves or (travelled < 5e-5).all()


def energies(step):
    """Energy put in, taken out and stored over two turns of a spiral on machine xyz, stepped one by one [J]."""
    machine = Machine("xyz")
    servo = Servo.derive(machine.axes)
    demand = simulate(machine, servo, MoveSpiral(60, 2, 10, 200).setpoints(1e-3), physics_step=step).demand
    model = machine.stepping(step)
    data = mujoco.MjData(model)
    rows = []
    currents = [address.current for address in machine.addresses]
    bristles = [address.current - 1 for address in machine.addresses]
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
            voltage = np.clip(MOTOR["R"] / MOTOR["K"] * torque + MOTOR["K"] * speed, -BUS, BUS)
            rows.append(
                [
                    voltage @ i,  # electrical power in
                    MOTOR["R"] * i @ i,  # copper loss
                    (stiffness * z + micro * z_dot) @ speed,  # into the bristles of the friction
                    damping @ v**2 + model.actuator_damping @ speed**2,  # viscous, in guides, shafts and structure
                    0.5 * MOTOR["L"] * i @ i + 0.5 * v @ matrix @ v + 0.5 * spring @ data.qpos**2,  # stored
                ]
            )
            mujoco.mj_step(model, data)
    table = np.array(rows)
    spent = np.trapezoid(table[:, :4], dx=step, axis=0)
    return spent, table[-1, 4] - table[0, 4]


def test_electrical_energy_is_mechanical_work_and_losses():
    gaps = []
    for step in (2.5e-4, 1.25e-4):
        (electrical, copper, friction, viscous), stored = energies(step)
        assert electrical > 1.0
        assert min(copper, friction, viscous) > 0
        gaps.append(abs(electrical - copper - friction - viscous - stored) / electrical)
    assert gaps[0] < BALANCE
    assert gaps[1] < 0.75 * gaps[0]  # and it is the step's: a smaller one leaves less


def test_structural_modes_are_those_of_a_ball_screw_gantry():
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
        assert 100 < frequencies.min() < 400
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
    assert "148867" in (folder / "README.md").read_text(encoding="utf-8")
