"""Machines from tables against closed forms: speed, force, inertia, energy, modes, maps, and a spiral on each."""

import math
import re
import runpy
import tomllib

import mujoco
import numpy as np
import pytest
from scipy.linalg import eigh

from gantrysim import InputError, Job, Machine
from gantrysim.machine.design.build import mjcf_in, modes
from gantrysim.machine.design.library import motor_of
from gantrysim.machine.design.table import read_table
from gantrysim.machine.ideal import without_compliance

from support.soaked import suite_runs
from support.tables import BELT, EXAMPLES, IDEAL, LIBRARY, RACK, SCREW, example, ideal

NAMES = sorted(file.stem for file in EXAMPLES.glob("*.toml"))
K, OHM, VOLT, AMPERE = 0.05, 0.5, 24.0, 20.0  # of the ideal motor
# travel per turn of the motor [m] and inertia that turns with the rotor [kg·m²]
WAYS = {
    SCREW: (0.020, math.pi * 7850 * 0.6 * 0.016**4 / 32),
    BELT: (25 * 0.003 / 4, 3.2e-5 / 16),
    RACK: (math.pi * 24e-3 / math.cos(math.radians(20)) / 5, 5e-5 / 25),
}


@pytest.fixture(scope="module")
def machines():
    return {name: Machine(EXAMPLES / f"{name}.toml") for name in NAMES}


def built(tmp_path, text):
    file = tmp_path / "machine.toml"
    file.write_text(text)
    return Machine(file)


def locked(machine):
    return [int(dof) for dof in machine.physics.jnt_dofadr[machine.physics.actuator_trnid[:, 0]]]


def hertz(stiffness, mass):
    return np.sqrt(eigh(np.atleast_2d(stiffness), np.atleast_2d(mass), eigvals_only=True)) / (2 * np.pi)


def test_the_examples_cover_every_arrangement():
    assert {example(name)["arrangement"] for name in NAMES} == {"bridge", "cantilever", "corexy", "table", "tandem"}


@pytest.mark.parametrize("way", WAYS)
def test_inertia_speed_and_force_follow_from_the_table(tmp_path, way):
    machine = built(tmp_path, ideal(way))
    axis, (turn, turning) = machine.axes[0], WAYS[way]
    armature = 2e-5 + turning
    # J = J_motor + m (travel per turn / 2 pi)^2
    reflected = armature + (1.0 + 0.25) * (turn / (2 * math.pi)) ** 2
    assert axis.inertia * axis.scale == pytest.approx(reflected, rel=1e-9)
    assert axis.no_load_speed == pytest.approx(1e3 * VOLT / K * turn / (2 * math.pi), rel=1e-12)
    assert axis.peak_torque == pytest.approx(K * AMPERE, rel=1e-12)
    assert axis.resolution == pytest.approx(1e3 * turn / 10000, rel=1e-12)
    # the force of a held motor, and the speed of a free one, as MuJoCo has them
    model = machine.stepping(2.5e-4)
    model.dof_armature[model.jnt_dofadr[model.joint("x").id]] = 1e12
    data = mujoco.MjData(model)
    data.ctrl[machine.addresses[0].control] = 1.0
    mujoco.mj_step(model, data, 10)
    assert data.qfrc_actuator[model.joint("x").dofadr[0]] == pytest.approx(K * AMPERE * 2 * math.pi / turn, rel=1e-6)


