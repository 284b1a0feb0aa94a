"""The tables that the command line shows of a run: the error budget, and the results."""

from __future__ import annotations

from typing import Literal

from rich.markup import escape
from rich.table import Table

from gantrysim.base.display import decimals_of
from gantrysim.bead import BeadValues
from gantrysim.job.causes import TITLE, Causes, cell_text
from gantrysim.job.losses import Losses, events
from gantrysim.job.margins import LOW_MARGIN
from gantrysim.job.plan import Plan
from gantrysim.job.scatter import Scatter
from gantrysim.machine.machine import Machine
from gantrysim.metrics.analysis import THOUSANDTH, AnalysisValues
from gantrysim.metrics.budget import DESCRIPTIONS, Budget
from gantrysim.metrics.parts import CORNER, PartValues
from gantrysim.record.run import Run
from gantrysim.report.scatter import HEADS, remark_of, rows_of
from gantrysim.report.scatter import TITLE as SCATTER
from gantrysim.results.verdict import Verdict
from gantrysim.stability.margins import NO_LOOP, Margins

_UM = 1e3
_MB = 1e6


def links_table(name: str, machine: Machine, budget: Budget) -> Table:
    """Return the error budget of a run of the job `name`, a row per link of the chain."""
    run = budget.analysis.run
    values = budget.values
    until = "" if run.fault is None else ", until the fault"
    title = escape(f"{name} on {run.machine}: error normal to the path [µm]{until}")
    table = Table(title=title, title_justify="left")
    table.add_column("link", no_wrap=True)
    for column in ("rms", "95 %", "max", "share"):
        table.add_column(column, justify="right", no_wrap=True)
    table.add_column("span")

    def add(label: str, part: PartValues, span: str = "") -> None:
        numbers = [f"{_UM * value:z.1f}" for value in (part.rms, part.p95, part.max)]
        table.add_row(label, *numbers, f"{100 * part.share:z.1f} %", span)

    for link, part in values.parts.items():
        add(link, part, DESCRIPTIONS[link])
        if link == "servo":
            for axis, axis_part in budget.servo_by_axis(machine).items():
                add(f"  by {axis}", budget.values_of(axis_part))
    if values.corner is not None:
        add(CORNER, values.corner, DESCRIPTIONS[CORNER])
    table.add_section()
    contour = values.contour
    x, y, _ = contour.point
    add("contour", contour, DESCRIPTIONS["contour"])
    table.caption = "links show where on the chain the error lies, not what causes it\n"
    table.caption += "share of the mean square contour error; a negative share offsets others\n"
    table.caption += f"largest contour error at t = {contour.time:z.2f} s, x = {x:z.1f}, y = {y:z.1f} mm"
    table.caption_justify = "left"
    return table


def verdict_table(verdict: Verdict) -> Table:
    """Return the verdict on a complete run, a row per value that it shows."""
    table = Table.grid(padding=(0, 2, 0, 0))
    table.title = escape(f"verdict {verdict.headline}")
    table.title_justify = "left"
    table.add_column(no_wrap=True)
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for row in verdict.rows:
        for k, text in enumerate(row.texts):
            heads = (f"{row.symbol} {row.state}", row.name) if k == 0 else ("", "")
            table.add_row(*heads, escape(text))
    return table


def scatter_table(scatter: Scatter) -> Table:
    """Return the scatter of a job's figures, a row per figure."""
    table = Table(title=escape(SCATTER), title_justify="left", caption=remark_of(scatter), caption_justify="left")
    for head in HEADS:
        table.add_column(head, justify="left" if head in HEADS[:2] else "right", no_wrap=True)
    for row in rows_of(scatter):
        table.add_row(*map(escape, row))
    return table


def causes_table(causes: Causes) -> Table:
    """Return what each cause of the error is worth, a row per cause."""
    table = Table(title=escape(TITLE), title_justify="left", box=None, padding=(0, 1, 0, 0))  # wide: without lines
    rows = [(name, *map(cell_text, cells)) for name, cells in causes.rows]
    for head, column in zip(causes.heads, zip(*rows, strict=True), strict=True):
        side: Literal["left", "right"] = "left" if head == causes.heads[0] else "right"
        table.add_column(
            head, justify=side, overflow="fold", min_width=max(map(len, column))
        )  # heads fold, not numbers
    for row in rows:
        table.add_row(*row)
    table.caption = "worth: rms with the cause minus rms without it, negative where it offsets others; gains stay, "
    table.caption += "\n".join(["effects do not add up", *map(escape, causes.notes)])
    table.caption_justify = "left"
    return table


