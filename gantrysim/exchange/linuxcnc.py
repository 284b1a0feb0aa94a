"""Gains in the parameters of LinuxCNC's component pid: a .hal file, or the section of an INI file."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from gantrysim.base.errors import InputError, expanded_path
from gantrysim.exchange.dialect import AxisLimits, AxisServo, Dialect, Word, by_name
from gantrysim.exchange.included import IncludedFiles
from gantrysim.tables.units import NUMBER

# INI files of LinuxCNC: sections, units, which joint is which axis, and limits of speed and acceleration.

_INCLUDE = re.compile(r"#INCLUDE\s+(.+?)\s*")
_SECTION = re.compile(r"\[\s*([\w:.-]+)\s*\].*")
_VALUE = re.compile(rf"({NUMBER})\s*(?:[#;].*)?")
_LENGTHS = {"mm": 1.0, "metric": 1.0, "cm": 10.0, "inch": 25.4, "in": 25.4, "imperial": 25.4}  # [mm]
_TRIVIAL_KINEMATICS = "trivkins"  # kinematics in which each joint is an axis


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
            yield from _lines(path.parent / expanded_path(include[1]), files, depth + 1)


@dataclass(frozen=True)
class IniFile:
    """The values of an INI file by section and key, both in capitals; of several values of a key the first counts."""

    sections: dict[str, dict[str, str]]

    @classmethod
    def of(cls, text: str) -> IniFile:
        """Return the content of a text."""
        sections: dict[str, dict[str, str]] = {}
        # before the first heading, where LinuxCNC looks for nothing
        section: dict[str, str] = {}
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
        words = self.sections.get("KINS", {}).get("KINEMATICS", _TRIVIAL_KINEMATICS).split("#")[0].lower().split()
        if not words or words[0] != _TRIVIAL_KINEMATICS:
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
        # before joints and axes were told apart
        older = f"AXIS_{name.upper()}"
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
                        _smallest_size(speeds, self.length),
                        _smallest_size(accelerations, self.length),
                        _smallest_size(scales, 1 / self.length),
                        _smallest_size(errors, self.length),
                    )
                )
        return tuple(limits)


def _smallest_size(values: Sequence[float | None], factor: float) -> float:
    """Return the least size of the values that are given and not 0, times a factor; 0 without any."""
    sizes = [abs(value) for value in values if value]
    return min(sizes) * factor if sizes else 0.0


# pins of pid, keys of an INI file and gains of the servo
_TERMS = (
    ("Pgain", "P", "kp"),
    ("Igain", "I", "ki"),
    ("Dgain", "D", "kd"),
    ("FF1", "FF1", "velocity_ff"),
    ("FF2", "FF2", "acceleration_ff"),
)
_DEADBAND = ("deadband", "DEADBAND")
_FOREIGN = (("FF0", "FF0"), ("FF3", "FF3"), ("bias", "BIAS"), _DEADBAND)  # that the servo lacks
_BOUND = "a bound of the loop, which the servo lacks"
_LIMITS = "set by the job's program: axis_speeds, acceleration"
# of the motion, in units of length; only MAX_OUTPUT is in those of the output
_OF_LENGTH = ("DEADBAND", "MAX_ERROR", "BACKLASH", "FERROR", "MIN_FERROR", "MAX_VELOCITY", "MAX_ACCELERATION")
_PERIOD = "SERVO_PERIOD"  # in section [EMCMOT] [ns]
_SAME_PERIOD = 1e-3  # relative difference that rounding explains
_OLDER_KEYS = {"P": "PGAIN", "I": "IGAIN", "D": "DGAIN"}  # names of keys that a HAL file may have instead
_UNITS = {"kp": "/u", "ki": "/(u·s)", "kd": "·s/u", "velocity_ff": "·s/u", "acceleration_ff": "·s²/u"}
_FORMULAS = {"kd": "kd - o", "velocity_ff": "vff + o", "acceleration_ff": "aff"}


class LinuxCNC(Dialect):
    """Pgain, Igain, Dgain, FF1 and FF2 of the component pid.

    Its output is the torque demand in N·m, or the speed demand in machine units per second of a velocity drive.

        output = bias + Pgain E + Igain T sum(E) + Dgain dE/T + FF0 DPOS + FF1 dDPOS/T + FF2 ddDPOS/T^2

    bias, FF0 and deadband are 0. The servo's output_velocity o is carried by Dgain and FF1, as
    kd dE + o dMPOS = (kd - o) dE + o dDPOS.
    """

    name = "linuxcnc"
    suffix = ".hal"
    source = "LinuxCNC manual page pid(9)"
    assumes = "the output of pid is the torque demand in N·m, or a velocity drive's speed demand in u/s; u is mm or deg"
    # each by its name: a gain that the package gains has no term here until somebody gives it one
    carries: ClassVar[tuple[str, ...]] = (
        "kp",
        "ki",
        "kd",
        "velocity_ff",
        "acceleration_ff",
        "output_velocity",
        "period",
        "torque_limit",
    )
    carries_of_velocity: ClassVar[tuple[str, ...]] = tuple(name for name in carries if name != "torque_limit")
    settings: ClassVar[Mapping[str, str]] = {
        "maxerror": _BOUND,
        "maxerrorI": _BOUND,
        "maxerrorD": _BOUND,
        "maxcmdD": _BOUND,
        "maxcmdDD": _BOUND,
        "maxoutput": "the bound of the output: servo.torque_limit of torque drives",
    }
    keys = 0  # which name of `_TERMS` is the dialect's

    def words(self, axis: AxisServo) -> list[Word]:
        gains = axis.on_error
        return [
            Word(term[self.keys], gains[term[2]], axis.output_unit(_UNITS[term[2]]), _FORMULAS.get(term[2], term[2]))
            for term in _TERMS
        ]

    def gains(self, words: Mapping[str, float], axis: AxisServo) -> dict[str, float]:
        foreign = {term[self.keys]: words.get(term[self.keys], 0.0) for term in _FOREIGN if term != _DEADBAND}
        for name, value in foreign.items():
            if value != 0:
                raise InputError(f"{name} of axis {axis.name} = {value:g}: must be 0, the servo has no such term")
        return {term[2]: words.get(term[self.keys], 0.0) for term in _TERMS} | {"output_velocity": 0.0}

    def remarks(self, words: Mapping[str, float], axis: AxisServo) -> list[str]:
        name = _DEADBAND[self.keys]
        deadband = words.get(name, 0.0)
        exported = {"maxoutput": axis.full_scale, "MAX_OUTPUT": axis.full_scale, "FERROR": axis.following_error_limit}
        same = {key for key, value in exported.items() if math.isclose(words.get(key, 0.0), value)}
        remarks = super().remarks({key: value for key, value in words.items() if key not in same}, axis)
        if not deadband:
            return remarks
        counts = f" = {deadband / axis.resolution:.2g} encoder counts" if axis.resolution else ""
        return [
            *remarks,
            f"{name} of axis {axis.name} = {deadband:.4g} {axis.unit}{counts}: left out, the servo has none; the real "
            "axis may stay that far from its command",
        ]

    def body(self, axes: Sequence[AxisServo]) -> list[str]:
        names = [f"pid.{axis.name}" for axis in axes]
        lines = [
            "# Runs as it is by halrun -f; beside motmod, which makes the thread, leave out the line of threads.",
            f"loadrt threads name1=servo-thread period1={round(1e9 * axes[0].period)}",
            f"loadrt pid names={','.join(names)}",
        ]
        for axis, name in zip(axes, names, strict=True):
            limit = axis.full_scale if axis.full_scale < float("inf") else 0.0  # 0: no limit
            lines += [f"addf {name}.do-pid-calcs servo-thread"]
            lines += [f"setp {name}.{word.name} {word.value!r}" for word in self.words(axis)]
            lines += [f"setp {name}.{foreign} 0" for foreign, _ in _FOREIGN[:1] + _FOREIGN[2:]]
            lines += [f"setp {name}.maxoutput {limit!r}", f"setp {name}.error-previous-target 0"]
            lines += [f"setp {name}.enable 1"]
        return [*lines, "start"]

    def read(self, text: str, axes: Sequence[AxisServo]) -> list[dict[str, float]]:
        values: list[dict[str, float]] = [{} for _ in axes]
        places = {axis.name.lower(): a for a, axis in enumerate(axes)} | {str(a): a for a in range(len(axes))}
        known = {name.lower(): name for name in (*(term[0] for term in (*_TERMS, *_FOREIGN)), *self.settings)}
        for owner, pin, value in by_name(rf"setp\s+(?:pid\.)?([\w-]+)\.([\w-]+)\s+({NUMBER})\s*(?:#.*)?", text):
            a = places.get(owner.lower())
            if a is not None and pin.lower() in known:
                values[a][known[pin.lower()]] = float(value)
        return [words if any(term[0] in words for term in _TERMS) else {} for words in values]


class LinuxCNCIni(LinuxCNC):
    """P, I, D, FF1 and FF2 in the sections [JOINT_n] of a LinuxCNC INI file."""

    name = "linuxcnc-ini"
    suffix = ".ini"
    carries = (*LinuxCNC.carries, "following_error_limit")
    carries_of_velocity = (*LinuxCNC.carries_of_velocity, "following_error_limit")
    settings: ClassVar[Mapping[str, str]] = {
        "MAX_ERROR": _BOUND,
        "MAX_ERROR_I": _BOUND,
        "MAX_ERROR_D": _BOUND,
        "MAX_OUTPUT": "the bound of the output: servo.torque_limit of torque drives",
        "BACKLASH": "the controller's compensation of backlash, which is not simulated",
        "FERROR": "servo.following_error_limit of the job",
        "MIN_FERROR": "the limit of the following error at low speed: the servo has one for all speeds",
        "MAX_VELOCITY": _LIMITS,
        "MAX_ACCELERATION": _LIMITS,
    }
    keys = 1

    def body(self, axes: Sequence[AxisServo]) -> list[str]:
        lines = ["[EMCMOT]", f"SERVO_PERIOD = {round(1e9 * axes[0].period)}"]
        for number, axis in enumerate(axes):
            lines += ["", f"[JOINT_{number}]", f"# axis {axis.name} [{axis.unit}]"]
            lines += [f"{word.name} = {word.value!r}" for word in self.words(axis)]
            lines += ["FF0 = 0", "BIAS = 0", "DEADBAND = 0", f"FERROR = {axis.following_error_limit!r}"]
            if axis.full_scale < float("inf"):
                lines.append(f"MAX_OUTPUT = {axis.full_scale!r}")
                # the output stage divides by it, so that it gives 1 at full scale
                if axis.takes_velocity:
                    lines.append(f"OUTPUT_SCALE = {axis.full_scale!r}")
        return lines

    def read(self, text: str, axes: Sequence[AxisServo]) -> list[dict[str, float]]:
        ini = IniFile.of(text)
        names = [axis.name for axis in axes]
        words = [self._words_of_joint(ini, ini.section_of(axis.name, a, names), axis) for a, axis in enumerate(axes)]
        period = ini.number("EMCMOT", _PERIOD)
        if period and words[0]:
            words[0][_PERIOD] = period
        return words

    def remarks(self, words: Mapping[str, float], axis: AxisServo) -> list[str]:
        remarks = super().remarks(words, axis)
        bound = words.get("MAX_ERROR", 0.0)
        if bound:
            unit = f"{axis.unit}/s" if axis.takes_velocity else "N·m"
            remarks.append(
                f"MAX_ERROR of axis {axis.name} bounds the correction of P to P x {bound:g} = "
                f"{words.get('P', 0.0) * bound:.4g} {unit}: beyond that error the real loop no longer catches up faster"
            )
        period = 1e-9 * words.get(_PERIOD, 0.0)
        if period and abs(period / axis.period - 1) > _SAME_PERIOD:
            remarks.append(
                f"{_PERIOD} = {1e3 * period:g} ms: the job's servo has {1e3 * axis.period:g} ms; gains are per second "
                f"and stay, the loop's lag does not: --set servo.period={period:g}"
            )
        return remarks

    def reason_without(self, text: str, axes: Sequence[AxisServo], missing: str) -> str:
        ini = IniFile.of(text)
        names = [axis.name for axis in axes]
        section = ini.section_of(missing, names.index(missing), names)
        if section is None:
            return f"no section is the joint of {missing}"
        steps = [key for key in ini.sections[section] if key.startswith("STEPGEN_")]
        if not steps:
            return ""
        return f"[{section}] is a drive that takes steps ({steps[0]}): a P there is the step generator's own"

    @staticmethod
    def _words_of_joint(ini: IniFile, section: str | None, axis: AxisServo) -> dict[str, float]:
        """Return the parameters of a joint's section, in mm or deg."""
        if section is None or ini.makes_steps(section):
            return {}
        words = {}
        for key in (*(term[1] for term in (*_TERMS, *_FOREIGN)), *LinuxCNCIni.settings):
            value = ini.number(section, key)
            if value is None:
                value = ini.number(section, _OLDER_KEYS.get(key, key))
            if value is not None:
                words[key] = value
        if not any(term[1] in words for term in _TERMS):
            return {}
        if ini.is_angular(section) != (axis.unit == "deg"):
            kind = ini.sections[section].get("TYPE", "LINEAR")
            raise InputError(f"[{section}] TYPE = {kind}: axis {axis.name} of the machine is in {axis.unit}")
        if axis.unit == "mm":
            for key in words:
                # per unit of length where the output is a torque; a speed has the unit itself, which cancels
                factor = 1 / ini.length if axis.mode == "torque" else 1.0
                if key == "MAX_OUTPUT":
                    factor = 1.0 if axis.mode == "torque" else ini.length
                words[key] *= ini.length if key in _OF_LENGTH else factor
        return words

    def limits(self, text: str) -> tuple[AxisLimits, ...]:
        return IniFile.of(text).limits

    def has_gains(self, text: str) -> bool:
        return IniFile.of(text).has_any("P", "PGAIN", "FF1")

    def file_text(self, path: Path) -> str:
        return ini_text(path)
