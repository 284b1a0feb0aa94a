"""Perturbed machines: every deviation has its effect, and no other."""

import copy
import math
import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace

import mujoco
import numpy as np
import pytest

import gantrysim as gs
from gantrysim import Machine, Servo, simulate
from gantrysim.base.errors import InputError
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.engine.simulation import Simulation
from gantrysim.machine.axis import read_axes
from gantrysim.machine.perturbation import VARIED_FACTORS, Perturbation

from support.runs import ideal_motors, plain, ramp

EXACT = 1e-12  # relative, of arrays
FRICTION = 2e-3  # relative, of the torque at a constant speed
DEFLECTION = 1e-6  # relative, of a spring at rest
GRAVITY = 9.81  # [m/s²]


def fields_that_differ(model, other):
    """Names of the arrays of a compiled model that differ from another's."""
    return {
        name
        for name in dir(model)
        if isinstance(getattr(model, name), np.ndarray)
        and not name.startswith("_")
        and not np.array_equal(getattr(model, name), getattr(other, name))
    }


def spiral_run(machine, servo):
    program = MoveSpiral(diameter=60, turns=1, thickness=10, speed=100)
    return simulate(machine, servo, program.setpoints(servo.period))


def test_an_empty_perturbation_changes_no_bit(xy):
    servo = Servo.derive(xy.axes)
    same = xy.perturbed(Perturbation())
    assert same.digest == xy.digest
    assert (same.axes, same.addresses, same.name, same.source) == (xy.axes, xy.addresses, xy.name, xy.source)
    assert same is not xy
    assert same.model is not xy.model
    run, again = spiral_run(xy, servo), spiral_run(same, servo)
    for name in ("encoder", "nozzle", "torque", "voltage", "motor"):
        assert np.array_equal(getattr(run, name), getattr(again, name))


@pytest.mark.parametrize(
    ("perturbation", "changed"),
    [
        (
            Perturbation(payload=0.5),
            # what MuJoCo derives of it besides, for constraints and for cameras and lights that track
            {"body_mass", "body_subtreemass", "body_invweight0", "dof_M0", "dof_invweight0"}
            | {"cam_poscom0", "light_poscom0"},
        ),
        (Perturbation(friction=1.2), {"actuator_biasprm", "actuator_dynprm"}),
        (Perturbation(viscous=1.2), {"dof_damping", "actuator_damping"}),
        (Perturbation(stiffness=1.2), {"jnt_stiffness"}),
        (Perturbation(home_offset=(0.0, 0.1)), {"qpos0"}),
        (Perturbation(motor_constant=1.2), {"actuator_gainprm", "actuator_forcerange", "actuator_ctrlrange"}),
    ],
)
def test_each_deviation_changes_its_arrays_of_the_copy_only(perturbation, changed):
    machine, untouched = Machine("xy"), Machine("xy")
    assert machine.digest == untouched.digest
    other = machine.perturbed(perturbation)
    assert fields_that_differ(machine.model, other.model) == changed
    assert fields_that_differ(machine.model, untouched.model) == set()
    assert other.digest != machine.digest


def test_perturbations_add_up(xy):
    once = xy.perturbed(Perturbation(payload=0.3, friction=(1.5, 1.0), motor_constant=1.1))
    twice = once.perturbed(Perturbation(payload=0.2, friction=(2.0, 1.0), motor_constant=1.1))
    assert twice.model.body("carriage").mass == pytest.approx(1.5, rel=EXACT)
    assert twice.axes[0].coulomb == pytest.approx(3 * xy.axes[0].coulomb, rel=EXACT)
    assert twice.axes[1].coulomb == xy.axes[1].coulomb
    assert twice.drive_gain == pytest.approx([1.21, 1.21], rel=EXACT)
    assert xy.drive_gain.tolist() == [1, 1]


MANY = Perturbation(payload=0.3, friction=1.3, viscous=0.8, stiffness=0.9, motor_constant=1.1, home_offset=0.02)


@pytest.mark.parametrize("name", ["xy", "xyz", "xyzr", "delta", "stage"])
def test_axes_of_a_perturbed_machine_are_those_that_its_model_states(name):
    machine = Machine(name).perturbed(MANY)
    axes, addresses = read_axes(machine.physics)
    assert machine.addresses == addresses
    for computed, read in zip(machine.plain_axes, axes, strict=True):
        for name, value in asdict(computed).items():
            is_number = isinstance(value, float | tuple)
            assert value == (
                pytest.approx(asdict(read)[name], rel=EXACT, nan_ok=True) if is_number else asdict(read)[name]
            )
    assert [axis.name for axis in machine.axes] == [axis.name for axis in axes]


