"""Machines read from MJCF, and the MJCF that is rejected."""

import math

import mujoco
import numpy as np
import pytest

from gantrysim import InputError, Machine, Servo, simulate
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.machine.machine import builtin_models
from gantrysim.machine.perturbation import Perturbation

from support.runs import ideal_motors


def test_axis_values_of_a_machine_with_known_parameters(rigid):
    machine = rigid()
    assert machine.axis_names == ("x", "y")
    x, y = machine.axes
    assert x.scale == pytest.approx(10 / (2 * math.pi))
    assert x.travel == (-150.0, 150.0)
    assert x.speed_limit == pytest.approx(1000.0)
    assert x.resolution == pytest.approx(10 / 10_000)
    assert x.lag == pytest.approx(3e-4 / 0.3)
    assert x.motor_constant == pytest.approx(0.03)
    assert x.bus_voltage == 24.0
    assert x.peak_torque == pytest.approx(0.03 * 30)
    # torque per acceleration: (mass + J gear^2) lead / 2 pi, and J + mass (lead / 2 pi)^2 over it
    lead = 0.010 / (2 * math.pi)
    assert x.inertia == pytest.approx((1.0 * lead + 1.5e-5 / lead) * 1e-3, rel=1e-12)
    assert y.inertia == pytest.approx((4.0 * lead + 1.5e-5 / lead) * 1e-3, rel=1e-12)
    assert x.viscous == pytest.approx(12.0 * lead * 1e-3, rel=1e-12)


@pytest.mark.parametrize("position", [(math.nan, 1.0), (1.0, math.inf), (1.0,), (1.0, 2.0, 3.0), 4.0, "near"])
def test_a_position_is_a_finite_number_for_each_axis(rigid, position):
    with pytest.raises(
        InputError, match=r"^position = .*: must be 2 finite numbers, one per axis: x \[mm\], y \[mm\]$"
    ):
        rigid().motion(position)


def test_the_builtin_machines_are_the_files_of_the_folder():
    assert {"xy", "xyz"} <= set(builtin_models())
    for name in builtin_models():
        assert Machine(name).name == name


@pytest.mark.parametrize("name", ["xy", "xyz"])
def test_the_work_frame_has_its_origin_at_the_nozzle_of_the_zeroed_machine(name):
    machine = Machine(name)
    positions = np.random.default_rng(1).uniform(-0.3, 70, (20, len(machine.axes)))
    expected = np.zeros((20, 3))
    expected[:, : len(machine.axes)] = positions
    np.testing.assert_allclose(machine.tip(positions), expected, atol=1e-9)


def test_tip_agrees_with_mujoco_at_random_positions(xyz):
    data = mujoco.MjData(xyz.model)
    for position in np.random.default_rng(2).uniform(-100, 100, (5, 3)):
        data.qpos[:] = xyz.to_qpos(position)
        mujoco.mj_kinematics(xyz.model, data)
        frame = data.xmat[xyz.work].reshape(3, 3)
        tip = 1e3 * frame.T @ (data.site_xpos[xyz.nozzle] - data.xpos[xyz.work])
        np.testing.assert_allclose(xyz.tip(position), tip, atol=1e-9)


def test_stepping_changes_only_the_timestep_and_leaves_the_machine_alone(rigid):
    machine = rigid()
    model = machine.stepping(1e-4)
    assert model.opt.timestep == 1e-4
    assert machine.model.opt.timestep == 5e-4
    assert machine.stepping(1e-4) is model
    heavy = machine.perturbed(Perturbation(payload=1.0))
    assert heavy.stepping(1e-4).body_mass.sum() == pytest.approx(model.body_mass.sum() + 1.0)
    assert machine.stepping(1e-4) is model


@pytest.mark.parametrize("name", builtin_models())
def test_the_physics_has_no_visual_geoms_and_the_same_dynamics(name):
    machine = Machine(name)
    machines = [machine, machine.perturbed(Perturbation(payload=0.2, friction=1.5, home_offset=0.01))]
    for each in machines:
        assert each.model.ngeom > 40
        assert (each.physics.ngeom, each.physics.ntex) == (0, 0)
        runs = []
        for model in (each.model, each.physics):
            data, random = mujoco.MjData(model), np.random.default_rng(0)
            for _ in range(20):
                data.ctrl[:] = 0.2 * random.uniform(-1, 1, model.nu)
                mujoco.mj_step(model, data, 50)
            runs.append([data.qpos.tobytes(), data.qvel.tobytes(), data.act.tobytes(), data.site_xpos.tobytes()])
        assert runs[0] == runs[1]


def test_geoms_that_collide_or_define_an_inertia_stay_in_the_physics(rigid):
    machine = rigid()
    assert machine.model.ngeom == machine.physics.ngeom == 2
    content = machine.source.read_text()
    visual = content.replace(
        '<geom type="sphere" size="0.01" mass="3"/>', '<geom size="0.01" mass="3" contype="0" conaffinity="0"/>'
    )
    assert visual != content
    machine.source.write_text(visual)
    light = Machine(machine.source)
    assert (light.model.ngeom, light.physics.ngeom) == (2, 1)
    assert np.array_equal(light.physics.body_mass, light.model.body_mass)
    machine.source.write_text(visual.replace("<option", '<compiler inertiafromgeom="true"/><option'))
    whole = Machine(machine.source)
    assert whole.physics is whole.model
    assert whole.model.ngeom == 2


