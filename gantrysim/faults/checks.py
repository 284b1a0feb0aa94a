"""Deliberate faults of tables, and checked against a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gantrysim.base.errors import InputError, unknown
from gantrysim.faults import KINDS
from gantrysim.faults.fault import InjectedFault


def fault_of(table: Any) -> InjectedFault:
    """Return the fault of a table of its values.

    Raises:
        InputError: an unknown kind, or a value out of bounds.
        TypeError: a value that is missing, or an unknown one.
    """
    if not isinstance(table, dict):
        raise InputError(f"fault {table!r}: must be a table of its values")
    kind = str(table.get("kind"))
    if kind not in KINDS:
        raise unknown("fault", kind, KINDS)
    fault: InjectedFault = KINDS[kind](**table)
    return fault


def check_faults(
    faults: Sequence[InjectedFault], machine: str, axes: Sequence[str], longest: float
) -> tuple[InjectedFault, ...]:
    """Return faults, checked against a run, in their order.

    Args:
        faults: the faults.
        machine: name of the machine, for messages.
        axes: names of its axes.
        longest: longest duration of the run [s].

    Raises:
        InputError: one that is no fault, of an axis that the machine does not have, or after the end of the run.
    """
    for fault in faults:
        if not isinstance(fault, InjectedFault):
            raise InputError(f"faults: holds a {type(fault).__name__}: must be faults such as {', '.join(KINDS)}")
        axis = getattr(fault, "axis", None)
        if axis is not None and axis not in axes:
            raise InputError(f"fault {fault.kind}: axis = {axis!r}: machine {machine} has {', '.join(axes)}")
        if fault.time > longest:
            raise InputError(
                f"fault {fault.kind}: time = {fault.time:g} s: must be at most {longest:g} s, the run's length"
            )
    return tuple(faults)