def outcome_table(
    run: Run, values: AnalysisValues, bead: BeadValues | None, margins: tuple[Margins, ...] | None
) -> Table:
    """Return the results of a run: following errors, stability, spacing, speed, and the bead where there is glue."""
    until = "" if run.fault is None else ", until the fault"
    table = Table.grid(padding=(0, 2))
    for unit, (axis, error) in zip(run.units, values.following.items(), strict=True):
        rms, largest = (f"{_UM * value:z.1f} {THOUSANDTH[unit]}" for value in (error.rms, error.max))
        table.add_row(f"following error {axis}", rms, f"max {largest}")
    if margins is not None and any(axis_margins != NO_LOOP for axis_margins in margins):
        axis, axis_margins = min(
            zip(run.axes, margins, strict=True), key=lambda pair: min(pair[1].gain, pair[1].together)
        )
        table.add_row(
            "gain margin",
            f"{min(axis_margins.gain, axis_margins.together):z.2f}",
            f"of {axis}, {_judged(axis_margins)}",
        )
    if values.spacing is not None:
        s = values.spacing
        requested = "" if run.requested.turn_spacing is None else f"requested {run.requested.turn_spacing:g}, "
        table.add_row("turn spacing", f"{s.mean:z.4f} mm", f"{requested}std {s.std:z.4f}, {s.min:z.4f} to {s.max:z.4f}")
    v = values.speed
    table.add_row("path speed", f"{v.mean:z.2f} mm/s", f"{v.min:z.2f} to {v.max:z.2f}")
    table.add_row("path length", f"{values.path_length:z.3f} mm", f"in {values.duration:z.3f} s{until}")
    table.add_row("end point", "", "x {:z.4f}, y {:z.4f}, z {:z.4f} mm".format(*values.end_point))
    if bead is not None:
        _add_bead(table, bead)
    return table


def losses_table(run: Run, losses: Losses) -> Table:
    """Return the faults on purpose of a run, what the supervision did, and what they cost."""
    table = Table.grid(padding=(0, 2))
    table.title = "faults on purpose\n" + escape("\n".join(events(run)))
    table.title_justify = "left"
    for row in losses.rows:
        table.add_row(*row)
    return table


def plan_table(name: str, plan: Plan) -> Table:
    """Return what a job commands: lengths, time and extents."""
    table = Table.grid(padding=(0, 2))
    table.title = escape(f"{name}: {plan.controller} on {plan.machine}, not simulated")
    table.title_justify = "left"
    table.add_row("requested path", f"{plan.length:z.3f} mm", "")
    table.add_row("commanded path length", f"{plan.way:z.3f} mm", f"{plan.glue:z.3f} mm with glue")
    table.add_row("time", f"{plan.duration:z.3f} s", f"at most {plan.speed:z.2f} mm/s")
    files = f", {plan.files / _MB:z.0f} MB of temporary files" if plan.files else ""
    table.add_row(
        "run",
        f"{plan.ticks} ticks",
        f"{plan.ticks * plan.period:z.3f} s of machine time; about {plan.memory / _MB:z.0f} MB of memory{files}",
    )
    for k, axis in enumerate("xyz"):
        table.add_row(f"tip {axis}", f"{plan.box[0, k]:z.3f} to {plan.box[1, k]:z.3f} mm", "")
    for axis, extent in plan.travel.items():
        low, high = extent.bounds
        unit = plan.units[axis]
        fastest = plan.speeds[axis]
        table.add_row(
            f"axis {axis}",
            f"{extent.least:z.3f} to {extent.largest:z.3f} {unit}",
            f"of {low:g} to {high:g}; at most {fastest.largest:.4g} of {fastest.bounds[1]:.4g} {unit}/s",
        )
    return table


def _judged(margins: Margins) -> str:
    if not margins.stable:
        return "unstable"
    low = f"low, below {LOW_MARGIN:g}" if min(margins.gain, margins.together) < LOW_MARGIN else "the smallest"
    return f"{low}; phase margin {margins.phase:z.0f} deg"


def _add_bead(table: Table, bead: BeadValues) -> None:
    width = bead.width
    volume = bead.requested_volume
    widths = f"{width.min:z.3f} to {width.max:z.3f}; nominal section {bead.nominal:z.3f} mm²"
    table.add_row("bead width", f"{width.mean:z.3f} mm", widths)
    if bead.clearance is not None:
        between = "gap" if bead.clearance.mean > 0 else "overlap"
        clearances = f"clearance {bead.clearance.min:z.3f} to {bead.clearance.max:z.3f}"
        covered = "" if bead.coverage is None else f"; coverage {100 * bead.coverage:z.1f} %"
        table.add_row(f"{between} between turns", f"{abs(bead.clearance.mean):z.3f} mm", clearances + covered)
        if bead.apart_share:
            table.add_row("height map", "in layers", bead.apart_note)
    missing = "excess" if bead.missing_at_start.mean < 0 else "missing"
    table.add_row("start", f"{abs(bead.missing_at_start.mean):z.2f} mm {missing}", "length of nominal bead")
    if bead.excess_at_stop is not None:
        excess = "missing" if bead.excess_at_stop.mean < 0 else "excess"
        table.add_row("stop", f"{abs(bead.excess_at_stop.mean):z.2f} mm {excess}", "length of nominal bead")
    table.add_row("volume", f"{bead.volume:.4g} mm³", f"{bead.volume_error_percent:+z.2f} % of {volume:.4g} requested")
    shares = ", ".join(f"{name} {_volume(value, volume)}" for name, value in bead.volume_error_parts.items())
    table.add_row("volume error", f"{_volume(bead.volume_error, volume)} mm³", shares)
    if bead.ridge:
        table.add_row("height map", "not settled", bead.ridge_note)


def _volume(value: float, whole: float) -> str:
    """Return a part of a volume, to a hundred-thousandth of the whole."""
    return f"{value:+z.{decimals_of(whole)}f}"
