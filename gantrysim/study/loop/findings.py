"""What a loop study has found, in words."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gantrysim.controllers.path import Floats
from gantrysim.study.cases import OK, Row
from gantrysim.study.loop.trends import EXCESS, Convergence, crossing, knee, power
from gantrysim.study.loop.variants import AS_IT_IS, LOOP_ALONE, NO_FRICTION, NO_LOOP, PERFECT
from gantrysim.study.series import series

if TYPE_CHECKING:
    from gantrysim.study.loop.study import LoopStudy

__all__ = ["CONVERGING", "convergence", "findings", "loop_knee"]

# figures whose convergence over the physics step is looked at
CONVERGING = {
    "contour_rms_um": "contour error",
    "tracking_rms_um": "tracking error",
    "tracking_along_rms_um": "tracking error along the path",
    "structure_rms_um": "structure's part",
    "spacing_std_mm": "spread of the spacing",
}
_PER_CENT = 100.0
_ARTEFACT = 0.05  # of a figure, from which what the physics step does to it is no small matter
_TURNED = 1.05  # of the least error, from which a rise is one


def findings(study: LoopStudy, rows: list[Row]) -> list[str]:
    """Return what the rows say: the paragraph that answers, the proof of the integrator, and what was left out."""
    said = [
        *(_loop(rows), _waits(study, rows), _interpreter(study, rows)),
        *(_servo(rows), _encoder(rows)),
    ]
    answer = " ".join(sentence for sentence in said if sentence)
    paragraphs = [answer or "No sweep has enough cases that went through to say anything of.", *_integrator(rows)]
    if not study.spiral:
        controller = study.job.program["controller"]
        paragraphs.append(
            f"{controller} has no program loop in the way of Trio's Move Spiral: the sweeps of its period and of the "
            "interpreter's time are left out."
        )
    failed = [row for row in rows if row["status"] != OK]
    if failed:
        paragraphs.append(
            f"{len(failed)} of {len(rows)} cases have no figures: the controller refused them, or a drive tripped."
        )
    return paragraphs


def loop_knee(rows: list[Row]) -> tuple[float | None, float] | None:
    """Return the loop period below which the loop alone does not matter [s], as `knee`, and the error it then has [µm].

    None where the cases for it are missing.
    """
    period, contour = series(rows, "value", "contour_rms_um", sweep="loop_period", variant=LOOP_ALONE)
    floor = series(rows, "contour_rms_um", sweep="loop_period", variant=NO_LOOP)[0]
    if not floor.size or period.size < 2:
        return None
    return knee(period, contour, float(floor[0])), float(floor[0])


def convergence(rows: list[Row], variant: str) -> dict[str, Convergence]:
    """Return the convergence of the figures of a variant over the physics step, by column."""
    found = {}
    for column in CONVERGING:
        step, value = series(rows, "value", column, sweep="physics_step", variant=variant)
        if step.size >= 3:
            found[column] = Convergence.of(step[::-1], value[::-1])
    return found


def _loop(rows: list[Row]) -> str | None:
    found = loop_knee(rows)
    if found is None:
        return None
    at, floor = found
    period, contour = series(rows, "value", "contour_rms_um", sweep="loop_period", variant=LOOP_ALONE)
    left = f"{_um(floor)} that servo and machine leave without any loop"
    if at is None:
        return (
            f"The program loop matters at every period down to T = {_ms(period[0])}: the contour error (rms) is "
            f"{_um(contour[0])} there with the loop alone, more than {_PER_CENT * EXCESS:.0f} % above the {left}."
        )
    within = f"the contour error (rms) is within {_PER_CENT * EXCESS:.0f} % of the {left}"
    if at == math.inf:
        return f"Up to T = {_ms(period[-1])} the program loop does not matter: {within}."
    text = f"Below T = {_ms(at)} the program loop no longer matters: with the loop alone {within}."
    exact_period, generation = series(rows, "value", "generation_rms_um", sweep="loop_period", variant=PERFECT)
    if exact_period.size > 1:
        text += (
            f" The loop's own part grows as T^{power(exact_period, generation):.2f}, "
            f"{_um(generation[0] / exact_period[0] * 1e-3)} for each millisecond."
        )
    return text


def _waits(study: LoopStudy, rows: list[Row]) -> str | None:
    """What the controller's other limits make of the loop: as a rule a shorter one is no better."""
    period, contour = series(rows, "value", "contour_rms_um", sweep="loop_period", variant=AS_IT_IS)
    alone = series(rows, "value", "contour_rms_um", sweep="loop_period", variant=LOOP_ALONE)
    if period.size < 2:
        return None
    best = int(contour.argmin())
    text = f"As the job is, the error is least at T = {_ms(period[best])}, with {_um(contour[best])}"
    by_itself = float(np.interp(float(period[best]), alone[0], alone[1])) if alone[0].size else math.nan
    if by_itself < contour[best] / _TURNED:
        text += f" where the loop by itself would cost {_um(by_itself)}"
    acceleration = study.job.program["acceleration"]
    if math.isfinite(acceleration):
        same = study.job.program["speed"] / acceleration
        text += f" (ACCEL costs as much as a loop of {_ms(same)} does)"
    if contour[0] <= _TURNED * contour[best]:
        return f"{text}."
    text += (
        f"; a faster loop makes it worse, up to {_um(contour[0])} at {_ms(period[0])}, "
        f"{contour[0] / contour[best]:.1f} times as much"
    )
    shortest = {"program.loop_period": float(period[0])}
    cut, uncut = study.arcs(shortest), study.arcs({**shortest, "program.wait_resolution": 0.0})
    if uncut is not None and (cut is None or uncut.generation.rms < cut.generation.rms / _TURNED):
        text += (
            f", because WA cuts every wait to a multiple of {_ms(study.job.program['wait_resolution'])} "
            f"({_um(1e3 * uncut.generation.rms)} if it did not)"
        )
    refused = [row["value"] for row in rows if _refused(row) and row["variant"] == AS_IT_IS]
    shorter = [value for value in refused if isinstance(value, float) and value < period[0]]
    if shorter:
        text += f", and at {_ms(max(shorter))} and below the spiral does not come to its end at all"
    return f"{text}."


