"""The output folder of a command, replaced as a whole, and the files of a run in it."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gantrysim.bead import BeadValues
from gantrysim.errors import InputError, expanded
from gantrysim.job.causes import Causes
from gantrysim.job.job import Job
from gantrysim.job.losses import Losses
from gantrysim.machine.machine import Machine
from gantrysim.metrics.budget import Budget
from gantrysim.report.summary import fault_summary, summary
from gantrysim.run import Run

JOB, RUN, SUMMARY, VIDEO, PLOTS = "job.toml", "run.npz", "summary.json", "video.mp4", "plots"
RENDER = "render"  # stem of the file that gantrysim render draws of a saved run
REPORT = "report.html"
RECORD = "record.csv"  # what the controller itself records, where its program asks for it
_PLOT_NAMES = ("plan", "error", "budget", "spacing", "bead")
_RENDERED = tuple(f"{RENDER}{suffix}" for suffix in (".mp4", ".gif", ".png"))
_FILES = (JOB, RUN, SUMMARY, VIDEO, REPORT, RECORD, *_RENDERED, *(f"{PLOTS}/{name}.png" for name in _PLOT_NAMES))

_PARTIAL = ".partial-"  # followed by the number of the writing process


@dataclass(frozen=True)
class Output:
    """The files that one kind of command writes into its folder.

    Attributes:
        kind: what the command makes, as messages name it.
        mark: file that identifies a folder of this kind.
        files: all that it may write, `mark` included, in the folder or its subfolder of plots.
    """

    kind: str
    mark: str
    files: tuple[str, ...]

    def check(self, folder: Path) -> Path:
        """Return the absolute path of a folder that may be written to.

        Raises:
            InputError: it is a file, or holds files of these names without `mark`.
        """
        target = expanded(folder).absolute()
        if target.exists() and not target.is_dir():
            raise InputError(f"--out {folder}: is a file, must be a folder")
        foreign = [name for name in self.files if (target / name).exists()]
        if foreign and not (target / self.mark).exists():
            raise InputError(
                f"--out {folder}: holds {foreign[0]}, which no {self.kind} has written: name another folder"
            )
        return target


_RUN_OUTPUT = Output("run", RUN, _FILES)


@contextmanager
def output_folder(folder: Path, output: Output = _RUN_OUTPUT) -> Iterator[Path]:
    """Yield a scratch folder inside `folder`; on success its files replace those of an earlier command.

    Other files in the folder stay. On failure nothing is left, not even a folder that this call created.

    Raises:
        InputError: the folder cannot be written, or holds files of these names that no such command has written.
    """
    target = output.check(folder)
    created = [parent for parent in (target, *target.parents) if not parent.exists()]
    try:
        target.mkdir(parents=True, exist_ok=True)
        _remove_abandoned(target)
        scratch = Path(tempfile.mkdtemp(prefix=partial_name(""), dir=target))
    except OSError as error:
        raise InputError(f"--out {folder}: cannot be written: {error.strerror}") from None
    try:
        (scratch / PLOTS).mkdir()
        yield scratch
        (target / PLOTS).mkdir(exist_ok=True)
        for name in output.files:
            if (scratch / name).exists():
                (scratch / name).replace(target / name)
            else:
                (target / name).unlink(missing_ok=True)
        with suppress(OSError):  # not empty
            (target / PLOTS).rmdir()
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
        if not (target / output.mark).exists():
            for parent in created:
                with suppress(OSError):
                    parent.rmdir()


def partial_name(name: str) -> str:
    """Return the hidden name under which this process writes `name` until the file is complete."""
    return f"{_PARTIAL}{os.getpid()}-{name}"


def _remove_abandoned(folder: Path) -> None:
    """Remove the partial files of processes that no longer exist."""
    for partial in folder.glob(f"{_PARTIAL}*"):
        owner = partial.name.removeprefix(_PARTIAL).partition("-")[0]
        if owner.isdigit() and not _alive(int(owner)):
            shutil.rmtree(partial, ignore_errors=True)


def _alive(process: int) -> bool:
    """Return whether a process exists; True where asking could end it, as on Windows."""
    if os.name != "posix":
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    return True


def write_run(
    folder: Path,
    job: Job,
    machine: Machine,
    budget: Budget,
    bead: BeadValues | None = None,
    causes: Causes | None = None,
    losses: Losses | None = None,
) -> None:
    """Write job, record, summary, and the controller's own record into a folder."""
    _write(folder, job, budget.analysis.run, summary(job, machine, budget, bead, causes, losses))


def write_fault(folder: Path, job: Job, machine: Machine, run: Run) -> None:
    """Write the files of a run that a fault ended before the dispenser was on."""
    _write(folder, job, run, fault_summary(job, machine, run))


def _write(folder: Path, job: Job, run: Run, content: dict[str, Any]) -> None:
    (folder / JOB).write_text(job.toml(), encoding="utf-8")
    run.save(folder / RUN)
    (folder / SUMMARY).write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    job.controller.write_record(run, folder / RECORD)