@pytest.mark.parametrize("way", WAYS)
def test_a_free_axis_runs_up_to_its_no_load_speed_with_the_motor_s_time_constant(tmp_path, way):
    """J dw/dt = K (V - K w) / R once the current is below its limit; a rigid axis does not swing on its way."""
    machine = without_compliance(built(tmp_path, ideal(way)))
    turn, turning = WAYS[way]
    inertia = 2e-5 + turning + 1.25 * (turn / (2 * math.pi)) ** 2
    model, dof = machine.stepping(5e-5), int(machine.physics.joint("x").dofadr[0])
    data = mujoco.MjData(model)
    data.ctrl[machine.addresses[0].control] = 1.0
    limited = inertia * (VOLT - OHM * AMPERE) / K / (K * AMPERE)  # until the bus limits the current
    constant = inertia * OHM / K**2
    mujoco.mj_step(model, data, round((limited + constant) / 5e-5))
    speed = data.qvel[dof] * 2 * math.pi / turn
    final, at_limit = VOLT / K, (VOLT - OHM * AMPERE) / K
    assert speed == pytest.approx(final - (final - at_limit) * math.exp(-1), rel=5e-3)
    mujoco.mj_step(model, data, round(9 * constant / 5e-5))
    assert 1e3 * data.qvel[dof] == pytest.approx(machine.axes[0].no_load_speed, rel=1e-3)


def test_the_motor_s_work_is_kinetic_and_spring_energy(tmp_path):
    machine = built(tmp_path, ideal())
    model = machine.stepping(1e-5)
    data, mass = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    dof = int(model.joint("x").dofadr[0])
    data.ctrl[machine.addresses[0].control] = 0.8
    work = 0.0
    for _ in range(3000):
        before = data.qvel[dof]
        mujoco.mj_step(model, data)
        work += data.qfrc_actuator[dof] * 0.5 * (before + data.qvel[dof]) * 1e-5
    mujoco.mj_fullM(model, data, mass)
    spring = 0.5 * 10e6 * data.qpos[model.joint("x_flex").qposadr[0]] ** 2
    kinetic = 0.5 * data.qvel @ mass @ data.qvel
    assert work > 1
    assert kinetic + spring == pytest.approx(work, rel=1e-3)


def carriage_mass(table):
    mass = table["masses"]["carriage"]
    if "z" in table:
        mass += LIBRARY[table["z"]["drive"]["motor"]]["mass"] + 0.15 + table["masses"]["ram"]
    return mass


def motor_mass(drive):
    """Mass that rotor and transmission are at the slide: J (2 pi / travel per turn)^2 [kg]."""
    way, rotor = drive["transmission"], LIBRARY[drive["motor"]]["rotor_inertia"]
    if way["kind"] == "belt":
        turn, turning = way["teeth"] * way["pitch"] / way["ratio"], way["inertia"] / way["ratio"] ** 2
    else:
        turn = way["lead"]
        turning = math.pi * 7850 * 1e-3 * way["length"] * (1e-3 * way["diameter"]) ** 4 / 32
    return (rotor + turning) * (2e3 * math.pi / turn) ** 2


@pytest.mark.validates(
    "modes of a machine from a table",
    "matrices set up by hand",
    "1e-5 relative",
)
@pytest.mark.parametrize("name", ["belt-gantry", "stepper"])
def test_modes_of_axes_in_series(machines, name):
    """sqrt(k / m2) with the motor locked, sqrt(k (1/m1 + 1/m2)) with it free."""
    machine, table = machines[name], example(name)
    on_x = carriage_mass(table)
    loads = {"x": on_x}
    if name == "stepper":
        loads |= {"y": table["masses"]["table"], "z": table["masses"]["ram"]}
    else:
        loads["y"] = table["masses"]["bridge"] + LIBRARY[table["x"]["drive"]["motor"]]["mass"] + 0.15 + on_x
    k = {axis: 1e6 * table[axis]["drive"]["transmission"]["stiffness"] for axis in loads}
    model = machine.physics
    own = {a: 0.15 + motor_mass(table[a]["drive"]) for a in loads}
    for held, mass in (
        (locked(machine), loads),
        ((), {a: 1 / (1 / own[a] + 1 / loads[a]) for a in loads}),
    ):
        expected = sorted(math.sqrt(k[a] / mass[a]) / (2 * math.pi) for a in loads)
        np.testing.assert_allclose(modes(model, locked=held)[0], expected, rtol=1e-5)


