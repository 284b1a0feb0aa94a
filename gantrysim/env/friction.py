"""Friction that changes during an episode: torque of the nominal model, and level estimated from torque commands."""

# mypy: allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.base.jit import jit
from gantrysim.engine.injection import Change
from gantrysim.env.episodes import Episode, Source
from gantrysim.env.ranges import NOT_NEGATIVE, POSITIVE, RandomValue
from gantrysim.env.settings import PathSettings
from gantrysim.machine.axis import Axis
from gantrysim.machine.perturbation import Perturbation
from gantrysim.machine.row import Log
from gantrysim.servo.laws.friction import friction_torque

# of the fit, by axis: N and D of `fit`
SUMS = np.dtype([("numerator", np.float64), ("denominator", np.float64)])

_friction_torque = jit(friction_torque)


class Changing(Source):
    """Source of episodes whose machine changes at some moment.

    Raises:
        InputError: as by `Source`, or a job with a stuck axis, which changes the machine too.
    """

    moment: ClassVar[str]  # name of the time at which it does, among the values drawn [s]

    def __init__(self, settings: PathSettings, detune: float = 1.0) -> None:
        super().__init__(settings, detune)
        if self._fixed is not None and self._simulation(self.machine, self._fixed).later:
            raise InputError(
                "environment: the job has a stuck axis, but this task changes the machine itself: leave it out"
            )

    def change(self, drawn: Mapping[str, float]) -> Perturbation:
        """Return the perturbation from that moment on, relative to the machine of the episode."""
        raise NotImplementedError

    def episode(self, drawn: Mapping[str, float]) -> Episode:
        episode = super().episode(drawn)
        simulation = episode.simulation
        machine = simulation.machine
        changed = machine.perturbed(self.change(drawn))
        interval = simulation.substeps * (self.ticks or 1)
        begin = max(round(drawn[self.moment] / self.settings.decision_interval), 1) * interval
        return replace(episode, simulation=replace(simulation, later=(Change(begin, changed),)))


class ChangingFriction(Changing):
    """Source of episodes whose friction changes by a factor at some moment."""

    values: ClassVar[Mapping[str, RandomValue]] = {
        "friction_change": RandomValue(1.0, (0.6, 1.6), (1.6, 2.4), POSITIVE, "1", "factor on the friction"),
        "friction_time": RandomValue(2.0, (0.5, 4.0), (0.25, 2.0), NOT_NEGATIVE, "s", "time from which it acts"),
    }
    moment: ClassVar[str] = "friction_time"

    def change(self, drawn: Mapping[str, float]) -> Perturbation:
        return Perturbation(friction=drawn["friction_change"])


def model_torques(axes: tuple[Axis, ...], position: Floats, period: float) -> tuple[Floats, Floats]:
    """Return the torques of friction and of inertia with viscous friction by the nominal model, (n, axes) each [N·m].

    Args:
        axes: of the nominal machine.
        position: setpoints, (n, axes) [mm or deg].
        period: servo period [s].
    """
    velocity = np.diff(position, axis=0, prepend=position[:1]) / period
    acceleration = np.diff(velocity, axis=0, prepend=velocity[:1]) / period
    inertia, viscous = np.array([(axis.inertia, axis.viscous) for axis in axes]).T
    sliding = np.zeros(position.shape)
    for a, axis in enumerate(axes):
        _fill(velocity[:, a].copy(), period, tuple(axis.friction), sliding[:, a])
    return sliding, inertia * acceleration + viscous * velocity


@jit
def _fill(velocity: Floats, period: float, friction: tuple[float, ...], torque: Floats) -> None:
    last = 0.0
    for k in range(velocity.size):
        last = _friction_torque(last, velocity[k], velocity[k] * period, friction)
        torque[k] = last


@jit
def fit(
    log: Log, ticks: tuple[int, int], sliding: Floats, moving: Floats, forget: float, sums: NDArray[np.void]
) -> None:
    """Estimate the level h of the friction by least squares that forget exponentially.

        demand - moving = h sliding,    h = N / D,    N <- N exp(-T/tau) + sliding (demand - moving), D likewise

    Args:
        log: the servo's, see `gantrysim.machine.row.Log`.
        ticks: the first, and the one after the last.
        sliding: torque of the nominal friction, one row per setpoint, (n, axes) [N·m].
        moving: torque of inertia and viscous friction, (n, axes) [N·m].
        forget: exp(-T/tau).
        sums: N and D, (axes,) of `SUMS`, to be updated.
    """
    for k in range(ticks[0], ticks[1]):
        setpoint = log.tick[k].setpoint
        for a in range(len(sums)):
            regressor = sliding[setpoint, a]
            total = sums[a]
            answer = log.axis[k, a].demand - moving[setpoint, a]
            total.numerator = forget * total.numerator + regressor * answer
            total.denominator = forget * total.denominator + regressor * regressor


@jit
def next_means(position: Floats, sliding: Floats, ticks: tuple[int, int], step: Floats, friction: Floats) -> None:
    """Write the means over the next ticks, at the end of the episode over its last one.

    Args:
        position: setpoints, (n, axes) [mm or deg].
        sliding: torque of the nominal friction, (n, axes) [N·m].
        ticks: the first, and their number.
        step: motion in a tick, (axes,), to be written [mm or deg].
        friction: torque of the nominal friction, (axes,), to be written [N·m].
    """
    first, count = ticks
    for a in range(position.shape[1]):
        way = 0.0
        torque = 0.0
        for k in range(first, first + count):
            tick = min(max(k, 1), len(position) - 1)
            way += position[tick, a] - position[tick - 1, a]
            torque += sliding[tick, a]
        step[a] = way / count
        friction[a] = torque / count
