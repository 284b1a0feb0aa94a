"""The plots of a loop study: simulations as points, closed forms as lines, knees marked."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.controllers.loop_theory import LoopTheory
from gantrysim.report.plots.style import AXIS_COLOURS, COLOURS, INK, UM, sheet
from gantrysim.servo.servo import Servo
from gantrysim.study.cases import Row
from gantrysim.study.loop.panels import SHAPES, Panels
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
from gantrysim.study.loop.trends import CONVERGING, convergence, knee, loop_knee
from gantrysim.study.series import series
from gantrysim.study.study import Plot

_SIZE = (11.0, 6.6)
_LINE = 60  # points of a predicted line
_MS = 1e3
_LEAST_SPACING = 0.05  # of the logarithmic axis [µm]
_LEAST_DEVIATION = 1e-7
_VALUE_COLOURS = (INK, COLOURS["servo"], AXIS_COLOURS[0], COLOURS["structure"], COLOURS["program"])


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
        with sheet(*_SIZE) as figure:
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


def _predicted(study: LoopStudy, key: str, values: Floats, base: Mapping[str, Any]) -> dict[str, Floats]:
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
    alone = _predicted(study, panels.sweep, swept, theory.alone)
    limited = _predicted(study, panels.sweep, swept, {})
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
    torques = set(study.job.built_servo.modes) == {"torque"}  # what the theory speaks of
    theory = study.theory if torques and {"x", "y"} <= set(machine.axis_names) else None
    if theory is not None:
        period = _points(study.servo_periods)
        plane = (machine.axis_names.index("x"), machine.axis_names.index("y"))
        middle = np.linspace(0.05, 0.95, _LINE)  # of the path, as of what was measured
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
        if period_at_knee is not None and period_at_knee > x[1]:  # else every shorter period reduces the error
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
            label = f"{CONVERGING[column]}, {variant}: {order}"
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
