"""The data of the compiled tick: one row of parameters and state per simulation, one log entry per servo tick."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from gantrysim.servo.gains import GAIN_NAMES
from gantrysim.servo.laws import LAW_PARAMETERS, LAWS
from gantrysim.servo.notch import Coefficients

MAX_AXES = 6

# How far an axis may pass its travel before the limit switch trips, and by which factor its speed limit.
OVERTRAVEL = 0.1  # [mm or deg]
OVERSPEED = 1.2

# The torque limit can hold an unstable loop in a limit cycle whose error looks harmless. It is detected by this many
# swings of the demand from one limit to the other, each within this time of the last.
OSCILLATION_SWINGS = 20.0
OSCILLATION_TIME = 0.1  # [s]

LARGEST_TORQUE = 1e9  # [N·m]; MuJoCo zeroes a control of more than 1e10, with no more than a warning

FAULTS = (
    "none",
    "following error",
    "travel",
    "overspeed",
    "diverged",
    "oscillation",
    "position error",
    "position error",
    "settling",
)
# of NumPy's type, as numba compiles a function anew for every literal of Python's that it is called with
FOLLOWING_ERROR, TRAVEL, OVERSPEEDING, DIVERGED, OSCILLATION = map(np.int64, range(1, 6))
POSITION_ERROR, POSITION_ERROR_AT_REST, SETTLING = map(np.int64, range(6, 9))

WARNINGS = int(mujoco.mjtWarning.mjNWARNING)  # kinds of MuJoCo's warnings; any of them makes the state invalid

# Points at which stages of the tick run, in their order; a law or a fault says at which of them it acts.
POINTS = (
    "current",  # before each physics step: `row.winding_current`
    "setpoint",  # before each tick: `row.setpoint`
    "motor",  # `row.motor`, the position of the motor; also where a drive samples it
    "encoder",  # `row.seen`, the position that the encoder reads, before it is counted
    "feedback",  # `row.seen` on its way to the servo
    "report",  # `row.seen` as it arrives; also where a drive samples it
    "supervise",  # trips, or sets `row.waits` for the stream to wait
    "error",  # `row.law_error` and `row.law_change`
    "law",  # in place of PID: sets `row.torque` and `row.next_integral`
    "feedforward",  # adds to `row.feedforward`
    "disturbance",  # adds to it, after all feed-forward
    "demand",  # after the torque demand is known: `row.torque`
    "drive",  # before each physics step: the controls
    "voltage",  # `row.control_torque`, the controls as torques
)
NEVER = 2**40  # tick of what does not happen in a run

_INTEGER_FIELDS = [
    "magic",
    "address",  # of this row
    "axes",
    "ticks",  # setpoints in all
    "substeps",  # physics steps per servo period
    "delay",  # physics steps from the sample to the output
    "steps",  # physics steps begun
    "phase",  # of these, since the last tick was due
    "tick",  # servo ticks begun
    "index",  # of the setpoint that the next tick sends
    "setpoints",  # address of (ticks, axes) positions
    "log",  # address of the LOG_TICK entries, one per tick
    "axis_log",  # address of the LOG_AXIS entries, one per tick and axis
    "first",  # tick of the first entry of both
    "nozzle_site",
    "work_body",
    "lost",  # 1 where MuJoCo has warned of anything: the state is no longer valid
    "position_error_delay",  # servo ticks
    "gates",  # address of the indices of setpoints at which the stream waits
    "gate_count",
    "gate",  # number of gates passed
    "settle_ticks",
    "timeout_ticks",
    "stages",  # address of the STAGE entries, 0 where there are none
    "within",  # ticks in a row within the settle error at this gate
    "waited",  # ticks at this gate
    "waits",  # 1 where the stream waits at this setpoint
    "fault",  # index into FAULTS
    "fault_axis",
    "fault_tick",
    "stops",  # one of the below
    "observer",  # address of a C function (row, argument)
    "observer_argument",
    "observer_step",  # number of physics steps begun at whose last the observer is called, 0 for never
]
# Where the stops of the axes are: in the model; not in it, and no axis has been at one; not in it, but missed
IN_MODEL, NOT_IN_MODEL, MISSED = range(3)
# where MuJoCo has an axis, -1 for nowhere
_AXIS_WHOLE = [
    "control_at",  # in ctrl
    "output_at",  # in actuator_length
    "current_at",  # in act
    "joint_at",  # in qpos
    "dof_at",  # in qvel
    "load_at",  # the load on its spring, in qpos
    "load_dof_at",  # in qvel
]
# what the machine is like at a physics step, read before it
_AXIS_MACHINE = [
    "angle",  # of the motor [rad]
    "motor_speed",  # [rad/s]
    "winding_current",  # nan where the motor has none [A]
    "joint_place",  # [SI]
    "joint_speed",  # [SI]
    "load_place",  # of the load's joint [SI]
    "passive",  # force of springs and dampers on the joint, where stages act before each step [SI]
    "load_passive",  # and on the load's
]
# what acts on it in that step: with it the winding current is written too, where stages act before each step
_AXIS_ACTS = [
    "control_torque",  # controls
    "applied",  # force on the joint besides [SI]
]
_AXIS_PARAMETERS = [
    "scale",  # axis travel per radian of the motor
    "drive_gain",  # torque that the drive gives per torque demanded
    "resolution",
    "torque_limit",
    "following_error_limit",
    "low",
    "high",
    "speed_limit",
    "stop_low",  # position in qpos at which the joint is at a stop [SI]
    "stop_high",
    "linear",  # 1 where the axis counts for the group's position error, 0 where not
]
_AXIS_STATE = [
    "setpoint",  # received by the servo at this tick
    "motor",  # position of the motor
    "seen",  # position on its way from the encoder to the servo
    "commanded",
    "measured",
    "error",
    "error_change",
    "law_error",  # to which the law answers
    "law_change",
    "integral",  # of the law
    "next_integral",  # unless the demand is clamped
    "demand_velocity",
    "demand_acceleration",
    "measured_velocity",
    "torque",
    "feedforward",  # added to the torque of the base law
    "compensation",  # the part of it that compensates what no linear model has
    "notch_first",  # states of the notch
    "notch_second",
    "pending",
    "held",
    "clamp_side",  # where the demand was last clamped, -1 or 1
    "clamp_tick",
    "swings",
]
ROW = np.dtype(
    [(name, np.int64) for name in _INTEGER_FIELDS]
    + [(name, np.float64) for name in ("period", "position_error", "settle_error", "fault_value", "fault_limit")]
    + [(name, np.int64, (MAX_AXES,)) for name in _AXIS_WHOLE]
    + [("stage_until", np.int64, (len(POINTS),))]  # number of the first stage after each point
    + [("nozzle", np.float64, (3,))]  # at a tick, in the work frame [mm]
    + [("gains", np.float64, (MAX_AXES, len(GAIN_NAMES)))]
    + [("notch", np.float64, (MAX_AXES, len(Coefficients._fields)))]
    + [(name, np.float64, (MAX_AXES,)) for name in _AXIS_PARAMETERS + _AXIS_MACHINE + _AXIS_ACTS + _AXIS_STATE]
)

STAGE = np.dtype([("address", np.int64), ("argument", np.int64)])

# a deliberate fault of one axis
FAULT = np.dtype(
    [
        ("axis", np.int64),
        ("begin", np.int64),  # first tick at which it acts
        ("end", np.int64),  # first tick at which it no longer does
        ("value", np.float64),  # see the fault
        ("constant", np.float64),  # motor constant [N·m/A]
        ("resistance", np.float64),  # [ohm]
    ]
)

# the laws of one axis: parameters, then states
LAW = np.dtype(
    [(parameter.name, np.float64) for parameter in LAW_PARAMETERS] + [field for law in LAWS for field in law.state]
)

ROW_NUMBERS = ROW.itemsize // 8  # mjtNums of userdata

# what the tick logs: of the machine, and of each axis
LOG_TICK = np.dtype(
    [
        ("setpoint", np.int64),  # index of the setpoint sent
        ("nozzle", np.float64, (3,)),  # in the work frame [mm]
    ]
)
LOG_AXIS = np.dtype(
    [
        ("encoder", np.float64),  # position as measured [mm or deg]
        ("motor", np.float64),  # exact position [mm or deg]
        ("motor_speed", np.float64),  # [rad/s]
        ("demand", np.float64),  # torque demand, clamped [N·m]; of a stepper in open loop its largest phase voltage [V]
        ("current", np.float64),  # of the motor, nan where MuJoCo does not simulate it [A]
    ]
)


class Log(NamedTuple):
    """The log of a run.

    Attributes:
        tick: of the machine, (ticks,) of `LOG_TICK`.
        axis: of the axes, (ticks, axes) of `LOG_AXIS`.
    """

    tick: NDArray[np.void]
    axis: NDArray[np.void]

    @classmethod
    def of(cls, ticks: int, axes: int) -> Log:
        """Return an empty log."""
        return cls(np.empty(ticks, LOG_TICK), np.empty((ticks, axes), LOG_AXIS))

    def until(self, tick: int) -> Log:
        """Return the entries before a tick."""
        return Log(self.tick[:tick], self.axis[:tick])

    def since(self, tick: int) -> Log:
        """Return the entries from a tick on."""
        return Log(self.tick[tick:], self.axis[tick:])


class Tape(NamedTuple):
    """What a run reads from tick to tick, and what it writes.

    Attributes:
        setpoints: positions of the axes, (n, axes) [mm or deg].
        gates: setpoints at which the stream waits, (gates,).
        log: the log.
    """

    setpoints: NDArray[np.float64]
    gates: NDArray[np.int64]
    log: Log