def test_modes_of_a_cantilever(machines):
    """Slide of the arm, its yaw about the guide, and slide of the carriage along it."""
    machine, table = machines["cantilever"], example("cantilever")
    wide, arm, nut, carriage = 0.25, 3.0 + LIBRARY["maxon-re30-48"]["mass"], 0.15, 0.9
    # of the carriage's nut and carriage from the yaw axis: along the arm, and across it
    parts = [(nut, wide, 0.085 - 0.125), (carriage, wide, 0.055 - 0.125)]
    mass = np.zeros((3, 3))  # y, yaw, x of the carriage
    mass[0, 0] = 1e-3 + arm + nut + carriage
    mass[0, 1] = mass[1, 0] = arm * wide + sum(m * along for m, along, _ in parts)
    mass[1, 1] = arm * (wide**2 + (2 * wide) ** 2 / 12) + sum(m * (a**2 + c**2 + 0.04**2) for m, a, c in parts)
    mass[2, 2] = carriage
    mass[1, 2] = mass[2, 1] = -carriage * parts[1][2]
    stiffness = np.diag([8e6, table["arm_stiffness"], 10e6])
    np.testing.assert_allclose(modes(machine.physics, locked=locked(machine))[0], hertz(stiffness, mass), rtol=1e-5)


def test_the_arm_of_a_cantilever_yaws_at_three_hundredths_of_critical_damping(machines):
    """The hinge's damping is 2 zeta sqrt(k I) for the arm about its end and the carriage in its middle."""
    machine, stiffness = machines["cantilever"], example("cantilever")["arm_stiffness"]
    yaw = machine.physics.joint("yaw")
    nominal = 3.0 * 0.5**2 / 3 + 0.9 * 0.25**2
    assert yaw.damping[0] == pytest.approx(2 * 0.03 * math.sqrt(stiffness * nominal), rel=1e-6)
    # with the motor and the nut on the arm as well, which the assumption leaves out
    arm = 3.0 + LIBRARY["maxon-re30-48"]["mass"]
    whole = arm * (0.25**2 + 0.5**2 / 12) + (0.15 + 0.9) * 0.25**2
    assert yaw.damping[0] / (2 * math.sqrt(stiffness * whole)) == pytest.approx(0.03, rel=0.05)


@pytest.mark.parametrize("name", NAMES)
def test_what_moves_along_y_stands_on_the_rails_that_are_drawn(machines, name):
    """Two rails along y on the frame; every block that slides above them rests on one, and one at least is used."""
    machine = machines[name]
    model, data = machine.model, mujoco.MjData(machine.model)
    mujoco.mj_forward(model, data)
    before = data.geom_xpos.copy()
    place = np.zeros((1, len(machine.kinematics.names)))
    place[0, machine.kinematics.names.index("y")] = 20.0
    data.qpos[:] = machine.to_qpos(machine.kinematics.inverse(place)[0])
    mujoco.mj_forward(model, data)
    moves = np.abs(data.geom_xpos - before)[:, 1] > 1e-3
    half = np.array([np.abs(data.geom_xmat[g].reshape(3, 3)) @ model.geom_size[g] for g in range(model.ngeom)])
    low = data.geom_xpos[:, 2] < data.site("nozzle").xpos[2]
    boxes = (model.geom_type == int(mujoco.mjtGeom.mjGEOM_BOX)) & low
    rails = np.flatnonzero(boxes & ~moves & (half[:, 1] > 0.15) & (half[:, 0] < 0.01) & (half[:, 2] < 0.006))
    blocks = np.flatnonzero(boxes & moves & (half[:, 1] < 0.07) & (half[:, 0] < 0.03) & (half[:, 0] > 0.015))
    assert len(rails) == 2

    def carries(rail, block):
        away = data.geom_xpos[block] - data.geom_xpos[rail]
        return abs(away[0]) < 1e-6 and 0 < away[2] <= half[rail, 2] + half[block, 2] + 1e-6

    sliding = blocks[np.abs(data.geom_xpos[blocks, 0]) > 0.1]  # but the nut of the screw between them
    assert len(sliding) >= 2
    assert all(any(carries(rail, block) for rail in rails) for block in sliding)


