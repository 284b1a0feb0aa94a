"""Sizing of a machine's drives: speed, force, inertia ratio, modes, gains, heat of a job."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from gantrysim.machine.axis import PER_SI, Axis, fact
from gantrysim.machine.checks import joint_friction, shaft_inertia, weights
from gantrysim.machine.design.build import modes
from gantrysim.machine.design.library import Winding, largest_torque
from gantrysim.machine.machine import Machine
from gantrysim.machine.quiet import quiet
from gantrysim.record.run import Run
from gantrysim.servo.servo import Servo
from gantrysim.servo.stability.margins import margins_of

# values beyond which a finding is reported
INERTIA_RATIO = 10.0
_COARSE_COUNT = 10.0  # encoder count [µm or mdeg]
_LEAST_MARGIN = 1.99  # derived loops have a gain margin of 2 or more, but for rounding


class Mode(NamedTuple):
    """A mode of the machine.

    Attributes:
        frequency: [Hz].
        joint: that takes the largest part of its energy.
    """

    frequency: float
    joint: str


@dataclass(frozen=True, kw_only=True)
class AxisSizing:
    """Capacity and load of an axis' drive; nan where the MJCF states none, such as a continuous torque.

    u is the axis' unit of travel, forces are in N, of a hinge torques in N·m.

    Attributes:
        axis: the axis.
        peak_force: at rest, with the transmission's efficiency.
        continuous_force: at the motor's continuous torque, with the same efficiency.
        torque_at_speed: largest torque that bus, winding and current leave at the speed limit [N·m].
        friction_at_speed: torque that friction, a weight and a constant torque take there, in the worse direction
            [N·m].
        inertia_ratio: of load, transmission and coupling to the rotor, at its shaft; where the MJCF states no rotor
            inertia, of the load to rotor, transmission and coupling together; nan where it states neither.
        acceleration: from rest with the peak torque, in the worse direction [u/s²].
        frequency: natural frequency of the derived loop, or of a stepper in its field [Hz].
        gain_margin: of the derived loop, with all others closed.
        travel_error: of the transmission over the whole travel, plus or minus [µm].
        rms: root mean square of the torque of a job, nan without one [N·m].
        peak: largest torque of a job, nan without one [N·m].
        continuous_torque: of the motor [N·m].
    """

    axis: Axis
    peak_force: float
    continuous_force: float
    torque_at_speed: float
    friction_at_speed: float
    inertia_ratio: float
    acceleration: float
    frequency: float
    gain_margin: float
    travel_error: float
    rms: float
    peak: float
    continuous_torque: float

    @property
    def load(self) -> float:
        """Thermal load: rms torque of the job per continuous torque."""
        return self.rms / self.continuous_torque

    def findings(self) -> tuple[str, ...]:
        """Return a line for each value that is unsuitable, with a remedy."""
        axis = self.axis
        name = self.axis.name
        lines = []
        if self.acceleration <= 0:
            lines.append(
                f"{name}: the peak torque {axis.peak_torque:.3g} N·m does not move it: friction and weight take as "
                "much: more reduction, a motor with more torque, or a counterbalance"
            )
        if self.torque_at_speed < self.friction_at_speed:
            lines.append(
                f"{name}: at {axis.speed_limit:.4g} {axis.unit}/s the bus leaves {self.torque_at_speed:.3g} N·m, "
                f"friction takes {self.friction_at_speed:.3g} N·m: lower the speed limit or raise the voltage"
            )
        if self.inertia_ratio > INERTIA_RATIO:
            lines.append(
                f"{name}: inertia ratio {self.inertia_ratio:.3g}, above {INERTIA_RATIO:g} the load leads the motor: "
                "more reduction, or a motor with more rotor inertia"
            )
        if axis.resolution * 1e3 > _COARSE_COUNT:
            lines.append(
                f"{name}: an encoder count is {1e3 * axis.resolution:.3g} {'µm' if axis.unit == 'mm' else 'mdeg'}: an "
                "encoder with more counts, or more reduction"
            )
        if self.gain_margin < _LEAST_MARGIN:
            lines.append(
                f"{name}: gain margin {self.gain_margin:.3g}, below 2: a shorter servo period or stiffer drive"
            )
        if self.load > 1:
            lines.append(
                f"{name}: rms torque {self.rms:.3g} N·m is {self.load:.2f} times the continuous torque: the motor "
                "overheats; a larger motor, lower accelerations, or pauses"
            )
        return tuple(lines)


@dataclass(frozen=True)
class Sizing:
    """A machine's axes and modes.

    Attributes:
        axes: a value per axis.
        locked: modes with all motors held.
        free: modes with all motors free.
    """

    axes: tuple[AxisSizing, ...]
    locked: tuple[Mode, ...]
    free: tuple[Mode, ...]

    @classmethod
    def of(cls, machine: Machine, period: float = 1e-3, run: Run | None = None) -> Sizing:
        """Return the sizing of a machine.

        Args:
            machine: the machine.
            period: servo period of the derived gains [s].
            run: of the job whose torques count.
        """
        servo = Servo.derive(machine.axes, period)
        margins = margins_of(machine, servo)
        model = machine.physics
        motors = [int(model.jnt_dofadr[joint]) for joint in model.actuator_trnid[:, 0]]
        qpos = machine.to_qpos(np.zeros(len(machine.axes)))
        weight = weights(machine)
        axes = []
        for a, axis in enumerate(machine.axes):
            frequency = _frequency(axis, servo.modes[a], servo.gains[a].kp)
            margin = margins[a].least_gain if margins else math.nan
            torque = None if run is None else run.torque[:, a]
            axes.append(_axis_sizing(machine, a, frequency, margin, weight.get(axis.name, 0.0), torque))
        with quiet():
            locked = _named_modes(model, *modes(model, qpos, motors))
            free = _named_modes(model, *modes(model, qpos, ()))
        return cls(tuple(axes), locked, free)

    @property
    def findings(self) -> tuple[str, ...]:
        """A line for each unsuitable value of all axes, with a remedy."""
        return tuple(text for axis in self.axes for text in axis.findings())


def _axis_sizing(
    machine: Machine, a: int, frequency: float, margin: float, weight: float, torque: np.ndarray | None
) -> AxisSizing:
    axis = machine.axes[a]
    model = machine.physics
    # travel per motor angle [m/rad or 1]
    per_motor = axis.scale / PER_SI[axis.unit]
    efficiency = fact(model, "efficiency", a, 1.0)
    continuous = fact(model, "continuous_torque", a)
    inertia = axis.inertia * axis.scale
    rotor_inertia = fact(model, "rotor_inertia", a, shaft_inertia(model, a))
    dry = axis.coulomb + joint_friction(model, a)
    held = abs(axis.constant_torque - weight)
    speed = axis.speed_limit / axis.scale
    ideal = math.isnan(axis.motor_constant)
    at_speed = axis.peak_torque
    if not ideal and math.isfinite(speed):
        winding = Winding(
            K=axis.motor_constant,
            R=axis.resistance,
            L=fact(model, "inductance", a, axis.lag * axis.resistance),
            pole_pairs=fact(model, "pole_pairs", a, 0.0),
        )
        current = axis.peak_torque / axis.motor_constant
        at_speed = largest_torque(winding, speed, axis.bus_voltage, current)
    length = axis.travel[1] - axis.travel[0]
    return AxisSizing(
        axis=axis,
        peak_force=efficiency * axis.peak_torque / per_motor,
        continuous_force=efficiency * continuous / per_motor,
        torque_at_speed=at_speed,
        friction_at_speed=_drag_at_speed(axis, dry, weight),
        inertia_ratio=(inertia - rotor_inertia) / rotor_inertia if rotor_inertia > 0 else math.nan,
        acceleration=(axis.peak_torque - dry - held) / axis.inertia,
        frequency=frequency,
        gain_margin=margin,
        travel_error=fact(model, "travel_error", a) * length / 300 if axis.unit == "mm" else math.nan,
        rms=math.nan if torque is None else float(np.sqrt(np.mean(torque**2))),
        peak=math.nan if torque is None else float(np.abs(torque).max()),
        continuous_torque=continuous,
    )


def _drag_at_speed(axis: Axis, dry: float, weight: float) -> float:
    if not math.isfinite(axis.speed_limit):
        return math.nan
    speed = axis.speed_limit
    return dry + axis.viscous * speed + abs(axis.constant_torque - weight - axis.viscous_difference * speed)


def _frequency(axis: Axis, mode: str, kp: float) -> float:
    """Return the natural frequency of an axis in its loop, of a velocity demand kp / 2 pi, or in its field [Hz]."""
    if mode == "velocity":
        return kp / (2 * math.pi)
    if mode == "stepper" and axis.phases is not None:
        kp = axis.phases.pole_pairs * axis.peak_torque / axis.scale
    return math.sqrt(kp / axis.inertia) / (2 * math.pi)


def _named_modes(model: mujoco.MjModel, frequencies: np.ndarray, shapes: np.ndarray) -> tuple[Mode, ...]:
    """Return modes with the joint that holds the most of their kinetic energy."""
    mass = np.zeros((model.nv, model.nv))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, mass)
    named = []
    for frequency, shape in zip(frequencies.tolist(), shapes.T, strict=True):
        dof = int(np.abs(shape * (mass @ shape)).argmax())
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, int(model.dof_jntid[dof]))
        named.append(Mode(frequency, name or f"degree of freedom {dof}"))
    return tuple(named)