def _refused(row: Row) -> bool:
    return row["sweep"] == "loop_period" and row["status"] != OK


def _interpreter(study: LoopStudy, rows: list[Row]) -> str | None:
    time, pitch = series(rows, "value", "spacing_mean_mm", sweep="interpreter_time", variant=PERFECT)
    if time.size < 2 or time[0] > 0:
        return None
    asked = study.job.program["thickness"]
    text = (
        f"The interpreter's time narrows the turns: by {_um(1e3 * (pitch[0] - pitch[-1]))} of {asked:g} mm on average "
        f"at {_ms(time[-1])} per pass"
    )
    as_is, contour = series(rows, "value", "contour_rms_um", sweep="interpreter_time", variant=AS_IT_IS)
    if as_is.size > 1:
        best = int(contour.argmin())
        if best and contour[0] > _TURNED * contour[best]:
            text += (
                f"; as the job is, {_ms(as_is[best])} of it makes good for part of what the controller's other limits "
                f"do, {_um(contour[best])} instead of {_um(contour[0])}"
            )
    return f"{text}."


def _servo(rows: list[Row]) -> str | None:
    period, contour, tracking, generation = series(
        rows, "value", "contour_rms_um", "tracking_rms_um", "generation_rms_um", sweep="servo_period", variant=AS_IT_IS
    )
    if period.size < 2:
        return None
    at = knee(period, contour, float(contour.min()))
    if at is None or at < period[1]:
        text = f"Every shortening of the servo period down to {_ms(period[0])} still pays"
    elif at == math.inf:
        text = f"Up to {_ms(period[-1])} the servo period makes no difference to the contour error as the job is"
    else:
        text = f"Below a servo period of {_ms(at)} the servo no longer matters to the contour error as the job is"
    text += (
        f": the tracking error is {_um(tracking[0])} at {_ms(period[0])} and {_um(tracking[-1])} at {_ms(period[-1])}"
        f" (as period^{power(period, tracking):.1f}, for the gains follow from the period)"
    )
    overtakes = crossing(period, tracking, generation) if np.all(generation > 0) and np.all(tracking > 0) else None
    if overtakes:
        text += f", and exceeds the program's part above {_ms(overtakes)}"
    smooth, normal = series(rows, "value", "steady_tracking_normal_rms_um", sweep="servo_period", variant=NO_FRICTION)
    shared = [k for k, value in enumerate(period) if value in smooth]
    if shared:
        k = shared[len(shared) // 2]
        share = normal[int(np.flatnonzero(smooth == period[k])[0])]
        text += (
            f". Of the {_um(tracking[k])} at {_ms(period[k])}, {_um(share)} would be left without friction, encoder "
            "counts and integral term"
        )
    return f"{text}."


def _encoder(rows: list[Row]) -> str | None:
    for variant in (NO_LOOP, AS_IT_IS):
        count, contour = series(rows, "value", "contour_rms_um", sweep="encoder_resolution", variant=variant)
        if count.size > 1:
            break
    else:
        return None
    at = knee(count, contour, float(contour[0]))
    where = "even without the loop" if variant == NO_LOOP else "as the job is"
    ripple = series(rows, "value", "speed_ripple", sweep="encoder_resolution", variant=AS_IT_IS)
    if at is None:
        text = f"Finer encoder counts than {_um(1e3 * count[0])} still help"
    elif at == math.inf:
        text = f"Encoder counts up to {_um(1e3 * count[-1])} make no difference to the contour error {where}"
    else:
        text = f"Below {_um(1e3 * at)} per count the encoder no longer matters to the contour error {where}"
    if ripple[0].size > 1:
        lowest, highest = _PER_CENT * ripple[1][0], _PER_CENT * ripple[1][-1]
        text += (
            f", while the speed ripple goes from {lowest:.2g} % at {_um(1e3 * ripple[0][0])} "
            f"to {highest:.2g} % at {_um(1e3 * ripple[0][-1])}"
        )
    return f"{text}."


def _integrator(rows: list[Row]) -> list[str]:
    """What of the figures is the integrator's making."""
    as_is, smooth = convergence(rows, AS_IT_IS), convergence(rows, NO_FRICTION)
    if not as_is:
        return []
    steps = next(iter(as_is.values())).steps
    moved = {column: figure for column, figure in as_is.items() if figure.deviation > _ARTEFACT}
    kept = {column: figure for column, figure in as_is.items() if column not in moved}
    text = (
        f"The physics step was halved from {1e3 * steps[0]:.3g} ms down to {1e3 * steps[-1]:.3g} ms, and the figures "
        "extrapolated to a step of zero (Richardson) where they show an order of convergence; where they scatter, the "
        "whole scatter is told. "
    )
    if not moved:
        text += "The figures of the job as it is are no artefact of the integrator, they are off their limits by: "
    elif kept:
        text += (
            "Of the figures of the job as it is these depend on the step, and so are the integrator's as well as the "
            f"machine's: {_told(moved)}. The others are no artefact of it, they are off their limits by: "
        )
    else:
        text += (
            "The figures of the job as it is all depend on the step, take a shorter one; they are off their limits by: "
        )
    text += f"{_told(kept or moved)}."
    if smooth:
        text += f" Without friction, which is not smooth: {_told(smooth)}."
    return [text]


def _told(found: dict[str, Convergence]) -> str:
    parts = []
    for column, figure in found.items():
        order = f"order {figure.order:.2f}" if figure.order is not None else "scatter"
        parts.append(f"{CONVERGING[column]} {_PER_CENT * figure.deviation:.2g} % ({order})")
    return ", ".join(parts)


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.3g} ms"


def _um(micrometres: Floats | float) -> str:
    value = float(micrometres)
    if value >= 100:
        return f"{value:.0f} µm"
    return f"{value:.3g} µm" if value >= 0.1 else f"{1e3 * value:.2g} nm"
