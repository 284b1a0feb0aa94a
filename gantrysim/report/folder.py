"""The output folder of a command, replaced as a whole: the files of a run in it, and a saved run read back."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gantrysim.base.errors import InputError, expanded_path
from gantrysim.base.files import check_free, check_whole, held_folder, pending, replaced_files
from gantrysim.base.input_files import read_toml
from gantrysim.job.basis import Basis
from gantrysim.job.content import content_digest
from gantrysim.job.job import Job
from gantrysim.machine.machine import Machine, builtin_models
from gantrysim.record.run import Run
from gantrysim.record.run_file import RUN
from gantrysim.report.document import Changes
from gantrysim.report.summary import fault_summary, summary
from gantrysim.results.run_results import RunResults

JOB = "job.toml"
SUMMARY = "summary.json"
VIDEO = "video.mp4"
PLOTS = "plots"
RENDER = "render"  # stem of the file that gantrysim render draws of a saved run
REPORT = "report.html"
CARD = "card.png"
RECORD = "record.csv"  # what the controller itself records, where its program asks for it
_PLOT_NAMES = ("plan", "error", "budget", "spacing", "bead")
_RENDERED = tuple(f"{RENDER}{suffix}" for suffix in (".mp4", ".gif", ".png"))
_SHOWN = (SUMMARY, VIDEO, REPORT, CARD, *(f"{PLOTS}/{name}.png" for name in _PLOT_NAMES))


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
            InputError: it is a file, or holds files of these names without `mark`, or folders of these names.
        """
        target = expanded_path(folder).absolute()
        if target.exists() and not target.is_dir():
            raise InputError(f"--out {folder}: is a file, must be a folder")
        # files are on their way: looked at by `written`, once the folder is held
        if pending(target):
            return target
        check_free(target, self.files, f"--out {folder}")
        foreign = [name for name in self.files if (target / name).exists()]
        if foreign and not (target / self.mark).exists():
            raise InputError(
                f"--out {folder}: holds {foreign[0]}, which no {self.kind} has written: name another folder"
            )
        return target

    def names_in(self, folder: Path) -> list[str]:
        """Return the names of the files in a folder, and of the folder of plots, that such a command has written."""
        return sorted({name.partition("/")[0] for name in self.files if (expanded_path(folder) / name).exists()})

    @contextmanager
    def held(self, folder: Path) -> Iterator[None]:
        """Hold a folder in the block, see `gantrysim.base.files.held_folder`.

        Raises:
            InputError: as `check`, or the folder is in use by another command.
        """
        with held_folder(self.check(folder), f"--out {folder}", self.files):
            yield

    @contextmanager
    def written(self, folder: Path) -> Iterator[Path]:
        """Yield a hidden folder in a held one, whose files replace an earlier command's on success.

        Raises:
            InputError: as `check`, or the folder cannot be written.
        """
        with replaced_files(self.check(folder), self.files, f"--out {folder}") as scratch:
            (scratch / PLOTS).mkdir()
            yield scratch


RUN_OUTPUT = Output("run", RUN, (JOB, RUN, RECORD, *_RENDERED, *_SHOWN))
# what is written beside the record of a run, once that is on disk
SHOWN_OUTPUT = Output("run", RUN, _SHOWN)
# what is written again once it is known what to change
CHANGED_OUTPUT = Output("run", RUN, (SUMMARY, REPORT, CARD))


# of any study, with its own plots and texts
STUDY_FILES = ("study.csv", "curves.csv", "study.toml", "tuned.toml", JOB, REPORT, f"{PLOTS}/*.png")


@contextmanager
def output_folder(folder: Path, output: Output = RUN_OUTPUT) -> Iterator[Path]:
    """Hold a folder and yield a hidden one in it, whose files replace an earlier command's on success.

    Other files in the folder stay. On failure nothing is left, not even a folder that this call created.

    Raises:
        InputError: the folder cannot be written, is in use by another command, or holds files of these names that no
            such command has written.
    """
    with output.held(folder), output.written(folder) as scratch:
        yield scratch


def write_run(folder: Path, results: RunResults) -> None:
    """Write job, record, summary, and the controller's own record into a folder; without a job, record and summary."""
    _write(folder, results.basis, results.budget.analysis.run, summary(results))


