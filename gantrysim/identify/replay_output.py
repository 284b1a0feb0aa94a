"""Tables, sentences and files of a replay, as `gantrysim replay` shows and writes them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.quantity import Quantity
from gantrysim.identify.replay import Compared, Replay
from gantrysim.metrics.analysis import THOUSANDTH, ErrorSize
from gantrysim.report.document import Column, Section, Table
from gantrysim.report.drawn_page import write_page
from gantrysim.report.folder import Output, output_folder
from gantrysim.report.plots.style import COLOURS, thinned_line
from gantrysim.report.sections import drawn_plot
from gantrysim.report.summary import versions

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

SUMMARY = "replay.json"
REPORT = "report.html"
OUTPUT = Output("replay", SUMMARY, (SUMMARY, REPORT))
QUANTITIES = ("following", "torque")
SIDES = ("measured", "simulated", "difference", "frictionless")
_LABELS = {"following": "following error", "torque": "torque", "frictionless": "difference without friction"}
_SIMULATED_LOG = 1e-6  # difference, of that without friction, below which the log is a simulation's own
_AS_GOOD = 0.8  # difference, of that without friction, from which the log does not tell the two apart
_WIDTH = 10.7  # of a plot across the page [inch]


def described_quantity(result: Replay, axis: str, quantity: str) -> Quantity[Any]:
    """Return unit and format of the following error or torque of an axis."""
    unit = THOUSANDTH[result.run.units[result.run.axes.index(axis)]] if quantity == "following" else "mN·m"
    name = "following_error" if quantity == "following" else "torque"
    meaning = "Commanded less encoder position" if quantity == "following" else "Torque at the motor shaft"
    return Quantity(name, label=_LABELS[quantity], unit=unit, form=".3g", meaning=meaning, path=(), factor=1e3)


def table_of(result: Replay, axis: str, quantity: str) -> Table:
    """Return the sizes of a quantity of an axis by part of the log."""
    described = described_quantity(result, axis, quantity)
    heads: list[str | Column] = ["part of the log", "rows"]
    heads += [Column(f"{_LABELS.get(side, side)}, {size}", ".4g") for side in SIDES for size in ("rms", "max")]
    rows: list[list[Any]] = []
    for name, sizes in result.compared(axis, quantity).items():
        cells: list[Any] = [name, sizes.rows]
        for side in SIDES:
            size: ErrorSize | None = getattr(sizes, side)
            cells += [None, None] if size is None else [described.in_unit(size.rms), described.in_unit(size.max)]
        rows.append(cells)
    return Table(heads, rows, f"{axis}: {described.head}, measured and simulated")


def sentences(result: Replay) -> Iterator[str]:
    """Yield what the replay shows: for each axis, and which rows are held out."""
    for axis in result.axes:
        for quantity in QUANTITIES:
            yield _sentence(result, axis, quantity)
    yield _held_out_words(result)


def _held_out_words(result: Replay) -> str:
    """Return which rows are held out, in a sentence."""
    if result.fitted is None:
        return (
            "No rows are named to which the machine was fitted (--fitted FIRST:LAST), so none are known to be held out."
        )
    if not result.fitted_count:
        return "All rows are held out: the machine was fitted to none of them."
    if not result.is_partly_held_out:
        return "No row is held out: the machine was fitted to all of them."
    first, last = _fitted_rows(result)
    return f"Rows {first} to {last} are those to which the machine was fitted; all others are held out."


def _fitted_rows(result: Replay) -> tuple[int, int]:
    """Return the numbers of the first and the last fitted row in the log's file."""
    assert result.fitted is not None
    rows = range(*result.fitted.indices(len(result.recorded.command)))
    before = result.recorded.first or 1
    return before + rows[0], before + rows[-1]


def _sentence(result: Replay, axis: str, quantity: str) -> str:
    described = described_quantity(result, axis, quantity)
    parts = result.compared(axis, quantity)
    judged = "held out" if result.is_partly_held_out else "all"
    sizes = parts[judged]
    where = "" if judged == "all" else " in the rows held out"
    text = (
        f"{axis}, {described.label}{where}: {described.text(sizes.measured.rms)} rms measured, "
        f"{described.text(sizes.simulated.rms)} simulated; the two differ by "
        f"{described.text(sizes.difference.rms)} rms, {described.text(sizes.difference.max)} at most"
    )
    near = parts.get("reversals" if judged == "all" else f"{judged}, reversals")
    if near is not None:
        text += f", around reversals by {described.text(near.difference.rms)} and {described.text(near.difference.max)}"
    return f"{text}. {_beside_wrong(sizes, described)}"


