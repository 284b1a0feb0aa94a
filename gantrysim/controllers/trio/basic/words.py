"""The words of Trio BASIC: functions, parameters of axes and of the system, and what is not emulated."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from gantrysim.base.errors import InputError
from gantrysim.controllers.basic import values as basic
from gantrysim.controllers.basic.values import Function
from gantrysim.controllers.trio.basic.axis import Axis
from gantrysim.controllers.trio.basic.process import MOST_OUTPUTS, TABLE_SIZE, VR_SIZE, Process, State, index

CONSTANTS = {"PI": math.pi, "TRUE": -1.0, "FALSE": 0.0, "ON": 1.0, "OFF": 0.0}

FUNCTIONS: dict[str, Function] = {
    **basic.FUNCTIONS,
    "ATAN": Function(math.atan),
    "FRAC": Function(lambda x: x - math.trunc(x)),
    "INT": Function(lambda x: float(math.trunc(x))),
    "LN": Function(math.log),
    "SQR": Function(math.sqrt),
}


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
    if move is None or not move.profiled or not math.isfinite(move.shape.length):
        return axis.position - axis.zero
    k = move.axes.index(axis.number)
    return move.start[k] + move.shape.displacement(move.shape.length)[k] - axis.zero


def _driver(state: State, axis: Axis) -> float:
    return -1.0 if axis.member is None or axis.member.driver is None else axis.member.driver


def _position(state: State, axis: Axis) -> float:
    return axis.position - axis.zero


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


AXIS_PARAMETERS = {
    "ACCEL": AxisParameter(lambda state, axis: axis.acceleration, _set_acceleration),
    "ATYPE": AxisParameter(lambda state, axis: axis.type or 0.0, _set_type),
    "DECEL": AxisParameter(lambda state, axis: axis.deceleration, _set_deceleration),
    "DEMAND_EDGES": AxisParameter(lambda state, axis: (axis.position - axis.zero) * axis.units),
    "DPOS": AxisParameter(_position),
    "ENDMOVE": AxisParameter(_end_of_move),
    "FE": AxisParameter(lambda state, axis: 0.0),  # the servo is beyond the controller's programs
    "LINK_AXIS": AxisParameter(_driver),
    "MERGE": AxisParameter(lambda state, axis: float(axis.merge), _set_merge),
    "MOVES_BUFFERED": AxisParameter(lambda state, axis: float(len(axis.queue))),
    "MPOS": AxisParameter(_position),
    "MSPEED": AxisParameter(lambda state, axis: axis.step / state.motion.period),
    "MTYPE": AxisParameter(lambda state, axis: float(axis.mtype)),
    "NTYPE": AxisParameter(lambda state, axis: float(axis.ntype)),
    "REMAIN": AxisParameter(_remaining),
    "SERVO": AxisParameter(lambda state, axis: float(axis.servo), _set_servo),
    "SPEED": AxisParameter(lambda state, axis: axis.speed, _set_speed),
    "UNITS": AxisParameter(lambda state, axis: axis.units, _set_units),
    "VP_SPEED": AxisParameter(lambda state, axis: axis.along.value),
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


@dataclass(frozen=True)
class SystemParameter:
    """A parameter of the controller, or of a process.

    Attributes:
        read: its value, given the process.
        write: sets it; None where it can only be read.
    """

    read: Callable[[Process], float]
    write: Callable[[Process, float], None] | None = None


def _set_ticks(process: Process, value: float) -> None:
    process.ticks_zero = process.state.tick + value


def _set_wdog(process: Process, value: float) -> None:
    process.state.motion.enabled = bool(value)


SYSTEM_PARAMETERS = {
    "MOTION_ERROR": SystemParameter(lambda process: 0.0),
    "PROCNUMBER": SystemParameter(lambda process: float(process.number)),
    "SERVO_PERIOD": SystemParameter(lambda process: 1e6 * process.state.motion.period),
    "TICKS": SystemParameter(lambda process: process.ticks_zero - process.state.tick, _set_ticks),
    "WDOG": SystemParameter(lambda process: float(process.state.motion.enabled), _set_wdog),
}

# memory, inputs and outputs, by their index
MEMORY: dict[str, Callable[[Process, float], float]] = {
    "IN": lambda process, k: float(index("IN", k, MOST_OUTPUTS) in process.state.inputs),
    "OP": lambda process, k: float(index("OP", k, MOST_OUTPUTS) in process.state.outputs),
    "READ_OP": lambda process, k: float(index("READ_OP", k, MOST_OUTPUTS) in process.state.outputs),
    "TABLE": lambda process, k: process.state.table.get(index("TABLE", k, TABLE_SIZE), 0.0),
    "VR": lambda process, k: process.state.vr.get(index("VR", k, VR_SIZE), 0.0),
}


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
