"""Deliberate faults as stages of the servo tick."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from functools import cache
from typing import Any

import numba

from gantrysim.engine.native.parts import with_parts
from gantrysim.engine.native.pointers import pointer, row_at
from gantrysim.engine.native.stages import compiled_stage
from gantrysim.machine.row import FAULT

_FAULT = numba.from_dtype(FAULT)


@cache
def fault_stage(function: Any) -> int:
    """Return the address of a fault's function of row and entry as a stage; its argument is the entry's address."""
    return compiled_stage(with_parts(_act, act=function))


def act(row, fault):
    """Stand for the function of a fault."""
    raise NotImplementedError


def _act(row, argument):
    act(row_at(row), numba.carray(pointer(argument, _FAULT), (1,))[0])
