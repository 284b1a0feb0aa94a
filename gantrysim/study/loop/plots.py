"""The plots of a loop study: simulations as points, closed forms as lines, knees marked."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.quantity import PER_CENT, UM
from gantrysim.controllers.loop_theory import LoopTheory
from gantrysim.report.plots.style import COLOURS, sheet
from gantrysim.results.colours import INK, RUNS
from gantrysim.servo.servo import Servo
from gantrysim.study.cases import OK, Row
from gantrysim.study.drawing import series
from gantrysim.study.loop.sampling import quantisation, sample_and_hold
from gantrysim.study.loop.study import (
    AS_IT_IS,
    LOOP_ALONE,
    NO_FRICTION,
    NO_LOOP,
    PERFECT,
    SWEEPS,
    LoopStudy,
)
from gantrysim.study.loop.trends import CONVERGING_VALUES, convergence, knee, loop_knee
from gantrysim.study.study import Plot

if TYPE_CHECKING:
    from matplotlib.axes import Axes


# The panels of a loop study's plots: errors, spacing and ripple of the path speed over one swept value.

# of a logarithmic axis: least range, and range labelled at decades only
_LEAST_DECADES = 1.0
_MANY_DECADES = 2.5
# of the legend, and of a handle in it [characters]
_WIDTH = 160
_HANDLE = 6
_LABELLED_VALUES = 8  # swept values, up to which each is labelled
_INNER_SIZE = 0.55  # size of a point drawn inside another
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
            # it often coincides with the contour error
            shape["ms"] = _INNER_SIZE * shape["ms"]
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
            self.points(self.ripple, "speed_ripple", variant, INK, variant, PER_CENT)

    def finish(self) -> None:
        """Label the axes in plain numbers and add the legends."""
        from matplotlib.ticker import FixedLocator, LogLocator, NullFormatter, NullLocator

        values = sorted({self.scale * float(row["value"]) for row in self.rows if row["sweep"] == self.sweep})  # type: ignore[arg-type]
        few = [value for value in values if value > 0]
        for panel in (self.errors, self.spacing, self.ripple):
            if not panel.lines:
                continue
            if len(few) <= _LABELLED_VALUES:
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


_FIGURE_SIZE = (11.0, 6.6)
_LINE = 60  # points of a predicted line
_MS = 1e3
_LEAST_SPACING = 0.05  # of the logarithmic axis [µm]
_LEAST_DEVIATION = 1e-7
_VALUE_COLOURS = (INK, *RUNS)


def plots(study: LoopStudy, rows: Sequence[Row]) -> list[Plot]:
    """Return a plot for each sweep that has cases."""
    sweeps: dict[str, tuple[Callable[[LoopStudy, Panels], str], float, str]] = {
        "loop_period": (_loop_period, _MS, "program loop period T [ms]"),
        "interpreter_time": (_interpreter_time, _MS, "interpreter time per pass d [ms]"),
        "servo_period": (_servo_period, _MS, "servo period [ms]"),
        "encoder_resolution": (_encoder_resolution, UM, "encoder resolution q [µm]"),
        "physics_step": (_physics_step, _MS, "physics step [ms]"),
    }
    drawn = []
    for sweep, (draw, scale, label) in sweeps.items():
        if not any(row["sweep"] == sweep for row in rows):
            continue
        with sheet(*_FIGURE_SIZE) as figure:
            grid = figure.add_gridspec(2, 2, width_ratios=(1.7, 1))
            errors = figure.add_subplot(grid[:, 0])
            spacing = figure.add_subplot(grid[0, 1])
            panels = Panels(
                [errors, spacing, figure.add_subplot(grid[1, 1], sharex=spacing)], rows, sweep, scale, label
            )
            text = draw(study, panels)
            panels.finish()
        drawn.append(Plot(sweep, SWEEPS[sweep], text, figure))
    return drawn


def _points(values: tuple[float, ...]) -> Floats:
    """Return points from the first to the last of ascending values above zero, evenly in the logarithm."""
    positive = [value for value in values if value > 0]
    return np.geomspace(positive[0], positive[-1], _LINE)


def _predicted_errors(study: LoopStudy, key: str, values: Floats, base: Mapping[str, Any]) -> dict[str, Floats]:
    """Return the predicted errors over an argument of the program, nan where it is refused, each (m,) [µm]."""
    predictions = []
    for value in values.tolist():
        theory = study.changed_theory({**base, key: value})
        errors = None if theory is None else theory.errors()
        rms = math.nan if errors is None else UM * errors.program.rms
        spacing = None if errors is None else errors.spacing
        if spacing is None:
            predictions.append([rms, *[math.nan] * 4])
        else:
            predictions.append([rms, *(UM * v for v in (spacing.mean, spacing.std, spacing.min, spacing.max))])
    return dict(zip(("rms", "mean", "std", "min", "max"), np.array(predictions).T, strict=True))


def _program_errors(
    study: LoopStudy, theory: LoopTheory, panels: Panels, values: tuple[float, ...]
) -> tuple[Floats, dict[str, Floats], dict[str, Floats]]:
    """Draw the errors over a setting of the program; return its values and the predictions, loop alone and limited."""
    amber = COLOURS["program"]
    swept = _points(values)
    alone = _predicted_errors(study, panels.sweep, swept, theory.alone)
    limited = _predicted_errors(study, panels.sweep, swept, {})
    panels.points(panels.errors, "contour_rms_um", AS_IT_IS, INK, "contour, as it is")
    panels.points(panels.errors, "contour_rms_um", LOOP_ALONE, INK, "contour, loop alone")
    panels.points(panels.errors, "program_rms_um", PERFECT, amber, "program, loop alone")
    panels.line(panels.errors, swept, alone["rms"], amber, "stepped arcs against the involute")
    limits = f"{theory.wait} and {theory.ramps}"
    panels.line(panels.errors, swept, limited["rms"], COLOURS["requested"], f"stepped arcs with {limits}")
    panels.failures()
    panels.ripples(AS_IT_IS, LOOP_ALONE)
    return swept, alone, limited


def _theory(study: LoopStudy) -> LoopTheory:
    """Return the closed forms of a program that has a loop: a sweep of its arguments has cases with them only."""
    assert study.theory is not None
    return study.theory


def _loop_period(study: LoopStudy, panels: Panels) -> str:
    amber = COLOURS["program"]
    theory = _theory(study)
    period, alone, limited = _program_errors(study, theory, panels, study.loop_periods)
    first_order = [UM * theory.first_order_error(t) for t in period.tolist()]
    panels.line(panels.errors, period, np.array(first_order), INK, theory.first_order, ":")
    knee_and_floor = loop_knee(panels.rows)
    if knee_and_floor is not None:
        period_of_knee, floor = knee_and_floor
        panels.errors.axhline(floor, color=COLOURS["servo"], lw=1.2, ls="--", label="contour, no loop")
        panels.mark(period_of_knee, "loop alone")
    panels.spacing_errors(theory.pitch)
    panels.line(panels.spacing, period, np.abs(limited["mean"] - UM * theory.pitch), COLOURS["requested"], "predicted")
    panels.points(panels.spacing, "spacing_std_mm", PERFECT, amber, "std, loop alone, follower", UM)
    panels.line(panels.spacing, period, alone["std"], amber, "predicted")
    panels.points(panels.spacing, "spacing_std_mm", LOOP_ALONE, INK, "std, loop alone", UM)
    panels.spacing.set_ylim(bottom=_LEAST_SPACING)
    return (
        "Loop alone: without the controller's other limits, the program error is that of tangent arcs, in closed "
        f"form; the dotted line is its first order. As it is: {theory.ramps} adds an error that no loop period "
        f"removes, and {theory.wait}, which rounds waits down to its resolution, makes short loops worse. The dashed "
        "line is the contour error of a spiral without any loop."
    )


def _interpreter_time(study: LoopStudy, panels: Panels) -> str:
    amber = COLOURS["program"]
    theory = _theory(study)
    time, alone, _ = _program_errors(study, theory, panels, study.interpreter_times)
    panels.spacing.set(yscale="linear", ylabel="[mm]")
    for column, colour in (("max", INK), ("mean", amber), ("min", INK)):
        panels.points(panels.spacing, f"spacing_{column}_mm", PERFECT, colour, f"{column}, loop alone, follower")
        panels.line(panels.spacing, time, alone[column] / UM, colour, "")
    for place, pitch in theory.local_pitches(time).items():
        panels.line(panels.spacing, time, pitch, COLOURS["structure"], f"local pitch, {place}", ":")
    return (
        "In every pass the interpreter takes its time besides the wait while the virtual circles turn on; this narrows "
        "the turns, most near the centre where the waits are short. Lines are the stepped arcs in closed form; dotted, "
        f"the local pitch at start and end. As it is, a short interpreter time offsets {theory.wait}'s rounding of the "
        "waits, half of its resolution on average."
    )


def _servo_period(study: LoopStudy, panels: Panels) -> str:
    blue = COLOURS["servo"]
    green = COLOURS["structure"]
    panels.points(panels.errors, "contour_rms_um", AS_IT_IS, INK, "contour, as it is")
    panels.points(panels.errors, "contour_rms_um", NO_LOOP, INK, "contour, no loop")
    panels.points(panels.errors, "servo_rms_um", AS_IT_IS, blue, "servo, as it is")
    normal = "steady_following_normal_rms_um"
    along = "steady_following_along_rms_um"
    panels.points(panels.errors, normal, NO_FRICTION, green, "no friction, normal to the path")
    panels.points(panels.errors, along, NO_FRICTION, COLOURS["encoder"], "no friction, along the path")
    machine = study.job.built_machine
    # what the theory speaks of
    torques = set(study.job.built_servo.modes) == {"torque"}
    theory = study.theory if torques and {"x", "y"} <= set(machine.axis_names) else None
    if theory is not None:
        period = _points(study.servo_periods)
        plane = (machine.axis_names.index("x"), machine.axis_names.index("y"))
        # of the path, as of what was measured
        middle = np.linspace(0.05, 0.95, _LINE)
        radius = theory.radius_of_curvature(middle)
        smooth = {"integral_time": math.inf, "resolution": 0.0}
        settings: list[dict[str, Any]] = [{**dict(study.job.servo), **smooth, "period": p} for p in period.tolist()]
        servos = [Servo.derive(machine.axes, **setting) for setting in settings]
        speed = theory.speed
        errors = [sample_and_hold(servo, machine.axes, plane, speed, radius) for servo in servos]
        panels.line(
            panels.errors, period, UM * np.array([e.normal for e in errors]), green, "sample, hold and winding lag"
        )
        panels.line(
            panels.errors, period, UM * np.array([e.along for e in errors]), COLOURS["encoder"], "the same, along"
        )
    x, y = series(panels.rows, "value", "contour_rms_um", sweep="servo_period", variant=AS_IT_IS)
    if x.size > 1:
        period_at_knee = knee(x, y, float(y.min()))
        # else every shorter period reduces the error
        if period_at_knee is not None and period_at_knee > x[1]:
            panels.mark(period_at_knee, "as it is")
    panels.failures()
    _spacings_and_ripples(panels, AS_IT_IS, NO_LOOP)
    remains = "the theory of the sampled servo remains (lines)" if theory is not None else "sampling remains"
    return (
        "The gains follow from the servo period: a slower servo has a lower bandwidth at the same phase margin. Most "
        f"of the servo error is friction. Without friction, program loop, encoder counts and integral term, {remains}: "
        "the feed-forward is late by one and a half servo periods and the winding's lag. These errors are taken in the "
        "middle 90 % of the time, at a quarter of the physics step."
    )


def _encoder_resolution(study: LoopStudy, panels: Panels) -> str:
    pink = COLOURS["encoder"]
    count = _points(study.resolutions)
    panels.points(panels.errors, "contour_rms_um", AS_IT_IS, INK, "contour, as it is")
    if study.theory is not None:
        panels.points(panels.errors, "contour_rms_um", NO_LOOP, INK, "contour, no loop")
    panels.points(panels.errors, "servo_rms_um", AS_IT_IS, COLOURS["servo"], "servo, as it is")
    panels.points(panels.errors, "encoder_rms_um", AS_IT_IS, pink, "encoder, as it is")
    if all(axis.unit == "mm" for axis in study.job.built_machine.axes):
        panels.line(panels.errors, count, UM * quantisation(count), pink, "q/√12")
    variant = NO_LOOP if study.theory is not None else AS_IT_IS
    x, y = series(panels.rows, "value", "contour_rms_um", sweep="encoder_resolution", variant=variant)
    if x.size > 1:
        panels.mark(knee(x, y, float(y[0])), variant)
    panels.failures()
    _spacings_and_ripples(panels, AS_IT_IS, NO_LOOP)
    return (
        "Encoder count of all linear axes, rotary ones in proportion. The encoder part of the error is that of an "
        "even distribution within a count, q / sqrt(12). The servo's derivative turns counts into torque: the path "
        "speed ripples at counts that do not yet affect the contour error."
    )


def _physics_step(study: LoopStudy, panels: Panels) -> str:
    panels.errors.set(ylabel="relative deviation from the limit", title="Convergence")
    for variant in (AS_IT_IS, NO_FRICTION):
        for (column, trend), colour in zip(convergence(panels.rows, variant).items(), _VALUE_COLOURS, strict=False):
            step = np.array(trend.steps)
            away = np.abs(np.array(trend.values) / trend.limit - 1) if trend.limit else np.zeros(step.size)
            order = "scatter" if trend.order is None else f"order {trend.order:.2f}"
            shown = away > _LEAST_DEVIATION
            shape = {"mfc": colour, **SHAPES[variant]}
            label = f"{CONVERGING_VALUES[column]}, {variant}: {order}"
            panels.errors.plot(panels.scale * step[shown], away[shown], color=colour, ls="none", label=label, **shape)
            if trend.order is not None and away[0] > _LEAST_DEVIATION:
                panels.line(panels.errors, step, away[0] * (step / step[0]) ** trend.order, colour, "")
    _spacings_and_ripples(panels, AS_IT_IS, NO_FRICTION)
    return (
        "The physics step is halved repeatedly, and each value with an order of convergence extrapolated to a step of "
        "zero; lines have that order's slope. A value that scatters is compared with that at the finest step. Without "
        "friction, which is not smooth, the first order of the integrator shows."
    )


def _spacings_and_ripples(panels: Panels, *variants: str) -> None:
    for variant in variants:
        panels.points(panels.spacing, "spacing_std_mm", variant, INK, f"std, {variant}", UM)
    panels.ripples(*variants)
