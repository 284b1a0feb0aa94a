"""Stages of the servo tick that only some runs need, each compiled on its own and called by its address.

The tick itself is encoder, PID and clamp. What else a run has, its laws, drives and deliberate faults, hangs on points
of the tick: the row has a table of C functions for each point, and the tick calls them one after the other. So a run
compiles what it uses and no more, and any mixture of laws, drives and faults is there at once.

A stage at the point "drive" adds the forces that it applies to `row.applied`. They last for one physics step.
"""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from gantrysim.base.jit import c_function, jit
from gantrysim.engine.native.pointers import call, stages_of
from gantrysim.machine.row import POINTS, STAGE


class Body(NamedTuple):
    """A function that acts in the tick.

    Attributes:
        kind: its arguments: "base" of (row, axis, gains), which returns torque and integral, "laws" of (row, laws),
            "drives" of (row, tape, axis, drive), "tape" of (row, tape).
        function: the function.
    """

    kind: str
    function: Any


class Stage(NamedTuple):
    """A part of the tick that one run has.

    Attributes:
        point: of the tick at which it runs, one of `POINTS`.
        address: of the C function (row, argument).
        argument: for the function, as a rule the address of an array that the run keeps alive.
        body: what it compiles, for a device that knows no addresses; None where a device cannot have it.
    """

    point: str
    address: int
    argument: int = 0
    body: Body | None = None


def compiled_stage(function: Any) -> int:
    """Return the address of a stage, a function of the address of a servo's row and its argument."""
    return int(c_function(function, types.void(types.int64, types.int64)).address)


def arm(row: Any, stages: list[Stage]) -> NDArray[np.void]:
    """Write stages into a servo's row; those of one point run in the order of the list.

    Returns:
        The table, which must be kept alive as long as the row.
    """
    ordered = sorted(stages, key=lambda stage: POINTS.index(stage.point))
    table = np.array([(stage.address, stage.argument) for stage in ordered], STAGE)
    numbers = [POINTS.index(stage.point) for stage in ordered]
    row["stages"] = table.ctypes.data if stages else 0
    row["stage_until"] = np.searchsorted(numbers, np.arange(len(POINTS)), side="right")
    return table


@jit
def has_stages(row, point):
    """Return whether there are stages at a point of the tick, given by its number."""
    begin = row.stage_until[point - 1] if point > 0 else 0
    return row.stage_until[point] > begin


@jit
def run_stages(row, tape, point):
    """Run the stages of a point of the tick, given by its number; they find the tape by the row."""
    begin = row.stage_until[point - 1] if point > 0 else 0
    end = row.stage_until[point]
    if end > begin:
        stages = stages_of(row)
        for k in range(begin, end):
            call(stages[k].address, row.address, stages[k].argument)
