"""What grbl, whose programs are read as LinuxCNC's, refuses of them."""

from __future__ import annotations

import numpy as np

from gantrysim.controllers.gcode.interpret import Interpreted
from gantrysim.controllers.gcode.move_table import ARC, CENTRE, END, KIND, PLANE, PLANES, SOURCE

# grbl 1.1, gcode.c: differences of the radii at an arc's ends
_ACCEPTED = 0.005  # [mm]
_MOST = 0.5  # [mm]
_RELATIVE = 1e-3  # of the radius at the start


def refused_by_grbl(program: Interpreted) -> tuple[str, ...]:
    """Return a note on the arcs whose ends are so far off their circles that grbl refuses them, by the worst."""
    table = program.moves
    rows = np.flatnonzero(table[:, KIND] == ARC)
    if not rows.size:
        return ()
    places = np.concatenate([[program.start], table[:, END : END + 3]])
    axes = np.array(PLANES)[table[rows, PLANE].astype(int), :2]
    centre = table[rows, CENTRE : CENTRE + 2]
    start = np.take_along_axis(places[rows], axes, axis=1)
    end = np.take_along_axis(places[rows + 1], axes, axis=1)
    radius = np.hypot(*(start - centre).T)
    off = np.abs(np.hypot(*(end - centre).T) - radius)
    refused = (off > _MOST) | ((off > _ACCEPTED) & (off > _RELATIVE * radius))
    if not refused.any():
        return ()
    worst = int(np.where(refused, off, 0.0).argmax())
    return (
        f"{refused.sum()} arcs end off their circle, by {off[worst]:.3g} mm in line {table[rows[worst], SOURCE]:.0f}: "
        f"run as LinuxCNC runs them, but grbl refuses more than {_ACCEPTED:g} mm and {100 * _RELATIVE:g} % of the "
        "radius.",
    )
