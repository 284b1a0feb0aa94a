"""The digest of a machine against the motion: what moves nothing leaves it as it is, all else changes it."""

import copy

import mujoco
import numpy as np
import pytest
from mujoco.introspect import structs

from gantrysim import Machine
from gantrysim.machine import compiling
from gantrysim.machine.compiling import digest_of

# elements of most kinds; the pendulum swings and hits the plate
EVERYTHING = """
<mujoco model="everything">
  <size nuser_jnt="1" nuser_sensor="1"/>
  <option timestep="0.002" density="1.2" viscosity="1e-5"/>
  <asset>
    <texture name="grid" type="2d" builtin="checker" width="4" height="4"/>
    <material name="red" texture="grid" rgba="1 0 0 1"/>
    <mesh name="wedge" vertex="0 0 0  0.1 0 0  0 0.1 0  0 0 0.1"/>
  </asset>
  <worldbody>
    <light pos="0 0 3"/>
    <geom name="plate" type="plane" size="1 1 0.1" material="red"/>
    <body name="arm" pos="0 0 0.3">
      <joint name="x" type="hinge" axis="0 1 0" damping="0.01" stiffness="0.1" range="-170 170" frictionloss="0.01"
        user="3"/>
      <geom name="rod" type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.3" rgba="0 1 0 1"/>
      <site name="tip" pos="0.2 0 0" rgba="0 0 1 1"/>
      <body name="hand" pos="0.2 0 0">
        <joint name="flex" type="slide" axis="1 0 0" stiffness="200" damping="0.5" armature="0.01"/>
        <geom name="finger" type="mesh" mesh="wedge" mass="0.1" material="red"/>
      </body>
    </body>
    <body name="block" pos="0.5 0 0.2">
      <freejoint/><geom name="cube" type="box" size="0.03 0.03 0.03" mass="0.2"/>
    </body>
  </worldbody>
  <contact><pair geom1="rod" geom2="cube"/><exclude body1="arm" body2="hand"/></contact>
  <equality><joint joint1="flex" polycoef="0 0 0 0 0"/></equality>
  <tendon><fixed name="belt" stiffness="1"><joint joint="x" coef="0.1"/></fixed></tendon>
  <actuator><motor name="x" joint="x" gear="2" ctrlrange="-1 1" ctrllimited="true" group="1"/></actuator>
  <sensor><jointpos name="x" joint="x" noise="0.001" user="4000"/></sensor>
  <custom><numeric name="gap" data="0.4 0.5"/><text name="kinematics" data="serial"/></custom>
  <keyframe><key name="home" qpos="0.1 0 0.5 0 0.2 1 0 0 0"/></keyframe>
</mujoco>
"""
AUTORESET = mujoco.mjtDisableBit.mjDSBL_AUTORESET
# arrays that only say how elements are drawn, and where names and files stand
DRAWN = ("tex_", "mat_", "light_")
LOOKS = {
    *("geom_rgba", "site_rgba", "tendon_rgba", "geom_matid", "site_matid", "tendon_matid", "geom_castshadow"),
    *("geom_group", "site_group", "jnt_group", "tendon_group", "tendon_width", "mesh_pathadr", "names_map"),
}


def is_looks(name):
    return name.startswith(DRAWN) or name in LOOKS or (name.startswith("name_") and name.endswith("adr"))


def everything():
    model = mujoco.MjSpec.from_string(EVERYTHING).compile()
    model.actuator_actearly[:] = False  # as the engine has it
    return model


def arrays(model):
    """Names of the model's arrays, by MuJoCo's own description of it."""
    values = {field.name: getattr(model, field.name, None) for field in structs.STRUCTS["mjModel"].fields}
    return [name for name, value in values.items() if isinstance(value, np.ndarray) and value.size]


def changed(array):
    """Change the first number of an array, as little as possible."""
    first = array.flat[0]
    array.flat[0] = np.nextafter(first, np.inf) if array.dtype.kind == "f" else not first if first in (0, 1) else 0


