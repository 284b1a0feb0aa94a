"""Measure cases in a worker: check that it computes the study's numbers, and measure.

A worker may be the study's own process, a copy that it started, or a process on another computer.
"""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import platform
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

from gantrysim.base.errors import GantryError, InputError
from gantrysim.base.extras import package_versions
from gantrysim.study.cases import Case, Row, forget_jobs, machine_digest

MeasureTogether = Callable[[Sequence[Case]], Sequence[Row]]  # one row per case, in order

_SOURCES = "source files of gantrysim"
_SHOWN = 12  # digits of a digest


class WorkerError(GantryError):
    """A worker ended, or would compute other numbers than the study."""


@dataclass(frozen=True)
class Origin:
    """Identity of a study's process, for its workers.

    Attributes:
        host: name of its computer.
        process: process number there.
        installed: versions that its numbers depend on, as (name, version).
        machines: machines of its cases, as (name or file, digest); None for one that is refused.
    """

    host: str
    process: int
    installed: tuple[tuple[str, str], ...]
    machines: tuple[tuple[str, str | None], ...]

    @classmethod
    def here(cls, cases: Sequence[Case]) -> Origin:
        """Return the identity of this process, with the machines of these cases."""
        machines = {case.machine: case for case in cases}
        digests = tuple((name, _digest(case)) for name, case in machines.items())
        return cls(platform.node(), os.getpid(), _installed_versions(), digests)


class Measured(NamedTuple):
    """Cases that a worker has measured.

    Attributes:
        rows: with the keys of their cases.
        seconds: that it took [s].
    """

    rows: list[tuple[str, Row]]
    seconds: float


def measured_rows(measure: MeasureTogether, cases: Sequence[Case], origin: Origin) -> Measured:
    """Measure cases.

    Raises:
        WorkerError: this process differs from the study's in its versions or machines.
    """
    begin = time.perf_counter()
    if not _started_by(origin) and (platform.node(), os.getpid()) != (origin.host, origin.process):  # started by others
        _check_installed(origin)
    _check_machines(cases, origin)
    # as read back from the ledger: tuples become lists, keys strings
    rows: list[Row] = json.loads(json.dumps(list(measure(cases)), allow_nan=False))
    keys = [case.key for case in cases]
    return Measured(list(zip(keys, rows, strict=True)), time.perf_counter() - begin)


def _started_by(origin: Origin) -> bool:
    """Return whether the study's process started this one."""
    copied = multiprocessing.current_process().name != "MainProcess"
    return copied and (platform.node(), os.getppid()) == (origin.host, origin.process)


def _check_installed(origin: Origin) -> None:
    installed = dict(_installed_versions())
    other = [
        f"{name} {installed[name]} instead of {value}" for name, value in origin.installed if installed[name] != value
    ]
    if other:
        raise WorkerError(f"{_name()}: has {', '.join(other)}: must have the study's")


def _check_machines(cases: Sequence[Case], origin: Origin) -> None:
    """Check that the machines equal the study's; a machine whose file has changed is built again."""
    expected = dict(origin.machines)
    for name, case in {case.machine: case for case in cases}.items():
        if _digest(case) != expected[name]:
            forget_jobs()
        if _digest(case) != expected[name]:
            raise WorkerError(
                f"{_name()}: machine {name} differs from the study's: its files must be the same, at the same place, "
                "for every worker"
            )


def _digest(case: Case) -> str | None:
    # reported in the case's row
    with suppress(InputError):
        return machine_digest(case)
    return None


def _name() -> str:
    return f"worker on {platform.node()}, process {os.getpid()}"


@cache
def _installed_versions() -> tuple[tuple[str, str], ...]:
    """Return the versions that numbers depend on, as (name, version)."""
    digest = hashlib.sha256()
    root = Path(str(files("gantrysim")))
    for file in sorted(file for kind in ("*.py", "*.xml") for file in root.rglob(kind)):
        digest.update(file.relative_to(root).as_posix().encode() + b"\0" + file.read_bytes())
    system = f"{platform.system()} {platform.machine()}"
    return (*package_versions().items(), ("system", system), (_SOURCES, digest.hexdigest()[:_SHOWN]))
