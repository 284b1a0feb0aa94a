"""The theory of the Move Spiral's loop, as a study of any controller's program loop asks for it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.controllers.loop_theory import LoopErrors, LoopTheory
from gantrysim.controllers.trio.arcs import SteppedArcs, involute_radius, local_pitch, loop_error

_ARCS = ("diameter", "turns", "thickness", "speed", "loop_period", "interpreter_time", "wait_resolution")


@dataclass(frozen=True)
class SpiralTheory(LoopTheory):
    """Errors of the Move Spiral by the closed forms of its arcs.

    Attributes:
        arguments: of the program, all of them; the controller may refuse them.
    """

    arguments: Mapping[str, Any]

    alone: ClassVar[Mapping[str, Any]] = {
        "acceleration": math.inf,
        "deceleration": None,
        "wait_resolution": 0.0,
        "ratio_bits": None,
        "interpreter_time": 0.0,
        "servo_period": 0.0,
        "as_published": False,
        "mhelical_mode": 1,
    }
    exact_waits: ClassVar[Mapping[str, Any]] = {"wait_resolution": 0.0}
    ramps = "ACCEL"
    wait = "WA"
    first_order = "√(3/2) a V T / 2R"

    @property
    def speed(self) -> float:
        return float(self.arguments["speed"])

    @property
    def pitch(self) -> float:
        return float(self.arguments["thickness"])

    @property
    def wait_resolution(self) -> float:
        return float(self.arguments["wait_resolution"])

    @property
    def ramp_period(self) -> float | None:
        acceleration = float(self.arguments["acceleration"])
        return self.speed / acceleration if math.isfinite(acceleration) else None

    def errors(self) -> LoopErrors | None:
        if not self.arguments["loop_period"]:
            return None
        try:
            arcs = SteppedArcs(
                **{name: self.arguments[name] for name in _ARCS},
                acceleration=self.arguments["acceleration"],
                ratio_bits=self.arguments.get("ratio_bits"),
            )
        except InputError:
            return None
        return LoopErrors(arcs.program, arcs.spacings)

    def first_order_error(self, loop_period: float) -> float:
        radius = 0.5 * self.arguments["diameter"]
        return loop_error(self.pitch, radius, self.speed, loop_period, math.inf).rms

    def local_pitches(self, interpreter_time: ArrayLike) -> dict[str, Floats]:
        last_ratio = 1 - 2 * self.arguments["turns"] * self.pitch / self.arguments["diameter"]
        ratios = {"start": 1.0, "end": last_ratio}
        time = np.asarray(interpreter_time, float)
        # a spiral that ends in its centre has no pitch there
        return {
            place: local_pitch(self.pitch, self.arguments["loop_period"], ratio, time)
            for place, ratio in ratios.items()
            if ratio > 0
        }

    def radius_of_curvature(self, share: ArrayLike) -> Floats:
        return involute_radius(self.arguments["diameter"], self.arguments["turns"], self.pitch, share)
