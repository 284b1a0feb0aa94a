"""The report of a loop study."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.quantity import PER_CENT
from gantrysim.controllers.loop_theory import LoopErrors
from gantrysim.report.document import Column, Table
from gantrysim.study.acceptance import Acceptance, Scope, improve_command, settings_text
from gantrysim.study.cases import LIMIT_USE, OK, Row
from gantrysim.study.drawing import series
from gantrysim.study.loop.limits import LEVERS, SweepVerdicts, draw_limits, milliseconds, present_value
from gantrysim.study.loop.plots import plots
from gantrysim.study.loop.study import AS_IT_IS, LOOP_ALONE, NO_FRICTION, NO_LOOP, PERFECT, SWEEPS, LoopStudy
from gantrysim.study.loop.trends import CONVERGING_VALUES, FLOOR_EXCESS, convergence, crossing, knee, loop_knee, power
from gantrysim.study.study import Details, Plot, Report

# The answer of a loop study: the longest period and the coarsest resolution that keep the job's limits.


def question(study: LoopStudy) -> str:
    """Return the question, by whether the program has a loop."""
    if study.job.controller.loop_line() is not None:
        return f"Which {LEVERS['loop_period'].noun} does this job need?"
    return f"Which {LEVERS[main_sweep(study)].noun} does this job need?"


def main_sweep(study: LoopStudy) -> str:
    """Return the sweep that answers the question."""
    return "servo_period" if study.theory is None else "loop_period"


def sweep_verdicts(study: LoopStudy, rows: Sequence[Row]) -> dict[str, SweepVerdicts]:
    """Return the verdicts on the unchanged job by sweep, for the sweeps with a run that was judged."""
    by_sweep: dict[str, dict[float, Acceptance | None]] = {}
    for row in rows:
        if row["variant"] == AS_IT_IS and row["sweep"] in LEVERS:
            by_sweep.setdefault(str(row["sweep"]), {})[float(row["value"])] = Acceptance.of(row)  # type: ignore[arg-type]
    verdicts = [verdict for sweep in by_sweep.values() for verdict in sweep.values()]
    present = {
        sweep: by_sweep[sweep].get(value) for sweep in by_sweep if (value := present_value(study, sweep)) is not None
    }
    scope = Scope.of(verdicts, next((verdict for verdict in present.values() if verdict is not None), None))
    return {
        sweep: SweepVerdicts(LEVERS[sweep], dict(sorted(by_sweep[sweep].items())), scope)
        for sweep in LEVERS
        if any(verdict is not None for verdict in by_sweep.get(sweep, {}).values())
    }


def loop_answer(study: LoopStudy, rows: Sequence[Row], knees: dict[str, str]) -> str:
    """Return the answer.

    Args:
        study: the study.
        rows: of all cases.
        knees: of the contour error, by sweep and variant in words.
    """
    sweeps = sweep_verdicts(study, rows)
    main = main_sweep(study)
    clauses = [_main(study, sweeps, main)] if main in sweeps else ["Too few cases were judged by the job's tolerance"]
    clauses += [
        f"{sweep.lever.key} alone keeps them at {sweep.kept_text}"
        for name, sweep in sweeps.items()
        if name != main and sweep.kept
    ]
    if knees:
        texts = [f"{name} {value}" for name, value in knees.items()]
        clauses.append(f"the contour error has knees at {', '.join(texts)}")
    return f"{_text_loop(study)}{'; '.join(clauses)}."


def _text_loop(study: LoopStudy) -> str:
    """Return that the loop in the program's text cannot be varied, and what can; empty without such a loop."""
    loop = study.job.controller.loop_line()
    if loop is None:
        return ""
    number, line = loop
    return (
        f"Not known: the program's own loop, line {number}, {line}, stands in its text, and no key of the job sets the "
        "time of its passes. Change the text and compare the runs: gantrysim compare. What can be varied is "
        f"{LEVERS['servo_period'].key} and {LEVERS['encoder_resolution'].key}. "
    )


def _main(study: LoopStudy, sweeps: dict[str, SweepVerdicts], main: str) -> str:
    sweep = sweeps[main]
    lever = sweep.lever
    scope = sweep.scope
    if sweep.kept:
        largest = sweep.kept[-1]
        present = present_value(study, main)
        value = largest if present is None or present not in sweep.kept else present
        verdict = sweep.judged[value]
        verb = "Keep" if value == present else "Set"
        change = f"{verb} {settings_text({lever.key: value})}"
        usage = f"keeps {scope.words}, with {scope.usage(verdict)}"
        longest = f"{lever.text(largest)} is the {lever.largest} {lever.noun} tried that"
        if value == largest:
            return f"{change}: {longest} {usage}{scope.remark(verdict)}"
        return f"{change}, which {usage}; {longest} does{scope.remark(verdict)}"
    verdict = sweep.judged[sweep.nearest]
    first = next(iter(sweep.verdicts))
    last = next(reversed(sweep.verdicts))
    text = (
        f"No {lever.noun} tried, {lever.text(first)} to {lever.text(last)}, keeps {scope.words}: "
        f"{lever.text(sweep.nearest)} comes nearest, at {scope.excess(verdict)}"
    )
    if any(other.kept for other in sweeps.values()):
        return text
    best = min(sweeps.values(), key=lambda other: other.judged[other.nearest].use(scope.aspects))
    if best is not sweep:
        change = settings_text({best.lever.key: best.nearest})
        text += f", {change} nearer, at {scope.excess(best.judged[best.nearest])}"
    return f"{text}; {improve_command(study.job)} tries other levers"