def test_modes_of_corexy(machines):
    """Both belts pull each slide with 2 k; the motors weigh 2 J / r^2 on it."""
    machine, k, radius = machines["corexy"], 0.25e6, 0.02 / math.pi
    on_x, on_y = 0.8, 0.8 + 0.9
    inertia = LIBRARY["maxon-ec45flat-24"]["rotor_inertia"] + 2e-6
    held = sorted(math.sqrt(2 * k / m) / (2 * math.pi) for m in (on_x, on_y))
    np.testing.assert_allclose(modes(machine.physics, locked=locked(machine))[0], held, rtol=1e-6)
    motors = 2 * (inertia + 1e-9) / radius**2
    free = sorted(math.sqrt(2 * k * (1 / m + 1 / motors)) / (2 * math.pi) for m in (on_x, on_y))
    np.testing.assert_allclose(modes(machine.physics)[0], free, rtol=1e-5)


def test_modes_of_a_tandem_bridge(machines):
    """Slide of the bridge on both mounts; skew on mounts and guides with the carriage's slide along it."""
    machine, table = machines["tandem"], example("tandem")
    arm, nut, carriage, k, span = 4.5 + LIBRARY["maxon-re40-24"]["mass"], 0.15, 1.2, 13.5e6, 0.52
    parts = [(nut, 0.085 - 0.125), (carriage, 0.055 - 0.125)]
    mass = np.diag([arm + nut + carriage, arm * 0.52**2 / 12 + sum(m * (c**2 + 0.04**2) for m, c in parts), carriage])
    mass[1, 2] = mass[2, 1] = -carriage * parts[1][1]
    stiffness = np.diag([2 * k, 2 * k * (span / 2) ** 2 + table["skew_stiffness"], 13e6])
    np.testing.assert_allclose(modes(machine.physics, locked=locked(machine))[0], hertz(stiffness, mass), rtol=1e-5)
    # by the bridge's own inertia as a rod of its length, with the damping ratio of guides
    inertia = arm * 0.52**2 / 12
    damping = 2 * 0.03 * math.sqrt(table["skew_stiffness"] * inertia)
    skew = machine.physics.joint("skew").dofadr[0]
    assert machine.physics.dof_damping[skew] == pytest.approx(damping, rel=1e-6)


def test_motors_of_corexy_and_tandem_share_the_coordinates(machines):
    radius = 40 / (2 * math.pi)
    at = np.array([[30.0, -70.0]])
    belts, bridge = machines["corexy"], machines["tandem"]
    assert belts.axis_names == ("a", "b")
    assert bridge.axis_names == ("x", "y1", "y2")
    np.testing.assert_allclose(belts.kinematics.inverse(at), np.degrees([[-40 / radius, 100 / radius]]), rtol=1e-9)
    np.testing.assert_allclose(bridge.kinematics.inverse(at), [[30, -70, -70]], rtol=1e-9)
    skew = -1.0 / 520  # the left drive is ahead; the nozzle is 125 mm in front of the axis of skew
    ahead = bridge.tip(np.array([[30.0, 0.5, -0.5]]))[0]
    np.testing.assert_allclose(
        ahead[:2], [30 * math.cos(skew) + 125 * math.sin(skew), 125 + 30 * math.sin(skew) - 125 * math.cos(skew)]
    )
    for machine in machines.values():
        axes = machine.kinematics.inverse(np.array([[30.0, -70.0, 0.0][: len(machine.kinematics.names)]]))
        np.testing.assert_allclose(machine.tip(axes)[0], [30, -70, 0], atol=1e-9)
        assert machine.gap == pytest.approx(0.5)


