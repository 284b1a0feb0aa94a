"""The report of a comparison: budgets, alignment and what the model does not explain, in words, tables and plots."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.quantity import UM, with_minus
from gantrysim.compare.alignment import alignment_words, estimate_rows
from gantrysim.compare.compare_quantities import (
    DIFFERENCE,
    FREQUENCY,
    MEASURED,
    PEAK,
    PEAK_SIZE,
    REMAINDER,
    SHIFT,
)
from gantrysim.compare.comparison import NOTHING, Comparison
from gantrysim.compare.over_time import FOLLOWING, TORQUE, AxisDifference
from gantrysim.metrics.budget import DESCRIPTIONS
from gantrysim.metrics.parts import ERROR, ERROR_SIZES, PART_SIZES
from gantrysim.report.document import Column, Section, Table, lead_of
from gantrysim.report.drawn_page import write_page
from gantrysim.report.plots.style import COLOURS, axes_on, draw_limit, sheet, thinned_line
from gantrysim.report.sections import drawn_plot
from gantrysim.report.summary import versions
from gantrysim.results.colours import INK, RUNS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure


# Plots of a comparison: errors along the path of both, and the spectrum of their difference.

OVERLAY = "overlay.png"
SPECTRUM = "spectrum.png"
_LEAST_SPAN = 0.01  # of an axis of errors, so that rounding looks like none [µm]


def draw_overlay(figure: Figure | SubFigure, comparison: Comparison) -> tuple[Axes, ...]:
    """Draw each link's lateral error along the path, measured and simulated, and their difference; return the axes.

    The contour error is drawn with the largest one that the run's tolerance admits.
    """
    names = [*comparison.parts, "contour"]
    panels = figure.subplots(len(names) + 1, sharex=True, squeeze=False)[:, 0]
    for panel, name in zip(panels[:-1], names, strict=True):
        for budget, label, colour in (
            (comparison.measured, "measured", RUNS[0]),
            (comparison.simulated, "simulated", RUNS[1]),
        ):
            part = budget.contour if name == "contour" else budget.parts[name]
            s = budget.analysis.nozzle.s
            panel.plot(*_line(s, budget.analysis.ticks, part.lateral), lw=0.9, color=colour, label=label)
        panel.set_title(name, loc="right")
        panel.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    analysis = comparison.measured.analysis
    difference = comparison.difference["contour"][:, 0]
    panels[-1].plot(*_line(analysis.nozzle.s, analysis.ticks, difference), lw=0.9, color=COLOURS["structure"])
    panels[-1].set_title("measured less simulated", loc="right")
    panels[-1].set_xlabel("distance along the requested path [mm]")
    for panel in panels:
        panel.axhline(0, color=INK, lw=0.6)
        panel.margins(x=0.01)
        low, high = panel.get_ylim()
        panel.set_ylim(min(low, -_LEAST_SPAN / 2), max(high, _LEAST_SPAN / 2))
    run = comparison.simulated.analysis.run
    if run.basis is not None:
        draw_limit(panels[-2], UM * run.basis.limits(run.face).path_max)
    figure.supylabel("lateral error, positive to the left [µm]", fontsize="medium")
    return tuple(panels)


def draw_spectrum(on: Figure | SubFigure | Axes, comparison: Comparison) -> Axes:
    """Draw the spectrum of the lateral error that the model does not explain, its peaks marked; return the axes."""
    axes = axes_on(on)
    frequency, density = comparison.spectrum
    axes.loglog(frequency[1:], UM * np.sqrt(density[1:]), lw=1.0, color=COLOURS["structure"])
    for peak in comparison.peaks:
        axes.axvline(peak.frequency, color=COLOURS["fault"], lw=0.8, ls=":")
        place = (peak.frequency, 0.98)
        text = f"{peak.frequency:.1f} Hz, {UM * peak.rms:.2g} µm"
        axes.annotate(text, place, xycoords=("data", "axes fraction"), rotation=90, va="top", fontsize=7)
    axes.set(xlabel="frequency [Hz]", ylabel="measured less simulated [µm/√Hz]")
    return axes


def has_spectrum(comparison: Comparison) -> bool:
    """Return whether a spectrum can be drawn: where no difference is left, it has no logarithm."""
    return bool(comparison.spectrum[1][1:].any())


def save_comparison(comparison: Comparison, folder: Path) -> list[str]:
    """Write the plots into a folder; return their names."""
    with sheet(9.0, 2.2 * (len(comparison.parts) + 2)) as figure:
        draw_overlay(figure, comparison)
        figure.savefig(folder / OVERLAY)
    if not has_spectrum(comparison):
        return [OVERLAY]
    with sheet(8.0, 4.6) as figure:
        draw_spectrum(figure, comparison)
        figure.savefig(folder / SPECTRUM)
    return [OVERLAY, SPECTRUM]


def _line(s: Floats, ticks: NDArray[np.intp], error: Floats) -> tuple[Floats, Floats]:
    gaps = np.flatnonzero(np.diff(ticks) > 1) + 1
    return thinned_line(np.insert(s, gaps, np.nan), np.insert(UM * error, gaps, np.nan))


REPORT = "report.html"
_PLOT_WIDTH = 10.7  # of a plot across the page [inch]


def write_comparison_page(
    file: str | os.PathLike[str],
    comparison: Comparison,
    run: str,
    measured: str,
    circle: Mapping[str, Mapping[str, Any]] | None = None,
) -> None:
    """Write the report of a comparison as one HTML file.

    Args:
        file: to write or replace.
        comparison: the comparison.
        run: name of the run.
        measured: name of the log.
        circle: values of a circular test, as `Comparison.circle` returns them.
    """
    write_page(
        file, f"{measured} beside {run}", "A measured trace and its simulation", list(_sections(comparison, circle))
    )


def _sections(comparison: Comparison, circle: Mapping[str, Mapping[str, Any]] | None) -> Iterator[Section]:
    text = headline(comparison)
    height = 2.2 * (len(comparison.parts) + 2)
    yield Section("Summary", lead_of(text), figure=drawn_plot(draw_overlay, comparison, _PLOT_WIDTH, height))
    yield Section("In full", text, facts=_facts(comparison))
    yield Section(
        "Error budgets",
        "Errors are normal to the requested path; the contour error is that of the last link measured. Links that are "
        "not measured are not compared. The difference is that of the errors at the same instant, not of the two "
        "numbers beside it.",
        table=_budgets(comparison),
    )
    yield Section(
        "Over time",
        over_time_words(comparison),
        table=over_time_table(comparison) if comparison.over_time else None,
    )
    yield Section("Alignment", alignment_text(comparison), table=_offsets(comparison))
    yield Section(
        "Not explained by the model",
        unexplained_errors(comparison),
        figure=drawn_plot(draw_spectrum, comparison, _PLOT_WIDTH, 4.6) if has_spectrum(comparison) else None,
        table=_peaks(comparison) if comparison.peaks else None,
    )
    if circle is not None:
        keys = circle["measured"]
        rows = [[key, *(float(row[key]) for row in circle.values())] for key in keys]
        heads: list[str | Column] = ["value", *(Column(name, ".2f") for name in circle)]
        yield Section("Circular test", table=Table(heads, rows, "Values of gantrysim study circle"))
    if comparison.notes:
        yield Section("Notes", [f"{note[0].upper()}{note[1:]}." for note in comparison.notes])
    yield Section(
        "Versions", table=Table(["", "version"], [list(item) for item in versions(comparison.machine).items()])
    )


_WRITTEN_DIFFERENCE = 1e-6  # of a difference that is not written as 0 [mm, deg or N·m]
AS_GOOD = 0.8  # difference, of that of the machine without friction, from which a trace does not tell them apart


def headline(comparison: Comparison) -> str:
    """Return both contour errors, how much of the measured links the simulation explains, and what is not compared."""
    contour = [budget.values.contour.rms for budget in (comparison.measured, comparison.simulated)]
    sizes = f"Contour error: {ERROR.text(contour[0])} rms measured, {ERROR.text(contour[1])} simulated."
    return " ".join(
        [
            sizes,
            _explained_share(comparison),
            *_beside_wrong(comparison),
            *_not_compared(comparison),
            *over_time_words(comparison),
        ]
    )


def _explained_share(comparison: Comparison) -> str:
    """Return how much of the measured links the simulation explains, in a sentence."""
    explained = comparison.explained
    links = " + ".join(_named_links(comparison))
    measured = f"{links}, {MEASURED.text(explained.measured)} rms measured"
    if comparison.is_all_noise:
        return f"Of {measured}, no difference is left: all is measured, and all differences are within the noise."
    if explained.share is None and explained.difference < NOTHING:
        return f"Of {links} there is no error across the path, neither measured nor simulated: it shows nothing there."
    if explained.difference < NOTHING:
        bound = f"{DIFFERENCE.factor * NOTHING:g} {DIFFERENCE.unit}"
        return f"Of {measured}, the simulation differs by less than {bound} rms."
    difference = f"{REMAINDER.text(explained.difference)} rms"
    if explained.share is None:
        return f"Of {links} there is no measured error; the simulated one is {difference}."
    if explained.share <= 0:
        share = share_text(explained.share)
        return f"Of {measured}, the simulation explains none ({share}): their difference is {difference}."
    return f"Of {measured}, the simulation explains {share_text(explained.share)} in mean square; {difference} is left."


def _beside_wrong(comparison: Comparison) -> list[str]:
    """Return how much a machine without friction would explain, in a sentence; nothing where it was not simulated."""
    wrong = comparison.explained_without_friction
    if wrong is None or wrong.share is None:
        return []
    text = f"Without friction the same machine would explain {share_text(wrong.share)}"
    if comparison.explained.difference >= AS_GOOD * wrong.difference:
        return [f"{text}: these links do not tell the two apart."]
    return [f"{text}, and {REMAINDER.text(wrong.difference)} rms would be left."]


def over_time_words(comparison: Comparison) -> list[str]:
    """Return the differences of following errors and torques over time, a sentence for each, and what is missing."""
    sentences = []
    for quantity in (FOLLOWING, TORQUE):
        rows = [row for row in comparison.over_time if row.quantity == quantity]
        if not rows:
            sentences.append(f"{quantity.capitalize()} over time is not measured, so not compared.")
            continue
        listed = "; ".join(
            f"{row.axis} {thousandths(row.measured.rms)} {row.unit} rms measured, {thousandths(row.simulated.rms)} "
            f"simulated, difference {thousandths(row.difference.rms)}{_wrong_size(row)}"
            for row in rows
        )
        sentences.append(f"{quantity.capitalize()} over time: {listed}.")
        alike = [
            row.axis for row in rows if row.frictionless and row.difference.rms >= AS_GOOD * row.frictionless.rms > 0
        ]
        if alike:
            sentences.append(f"It does not tell the machine from one without friction for {', '.join(alike)}.")
    return sentences


def _wrong_size(row: AxisDifference) -> str:
    return "" if row.frictionless is None else f" (without friction {thousandths(row.frictionless.rms)})"


def thousandths(value: float) -> str:
    """Return a size in a thousandth of its unit, as text."""
    return f"{1e3 * value:.3g}" if value > _WRITTEN_DIFFERENCE else "0"


def _named_links(comparison: Comparison) -> list[str]:
    """Return the compared links, with their spans where they differ from a full budget's."""
    return [name if span == DESCRIPTIONS[name] else f"{name} ({span})" for name, span in comparison.parts.items()]


