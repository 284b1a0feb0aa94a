"""Saved runs: the folder of a run read back, with its machine."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from gantrysim.base.errors import InputError, expanded_path
from gantrysim.base.files import check_whole
from gantrysim.base.toml_files import read_toml
from gantrysim.job.content import content_digest
from gantrysim.job.job import Job
from gantrysim.machine.machine import Machine, builtin_models
from gantrysim.record.run import Run
from gantrysim.record.run_file import RUN
from gantrysim.report.folder import JOB


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
        written = _written(where)
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
        return _written(expanded_path(self.folder)) == self.written


def _written(folder: Path) -> int:
    return (folder / RUN).stat().st_mtime_ns if (folder / RUN).exists() else 0
