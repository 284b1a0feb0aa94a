"""What the repeats of a job have in common and what not, in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gantrysim.metrics.analysis import THOUSANDTH
from gantrysim.study.cases import OK, Row
from gantrysim.study.repeat.repeats import ALL, has_phase

if TYPE_CHECKING:
    from gantrysim.study.repeat.study import RepeatStudy

_UM = 1e3


def findings(study: RepeatStudy, rows: list[Row]) -> list[str]:
    """Return accuracy and repeatability, what the scatter comes from, what was varied and what was followed."""
    paths = study.paths(rows)
    if ALL not in paths:
        return [f"Fewer than two of {study.repeats} repeats have figures: {rows[0]['status']}"]
    path = paths[ALL]
    accuracy, repeatability = _UM * path.path_accuracy, _UM * path.path_repeatability
    text = (
        f"Over {len(path.attained)} repeats of {study.job.name} the path accuracy is ATp = {accuracy:.2f} µm, at "
        f"s = {path.s[path.accuracy.argmax()]:.1f} mm, and the path repeatability RTp = {repeatability:.2f} µm, at "
        f"s = {path.s[path.repeatability.argmax()]:.1f} mm; at half of the places they are at most "
        f"{_UM * np.median(path.accuracy):.2f} and {_UM * np.median(path.repeatability):.2f} µm."
    )
    if repeatability > 0:
        text += (
            f" What the repeats have in common, at its largest, is {accuracy / repeatability:.3g} times the "
            "largest scatter: it is the part that a correction of the program could take away."
        )
    paragraphs = [text]
    alone = {varied: _UM * one.path_repeatability for varied, one in paths.items() if varied != ALL}
    if alone:
        order = sorted(alone, key=lambda varied: -alone[varied])
        several = ", ".join(f"{varied} {alone[varied]:.2f} µm" for varied in order)
        paragraphs.append(f"Varied alone, RTp comes to: {several}.")
    return [*paragraphs, _varied(study), _followed(study, rows)]


def _varied(study: RepeatStudy) -> str:
    parts = []
    if "friction" in study.sources:
        parts.append(f"friction and viscous friction of each axis by {100 * study.friction:g} % (standard deviation)")
    if "home offset" in study.sources:
        told = ", ".join(
            f"{axis.name} {1e3 * count:g} {THOUSANDTH[axis.unit]}"
            for axis, count in zip(study.job.built_machine.axes, study.counts, strict=True)
            if count
        )
        parts.append(f"the axes' zeros evenly within one encoder count ({told})")
    if "phase" in study.sources:
        parts.append(f"the program's start in eighths of the servo period of {study.job.built_servo.period:g} s")
    said = "; ".join(parts) or "nothing"
    bound = "" if has_phase(study.job) else " The program starts on a servo tick, so there is no phase to vary."
    return f"Varied from repeat to repeat: {said}, with the seed {study.seed}.{bound}"


def _followed(study: RepeatStudy, rows: list[Row]) -> str:
    lost = sum(row["status"] != OK for row in rows)
    left = f" {lost} runs did not finish and are left out." if lost else ""
    return (
        f"ATp and RTp are formed after public descriptions of ISO 9283:1998 at {study.s.size} places along "
        "the path where glue is laid, in planes square to it; load, speed and path are the job's, not the "
        f"standard's (see gantrysim.metrics).{left}"
    )
