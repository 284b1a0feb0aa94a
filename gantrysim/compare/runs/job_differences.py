"""What differs between the jobs of runs: keys of the job file, the machine, and the servo that they make."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

from gantrysim.base.quantity import NOTHING
from gantrysim.compare.runs.compared_run import ComparedRun
from gantrysim.job.job import Job
from gantrysim.servo.servo_values import DERIVED

JOB = "job"
MACHINE = "machine"
SERVO = "servo"

_IGNORED = ("name", "source")  # labels: they do not act on the run
_DIGITS = 6  # significant, of a number
_LONGEST = 60  # characters of a line of a program
_DIGEST = 12  # characters of a digest that tell two apart
_UNIT = re.compile(r"\bu\b")  # of the axis
# of an axis of the machine, with its unit, in which u is the axis' own
_AXIS_VALUES = {
    "inertia": "N·m·s²/u",
    "viscous": "N·m·s/u",
    "coulomb": "N·m",
    "motor_constant": "N·m/A",
    "resistance": "ohm",
    "lag": "s",
    "bus_voltage": "V",
    "peak_torque": "N·m",
    "speed_limit": "u/s",
    "resolution": "u",
}


@dataclass(frozen=True)
class JobDifference:
    """A value that is not the same in all jobs.

    Attributes:
        kind: `JOB`, `MACHINE` or `SERVO`; of the servo are the values that the others make of it.
        key: dotted key of the job file, or name of the value with its unit.
        texts: value of each run.
    """

    kind: str
    key: str
    texts: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.key} {' → '.join(self.texts)}"


def differences_of(runs: Sequence[ComparedRun]) -> tuple[JobDifference, ...]:
    """Return what differs between the jobs of some runs: keys first, then what they make of machine and servo."""
    jobs = [run.results.job for run in runs]
    named = [*_job_values(jobs), *_machine_values(runs), *_servo_values(jobs)]
    return tuple(difference for difference in named if len(set(difference.texts)) > 1)


def _job_values(jobs: Sequence[Job]) -> Iterator[JobDifference]:
    tables = [dict(_flat(job.model_dump(exclude_none=True))) for job in jobs]
    for key in dict.fromkeys(key for table in tables for key in table):
        if key in _IGNORED:
            continue
        values = [table.get(key) for table in tables]
        kind = MACHINE if key == "machine" else JOB
        if any(isinstance(value, str) and "\n" in value for value in values):
            if len(set(values)) > 1:
                yield from _text_differences(key, values)
        else:
            yield JobDifference(kind, key, tuple(map(_text, values)))


def _flat(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield dotted keys with their values, those of tables and of lists of tables too."""
    for name, value in content.items():
        key = f"{prefix}{name}"
        if isinstance(value, Mapping):
            yield from _flat(value, f"{key}.")
        elif isinstance(value, list | tuple) and any(isinstance(item, Mapping) for item in value):
            yield from _flat({str(number): item for number, item in enumerate(value)}, f"{key}.")
        else:
            yield key, value


def _text(value: Any) -> str:
    if value is None:
        return NOTHING
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:.{_DIGITS}g}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_text, value))}]"
    return str(value)


def _text_differences(key: str, values: Sequence[Any]) -> Iterator[JobDifference]:
    """Yield the first line that differs between texts of several lines, and their numbers of lines."""
    lines = [[] if value is None else str(value).splitlines() for value in values]
    for number, row in enumerate(zip_longest(*lines, fillvalue=NOTHING), 1):
        if len(set(row)) > 1:
            yield JobDifference(JOB, f"{key}, line {number}", tuple(line.strip()[:_LONGEST] for line in row))
            break
    counts = tuple(f"{len(text)} lines" for text in lines)
    others = sum(len(set(row)) > 1 for row in zip_longest(*lines)) - 1
    if others:
        yield JobDifference(JOB, f"{key}, {others} further lines differ; length", counts)


def _machine_values(runs: Sequence[ComparedRun]) -> Iterator[JobDifference]:
    digests = tuple((run.run.machine_sha256 or run.results.machine.digest)[:_DIGEST] for run in runs)
    names = {run.results.job.machine for run in runs}
    if len(names) == 1:  # else the name has said it
        yield JobDifference(MACHINE, "machine, digest of its physics", digests)
    axes = [{axis.name: axis for axis in run.results.machine.axes} for run in runs]
    yield JobDifference(MACHINE, "axes", tuple(", ".join(f"{a.name} [{a.unit}]" for a in of.values()) for of in axes))
    for name in _shared(axes):
        unit = axes[0][name].unit
        for value, value_unit in _AXIS_VALUES.items():
            key = f"{name}: {value} [{_UNIT.sub(unit, value_unit)}]"
            yield JobDifference(MACHINE, key, tuple(_text(getattr(of[name], value)) for of in axes))


def _servo_values(jobs: Sequence[Job]) -> Iterator[JobDifference]:
    """Yield the servo's values by axis, each with its unit."""
    servos = [job.built_servo for job in jobs]
    yield JobDifference(SERVO, "laws", tuple(", ".join(map(str, servo.laws.names)) for servo in servos))
    yield JobDifference(SERVO, "servo period [ms]", tuple(_text(1e3 * servo.period) for servo in servos))
    numbers = [{axis.name: k for k, axis in enumerate(job.built_machine.axes)} for job in jobs]
    units = {axis.name: axis.unit for axis in jobs[0].built_machine.axes}
    for parameter in DERIVED:
        for axis in _shared(numbers):
            values = [
                servo.per_axis(parameter.name)[number[axis]] for servo, number in zip(servos, numbers, strict=True)
            ]
            unit = _UNIT.sub(units[axis], parameter.unit)
            key = f"{axis}: {parameter.name} [{unit}]" if unit else f"{axis}: {parameter.name}"
            yield JobDifference(SERVO, key, tuple(map(_text, values)))


def _shared(tables: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the names that all tables have, in the order of the first."""
    return [name for name in tables[0] if all(name in table for table in tables)]
