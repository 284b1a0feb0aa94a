"""Springs between the motors and their loads, and the axes that they belong to."""

from __future__ import annotations

import mujoco


def driven_joints(model: mujoco.MjModel) -> list[int]:
    """Return the index of each axis' joint, in the order of the actuators."""
    joints: list[int] = model.actuator_trnid[:, 0].tolist()
    return joints


def springs_have_axes(model: mujoco.MjModel) -> bool:
    """Return whether each axis can have its own stiffness factor: there is one axis, or one for every spring."""
    if model.nactuator == 1:
        return True
    joints_have = all(axis_above(model, spring) is not None for spring in spring_joints(model))
    return joints_have and all(len(axes_of_tendon(model, tendon)) == 1 for tendon in elastic_tendons(model))


def spring_of(model: mujoco.MjModel, axis: int) -> str | None:
    """Return the name of the first spring joint that an axis carries with no other axis between, or None.

    Args:
        model: the compiled model.
        axis: index of the axis.
    """
    for spring in spring_joints(model):
        if axis_above(model, spring) == axis:
            return mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, spring)
    return None


def elastic_tendons(model: mujoco.MjModel) -> list[int]:
    """Return the tendons that are springs."""
    return [tendon for tendon in range(model.ntendon) if model.tendon_stiffness[tendon] > 0]


def wraps_of(model: mujoco.MjModel, tendon: int) -> range:
    """Return the indices of a tendon's path elements."""
    first = int(model.tendon_adr[tendon])
    return range(first, first + int(model.tendon_num[tendon]))


def axes_of_tendon(model: mujoco.MjModel, tendon: int) -> set[int]:
    """Return the axes whose joints a fixed tendon couples."""
    driven = driven_joints(model)
    axes = set()
    for wrap in wraps_of(model, tendon):
        joint = int(model.wrap_objid[wrap])
        if model.wrap_type[wrap] == mujoco.mjtWrap.mjWRAP_JOINT and joint in driven:
            axes.add(driven.index(joint))
    return axes


def spring_joints(model: mujoco.MjModel) -> list[int]:
    """Return the joints with stiffness that no axis drives."""
    driven = driven_joints(model)
    return [joint for joint in range(model.njnt) if joint not in driven and model.jnt_stiffness[joint] > 0]


def axis_above(model: mujoco.MjModel, joint: int) -> int | None:
    """Return the index of the axis whose joint is next above a joint in the tree, or None."""
    driven = driven_joints(model)
    body = int(model.jnt_bodyid[joint])
    below = joint
    while body:
        first = int(model.body_jntadr[body])
        count = int(model.body_jntnum[body])
        # of the joints of one body, each carries those that follow it
        for other in reversed(range(first, first + count)):
            if other < below and other in driven:
                return driven.index(other)
        body = int(model.body_parentid[body])
        below = model.njnt
    return None
