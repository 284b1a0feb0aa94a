"""Yaw of an axis against MuJoCo's own kinematics of the machine with a hinge in the axis' body."""

import math

import mujoco
import numpy as np
import pytest

from gantrysim import Machine
from gantrysim.machine.geometry import Geometry

from support.soaked import suite_runs
from support.tables import EXAMPLES

YAW = 0.01  # at the ends of the travel [mm/m]; so small that its square is none of the displacement
FIRST_ORDER = 1e-8  # [mm]


def turned(machine, body, centre, axes, angle):
    """The nozzle in the work's frame, with a body turned about the vertical through a point of its own [mm]."""
    spec = machine.spec.copy()
    spec.body(body).add_joint(
        name="oracle", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1], pos=[1e-3 * c for c in centre]
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    for name, value in axes.items():
        data.joint(name).qpos = 1e-3 * value
    data.joint("oracle").qpos = angle
    mujoco.mj_kinematics(model, data)
    work = data.body("work")
    return 1e3 * work.xmat.reshape(3, 3).T @ (data.site("nozzle").xpos - work.xpos)


def displacement(machine, body, centre, axes, angle):
    return turned(machine, body, centre, axes, angle) - turned(machine, body, centre, axes, 0.0)


def blocks(machine, body):
    """Middle of the guide blocks of a body, by the geoms that are drawn."""
    geoms = [geom for geom in machine.spec.body(body).geoms if geom.classname.name == "block"]
    return 1e3 * np.mean([geom.pos for geom in geoms if geom.pos[2] < 0], axis=0)


@pytest.mark.parametrize("x", [-120.0, 0.0, 75.0])
@pytest.mark.parametrize("y", [-150.0, 60.0])
def test_a_bridge_that_yaws_beside_the_nozzle_also_moves_it_across(x, y):
    machine = Machine("xy")
    angle = YAW * 1e-3 * y / 150.0
    middle = blocks(machine, "bridge")
    assert middle[:2] == pytest.approx([0.0, 125.0])
    expected = displacement(machine, "bridge_nut", (0.0, middle[1], 0.0), {"x": x, "y": y}, angle)
    motor = np.array([[x, y]])
    real = machine.with_geometry(Geometry(yaw=(0.0, YAW)))
    found = next(iter(real.kinematic_errors.tips([motor]))) - machine.tip(motor)
    np.testing.assert_allclose(found[0], expected, atol=FIRST_ORDER)
    assert abs(found[0, 0]) == pytest.approx(125.0 * abs(angle), rel=1e-6)


@pytest.mark.parametrize(
    "machine", suite_runs(["xyz", "xyzr", EXAMPLES / "cantilever.toml", EXAMPLES / "stepper.toml"], 1, 2)
)
@pytest.mark.parametrize("axis", ["x", "y"])
def test_the_nozzle_moves_by_the_yaw_times_the_whole_lever(machine, axis):
    """With any centre, on every chain: a bridge, an arm that is guided at its end, and a table under a beam."""
    machine = Machine(machine)
    names = machine.axis_names
    place = names.index(axis)
    bodies = {
        "x": "carriage_nut",
        "y": next(b.name for b in machine.spec.bodies if any(j.name == "y" for j in b.joints)),
    }
    low, high = machine.axes[place].travel
    random = np.random.default_rng(3)
    moves_work = machine.spec.body("work").parent.name not in ("frame", "world")
    for _ in range(5):
        axes = {name: float(random.uniform(*machine.axes[names.index(name)].travel)) for name in ("x", "y")}
        centre = random.uniform(-200.0, 200.0, 2)
        home = turned(machine, bodies[axis], (*centre, 0.0), {}, 0.0)
        lever = home[:2] - centre  # the bodies' frames coincide with that of the work at home
        abbe, arm = (lever[1], lever[0]) if axis == "x" else (lever[0], lever[1])
        geometry = Geometry(
            yaw=tuple(YAW if name == axis else 0.0 for name in names),
            abbe=tuple(abbe if name == axis else 0.0 for name in names),
            guide_arm=tuple(arm if name == axis else 0.0 for name in names),
        )
        share = axes[axis] / (0.5 * (high - low))
        angle = YAW * 1e-3 * share * (-1 if moves_work and axis == "y" else 1)  # of the nozzle against the work
        expected = displacement(machine, bodies[axis], (*centre, 0.0), axes, angle)
        motor = np.array([[axes.get(name, 0.0) for name in names]])
        found = next(iter(machine.with_geometry(geometry).kinematic_errors.tips([motor]))) - machine.tip(motor)
        np.testing.assert_allclose(found[0], expected, atol=FIRST_ORDER)


def test_racking_moves_the_nozzle_across_too():
    machine = Machine("xy")
    y = np.concatenate([np.linspace(0, 10, 101), np.linspace(10, 5, 501)])
    motor = np.stack([np.full(y.size, 100.0), y], axis=1)
    real = machine.with_geometry(Geometry(racking=0.2))
    shift = next(iter(real.kinematic_errors.tips([motor])))[-1] - machine.tip(motor[-1:])[0]
    assert shift[:2] == pytest.approx([0.2e-3 * 125.0, 0.2e-3 * 100.0], abs=1e-9)
    assert math.hypot(*shift[:2]) == pytest.approx(0.2e-3 * math.hypot(100.0, 125.0), abs=1e-9)
