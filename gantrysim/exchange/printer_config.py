"""The configuration of a printer under Klipper, `printer.cfg`: speeds, accelerations, steps and input shapers."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from gantrysim.base.errors import InputError, expanded_path
from gantrysim.exchange.dialect import AxisLimits, program_lines
from gantrysim.exchange.included import IncludedFiles
from gantrysim.servo.laws import ADDITIONS, PID

_SECTION = re.compile(r"\[\s*([^\]]+?)\s*\]\s*(?:[#;].*)?")
_INCLUDE = "include "
_SAVED_PREFIX = "#*#"  # begins the lines that SAVE_CONFIG has written; they count
_LETTERS = "xyz"
_LONGEST_NAME = 40

# defaults of the firmware, after its Configuration reference
_FULL_STEPS = 200.0
_CRUISE_RATIO = 0.5
_CORNER = 5.0  # [mm/s]
_SHAPER = "mzv"
_DAMPING = 0.1

_SHARED_SHAPERS = tuple(name for name in ADDITIONS if name in ("zv", "zvd"))  # shapers that are laws of the servo too


@dataclass(frozen=True)
class AxisShaper:
    """The input shaper of an axis.

    Attributes:
        kind: such as "mzv".
        frequency: [Hz].
        damping: ratio of the mode.
    """

    kind: str
    frequency: float
    damping: float


@dataclass(frozen=True)
class PrinterConfig:
    """A printer's configuration.

    Attributes:
        sections: options by section and name, in small letters.
        label: of the file in errors.
    """

    sections: dict[str, dict[str, str]]
    label: str

    @classmethod
    def load(cls, path: Path) -> PrinterConfig:
        """Return the configuration in a file and those that it includes.

        Raises:
            InputError: a file that cannot be read, or one without the limits of a printer.
        """
        sections: dict[str, dict[str, str]] = {}
        _add_file(path, sections, IncludedFiles("[include]"))
        config = cls(sections, str(path))
        if "printer" not in sections:
            raise InputError(f"{path}: has no section [printer]")
        for option in ("max_velocity", "max_accel"):
            if not config._number("printer", option):
                raise InputError(f"{path}: [printer] {option} = 0: must be greater than 0")
        return config

    def _number(self, section: str, option: str, default: float | None = None) -> float:
        """Return a positive number or 0, or its default."""
        text = self.sections.get(section, {}).get(option)
        if text is None and default is not None:
            return default
        if text is None:
            raise InputError(f"{self.label}: [{section}] has no {option}")
        try:
            value = float(text)
        except ValueError:
            raise InputError(f"{self.label}: [{section}] {option} = {text:.40}: must be a number") from None
        if not (math.isfinite(value) and value >= 0):
            raise InputError(f"{self.label}: [{section}] {option} = {text:.40}: must be finite and at least 0")
        return value

    @property
    def speed(self) -> float:
        """Largest speed along the path [mm/s]."""
        return self._number("printer", "max_velocity")

    @property
    def acceleration(self) -> float:
        """Acceleration along the path [mm/s²]."""
        return self._number("printer", "max_accel")

    @property
    def corner_speed(self) -> float:
        """Speed at corners of a right angle [mm/s]."""
        return self._number("printer", "square_corner_velocity", _CORNER)

    @property
    def limits(self) -> tuple[AxisLimits, ...]:
        """Limits of x, y and z; those of z are its own."""
        limits = []
        for letter in _LETTERS:
            speed = self.speed
            acceleration = self.acceleration
            if letter == "z":
                speed = min(speed, self._number("printer", "max_z_velocity", speed))
                acceleration = min(acceleration, self._number("printer", "max_z_accel", acceleration))
            limits.append(AxisLimits(letter, speed, acceleration, self.steps(letter)))
        return tuple(limits)

    def steps(self, letter: str) -> float:
        """Return the microsteps per travel of the motor of a letter, 0 if not known [1/mm]."""
        section = f"stepper_{letter}"
        travel = self._number(section, "rotation_distance", 0.0)
        if not travel:
            return 0.0
        steps = self._number(section, "full_steps_per_rotation", _FULL_STEPS)
        microsteps = self._number(section, "microsteps", 1.0)
        return steps * microsteps * self._gearing(section) / travel

    def _gearing(self, section: str) -> float:
        """Return the turns of a motor per turn of its output, 1 without gears."""
        ratio = 1.0
        text = self.sections[section].get("gear_ratio", "")
        for pair in filter(None, text.split(",")):
            teeth = re.fullmatch(r"\s*(\d+(?:\.\d*)?)\s*:\s*(\d+(?:\.\d*)?)\s*", pair)
            if teeth is None or not float(teeth[2]):
                raise InputError(f"{self.label}: [{section}] gear_ratio = {text:.40}: must be as 80:16, 3:1")
            ratio *= float(teeth[1]) / float(teeth[2])
        return ratio

    def shaper(self, letter: str) -> AxisShaper | None:
        """Return the shaper of an axis, None without one."""
        frequency = self._number("input_shaper", f"shaper_freq_{letter}", 0.0)
        if not frequency:
            return None
        options = self.sections["input_shaper"]
        kind = options.get(f"shaper_type_{letter}", options.get("shaper_type", _SHAPER)).lower()
        return AxisShaper(_name(kind), frequency, self._number("input_shaper", f"damping_ratio_{letter}", _DAMPING))

    def tables(self, axes: Sequence[str], modes: Sequence[str]) -> tuple[str, list[str]]:
        """Return the configuration as tables of a job, and notes on what of it they do not hold.

        Args:
            axes: names of the machine's axes.
            modes: command modes of their drives.
        """
        notes = ["no gains: the motors are steppers in open loop; these are the limits of the planner"]
        kinematics = _name(self.sections["printer"].get("kinematics", "none"))
        planner = (
            f"SET_VELOCITY_LIMIT VELOCITY={self.speed:g} ACCEL={self.acceleration:g} "
            f"SQUARE_CORNER_VELOCITY={self.corner_speed:g}"
        )
        lines = [
            f"# Limits of a printer under Klipper, kinematics {kinematics}; for a job of a slicer's G-code.",
            *(f"# {limit.in_words()}" for limit in self.limits),
            "# A line for the beginning of the program, with the speed along the path and at corners:",
            f"# {planner}",
            "",
            *program_lines(self.limits, self.acceleration),
        ]
        ratio = self._number("printer", "minimum_cruise_ratio", _CRUISE_RATIO)
        if ratio:
            notes.append(
                f"minimum_cruise_ratio = {ratio:g} is not simulated: short moves that never reach their speed are a "
                "little faster here"
            )
        z_acceleration = self.limits[-1].acceleration
        if z_acceleration < self.acceleration:
            notes.append(
                f"max_z_accel = {z_acceleration:g} mm/s² is not simulated: moves in z accelerate with "
                f"{self.acceleration:g} mm/s² here"
            )
        shaping, trouble = self._shaping(axes, modes)
        return "\n".join([*lines, *shaping]) + "\n", notes + trouble

    def _shaping(self, axes: Sequence[str], modes: Sequence[str]) -> tuple[list[str], list[str]]:
        """Return the table [servo] with the shapers of a machine's axes, or nothing and the reason."""
        shapers = [self.shaper(name) if name in tuple(_LETTERS) else None for name in axes]
        used = [shaper for shaper in shapers if shaper is not None]
        if not used:
            return [], []
        in_words = ", ".join(
            f"{name} {shaper.kind} {shaper.frequency:g} Hz"
            for name, shaper in zip(axes, shapers, strict=True)
            if shaper is not None
        )
        kinds = {shaper.kind for shaper in used}
        if len(kinds) > 1 or not kinds <= set(_SHARED_SHAPERS):
            return [], [
                f"input shapers {in_words} are not simulated: the laws have one of {', '.join(_SHARED_SHAPERS)} for all"
            ]
        if set(modes) != {"torque"}:
            return [], [f"input shapers {in_words} are not simulated: laws need drives in mode 'torque'"]
        frequencies = ", ".join(repr(shaper.frequency if shaper else 0.0) for shaper in shapers)
        dampings = ", ".join(repr(shaper.damping if shaper else 0.0) for shaper in shapers)
        table = [
            "",
            "[servo]",
            f'law = ["{PID.name}", "{used[0].kind}"]',
            f"shaper_frequency = [{frequencies}]  # [Hz]",
            f"shaper_damping = [{dampings}]",
        ]
        return table, []


