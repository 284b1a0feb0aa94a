"""Friction that changes during an episode: torque of the nominal model, and level estimated from torque commands."""

# mypy: allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats, read_only_view
from gantrysim.base.errors import InputError
from gantrysim.base.jit import jit
from gantrysim.engine.injection import Change
from gantrysim.engine.native.pointers import log_of, row_at, rows_at
from gantrysim.env.episodes import Episode, Source
from gantrysim.env.ranges import NOT_NEGATIVE, POSITIVE_VALUES, RandomValue
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
        "friction_change": RandomValue(1.0, (0.6, 1.6), (1.6, 2.4), POSITIVE_VALUES, "1", "factor on the friction"),
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
    parameters = np.array([(*axis.friction, axis.inertia, axis.viscous) for axis in axes])
    sliding = np.empty(position.shape)
    moving = np.empty(position.shape)
    _fill(read_only_view(position), period, parameters, sliding, moving)
    return sliding, moving


@jit
def _fill(position: Floats, period: float, parameters: Floats, sliding: Floats, moving: Floats) -> None:
    for a in range(position.shape[1]):
        friction = (parameters[a, 0], parameters[a, 1], parameters[a, 2], parameters[a, 3])
        last = 0.0
        before = 0.0
        for k in range(len(position)):
            velocity = (position[k, a] - position[max(k - 1, 0), a]) / period
            last = _friction_torque(last, velocity, velocity * period, friction)
            sliding[k, a] = last
            moving[k, a] = parameters[a, 4] * ((velocity - before) / period) + parameters[a, 5] * velocity
            before = velocity


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


# torques of a place of a batch, with the addresses of arrays, (n, axes) each [N·m]
TORQUES = np.dtype(
    [
        ("row", np.int64),  # address of the servo's row
        ("sliding", np.int64),  # of the nominal friction
        ("moving", np.int64),  # of inertia and viscous friction
        ("given", np.int64),  # sent with the setpoints without an agent
        ("sent", np.int64),  # sent with the setpoints
    ]
)


@jit
def send_torques(
    places: NDArray[np.intp], torques: NDArray[np.void], firsts: NDArray[np.int64], count: int, level: Floats
) -> None:
    """Write the torques that are sent with the next setpoints at places of a batch.

    Args:
        places: numbers of the places.
        torques: of the batch, of `TORQUES`.
        firsts: number of the next setpoint at each place of the batch.
        count: number of setpoints.
        level: factor on the torque of the nominal friction, (places of the batch, axes).
    """
    for place in places:
        here = torques[place]
        row = row_at(here.row)
        sliding = rows_at(here.sliding, row.ticks, row.axes)
        given = rows_at(here.given, row.ticks, row.axes)
        sent = rows_at(here.sent, row.ticks, row.axes)
        for k in range(firsts[place], min(firsts[place] + count, row.ticks)):
            for a in range(row.axes):
                sent[k, a] = given[k, a] + level[place, a] * sliding[k, a]


@jit
def fit_at_places(
    places: NDArray[np.intp],
    ticks: tuple[NDArray[np.int64], NDArray[np.int64]],
    torques: NDArray[np.void],
    forget: float,
    sums: NDArray[np.void],
) -> None:
    """Estimate the level of the friction at places of a batch, see `fit`.

    Args:
        places: numbers of the places, (n,).
        ticks: the first at each of them, and the one after the last, (n,) each.
        torques: of the batch, of `TORQUES`.
        forget: as of one place.
        sums: of the batch, (places of the batch, axes) of `SUMS`.
    """
    firsts, lasts = ticks
    for k in range(len(places)):
        here = torques[places[k]]
        row = row_at(here.row)
        sliding = rows_at(here.sliding, row.ticks, row.axes)
        moving = rows_at(here.moving, row.ticks, row.axes)
        fit(log_of(row), (firsts[k], lasts[k]), sliding, moving, forget, sums[places[k]])


@jit
def next_means_at_places(
    places: NDArray[np.intp],
    firsts: NDArray[np.int64],
    count: int,
    torques: NDArray[np.void],
    step: Floats,
    friction: Floats,
) -> None:
    """Write the means over the next ticks at places of a batch, see `next_means`.

    Args:
        places: numbers of the places, (n,).
        firsts: number of the next setpoint at each place of the batch.
        count: number of ticks.
        torques: of the batch, of `TORQUES`.
        step: of the batch, (places of the batch, axes).
        friction: likewise.
    """
    for place in places:
        here = torques[place]
        row = row_at(here.row)
        position = rows_at(row.setpoints, row.ticks, row.axes)
        sliding = rows_at(here.sliding, row.ticks, row.axes)
        next_means(position, sliding, (firsts[place], count), step[place], friction[place])
