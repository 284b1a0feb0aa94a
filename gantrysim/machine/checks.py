"""What is doubtful about a machine at rest, and what to change."""

from __future__ import annotations

import mujoco
import numpy as np

from gantrysim.machine.machine import Machine

_GAP = 5.0  # of a nozzle above its work [mm]


def notes(machine: Machine) -> tuple[str, ...]:
    """Return a line for each contact at rest, and one for a nozzle that is not close above its work."""
    model = machine.model
    data = mujoco.MjData(model)
    data.qpos[:] = machine.to_qpos(np.zeros(len(machine.axes)))
    mujoco.mj_forward(model, data)
    found = []
    for contact in data.contact[: data.ncon]:
        if contact.dist <= 0:
            first, second = (_geom(model, int(one)) for one in contact.geom)
            found.append(
                f"machine {machine.name}: {first} and {second} touch with all axes at zero, by "
                f"{-1e3 * contact.dist:.3g} mm"
                ': move them apart, or give one contype="0" conaffinity="0"'
            )
    if not machine.over_work:
        found.append(
            f"machine {machine.name}: no geom of body 'work' lies below the nozzle with all axes at zero: a gap of "
            f"{machine.gap:g} mm is assumed; give 'work' a geom there"
        )
    elif machine.gap > _GAP:
        found.append(
            f"machine {machine.name}: the nozzle is {machine.gap:.3g} mm above its work with all axes at zero: lower "
            "the nozzle or raise the geom of body 'work', unless z takes it there"
        )
    return tuple(found)


def _geom(model: mujoco.MjModel, geom: int) -> str:
    name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, geom)
    if name:
        return f"geom {name!r}"
    body = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, int(model.geom_bodyid[geom]))
    return f"a geom of body {body!r}" if body else "a geom of a body without a name"