def share_text(share: float) -> str:
    """Return an explained share in percent, rounded down: 100 % is said of no share below it."""
    return f"{with_minus(f'{math.floor(1000 * share) / 10:z.1f}')} %"


def _not_compared(comparison: Comparison) -> list[str]:
    """Return which links are not compared, and why, in a sentence; nothing where all are."""
    missing = [f"{link}, as {why}" for link, why in comparison.not_compared.items()]
    return [f"Not compared: {'; '.join(missing)}."] if missing else []


def unexplained_errors(comparison: Comparison) -> list[str]:
    """Return what the model does not explain, a paragraph each: links, constant and varying part, frequencies."""
    contour = comparison.unexplained["contour"]
    if contour.rms < NOTHING:
        return [
            f"Across the path the simulation has the error that is measured: {', '.join(comparison.parts)}.",
            *_not_compared(comparison),
        ]
    links = sorted(comparison.parts, key=lambda name: -comparison.unexplained[name].rms)
    sizes = ", ".join(f"{name} {DIFFERENCE.text(comparison.unexplained[name].rms)} rms" for name in links)
    sentences = [f"Difference by link, largest first: {sizes}. Links can offset one another."]
    sentences += _not_compared(comparison)
    lateral = comparison.difference["contour"][:, 0]
    mean = float(lateral.mean())
    varying = float(lateral.std())
    side = "left" if mean > 0 else "right"
    sentences.append(
        f"Across the path the measured nozzle lies {DIFFERENCE.text(abs(mean))} further to the {side} on average; the "
        f"difference varies by {DIFFERENCE.text(varying)} rms about that, and is {DIFFERENCE.text(contour.max)} at "
        "most in any direction."
    )
    if comparison.peaks:
        named = ", ".join(
            f"{FREQUENCY.text(peak.frequency)} ({PEAK_SIZE.text(peak.rms)} rms)" for peak in comparison.peaks
        )
        sentences.append(f"Frequencies that the model lacks: {named}.")
    elif comparison.spectrum[0].size:
        sentences.append("No frequency stands out from the spectrum: what is left is noise, drift or slow.")
    return sentences


