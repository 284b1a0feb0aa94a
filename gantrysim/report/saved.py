"""A run as it was saved: its folder read back, with the machine that it ran on."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path

from gantrysim.errors import InputError
from gantrysim.job.job import Job
from gantrysim.machine.machine import Machine, builtin_models
from gantrysim.report.folder import JOB, RUN, SUMMARY
from gantrysim.run import Run


@dataclass(frozen=True, eq=False)
class SavedRun:
    """What `gantrysim run` has written into a folder, as far as a picture of it needs it.

    Attributes:
        folder: that holds it.
        job: that ran.
        run: the record.
        machine: built from the job now.
        changed: whether what is stepped of the machine is no longer what the summary says that ran; its looks do not
            count. False where no summary says so.
    """

    folder: Path
    job: Job
    run: Run
    machine: Machine
    changed: bool

    def __post_init__(self) -> None:
        for what, had, has in (
            ("axes", self.run.axes, self.machine.axis_names),
            ("units", self.run.units, tuple(axis.unit for axis in self.machine.axes)),
        ):
            if had != has:
                raise InputError(
                    f"run {self.folder}: its record has the {what} {', '.join(had)}; its machine {self.machine.name} "
                    f"has {', '.join(has)} now: run {self.folder / JOB} again"
                )

    @classmethod
    def load(cls, folder: str | os.PathLike[str]) -> SavedRun:
        """Read the folder of a run.

        A machine of one's own is read from where its file was when it ran. Where the file has moved since, job.toml
        has to say where to: a relative path is taken from the run's folder.

        Raises:
            InputError: no such folder, one that holds no run, or a machine that is gone or has other axes now.
        """
        place = Path(folder)
        where = place.expanduser()
        if not where.exists():
            raise InputError(f"run {place}: no such folder; gantrysim run JOB --out {place} makes one")
        if not where.is_dir():
            raise InputError(f"run {place}: is a file, must be a folder that gantrysim run has written")
        missing = [name for name in (JOB, RUN) if not (where / name).is_file()]
        if missing:
            raise InputError(f"run {place}: holds no run: {' and '.join(missing)} missing")
        record = Run.load(where / RUN)
        job = Job.load(where / JOB)
        if job.machine not in builtin_models() and not Path(job.machine).expanduser().is_file():
            raise InputError(
                f"run {place}: its machine {job.machine} is gone: set machine in {place / JOB} to a file, or to one of "
                f"{', '.join(builtin_models())}"
            )
        return cls(place, job, record, job.built_machine, _changed(where / SUMMARY, job.built_machine))


def _changed(summary: Path, machine: Machine) -> bool:
    try:
        ran = json.loads(summary.read_text(encoding="utf-8"))["versions"]["machine_sha256"]
    except (OSError, ValueError, LookupError, TypeError):
        return False
    return bool(ran != machine.digest)