def answer_table(study: LoopStudy, sweeps: dict[str, SweepVerdicts], knees: dict[str, str]) -> Table | None:
    """Return the table of what each swept setting needs; None without a run that was judged."""
    if not sweeps:
        return None
    cells: list[list[Any]] = []
    for name, sweep in sweeps.items():
        verdict = sweep.judged[sweep.nearest]
        use = verdict.use(sweep.scope.aspects)
        knee = ", ".join(
            f"{value} ({variant})" for (title, variant), value in _split(knees) if title == sweep.lever.noun
        )
        present = present_value(study, name)
        job_value = "–" if present is None else sweep.lever.text(present)
        nearest = sweep.lever.text(sweep.nearest)
        cells.append([SWEEPS[name], sweep.lever.key, job_value, sweep.kept_text, nearest, use, knee or "–"])
    scope = next(iter(sweeps.values())).scope
    caption = (
        f"Values tried that keep {scope.words}, the one with the least use of its closest limit, and the knee of the "
        "contour error: the largest value up to which the setting has no effect."
    )
    columns: list[str | Column] = [
        "setting",
        "key",
        "job",
        "keeps the limits",
        "least use at",
        Column(f"closest limit [{LIMIT_USE.unit}]", LIMIT_USE.form),
        "knee",
    ]
    return Table(columns, cells, caption)


def _split(knees: dict[str, str]) -> list[tuple[tuple[str, str], str]]:
    """Return the knees with their sweep and variant apart."""
    parts = []
    for name, value in knees.items():
        sweep, _, variant = name.partition(" (")
        parts.append(((sweep, variant.rstrip(")")), value))
    return parts


_SIGNIFICANT_RISE = 1.05  # over the least error: a significant rise
_HIDING = 0.5  # of the contour error: a program error that hides the servo's
_SENSITIVE_SHARE = 0.05  # of a value: a significant effect of the physics step

Lines = list[tuple[str, str, str, str]]  # sweep, variant, result and value


def report(study: LoopStudy, rows: Sequence[Row]) -> Report:
    """Return the knees and errors of all sweeps, the convergence over the physics step, and a plot of each sweep."""
    lines = [*_loop(study, rows), *_interpreter(study, rows), *_servo(rows), *_encoder(rows)]
    caption = (
        f"Contour errors are rms. Knee: largest value up to which the contour error is within "
        f"{PER_CENT * FLOOR_EXCESS:.0f} % of its floor; below it, the sweep has no effect."
    )
    tables = [Table(["sweep", "variant", "result", "value"], lines, caption)] if lines else []
    tables += _convergence_table(rows)
    knees = {f"{sweep} ({variant})": value for sweep, variant, result, value in lines if result == "knee"}
    drawn = plots(study, rows)
    sweeps = sweep_verdicts(study, rows)
    main = main_sweep(study)
    chart = next((plot for plot in drawn if plot.name == main), None)
    if sweeps:
        scope = next(iter(sweeps.values())).scope
        chart = Plot(
            "limits",
            "Use of the closest limit",
            f"The job as it is, with one setting changed at a time: the largest use of {scope.words}. Green points "
            "keep them. The dashed line is the limit, 100 %; the dotted one the job's own value.",
            draw_limits(study, sweeps),
        )
    return Report(
        question(study),
        loop_answer(study, rows, knees),
        chart,
        answer_table(study, sweeps, knees),
        Details(_notes(study, rows), tables, [plot for plot in drawn if plot is not chart]),
    )


