"""The report of a loop study."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.controllers.loop_theory import LoopErrors
from gantrysim.report.document import Column, Table
from gantrysim.study.cases import OK, Row
from gantrysim.study.loop.answer import answer_table, loop_answer, main_sweep, question, sweep_verdicts
from gantrysim.study.loop.answer import milliseconds as _ms
from gantrysim.study.loop.plots import plots
from gantrysim.study.loop.study import AS_IT_IS, LOOP_ALONE, NO_FRICTION, NO_LOOP, PERFECT, LoopStudy
from gantrysim.study.loop.trends import CONVERGING, EXCESS, convergence, crossing, knee, loop_knee, power
from gantrysim.study.series import series
from gantrysim.study.study import Details, Report

_PER_CENT = 100.0
_TURNED = 1.05  # over the least error: a significant rise
_HIDING = 0.5  # of the contour error: a program error that hides the servo's
_SENSITIVE = 0.05  # of a value: a significant effect of the physics step

Lines = list[tuple[str, str, str, str]]  # sweep, variant, result and value


def report(study: LoopStudy, rows: Sequence[Row]) -> Report:
    """Return the knees and errors of all sweeps, the convergence over the physics step, and a plot of each sweep."""
    lines = [*_loop(study, rows), *_interpreter(study, rows), *_servo(rows), *_encoder(rows)]
    caption = (
        f"Contour errors are rms. Knee: largest value up to which the contour error is within {_PER_CENT * EXCESS:.0f} "
        "% of its floor; below it, the sweep has no effect."
    )
    tables = [Table(["sweep", "variant", "result", "value"], lines, caption)] if lines else []
    tables += _convergence_table(rows)
    knees = {f"{sweep} ({variant})": value for sweep, variant, result, value in lines if result == "knee"}
    drawn = plots(study, rows)
    main = main_sweep(study)
    chart = next((plot for plot in drawn if plot.name == main), None)
    return Report(
        question(study),
        loop_answer(study, rows, knees),
        chart,
        answer_table(study, sweep_verdicts(rows), knees),
        Details(_notes(study, rows), tables, [plot for plot in drawn if plot is not chart]),
    )


def _notes(study: LoopStudy, rows: Sequence[Row]) -> list[str]:
    notes = []
    converging = convergence(rows, AS_IT_IS)
    if moved := [CONVERGING[column] for column, value in converging.items() if value.deviation > _SENSITIVE]:
        notes.append(f"More than {_PER_CENT * _SENSITIVE:.0f} % off due to the physics step: {', '.join(moved)}.")
    if study.theory is None:
        controller = study.job.program["controller"]
        reason = "has no program loop" if study.job.controller.loop_line() is None else "has its loop in its text"
        notes.append(f"{controller} {reason}: the sweeps of loop period and interpreter time are left out.")
    if failed := sum(row["status"] != OK for row in rows):
        notes.append(f"{failed} of {len(rows)} cases have no values: refused by the controller, or ended by a fault.")
    return notes


def _loop(study: LoopStudy, rows: Sequence[Row]) -> Lines:
    lines: Lines = []

    def add(variant: str, result: str, value: str) -> None:
        lines.append(("loop period", variant, result, value))

    theory = study.theory
    period, contour = series(rows, "value", "contour_rms_um", sweep="loop_period", variant=AS_IT_IS)
    alone = series(rows, "value", "contour_rms_um", sweep="loop_period", variant=LOOP_ALONE)
    if period.size > 1:
        best = int(contour.argmin())
        add(AS_IT_IS, "best period", _ms(period[best]))
        add(AS_IT_IS, f"contour error at {_ms(period[best])}", _um(contour[best]))
        if alone[0].size:
            by_itself = np.interp(float(period[best]), alone[0], alone[1])
            add(LOOP_ALONE, f"contour error at {_ms(period[best])}", _um(by_itself))
        if theory is not None and theory.ramp_period is not None:
            add(AS_IT_IS, f"loop period with the same error as {theory.ramps}", _ms(theory.ramp_period))
        if contour[0] > _TURNED * contour[best]:
            times = f"{contour[0] / contour[best]:.1f} times the least"
            add(AS_IT_IS, f"contour error at {_ms(period[0])}", f"{_um(contour[0])}, {times}")
            if unrounded := _with_exact_waits(study, float(period[0])):
                rounding = f"{theory.wait}'s rounding to {_ms(theory.wait_resolution)}" if theory is not None else ""
                add(AS_IT_IS, f"program error without {rounding}, at {_ms(period[0])}", _um(unrounded))
        refused = [
            float(row["value"])  # type: ignore[arg-type]
            for row in rows
            if row["sweep"] == "loop_period" and row["variant"] == AS_IT_IS and row["status"] != OK
        ]
        if shorter := [value for value in refused if value < period[0]]:
            add(AS_IT_IS, "no values at and below", _ms(max(shorter)))
    knee_and_floor = loop_knee(rows)
    if knee_and_floor is not None:
        add(LOOP_ALONE, "knee", _knee(knee_and_floor[0], alone[0], _ms))
        add(NO_LOOP, "contour error", _um(knee_and_floor[1]))
        exact, program = series(rows, "value", "program_rms_um", sweep="loop_period", variant=PERFECT)
        if exact.size > 1:
            per_ms = _um(program[0] / exact[0] * 1e-3)
            add(PERFECT, "growth of the program error", f"T^{power(exact, program):.2f}, {per_ms} per ms")
    return lines


def _with_exact_waits(study: LoopStudy, period: float) -> float | None:
    """Return the program error at a loop period with exact waits [µm]; None where that makes no difference."""
    if study.theory is None:
        return None
    rounded = _errors(study, {"loop_period": period})
    exact = _errors(study, {"loop_period": period, **study.theory.exact_waits})
    if exact is None or (rounded is not None and exact.program.rms >= rounded.program.rms / _TURNED):
        return None
    return 1e3 * exact.program.rms


def _errors(study: LoopStudy, changes: Mapping[str, Any]) -> LoopErrors | None:
    theory = study.changed_theory(changes)
    return None if theory is None else theory.errors()


def _interpreter(study: LoopStudy, rows: Sequence[Row]) -> Lines:
    time, pitch = series(rows, "value", "spacing_mean_mm", sweep="interpreter_time", variant=PERFECT)
    if time.size < 2 or time[0] > 0:
        return []
    sweep = "interpreter time"
    nominal = "" if study.theory is None else f" of {study.theory.pitch:g} mm"
    narrowing = f"{_um(1e3 * (pitch[0] - pitch[-1]))}{nominal}"
    lines = [(sweep, PERFECT, f"narrowing of the turns at {_ms(time[-1])} per pass", narrowing)]
    as_is, contour = series(rows, "value", "contour_rms_um", sweep="interpreter_time", variant=AS_IT_IS)
    if as_is.size > 1:
        best = int(contour.argmin())
        if best and contour[0] > _TURNED * contour[best]:
            value = f"{_um(contour[best])} instead of {_um(contour[0])}"
            lines.append((sweep, AS_IT_IS, f"least contour error, at {_ms(as_is[best])}", value))
    return lines


def _servo(rows: Sequence[Row]) -> Lines:
    lines: Lines = []

    def add(variant: str, result: str, value: str) -> None:
        lines.append(("servo period", variant, result, value))

    for shown in (AS_IT_IS, NO_LOOP):
        period, contour = series(rows, "value", "contour_rms_um", sweep="servo_period", variant=shown)
        if period.size < 2:
            continue
        period_at_knee = knee(period, contour, float(contour.min()))
        if period_at_knee is not None and period_at_knee < period[1]:  # every shorter period reduces the error
            period_at_knee = None
        add(shown, "knee", _knee(period_at_knee, period, _ms))
    variants = [variant for _, variant, *_ in lines]
    if AS_IT_IS not in variants:
        return []
    if NO_LOOP in variants:
        columns = ("contour_rms_um", "servo_rms_um", "program_rms_um")
        period, contour, servo, program = series(rows, "value", *columns, sweep="servo_period", variant=AS_IT_IS)
        if period.size and program.min() > _HIDING * contour.min():
            add(AS_IT_IS, "least program error, which hides the servo's", _um(program.min()))
        if np.all(program > 0) and np.all(servo > 0):  # the crossing lies between points on logarithmic scales
            period_at_crossing = crossing(period, servo, program)
            if period_at_crossing:
                add(AS_IT_IS, "servo error exceeds program error above", _ms(period_at_crossing))
    shown = variants[-1]
    period, contour = series(rows, "value", "contour_rms_um", sweep="servo_period", variant=shown)
    for value, error in zip(period, contour, strict=True):
        add(shown, f"contour error at {_ms(value)}", _um(error))
    add(shown, "growth of the contour error", f"period^{power(period, contour):.1f}")
    steady = "steady_following_normal_rms_um"
    errors = {
        variant: dict(np.transpose(series(rows, "value", steady, sweep="servo_period", variant=variant)).tolist())
        for variant in (shown, NO_FRICTION)
    }
    if shared := [value for value in errors[shown] if value in errors[NO_FRICTION]]:
        middle = shared[len(shared) // 2]
        for variant, values in errors.items():
            add(variant, f"steady normal following error at {_ms(middle)}", _um(values[middle]))
    return lines


def _encoder(rows: Sequence[Row]) -> Lines:
    sweep = "encoder resolution"
    for variant in (NO_LOOP, AS_IT_IS):
        count, contour = series(rows, "value", "contour_rms_um", sweep="encoder_resolution", variant=variant)
        if count.size > 1:
            break
    else:
        return []
    count_at_knee = knee(count, contour, float(contour[0]))
    lines = [(sweep, variant, "knee", _knee(count_at_knee, count, lambda value: _um(1e3 * value)))]
    count, ripple = series(rows, "value", "speed_ripple", sweep="encoder_resolution", variant=AS_IT_IS)
    if count.size > 1:
        for k in (0, -1):
            ripple_text = f"{_PER_CENT * ripple[k]:.2g} %"
            lines.append((sweep, AS_IT_IS, f"speed ripple at {_um(1e3 * count[k])}", ripple_text))
    return lines


def _convergence_table(rows: Sequence[Row]) -> list[Table]:
    trends = {variant: convergence(rows, variant) for variant in (AS_IT_IS, NO_FRICTION)}
    if not trends[AS_IT_IS]:
        return []
    steps = next(iter(trends[AS_IT_IS].values())).steps
    cells = [
        [
            CONVERGING[column],
            variant,
            _PER_CENT * value.deviation,
            "scatter" if value.order is None else f"{value.order:.2f}",
        ]
        for variant, values in trends.items()
        for column, value in values.items()
    ]
    caption = (
        f"Deviation at a physics step of {_ms(steps[0])} from the limit extrapolated (Richardson) over halved steps "
        f"down to {_ms(steps[-1])}; without an order of convergence, the whole scatter."
    )
    return [Table(["value", "variant", Column("deviation [%]", ".2g"), "order"], cells, caption)]


def _knee(value: float | None, swept: Floats, text: Callable[[float], str]) -> str:
    """Return a knee as text, or the end of the sweep beyond which it lies."""
    if value is None:
        return f"< {text(swept[0])}"
    return f"> {text(swept[-1])}" if value == math.inf else text(value)


def _um(micrometres: Floats | float) -> str:
    value = float(micrometres)
    if value >= 100:
        return f"{value:.0f} µm"
    return f"{value:.3g} µm"
