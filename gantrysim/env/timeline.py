"""Settings and episodes of SpeedOverride-v1: setpoints that are written while an episode goes on."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from gantrysim.base import memory
from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, at_least, positive
from gantrysim.base.jit import jit
from gantrysim.engine.recording import LogBook
from gantrysim.engine.simulation import Simulation
from gantrysim.env.episodes import Plan
from gantrysim.env.friction import ChangingFriction
from gantrysim.env.settings import Bounds, PathSettings
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.machine.machine import Machine
from gantrysim.record.setpoints import Setpoints

_BEAD = 2.0  # cross-section of the bead [mm²]


class SpeedOverrideSettings(PathSettings):
    """Settings of `SpeedOverrideEnv`: those of `PathSettings`, and of action and reward.

    Attributes:
        override: override of the speed at the start of an episode.
        step: largest change of the logarithm of the override at a decision.
        slowest: smallest override.
        fastest: largest override.
        weight: loss of a bead that exceeds the tolerance by one tolerance everywhere, in nominal durations.
        worst: largest excess over the tolerance that counts [tolerances].
        progress: reward of the whole path, paid in proportion to the path commanded, in nominal durations.

    Raises:
        InputError: a value out of bounds.
    """

    diameter: Bounds = (36.0, 60.0)
    turns: Bounds = (1, 2)
    thickness: Bounds = (6.0, 9.0)
    speed: Bounds = (60.0, 120.0)
    acceleration: float = 2000.0
    decision_interval: float = 0.02
    tolerance: float = 0.01
    override: float = 1.0
    step: float = 0.5
    slowest: float = 0.03
    fastest: float = 2.0
    weight: float = 10.0
    worst: float = 5.0
    progress: float = 6.0

    def model_post_init(self, context: Any) -> None:
        """Raise InputError for values out of bounds."""
        super().model_post_init(context)
        if self.decision_interval == math.inf:
            raise InputError("decision_interval = inf s: must be finite, for the speed changes within an episode")
        for name in ("override", "step", "slowest", "fastest", "weight", "worst"):
            positive(name, getattr(self, name))
        at_least("progress", self.progress, 0)
        if not self.slowest <= self.override <= self.fastest:
            raise InputError(f"override = {self.override:g}: must be from {self.slowest:g} to {self.fastest:g}")


class SpeedOverrideSource(ChangingFriction):
    """Source of episodes whose setpoints are still to be written, and whose friction changes at some moment."""

    settings: SpeedOverrideSettings

    def _simulation(self, machine: Machine, plan: Plan) -> Simulation:
        """Return a simulation that rests at the start of the path, with room for the setpoints of an episode."""
        asked = plan.setpoints
        if self._job is not None and (asked.requested.corners.size or not set(asked.axes) <= set("xyz")):
            raise InputError(
                f"the path of job {self._job.name} has {asked.requested.corners.size} corners and the axes "
                f"{', '.join(asked.axes)}: must have no corners, and axes of x, y and z alone, for its speed to change"
            )
        super()._simulation(machine, plan)  # checks travel, and the speed of the program
        count = self._room(asked.requested.length, self.program_speed(plan.drawn))
        position = np.repeat(asked.requested.position(0.0)[:, : len(asked.axes)], count, axis=0)
        setpoints = Setpoints(
            period=self.servo.period,
            axes=asked.axes,
            position=position,
            dispense=np.ones(count, bool),
            requested=asked.requested,
            progress=np.zeros(count),
        )
        simulation = Simulation.of(machine, self.servo, setpoints, dispenser=Dispenser(area=_BEAD))
        position = simulation.position.copy()  # to be written as the episode goes on
        book = LogBook(machine, setpoints, position, simulation.dispenser, drives=simulation.drives)
        return replace(simulation, position=position, book=book)

    def _room(self, length: float, speed: float) -> int:
        """Return the number of setpoints of the slowest episode, a multiple of those of an interval."""
        settings = self.settings
        interval = self.ticks or 1
        ramps = 2 * settings.fastest * speed / settings.acceleration
        longest = length / (settings.slowest * speed) + ramps
        count = math.ceil(longest / self.servo.period / interval + 1) * interval
        if count > memory.LONG:
            raise InputError(
                f"slowest = {settings.slowest:g}: {length:.4g} mm at {settings.slowest * speed:.4g} mm/s take {count} "
                f"servo ticks, at most {memory.LONG}; use a larger value"
            )
        return count

    @cached_property
    def most_ticks(self) -> int:
        if self._fixed is not None:
            return self._room(self._fixed.setpoints.requested.length, self.program_speed({}))
        slowest = self.settings.between("speed")[0]
        plan = self._spiral(
            diameter=self.settings.between("diameter")[1],
            thickness=self.settings.between("thickness")[0],
            speed=slowest,
            turns=int(self.settings.between("turns")[1]),
        )
        return self._room(plan.setpoints.requested.length, slowest)

    def program_speed(self, drawn: Mapping[str, float]) -> float:
        """Return the program's speed in an episode with these values [mm/s]."""
        if self._fixed is None:
            return drawn["speed"]
        asked = self._fixed.setpoints
        steps = np.linalg.norm(np.diff(asked.position, axis=0), axis=1)
        return float(np.median(steps[asked.dispense[:-1]])) / asked.period


@jit
def move(
    state: tuple[float, float], target: float, length: float, acceleration: float, period: float, way: Floats
) -> tuple[float, float]:
    """Move along a path towards a speed, with limited acceleration, such that the path ends at rest.

    Args:
        state: arc length [mm] and speed [mm/s].
        target: speed wanted [mm/s].
        length: of the path [mm].
        acceleration: limit, in both directions [mm/s²].
        period: servo period [s].
        way: arc lengths after each period, (n,), to be written.

    Returns:
        Arc length and speed after the last period.
    """
    s, v = state
    most = acceleration * period
    for k in range(way.size):
        # after this period at v, what remains must suffice to stop: v period + v² / 2a <= length - s
        stop = most * (np.sqrt(0.25 + 2 * (length - s) / (most * period)) - 0.5)
        v = max(min(min(max(target, v - most), v + most), stop), 0.0)
        s = min(s + v * period, length)
        if length - s < 1e-6 * length:
            s = length
            v = 0.0
        way[k] = s
    return s, v
