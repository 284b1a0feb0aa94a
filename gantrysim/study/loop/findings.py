"""What a loop study has found, in words."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gantrysim.arrays import Floats
from gantrysim.study.cases import OK, Row
from gantrysim.study.loop.integrator import integrator_findings
from gantrysim.study.loop.trends import EXCESS, crossing, knee, power
from gantrysim.study.loop.variants import AS_IT_IS, LOOP_ALONE, NO_FRICTION, NO_LOOP, PERFECT
from gantrysim.study.series import series

if TYPE_CHECKING:
    from gantrysim.study.loop.study import LoopStudy

_PER_CENT = 100.0
_TURNED = 1.05  # of the least error, from which a rise is one
_HIDING = 0.5  # of the error, from which the program's part hides the others


def findings(study: LoopStudy, rows: list[Row]) -> list[str]:
    """Return what the rows say: the knees in one paragraph, one of each sweep, and what was left out."""
    sweeps = [_loop(study, rows), _interpreter(study, rows), _servo(rows), _encoder(rows)]
    told = [paragraph for paragraph in sweeps if paragraph]
    summary = _summary(study, rows) or "No sweep has enough cases that went through to say anything of."
    paragraphs = [summary, *told, *integrator_findings(rows)]
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


def _summary(study: LoopStudy, rows: list[Row]) -> str:
    """The knees of all sweeps, short."""
    said = []
    period, contour = series(rows, "value", "contour_rms_um", sweep="loop_period", variant=AS_IT_IS)
    if period.size > 1:
        best = int(contour.argmin())
        text = f"As the job is, a program loop of T = {_ms(period[best])} is best, with a contour error of "
        text += f"{_um(contour[best])} (rms)"
        if contour[0] > _TURNED * contour[best]:
            text += ": a faster one is worse"
            if _cut_by_wa(study, float(period[0])):
                text += f", because {_wa(study)}"
        said.append(text)
    if (alone := _loop_alone(rows)) is not None:
        said.append(alone)
    for variant, where in ((AS_IT_IS, "as the job is"), (NO_LOOP, "without the loop")):
        if (servo := _servo_knee(rows, variant)) is not None:
            said.append(f"{where}, {servo}")
    if (encoder := _encoder_knee(rows)) is not None:
        said.append(encoder)
    return " ".join(f"{_sentence(clause)}." for clause in said)


def _loop_alone(rows: list[Row]) -> str | None:
    """Up to which period the loop by itself does not matter, as a clause."""
    found = loop_knee(rows)
    if found is None:
        return None
    period = series(rows, "value", sweep="loop_period", variant=LOOP_ALONE)[0]
    alone = "by itself, without the limits of ACCEL, WA and CONNECT, the loop"
    if found[0] is None:
        return f"{alone} matters at every period down to T = {_ms(period[0])}"
    if found[0] == math.inf:
        return f"{alone} does not matter up to T = {_ms(period[-1])}"
    return f"{alone} would no longer matter below T = {_ms(found[0])}"


def _loop(study: LoopStudy, rows: list[Row]) -> str | None:
    """The job as it is first, then what the loop alone would allow."""
    said = [_as_it_is(study, rows)]
    found, clause = loop_knee(rows), _loop_alone(rows)
    if found is not None and clause is not None:
        contour = series(rows, "value", "contour_rms_um", sweep="loop_period", variant=LOOP_ALONE)[1]
        left = f"the {_um(found[1])} that servo and machine leave without any loop"
        text = f"{_sentence(clause)}: "
        if found[0] is None:
            text += f"the contour error is {_um(contour[0])} there, more than {_PER_CENT * EXCESS:.0f} % above {left}."
        else:
            text += f"the contour error is then within {_PER_CENT * EXCESS:.0f} % of {left}."
        said.append(text)
        exact_period, generation = series(rows, "value", "generation_rms_um", sweep="loop_period", variant=PERFECT)
        if exact_period.size > 1:
            said.append(
                f"The loop's own part grows as T^{power(exact_period, generation):.2f}, "
                f"{_um(generation[0] / exact_period[0] * 1e-3)} for each millisecond."
            )
    return " ".join(sentence for sentence in said if sentence) or None


def _as_it_is(study: LoopStudy, rows: list[Row]) -> str | None:
    """What the controller's other limits make of the loop: as a rule a shorter one is no better."""
    period, contour = series(rows, "value", "contour_rms_um", sweep="loop_period", variant=AS_IT_IS)
    alone = series(rows, "value", "contour_rms_um", sweep="loop_period", variant=LOOP_ALONE)
    if period.size < 2:
        return None
    best = int(contour.argmin())
    text = f"As the job is, the contour error (rms) is least at T = {_ms(period[best])}, with {_um(contour[best])}"
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
    if uncut := _cut_by_wa(study, float(period[0])):
        text += f", because {_wa(study)} ({_um(uncut)} if it did not)"
    refused = [row["value"] for row in rows if _refused(row) and row["variant"] == AS_IT_IS]
    shorter = [value for value in refused if isinstance(value, float) and value < period[0]]
    if shorter:
        text += f", and at {_ms(max(shorter))} and below the spiral does not come to its end at all"
    return f"{text}."


