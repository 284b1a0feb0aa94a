"""The servo part of the error by axis: whose following error moves the nozzle off the path."""

from __future__ import annotations

from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats, dot
from gantrysim.base.columns import blocks, table_by_blocks
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.parts import Part

_NO_MOTION = 1e-9  # shortest displacement that has a direction [mm]


class ForwardKinematics(Protocol):
    """Kinematics of a machine."""

    def tip(self, position: ArrayLike) -> Floats:
        """Return the nozzle in the work frame, (n, 3) [mm], at axis positions, (n, axes) [mm or deg]."""
        ...


def servo_by_axis(analysis: Analysis, servo: Part, machine: ForwardKinematics) -> dict[str, Part]:
    """Return each axis' contribution to the servo part, see `Budget.servo_by_axis`.

    Args:
        analysis: of the run.
        servo: part of the error between command and encoder.
        machine: the machine of the run.
    """
    run = analysis.run
    ticks = analysis.ticks

    @lru_cache(maxsize=1)  # a block's normals serve all axes
    def normals(first: int, last: int) -> tuple[Floats, Floats, Floats]:
        return _normals(analysis, servo, slice(first, last))

    def part(a: int, block: slice) -> Part:
        lateral, vertical, beyond = normals(block.start, block.stop)
        position = run.commanded[ticks[block]]
        position[:, a] = run.encoder[ticks[block], a]
        shift = machine.tip(position) - run.commanded_tip[ticks[block]]
        return Part(dot(shift, lateral), dot(shift, vertical), dot(shift, beyond))

    return {
        name: table_by_blocks((part(a, block) for block in blocks(ticks.size)), ticks.size)
        for a, name in enumerate(run.axes)
    }


def _normals(analysis: Analysis, servo: Part, block: slice) -> tuple[Floats, Floats, Floats]:
    """Return the directions along which a displacement counts as lateral, vertical and beyond, (n, 3) each."""
    run = analysis.run
    path = run.requested
    s = analysis.commanded.s[block]
    lateral = path.normal(s)
    vertical = np.cross(path.tangent(s), lateral)
    beyond = np.zeros_like(lateral)
    if not path.corners.size:
        return lateral, vertical, beyond
    # the frame turns between the feet of two points with a corner between them: no one normal fits both
    corner = path.legs.between(s, analysis.encoder.s[block])
    corner |= path.legs.between(s, analysis.nozzle.s[block])
    rows = np.flatnonzero(corner)
    corner_ticks = analysis.ticks[block][rows]
    displacement = run.encoder_tip[corner_ticks] - run.commanded_tip[corner_ticks]
    square = np.maximum(dot(displacement, displacement), _NO_MOTION**2)
    present = servo.at(block)
    for normal, component in ((lateral, present.lateral), (vertical, present.vertical), (beyond, present.beyond)):
        missing = component[rows] - dot(normal[rows], displacement)
        normal[rows] += (missing / square)[:, None] * displacement
    return lateral, vertical, beyond
