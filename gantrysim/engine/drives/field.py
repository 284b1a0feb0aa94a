"""The field of a stepper, or the reference of a drive in position mode, on its way between setpoints."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

import numpy as np

from gantrysim.base.jit import jit
from gantrysim.engine.drives.part import DrivePart


@jit
def turn_target(row, axis, field, begun):
    """Take the setpoint that is due at this physics step as the target.

    Args:
        row: the servo's row.
        axis: number of the axis.
        field: its field.
        begun: whether the drive has run for a tick.
    """
    if row.phase == row.delay % row.substeps:
        field.came_from = field.start if begun else field.target
        field.start = field.target
        field.target = row.commanded[axis]
        if row.delay == row.substeps:
            field.target = field.next
            field.next = row.commanded[axis]


@jit
def field_at(row, field, share):
    """Return where the field is at a share of a physics step, on its way from the last setpoint to this one [u]."""
    begun = (row.phase - row.delay) % row.substeps + share
    if begun < 0.0:
        return field.start + (field.start - field.came_from) * begun / row.substeps
    return field.start + (field.target - field.start) * begun / row.substeps


@jit
def stepped_place(place, stepper):
    """Return the place of a field in microsteps."""
    return stepper.microstep * np.floor(place / stepper.microstep + 0.5)


@jit
def mean_stepped(low, high, stepper):
    """Return the mean of a field in microsteps while it goes from one place to another.

    With the integral of floor(w), n w - n (n + 1) / 2 where n = floor(w), from the first microstep on.
    """
    steps = (high - low) / stepper.microstep
    begin = low / stepper.microstep + 0.5
    first = np.floor(begin)
    begin -= first
    end = begin + steps
    if np.floor(end) == 0.0:
        return stepper.microstep * first
    whole = np.floor(end)
    return stepper.microstep * (first + (whole * end - 0.5 * whole * (whole + 1.0)) / steps)


FIELD = DrivePart(
    "field",
    [
        ("came_from", np.float64),  # start of the period before [u]
        ("start", np.float64),  # on its way to the target during a servo period [u]
        ("target", np.float64),  # [u]
        ("next", np.float64),  # target of the next period where the servo's delay is a whole one [u]
    ],
    lambda driven: {},
    (),
    lambda servo, entries: False,
)
