"""The data of the compiled tick: one row of parameters and state per simulation, one log entry per servo tick."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from gantrysim.native.layout import POINTERS
from gantrysim.servo.gains import GAIN_NAMES
from gantrysim.servo.laws.friction import Friction
from gantrysim.servo.laws.observer import MOST_SHIFT, TAPS
from gantrysim.servo.notch import Coefficients
from gantrysim.servo.servo_values import MAX_FEEDBACK_DELAY

MAX_AXES = 6

# How far an axis may pass its travel before the limit switch trips, and by which factor its speed limit.
OVERTRAVEL = 0.1  # [mm or deg]
OVERSPEED = 1.2

# The torque limit can hold an unstable loop in a limit cycle whose error looks harmless. It is detected by this many
# swings of the demand from one limit to the other, each within this time of the last.
OSCILLATION_SWINGS = 20
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
FOLLOWING_ERROR, TRAVEL, OVERSPEEDING, DIVERGED, OSCILLATION = range(1, 6)
POSITION_ERROR, POSITION_ERROR_AT_REST, SETTLING = range(6, 9)

WARNINGS = int(mujoco.mjtWarning.mjNWARNING)  # kinds of MuJoCo's warnings; any of them makes the state invalid

# faults on purpose: what they do to an axis
DROPOUT, OFFSET, SLIP, HELD, EXTRAPOLATED, WINDING, BUS = range(1, 8)
TORQUE, VELOCITY, POSITION, STEPPER = range(4)  # modes of a drive
NEVER = 2**40  # tick of what does not happen in a run

OFFSETS = {f"{name}_at": name for name in (*POINTERS, "warning") if name != "userdata"}  # fields of `layout.offsets`

_WHOLE = [
    "magic",
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
    *OFFSETS,  # in mjData
    "nozzle",  # site
    "work",  # body
    "position_error_delay",  # servo ticks
    "gates",  # address of the indices of setpoints at which the stream waits
    "gate_count",
    "gate",  # number of gates passed
    "settle_ticks",
    "timeout_ticks",
    "injected",  # address of the INJECTED entries, one per fault on purpose and axis
    "injected_count",
    "drives",  # address of the DRIVE entries, one per axis; 0 where every drive is a plain one
    "laws",  # address of the LAW entries, one per axis; 0 where the law is PID alone
    "within",  # ticks in a row within the settle error at this gate
    "waited",  # ticks at this gate
    "fault",  # index into FAULTS
    "fault_axis",
    "fault_tick",
]
_AXIS_WHOLE = ["control", "output", "current"]  # indices of ctrl, of actuator_length, and of act or -1
_AXIS_PARAMETERS = [
    "scale",  # axis travel per radian of the motor
    "drive_gain",  # torque that the drive gives per torque demanded
    "resolution",
    "torque_limit",
    "following_error_limit",
    "low",
    "high",
    "speed_limit",
    "linear",  # 1 where the axis counts for the group's position error, 0 where not
]
_AXIS_STATE = [
    "commanded",
    "measured",
    "error",
    "error_change",
    "error_sum",
    "demand_velocity",
    "demand_acceleration",
    "measured_velocity",
    "torque",
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
    + [("gains", np.float64, (MAX_AXES, len(GAIN_NAMES)))]
    + [("notch", np.float64, (MAX_AXES, len(Coefficients._fields)))]
    + [(name, np.float64, (MAX_AXES,)) for name in _AXIS_PARAMETERS + _AXIS_STATE]
)

INJECTED = np.dtype(
    [
        ("kind", np.int64),
        ("axis", np.int64),
        ("begin", np.int64),  # first tick at which it acts
        ("end", np.int64),  # first tick at which it no longer does
        ("value", np.float64),  # offset of the encoder or of the motor [u], or voltage that is left [V]
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

TOLD = MOST_SHIFT + TAPS + 1
LAW = np.dtype(
    [
        ("cascade", np.int64),  # 1 for P-PI, 0 for PID
        ("user", np.int64),  # address of a user's own law, of the first axis; 0 for none
        ("state_at", np.int64),  # address of its state
        ("feed", np.int64),  # address of the torques sent with the setpoints, one per setpoint and axis; 0 for none
        ("contour", np.float64),  # factor on the error across the path
        ("friction", np.float64, (len(Friction._fields),)),
        ("inertia", np.float64),  # of the observer; 0 for no observer
        ("viscous", np.float64),
        ("shift", np.int64),  # see `torque_taps`
        ("taps", np.float64, (TAPS,)),
        ("filter", np.float64, (len(Coefficients._fields),)),
        # state
        ("speed_sum", np.float64),  # of the cascade [N·m·s]
        ("across", np.float64),  # error across the path at the last tick [mm]
        ("tangent", np.float64),  # of the path, while it last moved
        ("friction_torque", np.float64),
        ("velocity", np.float64),  # measured at the last tick
        ("first", np.float64),  # states of the filter
        ("second", np.float64),
        ("told", np.float64, (TOLD,)),  # torque demands, by tick modulo their number
    ]
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
