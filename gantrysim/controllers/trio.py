"""Trio Motion BASIC: the "Move Spiral" method of application note AN-225.

Two virtual axes run circles of the outer diameter. CONNECT(x, virtual axis) links each real axis to the
movement of its virtual axis, and a program loop lowers the ratio x while it raises the virtual speed to
V / x, so that the real path speed stays V. Between two passes of the loop the real axes therefore run an
arc of radius x R; the arcs meet with one tangent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gantrysim.controllers.arcs import ArcChain
from gantrysim.controllers.path import Floats, Path
from gantrysim.controllers.setpoints import Setpoints
from gantrysim.controllers.spirals import Involute
from gantrysim.errors import InputError, at_least, point, positive, whole

__all__ = ["MoveSpiral"]

_MAX_PASSES = 2_000_000
_ROUNDING = 1e-12
_LEAST_RATIO = 2.0**-16  # CONNECT's ratio has 16 fractional bits


@dataclass(frozen=True)
class MoveSpiral:
    """An inward spiral by the loop method of AN-225.

    The loop's k-th pass sets x_k = 1 - k change, with change = 2 thickness V T / (pi D^2), before the
    k-th piece of motion, and waits WA(1000 T x_k) ms. A pass lasts T x_k + d and turns the virtual circle by
    V (T x_k + d) / (x_k R). As T and d go to zero the path tends to the involute of a circle of radius
    thickness / 2 pi, whose normal pitch is exactly `thickness`: that is the requested path.

    The setpoints lie on these arcs exactly. A real controller adds ratio times the virtual axis' step at each
    servo tick, with a ratio of 16 fractional bits and virtual axes that accelerate; that is not modelled, and
    apart from the acceleration comes to some micrometres.

    Source: Trio Motion Technology, application note AN-225 (2008).

    Args:
        diameter: outer diameter D of the virtual circles [mm].
        turns: number of circles, a whole number.
        thickness: distance of neighbouring turns [mm].
        speed: path speed V of the real axes [mm/s].
        loop_period: time T of one pass of the program loop at x = 1; 0 is the continuous limit [s].
        interpreter_time: time d that the interpreter itself adds to every pass [s].
        start: first point (x, y) [mm].
        clockwise: sense of the turning; the first motion is towards +y, the centre lies at +x where
            clockwise and at -x where not.

    Raises:
        InputError: a value out of its bounds, an inner diameter below zero, or a ratio x that would fall
            to zero or below.
    """

    diameter: float
    turns: int
    thickness: float
    speed: float
    loop_period: float = 0.1
    interpreter_time: float = 0.0
    start: tuple[float, float] = (0.0, 0.0)
    clockwise: bool = True

    def __post_init__(self) -> None:
        checked = {
            "diameter": positive("diameter", self.diameter, "mm"),
            "turns": whole("turns", self.turns, 1),
            "thickness": positive("thickness", self.thickness, "mm"),
            "speed": positive("speed", self.speed, "mm/s"),
            "loop_period": at_least("loop_period", self.loop_period, 0, "s"),
            "interpreter_time": at_least("interpreter_time", self.interpreter_time, 0, "s"),
            "start": point("start", self.start),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)
        if self.inner_diameter < -_ROUNDING * self.diameter:
            raise InputError(
                f"inner_diameter = {self.inner_diameter:g} mm (diameter {self.diameter:g} - 2 x turns {self.turns} x "
                f"thickness {self.thickness:g}): must be at least 0 mm; "
                f"use {_fewer(self.diameter, self.thickness)}thickness below {self.diameter / (2 * self.turns):g} mm"
            )
        if self.loop_period == 0 and self.interpreter_time > 0:
            raise InputError(
                f"interpreter_time = {self.interpreter_time:g} s: must be 0 s where loop_period is 0 s, "
                "the limit of a loop that takes no time"
            )
        if self.loop_period > 0:
            _ = self.ratios  # raises where the ratio would reach zero

    @property
    def radius(self) -> float:
        """Radius R of the virtual circles [mm]."""
        return 0.5 * self.diameter

    @property
    def inner_diameter(self) -> float:
        """Diameter less a thickness on both sides for every turn [mm]."""
        return self.diameter - 2 * self.turns * self.thickness

    @property
    def virtual_length(self) -> float:
        """Length of the virtual circles, pi D turns [mm]."""
        return math.pi * self.diameter * self.turns

    @property
    def virtual_time(self) -> float:
        """Time of the virtual circles at the path speed [s]."""
        return self.virtual_length / self.speed

    @property
    def change(self) -> float:
        """Decrease of the ratio x at each pass of the loop."""
        return 2 * self.thickness * self.speed * self.loop_period / (math.pi * self.diameter**2)

    @cached_property
    def ratios(self) -> Floats:
        """Ratio x of every pass whose motion is run, (passes,); empty in the continuous limit."""
        if self.loop_period == 0:
            return np.zeros(0)
        # without interpreter time every pass turns the circle by V T / R; with it the passes are fewer
        bound = max(1, math.ceil(self.virtual_time / self.loop_period - 1e-9))
        if bound > _MAX_PASSES:
            raise InputError(
                f"loop_period = {self.loop_period:g} s: makes {bound:.8g} passes, at most {_MAX_PASSES} are run; "
                f"use 0 s for the continuous limit or at least {self.virtual_time / _MAX_PASSES:.3g} s"
            )
        x = 1 - self.change * np.arange(1, bound + 1, dtype=np.float64)
        running = x >= _LEAST_RATIO
        turned = np.cumsum(self._pass_angle(x[running]))
        needed = int(np.searchsorted(turned, 2 * math.pi * self.turns * (1 - 1e-12))) + 1
        if needed > turned.size:
            raise InputError(
                f"ratio x = {x[turned.size]:.4g} on pass {turned.size + 1} of {bound}: "
                "must be at least 2^-16, the least that CONNECT can hold; "
                f"inner_diameter {self.inner_diameter:g} mm is too small for loop_period {self.loop_period:g} s, "
                "use fewer turns, a smaller thickness or a shorter loop_period"
            )
        return x[:needed]

    def _pass_angle(self, x: Floats) -> Floats:
        """Angle by which a pass at the ratio x turns the virtual circle, (passes,) [rad]."""
        return self.speed / self.radius * (self.loop_period + self.interpreter_time / x)

    @cached_property
    def requested(self) -> Involute:
        """The continuous limit: the involute with normal pitch `thickness`."""
        return Involute(self.radius, self.thickness, self.turns, self.start, 0.5 * math.pi, self.clockwise)

    @cached_property
    def generated(self) -> Path:
        """The path that the controller really commands: an arc for every pass of the loop."""
        if self.loop_period == 0:
            return self.requested
        x = self.ratios
        angle = self._pass_angle(x)
        angle[-1] -= angle.sum() - 2 * math.pi * self.turns  # the circles end within the last pass
        radius = x * self.radius
        turn = -1.0 if self.clockwise else 1.0
        return ArcChain(self.start, 0.5 * math.pi, turn / radius, angle * radius)

    @property
    def duration(self) -> float:
        """Time of the motion [s]."""
        return self.generated.length / self.speed

    def setpoints(self, period: float) -> Setpoints:
        """Return the commanded positions of the axes x and y at every servo period [s]."""
        return Setpoints.along(self.generated, self.speed, period, requested=self.requested)


def _fewer(diameter: float, thickness: float) -> str:
    turns = math.ceil(diameter / (2 * thickness)) - 1
    return f"turns at most {turns} or " if turns >= 1 else ""
