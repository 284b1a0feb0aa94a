"""The report of one run."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

from gantrysim.bead import Bead
from gantrysim.job.job import Job
from gantrysim.machine.machine import Machine
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.report.document import Section, Table, write_page
from gantrysim.report.folder import versions
from gantrysim.report.sections import bead_section, budget_section, errors_section, plan_section, spacing_section
from gantrysim.report.servo import servo_section

_UM = 1e3
_BLAME = {
    "generation": "the controller's program",
    "tracking": "the servo and its motors",
    "measurement": "the encoder's counts",
    "structure": "what lies behind the motors",
}
_BEFORE = "All figures are of what came before it."
_NOTHING = 1e-6  # rms of an error that is none [mm]
_ALMOST_ALL, _MOST = 0.9, 0.5  # of the mean square


def write_run_page(
    file: str | os.PathLike[str],
    job: Job,
    machine: Machine,
    bead: Bead,
    video: str | os.PathLike[str] | None = None,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Write the report of a run as one HTML file.

    Args:
        file: to write.
        job: that ran.
        machine: it ran on.
        bead: of the run, with or without glue.
        video: its MP4 file; None, or a file that there is not, without one.
        progress: called with the share that is done.
    """
    run = bead.run
    write_page(
        file,
        f"{job.name} on {machine.name}",
        f"{job.program['controller']}, servo period {1e3 * run.period:g} ms",
        list(run_sections(job, machine, bead, None if video is None else Path(video))),
        warning=None if run.fault is None else f"A fault ended this run: {run.fault}. {_BEFORE}",
        progress=progress,
    )


def run_sections(job: Job, machine: Machine, bead: Bead, video: Path | None = None) -> Iterator[Section]:
    """Yield the sections of a run's report, see `write_run_page`."""
    analysis = bead.analysis
    budget = Budget(analysis)
    yield _summary(analysis, budget)
    yield budget_section(budget, machine)
    yield plan_section(analysis)
    if analysis.spacing.distance.size:
        yield spacing_section(analysis)
    if bead.nominal > 0:
        yield bead_section(bead)
    yield errors_section(analysis)
    yield servo_section(job, machine, analysis.run)
    if video is not None and video.exists():
        yield Section("Video", video=video.read_bytes())
    if job.notes:
        yield Section("Notes of the controller", job.notes)
    again = "Saved as a file and given to gantrysim run, this repeats the run to the last bit."
    yield Section("Job", again, code=job.toml())
    yield Section("Versions", table=Table(["", "version"], [list(item) for item in versions(machine).items()]))


def headline(budget: Budget) -> str:
    """Return the sentence that says which link of the chain caused most of the contour error, with figures."""
    figures = budget.values
    whole = figures.contour
    if whole.rms < _NOTHING:
        until = "" if budget.analysis.run.fault is None else "Until the fault "
        sentence = "the nozzle follows the requested path exactly: there is no error to share out."
        return until + sentence if until else sentence.capitalize()
    name, part = max(figures.parts.items(), key=lambda item: item[1].share)
    much = "Almost all" if part.share >= _ALMOST_ALL else "Most" if part.share > _MOST else "The largest part"
    sentence = (
        f"{much} of the nozzle's error comes from {_BLAME[name]} ({name}): {_UM * part.rms:.1f} µm rms, where "
        f"the nozzle is {_UM * whole.rms:.1f} µm off."
    )
    others = [(other, rest) for other, rest in figures.parts.items() if other != name and rest.rms >= _NOTHING]
    if others:
        other, rest = max(others, key=lambda item: item[1].rms)
        sentence += f" Next comes {_BLAME[other]} ({other}) with {_UM * rest.rms:.1f} µm rms."
    x, y, _ = whole.point
    return (
        f"{sentence} The nozzle is furthest off, {_UM * whole.max:.0f} µm, at t = {whole.time:.2f} s, "
        f"x = {x:.1f}, y = {y:.1f} mm."
    )


def _summary(analysis: Analysis, budget: Budget) -> Section:
    figures, run = analysis.values, analysis.run
    facts = [
        ("Contour error, rms", f"{_UM * figures.contour.rms:.1f} µm", f"max {_UM * figures.contour.max:.1f} µm"),
        (
            "Generation error, rms",
            f"{_UM * figures.generation.rms:.1f} µm",
            f"max {_UM * figures.generation.max:.1f} µm",
        ),
    ]
    if figures.spacing is not None:
        asked = run.requested.turn_spacing
        facts.append(
            (
                "Spacing of the turns",
                f"{figures.spacing.mean:.4f} mm",
                f"{'' if asked is None else f'asked for {asked:g}, '}std {figures.spacing.std:.4f} mm",
            )
        )
    speed = figures.speed
    facts.append(("Path speed", f"{speed.mean:.2f} mm/s", f"from {speed.min:.2f} to {speed.max:.2f} mm/s"))
    facts.append(("Path length", f"{figures.path_length:.1f} mm", f"in {figures.duration:.2f} s"))
    return Section("Summary", headline(budget), facts=facts)