def test_a_simulation_of_a_perturbed_machine_does_not_need_its_inertia_and_motion(xy, monkeypatch):
    def refuse(*_):
        raise AssertionError("slow")

    servo, setpoints = Servo.derive(xy.axes), MoveSpiral(60, 1, 10, 100).setpoints(0.001)
    inertias = [axis.inertia for axis in xy.perturbed(MANY).axes]
    with monkeypatch.context() as patch:
        patch.setattr("gantrysim.machine.machine.with_dynamics", refuse)
        machine = xy.perturbed(MANY)
        simulation = Simulation.of(machine, servo, setpoints)
    assert [axis.inertia for axis in simulation.machine.axes] == inertias
    assert all(a.inertia > b.inertia for a, b in zip(simulation.machine.axes, xy.axes, strict=True))


def test_machines_perturbed_in_turns_and_on_threads_have_their_own_constants(xy, xyz):
    def perturbed(k):
        machine = (xy, xyz)[k % 2].perturbed(Perturbation(payload=0.1 * (k + 1)))
        fresh = copy.copy(machine.physics)
        mujoco.mj_setConst(fresh, mujoco.MjData(fresh))
        return not fields_that_differ(machine.physics, fresh)

    with ThreadPoolExecutor(4) as threads:
        assert all(threads.map(perturbed, range(16)))


@pytest.mark.parametrize(("name", "feels"), [("xy", "xy"), ("xyz", "xyz"), ("xyzr", "xyz")])
def test_a_payload_adds_to_the_reflected_inertia_of_the_axes_that_carry_it(name, feels):
    machine = Machine(name)
    loaded = machine.perturbed(Perturbation(payload=0.5))
    for before, after, gear in zip(machine.axes, loaded.axes, machine.model.actuator_gear[:, 0], strict=True):
        more = 0.5 / gear / 1e3 if before.name in feels else 0.5 * 0.001**2 / gear * math.radians(1)
        assert after.inertia - before.inertia == pytest.approx(more, rel=1e-6)
        assert after.coulomb == before.coulomb
    assert loaded.tip(np.eye(len(machine.axes))) == pytest.approx(machine.tip(np.eye(len(machine.axes))))


def test_a_payload_is_on_the_work_if_the_nozzle_is_fixed():
    machine = Machine("stage")
    loaded = machine.perturbed(Perturbation(payload=0.5))
    gear = machine.model.actuator_gear[1:, 0]
    more = [b.inertia - a.inertia for a, b in zip(machine.axes[1:], loaded.axes[1:], strict=True)]
    assert more == pytest.approx(0.5 / gear / 1e3, rel=1e-9)


def test_a_constant_force_spring_does_not_grow_with_the_payload(xyz):
    loaded = xyz.perturbed(Perturbation(payload=0.5))
    z = xyz.addresses[2].joint
    forces = []
    for machine in (xyz, loaded):
        data = mujoco.MjData(machine.model)
        mujoco.mj_forward(machine.model, data)
        forces.append(data.qfrc_gravcomp[z] - data.qfrc_bias[z])
    assert forces == pytest.approx([0, -0.5 * GRAVITY], abs=1e-9)


def test_a_payload_is_part_of_mujocos_derived_constants(xy):
    loaded = xy.perturbed(Perturbation(payload=0.5))
    assert loaded.model.body("bridge_nut").subtreemass - xy.model.body("bridge_nut").subtreemass == pytest.approx(0.5)
    assert loaded.model.dof_M0[0] - xy.model.dof_M0[0] == pytest.approx(0.5)


