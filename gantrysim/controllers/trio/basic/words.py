"""The words of Trio BASIC: functions, parameters of axes and of the system, and what is not emulated."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass

from gantrysim.base.errors import InputError
from gantrysim.controllers.basic import operators
from gantrysim.controllers.basic.operators import Function
from gantrysim.controllers.trio.basic.process import MOST_ANALOGUE, MOST_OUTPUTS, TABLE_SIZE, VR_SIZE, Process, index

CONSTANTS = {"PI": math.pi, "TRUE": -1.0, "FALSE": 0.0, "ON": 1.0, "OFF": 0.0}

FUNCTIONS: dict[str, Function] = {
    **operators.FUNCTIONS,
    "ATAN": Function(math.atan),
    "FRAC": Function(lambda x: x - math.trunc(x)),
    "INT": Function(lambda x: float(math.trunc(x))),
    "LN": Function(math.log),
    "SQR": Function(math.sqrt),
}


# parameters and commands that are accepted and noted, by what their values do not change here
NO_EFFECT = {
    "P_GAIN I_GAIN D_GAIN VFF_GAIN OV_GAIN DAC_SCALE D_ZONE_MAX D_ZONE_MIN": "the servo has gains of its own",
    "AXIS_FS_LIMIT AXIS_RS_LIMIT FE_LATCH FE_LIMIT FE_LIMIT_MODE FE_RANGE FS_LIMIT RS_LIMIT ERRORMASK OUTLIMIT": (
        "the servo and the machine have limits of their own"
    ),
    "ADDRESS AXIS_ADDRESS AXIS_ENABLE AXIS_MODE BACKLASH BACKLASH_DIST CLOSE_WIN CLUTCH_RATE CREEP DAC DAC_OUT "
    "DATUM_IN DRIVE_ENABLE FASTDEC FAST_JOG FHOLD_IN FHSPEED FWD_IN FWD_JOG INVERT_STEP JOGSPEED MICROSTEP "
    "OPEN_WIN REGIST_DELAY REG_INPUTS REV_IN REV_JOG": "nothing here depends on it",
    "RAISE_ANGLE REP_DIST REP_OPTION SRAMP": "the motion stays that without it",
}
# commands of the same kind, by the least and the largest number of their values
IGNORED_COMMANDS = {
    "ENCODER_RATIO": (2, 2),
    "ETHERCAT": (1, 16),
    "ETHERNET": (1, 16),
    "SCOPE": (1, 12),
    "SETCOM": (1, 8),
    "STEP_RATIO": (2, 2),
    "TRIGGER": (0, 0),
    "TROFF": (0, 0),
    "TRON": (0, 0),
    "UNIT_CLEAR": (0, 0),
}
IGNORED_WORDS = {name: reason for names, reason in NO_EFFECT.items() for name in names.split()}
# with the reason of the note
NOTED = {**IGNORED_WORDS, **dict.fromkeys(IGNORED_COMMANDS, "nothing here depends on it")}


@dataclass(frozen=True)
class SystemParameter:
    """A parameter of the controller, or of a process.

    Attributes:
        read: its value, given the process.
        write: sets it; None where it can only be read.
    """

    read: Callable[[Process], float]
    write: Callable[[Process, float], None] | None = None


MOST_BUFFERED = 64  # moves of an axis
OF_PROCESS = ("ERROR_LINE", "PROC_STATUS", "RUN_ERROR", "TICKS")  # which PROC() may follow


def _set_ticks(process: Process, value: float) -> None:
    process.ticks_zero = process.state.tick + value


def _set_wdog(process: Process, value: float) -> None:
    process.state.motion.enabled = bool(value)


def _set_buffers(process: Process, value: float) -> None:
    if not 1 <= value <= MOST_BUFFERED or value != int(value):
        raise InputError(f"LIMIT_BUFFERED = {value:g}: must be a whole number from 1 to {MOST_BUFFERED}")
    process.state.motion.buffers = int(value)


SIMULATOR = 400.0  # CONTROL of Trio's own simulator of a controller, by which programs skip what a simulator lacks


def _last_axis(process: Process) -> float:
    return float(max(process.state.motion.axes, default=0))


def _status(process: Process) -> float:
    return 0.0 if process.ended else 1.0


def _analogue(number: int) -> SystemParameter:
    """Return AOUT0 and so on: AOUT(0) by another name."""
    return SystemParameter(
        lambda process: process.state.analogue.get(number, 0.0),
        lambda process, value: process.state.set_analogue(number, value),
    )


SYSTEM_PARAMETERS = {
    **{f"AOUT{number}": _analogue(number) for number in range(4)},
    "CONTROL": SystemParameter(lambda process: SIMULATOR),
    "ERROR_AXIS": SystemParameter(lambda process: 0.0),
    "ERROR_LINE": SystemParameter(lambda process: float(process.error_line)),
    "LAST_AXIS": SystemParameter(_last_axis),
    "LIMIT_BUFFERED": SystemParameter(lambda process: float(process.state.motion.buffers), _set_buffers),
    "MOTION_ERROR": SystemParameter(lambda process: 0.0),
    "PROC_STATUS": SystemParameter(_status),
    "PROCNUMBER": SystemParameter(lambda process: float(process.number)),
    "RUN_ERROR": SystemParameter(lambda process: float(process.error_line > 0)),
    "SERVO_PERIOD": SystemParameter(lambda process: 1e6 * process.state.motion.period),
    "SYSTEM_ERROR": SystemParameter(lambda process: 0.0),
    "TICKS": SystemParameter(lambda process: process.ticks_zero - process.state.tick, _set_ticks),
    "WDOG": SystemParameter(lambda process: float(process.state.motion.enabled), _set_wdog),
}


def _bits(name: str, on: Callable[[Process], Collection[int]]) -> Callable[..., float]:
    """Return what reads an input or output, or those from a first to a last one as a binary number."""

    def read(process: Process, first: float, last: float | None = None) -> float:
        begin = index(name, first, MOST_OUTPUTS)
        if last is None:
            return float(begin in on(process))
        end = index(name, last, MOST_OUTPUTS)
        if not 0 <= end - begin < MOST_BITS:
            raise InputError(f"{name}({begin},{end}): must be 1 to {MOST_BITS} lines, the first one first")
        return float(sum(1 << k for k in range(end - begin + 1) if begin + k in on(process)))

    return read


MOST_BITS = 32  # inputs or outputs read as one number

# memory, inputs and outputs, by one index; inputs and outputs by a first and a last one too
MEMORY: dict[str, Callable[..., float]] = {
    "AOUT": lambda process, k: process.state.analogue.get(index("AOUT", k, MOST_ANALOGUE), 0.0),
    "IN": _bits("IN", lambda process: process.state.inputs),
    "OP": _bits("OP", lambda process: process.state.outputs),
    "READ_OP": _bits("READ_OP", lambda process: process.state.outputs),
    "TABLE": lambda process, k: process.state.table.get(index("TABLE", k, TABLE_SIZE), 0.0),
    "VR": lambda process, k: process.state.vr.get(index("VR", k, VR_SIZE), 0.0),
}
RANGES = ("IN", "OP", "READ_OP")
WHOLE_LINES = ("IN", "OP")  # which without an index are the first MOST_BITS lines


def _names(text: str) -> frozenset[str]:
    return frozenset(text.split())


NOT_EMULATED = _names(
    "ACC ADD_DAC AIN AUTORUN B_SPLINE CHANNEL_READ CLOSE DEC DEFKEY DISABLE_GROUP DLINK DRIVE_CONTROLWORD "
    "FILE FLAG FLAGS FLEXLINK GET INPUT INVERT_IN KEY LINPUT MODBUS MOVEMODIFY MOVETANG MSPHERICAL "
    "MSPHERICALSP OPEN PROFINET PSWITCH REGIST REG_POS STEPLINE TIMER"
)

KEYWORDS = _names(
    "AND AXIS BASICERROR CHR CONSTANT DIM DO ELSE ELSEIF ENDIF FOR GLOBAL GOSUB GOTO HALT HEX IF INCLUDE LOOP MOD NEXT "
    "NOT OR PRINT PROC REM REPEAT RETURN RUN STEP STOP THEN TO UNTIL WAIT WEND WHILE XOR"
)