def test_a_corexy_motor_carries_a_quarter_of_each_slide(machines):
    axis, radius = machines["corexy"].axes[0], 0.02 / math.pi
    own = LIBRARY["maxon-ec45flat-24"]["rotor_inertia"] + 2e-6 + 1e-9
    assert axis.inertia * axis.scale == pytest.approx(own + (0.8 + 1.7) / 4 * radius**2, rel=1e-5)


def test_friction_lag_and_speed_of_a_drive(machines):
    """The y axis of the belt gantry and the motors of CoreXY by hand; half of the no-load torque is dry friction."""
    machine = machines["belt-gantry"]
    axis, motor = machine.axes[1], LIBRARY["maxon-re40-48"]
    gear = 4 * 2 * math.pi / 0.072
    assert axis.coulomb == pytest.approx(0.5 * 0.0603 * 0.0686 + 0.006 + 3 / 0.97 / gear, rel=1e-9)
    no_load = (48 - 1.13 * 0.0686) / 0.0603
    assert axis.viscous * axis.scale == pytest.approx(0.5 * 0.0603 * 0.0686 / no_load + 12 / 0.97 / gear**2, rel=1e-9)
    assert axis.lag == pytest.approx(1 / (2 * math.pi * 1000))  # L/R is 0.29 ms
    assert motor["inductance"] / motor["resistance"] > axis.lag
    assert axis.speed_limit == pytest.approx(0.8 * 1e3 * 48 / 0.0603 / gear, rel=1e-9)
    flex = machine.physics.joint("y_flex")
    load = 2.4 + LIBRARY["maxon-re30-48"]["mass"] + 0.15 + 0.9
    assert flex.damping[0] == pytest.approx(2 * 0.03 * math.sqrt(1.2e6 * load), rel=1e-9)
    # bristles: 80 Hz or a presliding of 5 um, whichever is softer
    inertia = axis.inertia * axis.scale
    stiffness, damping = machine.physics.actuator_dynprm[1, [5, 6]]
    assert stiffness == pytest.approx(
        min(1.2 * axis.coulomb / 5e-6 / gear, inertia * (2 * math.pi * 80) ** 2), rel=1e-6
    )
    assert damping == pytest.approx(0.6 * math.sqrt(stiffness * inertia), rel=1e-6)
    static, stribeck = machine.physics.actuator_biasprm[1, [4, 5]]
    assert (static, stribeck) == pytest.approx((1.2 * axis.coulomb, 5e-3 * gear), rel=1e-9)
    belts = machines["corexy"]
    one = belts.axes[0]
    stiffness, damping = belts.physics.actuator_dynprm[0, [5, 6]]
    assert damping == pytest.approx(0.6 * math.sqrt(stiffness * one.inertia * one.scale), rel=1e-3)
    assert [belts.physics.joint(name).frictionloss[0] for name in "xy"] == [1.5, 2.5]
    assert belts.axes[0].speed_limit == pytest.approx(math.degrees(2 * 0.8 / (0.02 / math.pi)))
    stepper = machines["stepper"].axes[0]
    keli = motor_of("keli-bj42d41-14v19")
    left = keli.torque_at(stepper.speed_limit / stepper.scale, 36, keli.current)
    assert left >= 0.5 * 0.65 - 1e-6
    assert machines["stepper"].physics.actuator_biasprm[0, :2] == pytest.approx([0.025, 200])  # detent
    tandem = machines["tandem"]
    bridge = 0.5 * 0.0302 * 0.137 + 0.012 + 2 / 0.9 / (2 * math.pi / 0.01)  # each side bears half of the guides
    assert [axis.coulomb for axis in tandem.axes[1:]] == pytest.approx([bridge, bridge], rel=1e-9)


