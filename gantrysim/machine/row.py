"""The data of the compiled tick: one row of parameters and state per simulation, one log entry per servo tick."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from gantrysim.machine.layout import POINTERS
from gantrysim.servo.gains import GAIN_NAMES
from gantrysim.servo.laws import LAW_PARAMETERS, LAWS
from gantrysim.servo.notch import Coefficients
from gantrysim.servo.request import MAX_FEEDBACK_DELAY

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
TORQUE, VELOCITY, POSITION, STEPPER = range(4)  # modes of a drive
NEVER = 2**40  # tick of what does not happen in a run

OFFSETS = {f"{name}_at": name for name in (*POINTERS, "warning") if name != "userdata"}  # fields of `layout.offsets`

_WHOLE = [
    "magic",
    "axes",
    "dofs",  # of the machine, nv
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
    *OFFSETS,  # in mjData
    "nozzle",  # site
    "work",  # body
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
    "observer",  # address of a C function (mjData, userdata, argument)
    "observer_argument",
    "observer_step",  # number of physics steps begun at whose last the observer is called, 0 for never
]
# Where the stops of the axes are: in the model; not in it, and no axis has been at one; not in it, but missed
IN_MODEL, NOT_IN_MODEL, MISSED = range(3)
_AXIS_WHOLE = ["control", "output", "current", "joint"]  # indices of ctrl, actuator_length, act or -1, and qpos
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
    "motor_speed",
    "winding_current",  # of a motor whose current MuJoCo simulates
    "control_torque",  # controls
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
    [(name, np.int64) for name in _WHOLE]
    + [(name, np.float64) for name in ("period", "position_error", "settle_error", "fault_value", "fault_limit")]
    + [(name, np.int64, (MAX_AXES,)) for name in _AXIS_WHOLE]
    + [("stage_until", np.int64, (len(POINTS),))]  # number of the first stage after each point
    + [("gains", np.float64, (MAX_AXES, len(GAIN_NAMES)))]
    + [("notch", np.float64, (MAX_AXES, len(Coefficients._fields)))]
    + [(name, np.float64, (MAX_AXES,)) for name in _AXIS_PARAMETERS + _AXIS_STATE]
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

DRIVE = np.dtype(
    [
        ("load", np.int64),  # of the load's joint in qpos, -1 where the encoder is on the motor
        ("load_zero", np.float64),  # where the load is not displaced [SI]
        ("per_si", np.float64),  # mm per metre or deg per radian
        ("noise", np.float64),  # rms [u]
        ("seed", np.uint64),
        ("once", np.float64),  # amplitude of the interpolation error, once per signal period [u]
        ("twice", np.float64),  # and twice
        ("signal", np.float64),  # radians of the signal per u
        ("delay", np.int64),  # servo ticks from the encoder to the servo
        ("history", np.float64, (MAX_FEEDBACK_DELAY + 1,)),  # of the encoder [u]
        ("lead", np.float64),  # control beyond the torque, per difference of demand and torque; 0 for no current loop
        ("constant", np.float64),  # of the motor, that of a stepper with its perturbation [N·m/A]
        ("mode", np.int64),
        ("logged", np.int64),  # ticks of which the drive has written its part of the log
        # transmission
        ("loss", np.float64),  # friction per transmitted force, 0 for none
        ("dof", np.int64),  # of the axis' joint
        ("spring", np.int64),  # dof of the spring that carries the load; -1 for tendons, which pull at the axis' joint
        ("damping", np.float64),  # of the axis' joint itself [N·s/m or N·m·s/rad]
        ("presliding", np.float64),  # motion within which the friction turns [SI]
        ("slid", np.float64),  # share and direction of the friction, -1 to 1
        # loops in the drive
        ("every", np.int64),  # physics steps between its samples
        ("period", np.float64),  # of them [s]
        ("limit", np.float64),  # largest torque demand [N·m]
        ("gain", np.float64),  # of the velocity loop [N·m·s/u]
        ("rate", np.float64),  # its integral action [1/s]
        ("before", np.float64),  # position [u], or in position mode following error, at the last sample
        ("position", np.float64),  # in position mode at the last sample [u]
        ("sum", np.float64),  # of the error times the period
        ("torque", np.float64),  # demand held [N·m]
        ("first", np.float64),  # states of the notch in position mode
        ("second", np.float64),
        ("poles", np.float64),  # electrical radians per u
        ("reactance", np.float64),  # of a motor with poles per speed, else 0 [ohm·s]
        ("resistance", np.float64),  # [ohm]
        ("bus", np.float64),  # [V]
        # of a stepper in open loop
        ("counts", np.int64),  # 1 where its microsteps are counted in place of an encoder
        ("circuit", np.int64),  # steps of the circuit per physics step, even
        ("microstep", np.float64),  # [u]
        ("amplitude", np.float64),  # of the phase currents [A]
        ("left", np.float64),  # share of a phase current that is left after a step of the circuit
        ("start", np.float64),  # of the field or reference, on its way to the target during a servo period [u]
        ("came_from", np.float64),  # start of the period before [u]
        ("target", np.float64),  # [u]
        ("next", np.float64),  # target of the next period where the servo's delay is a whole one [u]
        ("phases", np.float64, (2,)),  # currents [A]
        ("volts", np.float64),  # largest phase voltage of the last physics step [V]
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