def _add_file(path: Path, sections: dict[str, dict[str, str]], files: IncludedFiles, depth: int = 0) -> None:
    """Add the options of a file and of those that it includes; the last value of an option counts."""
    section: dict[str, str] = {}
    for line in files.text(path, depth).splitlines():
        content = line.removeprefix(_SAVED_PREFIX)
        heading = _SECTION.fullmatch(content.strip())
        if heading and heading[1].startswith(_INCLUDE):
            for file in _included_files(path.parent / expanded_path(heading[1].removeprefix(_INCLUDE).strip())):
                _add_file(file, sections, files, depth + 1)
        elif heading:
            section = sections.setdefault(heading[1].lower(), {})
        # else a further line of a value, such as a macro
        elif not content[:1].isspace() or line.startswith(_SAVED_PREFIX):
            option = re.fullmatch(r"\s*([\w.-]+)\s*[:=]\s*([^#;]*?)\s*(?:[#;].*)?", content)
            if option:
                section[option[1].lower()] = option[2]


def _included_files(target: Path) -> list[Path]:
    """Return the files of an [include], whose name may have wildcards."""
    if not re.search(r"[*?\[]", target.name):
        return [target]
    if not target.parent.is_dir():
        return []
    return sorted(file for file in target.parent.iterdir() if fnmatchcase(file.name, target.name))


def _name(text: str) -> str:
    """Return a name in one line, as long as names are: the file may be one that was never meant to be shown."""
    return " ".join(text.split())[:_LONGEST_NAME]
