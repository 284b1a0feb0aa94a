"""Deliberate faults: what is to fail in a run, when, and by how much.

Times are those of the run. Faults of the encoder, the drive, the axis and the setpoints begin and end with a servo
tick, the first at or after their time; faults of the dispenser at their very time.

A file holds the faults of one part of the machine. A new fault is a class there, and its line in `AnyFault` below.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any, TypeAlias

from gantrysim.base.errors import InputError, unknown
from gantrysim.faults.axis import SlippingAxis, StuckAxis
from gantrysim.faults.dispenser import ATMOSPHERE, AirBubble, CloggedNozzle, DrippingNozzle
from gantrysim.faults.drive import BusSag, OpenWinding
from gantrysim.faults.encoder import EncoderDropout, EncoderGlitch, EncoderSlip
from gantrysim.faults.fault import InjectedFault
from gantrysim.faults.setpoints import LostPackets

# In the order in which they act on the same value: an encoder that stands still reports no glitch, an open winding has
# no voltage, and a clogged nozzle holds back its share of what drips too.
AnyFault: TypeAlias = (
    EncoderGlitch
    | EncoderSlip
    | EncoderDropout
    | StuckAxis
    | SlippingAxis
    | BusSag
    | OpenWinding
    | LostPackets
    | DrippingNozzle
    | AirBubble
    | CloggedNozzle
)

KINDS: dict[str, Any] = {  # the dataclasses by kind
    str(next(field.default for field in fields(fault) if field.name == "kind")): fault for fault in AnyFault.__args__
}


def in_acting_order(faults: Any) -> list[InjectedFault]:
    """Return faults in the order in which they act on the same value; those of one kind as they are given."""
    kinds = list(KINDS)
    return sorted(faults, key=lambda fault: kinds.index(fault.kind))


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
