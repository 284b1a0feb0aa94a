"""A drawing of a machine for a notebook: its solids in parallel projection, farthest first."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.display import svg_picture
from gantrysim.machine.quiet import quiet

_MM = 1e3
_SIDES = 12  # of a drawn circle
_LEAST_SIZE = 0.003  # half the longest edge below which a solid is left out [m]
_ROUND_GEOMS = (int(mujoco.mjtGeom.mjGEOM_CYLINDER), int(mujoco.mjtGeom.mjGEOM_CAPSULE))
_WITHOUT_BODY = (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD))

# seen from the front, from the right and from above
_TURN = np.radians(-30.0)
_TILT = np.radians(25.0)
_RIGHT = np.array([np.cos(_TURN), -np.sin(_TURN), 0.0])
_VIEW_DIRECTION = np.array([np.cos(_TILT) * np.sin(_TURN), np.cos(_TILT) * np.cos(_TURN), -np.sin(_TILT)])
_VIEW_UP = np.cross(_RIGHT, _VIEW_DIRECTION)
_LIGHT_DIRECTION = np.array([0.2, -0.45, 0.87])

# corners of a box of half lengths 1, and of its six faces in a round
_CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
_FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
_NORMALS = np.array([(-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0), (0, 0, -1), (0, 0, 1)], float)


def scheme(model: mujoco.MjModel, qpos: Floats, title: str) -> str:
    """Return a machine as an SVG element.

    Args:
        model: with its visual elements.
        qpos: positions of its joints, (nq,).
        title: what it shows.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    with quiet():
        mujoco.mj_kinematics(model, data)
    polygons = sorted(_polygons(model, data), key=lambda polygon: polygon[0], reverse=True)
    points = np.concatenate([corners for _, corners, _ in polygons])
    low = points.min(axis=0)
    extent = np.ptp(points, axis=0)
    line = float(extent.max()) / 600
    drawn = "".join(
        f'<polygon points="{" ".join(f"{x:.1f},{y:.1f}" for x, y in corners.tolist())}" fill="{colour}"/>'
        for _, corners, colour in polygons
    )
    content = f'<g stroke="#1b1f24" stroke-width="{line:.3g}" stroke-linejoin="round">{drawn}</g>'
    return svg_picture(content, (*low.tolist(), *extent.tolist()), title)


def _polygons(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[tuple[float, Floats, str]]:
    """Yield distance, corners in the picture, (k, 2) [mm], and colour of every face that is seen."""
    from scipy.spatial import ConvexHull, QhullError  # slow to import

    for geom in range(model.ngeom):
        kind = int(model.geom_type[geom])
        half = model.geom_aabb[geom, 3:]
        rgba = model.mat_rgba[model.geom_matid[geom]] if model.geom_matid[geom] >= 0 else model.geom_rgba[geom]
        if kind in _WITHOUT_BODY or half.max() < _LEAST_SIZE or rgba[3] == 0:
            continue
        centre = data.geom_xpos[geom]
        turn = data.geom_xmat[geom].reshape(3, 3)
        middle = centre + turn @ model.geom_aabb[geom, :3]
        if kind in _ROUND_GEOMS:
            corners = centre + _ring(model.geom_size[geom]) @ turn.T
            try:
                seen = ConvexHull(_MM * corners @ np.stack([_RIGHT, _VIEW_UP], axis=1))
            except QhullError:  # of no extent in the picture
                continue
            yield float(middle @ _VIEW_DIRECTION), seen.points[seen.vertices], _shade(rgba, -_VIEW_DIRECTION)
            continue
        corners = middle + (_CORNERS * half) @ turn.T
        for face, normal in zip(_FACES, _NORMALS @ turn.T, strict=True):
            if normal @ _VIEW_DIRECTION < 0:
                places = corners[list(face)]
                picture = _MM * places @ np.stack([_RIGHT, _VIEW_UP], axis=1)
                yield float(places.mean(axis=0) @ _VIEW_DIRECTION), picture, _shade(rgba, normal)


def _ring(size: Floats) -> Floats:
    """Return the rims of a cylinder along z, (2 sides, 3)."""
    angles = np.linspace(0.0, 2 * np.pi, _SIDES, endpoint=False)
    rim = size[0] * np.stack([np.cos(angles), np.sin(angles), np.zeros(_SIDES)], axis=1)
    half = np.array([0.0, 0.0, size[1]])
    return np.concatenate([rim + half, rim - half])


def _shade(rgba: Floats, normal: Floats) -> str:
    """Return the colour of a face in the light."""
    light = 0.65 + 0.35 * max(float(normal @ _LIGHT_DIRECTION), 0.0)
    return "#" + bytes(np.round(255 * np.clip(light * rgba[:3], 0, 1)).astype(np.uint8).tolist()).hex()