def _notes(study: LoopStudy, rows: Sequence[Row]) -> list[str]:
    notes = []
    converging = convergence(rows, AS_IT_IS)
    if moved := [
        CONVERGING_VALUES[column] for column, value in converging.items() if value.deviation > _SENSITIVE_SHARE
    ]:
        notes.append(f"More than {PER_CENT * _SENSITIVE_SHARE:.0f} % off due to the physics step: {', '.join(moved)}.")
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
        add(AS_IT_IS, "best period", milliseconds(period[best]))
        add(AS_IT_IS, f"contour error at {milliseconds(period[best])}", _um(contour[best]))
        if alone[0].size:
            by_itself = np.interp(float(period[best]), alone[0], alone[1])
            add(LOOP_ALONE, f"contour error at {milliseconds(period[best])}", _um(by_itself))
        if theory is not None and theory.ramp_period is not None:
            add(AS_IT_IS, f"loop period with the same error as {theory.ramps}", milliseconds(theory.ramp_period))
        if contour[0] > _SIGNIFICANT_RISE * contour[best]:
            times = f"{contour[0] / contour[best]:.1f} times the least"
            add(AS_IT_IS, f"contour error at {milliseconds(period[0])}", f"{_um(contour[0])}, {times}")
            if unrounded := _with_exact_waits(study, float(period[0])):
                rounding = (
                    f"{theory.wait}'s rounding to {milliseconds(theory.wait_resolution)}" if theory is not None else ""
                )
                add(AS_IT_IS, f"program error without {rounding}, at {milliseconds(period[0])}", _um(unrounded))
        refused = [
            float(row["value"])  # type: ignore[arg-type]
            for row in rows
            if row["sweep"] == "loop_period" and row["variant"] == AS_IT_IS and row["status"] != OK
        ]
        if shorter := [value for value in refused if value < period[0]]:
            add(AS_IT_IS, "no values at and below", milliseconds(max(shorter)))
    knee_and_floor = loop_knee(rows)
    if knee_and_floor is not None:
        add(LOOP_ALONE, "knee", _knee(knee_and_floor[0], alone[0], milliseconds))
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
    if exact is None or (rounded is not None and exact.program.rms >= rounded.program.rms / _SIGNIFICANT_RISE):
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
    lines = [(sweep, PERFECT, f"narrowing of the turns at {milliseconds(time[-1])} per pass", narrowing)]
    as_is, contour = series(rows, "value", "contour_rms_um", sweep="interpreter_time", variant=AS_IT_IS)
    if as_is.size > 1:
        best = int(contour.argmin())
        if best and contour[0] > _SIGNIFICANT_RISE * contour[best]:
            value = f"{_um(contour[best])} instead of {_um(contour[0])}"
            lines.append((sweep, AS_IT_IS, f"least contour error, at {milliseconds(as_is[best])}", value))
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
        # every shorter period reduces the error
        if period_at_knee is not None and period_at_knee < period[1]:
            period_at_knee = None
        add(shown, "knee", _knee(period_at_knee, period, milliseconds))
    variants = [variant for _, variant, *_ in lines]
    if AS_IT_IS not in variants:
        return []
    if NO_LOOP in variants:
        columns = ("contour_rms_um", "servo_rms_um", "program_rms_um")
        period, contour, servo, program = series(rows, "value", *columns, sweep="servo_period", variant=AS_IT_IS)
        if period.size and program.min() > _HIDING * contour.min():
            add(AS_IT_IS, "least program error, which hides the servo's", _um(program.min()))
        # the crossing lies between points on logarithmic scales
        if np.all(program > 0) and np.all(servo > 0):
            period_at_crossing = crossing(period, servo, program)
            if period_at_crossing:
                add(AS_IT_IS, "servo error exceeds program error above", milliseconds(period_at_crossing))
    shown = variants[-1]
    period, contour = series(rows, "value", "contour_rms_um", sweep="servo_period", variant=shown)
    for value, error in zip(period, contour, strict=True):
        add(shown, f"contour error at {milliseconds(value)}", _um(error))
    add(shown, "growth of the contour error", f"period^{power(period, contour):.1f}")
    steady = "steady_following_normal_rms_um"
    errors = {
        variant: dict(np.transpose(series(rows, "value", steady, sweep="servo_period", variant=variant)).tolist())
        for variant in (shown, NO_FRICTION)
    }
    if shared := [value for value in errors[shown] if value in errors[NO_FRICTION]]:
        middle = shared[len(shared) // 2]
        for variant, values in errors.items():
            add(variant, f"steady normal following error at {milliseconds(middle)}", _um(values[middle]))
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
            ripple_text = f"{PER_CENT * ripple[k]:.2g} %"
            lines.append((sweep, AS_IT_IS, f"speed ripple at {_um(1e3 * count[k])}", ripple_text))
    return lines


def _convergence_table(rows: Sequence[Row]) -> list[Table]:
    trends = {variant: convergence(rows, variant) for variant in (AS_IT_IS, NO_FRICTION)}
    if not trends[AS_IT_IS]:
        return []
    steps = next(iter(trends[AS_IT_IS].values())).steps
    cells = [
        [
            CONVERGING_VALUES[column],
            variant,
            PER_CENT * value.deviation,
            "scatter" if value.order is None else f"{value.order:.2f}",
        ]
        for variant, values in trends.items()
        for column, value in values.items()
    ]
    caption = (
        f"Deviation at a physics step of {milliseconds(steps[0])} from the limit extrapolated (Richardson) over halved "
        f"steps down to {milliseconds(steps[-1])}; without an order of convergence, the whole scatter."
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