def write_summary(folder: Path, results: RunResults, changes: Changes | None = None) -> None:
    """Write the summary alone, beside a record that is written, with what to change in the job if that is known."""
    _write_content(folder, summary(results, changes))


def write_fault(folder: Path, job: Basis, machine: Machine, run: Run) -> None:
    """Write the files of a run that a fault ended before the dispenser was on."""
    _write(folder, job, run, fault_summary(job, machine, run))


def _write(folder: Path, job: Basis, run: Run, content: dict[str, Any]) -> None:
    digests = {"machine_sha256": content["versions"]["machine_sha256"]}
    if isinstance(job, Job):
        (folder / JOB).write_text(job.toml(), encoding="utf-8")
        job.controller.write_record(run, folder / RECORD)
        digests["job_sha256"] = job.digest
    run.replaced(**digests).save(folder / RUN)
    _write_content(folder, content)


def _write_content(folder: Path, content: dict[str, Any]) -> None:
    (folder / SUMMARY).write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")


@dataclass(frozen=True, eq=False)
class SavedRun:
    """A run loaded from a folder written by `gantrysim run`.

    Attributes:
        folder: the folder.
        job: the job of the run.
        run: the record.
        machine: machine of the job, built at loading.
        changed: whether the physics of the machine differ from the digest in the record; visual changes do not count.
            False without a digest, as in a record that was saved without its job.
        written: time at which the record was written [ns].
    """

    folder: Path
    job: Job
    run: Run
    machine: Machine
    changed: bool
    written: int = 0

    def __post_init__(self) -> None:
        for kind, had, has in (
            ("axes", self.run.axes, self.machine.axis_names),
            ("units", self.run.units, tuple(axis.unit for axis in self.machine.axes)),
        ):
            if had != has:
                raise InputError(
                    f"run {self.folder}: its record has the {kind} {', '.join(had)}; its machine {self.machine.name} "
                    f"has {', '.join(has)} now: run {self.folder / JOB} again"
                )

    @classmethod
    def load(cls, folder: str | os.PathLike[str]) -> SavedRun:
        """Load the folder of a run.

        A machine file is read from the path in job.toml; a relative path starts from the run's folder.

        Raises:
            InputError: no such folder, no run in it, a record that is damaged or of another format, a job that is not
                the record's, or a machine that is missing or has other axes now.
        """
        where = expanded_path(folder)
        place = Path(folder)
        if not where.exists():
            raise InputError(f"run {place}: no such folder; gantrysim run JOB --out {place} makes one")
        if not where.is_dir():
            raise InputError(f"run {place}: is a file, must be a folder that gantrysim run has written")
        check_whole(where, f"run {place}")
        missing = [name for name in (JOB, RUN) if not (where / name).is_file()]
        written = _time_of_record(where)
        if missing == [JOB] and not Run.load(where / RUN).job_sha256:
            raise InputError(
                f"run {place}: its record was written from Python, without a job, which commands need: read it with "
                f"gantrysim.Run.load({str(place / RUN)!r}), and film it with .replaced(rig=gantrysim.Rig(machine, "
                "servo, dispenser)).film(file) behind it"
            )
        if missing:
            raise InputError(f"run {place}: holds no run: {' and '.join(missing)} missing")
        record = Run.load(where / RUN)
        content = read_toml(where / JOB, f"job {place / JOB}")
        if record.job_sha256 and record.job_sha256 != content_digest(content):
            raise InputError(
                f"run {place}: {JOB} is not the job that {RUN} was made from: put that one back, or run this one again "
                f"with gantrysim run {place / JOB}"
            )
        job = Job.of_record(where / JOB)
        if job.machine not in builtin_models() and not expanded_path(job.machine).is_file():
            raise InputError(
                f"run {place}: its machine {job.machine} is missing: set machine in {place / JOB} to a file, or "
                f"to one of {', '.join(builtin_models())}"
            )
        changed = record.machine_sha256 not in ("", job.built_machine.digest)
        saved = cls(place, job, record.replaced(job=job), job.built_machine, changed, written)
        return saved if saved.is_current else cls.load(folder)

    @property
    def is_current(self) -> bool:
        """Whether the folder still holds this record, not a later run's."""
        return _time_of_record(expanded_path(self.folder)) == self.written


def _time_of_record(folder: Path) -> int:
    return (folder / RUN).stat().st_mtime_ns if (folder / RUN).exists() else 0
