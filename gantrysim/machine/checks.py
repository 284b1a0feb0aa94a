"""Doubtful states of a machine at rest, each with a remedy."""

from __future__ import annotations

import mujoco
import numpy as np

from gantrysim.machine.machine import Machine

_GAP = 5.0  # of a nozzle above its work [mm]
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
        if distance <= 0:  # MuJoCo lists pairs within their margin too
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
    elif machine.gap > _GAP:
        lines.append(
            f"machine {machine.name}: the nozzle is {machine.gap:.3g} mm above its work with all axes at zero: lower "
            "the nozzle or raise the geom of body 'work', unless z takes it there"
        )
    return tuple(lines)


def _geom(model: mujoco.MjModel, geom: int) -> str:
    name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, geom)
    if name:
        return f"geom {name!r}"
    body = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, int(model.geom_bodyid[geom]))
    return f"a geom of body {body!r}" if body else "a geom of a body without a name"
