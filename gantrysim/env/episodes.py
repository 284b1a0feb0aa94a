"""Episodes: a random spiral, or the path of a job, on a random machine."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from gantrysim.arrays import Floats
from gantrysim.controllers.paths.spirals import Involute
from gantrysim.controllers.profile import PointToPoint
from gantrysim.controllers.servo import Servo
from gantrysim.controllers.setpoints import Setpoints
from gantrysim.engine.simulation import Simulation
from gantrysim.env.settings import Settings
from gantrysim.errors import InputError
from gantrysim.job.job import Job
from gantrysim.machine.dispenser import Dispenser
from gantrysim.machine.machine import Machine

TUNED_GAINS = ("kp", "kd", "velocity_ff", "acceleration_ff")  # set by the agent, in the order of the action
SCALED = ("ki", *TUNED_GAINS)  # scaled by the action: ki with kp, so that the integral time stays

_SPIRAL = ("diameter", "thickness", "speed", "turns")
_BEAD = 2.0  # cross-section of the bead on a spiral [mm²]
_ROUNDING = 1e-9


def gain_factors(action: Floats, gain_range: float) -> dict[str, Floats]:
    """Return the factor on each gain of `SCALED`, of the shape of its action.

    Args:
        action: one row per gain of `TUNED_GAINS`, from -1 to 1, (gains, ...).
        gain_range: largest factor.
    """
    factors = dict(zip(TUNED_GAINS, gain_range ** np.asarray(action), strict=True))
    return {"ki": factors["kp"], **factors}


@dataclass(frozen=True, eq=False)
class Episode:
    """One episode, ready to run.

    Attributes:
        simulation: its setpoints on its machine.
        points: points along the requested path, evenly spaced but for the corners, (m, 3) [mm].
        spacing: their spacing [mm].
        drawn: values drawn for the path, by name.
    """

    simulation: Simulation
    points: Floats
    spacing: float
    drawn: dict[str, float]


@dataclass(frozen=True, eq=False)
class _Plan:
    """The path of an episode."""

    setpoints: Setpoints
    dispenser: Dispenser
    drawn: dict[str, float]

    @cached_property
    def points(self) -> tuple[Floats, float]:
        """Points along the requested path, with its corners, and their spacing."""
        path = self.setpoints.requested
        s, points = path.table
        if path.corners.size:
            points = np.insert(points, np.searchsorted(s, path.corners), path.position(path.corners), axis=0)
        return points, float(s[1])


class Source:
    """Source of random episodes.

    Args:
        settings: settings of the environment.

    Attributes:
        machine: the nominal machine.
        servo: the servo with an action of 0.
        ticks: servo periods between decisions; None for one decision per episode.

    Raises:
        InputError: an unknown job or machine, spirals that the machine cannot run, or a decision interval that is not a
            multiple of the servo period.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._job = Job.load(settings.job) if isinstance(settings.job, str) else settings.job
        if self._job is None:
            self.machine = Machine(settings.machine)
            servo = Servo.derive(self.machine.axes, **dict(settings.servo))
        else:
            self.machine, servo = self._job.built_machine, self._job.built_servo
        servo.check_torque("environment")
        lower: dict[str, Any] = {n: tuple(gain / settings.detune for gain in getattr(servo, n)) for n in SCALED}
        self.servo = replace(servo, **lower)
        self.ticks = self._ticks()
        self._fixed = self._fixed_plan()
        if self._job is None:
            self._check_room()

    def draw(self, random: np.random.Generator) -> Episode:
        """Return a random episode; it depends on the random numbers alone."""
        plan = self._fixed or self._drawn_plan(random)
        spread = self.settings.spread
        machine = self.machine if spread is None else self.machine.perturbed(spread.draw(random, self.machine))
        simulation = Simulation.of(
            machine,
            self.servo,
            plan.setpoints,
            physics_step=None if self._job is None else self._job.simulation.physics_step,
            dispenser=plan.dispenser,
            faults=() if self._job is None else self._job.faults,
        )
        return Episode(simulation, *plan.points, plan.drawn)

    def _fixed_plan(self) -> _Plan | None:
        """Return the path that all episodes share, or None if it is drawn."""
        if self._job is not None:
            return _Plan(self._job.setpoints, self._job.dispenser, {})
        bounds = [self.settings.between(name) for name in _SPIRAL]
        if any(low != high for low, high in bounds):
            return None
        diameter, thickness, speed, turns = (low for low, _ in bounds)
        return self._spiral(diameter, thickness, speed, int(turns))

    def _drawn_plan(self, random: np.random.Generator) -> _Plan:
        diameter, thickness, speed = (float(random.uniform(*self.settings.between(name))) for name in _SPIRAL[:3])
        fewest, most = self.settings.between("turns")
        return self._spiral(diameter, thickness, speed, int(random.integers(int(fewest), int(most) + 1)))

    def _spiral(self, diameter: float, thickness: float, speed: float, turns: int) -> _Plan:
        turns = min(turns, int(0.5 * diameter / thickness - 1 + _ROUNDING))
        path = Involute(0.5 * diameter, thickness, turns, start=(-0.5 * diameter, 0.0))
        profile = PointToPoint(path.length, speed, self.settings.acceleration)
        setpoints = Setpoints.along(path, profile, self.servo.period)
        drawn = {"diameter": diameter, "thickness": thickness, "speed": speed, "turns": turns}
        return _Plan(setpoints, Dispenser(flow=_BEAD * speed), drawn)

    def _check_room(self) -> None:
        """Raise InputError unless the machine can run the largest and fastest spirals: training must not stop later."""
        if self.machine.turns_work:
            raise InputError(
                f"machine {self.machine.name} turns its work, but spirals need a work that does not turn: "
                "give a job or another machine"
            )
        diameter, thickness, speed, turns = (self.settings.between(name) for name in _SPIRAL)
        for distance in thickness:
            plan = self._spiral(diameter[1], distance, speed[1], int(turns[1]))
            Simulation.of(self.machine, self.servo, plan.setpoints, dispenser=plan.dispenser)

    def _ticks(self) -> int | None:
        interval, period = self.settings.decision_interval, self.servo.period
        if interval == np.inf:
            return None
        ticks = round(interval / period)
        if ticks < 1 or abs(ticks * period - interval) > _ROUNDING:
            raise InputError(
                f"decision_interval = {interval:g} s: must be a multiple of the servo period, {period:g} s"
            )
        return ticks
