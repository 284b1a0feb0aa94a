"""The words of Trio BASIC: functions, parameters of axes and of the system, and what is not emulated."""

from __future__ import annotations

import math
from collections.abc import Callable

from gantrysim.base.errors import InputError
from gantrysim.controllers.trio.basic.axis import Axis
from gantrysim.controllers.trio.basic.process import Process, State

CONSTANTS = {"PI": math.pi, "TRUE": -1.0, "FALSE": 0.0, "ON": 1.0, "OFF": 0.0}

FUNCTIONS: dict[str, Callable[..., float]] = {
    "ABS": abs,
    "ACOS": math.acos,
    "ASIN": math.asin,
    "ATAN": math.atan,
    "ATAN2": math.atan2,
    "COS": math.cos,
    "EXP": math.exp,
    "FRAC": lambda x: x - math.trunc(x),
    "INT": lambda x: float(math.trunc(x)),
    "LN": math.log,
    "SGN": lambda x: float((x > 0) - (x < 0)),
    "SIN": math.sin,
    "SQR": math.sqrt,
    "TAN": math.tan,
}
ARGUMENTS = {"ATAN2": 2}  # of functions, else one


def _remain(c: State, axis: Axis) -> float:
    move = axis.member
    return 0.0 if move is None or not math.isfinite(move.shape.length) else move.shape.length - move.s


def _end_of_move(c: State, axis: Axis) -> float:
    move = axis.member
    if move is None or not move.profiled or not math.isfinite(move.shape.length):
        return axis.position - axis.zero
    k = move.axes.index(axis.number)
    return move.start[k] + move.shape.displacement(move.shape.length)[k] - axis.zero


def _speed(c: State, axis: Axis) -> float:
    return axis.step / c.motion.period


AXIS_VALUES: dict[str, Callable[[State, Axis], float]] = {
    "ACCEL": lambda c, axis: axis.acceleration,
    "ATYPE": lambda c, axis: axis.type or 0.0,
    "DECEL": lambda c, axis: axis.deceleration,
    "DEMAND_EDGES": lambda c, axis: (axis.position - axis.zero) * axis.units,
    "DPOS": lambda c, axis: axis.position - axis.zero,
    "ENDMOVE": _end_of_move,
    "FE": lambda c, axis: 0.0,
    "LINK_AXIS": lambda c, axis: -1.0 if axis.member is None or axis.member.driver is None else axis.member.driver,
    "MERGE": lambda c, axis: float(axis.merge),
    "MOVES_BUFFERED": lambda c, axis: float(len(axis.queue)),
    "MPOS": lambda c, axis: axis.position - axis.zero,
    "MSPEED": _speed,
    "MTYPE": lambda c, axis: float(axis.mtype),
    "NTYPE": lambda c, axis: float(axis.ntype),
    "REMAIN": _remain,
    "SERVO": lambda c, axis: float(axis.servo),
    "SPEED": lambda c, axis: axis.speed,
    "UNITS": lambda c, axis: axis.units,
    "VP_SPEED": lambda c, axis: axis.along.value,
}


def _set_speed(axis: Axis, value: float) -> None:
    if value < 0:
        raise InputError(f"SPEED = {value:g} of axis {axis.number}: must be at least 0")
    axis.speed = value


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


AXIS_SETTERS: dict[str, Callable[[Axis, float], None]] = {
    "ACCEL": _set_acceleration,
    "ATYPE": _set_type,
    "DECEL": _set_deceleration,
    "MERGE": _set_merge,
    "SERVO": _set_servo,
    "SPEED": _set_speed,
    "UNITS": _set_units,
}

# parameters that are accepted and noted, by what their values do not change here
NO_EFFECT = {
    "P_GAIN I_GAIN D_GAIN VFF_GAIN OV_GAIN": "the servo has gains of its own",
    "FE_LIMIT FE_RANGE FS_LIMIT RS_LIMIT ERRORMASK OUTLIMIT": "the servo and the machine have limits of their own",
    "AXIS_ENABLE BACKLASH CREEP DAC DAC_OUT DATUM_IN DRIVE_ENABLE FASTDEC FHOLD_IN FHSPEED FWD_IN JOGSPEED MICROSTEP "
    "REV_IN": "nothing here depends on it",
    "CORNER_MODE DECEL_ANGLE FULL_SP_RADIUS RAISE_ANGLE REP_DIST REP_OPTION SRAMP STOP_ANGLE": (
        "the motion stays that without it"
    ),
}
IGNORED = {name: reason for names, reason in NO_EFFECT.items() for name in names.split()}


def _ticks(p: Process) -> float:
    return p.ticks_zero - p.state.tick


SYSTEM_VALUES: dict[str, Callable[[Process], float]] = {
    "MOTION_ERROR": lambda p: 0.0,
    "PROCNUMBER": lambda p: float(p.number),
    "SERVO_PERIOD": lambda p: 1e6 * p.state.motion.period,
    "TICKS": _ticks,
    "WDOG": lambda p: float(p.state.motion.enabled),
}


def _set_ticks(p: Process, value: float) -> None:
    p.ticks_zero = p.state.tick + value


def _set_wdog(p: Process, value: float) -> None:
    p.state.motion.enabled = bool(value)


SYSTEM_SETTERS: dict[str, Callable[[Process, float], None]] = {"TICKS": _set_ticks, "WDOG": _set_wdog}


def _names(text: str) -> frozenset[str]:
    return frozenset(text.split())


NOT_EMULATED = _names(
    "ACC ADD_DAC AIN AOUT AUTORUN B_SPLINE CLOSE CONSTANT DATUM DEC DIM DISABLE_GROUP ENCODER_RATIO FILE FLAG FLAGS "
    "FORCE_SPEED GET GLOBAL INPUT INVERT_IN KEY LINPUT MHELICALSP MOVEABSSP MOVECIRCSP MOVEMODIFY MOVESP MOVETANG "
    "MSPHERICAL OFFPOS OPEN PSWITCH REGIST REG_POS SCOPE SETCOM STEP_RATIO STEPLINE TIMER TRIGGER"
)

KEYWORDS = _names(
    "AND AXIS CHR ELSE ELSEIF ENDIF FOR GOSUB GOTO HALT IDLE IF LOADED MOD NEXT NOT OR PRINT REM REPEAT RETURN RUN "
    "STEP STOP THEN TO UNTIL WAIT WEND WHILE XOR"
)