def test_power_in_is_copper_loss_friction_and_kinetic_energy(machines):
    """Of a motor that runs up on the belt gantry: K i w against inertia, both frictions, springs and their damping."""
    machine = machines["belt-gantry"]
    model = machine.stepping(1e-5)
    data, mass = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    dof, current = int(model.joint("y").dofadr[0]), machine.addresses[1].current
    gear, prm = float(model.actuator_gear[1, 0]), model.actuator_gainprm[1]
    data.ctrl[machine.addresses[1].control] = 0.4
    electric = copper = mechanical = viscous = 0.0
    for _ in range(8000):
        before, was = data.qvel.copy(), data.act[current]
        mujoco.mj_step(model, data)
        i, v = 0.5 * (was + data.act[current]), 0.5 * (before + data.qvel)
        electric += (prm[0] * i + prm[1] * gear * v[dof]) * i * 1e-5
        copper += prm[0] * i**2 * 1e-5
        mechanical += prm[1] * i * gear * v[dof] * 1e-5
        viscous += float(model.dof_damping @ v**2) * 1e-5
    mujoco.mj_fullM(model, data, mass)
    kinetic = 0.5 * data.qvel @ mass @ data.qvel
    spring = 0.5 * float(model.jnt_stiffness @ data.qpos**2)
    shaft = float(model.actuator_damping[1]) * gear**2 * (viscous / model.dof_damping[dof])
    axis = machine.axes[1]
    dry = axis.coulomb * gear * data.qpos[dof]
    assert kinetic > 1
    assert electric == pytest.approx(copper + kinetic + spring + viscous + shaft + dry, rel=5e-3)


@pytest.mark.parametrize("name", suite_runs(NAMES, 0, 2))
def test_the_spiral_runs_on_each(name):
    job = Job.load("an225", ["turns=1"], machine=str(EXAMPLES / f"{name}.toml"))
    run = job.run()
    assert run.fault is None
    assert np.abs(run.nozzle - run.commanded_tip).max() < 0.3
    assert min(min(one.gain, one.together) for one in job.margins) >= 1.99
    # faster modes turn by at most one radian in a physics step
    fastest = modes(job.built_machine.physics)[0][-1]
    assert 2 * math.pi * fastest * job.built_machine.physics.opt.timestep <= 1


def test_a_stiffer_belt_brings_the_nozzle_nearer_to_its_motors(machines):
    """Without compliance the nozzle is where the motors are."""
    rigid = without_compliance(machines["corexy"])
    run = Job.load("an225", ["turns=1"], machine=str(EXAMPLES / "corexy.toml")).run(machine=rigid)
    assert np.abs(run.nozzle - run.motor_tip).max() < 2e-3


