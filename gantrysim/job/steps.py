"""Steps that steppers in open loop lose in a run."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gantrysim.base.quantity import number_text
from gantrysim.job.basis import Basis
from gantrysim.machine.machine import Machine
from gantrysim.record.run import Run
from gantrysim.servo.servo import Servo

_FULL_STEPS = 4  # per electrical period

_ASSIGNED = (
    "The setpoints state no progress along the requested path: each was given the place of the path that fits the "
    "whole trace best, which takes long; see `Setpoints.progress`."
)


class LostSteps(NamedTuple):
    """Steps that an axis has lost: its rotor has come to rest whole electrical periods from where the field is.

    Attributes:
        axis: its name.
        steps: full steps lost at the end, a multiple of 4; negative where the rotor is ahead.
        most: largest number at any time, without sign.
        time: when the first were lost [s].
        offset: distance by which the axis lags at the end because of them [mm or deg].
        unit: of the offset.
    """

    axis: str
    steps: int
    most: int
    time: float
    offset: float
    unit: str

    def __str__(self) -> str:
        offset = number_text(self.offset, "+.4g")
        text = f"{abs(self.steps)}, {offset} {self.unit} from its command" if self.steps else "none"
        return (
            f"stepper {self.axis} lost up to {self.most} full steps, the first at t = {self.time:.4f} s, at the end "
            f"{text}: lower acceleration or speed, or raise the current or the bus voltage"
        )


def lost_steps(machine: Machine, servo: Servo, run: Run) -> tuple[LostSteps, ...]:
    """Return what steppers in open loop have lost; the field follows the command by one servo period."""
    lost = []
    for a, (axis, mode) in enumerate(zip(machine.axes, servo.modes, strict=True)):
        if mode != "stepper":
            continue
        period = axis.electrical_period
        commanded = run.commanded[:, a]
        field = np.append(commanded[:1], commanded[:-1])
        behind = np.rint((field - run.motor[:, a]) / period).astype(int)
        if behind.any():
            first = float(run.time[np.flatnonzero(behind)[0]])
            most = int(np.abs(behind).max())
            last = int(behind[-1])
            lost.append(
                LostSteps(axis.name, _FULL_STEPS * last, _FULL_STEPS * most, first, -last * period + 0.0, axis.unit)
            )
    return tuple(lost)


def run_notes(job: Basis, run: Run) -> tuple[str, ...]:
    """Return the notes of a job, those on the steps that were lost in its run, and on where its errors are taken."""
    notes = (*job.notes, *map(str, lost_steps(job.built_machine, job.built_servo, run)))
    return notes if run.progress is not None else (*notes, _ASSIGNED)
