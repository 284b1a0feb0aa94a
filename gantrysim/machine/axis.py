"""An axis of a machine: its drive, encoder, friction and motion, in mm or deg."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from gantrysim.base.display import table_html
from gantrysim.base.quantity import number_text
from gantrysim.servo.axis_dynamics import Friction
from gantrysim.servo.stability.motion import Motion

PER_SI = {"mm": 1e3, "deg": 180 / math.pi}  # millimetres per metre, degrees per radian


@dataclass(frozen=True)
class Phases:
    """The phases of a motor with poles.

    Attributes:
        pole_pairs: p, electrical periods per turn; of a stepper each is four full steps.
        inductance: of a phase [H].
        microsteps: per full step of a stepper in open loop, else 0.
    """

    pole_pairs: float
    inductance: float
    microsteps: float


@dataclass(frozen=True)
class Axis:
    """A driven axis; u is its unit of travel, torques are at the motor shaft.

    Attributes:
        name: name of the axis, and of its joint, actuator and encoder.
        unit: "mm" for a slide, "deg" for a hinge.
        travel: lowest and highest position; infinite for a joint without a range [u].
        scale: axis travel per motor angle: lead / 2 pi, or 1 / gear ratio in degrees [u/rad].
        inertia: motor torque per acceleration: rotor, transmission and load, with all axes at their reference
            [N·m·s²/u].
        viscous: motor torque per speed [N·m·s/u].
        coulomb: Coulomb friction [N·m].
        motor_constant: torque and back-EMF constant K; nan for an ideal torque source [N·m/A].
        resistance: winding resistance; nan for an ideal torque source [ohm].
        lag: electrical time constant, L/R [s].
        bus_voltage: voltage limit of the drive; inf for an ideal torque source [V].
        peak_torque: torque limit of the drive [N·m].
        declared_speed: speed limit stated in the MJCF; inf if none [u/s].
        resolution: axis travel per encoder count; 0 for an exact measurement [u].
        motion: linear dynamics with all axes at their reference and the other motors held; None if an actuator has a
            delay of its own.
        friction: LuGre friction of the motor; all zero without friction.
        chain: linear dynamics of all axes if a closed chain couples them, otherwise None.
        coupled: linear dynamics of this axis and the axes coupled with it, in their order; None for an uncoupled axis.
            In a closed chain these are all axes.
        efficiency: fraction of the work that the transmission passes on.
        constant_torque: that acts on the motor besides, such as a weight, positive forwards [N·m].
        viscous_difference: half the difference of viscous friction, forwards less back; `viscous` is the mean
            [N·m·s/u].
        mode: command mode of the drive, see `gantrysim.Servo`.
        phases: phases of a motor whose custom numerics state them, otherwise None.
    """

    name: str
    unit: str
    travel: tuple[float, float]
    scale: float
    inertia: float
    viscous: float
    coulomb: float
    motor_constant: float
    resistance: float
    lag: float
    bus_voltage: float
    peak_torque: float
    declared_speed: float
    resolution: float
    friction: Friction = field(repr=False)
    motion: Motion | None = field(default=None, repr=False)
    chain: Motion | None = field(default=None, repr=False)
    coupled: Motion | None = field(default=None, repr=False)
    efficiency: float = 1.0
    constant_torque: float = 0.0
    viscous_difference: float = 0.0
    mode: str = "torque"
    phases: Phases | None = None

    @property
    def no_load_speed(self) -> float:
        """Speed at which the back-EMF equals the bus voltage [u/s]."""
        # an ideal torque source has no back-EMF: nan
        if not self.motor_constant > 0:
            return math.inf
        return self.bus_voltage / self.motor_constant * self.scale

    @property
    def speed_limit(self) -> float:
        """The lower of declared speed and no-load speed [u/s]."""
        return min(self.declared_speed, self.no_load_speed)

    @property
    def electrical_period(self) -> float:
        """Travel per electrical period, four full steps of a stepper; 0 if the phases are unknown [u]."""
        if self.phases is None:
            return 0.0
        return 2 * math.pi * self.scale / self.phases.pole_pairs


@dataclass(frozen=True)
class AxisAddress:
    """Indices of an axis in MuJoCo's arrays."""

    joint: int  # qpos
    control: int  # ctrl
    output: int  # actuator_length
    current: int  # act, -1 where the winding has no inductance
    load: int  # joint of the load on the axis' compliance, -1 where there is none


def axis_table(title: str, axes: Sequence[Axis]) -> str:
    """Return the main values of axes as an HTML table."""
    heads = ("axis", "unit", "travel", "peak torque [N·m]", "encoder count", "inertia [N·m·s²/u]")
    rows = [
        [
            axis.name,
            axis.unit,
            " to ".join(number_text(end, "g") for end in axis.travel),
            f"{axis.peak_torque:.4g}",
            f"{axis.resolution:.4g}",
            f"{axis.inertia:.4g}",
        ]
        for axis in axes
    ]
    return table_html(title, heads, rows)