def test_the_written_mjcf_is_the_machine_of_the_table(tmp_path, machines):
    for name, machine in machines.items():
        file = tmp_path / f"{name}.xml"
        file.write_text(mjcf_in(EXAMPLES / f"{name}.toml"), encoding="utf-8")
        again = Machine(file)
        assert again.digest == machine.digest
        cameras = {again.model.camera(k).name for k in range(again.model.ncam)}
        assert {"overview", "top", "side", "nozzle"} <= cameras
        assert again.needle == pytest.approx((0.82, 25.4))


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ('arrangement = "bridge"', 'arrangement = "gantry"', "arrangement = 'gantry'"),
        ("bridge = 2.0, ", "", "masses.bridge is missing, arrangement = 'bridge' needs it"),
        ("bridge = 2.0", "bridge = 2.0, table = 3.0", "masses.table: arrangement = 'bridge' has none, leave it out"),
        ("bridge = 2.0", "bridge = -2.0", "masses.bridge = -2.0: .*greater than 0"),
        ("travel = [-150, 150]", "travel = [10, 150]", r"travel = \[10, 150\] mm: must include 0"),
        ('motor = "maxon-re40-24"', 'motor = "maxon-re99"', "unknown motor 'maxon-re99'"),
        ("encoder = 10000\nvoltage = 24\nnut", "encoder = 'none'\nvoltage = 24\nnut", "unknown encoder 'none'"),
        ("lead = 10, inertia = 7e-6", "lead = 10", "a screw needs its inertia, or diameter and length"),
        ("lead = 10", 'lead = 10, accuracy = "C4"', "accuracy = 'C4': must be one of C0, C1"),
        ('kind = "screw", lead', 'kind = "chain", lead', "transmission"),
        ("speed = 9000", "sped = 9000", "unknown key x.sped"),
        ("nut_mass = 0.25", 'mode = "stepper"', "mode = 'stepper': a brushed motor runs in a closed loop; use torque"),
        ("nut_mass = 0.25", "microsteps = 16", "microsteps: a brushed motor has none, leave it out"),
        ("encoder = 10000\n", "", "encoder is missing, a brushed motor needs it"),
        ('kind = "brushed"', 'kind = "stepper"', "holding_torque and rated_current of a stepper motor missing"),
        (
            'arrangement = "bridge"',
            'arrangement = "bridge"\nskew_stiffness = 3',
            "skew_stiffness: arrangement = 'bridge' has",
        ),
        ('arrangement = "bridge"', 'arrangement = "bridge"\nspan = 3', "span: arrangement = 'bridge' has none"),
        ('arrangement = "bridge"', 'arrangement = "tandem"', "span is missing, arrangement = 'tandem' needs it"),
        ("lead = 20", "lead = 1e-300", "one is far too large or too small"),
        ("lead = 20", "lead = true", "x.drive.transmission.*lead = true: must not be a boolean|lead = true"),
        ("peak_current = 20", "peak_current = 20\npole_pairs = -1", "pole_pairs = -1"),
        ("max_speed = 20000", "max_speed = nan", "max_speed = nan"),
        ("diameter = 16", "diameter = 1e300", "diameter = 1e.300: .*must be at most 1e.09"),
        ('arrangement = "bridge"', 'arrangement = "corexy"', "belts is missing, arrangement = 'corexy' needs it"),
    ],
)
def test_a_wrong_table_is_refused_in_one_line(tmp_path, old, new, text):
    assert old in ideal()
    file = tmp_path / "wrong.toml"
    file.write_text(ideal().replace(old, new, 1))
    with pytest.raises(InputError, match=text) as caught:
        Machine(file)
    assert "\n" not in str(caught.value)
    assert "wrong.toml" in str(caught.value)


def test_a_table_holds_every_key_of_the_page():
    """The table without friction is TOML by itself, so that the tests above change what they mean to."""
    assert tomllib.loads(ideal())["x"]["drive"]["transmission"]["lead"] == 20
    assert "TRANSMISSION" in IDEAL


def test_the_page_of_keys_is_that_of_the_code_and_its_table_is_a_machine(tmp_path):
    root = EXAMPLES.parent.parent
    page = runpy.run_path(str(root / "scripts" / "machine_keys_page.py"))["page"]
    assert page() == (root / "docs" / "machines.md").read_text(encoding="utf-8")
    text = (root / "docs" / "machines.md").read_text(encoding="utf-8")
    machine = built(tmp_path, re.search(r"```toml\n(.*?)```", text, re.S)[1])
    assert machine.axis_names == ("x", "y")


@pytest.mark.parametrize("name", NAMES)
def test_the_fastest_mode_turns_by_a_radian_in_a_physics_step_and_a_stepper_s_field_by_half_of_one(machines, name):
    """The step is the longest of 0.25 ms, 0.125 ms and so on that keeps it."""
    physics = machines[name].physics
    table = read_table(EXAMPLES / f"{name}.toml")
    slides = [slide for slide in (table.x, table.y, table.z) if slide is not None]
    fields = [slide.drive.field_rate for slide in slides if slide.drive is not None]
    fields += [] if table.belts is None else [table.belts.field_rate]
    assert any(fields) == (name == "stepper")
    fastest = max(2 * math.pi * modes(physics)[0].max(initial=0.0), *fields)
    step = physics.opt.timestep
    largest = 0.5 if any(fields) else 1.0
    assert fastest * step <= largest
    assert step == 2.5e-4 or fastest * 2 * step > largest
    assert math.log2(2.5e-4 / step).is_integer()