def alignment_text(comparison: Comparison) -> str:
    """Return how the trace was aligned, in some sentences."""
    return alignment_words(comparison.alignment, comparison.measured.analysis.run)


def _facts(comparison: Comparison) -> list[tuple[str, str, str]]:
    facts = [
        (f"Contour error, {name}", ERROR.text(values.rms), f"max {ERROR.text(values.max)}")
        for name, values in (
            ("measured", comparison.measured.values.contour),
            ("simulated", comparison.simulated.values.contour),
            ("difference", comparison.unexplained["contour"]),
        )
    ]
    explained = comparison.explained
    if explained.share is not None:
        facts.append(
            ("Explained", share_text(explained.share), f"of {' + '.join(_named_links(comparison))}, in mean square")
        )
    return [*facts, ("Time shift", SHIFT.text(comparison.alignment.shift), f"by {comparison.alignment.by}")]


def _budgets(comparison: Comparison) -> Table:
    heads: list[str | Column] = ["link", "span"]
    heads += [
        Column(f"{which}, {size.head}", DIFFERENCE.form) for which in ("measured", "simulated") for size in PART_SIZES
    ]
    heads += [Column(f"difference, {size.label} [{size.unit}]", DIFFERENCE.form) for size in ERROR_SIZES]
    rows = []
    for name in (*comparison.parts, "contour"):
        cells: list[float] = []
        for budget in (comparison.measured, comparison.simulated):
            part = budget.values.contour if name == "contour" else budget.values.parts[name]
            cells += [size.get(part) for size in PART_SIZES]
        difference = comparison.unexplained[name]
        span = comparison.parts.get(name, "requested path to the last link measured")
        rows.append([name, span, *map(DIFFERENCE.in_unit, (*cells, difference.rms, difference.max))])
    return Table(heads, rows, "Error normal to the requested path, measured, simulated, and their difference", COLOURS)