def test_digest_tells_machines_apart(rigid):
    first, again = rigid(), rigid()
    assert first.digest == again.digest
    assert rigid(damping=13.0).digest != first.digest


def test_mujocos_automatic_reset_is_disabled(rigid):
    machine = rigid()
    for model in (machine.model, machine.physics, machine.stepping(1e-4), Machine("xy").physics):
        assert model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_AUTORESET


REPLACEMENTS = {
    "no nozzle": ('name="nozzle"', 'name="tip"', "has no site named 'nozzle'; it has: tip"),
    "no work": ('name="work"', 'name="table"', "has no body named 'work'; it has: world, table, bridge, carriage"),
    "axis name": (
        '<dcmotor name="x" joint="x"/>',
        '<dcmotor name="q" joint="x"/>',
        "no joint named 'q'; it has: y, x",
    ),
    "nameless": ('<dcmotor name="x" joint="x"/>', '<dcmotor joint="x"/>', "actuator 0 has no name"),
    "other joint": (
        '<dcmotor name="x" joint="x"/>\n    <dcmotor name="y" joint="y"/>',
        '<dcmotor name="x" joint="y"/>\n    <dcmotor name="y" joint="x"/>',
        "actuator 'x' must drive the joint 'x'",
    ),
    "voltage mode": (
        '<dcmotor name="x" joint="x"/>',
        '<dcmotor name="x" joint="x" input="voltage" controller="0 0 0 0 0 0"/>',
        "dcmotor 'x' must have input=\"ff\" and a bus voltage",
    ),
    "position servo": (
        '<dcmotor name="x" joint="x"/>',
        '<position name="x" joint="x" kp="1"/>',
        "actuator 'x' must be a dcmotor",
    ),
    "integrator": ('integrator="Euler"', 'integrator="RK4"', "integrator RK4 calls the servo four times"),
    "encoder": (
        '<actuatorpos name="x" actuator="x"',
        '<actuatorpos name="x" actuator="y"',
        "sensor 'x' must be an actuatorpos of",
    ),
    "gear": ('gear="628.3185307179587"', 'gear="-1"', "gear of 'x' = -1: must be greater than 0"),
    "ball": (
        '<joint name="x" axis="1 0 0"/>',
        '<joint name="x" type="ball" range="0 0"/>',
        "joint 'x' must be a slide or a hinge",
    ),
    "hinge of a slide's name": (
        '<joint name="x" axis="1 0 0"/>',
        '<joint name="x" type="hinge" axis="0 0 1"/>',
        r"axis 'x' moves the nozzle along \(0, 0, 0\) of body 'work': must be along its x",
    ),
    "hinge beside the tip": (
        '<joint name="x" axis="1 0 0"/>',
        '<joint name="x" type="hinge" axis="0 0 1" pos="0.05 0 0"/>',
        "rotary axis 'x' moves the nozzle by 70.71 mm in 90 deg: must turn it about its own tip",
    ),
    "hinge that turns a slide": (
        '<joint name="y" axis="0 1 0"/>',
        '<joint name="y" type="hinge" axis="0 0 1"/>',
        "rotary axis 'y' moves the nozzle by 141.4 mm in 90 deg: must turn it about its own tip",
    ),
    "work elsewhere": (
        '<body name="work"/>',
        '<body name="work" pos="0.1 0 -0.05"/>',
        r"with all axes at zero the nozzle is at \(-100, 0, 50\) mm of body 'work': must be its origin",
    ),
    "joint reference": ('<joint name="x" axis="1 0 0"/>', '<joint name="x" axis="1 0 0" ref="0.1"/>', "nozzle is at"),
    "axis direction": (
        '<joint name="x" axis="1 0 0"/>',
        '<joint name="x" axis="-1 0 0"/>',
        r"axis 'x' moves the nozzle along \(-1, 0, 0\) of body 'work': must be along its x",
    ),
    "no actuation": (
        'integrator="Euler" gravity="0 0 0"/>',
        'integrator="Euler"><flag actuation="disable"/></option>',
        "disables its actuators",
    ),
    "one-sided range": (
        '<dcmotor name="x" joint="x"/>',
        '<dcmotor name="x" joint="x" ctrllimited="true" ctrlrange="0 5"/>',
        "range of 'x' = 0 to 5 N·m: must include zero",
    ),
    "not XML": ("</mujoco>", "", "model .*rigid.xml: .*XML"),
}


