"""What the command line shows of a run: the links of the chain with their errors, and what came out at its end."""

from __future__ import annotations

import math

from rich.markup import escape
from rich.table import Table

from gantrysim.bead import BeadValues
from gantrysim.machine.machine import Machine
from gantrysim.metrics.analysis import THOUSANDTH, AnalysisValues
from gantrysim.metrics.budget import DESCRIPTIONS, Budget, PartValues
from gantrysim.run import Run

_UM = 1e3


def links_table(name: str, machine: Machine, budget: Budget) -> Table:
    """Return the error budget: the chain's links from top to bottom with what each adds to the error.

    Args:
        name: of the job.
        machine: that ran.
        budget: of the run.
    """
    run, figures = budget.analysis.run, budget.values
    until = "" if run.fault is None else ", until the fault"
    title = escape(f"{name} on {run.machine}: error normal to the path [µm]{until}")
    table = Table(title=title, title_justify="left")
    table.add_column("link", no_wrap=True)
    for column in ("rms", "95 %", "max", "share"):
        table.add_column(column, justify="right", no_wrap=True)
    table.add_column("what the link adds")

    def add(label: str, part: PartValues, note: str) -> None:
        numbers = [f"{_UM * value:.1f}" for value in (part.rms, part.p95, part.max)]
        table.add_row(label, *numbers, f"{100 * part.share:z.1f} %", note)

    for link, part in figures.parts.items():
        add(link, part, DESCRIPTIONS[link])
        if link == "tracking":
            for axis, own in budget.tracking_by_axis(machine).items():
                add(f"  by {axis}", budget.values_of(own), "")
    table.add_section()
    add("contour", figures.contour, DESCRIPTIONS["contour"])
    table.caption = "share: of the contour error's mean square; negative: makes good for others"
    table.caption_justify = "left"
    return table


def outcome_table(run: Run, figures: AnalysisValues, bead: BeadValues | None) -> Table:
    """Return what came out: following errors, spacing, speed, and the bead where glue was asked for."""
    until = "" if run.fault is None else ", until the fault"
    table = Table.grid(padding=(0, 2))
    for unit, (axis, spread) in zip(run.units, figures.tracking.items(), strict=True):
        rms, largest = (f"{_UM * value:.1f} {THOUSANDTH[unit]}" for value in (spread.rms, spread.max))
        table.add_row(f"following error {axis}", rms, f"max {largest}")
    if figures.spacing is not None:
        s = figures.spacing
        asked = f"std {s.std:.4f}, {s.min:.4f} to {s.max:.4f}"
        if run.requested.turn_spacing is not None:
            asked = f"asked for {run.requested.turn_spacing:g}, {asked}"
        table.add_row("spacing of turns", f"{s.mean:.4f} mm", asked)
    v = figures.speed
    table.add_row("path speed", f"{v.mean:.2f} mm/s", f"{v.min:.2f} to {v.max:.2f}")
    table.add_row("path length", f"{figures.path_length:.3f} mm", f"in {figures.duration:.3f} s{until}")
    table.add_row("end point", "", "x {:.4f}, y {:.4f}, z {:.4f} mm".format(*figures.end_point))
    if bead is not None:
        _add_bead(table, bead)
    return table


def _add_bead(table: Table, bead: BeadValues) -> None:
    width = bead.width
    table.add_row(
        "bead's width",
        f"{width.mean:.3f} mm",
        f"{width.min:.3f} to {width.max:.3f}; section asked for {bead.nominal:.3f} mm²",
    )
    if bead.clearance is not None and bead.coverage is not None:
        between = "gap" if bead.clearance.mean > 0 else "overlap"
        covered = f"{bead.clearance.min:.3f} to {bead.clearance.max:.3f}; {100 * bead.coverage:.1f} % covered"
        table.add_row(f"{between} of turns", f"{abs(bead.clearance.mean):.3f} mm", f"clearance {covered}")
    table.add_row("missing at the start", f"{bead.start_shortfall.mean:+.2f} mm", "of nominal bead")
    if bead.stop_excess is not None:
        table.add_row("too much at the stop", f"{bead.stop_excess.mean:+.2f} mm", "of nominal bead")
    table.add_row(
        "volume",
        f"{bead.volume:.4g} mm³",
        f"{bead.volume_error_percent:+.2f} % of {bead.requested_volume:.4g} asked for",
    )
    parts = {
        "ramps": bead.ramp_error,
        "starts": bead.start_error,
        "running": bead.steady_error,
        "stops": bead.stop_error,
    }
    told = ", ".join(f"{name} {_volume(value, bead.requested_volume)}" for name, value in parts.items())
    table.add_row("volume error", f"{_volume(bead.volume_error, bead.requested_volume)} mm³", told)
    if bead.ridge:
        table.add_row("height map", "not settled", bead.ridge_note)


def _volume(value: float, whole: float) -> str:
    """A part of a volume down to a hundred thousandth of the whole."""
    decimals = max(0, 5 - math.ceil(math.log10(max(whole, 1e-9))))
    return f"{value:+.{min(decimals, 9)}f}"