def _offsets(comparison: Comparison) -> Table:
    rows = list(estimate_rows(comparison.alignment, comparison.measured.analysis.run))
    heads: list[str | Column] = ["", Column("against the run", ".6g"), Column("± 95 %", ".2g"), "unit", "distinguished"]
    return Table(heads, rows, "Trace against run; what is not distinguished from zero is left in the trace")


def over_time_table(comparison: Comparison) -> Table:
    """Return following error and torque of each axis, measured and simulated."""
    heads: list[str | Column] = ["axis", "quantity", "unit"]
    sides = ("measured", "simulated", "difference", "without friction")
    heads += [Column(f"{side}, {size}", ".4g") for side in sides for size in ("rms", "max")]
    rows: list[list[Any]] = []
    for row in comparison.over_time:
        cells: list[Any] = [row.axis, row.quantity, row.unit]
        for size in (row.measured, row.simulated, row.difference, row.frictionless):
            cells += [None, None] if size is None else [1e3 * size.rms, 1e3 * size.max]
        rows.append(cells)
    caption = "Over all samples, along the path too; without friction: the difference from that machine"
    return Table(heads, rows, caption)


def _peaks(comparison: Comparison) -> Table:
    rows = [[quantity.in_unit(quantity.get(peak)) for quantity in PEAK] for peak in comparison.peaks]
    return Table(list(map(Column.of, PEAK)), rows, "Peaks of the spectrum")
