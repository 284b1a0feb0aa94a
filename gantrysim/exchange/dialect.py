"""Base of the dialects of gains: the parameters of one axis, their arithmetic, speed limits, the text of a file."""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, NamedTuple

from gantrysim.base.errors import InputError
from gantrysim.base.input_files import read_text
from gantrysim.machine.axis import Axis
from gantrysim.servo.servo import Servo

# letters of the formulas
SYMBOLS = (
    "T servo period, r resolution, c 2048 / full scale (torque_limit, or the axis' speed limit for a velocity drive), "
    "o output_velocity, vff velocity_ff, aff acceleration_ff, kv kd - o (velocity_gain for a velocity drive), s travel "
    "per radian, K motor constant (1 for an ideal torque source)"
)
SAYABLE_MODES = ("torque", "velocity")  # of drives to which the controller's law sends its output


# a gain whose output is a speed [u/s]; by the same gain's unit where it is a torque, after N·m
SPEED_UNITS = {"/u": "1/s", "/(u·s)": "1/s²", "·s/u": "1", "·s²/u": "s"}


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
        mode: command mode of the drive, "torque" or "velocity".
        speed_limit: of the axis, at which the law's output to a velocity drive is clamped [u/s].
        velocity_gain: of a velocity loop in the drive [N·m·s/u].
        velocity_time: integral time of a velocity loop in the drive [s].
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
    mode: str = "torque"
    speed_limit: float = math.inf
    velocity_gain: float = 0.0
    velocity_time: float = 0.0

    @classmethod
    def of(cls, axes: Sequence[Axis], servo: Servo) -> tuple[AxisServo, ...]:
        """Return the servo of each axis.

        Raises:
            InputError: a drive that takes positions or steps, so that the controller has no gains.
        """
        for axis, mode in zip(axes, servo.modes, strict=True):
            if mode not in SAYABLE_MODES:
                raise InputError(
                    f"gains in a controller's parameters: the drive of axis {axis.name} is in mode {mode!r}, takes "
                    f"positions and closes its loop itself: the controller has no gains for it; they are for servo "
                    f"mode = {' or '.join(map(repr, SAYABLE_MODES))}"
                )
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
                servo.modes[a],
                axis.speed_limit,
                servo.drives[a].velocity_gain,
                servo.drives[a].velocity_time,
            )
            for a, axis in enumerate(axes)
        )

    @property
    def takes_velocity(self) -> bool:
        """Whether the drive takes a velocity and closes the loop of the speed itself."""
        return self.mode == "velocity"

    @property
    def full_scale(self) -> float:
        """Largest output of the law, inf without a limit: a torque [N·m], or of a velocity drive a speed [u/s]."""
        return self.speed_limit if self.takes_velocity else self.torque_limit

    @property
    def known_full_scale(self) -> float:
        """The full scale, where there is one; InputError where it is infinite."""
        if self.takes_velocity:
            return self.has("speed limit", self.speed_limit, "the speed at full scale of the output")
        return self.has("torque_limit", self.torque_limit, "the torque at full scale of the output")

    @property
    def motor_unit_factor(self) -> tuple[float, str]:
        """Factor from torque per travel to the drive's current, or torque, per angle of the motor, and its unit."""
        if math.isfinite(self.motor_constant):
            return self.scale / self.motor_constant, "A"
        return self.scale, "N·m"

    def output_unit(self, per: str) -> str:
        """Return the unit of a gain from its unit per unit of the law's output, which is a torque or a speed.

        Args:
            per: unit after that of a torque, such as "·s/u" of N·m·s/u.
        """
        return SPEED_UNITS[per] if self.takes_velocity else f"N·m{per}"

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
    """A controller's parameters for the servo's gains.

    Attributes:
        name: name of the dialect.
        suffix: suffix of the files that it writes.
        comment: text that begins a comment in them.
        source: public documents that define parameters and units.
        assumes: assumptions about controller and drive.
        carries: fields of `Servo` that its parameters express for a torque drive.
        carries_of_velocity: fields of `Servo` that its parameters express for a velocity drive.
        settings: parameters beside the gains that are named where a text has them, and what each means for the servo.
    """

    name: ClassVar[str]
    suffix: ClassVar[str] = ".txt"
    comment: ClassVar[str] = "#"
    source: ClassVar[str]
    assumes: ClassVar[str]
    carries: ClassVar[tuple[str, ...]]
    carries_of_velocity: ClassVar[tuple[str, ...]]
    settings: ClassVar[Mapping[str, str]] = {}

    def carried_fields(self, mode: str) -> tuple[str, ...]:
        """Return the fields of `Servo` that the parameters express for a drive in a mode."""
        return self.carries_of_velocity if mode == "velocity" else self.carries

    @abstractmethod
    def words(self, axis: AxisServo) -> list[Word]:
        """Return the parameters of an axis.

        Raises:
            InputError: a value of the axis that the controller's units need is missing.
        """

    @abstractmethod
    def gains(self, words: Mapping[str, float], axis: AxisServo) -> dict[str, float]:
        """Return the servo's gains from an axis' parameters; gains without a parameter are 0.

        Args:
            words: values of the parameters that were found, by name; a missing one is 0.
            axis: axis with its units and, where the dialect builds on a gain without a parameter, that gain.
        """

    @abstractmethod
    def body(self, axes: Sequence[AxisServo]) -> list[str]:
        """Return the lines of the file after its comments."""

    @abstractmethod
    def read(self, text: str, axes: Sequence[AxisServo]) -> list[dict[str, float]]:
        """Return the parameters of each axis in a text, in the order of the axes; empty where it has none."""

    def remarks(self, words: Mapping[str, float], axis: AxisServo) -> list[str]:
        """Return notes on parameters of an axis that are read but not used."""
        unused = [f"{name} = {words[name]:g}, {meaning}" for name, meaning in self.settings.items() if words.get(name)]
        return [f"not taken over for axis {axis.name}: {'; '.join(unused)}"] if unused else []

    def warnings(self, axis: AxisServo) -> list[str]:
        """Return notes on parameters of an axis that a controller would not take as they are written."""
        return []

    def has_gains(self, text: str) -> bool:
        """Return whether a text has gains of any axis; one without may be the file of a position drive."""
        return True

    def reason_without(self, text: str, axes: Sequence[AxisServo], missing: str) -> str:
        """Return why an axis, by its name, has no gains in a text, in words; empty where its parameters just lack.

        Args:
            text: that was read.
            axes: all of them.
            missing: name of the axis.
        """
        return ""

    def file_text(self, path: Path) -> str:
        """Return the text of a file, or raise InputError where it cannot be read."""
        try:
            return read_text(path, errors="replace")
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {error.strerror}") from None

    def limits(self, text: str) -> tuple[AxisLimits, ...]:
        """Return the limits of speed and acceleration in a text, beside gains or instead of them."""
        return ()

    def text(self, axes: Sequence[AxisServo], notes: Sequence[str] = ()) -> str:
        """Return the file of these gains.

        Args:
            axes: their servos.
            notes: more lines for its head.
        """
        head = [
            f"Servo gains for {self.name}. Source of parameters and units: {self.source}",
            *dict.fromkeys(f"{word.name} [{word.unit}] = {word.formula}" for axis in axes for word in self.words(axis)),
            f"with {SYMBOLS}",
            *(f"Drive of axis {axis.name}: {drive_in_words(axis)}" for axis in axes),
            f"Assumed: {self.assumes}",
            *notes,
        ]
        return "\n".join([*(f"{self.comment} {line}" for line in head), *self.body(axes)]) + "\n"


