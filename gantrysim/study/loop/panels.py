"""The panels of a loop study's plots: errors, spacing and ripple of the path speed over one swept value."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.report.plots.style import COLOURS, INK, UM
from gantrysim.study.cases import OK, Row
from gantrysim.study.loop.study import AS_IT_IS, LOOP_ALONE, NO_FRICTION, NO_LOOP, PERFECT
from gantrysim.study.series import series

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# of a logarithmic axis: least range, and range labelled at decades only
_LEAST_DECADES = 1.0
_MANY_DECADES = 2.5
# of the legend, and of a handle in it [characters]
_WIDTH = 160
_HANDLE = 6
_FEW = 8  # swept values, up to which each is labelled
_PER_CENT = 100.0
_INSIDE = 0.55  # size of a point drawn inside another
# Points have a shape by variant and a colour by value.
SHAPES: dict[str, dict[str, Any]] = {
    AS_IT_IS: {"marker": "o", "ms": 5.5},
    LOOP_ALONE: {"marker": "o", "ms": 5.5, "mfc": "none"},
    PERFECT: {"marker": "D", "ms": 4.5},
    NO_LOOP: {"marker": "s", "ms": 5.0, "mfc": "none"},
    NO_FRICTION: {"marker": "^", "ms": 5.5, "mfc": "none"},
}


# values that a shape tells from another value of the variant, as colours alone are alike to some eyes
DOWNWARDS = ("steady_following_along_rms_um",)


class Panels:
    """Three panels over one swept value: errors on the left, spacing and speed ripple on the right."""

    def __init__(self, axes: list[Axes], rows: Sequence[Row], sweep: str, scale: float, label: str) -> None:
        self.errors, self.spacing, self.ripple = axes
        self.rows = rows
        self.sweep = sweep
        self.scale = scale
        self.unit = label.rpartition("[")[2].rstrip("]")
        for panel in axes:
            panel.set(xscale="log", yscale="log")
            panel.xaxis.set_major_formatter("{x:g}")
        self.errors.set(xlabel=label, ylabel="rms error [µm]", title="Errors")
        self.spacing.set(ylabel="[µm]", title="Spacing of the turns")
        self.spacing.tick_params(labelbottom=False)
        self.ripple.set(xlabel=label, ylabel="[%]", title="Ripple of the path speed, std over mean")

    def points(self, panel: Axes, column: str, variant: str, colour: str, label: str, factor: float = 1.0) -> None:
        """Draw a column of a variant without zeros and missing values."""
        x, y = series(self.rows, "value", column, sweep=self.sweep, variant=variant)
        shape = {"mfc": colour, **SHAPES[variant]}
        if column in DOWNWARDS:
            shape["marker"] = "v"
        if column.startswith(("servo_", "following_")):
            shape["ms"] = _INSIDE * shape["ms"]  # it often coincides with the contour error
        self._scatter(panel, x, factor * y, color=colour, label=label, **shape)

    def spacing_errors(self, nominal: float) -> None:
        """Draw the deviation of the mean spacing from the nominal one [mm] for the unchanged job."""
        x, mean = series(self.rows, "value", "spacing_mean_mm", sweep=self.sweep, variant=AS_IT_IS)
        label = "error of the mean, as it is"
        self._scatter(
            self.spacing, x, UM * (mean - nominal), color=INK, label=label, **{"mfc": INK, **SHAPES[AS_IT_IS]}
        )

    def _scatter(self, panel: Axes, x: Floats, y: Floats, **style: Any) -> None:
        """Draw magnitudes as points; both axes are logarithmic, where a zero has no place."""
        shown = (x > 0) & (y != 0)
        if shown.any():
            panel.plot(self.scale * x[shown], np.abs(y[shown]), ls="none", **style)

    def line(self, panel: Axes, x: Floats, y: Floats, colour: str, label: str, style: str = "-") -> None:
        """Draw a predicted line, if there is one."""
        good = np.isfinite(y)
        if good.any():
            panel.plot(self.scale * x[good], y[good], color=colour, ls=style, lw=1.3, label=label, zorder=1.5)

    def mark(self, knee: float | None, text: str) -> None:
        """Mark a knee, if there is one."""
        if knee is None or not math.isfinite(knee):
            return
        x = self.scale * knee
        self.errors.axvline(x, color=COLOURS["fault"], lw=1.0, ls="--", zorder=1)
        low, high = self.errors.get_xlim()
        right = x > math.sqrt(low * high)
        self.errors.annotate(
            f"{text}: knee at {x:.3g} {self.unit}",
            (x, 0.02),
            xycoords=("data", "axes fraction"),
            xytext=(-5 if right else 5, 0),
            textcoords="offset points",
            ha="right" if right else "left",
            va="bottom",
            color=COLOURS["fault"],
        )

    def failures(self) -> None:
        """Mark the swept values at which the unchanged job is refused or ends in a fault."""
        failed = [
            self.scale * float(row["value"])  # type: ignore[arg-type]
            for row in self.rows
            if row["sweep"] == self.sweep and row["variant"] == AS_IT_IS and row["status"] != OK
        ]
        if failed:
            height = np.full(len(failed), 0.985)
            transform = self.errors.get_xaxis_transform()
            self.errors.plot(
                failed,
                height,
                "x",
                color=COLOURS["fault"],
                transform=transform,
                ls="none",
                label="as it is: refused or fault",
            )

    def ripples(self, *variants: str) -> None:
        """Draw the ripple of the path speed of some variants."""
        for variant in variants:
            self.points(self.ripple, "speed_ripple", variant, INK, variant, _PER_CENT)

    def finish(self) -> None:
        """Label the axes in plain numbers and add the legends."""
        from matplotlib.ticker import FixedLocator, LogLocator, NullFormatter, NullLocator

        values = sorted({self.scale * float(row["value"]) for row in self.rows if row["sweep"] == self.sweep})  # type: ignore[arg-type]
        few = [value for value in values if value > 0]
        for panel in (self.errors, self.spacing, self.ripple):
            if not panel.lines:
                continue
            if len(few) <= _FEW:
                panel.xaxis.set_major_locator(FixedLocator(few))
                panel.xaxis.set_minor_locator(NullLocator())
            panel.xaxis.set_minor_formatter(NullFormatter())
            if panel.get_yscale() == "log":
                low, high = panel.get_ylim()
                decades = math.log10(high / low)
                if decades < _LEAST_DECADES:
                    reach = 10 ** (0.5 * _LEAST_DECADES)
                    panel.set_ylim(math.sqrt(low * high) / reach, math.sqrt(low * high) * reach)
                panel.yaxis.set_major_locator(LogLocator(subs=(1.0,) if decades > _MANY_DECADES else (1.0, 2.0, 5.0)))
                panel.yaxis.set_major_formatter("{x:g}")
                panel.yaxis.set_minor_formatter(NullFormatter())
            if panel is not self.errors:
                panel.legend(fontsize="x-small")
        self._close_gaps()
        figure = self.errors.figure
        handles, labels = self.errors.get_legend_handles_labels()
        if labels:
            columns = _WIDTH // max(len(label) + _HANDLE for label in labels)
            figure.legend(handles, labels, loc="outside lower center", ncols=min(columns, 4), fontsize="small")

    def _close_gaps(self) -> None:
        """Remove panels without values; the others take their place."""
        right = (self.spacing, self.ripple)
        filled = [panel for panel in right if panel.lines]
        grid = self.errors.get_subplotspec().get_gridspec()  # type: ignore[union-attr]
        for panel in right:
            if panel not in filled:
                panel.remove()
        for panel in filled:
            panel.tick_params(labelbottom=panel is filled[-1])
            if len(filled) == 1:
                panel.set(xlabel=self.errors.get_xlabel())
                panel.set_subplotspec(grid[:, 1])
        if not filled:
            self.errors.set_subplotspec(grid[:, :])
