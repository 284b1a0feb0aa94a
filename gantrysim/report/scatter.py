"""The scatter of a job's figures in terminal, report and summary."""

from __future__ import annotations

import math
from typing import Any

from gantrysim.base.quantity import number_text
from gantrysim.job.scatter import Figure, Scatter
from gantrysim.report.document import Column, Section, Table

TITLE = "Scatter with the zeros of the encoders"
SCATTER_NOTE = (
    "note: friction and encoder counts make these figures scatter from one start of the machine to the next; "
    "--repeat 16 shows by how much"
)
_DECIMALS = 3
_MOST_DECIMALS = 6
_NOTHING = 1e-6  # of a link, in its unit
HEADS = ("figure", "unit", "nominal", "mean", "std", "min", "max")


def rows_of(scatter: Scatter) -> list[tuple[str, ...]]:
    """Return a row of cells per figure, see `HEADS`, each with the decimals that its scatter leaves it.

    Links without any error are left out.
    """
    figures = scatter.figures.values()
    return [
        (figure.quantity.label, figure.quantity.unit, *_cells(figure))
        for figure in figures
        if figure.high > _NOTHING or figure.low < 0
    ]


def _cells(figure: Figure) -> tuple[str, ...]:
    decimals = decimals_of(figure)
    nominal, mean, std, low, high = (
        number_text(number, f".{decimals}f")
        for number in (figure.nominal, figure.mean, figure.std, figure.low, figure.high)
    )
    return nominal, f"{mean} ± {figure.mean_error:.{decimals}f}", std, low, high


def decimals_of(figure: Figure) -> int:
    """Return the decimals of a figure of which its scatter leaves the first digit of the standard error of the mean.

    One that hardly scatters has three, or more where its mean is small: as a ripple of 0.0013.
    """
    most = _DECIMALS
    if 0 < abs(figure.mean) < 1:
        most += math.floor(-math.log10(abs(figure.mean)))
    for decimals in range(min(most, _MOST_DECIMALS)):
        if figure.mean_error >= 10.0**-decimals:
            return decimals
    return min(most, _MOST_DECIMALS)


def remark_of(scatter: Scatter) -> str:
    """Return how the scatter was made."""
    counts = ", ".join(f"{name} {count:.4g}" for name, count in scatter.counts.items() if count > 0)
    faults = f"; {scatter.faults} of them ended in a fault and do not count" if scatter.faults else ""
    return (
        f"{scatter.repeats} runs with the zero of each encoder anywhere within a count ({counts} mm or deg), seed "
        f"{scatter.seed}{faults}; the mean with its standard error, std of a single run"
    )


def scatter_section(scatter: Scatter) -> Section:
    """Return the section of the scatter."""
    columns: list[str | Column] = list(HEADS)
    return Section(TITLE, [f"{remark_of(scatter)}."], table=Table(columns, [list(row) for row in rows_of(scatter)]))


def scatter_summary(scatter: Scatter) -> dict[str, Any]:
    """Return the scatter for summary.json."""
    figures = {
        key: {
            "unit": figure.quantity.unit,
            "nominal": figure.nominal,
            "mean": figure.mean,
            "mean_error": figure.mean_error,
            "std": figure.std,
            "min": figure.low,
            "max": figure.high,
        }
        for key, figure in scatter.figures.items()
    }
    return {"repeats": scatter.repeats, "seed": scatter.seed, "faults": scatter.faults, "figures": figures}