def steady_torque(machine, servo, speed):
    """Torque of the motor of x at a constant speed, the mean over the second half of a ramp [N·m]."""
    run = simulate(machine, servo, ramp(speed))
    assert run.fault is None
    return float(run.torque[len(run.time) // 2 :, 0].mean())


@pytest.mark.parametrize("friction", [0.5, 1.0, 1.6])
def test_friction_scales_the_coulomb_torque_of_a_simulation(xy, friction):
    machine = xy.perturbed(Perturbation(friction=friction))
    servo = plain(xy, integral_time=0.03)
    viscous = machine.axes[0].viscous * 60.0
    assert machine.axes[0].viscous == xy.axes[0].viscous
    assert machine.axes[0].coulomb == pytest.approx(friction * 0.0173, rel=EXACT)
    assert steady_torque(machine, servo, 60.0) - viscous == pytest.approx(friction * 0.0173, rel=FRICTION)


@pytest.mark.parametrize("speed", [0.0, 1e-4, 3e-3, 0.1])
def test_friction_scales_the_force_of_the_whole_lugre_law_at_the_same_motion(xy, speed):
    """F = sigma0 z + sigma1 (v - sigma0 |v| z / g(v)), g = Coulomb + (static - Coulomb) exp(-(v/vs)^2)."""
    z, force = 1e-3, []
    for friction in (1.0, (1.7, 1.0)):
        model = xy.perturbed(Perturbation(friction=friction)).model
        data = mujoco.MjData(model)
        data.act[model.actuator_actadr[0]] = z
        data.qvel[model.jnt_dofadr[xy.addresses[0].joint]] = speed
        mujoco.mj_forward(model, data)
        force.append(-data.actuator_force[0])
    v = speed * xy.model.actuator_gear[0, 0]
    g = 0.0173 + (0.0208 - 0.0173) * math.exp(-((v / 3.1) ** 2))
    assert force[0] == pytest.approx(6.6 * z + 0.008 * (v - 6.6 * v * z / g), rel=1e-6)
    assert force[1] == pytest.approx(1.7 * force[0], rel=EXACT)


def test_an_axis_with_more_friction_is_held_by_a_torque_that_moves_the_nominal_one(xy):
    moved = []
    for friction in (1.0, 1.5):
        model = xy.perturbed(Perturbation(friction=friction)).model
        data = mujoco.MjData(model)
        data.ctrl[0] = 1.25 * 0.0208
        mujoco.mj_step(model, data, 4000)
        moved.append(1e3 * data.qpos[xy.addresses[0].joint])
    assert moved[0] > 10
    assert moved[1] < 0.2


@pytest.mark.parametrize("viscous", [1.0, 3.0])
def test_viscous_friction_scales_with_the_speed(xy, viscous):
    machine = xy.perturbed(Perturbation(viscous=viscous))
    servo = plain(xy, integral_time=0.03)
    slope = (steady_torque(machine, servo, 240.0) - steady_torque(machine, servo, 60.0)) / 180.0
    assert slope == pytest.approx(viscous * xy.axes[0].viscous, rel=0.03)
    assert machine.axes[0].viscous == pytest.approx(viscous * xy.axes[0].viscous, rel=EXACT)


def test_frictionloss_of_an_axis_joint_is_friction(rigid):
    file = rigid().source
    file.write_text(file.read_text().replace('<joint name="x"', '<joint name="x" frictionloss="2"'))
    model = Machine(file).perturbed(Perturbation(friction=1.5)).model
    assert model.dof_frictionloss.tolist() == [0, 3]


@pytest.mark.parametrize("stiffness", [0.5, 1.0, (2.0, 0.7)])
def test_static_deflection_is_force_over_stiffness(xy, stiffness):
    model = xy.perturbed(Perturbation(stiffness=stiffness)).model
    for axis, nominal, factor in zip("xy", (13.1e6, 13.5e6), np.broadcast_to(stiffness, 2), strict=True):
        data = mujoco.MjData(model)
        flex = model.joint(f"{axis}_flex")
        data.qfrc_applied[flex.dofadr[0]] = 8.0  # less than the break-away force: the motor side stays
        mujoco.mj_step(model, data, 8000)
        assert data.qpos[flex.qposadr[0]] == pytest.approx(8.0 / (factor * nominal), rel=DEFLECTION)


def test_a_spring_above_all_axes_takes_one_common_factor(rigid):
    file = rigid().source
    text = file.read_text()
    springy = (
        '<body name="base"><joint name="base" axis="0 0 1" stiffness="1e6" damping="10"/><geom size="0.01" mass="1"/>'
    )
    text = text.replace('<body name="bridge">', springy + '<body name="bridge">')
    file.write_text(text.replace("</worldbody>", "</body></worldbody>"))
    machine = Machine(file)
    assert machine.perturbed(Perturbation(stiffness=2.0)).model.joint("base").stiffness[0] == 2e6
    with pytest.raises(InputError, match="factors of stiffness per axis: no axis carries the spring 'base'; give one"):
        machine.perturbed(Perturbation(stiffness=(2.0, 1.0)))


@pytest.mark.parametrize("factor", [0.8, 1.0, 1.2])
def test_the_motor_constant_scales_torque_and_stall_force_and_divides_the_no_load_speed(rigid, factor):
    machine = rigid(damping=0.0)
    other = machine.perturbed(Perturbation(motor_constant=factor))
    axis, nominal = other.axes[0], machine.axes[0]
    assert axis.motor_constant == pytest.approx(0.03 * factor, rel=EXACT)
    assert axis.peak_torque == pytest.approx(30 * 0.03 * factor, rel=EXACT)
    assert axis.no_load_speed == pytest.approx(nominal.no_load_speed / factor, rel=EXACT)
    assert axis.inertia == nominal.inertia
    # a constant demand: the torque that arrives, and the acceleration that it makes
    run = simulate(other, plain(machine), ramp(50.0, 5.0), law=lambda tick: [0.1, 0.0])
    late = slice(20, 60)
    assert run.demand[late, 0] == pytest.approx(0.1)
    assert run.torque[late, 0] == pytest.approx(0.1 * factor, rel=1e-6)
    assert run.current[late, 0] == pytest.approx(0.1 / 0.03, rel=1e-6)
    motion = np.diff(run.motor[late, 0], 2) / run.period**2
    assert motion == pytest.approx(0.1 * factor / axis.inertia, rel=1e-4)
    # more than the drive has: its current is the limit
    run = simulate(other, plain(machine), ramp(50.0, 5.0), law=lambda tick: [9.0, 0.0])
    assert run.torque[:15, 0].max() == pytest.approx(30 * 0.03 * factor, rel=1e-3)
    assert run.demand[:, 0].max() == pytest.approx(30 * 0.03)


def test_the_drive_clamps_its_voltage_by_the_real_back_emf(rigid):
    other = rigid(voltage=12.0).perturbed(Perturbation(motor_constant=1.2))
    run = simulate(other, plain(rigid(voltage=12.0)), ramp(50.0, 5.0), law=lambda tick: [0.2, 0.0])
    motor = run.motor[:, 0] / other.axes[0].scale
    # the speed that a step of Euler's has reached is that of its end
    motor_speed = np.gradient(motor, run.period) - 0.25e-3 * np.gradient(np.gradient(motor, run.period), run.period)
    expected = 0.3 * 0.2 / 0.03 + 0.036 * motor_speed
    assert run.voltage[10:20, 0] == pytest.approx(expected[10:20], rel=1e-4)
    assert run.voltage.max() <= 12.0


def test_an_ideal_torque_source_gives_the_demand_times_the_factor(rigid):
    machine = Machine(ideal_motors(rigid(damping=0.0).source))
    other = machine.perturbed(Perturbation(friction=1.5, motor_constant=(1.25, 1.0)))
    assert fields_that_differ(machine.model, other.model) <= {"actuator_forcerange"}  # no winding, no friction
    run = simulate(other, plain(machine), ramp(50.0, 5.0), law=lambda tick: [0.1, 0.1])
    assert run.torque[:, 0] == pytest.approx(0.125)
    assert run.torque[:, 1] == pytest.approx(0.1)
    assert np.diff(run.motor[1:, 0], 2) / run.period**2 == pytest.approx(0.125 / machine.axes[0].inertia, rel=1e-4)


def test_a_home_offset_moves_the_nozzle_but_not_the_encoders(xyz):
    servo = Servo.derive(xyz.axes)
    offset = (2e-4, -3e-4, 5e-4)
    run, other = (spiral_run(m, servo) for m in (xyz, xyz.perturbed(Perturbation(home_offset=offset))))
    assert other.nozzle - run.nozzle == pytest.approx(np.broadcast_to(offset, run.nozzle.shape), abs=1e-9)
    assert other.encoder == pytest.approx(run.encoder, abs=1e-9)
    assert other.motor_tip == pytest.approx(run.motor_tip, abs=1e-9)


def test_a_home_offset_of_the_table_turns_the_work_by_it():
    machine = Machine("stage")
    data = mujoco.MjData(machine.perturbed(Perturbation(home_offset=(0.5, 0.0, 0.0))).model)
    data.qpos[:] = machine.to_qpos([10.0, 20.0, -30.0])
    mujoco.mj_forward(machine.model, data)  # of the nominal machine, at the same positions of its encoders
    nominal = data.body("work").xpos.copy()
    other = machine.perturbed(Perturbation(home_offset=(0.5, 0.0, 0.0)))
    mujoco.mj_forward(other.model, data)
    turn = math.radians(0.5)
    turned = [
        nominal[0] * math.cos(turn) - nominal[1] * math.sin(turn),
        nominal[0] * math.sin(turn) + nominal[1] * math.cos(turn),
        nominal[2],
    ]
    assert data.body("work").xpos == pytest.approx(turned, abs=1e-12)


@pytest.mark.parametrize("name", ["xy", "xyz", "xyzr", "stage", "delta"])
def test_every_machine_takes_quasi_random_factors_and_runs(name):
    machine = Machine(name)
    generator = np.random.default_rng(1)
    for _ in range(4):
        factors = {key: tuple(generator.uniform(0.6, 1.5, len(machine.axes))) for key in VARIED_FACTORS}
        other = machine.perturbed(Perturbation(payload=generator.uniform(0, 0.5), **factors))
        data = mujoco.MjData(other.model)
        for _ in range(100):
            data.ctrl[:] = generator.uniform(-1, 1, other.model.nu) * [axis.peak_torque for axis in other.axes]
            mujoco.mj_step(other.model, data, 20)
        assert [int(warning.number) for warning in data.warning] == [0] * len(data.warning)


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"payload": math.nan}, "payload = nan kg: must be finite"),
        ({"friction": 0.0}, "factor of friction = 0: must be greater than 0"),
        ({"home_offset": math.inf}, "home_offset = inf: must be finite"),
        ({"stiffness": (1.0, -1.0)}, "factor of stiffness = -1: must be greater than 0"),
        ({"geometry": 2.0}, r'geometry is of type float: must be pairs; write geometry=\(\("warming", 2.0\),\)'),
        ({"geometry": ("warming", 2.0)}, "must be pairs"),
        ({"geometry": (("warming", math.inf),)}, "factor of warming = inf: must be finite"),
        ({"motor_constant": "much"}, "factor of motor_constant = 'much': must be a number"),
    ],
)
def test_invalid_perturbations_are_rejected(values, text):
    with pytest.raises(InputError, match=text):
        Perturbation(**values)


