"""INI files of LinuxCNC: sections, units, which joint is which axis, and limits of speed and acceleration."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from gantrysim.base.errors import InputError, expanded
from gantrysim.base.patterns import NUMBER
from gantrysim.exchange.included import IncludedFiles
from gantrysim.exchange.motion_limits import AxisLimits

_INCLUDE = re.compile(r"#INCLUDE\s+(.+?)\s*")
_SECTION = re.compile(r"\[\s*([\w:.-]+)\s*\].*")
_VALUE = re.compile(rf"({NUMBER})\s*(?:[#;].*)?")
_LENGTHS = {"mm": 1.0, "metric": 1.0, "cm": 10.0, "inch": 25.4, "in": 25.4, "imperial": 25.4}  # [mm]
_TRIVIAL = "trivkins"  # kinematics in which each joint is an axis


def ini_text(path: Path) -> str:
    """Return the text of an INI file, with the files that its lines #INCLUDE name in their places.

    Raises:
        InputError: a file that cannot be read, or files that include each other.
    """
    return "\n".join(_lines(path, IncludedFiles("#INCLUDE"), 0)) + "\n"


def _lines(path: Path, files: IncludedFiles, depth: int) -> Iterator[str]:
    for line in files.text(path, depth).splitlines():
        include = _INCLUDE.fullmatch(line)
        if include is None:
            yield line
        else:
            yield from _lines(path.parent / expanded(include[1]), files, depth + 1)


@dataclass(frozen=True)
class IniFile:
    """The values of an INI file by section and key, both in capitals; of several values of a key the first counts."""

    sections: dict[str, dict[str, str]]

    @classmethod
    def of(cls, text: str) -> IniFile:
        """Return the content of a text."""
        sections: dict[str, dict[str, str]] = {}
        section: dict[str, str] = {}  # before the first heading, where LinuxCNC looks for nothing
        for line in text.splitlines():
            heading = _SECTION.fullmatch(line.strip())
            if heading:
                section = sections.setdefault(heading[1].upper(), {})
                continue
            key, equals, value = line.partition("=")
            if equals and not line.lstrip().startswith(("#", ";")):
                section.setdefault(key.strip().upper(), value.strip())
        return cls(sections)

    def number(self, section: str, key: str) -> float | None:
        """Return a number, None where there is none.

        Raises:
            InputError: a value that is not a finite number.
        """
        text = self.sections.get(section, {}).get(key, "")
        if not text:
            return None
        value = _VALUE.fullmatch(text)
        if value is None or not math.isfinite(float(value[1])):
            raise InputError(f"[{section}] {key} = {text:.40}: must be a finite number")
        return float(value[1])

    def has_any(self, *keys: str) -> bool:
        """Return whether the section of any joint or axis that takes no steps has one of some keys."""
        joints = [name for name in self.sections if name.startswith(("JOINT_", "AXIS_")) and not self.makes_steps(name)]
        return any(key in self.sections[name] for name in joints for key in keys)

    def makes_steps(self, section: str) -> bool:
        """Return whether a joint's drive takes steps: P and FF1 beside are those of the step generator's own loop."""
        return any(key.startswith("STEPGEN_") for key in self.sections[section])

    @property
    def length(self) -> float:
        """Millimetres per machine unit of length.

        Raises:
            InputError: an unknown unit.
        """
        unit = self.sections.get("TRAJ", {}).get("LINEAR_UNITS", "mm").split("#")[0].strip()
        per_millimetre = re.fullmatch(NUMBER, unit)
        if per_millimetre and float(unit) > 0:
            return 1 / float(unit)
        if unit.lower() not in _LENGTHS:
            raise InputError(f"[TRAJ] LINEAR_UNITS = {unit:.40}: must be one of {', '.join(_LENGTHS)}")
        return _LENGTHS[unit.lower()]

    @property
    def letters(self) -> str:
        """The axis of each joint in turn, in small letters; empty where the kinematics mix the joints."""
        words = self.sections.get("KINS", {}).get("KINEMATICS", _TRIVIAL).split("#")[0].lower().split()
        if not words or words[0] != _TRIVIAL:
            return ""
        named = [word.removeprefix("coordinates=") for word in words if word.startswith("coordinates=")]
        letters = named[0] if named else self.sections.get("TRAJ", {}).get("COORDINATES", "").split("#")[0]
        return re.sub("[^a-z]", "", letters.lower())

    def section_of(self, name: str, number: int, names: Sequence[str]) -> str | None:
        """Return the section of an axis' joint, None without one.

        Joints are found by the letters of the axes, or by their numbers where the machine's axes have no such names.

        Args:
            name: of the axis.
            number: its place in the machine.
            names: of all axes of the machine.
        """
        letters = self.letters
        if set("".join(names).lower()) & set(letters):
            number = letters.find(name.lower())
        joint = f"JOINT_{number}"
        if joint in self.sections:
            return joint
        older = f"AXIS_{name.upper()}"  # before joints and axes were told apart
        return older if older in self.sections else None

    def is_angular(self, section: str) -> bool:
        """Return whether a joint turns."""
        return self.sections[section].get("TYPE", "").upper().startswith("ANGULAR")

    @property
    def limits(self) -> tuple[AxisLimits, ...]:
        """Limits of the axes x, y and z, as far as the file has them."""
        limits = []
        for letter in "xyz":
            joint = f"JOINT_{self.letters.find(letter)}"
            sections = [section for section in (joint, f"AXIS_{letter.upper()}") if section in self.sections]
            speeds = [self.number(section, "MAX_VELOCITY") for section in sections]
            accelerations = [self.number(section, "MAX_ACCELERATION") for section in sections]
            scales = [self.number(section, key) for section in sections for key in ("SCALE", "STEP_SCALE")]
            errors = [self.number(section, "FERROR") for section in sections]
            if any(speeds):
                limits.append(
                    AxisLimits(
                        letter,
                        _least(speeds, self.length),
                        _least(accelerations, self.length),
                        _least(scales, 1 / self.length),
                        _least(errors, self.length),
                    )
                )
        return tuple(limits)


def _least(values: Sequence[float | None], factor: float) -> float:
    """Return the least size of the values that are given and not 0, times a factor; 0 without any."""
    sizes = [abs(value) for value in values if value]
    return min(sizes) * factor if sizes else 0.0
