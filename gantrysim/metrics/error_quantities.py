"""The errors and the motion of a run as people see them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from gantrysim.base.quantity import AXIS, MAX, P95, RANGE, RMS, SIZES, Item, Quantity
from gantrysim.metrics.analysis import THOUSANDTH
from gantrysim.metrics.budget import DESCRIPTIONS, GEOMETRY, LINKS, Budget
from gantrysim.metrics.parts import CORNER, ERROR

_VALUES = ("analysis", "values")

CONTOUR: Quantity[Budget] = replace(
    ERROR,
    name="contour",
    label="contour error",
    meaning="Distance of the nozzle from the nearest point of the requested path",
    path=("values", "contour"),
)
PROGRAM, SERVO, ENCODER, GEOMETRY_ERROR, STRUCTURE = (
    replace(
        CONTOUR,
        name=link,
        label=f"{link} error",
        meaning=f"Part of the contour error between two points of the chain, {DESCRIPTIONS[link]}"
        + (" on a machine with errors of its geometry" if link == GEOMETRY else ""),
        path=("values", "parts", Item(link)),
    )
    for link in (*LINKS[:-1], GEOMETRY, LINKS[-1])
)
CORNER_ERROR = replace(
    CONTOUR,
    name=CORNER,
    label=f"{CORNER} error",
    meaning="Part of the contour error from a change of leg of the path, which belongs to no link",
    path=("values", "corner"),
)
LAG: Quantity[Budget] = replace(
    CONTOUR,
    name="lag",
    label="lag along the path",
    meaning="Distance of the nozzle behind the commanded position along the requested path",
    path=("values", "lag"),
    statistics=(RMS, P95, MAX),
)
_FOLLOWING: Quantity[Any] = replace(
    CONTOUR,
    name="following",
    label="following error",
    meaning="Commanded less encoder position of an axis",
    path=(),
    statistics=SIZES,
)
FOLLOWING: Quantity[Budget] = _FOLLOWING.by_axis((*_VALUES, "following", Item(AXIS)))
FOLLOWING_ALONG: Quantity[Budget] = replace(
    CONTOUR,
    name="following_along",
    label="following error along the path",
    meaning="Commanded less encoder position at the nozzle, along the tangent of the requested path",
    path=(*_VALUES, "following_along"),
    statistics=SIZES,
)
STEADY_ALONG: Quantity[Budget] = replace(
    CONTOUR,
    name="steady_following_along",
    label="steady following error along the path",
    meaning="Commanded less encoder position at the nozzle, along the path, in the middle 90 % of the dispensing time",
    path=("analysis", "steady_following", "along"),
    statistics=(RMS,),
)
STEADY_NORMAL: Quantity[Budget] = replace(
    CONTOUR,
    name="steady_following_normal",
    label="steady following error normal to the path",
    meaning="Commanded less encoder position at the nozzle, normal to the path, in the same time",
    path=("analysis", "steady_following", "normal"),
    statistics=(RMS,),
)

ERRORS: tuple[Quantity[Budget], ...] = (
    CONTOUR,
    PROGRAM,
    SERVO,
    ENCODER,
    GEOMETRY_ERROR,
    STRUCTURE,
    CORNER_ERROR,
    LAG,
    FOLLOWING,
    FOLLOWING_ALONG,
    STEADY_ALONG,
    STEADY_NORMAL,
)

REQUESTED_SPACING = Quantity[Budget](
    "requested_spacing",
    label="requested turn spacing",
    unit="mm",
    form=".6g",
    meaning="Distance of neighbouring turns of the requested path",
    path=("analysis", "run", "requested", "turn_spacing"),
)
SPACING = Quantity[Budget](
    "spacing",
    label="turn spacing",
    unit="mm",
    form=".2f",
    meaning="Distance of neighbouring turns of the nozzle's trace, along the trace's normal",
    path=(*_VALUES, "spacing"),
    statistics=RANGE,
)
SPEED = Quantity[Budget](
    "speed",
    label="path speed",
    unit="mm/s",
    form=".1f",
    meaning="Speed of the nozzle over the work while the dispenser is on",
    path=(*_VALUES, "speed"),
    statistics=RANGE,
)
SPEED_RIPPLE = Quantity[Budget](
    "speed_ripple",
    label="speed ripple",
    unit="",
    form=".3f",
    meaning="Standard deviation of the path speed over its mean, in the middle 90 % of the dispensing time",
    path=("analysis", "speed_ripple"),
)
TORQUE_RIPPLE = Quantity[Any](
    "torque_ripple",
    label="torque ripple",
    unit="N·m",
    form=".2g",
    meaning="Noise of the torque demand while the dispenser is on: rms change from tick to tick over the square root "
    "of 2",
    path=("torque_ripple",),
)
PATH_LENGTH = Quantity[Budget](
    "path_length",
    label="path length",
    unit="mm",
    form=".1f",
    meaning="Length of the commanded path while the dispenser is on",
    path=(*_VALUES, "path_length"),
)
DURATION = Quantity[Budget](
    "duration",
    label="duration",
    unit="s",
    form=".2f",
    meaning="Time from the start of the run to the end of the commanded motion",
    path=(*_VALUES, "duration"),
)
END_POINT = tuple(
    Quantity[Budget](
        f"end_{coordinate}",
        label=f"end point {coordinate}",
        unit="mm",
        form=".3f",
        meaning=f"Coordinate {coordinate} of the nozzle in the work frame at the end of the run",
        path=(*_VALUES, "end_point", Item(k)),
    )
    for k, coordinate in enumerate("xyz")
)

MOTION: tuple[Quantity[Budget], ...] = (
    REQUESTED_SPACING,
    SPACING,
    SPEED,
    SPEED_RIPPLE,
    PATH_LENGTH,
    DURATION,
    *END_POINT,
)


def of_axes(
    quantities: Iterable[Quantity[Any]], axes: Iterable[str], units: Iterable[str]
) -> tuple[Quantity[Any], ...]:
    """Return quantities with each template of `Quantity.by_axis` replaced by the quantities of the axes.

    Args:
        quantities: in their order.
        axes: names of the axes.
        units: of the axes, "mm" or "deg": an error of a rotary axis is shown in mdeg.
    """
    names = list(zip(axes, units, strict=True))
    expanded: list[Quantity[Any]] = []
    for quantity in quantities:
        if AXIS in quantity.name:
            lengths = quantity.unit == THOUSANDTH["mm"]
            expanded += [quantity.of_axis(axis, THOUSANDTH[unit] if lengths else None) for axis, unit in names]
        else:
            expanded.append(quantity)
    return tuple(expanded)
