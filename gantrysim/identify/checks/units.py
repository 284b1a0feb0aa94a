"""Names the confusion of units that makes an inertia, a torque or a travel that is no machine's of this table."""

from __future__ import annotations

import math

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.identify.checks.finding import NotIdentifiedError
from gantrysim.identify.checks.relation import EXPLAINED, relation_of
from gantrysim.identify.model import AxisModel
from gantrysim.machine.axis import Axis

UNUSABLE = 5.0  # ratio of the inertia to that of the table, or its inverse, from which the log is refused
TRAVEL = 2.0  # largest travel of the log, of the axis': its table may leave out the ends
_NEAR = 1.5  # ratio of two factors that may be the same: machines differ from their tables by as much
_RATED = (2.0, 5.0)  # peak torque of servo drives over the rated one


def torque_slips(axis: Axis, factor: float) -> list[str]:
    """Return the units of a torque that is this many times too large when read as N·m."""
    slips = {
        "mN·m": (1e3, 1e3),
        "N·cm": (1e2, 1e2),
        "ozf·in": (141.6, 141.6),
        "lbf·in": (8.851, 8.851),
        "kgf·m": (1 / 9.81, 1 / 9.81),
        "kN·m": (1e-3, 1e-3),
    }
    if math.isfinite(axis.motor_constant) and axis.motor_constant > 0:
        slips[f"A ({axis.motor_constant:g} N·m/A)"] = (1 / axis.motor_constant,) * 2
    if math.isfinite(axis.peak_torque) and axis.peak_torque > 0:
        low = _RATED[0] / axis.peak_torque
        high = _RATED[1] / axis.peak_torque
        slips["% of the rated torque"] = (1e2 * low, 1e2 * high)
        slips["per mille of the rated torque"] = (1e3 * low, 1e3 * high)
    return _matching(slips, factor)


def position_slips(axis: Axis, factor: float) -> list[str]:
    """Return the units of a position that is this many times too large when read as mm or deg."""
    if axis.unit == "mm":
        units = {"m": 1e-3, "µm": 1e3, "inches": 1 / 25.4}
    else:
        units = {"rad": math.pi / 180, "turns": 1 / 360, "mdeg": 1e3}
    units["rad of the motor"] = 1 / axis.scale
    units["turns of the motor"] = 1 / (2 * math.pi * axis.scale)
    units["degrees of the motor"] = math.degrees(1 / axis.scale)
    if axis.resolution > 0:
        units["counts"] = 1 / axis.resolution
    return _matching({name: (size, size) for name, size in units.items() if abs(math.log(size)) > 0.1}, factor)


def _matching(slips: dict[str, tuple[float, float]], factor: float) -> list[str]:
    """Return the names of the ranges that hold a factor, nearest first."""
    distances = {}
    for name, (low, high) in slips.items():
        outside = max(math.log(low / factor), math.log(factor / high), 0.0)
        if outside < math.log(_NEAR):
            distances[name] = outside
    return sorted(distances, key=lambda name: distances[name])


def check_travel(axis: Axis, position: Floats, ratio: float) -> None:
    """Refuse a position that goes further than the axis can.

    Args:
        axis: of the machine.
        position: (n,) [u].
        ratio: of the log's inertia to that of the table; nan where it is not known.

    Raises:
        NotIdentifiedError: with the travel, the bound and the unit that the inertia suggests.
    """
    distance = float(np.ptp(position))
    low, high = axis.travel
    longest = TRAVEL * (high - low)
    if not (math.isfinite(longest) and distance > longest > 0):
        return
    slips = position_slips(axis, 1 / ratio) if ratio > 0 else []
    hint = f"position in {' or '.join(slips)} read as {axis.unit}?" if slips else "check its unit"
    raise NotIdentifiedError(
        f"axis {axis.name}: its position goes over {distance:.4g} {axis.unit}, the axis over {high - low:.4g} "
        f"{axis.unit}: must be at most {TRAVEL:g} times as far; {hint}"
    )


def inertia_ratio(table: AxisModel, position: Floats, torque: Floats, period: float) -> float:
    """Return the log's inertia over that of the table; nan where the motion does not explain the torque."""
    relation = relation_of(position, torque, period)
    if relation is None or relation.explained < EXPLAINED:
        return math.nan
    return relation.inertia / table.inertia


def inertia_hint(axis: Axis, ratio: float) -> str:
    """Return the confusions that make an inertia this many times that of the table, as a question or an advice."""
    slips = [f"torque in {name} read as N·m" for name in torque_slips(axis, ratio)]
    slips += [f"position in {name} read as {axis.unit}" for name in position_slips(axis, 1 / ratio)]
    return f"{', or '.join(slips)}?" if slips else "check units, lead and gear ratio"


def check_inertia(axis: Axis, ratio: float) -> None:
    """Refuse an inertia of the log that is no machine's of this table.

    Args:
        axis: of the machine.
        ratio: of the inertia by the regression to that of the table, as `inertia_ratio` has it.

    Raises:
        NotIdentifiedError: the ratio or its inverse exceeds `UNUSABLE`.
    """
    if not ratio > 0 or 1 / UNUSABLE <= ratio <= UNUSABLE:
        return
    raise NotIdentifiedError(
        f"axis {axis.name}: the log gives {ratio:.3g} times the inertia of the machine's table, must be "
        f"{1 / UNUSABLE:g} to {UNUSABLE:g} times; {inertia_hint(axis, ratio)}"
    )