def by_name(pattern: str, text: str, flags: re.RegexFlag = re.IGNORECASE) -> list[tuple[str, ...]]:
    """Return the groups of every line that matches as a whole."""
    matches = [re.fullmatch(pattern, line.strip(), flags) for line in text.splitlines()]
    return [match.groups() for match in matches if match]


def drive_in_words(axis: AxisServo) -> str:
    """Return what an axis' drive takes from the controller, at which full scale, and what is to be set in it."""
    if not axis.takes_velocity:
        limit = f", full scale {axis.torque_limit:.6g} N·m" if math.isfinite(axis.torque_limit) else ""
        return f"torque mode{limit}"
    per_second = axis.speed_limit / axis.scale  # of the motor [rad/s]
    scale = ""
    if math.isfinite(per_second):
        scale = (
            f", full scale {axis.speed_limit:.6g} {axis.unit}/s = {per_second * 30 / math.pi:.6g} rpm of the motor"
            f" (at +-10 V {per_second * 3 / math.pi:.6g} rpm/V)"
        )
    factor, unit = axis.motor_unit_factor
    time = f", integral time {1e3 * axis.velocity_time:.6g} ms" if axis.velocity_time else ", no integral term"
    return f"velocity mode{scale}, velocity loop of {axis.velocity_gain * factor:.6g} {unit}·s/rad{time}"


class AxisLimits(NamedTuple):
    """Limits of an axis; 0 where they are not known.

    Attributes:
        name: of the axis, x, y or z.
        speed: [mm/s].
        acceleration: [mm/s²].
        steps: that a position drive gets per travel [1/mm].
        following_error: at which the drives are disabled [mm].
    """

    name: str
    speed: float
    acceleration: float
    steps: float = 0.0
    following_error: float = 0.0

    def in_words(self) -> str:
        """Return the limits in a line."""
        parts = [f"{self.speed:.6g} mm/s"]
        if self.acceleration:
            parts.append(f"{self.acceleration:.6g} mm/s²")
        if self.steps:
            parts.append(f"{self.steps:.6g} steps/mm, {1e3 / self.steps:.4g} µm each")
        if self.following_error:
            parts.append(f"following error at most {self.following_error:.6g} mm")
        return f"{self.name}: {', '.join(parts)}"


def program_lines(limits: Sequence[AxisLimits], acceleration: float = 0.0) -> list[str]:
    """Return the table [program] of a job of G-code with the limits of a machine.

    Args:
        limits: of its axes.
        acceleration: along the path; 0 for the lowest of the axes, as a job has one for all [mm/s²].
    """
    speeds = {limit.name: limit.speed for limit in limits}
    lowest = min((limit.acceleration for limit in limits if limit.acceleration), default=0.0)
    lines = ["[program]"]
    if acceleration or lowest:
        meaning = "along the path" if acceleration else "the lowest of the axes"
        lines.append(f"acceleration = {float(f'{acceleration or lowest:.12g}')!r}  # {meaning} [mm/s²]")
    # of speeds in inches the last digits are rounding
    of_axes = ", ".join(repr(float(f"{speeds.get(name) or math.inf:.12g}")) for name in "xyz")
    lines.append(f"axis_speeds = [{of_axes}]  # x, y, z [mm/s]")
    return lines
