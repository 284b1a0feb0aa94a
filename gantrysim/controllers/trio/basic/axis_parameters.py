"""The parameters of an axis in Trio BASIC: how each is read and set."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from gantrysim.base.errors import InputError
from gantrysim.controllers.trio.basic.buffers import Axis
from gantrysim.controllers.trio.basic.moves import SHARP_CORNERS, SMALL_CIRCLES
from gantrysim.controllers.trio.basic.process import State

TRUE = -1.0
CANCELLING = 2048.0  # bit 11 of AXISSTATUS


@dataclass(frozen=True)
class AxisParameter:
    """A parameter of an axis.

    Attributes:
        read: its value, given what the controller shares and the axis.
        write: sets it on an axis; None where it can only be read.
    """

    read: Callable[[State, Axis], float]
    write: Callable[[Axis, float], None] | None = None


def _remaining(state: State, axis: Axis) -> float:
    move = axis.member
    if move is None or not math.isfinite(move.shape.length):
        return 0.0
    return move.shape.length - move.s


def _end_of_move(state: State, axis: Axis) -> float:
    move = axis.member
    if move is None or not move.has_profile or not math.isfinite(move.shape.length):
        return axis.position - axis.zero
    k = move.axes.index(axis.number)
    return move.start[k] + move.shape.displacement(move.shape.length)[k] - axis.zero


def _driver(state: State, axis: Axis) -> float:
    return -1.0 if axis.member is None or axis.member.driver is None else axis.member.driver


def _position(state: State, axis: Axis) -> float:
    return axis.position - axis.zero


def _set_speed(axis: Axis, value: float) -> None:
    axis.speed = _not_negative("SPEED", axis, value)


def _positive(name: str, axis: Axis, value: float) -> float:
    if not value > 0:
        raise InputError(f"{name} = {value:g} of axis {axis.number}: must be greater than 0")
    return value


def _set_units(axis: Axis, value: float) -> None:
    if axis.moved and value != axis.units:
        raise InputError(f"UNITS of axis {axis.number}: must be set before it moves")
    axis.units = _positive("UNITS", axis, value)


def _set_type(axis: Axis, value: float) -> None:
    axis.type = value


def _set_servo(axis: Axis, value: float) -> None:
    axis.servo = bool(value)


def _set_merge(axis: Axis, value: float) -> None:
    axis.merge = bool(value)


def _set_acceleration(axis: Axis, value: float) -> None:
    axis.acceleration = _positive("ACCEL", axis, value)


def _set_deceleration(axis: Axis, value: float) -> None:
    axis.deceleration = _positive("DECEL", axis, value)


def _set_corner_mode(axis: Axis, value: float) -> None:
    mode = int(value)
    if mode != value or mode & ~(SHARP_CORNERS | SMALL_CIRCLES):
        raise InputError(
            f"CORNER_MODE = {value:g} of axis {axis.number}: must be a sum of 2 (DECEL_ANGLE and STOP_ANGLE) and 8 "
            "(FULL_SP_RADIUS); other bits are not emulated"
        )
    axis.corners = replace(axis.corners, mode=mode)


def _set_decel_angle(axis: Axis, value: float) -> None:
    axis.corners = replace(axis.corners, decel_angle=_not_negative("DECEL_ANGLE", axis, value))


def _set_stop_angle(axis: Axis, value: float) -> None:
    axis.corners = replace(axis.corners, stop_angle=_not_negative("STOP_ANGLE", axis, value))


def _set_full_radius(axis: Axis, value: float) -> None:
    axis.corners = replace(axis.corners, full_radius=_not_negative("FULL_SP_RADIUS", axis, value))


def _set_force_speed(axis: Axis, value: float) -> None:
    axis.speeds = replace(axis.speeds, force=_not_negative("FORCE_SPEED", axis, value))


def _set_start_speed(axis: Axis, value: float) -> None:
    axis.speeds = replace(axis.speeds, start=_not_negative("STARTMOVE_SPEED", axis, value))


def _set_end_speed(axis: Axis, value: float) -> None:
    axis.speeds = replace(axis.speeds, end=_not_negative("ENDMOVE_SPEED", axis, value))


def _not_negative(name: str, axis: Axis, value: float) -> float:
    if value < 0:
        raise InputError(f"{name} = {value:g} of axis {axis.number}: must be at least 0")
    return value


def _offset(axis: Axis, value: float) -> None:
    """OFFPOS: add to DPOS and MPOS without motion; it reads 0 once that is done, which is at once."""
    axis.zero -= value


def _force_speed(state: State, axis: Axis) -> float:
    return axis.speed if axis.speeds.force is None else axis.speeds.force


def _unless_unset(value: float, axis: Axis) -> float:
    """STARTMOVE_SPEED or ENDMOVE_SPEED: without a limit they read as SPEED."""
    return value if math.isfinite(value) else axis.speed


def _status(state: State, axis: Axis) -> float:
    return CANCELLING if axis.member is not None and axis.member.stopping else 0.0


AXIS_PARAMETERS = {
    "ACCEL": AxisParameter(lambda state, axis: axis.acceleration, _set_acceleration),
    "ATYPE": AxisParameter(lambda state, axis: axis.type or 0.0, _set_type),
    "AXISSTATUS": AxisParameter(_status),
    "CORNER_MODE": AxisParameter(lambda state, axis: float(axis.corners.mode), _set_corner_mode),
    "DECEL": AxisParameter(lambda state, axis: axis.deceleration, _set_deceleration),
    "DECEL_ANGLE": AxisParameter(lambda state, axis: axis.corners.decel_angle, _set_decel_angle),
    "DEMAND_EDGES": AxisParameter(lambda state, axis: (axis.position - axis.zero) * axis.units),
    "DPOS": AxisParameter(_position),
    "ENDMOVE": AxisParameter(_end_of_move),
    "ENDMOVE_SPEED": AxisParameter(lambda state, axis: _unless_unset(axis.speeds.end, axis), _set_end_speed),
    "FE": AxisParameter(lambda state, axis: 0.0),  # the servo is beyond the controller's programs
    "FORCE_SPEED": AxisParameter(_force_speed, _set_force_speed),
    "FULL_SP_RADIUS": AxisParameter(lambda state, axis: axis.corners.full_radius, _set_full_radius),
    "IDLE": AxisParameter(lambda state, axis: TRUE if axis.idle else 0.0),
    "LINK_AXIS": AxisParameter(_driver),
    "LOADED": AxisParameter(lambda state, axis: 0.0 if axis.queue else TRUE),
    "MERGE": AxisParameter(lambda state, axis: float(axis.merge), _set_merge),
    "MOVES_BUFFERED": AxisParameter(lambda state, axis: float(len(axis.queue))),
    "MPOS": AxisParameter(_position),
    "MSPEED": AxisParameter(lambda state, axis: axis.step / state.motion.period),
    "MTYPE": AxisParameter(lambda state, axis: float(axis.mtype)),
    "NTYPE": AxisParameter(lambda state, axis: float(axis.ntype)),
    "OFFPOS": AxisParameter(lambda state, axis: 0.0, _offset),
    "REMAIN": AxisParameter(_remaining),
    "SERVO": AxisParameter(lambda state, axis: float(axis.servo), _set_servo),
    "SPEED": AxisParameter(lambda state, axis: axis.speed, _set_speed),
    "STARTMOVE_SPEED": AxisParameter(lambda state, axis: _unless_unset(axis.speeds.start, axis), _set_start_speed),
    "STOP_ANGLE": AxisParameter(lambda state, axis: axis.corners.stop_angle, _set_stop_angle),
    "UNITS": AxisParameter(lambda state, axis: axis.units, _set_units),
    "VP_SPEED": AxisParameter(lambda state, axis: axis.along.value),
}