def motion(model):
    """Positions of a run in which every part moves and the pendulum strikes."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.ctrl[:] = 0.5
    places = []
    for _ in range(300):
        mujoco.mj_step(model, data)
        places.append(data.qpos.copy())
    return np.array(places)


def test_every_array_of_the_physics_counts():
    model = everything()
    same = digest_of(model)
    physical = [name for name in arrays(model) if not is_looks(name) and name != "actuator_actearly"]
    assert {"body_mass", "jnt_range", "dof_damping", "jnt_stiffness", "actuator_gear", "sensor_user"} < set(physical)
    for name in physical:
        other = copy.copy(model)
        changed(getattr(other, name))
        assert digest_of(other) != same, name


def test_every_option_counts():
    model = everything()
    same = digest_of(model)
    for field in structs.STRUCTS["mjOption"].fields:
        other = copy.copy(model)
        value = getattr(other.opt, field.name)
        if isinstance(value, np.ndarray):
            changed(value)
        else:
            setattr(other.opt, field.name, value + 1)
        assert digest_of(other) != same, field.name
    other = copy.copy(model)
    other.stat.meaninertia *= 2  # by which the solver measures its error
    assert digest_of(other) != same


def test_what_does_not_count_moves_nothing():
    model = everything()
    places = motion(model)
    assert np.ptp(places[:, [0, 1, 4]], axis=0).min() > 1e-3  # the arm, the hand, and the block that falls
    left_out = [name for name in arrays(model) if is_looks(name)]
    assert {"geom_rgba", "tex_data", "light_pos", "mat_rgba", "name_jntadr"} < set(left_out)
    for name in left_out:
        other = copy.copy(model)
        changed(getattr(other, name))
        assert digest_of(other) == digest_of(model), name
        assert np.array_equal(motion(other), places), name
    other = copy.copy(model)
    other.stat.extent = 7.0
    other.vis.headlight.active = 0
    other.opt.disableflags |= AUTORESET  # as the engine has it, which reports a divergence itself
    assert digest_of(other) == digest_of(model)
    assert np.array_equal(motion(other), places)


@pytest.mark.parametrize(
    "edit",
    [
        lambda spec: setattr(spec, "nuserdata", 5000),
        lambda spec: setattr(spec, "memory", 2**26),
        lambda spec: setattr(spec, "modelname", "another name"),
        lambda spec: setattr(spec.option, "disableflags", spec.option.disableflags | AUTORESET),
    ],
    ids=["user data", "memory", "the model's name", "automatic reset, which the engine turns off"],
)
def test_what_the_engine_needs_for_itself_does_not_count(xy, edit):
    edited = xy.edited(edit)
    assert edited.digest == xy.digest


def test_a_longer_row_of_the_servo_is_the_same_machine(xy, monkeypatch):
    monkeypatch.setattr(compiling, "ROW_NUMBERS", compiling.ROW_NUMBERS + 3)
    longer = Machine(xy.source)
    assert longer.physics.nuserdata == xy.physics.nuserdata + 3
    assert longer.digest == xy.digest


@pytest.mark.parametrize(
    "edit",
    [
        lambda spec: setattr(spec.joint("x"), "damping", [*spec.joint("x").damping + 1e-9]),
        lambda spec: setattr(spec.option, "timestep", 2e-4),
        lambda spec: setattr(spec.actuator("x"), "gear", 1.001 * spec.actuator("x").gear),
        lambda spec: setattr(spec.sensor("x"), "userdata", 2 * np.array(spec.sensor("x").userdata)),
        lambda spec: setattr(spec.body("work").parent, "name", "table"),
        lambda spec: spec.add_text(name="kinematics", data="serial"),
    ],
    ids=["damping", "time step", "gear", "encoder counts", "name of a body", "text"],
)
def test_what_the_author_states_counts(xy, edit):
    assert xy.edited(edit).digest != xy.digest


def test_exchanged_names_are_another_machine():
    """They say which joint is which axis, though all numbers of both are the same."""
    other = EVERYTHING.replace('joint name="x"', 'joint name="?"').replace('joint name="flex"', 'joint name="x"')
    other = other.replace('joint name="?"', 'joint name="flex"').replace('joint1="flex"', 'joint1="x"')
    other = other.replace('joint="x"', 'joint="flex"')
    exchanged = mujoco.MjSpec.from_string(other).compile()
    exchanged.actuator_actearly[:] = False
    assert np.array_equal(motion(exchanged), motion(everything()))
    assert digest_of(exchanged) != digest_of(everything())
