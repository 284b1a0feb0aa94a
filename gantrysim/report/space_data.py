"""What the page's 3-D view needs beside the columns of the viewer: the bead's height and the machine's poses.

Only jobs whose bead leaves a plane have the view, see `gantrysim.glue.bead.climb`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.glue.bead import Bead
from gantrysim.machine.outline import Part, Solid, outline
from gantrysim.record.run import Run
from gantrysim.report.encoding import encoded
from gantrysim.results.run_results import RunResults

POSES = 800  # of the machine in a run, between which the page interpolates by cubics
_CONSTANT = 1e-6  # extent of a coordinate below which it is one number [mm, or of a quaternion]


def space_content(results: RunResults) -> dict[str, Any]:
    """Return the gap, and the machine in poses at ticks evenly spread over the run.

    The gap between nozzle and surface is in mm, positions and sizes of the machine are in mm in the frame of the work.
    """
    run = results.budget.analysis.run
    ticks = pose_ticks(run)
    parts = outline(results.machine, run.encoder[ticks])
    gap = run.gap if results.bead is None else results.bead.gap
    return {"gap": gap, "poses": int(ticks.size), "parts": [_part_content(part) for part in parts]}


def pose_ticks(run: Run) -> NDArray[np.intp]:
    """Return the ticks of the poses, evenly spread and no more than the run has, (poses,)."""
    last = len(run.time) - 1
    return np.rint(np.linspace(0, last, min(POSES, last + 1))).astype(np.intp)


def bead_height(bead: Bead, rows: NDArray[np.intp]) -> Floats:
    """Return the height of the bead below the nozzle at ticks of the run, (m,) [mm]."""
    return np.interp(bead.length[rows], bead.place, bead.height)


def _part_content(part: Part) -> dict[str, Any]:
    return {
        "name": part.name,
        "solids": [_solid_content(solid) for solid in part.solids],
        "pose": [_coordinate_content(values) for values in (*part.position.T, *part.rotation.T)],
    }


def _solid_content(solid: Solid) -> list[Any]:
    """Return kind, size, position, rotation and whether it is the needle in a row, within 0.01 mm."""
    lengths = np.round([*solid.size, *solid.position], 2).tolist()
    return [solid.kind, *lengths, *np.round(solid.rotation, 4).tolist(), solid.needle]


def _coordinate_content(values: Floats) -> Any:
    if np.ptp(values) < _CONSTANT:
        return round(float(values[0]), 6)
    return encoded(values)
