"""Axes of plots of studies."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.study.cases import OK, Row, Value

if TYPE_CHECKING:
    from matplotlib.axes import Axes


# Columns of a study's rows as arrays.


def series(rows: Sequence[Row], *columns: str, **tags: Value) -> tuple[Floats, ...]:
    """Return columns of the rows with all these tags, sorted by the first column, each (m,).

    Rows without values in one of the columns are left out.
    """
    chosen = []
    for row in rows:
        tagged = all(row.get(tag) == value for tag, value in tags.items())
        if row["status"] == OK and tagged and all(row.get(column) is not None for column in columns):
            chosen.append([row[column] for column in columns])
    values = np.array(chosen, float).reshape(-1, len(columns))
    return tuple(values[np.argsort(values[:, 0], kind="stable")].T)


_TICK_STEPS = ((1, 2, 5), (1, 1.5, 2, 3, 5, 7), (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 7, 8, 9))
_LEAST_TICKS = 4


def logarithmic(axes: Axes, direction: Literal["x", "y"], values: Sequence[float]) -> None:
    """Make an axis logarithmic, from the least to the largest value, with round numbers at its ticks.

    Args:
        axes: the plot.
        direction: of the axis.
        values: to show, above 0.
    """
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    low = min(values)
    high = max(values)
    margin = 1.06 * (high / low) ** 0.03
    low = low / margin
    high = high * margin
    for steps in _TICK_STEPS:
        decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
        ticks = [step * 10.0**decade for decade in decades for step in steps if low <= step * 10.0**decade <= high]
        if len(ticks) >= _LEAST_TICKS:
            break
    if direction == "x":
        axes.set_xscale("log")
        axes.set_xlim(low, high)
    else:
        axes.set_yscale("log")
        axes.set_ylim(low, high)
    axis = axes.xaxis if direction == "x" else axes.yaxis
    axis.set_major_locator(FixedLocator(ticks))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
