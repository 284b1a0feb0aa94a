"""The report of one run."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, TypeVar

from gantrysim import plots
from gantrysim.budget import Budget, PartFigures
from gantrysim.job import Job
from gantrysim.machine import Machine
from gantrysim.metrics import THOUSANDTH, Analysis
from gantrysim.page.document import Column, Section, Table, write_page
from gantrysim.report import versions

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["headline", "run_sections", "write_run_page"]

_UM = 1e3
_WIDE, _HALF = 10.7, 5.3  # of a figure as wide as the page, and of one of two side by side [inch]
_MEANS = {
    "generation": "requested to commanded: the controller's program",
    "tracking": "commanded to encoder: servo, motor, friction",
    "measurement": "encoder to motor: the encoder's counts",
    "structure": "motor to nozzle: what lies behind the motor",
    "contour": "requested to nozzle: what the part sees",
}
_BLAME = {
    "generation": "the controller's program",
    "tracking": "the servo that follows it",
    "measurement": "the encoder's counts",
    "structure": "what lies behind the motors",
}
_NOTHING = 1e-6  # rms of an error that is none [mm]
Subject = TypeVar("Subject")

_ALMOST_ALL, _MOST = 0.9, 0.5  # of the mean square


def write_run_page(
    file: str | os.PathLike[str], job: Job, machine: Machine, analysis: Analysis, video: bytes | None = None
) -> None:
    """Write the report of a run as one HTML file.

    Args:
        file: to write.
        job: that ran.
        machine: it ran on.
        analysis: of its record.
        video: content of its video.mp4, or None without one.
    """
    fault = analysis.run.fault
    write_page(
        file,
        f"{job.name} on {machine.name}",
        f"{job.program['controller']}, servo period {1e3 * analysis.run.period:g} ms",
        list(run_sections(job, machine, analysis, video)),
        warning=None if fault is None else f"A fault ended this run: {fault}. All figures are of what came before it.",
    )


def run_sections(job: Job, machine: Machine, analysis: Analysis, video: bytes | None = None) -> Iterator[Section]:
    """Yield the sections of a run's report, see `write_run_page`."""
    budget = Budget(analysis)
    yield _summary(job, analysis, budget)
    yield _budget(budget)
    yield Section(
        "Plan view",
        figure=_drawn(plots.draw_plan, analysis, 7.6, 7.6),
        alternative="The requested path in plan view, and the nozzle's trace with its error magnified.",
    )
    if analysis.spacing.distance.size:
        yield _spacing(analysis)
    yield _errors(analysis)
    if video is not None:
        yield Section("Video", video=video)
    if job.notes:
        yield Section("Notes of the controller", list(job.notes))
    yield Section(
        "Job", "This file repeats the run to the last bit: save it, and call gantrysim run with it.", code=job.toml()
    )
    yield Section("Versions", table=Table(["", "version"], [list(item) for item in versions(machine).items()]))


def headline(budget: Budget) -> str:
    """Return the sentence that says which link of the chain caused most of the contour error, with figures."""
    figures = budget.figures
    whole = figures.contour
    if whole.rms < _NOTHING:
        return "The nozzle follows the requested path exactly: there is no error to share out."
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


def _summary(job: Job, analysis: Analysis, budget: Budget) -> Section:
    figures, run = analysis.figures, analysis.run
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


def _budget(budget: Budget) -> Section:
    figures = budget.figures
    columns: list[str | Column] = [
        "link",
        "from one of its ends to the other",
        Column("share [%]", ".1f"),
        Column("rms [µm]", ".1f"),
        Column("95 % [µm]", ".1f"),
        Column("max [µm]", ".1f"),
        Column("at s [mm]", ".1f"),
        Column("t [s]", ".3f"),
        "x, y, z [mm]",
    ]

    def row(name: str, part: PartFigures) -> list[str | float | None]:
        numbers = [100 * part.share, *(_UM * value for value in (part.rms, part.p95, part.max))]
        point = ", ".join(f"{value:.1f}".replace("-", "−") for value in part.point)
        where = [None] * 3 if part.rms < _NOTHING else [part.s, part.time, point]
        return [name, _MEANS[name], *numbers, *where]

    rows = [row(name, part) for name, part in figures.parts.items()]
    rows.append(row("contour", figures.contour))
    links = Table(
        columns,
        rows,
        "Error normal to the requested path; its share of the mean square, and where it is largest",
        plots.COLOURS,
    )
    tables = [links]
    if figures.turns:
        tables.append(_turns(budget))
    text = [
        "At every tick the error of the nozzle normal to the requested path is the sum of the links' parts. A link's "
        "share of the mean square is the mean of its part times the whole error; a share below zero is that of a link "
        "that makes good for others.",
        f"Along the path the nozzle lags the command by {_UM * figures.lag.rms:.1f} µm rms, at most "
        f"{_UM * figures.lag.max:.1f} µm, which is no error normal to it.",
    ]
    tall = 4.4 if figures.turns else 1.6
    return Section(
        "Error budget",
        text,
        table=tables,
        figure=[
            _drawn(plots.draw_budget, budget, _WIDE, tall),
            _drawn(plots.draw_budget_along, budget, _WIDE, 8.0),
        ],
        alternative=[
            "The links' shares of the contour error's mean square as a stacked bar, and the rms error by turn.",
            "The contour error and the part of every link over the path's length.",
        ],
    )


def _errors(analysis: Analysis) -> Section:
    figures, run = analysis.figures, analysis.run
    axes: list[list[str | float]] = [
        [name, THOUSANDTH[unit], 1e3 * spread.rms, 1e3 * spread.max]
        for unit, (name, spread) in zip(run.units, figures.tracking.items(), strict=True)
    ]
    along = figures.tracking_along
    axes.append(["along the path", "µm", _UM * along.rms, _UM * along.max])
    table = Table(
        ["axis", "unit", Column("rms", ".1f"), Column("max", ".1f")],
        axes,
        "Tracking error, commanded to encoder; rms and max in the row's unit",
    )
    return Section(
        "Errors over time",
        figure=_drawn(plots.draw_error, analysis, _WIDE, 6.5 if len(set(run.units)) == 1 else 8.5),
        table=table,
        alternative="Tracking error of every axis, and the error normal to the requested path, over time.",
    )


def _turns(budget: Budget) -> Table:
    names = [*budget.parts, "contour"]
    columns: list[str | Column] = ["turn", Column("from s [mm]", ".1f"), Column("to s [mm]", ".1f")]
    columns += [Column(f"{name}, rms [µm]", ".1f") for name in names]
    columns.append(Column("contour, max [µm]", ".1f"))
    rows = []
    for turn in budget.figures.turns:
        rms = [_UM * turn.parts[name].rms for name in names]
        rows.append([turn.turn, *turn.s, *rms, _UM * turn.parts["contour"].max])
    return Table(columns, rows, "By turn of the path's tangent")


def _spacing(analysis: Analysis) -> Section:
    return Section(
        "Spacing of neighbouring turns",
        figure=[
            _drawn(plots.draw_polar_spacing, analysis, _HALF, 4.8),
            _drawn(plots.draw_spacing, analysis, _HALF, 4.8),
        ],
        alternative=[
            "Spacing of neighbouring turns over the direction in the path's plane, turn by turn.",
            "Spacing of neighbouring turns over the angle of the tangent within the turn, turn by turn.",
        ],
    )


def _drawn(draw: Callable[[Figure, Subject], None], subject: Subject, width: float, height: float) -> Figure:
    with plots.sheet(width, height) as figure:
        draw(figure, subject)
    return figure
