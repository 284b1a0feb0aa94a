"""The field of a stepper, or the reference of a drive in position mode, on its way between setpoints."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

import numpy as np

from gantrysim.base.jit import jit


@jit
def turn_target(row, axis, drive):
    """Take the setpoint that is due at this physics step as the target."""
    if row.phase == row.delay % row.substeps:
        drive.came_from = drive.start if drive.logged > 0 else drive.target
        drive.start = drive.target
        drive.target = row.commanded[axis]
        if row.delay == row.substeps:
            drive.target = drive.next
            drive.next = row.commanded[axis]


@jit
def field_at(row, drive, share):
    """Return where the field is at a share of a physics step, on its way from the last setpoint to this one [u]."""
    begun = (row.phase - row.delay) % row.substeps + share
    if begun < 0.0:
        return drive.start + (drive.start - drive.came_from) * begun / row.substeps
    return drive.start + (drive.target - drive.start) * begun / row.substeps


@jit
def stepped(field, drive):
    """Return a field in microsteps."""
    return drive.microstep * np.floor(field / drive.microstep + 0.5)


@jit
def mean_stepped(low, high, drive):
    """Return the mean of a field in microsteps while it goes from one place to another.

    With the integral of floor(w), n w - n (n + 1) / 2 where n = floor(w), from the first microstep on.
    """
    steps = (high - low) / drive.microstep
    begin = low / drive.microstep + 0.5
    first = np.floor(begin)
    begin -= first
    end = begin + steps
    if np.floor(end) == 0.0:
        return drive.microstep * first
    whole = np.floor(end)
    return drive.microstep * (first + (whole * end - 0.5 * whole * (whole + 1.0)) / steps)
