"""The nozzle as the model shows it: height above the work, size of the needle."""

from __future__ import annotations

import mujoco
import numpy as np

from gantrysim.machine.quiet import quiet

_MM = 1e3
_ROUND = (int(mujoco.mjtGeom.mjGEOM_CAPSULE), int(mujoco.mjtGeom.mjGEOM_CYLINDER))


def height_above(model: mujoco.MjModel, nozzle: int, work: int) -> float | None:
    """Return the height of the nozzle above the work at the model's reference, None if none of it lies below [mm].

    Args:
        model: the compiled model, with its visual elements.
        nozzle: index of the site.
        work: index of the body.
    """
    data = mujoco.MjData(model)
    with quiet():
        mujoco.mj_forward(model, data)
    geom = np.full(1, -1, np.int32)
    up = data.xmat[work].reshape(3, 3)[:, 2]
    above = data.xpos[work] + up * (up @ (data.site_xpos[nozzle] - data.xpos[work]))
    distance = mujoco.mj_ray(model, data, above, -up, None, 1, int(model.site_bodyid[nozzle]), geom, None)
    if geom[0] < 0:
        return None
    hit = int(model.geom_bodyid[geom[0]])
    weld = model.body_weldid
    # a work that is a mere frame has the geoms of the body that it is part of
    on_work = hit == work or (model.body_geomnum[work] == 0 and weld[hit] == weld[work])
    return _MM * float(distance) if on_work else None


def needle_size(model: mujoco.MjModel, nozzle: int, name: str) -> tuple[float, float] | None:
    """Return outer diameter and length of the needle that the model draws, None without a round geom [mm].

    Args:
        model: the compiled model, with its visual elements.
        nozzle: index of the site, on whose body the needle is.
        name: of the geom.
    """
    geom = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name)
    if geom < 0 or model.geom_bodyid[geom] != model.site_bodyid[nozzle] or model.geom_type[geom] not in _ROUND:
        return None
    radius, half_length, _ = model.geom_size[geom]
    return 2 * _MM * float(radius), 2 * _MM * float(half_length)