def _cut_by_wa(study: LoopStudy, period: float) -> float | None:
    """The generation error at a loop period if WA took away nothing [µm]; None where it takes away no more so."""
    shortest = {"program.loop_period": period}
    cut, uncut = study.arcs(shortest), study.arcs({**shortest, "program.wait_resolution": 0.0})
    if uncut is None or (cut is not None and uncut.generation.rms >= cut.generation.rms / _TURNED):
        return None
    return 1e3 * uncut.generation.rms


def _wa(study: LoopStudy) -> str:
    return f"WA cuts every wait to a multiple of {_ms(study.job.program['wait_resolution'])}"


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


def _servo_knee(rows: list[Row], variant: str) -> str | None:
    """Up to which period the servo does not matter in a variant, as a clause."""
    period, contour = series(rows, "value", "contour_rms_um", sweep="servo_period", variant=variant)
    if period.size < 2:
        return None
    at = knee(period, contour, float(contour.min()))
    if at is None or at < period[1]:
        return f"every shortening of the servo period down to {_ms(period[0])} pays"
    if at == math.inf:
        return f"the servo period makes no difference to the contour error up to {_ms(period[-1])}"
    return f"below a servo period of {_ms(at)} the servo no longer matters to the contour error"


def _servo(rows: list[Row]) -> str | None:
    """What hides the servo as the job is, and what of it is seen without the loop."""
    as_is, bare = _servo_knee(rows, AS_IT_IS), _servo_knee(rows, NO_LOOP)
    if as_is is None:
        return None
    period, contour, tracking, generation = series(
        rows, "value", "contour_rms_um", "tracking_rms_um", "generation_rms_um", sweep="servo_period", variant=AS_IT_IS
    )
    text = f"As the job is, {as_is}"
    if bare is not None:
        if period.size and generation.min() > _HIDING * contour.min():
            text += f": the program's own part, at least {_um(generation.min())}, hides it"
        overtakes = crossing(period, tracking, generation) if np.all(generation > 0) and np.all(tracking > 0) else None
        if overtakes:
            text += f", and the tracking error exceeds that only above {_ms(overtakes)}"
        text += f". Without the loop {bare}"
    shown = NO_LOOP if bare is not None else AS_IT_IS
    period, contour = series(rows, "value", "contour_rms_um", sweep="servo_period", variant=shown)
    errors = ", ".join(f"{_um(error)} at {_ms(value)}" for value, error in zip(period, contour, strict=True))
    law = f"as period^{power(period, contour):.1f}, for the gains follow from the period"
    text += f": the contour error is {errors} ({law})."
    steady = "steady_tracking_normal_rms_um"
    whole, smooth = (
        dict(zip(*(v.tolist() for v in series(rows, "value", steady, sweep="servo_period", variant=one)), strict=True))
        for one in (shown, NO_FRICTION)
    )
    if shared := [value for value in whole if value in smooth]:
        middle = shared[len(shared) // 2]
        text += (
            f" Of the tracking error normal to the path in the middle 90 % of the time, {_um(whole[middle])} at "
            f"{_ms(middle)}, {_um(smooth[middle])} would be left without friction, encoder counts and integral term."
        )
    return text


def _encoder_knee(rows: list[Row]) -> str | None:
    """Up to which resolution the encoder does not matter, as a clause."""
    for variant in (NO_LOOP, AS_IT_IS):
        count, contour = series(rows, "value", "contour_rms_um", sweep="encoder_resolution", variant=variant)
        if count.size > 1:
            break
    else:
        return None
    at = knee(count, contour, float(contour[0]))
    where = "even without the loop" if variant == NO_LOOP else "as the job is"
    if at is None:
        return f"finer encoder counts than {_um(1e3 * count[0])} still help"
    if at == math.inf:
        return f"encoder counts up to {_um(1e3 * count[-1])} make no difference to the contour error {where}"
    return f"below {_um(1e3 * at)} per count the encoder no longer matters to the contour error {where}"


def _encoder(rows: list[Row]) -> str | None:
    text = _encoder_knee(rows)
    if text is None:
        return None
    text = _sentence(text)
    count, ripple = series(rows, "value", "speed_ripple", sweep="encoder_resolution", variant=AS_IT_IS)
    if count.size > 1:
        text += (
            f", while the speed ripple goes from {_PER_CENT * ripple[0]:.2g} % at {_um(1e3 * count[0])} "
            f"to {_PER_CENT * ripple[-1]:.2g} % at {_um(1e3 * count[-1])}"
        )
    return f"{text}."


def _sentence(clause: str) -> str:
    return f"{clause[:1].upper()}{clause[1:]}"


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.3g} ms"


def _um(micrometres: Floats | float) -> str:
    value = float(micrometres)
    if value >= 100:
        return f"{value:.0f} µm"
    return f"{value:.3g} µm" if value >= 0.1 else f"{1e3 * value:.2g} nm"
