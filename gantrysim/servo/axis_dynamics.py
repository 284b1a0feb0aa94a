"""What the design of a loop needs to know: dynamics of the axes, and lags of the servo and its drives."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, Protocol

from gantrysim.servo.stability.motion import Drives, Motion


class Friction(NamedTuple):
    """Friction of an axis at its motor.

    Attributes:
        coulomb: torque at speed [N·m].
        static: torque at which it breaks away [N·m].
        speed: Stribeck speed [u/s].
        stiffness: of the bristles, torque per travel after a reversal; 0 for a step [N·m/u].
    """

    coulomb: float
    static: float
    speed: float
    stiffness: float


class AxisDynamics(Protocol):
    """An axis, as the derivation of its gains depends on it."""

    @property
    def name(self) -> str:
        """Of the axis."""

    @property
    def inertia(self) -> float:
        """Motor torque per acceleration of the axis [N·m·s²/mm]."""

    @property
    def viscous(self) -> float:
        """Motor torque per speed of the axis [N·m·s/mm]."""

    @property
    def lag(self) -> float:
        """Time constant from torque demand to torque [s]."""

    @property
    def peak_torque(self) -> float:
        """Largest torque the drive delivers [N·m]."""

    @property
    def resolution(self) -> float:
        """Axis travel per encoder count, 0 for an exact measurement [mm]."""

    @property
    def friction(self) -> Friction:
        """Friction at the motor."""

    @property
    def mode(self) -> str:
        """Command mode of the drive, one of `MODES`."""

    @property
    def motion(self) -> Motion | None:
        """Linear motion of the axis alone; None if it is not known, and no mode is taken into account."""

    @property
    def chain(self) -> Motion | None:
        """Linear motion of all axes, where a closed chain couples them; None if none does."""

    @property
    def coupled(self) -> Motion | None:
        """Linear motion of all axes that move each other, this one among them; None if it moves no other."""


class Lags(NamedTuple):
    """What makes the loops of a servo late, besides its period and the machine.

    Attributes:
        delay: from sample to output [s].
        feedback: from the encoder to the servo [servo periods].
        drives: feedback and current loops of the drives.
    """

    delay: float = 0.0
    feedback: int = 0
    drives: Drives = Drives()

    def of_axes(self, axes: Sequence[int]) -> Lags:
        """Return those of some axes."""
        return self._replace(drives=self.drives.of_axes(axes))

    def winding(self, axis: AxisDynamics) -> float:
        """Return the time constant of the torque, given those of one axis [s]."""
        width = max(self.drives.bandwidth, default=0.0)
        return 1 / (2 * math.pi * width) if width else axis.lag


def coupled_groups(axes: Sequence[AxisDynamics]) -> list[list[int]]:
    """Return the numbers of the axes that move each other, one list per group; an axis that moves no other is in none.

    Axes of one group have the same `coupled`. Of a group of which not all axes are among those given, the others are
    missing: its list is shorter than its motion has axes.
    """
    groups: dict[Motion, list[int]] = {}
    for a, axis in enumerate(axes):
        if axis.coupled is not None:
            groups.setdefault(axis.coupled, []).append(a)
    return list(groups.values())
