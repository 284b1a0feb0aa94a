"""A part of a drive: its record, what an axis has of it, and what it does in the servo tick."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from gantrysim.machine.axis import Axis, fact
from gantrysim.machine.machine import Machine
from gantrysim.machine.model_arrays import ModelArrays
from gantrysim.servo.drive_settings import DriveSettings
from gantrysim.servo.servo import Servo

TORQUE, VELOCITY, POSITION, STEPPER = range(4)  # modes of a drive
MODE_NUMBERS = {"torque": TORQUE, "velocity": VELOCITY, "position": POSITION, "stepper": STEPPER}


@dataclass(frozen=True, eq=False)
class DrivenAxis:
    """An axis with its drive in a run.

    Attributes:
        machine: its machine.
        servo: its servo.
        number: of the axis.
        step: physics step [s].
    """

    machine: Machine
    servo: Servo
    number: int
    step: float

    @property
    def axis(self) -> Axis:
        """The axis."""
        return self.machine.plain_axes[self.number]

    @property
    def drive(self) -> DriveSettings:
        """Its drive and encoder, as the servo knows them."""
        return self.servo.drives[self.number]

    @property
    def model(self) -> mujoco.MjModel | ModelArrays:
        """The machine's compiled MJCF, or its arrays."""
        return self.machine.arrays

    @property
    def gain(self) -> float:
        """Torque of the motor, of that which its drive means to give."""
        return float(self.machine.drive_gain[self.number])

    @property
    def joint(self) -> int:
        """The joint that the motor turns or pushes."""
        return int(self.machine.layout.actuator_trnid[self.number, 0])

    @property
    def load(self) -> int:
        """The joint of the load on its spring; -1 where the axis has no single one."""
        return self.machine.addresses[self.number].load

    def stated(self, name: str, default: float) -> float:
        """Return a value of a custom numeric of the MJCF that has one per actuator."""
        return fact(self.model, name, self.number, default)


@dataclass(frozen=True, eq=False)
class DrivePart:
    """A part of a drive.

    Its functions in the tick take (row, tape, axis, drive): the row of the servo, with the machine's state, the tape of
    the run, the number of the axis, and its drive, a record with one record per part. They are compiled.

    Attributes:
        name: of its record in a drive's.
        record: its fields.
        entry: from an axis to the values of its fields at the start; those that are missing are 0.
        acts: points of the tick, see `gantrysim.machine.row`, and the function that runs there for every axis.
        needed: whether a run needs this part, by the servo and the records of its axes.
    """

    name: str
    record: list[Any]
    entry: Callable[[DrivenAxis], dict[str, Any]]
    acts: Sequence[tuple[str, Callable[..., None]]]
    needed: Callable[[Servo, NDArray[np.void]], bool]
