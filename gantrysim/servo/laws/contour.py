"""Cross-coupled contour control: the error across the path counts more than the one along it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from gantrysim.base.arrays import Floats
from gantrysim.servo.gains import Parameter
from gantrysim.servo.laws.law import ERROR, Law, LawDesign

GAIN = 1.0


def tangents(velocity: Floats, linear: Floats, tangent: Floats, axes: int) -> None:
    """Set the unit tangent of the demanded path, v / |v|, in the linear axes; where it rests, keep the last one.

    Args:
        velocity: dDPOS/T, (axes,) or more [mm/s].
        linear: 1 for a linear axis, 0 for another.
        tangent: t, set.
        axes: number of axes.
    """
    square = 0.0
    for a in range(axes):
        square += linear[a] * velocity[a] ** 2
    if square > 0.0:
        for a in range(axes):
            tangent[a] = linear[a] * velocity[a] / math.sqrt(square)


def error_across(error: Floats, tangent: Floats, linear: Floats, axis: int, axes: int) -> float:
    """Return an axis' part of the following error across the path [mm].

        E_n = E - t (t . E)

    of the linear axes. With contour_gain g the law takes E + g E_n for E (Koren, Journal of Dynamic Systems,
    Measurement, and Control 102, 1980).

    Args:
        error: E, (axes,) or more [mm].
        tangent: t.
        linear: 1 for a linear axis, 0 for another.
        axis: whose part.
        axes: number of axes.
    """
    along = size = 0.0
    for a in range(axes):
        along += linear[a] * tangent[a] * error[a]
        size += tangent[a] ** 2
    return error[axis] - tangent[axis] * along if size > 0.0 else 0.0


def tick(row: Any, laws: Any) -> None:
    """Add the error across the path, times the gain, to the error of every linear axis, and its change likewise."""
    tangents(row.demand_velocity, row.linear, laws.contour_tangent, row.axes)
    for axis in range(row.axes):
        law = laws[axis]
        if law.contour_gain > 0.0 and row.linear[axis] > 0.0:
            across = law.contour_gain * error_across(row.error, laws.contour_tangent, row.linear, axis, row.axes)
            row.law_change[axis] += (across - law.contour_across) / row.period
            row.law_error[axis] += across
            law.contour_across = across


class CrossCoupling(Law):
    """The law as one of the ladder.

    Its linear model is that of a path across the axis, where it multiplies the error most. Along the path it does not
    act.
    """

    name = "contour"
    meaning = "cross-coupling: the error across the path is multiplied"
    parameters = (
        Parameter(
            "contour_gain",
            "",
            "weight with which the law contour adds the error across the path to the following error",
        ),
    )
    state = (
        ("contour_across", float),  # error across the path at the last tick, times the gain [mm]
        ("contour_tangent", float),  # of the path while it last moved
    )
    stages = ((ERROR, tick),)
    answers_to_position = True
    needs_known_base = True
    same_nozzle_axes = True

    def derived(self, design: LawDesign) -> dict[str, float]:
        return {"contour_gain": GAIN}

    def error_gain(self, values: Mapping[str, float]) -> float:
        return 1.0 + values["contour_gain"]


CONTOUR = CrossCoupling()
