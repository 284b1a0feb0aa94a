"""What a record offers in one call: verdict, error budget, figure, report and film.

The rooms that judge and draw a run lie above this one and import it. Loading a record must need nothing of them, nor of
MuJoCo: a saved run is read on machines that only evaluate it. Each is therefore imported by its name at its first use,
as pandas imports the library that draws its plots. Types are in the stub beside this file, for editors and mypy.
"""

from __future__ import annotations

import os
from functools import cached_property
from importlib import import_module
from typing import Any

from gantrysim.base.errors import InputError


class Conveniences:
    """Mixin of `Run`: its evaluation, by the rooms above.

    Attributes:
        job: the `Job` that the run is of; None where it was made by `simulate` or read without its job.
    """

    job: Any
    fault: Any
    dispense: Any

    @cached_property
    def budget(self) -> Any:
        """The `Budget` of the contour error.

        Raises:
            InputError: the dispenser is never on.
        """
        return _named("gantrysim.metrics.budget", "Budget")(self)

    @cached_property
    def verdict(self) -> Any:
        """The `Verdict`: path, glue, stability and machine against the job's tolerances.

        Raises:
            InputError: the run has no job, or its dispenser is never on.
        """
        job = self._job("verdict", "gantrysim.Verdict.of(job, run)")
        return _named("gantrysim.results.verdict", "Verdict").of(job, self)

    @property
    def verdict_headline(self) -> str:
        """The verdict in a line; empty where nothing can be judged: no glue, or no job whose code may run."""
        is_judged = self.job is not None and (self.fault is not None or bool(self.dispense.any()))
        try:
            return self.verdict.headline if is_judged else ""
        except InputError:  # a saved job that names code which may not run here: its loops are unknown
            return ""

    def plot(self) -> Any:
        """Return a matplotlib figure: the plan, coloured by the error, beside the error budget.

        Raises:
            InputError: the dispenser is never on.
        """
        return _named("gantrysim.report.plots.overview", "overview")(self.budget)

    def report(
        self, folder: str | os.PathLike[str], *, causes: bool = True, improve: bool = True, progress: Any = None
    ) -> Any:
        """Write the files of `gantrysim run` without the film into a folder; return the path of report.html.

        Args:
            folder: to write to; files of an earlier run are replaced.
            causes: whether to run the job again with one cause of error at a time switched off.
            improve: whether to simulate what may improve the two worst rows of a verdict that is no pass.
            progress: as in `simulate`.

        Raises:
            InputError: the run has no job, or the folder cannot be written.
        """
        job = self._job("report", "run.replaced(job=job).report(folder)")
        changes = _named("gantrysim.remedy.report", "changes_of") if improve else None
        return _named("gantrysim.report.writing", "write_report")(job, self, folder, causes, changes, progress)

    def film(self, file: str | os.PathLike[str], **options: Any) -> int:
        """Write a film of the run, MP4 or GIF, and return its number of frames.

        Args:
            file: to be written.
            options: keywords of `gantrysim.render.save_video`.

        Raises:
            InputError: the run has no job, or as `gantrysim.render.save_video`.
        """
        job = self._job("film", "gantrysim.render.save_video(machine, run, file)")
        values = {"bead": job.bead, "label": job.name, "verdict": self.verdict_headline, **options}
        frames: int = _named("gantrysim.render", "save_video")(job.built_machine, self, file, **values)
        return frames

    def _job(self, name: str, alternative: str) -> Any:
        """Return the job, or raise InputError with what to write instead."""
        if self.job is None:
            raise InputError(f"run.{name}: the run has no job: write {alternative}")
        return self.job


def _named(module: str, name: str) -> Any:
    return getattr(import_module(module), name)
