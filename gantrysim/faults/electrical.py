"""What electrical faults need of an axis: a drive whose voltage the servo tick sets."""

from __future__ import annotations

from collections.abc import Sequence

from gantrysim.base.errors import InputError
from gantrysim.faults.fault import FaultAxis


def check_electrical(kind: str, axis: FaultAxis) -> None:
    """Raise InputError for an axis whose actuator has a delay of its own, so that the tick does not set its voltage."""
    if axis.delayed:
        raise InputError(f"fault {kind}: machine {axis.machine} has an actuator with a delay of its own")


def spared(kind: str, axis: FaultAxis, axes: Sequence[FaultAxis], *, named: bool) -> bool:
    """Return whether a fault of all axes leaves out one, a stepper in open loop among servo axes.

    Raises:
        InputError: the fault is one of steppers in open loop alone.

    Args:
        kind: of the fault.
        axis: the axis.
        axes: all axes of the machine.
        named: whether the fault names the axis.
    """
    if axis.mode != "stepper":
        return False
    if not named and any(other.mode != "stepper" for other in axes):
        return True
    raise InputError(f"fault {kind}: axis {axis.name} is a stepper in open loop; of a servo axis only")