@pytest.mark.parametrize(
    ("perturbation", "text"),
    [
        (Perturbation(payload=-1.0), "payload = -1 kg: must leave the body 'carriage' a mass, which is 1 kg"),
        (
            Perturbation(viscous=(1, 1, 1)),
            "viscous has 3 values: must be one or 2, of the axes x, y",
        ),
    ],
)
def test_a_perturbation_that_does_not_fit_the_machine_is_rejected(xy, perturbation, text):
    with pytest.raises(InputError, match=text):
        xy.perturbed(perturbation)


@pytest.mark.parametrize("name", ["friction", "viscous", "stiffness", "motor_constant", "home_offset"])
def test_a_value_of_a_named_axis_leaves_the_others_nominal(xy, name):
    nominal = 0.0 if name == "home_offset" else 1.0
    named = Perturbation(**{name: {"y": 2.0}})
    assert named.per_axis(name, ("x", "y")).tolist() == [nominal, 2.0]
    in_order = Perturbation(**{name: (nominal, 2.0)})
    same, expected = (xy.perturbed(perturbation) for perturbation in (named, in_order))
    assert same.digest == expected.digest != xy.digest
    assert same.axes == expected.axes


def test_a_perturbation_by_axes_is_a_value():
    one = Perturbation(friction={"x": 1.5, "y": 2})
    assert one == Perturbation(friction={"y": 2.0, "x": 1.5})
    assert hash(one) == hash(Perturbation(friction={"y": 2.0, "x": 1.5}))
    assert repr(one) != repr(Perturbation(friction={"x": 1.5, "y": 3.0}))
    assert replace(one, payload=0.2) == Perturbation(payload=0.2, friction={"x": 1.5, "y": 2.0})
    assert pickle.loads(pickle.dumps(one)) == one
    assert gs.Perturbation is Perturbation


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"friction": {"x": -1.0}}, "^factor of friction of x = -1: must be greater than 0$"),
        ({"motor_constant": {"y": math.nan}}, "^factor of motor_constant of y = nan: must be finite$"),
        ({"home_offset": {"y": "far"}}, "^home_offset of y = 'far': must be a number$"),
    ],
)
def test_invalid_values_of_named_axes_are_rejected(values, text):
    with pytest.raises(InputError, match=text):
        Perturbation(**values)


def test_an_axis_that_the_machine_does_not_have_is_rejected(xy):
    with pytest.raises(InputError, match=r"^friction of z = 1\.5: unknown axis 'z': known: x, y$"):
        xy.perturbed(Perturbation(friction={"x": 1.2, "z": 1.5}))


def test_a_lighter_nozzle_is_a_negative_payload(xy):
    assert xy.perturbed(Perturbation(payload=-0.4)).model.body("carriage").mass[0] == pytest.approx(0.6)
