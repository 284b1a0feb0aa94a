"""Doubtful states of a machine at rest, each with a remedy."""

from __future__ import annotations

import mujoco
import numpy as np

from gantrysim.machine.axis import PER_SI
from gantrysim.machine.machine import Machine

_GAP = 5.0  # of a nozzle above its work [mm]
_TOUCHING_DEPTH = 1e-3  # depth up to which the nozzle stands on the work's surface [mm]
_WEIGHTLESS_SHARE = 1e-6  # share of the whole machine's weight, below which an axis' part of it is rounding
_MOST_PAIRS = 3  # of geoms that touch, of which each has a line


def notes(machine: Machine) -> tuple[str, ...]:
    """Return a line for each of the geoms that touch deepest at rest, and for a nozzle not close above its work."""
    model = machine.model
    data = mujoco.MjData(model)
    data.qpos[:] = machine.to_qpos(np.zeros(len(machine.axes)))
    mujoco.mj_forward(model, data)
    lines = []
    depth: dict[tuple[int, int], float] = {}
    pairs = data.contact.geom.tolist()
    for (first, second), distance in zip(pairs, data.contact.dist.tolist(), strict=True):
        # MuJoCo lists pairs within their margin too
        if distance <= 0:
            depth[first, second] = max(depth.get((first, second), 0.0), -distance)
    for first, second in sorted(depth, key=lambda pair: -depth[pair])[:_MOST_PAIRS]:
        lines.append(
            f"machine {machine.name}: {_geom(model, first)} and {_geom(model, second)} touch with all axes at zero, by "
            f"{1e3 * depth[first, second]:.3g} mm"
            ': move them apart, or give one contype="0" conaffinity="0"'
        )
    if len(depth) > _MOST_PAIRS:
        lines.append(
            f"machine {machine.name}: {len(depth)} pairs of geoms touch with all axes at zero, of which the "
            f"{_MOST_PAIRS} deepest are listed"
        )
    if not machine.over_work:
        lines.append(
            f"machine {machine.name}: no geom of body 'work' lies below the nozzle with all axes at zero: a gap of "
            f"{machine.gap:g} mm is assumed; give 'work' a geom there"
        )
    elif machine.depth_in_work is not None:
        where = (
            f"{machine.depth_in_work:.3g} mm inside" if machine.depth_in_work > _TOUCHING_DEPTH else "on the surface of"
        )
        lines.append(
            f"machine {machine.name}: the nozzle is {where} its work with all axes at zero: a gap of "
            f"{machine.gap:g} mm is assumed; raise the nozzle, or lower the geom of body 'work'"
        )
    elif machine.gap > _GAP:
        lines.append(
            f"machine {machine.name}: the nozzle is {machine.gap:.3g} mm above its work with all axes at zero: lower "
            "the nozzle or raise the geom of body 'work', unless z takes it there"
        )
    slippery = [axis.name for a, axis in enumerate(machine.axes) if axis.coulomb == 0 and not _has_loss(model, a)]
    if slippery:
        lines.append(
            f"machine {machine.name}: no dry friction on {', '.join(slippery)}: errors at reversals and the torque "
            "that friction takes are 0; give guides.friction in a table, frictionloss or dcmotor's friction in an MJCF"
        )
    rotors = [axis.name for a, axis in enumerate(machine.axes) if _lacks_rotor(model, a)]
    if rotors:
        lines.append(
            f"machine {machine.name}: no rotor inertia on {', '.join(rotors)}: the motors accelerate the load alone, "
            "too fast; give the dcmotor its armature, in kg·m²"
        )
    return tuple(lines)


def _has_loss(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether MuJoCo's own dry friction acts on the joint of an actuator, or on any joint where it drives a tendon."""
    if model.actuator_trntype[actuator] != mujoco.mjtTrn.mjTRN_JOINT:
        return bool(model.dof_frictionloss.any())
    return joint_friction(model, actuator) > 0


def joint_friction(model: mujoco.MjModel, actuator: int) -> float:
    """Return MuJoCo's own dry friction of the joint that an actuator drives, at the motor [N·m]; 0 for a tendon's."""
    if model.actuator_trntype[actuator] != mujoco.mjtTrn.mjTRN_JOINT:
        return 0.0
    dof = model.jnt_dofadr[model.actuator_trnid[actuator, 0]]
    return float(model.dof_frictionloss[dof] / abs(model.actuator_gear[actuator, 0]))


def shaft_inertia(model: mujoco.MjModel, actuator: int) -> float:
    """Return the inertia at the motor's shaft that the MJCF gives an actuator and, reflected, its joint [kg·m²]."""
    at_shaft = float(model.actuator_armature[actuator])
    if model.actuator_trntype[actuator] != mujoco.mjtTrn.mjTRN_JOINT:
        return at_shaft
    dof = model.jnt_dofadr[model.actuator_trnid[actuator, 0]]
    return at_shaft + float(model.dof_armature[dof] / model.actuator_gear[actuator, 0] ** 2)


def _lacks_rotor(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether a DC motor drives a slide without any inertia of its own; a hinge may itself be the rotor."""
    if model.actuator_gaintype[actuator] != mujoco.mjtGain.mjGAIN_DCMOTOR:
        return False
    joint = model.actuator_trnid[actuator, 0]
    is_joint = model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT
    slides = is_joint and model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
    return bool(slides) and shaft_inertia(model, actuator) == 0


def weights(machine: Machine) -> dict[str, float]:
    """Return the motor torque that holds the weight on each axis with all axes at zero, by name [N·m].

    Axes without such a torque are left out, and those whose actuators drive no joint of a tree directly.
    """
    model = machine.model
    if model.neq or model.ntendon:
        return {}
    data = mujoco.MjData(model)
    data.qpos[:] = machine.to_qpos(np.zeros(len(machine.axes)))
    mujoco.mj_forward(model, data)
    # of gravity, less gravcomp and springs
    held = data.qfrc_bias - data.qfrc_passive
    whole = float(model.body_mass.sum() * np.linalg.norm(model.opt.gravity))
    torques = {}
    for a, axis in enumerate(machine.axes):
        if model.actuator_trntype[a] != mujoco.mjtTrn.mjTRN_JOINT:
            continue
        dof = int(model.jnt_dofadr[model.actuator_trnid[a, 0]])
        if abs(held[dof]) > _WEIGHTLESS_SHARE * whole:
            torques[axis.name] = float(held[dof]) * axis.scale / PER_SI[axis.unit]
    return torques


def _geom(model: mujoco.MjModel, geom: int) -> str:
    name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, geom)
    if name:
        return f"geom {name!r}"
    body = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, int(model.geom_bodyid[geom]))
    return f"a geom of body {body!r}" if body else "a geom of a body without a name"