@pytest.mark.parametrize(("old", "new", "text"), REPLACEMENTS.values(), ids=REPLACEMENTS.keys())
def test_an_incomplete_mjcf_is_rejected_with_one_line(rigid, old, new, text):
    source = rigid().source
    content = source.read_text()
    assert old in content
    content = content.replace(old, new)
    if "actuator" not in old:
        content = content[: content.index("<sensor>")] + "</mujoco>"  # sensors of the old names would be refused first
    source.write_text(content if old != "</mujoco>" else content.removesuffix("</mujoco>"))
    with pytest.raises(InputError, match=text) as caught:
        Machine(source)
    assert "\n" not in str(caught.value)


def test_a_plain_motor_is_an_ideal_torque_source(rigid):
    x = Machine(ideal_motors(rigid().source)).axes[0]
    assert math.isnan(x.motor_constant)
    assert x.peak_torque == pytest.approx(0.9)  # the default class' force range
    assert x.lag == 0.0
    assert x.inertia == rigid().axes[0].inertia


@pytest.mark.parametrize(
    ("model", "text"),
    [
        ("yx", "unknown model 'yx': did you mean xy\\? known: xy, .*xyz"),
        ("no/such.xml", r"model no/such.xml: no such file; built-in models: .*xy, xyz"),
    ],
)
def test_unknown_models_are_rejected_with_the_alternatives(model, text):
    with pytest.raises(InputError, match=text):
        Machine(model)


def test_peak_torque_is_the_least_of_all_limits(rigid):
    source = rigid(current=1e3).source  # so that 0.03 N·m/A of 24 V through 0.3 ohm is the least
    assert Machine(source).axes[0].peak_torque == pytest.approx(0.03 * 24 / 0.3)
    content = source.read_text()
    limited = '<dcmotor name="x" joint="x" ctrllimited="true" ctrlrange="-0.4 0.7"/>'
    source.write_text(content.replace('<dcmotor name="x" joint="x"/>', limited))
    assert Machine(source).axes[0].peak_torque == pytest.approx(0.4)
    assert Machine(source).axes[1].peak_torque == pytest.approx(2.4)


def test_the_work_frame_does_not_depend_on_the_machines_pose_in_the_world(rigid):
    source = rigid().source
    content = source.read_text()
    turned = content.replace("<worldbody>", '<worldbody><body name="bench" pos="0.3 -0.2 0.5" euler="20 -30 70">')
    source.write_text(turned.replace("</worldbody>", "</body></worldbody>"))
    machine = Machine(source)
    np.testing.assert_allclose(machine.tip([[30.0, -40.0]]), [[30.0, -40.0, 0.0]], atol=1e-9)
    servo = Servo.derive(machine.axes, resolution=0.0)
    run = simulate(machine, servo, MoveSpiral(60, 1, 10, 100).setpoints(1e-3))
    np.testing.assert_allclose(run.nozzle[:, :2], run.encoder, atol=1e-9)


HINGE = """
      <body name="head">
        <joint name="r" type="hinge" axis="0 0 1" range="-40 40"/>
        <geom type="sphere" size="0.01" mass="0.1"/>
        <site name="nozzle"/>
      </body>
"""


def test_a_hinge_through_the_tip_turns_the_nozzle_and_leaves_the_tip(rigid):
    source = rigid().source
    content = source.read_text().replace('<site name="nozzle"/>', HINGE)
    content = content.replace("</actuator>", '<motor name="r" joint="r" gear="10"/></actuator>')
    source.write_text(content)
    machine = Machine(source)
    r = machine.axes[2]
    assert (r.name, r.unit) == ("r", "deg")
    assert r.travel == pytest.approx((-40.0, 40.0))
    assert r.speed_limit == pytest.approx(math.degrees(1.0))  # the default class' user value, in rad/s
    np.testing.assert_allclose(machine.tip([[30.0, -40.0, 123.0]]), [[30.0, -40.0, 0.0]], atol=1e-9)
    source.write_text(content.replace('gear="10"', 'gear="-10"'))
    with pytest.raises(InputError, match=r"gear of 'r' = -10: .* 0 \(turns of the motor per turn of the axis\)"):
        Machine(source)


def test_a_hinge_that_turns_the_work_frees_the_work_frame(rigid):
    source = rigid().source
    turned = '<body name="work" pos="0.1 0 -0.05"><joint name="th" type="hinge"/><geom size="0.1" mass="1"/></body>'
    content = source.read_text().replace('<body name="work"/>', turned)
    source.write_text(content)
    with pytest.raises(InputError, match="with all axes at zero the nozzle is at"):
        Machine(source)  # nothing drives the hinge: it stands still
    source.write_text(content.replace("</actuator>", '<motor name="th" joint="th" gear="10"/></actuator>'))
    tip = Machine(source).tip([[0.0, 0.0, 90.0], [100.0, 50.0, 180.0]])
    np.testing.assert_allclose(tip, [[0.0, 100.0, 50.0], [0.0, -50.0, 50.0]], atol=1e-9)


@pytest.mark.parametrize("name", builtin_models())
def test_a_machine_knows_the_needle_that_it_draws(name):
    assert Machine(name).needle == pytest.approx((0.82, 25.4), abs=3e-3)


def test_a_machine_without_a_drawn_needle_has_none(rigid):
    assert rigid().needle is None
