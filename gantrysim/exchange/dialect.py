"""What every dialect of gains has: its words for one axis, their arithmetic, its text."""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from gantrysim.base.errors import InputError
from gantrysim.machine.axis import Axis
from gantrysim.servo.servo import Servo

# letters of the formulas
SYMBOLS = (
    "T period, r resolution, c 2048 / torque_limit, o output_velocity, vff velocity_ff, aff acceleration_ff, "
    "kv kd - o, s travel per radian, K motor constant (1 for an ideal torque source)"
)


class Word(NamedTuple):
    """A parameter of a controller for one axis.

    Attributes:
        name: as the controller calls it.
        value: in its unit.
        unit: in which u is the axis' own, mm or deg.
        formula: how it follows from the servo's gains, in the letters of `SYMBOLS`.
    """

    name: str
    value: float
    unit: str
    formula: str


@dataclass(frozen=True)
class AxisServo:
    """The servo of one axis, and what its conversion needs of the machine.

    Attributes:
        name, unit: of the axis.
        period: servo period [s].
        gains: by the names of the fields of `Gains`.
        torque_limit: [N·m].
        resolution: axis travel per encoder edge [u].
        following_error_limit: [u].
        scale: axis travel per motor angle [u/rad].
        motor_constant: nan for an ideal torque source [N·m/A].
    """

    name: str
    unit: str
    period: float
    gains: Mapping[str, float]
    torque_limit: float
    resolution: float
    following_error_limit: float
    scale: float
    motor_constant: float

    @classmethod
    def of(cls, axes: Iterable[Axis], servo: Servo) -> tuple[AxisServo, ...]:
        """Return the servo of each axis.

        Raises:
            InputError: a servo that does not send torques to all its drives.
        """
        servo.check_torque("gains in the words of a controller")
        return tuple(
            cls(
                axis.name,
                axis.unit,
                servo.period,
                servo.gains[a]._asdict(),
                servo.drives[a].torque_limit,
                servo.drives[a].resolution,
                servo.following_error_limit[a],
                axis.scale,
                axis.motor_constant,
            )
            for a, axis in enumerate(axes)
        )

    @property
    def on_error(self) -> dict[str, float]:
        """The gains without output_velocity, which gives the same torque at every tick.

        From dMPOS = dDPOS - dE follows kd dE + o dMPOS = (kd - o) dE + o dDPOS.
        """
        gains = dict(self.gains)
        o = gains.pop("output_velocity")
        return {**gains, "kd": gains["kd"] - o, "velocity_ff": gains["velocity_ff"] + o}

    def has(self, name: str, value: float, why: str) -> float:
        """Return a value of this axis that is finite and above zero, or raise InputError."""
        if not (math.isfinite(value) and value > 0):
            raise InputError(f"{name} of axis {self.name} = {value:g}: must be finite and greater than 0, {why}")
        return value


class Dialect(ABC):
    """A controller's words for the servo's gains.

    Attributes:
        name: of the dialect.
        suffix: of the files that it writes.
        comment: begins a comment in them.
        source: which public documents give words and units.
        assumes: what is assumed of controller and drive.
        carries: fields of `Servo` that its words express.
    """

    name: ClassVar[str]
    suffix: ClassVar[str] = ".txt"
    comment: ClassVar[str] = "#"
    source: ClassVar[str]
    assumes: ClassVar[str]
    carries: ClassVar[tuple[str, ...]]

    @abstractmethod
    def words(self, axis: AxisServo) -> list[Word]:
        """Return the words of an axis.

        Raises:
            InputError: a value of the axis that the controller's units need is missing.
        """

    @abstractmethod
    def gains(self, words: Mapping[str, float], axis: AxisServo) -> dict[str, float]:
        """Return the servo's gains from an axis' words; those that it has no words for are 0.

        Args:
            words: those found; a missing one is 0.
            axis: for units and, where the dialect builds on a gain without a word, that gain.
        """

    @abstractmethod
    def body(self, axes: Sequence[AxisServo]) -> list[str]:
        """Return the lines of the file after its comments."""

    @abstractmethod
    def read(self, text: str, axes: Sequence[AxisServo]) -> list[dict[str, float]]:
        """Return the words that a text gives each axis, in their order; empty where it gives none."""

    def text(self, axes: Sequence[AxisServo], notes: Sequence[str] = ()) -> str:
        """Return the file of these gains.

        Args:
            axes: their servos.
            notes: more lines for its head.
        """
        head = [
            f"Servo gains for {self.name}. Source of words and units: {self.source}",
            *(f"{word.name} [{word.unit}] = {word.formula}" for word in self.words(axes[0])),
            f"with {SYMBOLS}",
            f"Assumed: {self.assumes}",
            *notes,
        ]
        return "\n".join([*(f"{self.comment} {line}" for line in head), *self.body(axes)]) + "\n"


def by_name(pattern: str, text: str, flags: re.RegexFlag = re.IGNORECASE) -> list[tuple[str, ...]]:
    """Return the groups of every line that matches as a whole."""
    matches = [re.fullmatch(pattern, line.strip(), flags) for line in text.splitlines()]
    return [match.groups() for match in matches if match]
