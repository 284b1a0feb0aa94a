"""A machine in plain boxes, cylinders and balls, and where they are during a run, in the frame of the work."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.machine.machine import NEEDLE, Machine
from gantrysim.machine.quiet import quiet

_MM = 1e3  # in a metre
_LEAST_RADIUS = 0.012  # of the ball around a geom; smaller parts, as bolts, are left out [m]
_NEXT = [1, 2, 0]  # coordinate after each, cyclically
_AFTER_NEXT = [2, 0, 1]
_AT_REST = 1e-9  # change of a joint's position below which it stands still [m or rad]

BOX = "box"
CYLINDER = "cylinder"
CAPSULE = "capsule"
BALL = "ball"
_KINDS = {
    int(mujoco.mjtGeom.mjGEOM_BOX): BOX,
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): CYLINDER,
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): CAPSULE,
    int(mujoco.mjtGeom.mjGEOM_SPHERE): BALL,
}
_WITHOUT_BODY = (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD))


@dataclass(frozen=True, eq=False)
class Solid:
    """A box, cylinder, capsule or ball of a machine; of a mesh or an ellipsoid the box around it.

    Attributes:
        kind: `BOX`, `CYLINDER`, `CAPSULE` or `BALL`.
        size: half lengths of a box; else radius and, along its z, half length without round ends, (3,) [mm].
        position: of its centre in the frame of its part, (3,) [mm].
        rotation: quaternion w, x, y, z in that frame, (4,).
        needle: whether it is the needle.
    """

    kind: str
    size: Floats
    position: Floats
    rotation: Floats
    needle: bool


@dataclass(frozen=True, eq=False)
class Part:
    """Solids of a machine that move together.

    Attributes:
        name: of the body that carries them.
        solids: the solids.
        position: of the part in the frame of the work in each pose, (poses, 3) [mm].
        rotation: quaternions w, x, y, z, neighbours with the same sign, (poses, 4).
    """

    name: str
    solids: tuple[Solid, ...]
    position: Floats
    rotation: Floats


def outline(machine: Machine, positions: Floats) -> list[Part]:
    """Return the parts of a machine at positions of its axes.

    Bodies between which no joint moves in these poses are one part.

    Args:
        machine: with the geoms of its MJCF; those within a ball of 12 mm are left out, but for the needle.
        positions: of the axes, (poses, axes) [mm or deg].
    """
    model = machine.model
    data = mujoco.MjData(model)
    qpos = machine.to_qpos(positions)
    carriers = _carriers(model, qpos)
    # of all bodies: to pick some of them in each pose takes longer
    places = np.empty((len(qpos), model.nbody, 3))
    turns = np.empty((len(qpos), model.nbody, 4))
    # views: each look at an attribute takes as long as a copy
    joints = data.qpos
    body_places = data.xpos
    body_turns = data.xquat
    with quiet():
        for k, pose in enumerate(qpos):
            joints[:] = pose
            mujoco.mj_kinematics(model, data)
            places[k] = body_places
            turns[k] = body_turns
    # seen from the work
    origin = places[:, machine.work]
    inverse = _inverse(turns[:, machine.work])
    parts = []
    for body, solids in sorted(_solids(model, data, carriers).items()):
        position = _MM * _rotated_vectors(places[:, body] - origin, inverse)
        rotation = _steady_sign(_product(inverse, turns[:, body]))
        parts.append(Part(model.body(body).name, tuple(solids), position, rotation))
    return parts


def _inverse(rotation: Floats) -> Floats:
    """Return the inverse of unit quaternions, (n, 4)."""
    return rotation * [1.0, -1.0, -1.0, -1.0]


def _product(first: Floats, second: Floats) -> Floats:
    """Return the products of quaternions w, x, y, z, (n, 4) each."""
    w = first[:, :1] * second[:, :1] - np.sum(first[:, 1:] * second[:, 1:], axis=1, keepdims=True)
    vector = first[:, :1] * second[:, 1:] + second[:, :1] * first[:, 1:] + _cross(first[:, 1:], second[:, 1:])
    return np.concatenate([w, vector], axis=1)


def _rotated_vectors(vectors: Floats, rotation: Floats) -> Floats:
    """Return vectors, (n, 3), turned by quaternions, (n, 4)."""
    # v' = v + 2 u x (u x v + w v) for the quaternion (w, u)
    u = rotation[:, 1:]
    return vectors + 2.0 * _cross(u, _cross(u, vectors) + rotation[:, :1] * vectors)


def _cross(first: Floats, second: Floats) -> Floats:
    """Return the products of vectors, (n, 3) each; NumPy's own function takes five times as long for a few hundred."""
    return first[:, _NEXT] * second[:, _AFTER_NEXT] - first[:, _AFTER_NEXT] * second[:, _NEXT]


def _carriers(model: mujoco.MjModel, qpos: Floats) -> NDArray[np.intp]:
    """Return the body with which each body moves: itself, or the next above it whose joints move, (bodies,)."""
    still = np.ptp(qpos, axis=0) < _AT_REST
    carriers = np.zeros(model.nbody, np.intp)
    ends = np.append(model.jnt_qposadr, model.nq)
    for body in range(1, model.nbody):
        first = model.body_jntadr[body]
        joints = slice(ends[first], ends[first + model.body_jntnum[body]]) if first >= 0 else slice(0)
        carriers[body] = carriers[model.body_parentid[body]] if still[joints].all() else body
    return carriers


def _solids(model: mujoco.MjModel, data: mujoco.MjData, carriers: NDArray[np.intp]) -> dict[int, list[Solid]]:
    """Return the solids of the bodies, as they are posed, by the body that carries them, and in its frame."""
    needle = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, NEEDLE)
    is_wanted = (model.geom_rbound >= _LEAST_RADIUS) | (np.arange(model.ngeom) == needle)
    geoms = np.flatnonzero(is_wanted & ~np.isin(model.geom_type, _WITHOUT_BODY))
    kinds = model.geom_type[geoms]
    centre = model.geom_pos[geoms]
    size = model.geom_size[geoms]
    turn = model.geom_quat[geoms]
    # the box around it, in the frame of the geom
    is_boxed = ~np.isin(kinds, list(_KINDS))
    box = model.geom_aabb[geoms[is_boxed]]
    centre[is_boxed] += _rotated_vectors(box[:, :3], turn[is_boxed])
    size[is_boxed] = box[:, 3:]
    body = model.geom_bodyid[geoms]
    carrier = carriers[body]
    inverse = _inverse(data.xquat[carrier])
    from_carrier = data.xpos[body] + _rotated_vectors(centre, data.xquat[body]) - data.xpos[carrier]
    position = _rotated_vectors(from_carrier, inverse)
    rotation = _product(inverse, _product(data.xquat[body], turn))
    solids: dict[int, list[Solid]] = {}
    for k, (of, kind, geom) in enumerate(zip(carrier.tolist(), kinds.tolist(), geoms.tolist(), strict=True)):
        solid = Solid(_KINDS.get(kind, BOX), _MM * size[k], _MM * position[k], rotation[k], geom == needle)
        solids.setdefault(of, []).append(solid)
    return solids


def _steady_sign(rotation: Floats) -> Floats:
    """Return quaternions, (n, 4), with the sign that keeps each near the one before."""
    products = np.sum(rotation[1:] * rotation[:-1], axis=1)
    signs = np.cumprod(np.concatenate([[1.0], np.where(products < 0, -1.0, 1.0)]))
    return rotation * signs[:, None]