def _beside_wrong(sizes: Compared, described: Quantity[Any]) -> str:
    wrong = sizes.frictionless
    if wrong is None:
        return "The machine without friction could not be simulated beside it."
    text = f"Without friction the same machine differs by {described.text(wrong.rms)} rms"
    if sizes.difference.rms >= _AS_GOOD * wrong.rms:
        return f"{text}: this log does not show whether the machine's friction is right."
    if sizes.difference.rms < _SIMULATED_LOG * wrong.rms:
        return f"{text}."
    return f"{text}, {wrong.rms / sizes.difference.rms:.3g} times as much."


def content(result: Replay) -> dict[str, Any]:
    """Return all values for JSON; a key ends in its unit."""
    axes: dict[str, Any] = {}
    for axis in result.axes:
        axes[axis] = {}
        for quantity in QUANTITIES:
            described = described_quantity(result, axis, quantity)
            axes[axis][described.name] = {
                name: _part_content(sizes, described) for name, sizes in result.compared(axis, quantity).items()
            }
    fitted = list(_fitted_rows(result)) if result.fitted_count else None
    return {
        "machine": str(result.machine.source),
        "rows": len(result.recorded.command),
        "period_s": result.recorded.log.period,
        "fitted_rows": fitted,
        "axes": axes,
        "sentences": list(sentences(result)),
        "notes": list(result.notes),
    }


def _part_content(sizes: Compared, described: Quantity[Any]) -> dict[str, Any]:
    values: dict[str, Any] = {"rows": sizes.rows}
    unit = described.key.removeprefix(f"{described.name}_")
    for side in SIDES:
        size: ErrorSize | None = getattr(sizes, side)
        for statistic in ("rms", "max"):
            value = None if size is None else getattr(size, statistic)
            values[f"{side}_{statistic}_{unit}"] = described.content(value)
    for name, share in (("explained", sizes.share), ("explained_frictionless", sizes.frictionless_share)):
        values[f"{name}_percent"] = None if share is None else 100 * share
    return values


def write_all(result: Replay, log: str, folder: Path) -> list[str]:
    """Write values and report to a folder, replaced as a whole; return their names.

    Args:
        result: the replay.
        log: name of the log.
        folder: to write to.

    Raises:
        InputError: the folder holds other files of these names, or cannot be written.
    """
    with output_folder(folder, OUTPUT) as scratch:
        (scratch / SUMMARY).write_text(
            json.dumps({"log": log, **content(result)}, indent=2, allow_nan=False) + "\n", encoding="utf-8"
        )
        title = f"{log} replayed on {result.machine.name}"
        write_page(
            scratch / REPORT, title, "A recorded command, sent to the simulated machine", list(_sections(result))
        )
    return list(OUTPUT.files)


def _sections(result: Replay) -> Iterator[Section]:
    yield Section("Summary", list(sentences(result)))
    for axis in result.axes:
        for quantity in QUANTITIES:
            yield Section(
                f"{axis}: {_LABELS[quantity]}",
                figure=drawn_plot(partial(_draw, axis=axis, quantity=quantity), result, _WIDTH, 5.2),
                table=table_of(result, axis, quantity),
            )
    if result.notes:
        yield Section("Notes", list(result.notes))
    yield Section("Versions", table=Table(["", "version"], [list(item) for item in versions(result.machine).items()]))


def _draw(figure: Figure | SubFigure, result: Replay, axis: str, quantity: str) -> tuple[Axes, ...]:
    """Draw a quantity over time, measured and simulated, and below their difference; return the axes."""
    described = described_quantity(result, axis, quantity)
    values = result.following if quantity == "following" else result.torque
    time = result.run.period * np.arange(len(result.run), dtype=np.float64)
    over, below = figure.subplots(2, sharex=True)

    def line(panel: Axes, shown: Floats, label: str, colour: str) -> None:
        panel.plot(*thinned_line(time, described.factor * shown), lw=0.8, color=colour, label=label)

    line(over, values(axis), "measured", COLOURS["contour"])
    line(over, values(axis, result.run), "simulated", COLOURS["servo"])
    if result.frictionless is not None:
        line(below, values(axis) - values(axis, result.frictionless), "without friction", COLOURS["requested"])
    line(below, values(axis) - values(axis, result.run), "measured less simulated", COLOURS["structure"])
    for panel, label in ((over, described.head), (below, f"difference [{described.unit}]")):
        panel.set_ylabel(label)
        panel.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    below.set_xlabel("time in the log [s]")
    return over, below
