"""Payload that changes during an episode, and inertia estimated from torque commands."""

# mypy: allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit
from gantrysim.engine.native.pointers import log_of, row_at, rows_at
from gantrysim.env.episodes import Episode
from gantrysim.env.friction import Changing, model_torques
from gantrysim.env.ranges import NOT_NEGATIVE, RandomValue
from gantrysim.machine.perturbation import Perturbation
from gantrysim.machine.row import Log

MOST_PAYLOAD = 4.0  # payload after a change [kg]


class Motion(NamedTuple):
    """Motion of the setpoints.

    Attributes:
        sliding: torque of the nominal friction, (n, axes) [N·m].
        moved: dDPOS, (n, axes) [mm or deg].
    """

    sliding: Floats
    moved: Floats


@dataclass(frozen=True, eq=False)
class PayloadEpisode(Episode):
    """An episode with the motion for the fit of its inertia."""

    motion: Motion


class ChangingPayload(Changing):
    """Source of episodes whose payload is another one from some moment on."""

    values: ClassVar[Mapping[str, RandomValue]] = {
        "payload_later": RandomValue(
            0.0, (0.0, MOST_PAYLOAD), (MOST_PAYLOAD, 1.5 * MOST_PAYLOAD), (0.0, 10.0), "kg", "payload after the change"
        ),
        "payload_time": RandomValue(0.7, (0.2, 1.2), (0.2, 0.6), NOT_NEGATIVE, "s", "time of the change"),
    }
    moment: ClassVar[str] = "payload_time"
    looks_ahead: ClassVar[bool] = True

    def change(self, drawn: Mapping[str, float]) -> Perturbation:
        return Perturbation(payload=drawn["payload_later"] - drawn.get("payload_kg", 0.0))

    def episode(self, drawn: Mapping[str, float]) -> PayloadEpisode:
        episode = super().episode(drawn)
        position = episode.simulation.position
        sliding, _ = model_torques(self.machine.axes, position, self.servo.period)
        moved = np.diff(position, axis=0, prepend=position[:1])
        return PayloadEpisode(**episode.parts(), motion=Motion(sliding, moved))


# of the fit, by axis: sums of products of torques of inertia J, of friction F, and of the demand without viscous
# friction D, and these three after the low pass
SUMS = np.dtype([(name, np.float64) for name in ("JJ", "JF", "FF", "JD", "FD", "J", "F", "D")])


class Nominal(NamedTuple):
    """What resists the motion of the nominal axes.

    Attributes:
        inertia: inertia / T², (axes,) [N·m/mm].
        viscous: viscous / T, (axes,) [N·m/mm].
    """

    inertia: Floats
    viscous: Floats


class Decay(NamedTuple):
    """What is left after a tick, exp(-T/tau): of the low pass, and of the sums."""

    smooth: float
    forget: float


@jit
def fit(
    log: Log, ticks: tuple[int, int], motion: Motion, nominal: Nominal, decay: Decay, sums: NDArray[np.void]
) -> None:
    """Add ticks to the least squares, which forget exponentially, of inertia and friction in the torque demand.

        L(demand - viscous dDPOS/T) = r L(inertia ddMPOS/T²) + h L(sliding)

    L is a low pass of first order, for the second difference of encoder counts is coarse. That is taken about one tick,
    the demand at the tick before, which acts by then, friction at that tick. An axis at rest adds and forgets nothing.

    Args:
        log: the servo's, see `gantrysim.machine.row.Log`.
        ticks: the first, and the one after the last.
        motion: of the setpoints.
        nominal: what resists it.
        decay: of what is filtered and summed.
        sums: (axes,) of `SUMS`, to be updated.
    """
    sliding, moved = motion
    smooth, forget = decay
    for k in range(max(ticks[0], 2), ticks[1]):
        setpoint = log.tick[k - 1].setpoint
        for a in range(len(sums)):
            if moved[setpoint, a] == 0.0:
                continue
            total = sums[a]
            change = log.axis[k, a].encoder - 2 * log.axis[k - 1, a].encoder + log.axis[k - 2, a].encoder
            demand = log.axis[k - 2, a].demand - nominal.viscous[a] * moved[setpoint, a]
            total.J += (1 - smooth) * (nominal.inertia[a] * change - total.J)
            total.F += (1 - smooth) * (sliding[setpoint, a] - total.F)
            total.D += (1 - smooth) * (demand - total.D)
            j = total.J
            f = total.F
            d = total.D
            total.JJ = forget * total.JJ + j * j
            total.JF = forget * total.JF + j * f
            total.FF = forget * total.FF + f * f
            total.JD = forget * total.JD + j * d
            total.FD = forget * total.FD + f * d


# motion of a place of a batch, with the addresses of arrays
MOTIONS = np.dtype(
    [
        ("row", np.int64),  # address of the servo's row
        ("sliding", np.int64),  # address of the torques of `Motion`
        ("moved", np.int64),  # address of its steps
    ]
)


@jit
def fit_at_places(
    places: NDArray[np.intp],
    ticks: tuple[NDArray[np.int64], NDArray[np.int64]],
    motions: NDArray[np.void],
    nominal: Nominal,
    decay: Decay,
    sums: NDArray[np.void],
) -> None:
    """Add ticks to the least squares at places of a batch, see `fit`.

    Args:
        places: numbers of the places, (n,).
        ticks: the first at each of them, and the one after the last, (n,) each.
        motions: of the batch, of `MOTIONS`.
        nominal: as of one place.
        decay: as of one place.
        sums: of the batch, (places of the batch, axes) of `SUMS`.
    """
    firsts, lasts = ticks
    for k in range(len(places)):
        here = motions[places[k]]
        row = row_at(here.row)
        motion = Motion(rows_at(here.sliding, row.ticks, row.axes), rows_at(here.moved, row.ticks, row.axes))
        fit(log_of(row), (firsts[k], lasts[k]), motion, nominal, decay, sums[places[k]])


@jit
def next_motion_at_places(
    places: NDArray[np.intp],
    firsts: NDArray[np.int64],
    interval: tuple[int, float],
    motions: NDArray[np.void],
    velocity: Floats,
    acceleration: Floats,
) -> None:
    """Write the mean velocity and acceleration over the next ticks at places of a batch, see `next_motion`.

    Args:
        places: numbers of the places, (n,).
        firsts: number of the next setpoint at each place of the batch.
        interval: number of ticks, and the servo period [s].
        motions: of the batch, of `MOTIONS`.
        velocity: of the batch, (places of the batch, axes).
        acceleration: likewise.
    """
    count, period = interval
    for place in places:
        row = row_at(motions[place].row)
        position = rows_at(row.setpoints, row.ticks, row.axes)
        next_motion(position, (firsts[place], count), period, velocity[place], acceleration[place])


def ratios(sums: NDArray[np.void]) -> tuple[Floats, Floats]:
    """Return r of each axis, and the r that all axes have in common, each axis with its own h.

    Args:
        sums: (..., axes) of `SUMS`, with JJ FF > JF².

    Returns:
        Ratios of the inertia to the nominal one, (..., axes) and (...,).
    """
    above = sums["JD"] - sums["JF"] * sums["FD"] / sums["FF"]
    below = sums["JJ"] - sums["JF"] * sums["JF"] / sums["FF"]
    return above / below, above.sum(axis=-1) / below.sum(axis=-1)


@jit
def next_motion(
    position: Floats, ticks: tuple[int, int], period: float, velocity: Floats, acceleration: Floats
) -> None:
    """Write the mean velocity and acceleration over the next ticks, at the end of the episode those of its last one.

    Args:
        position: setpoints, (n, axes) [mm or deg].
        ticks: the first, and their number.
        period: servo period [s].
        velocity: (axes,), to be written [mm/s or deg/s].
        acceleration: (axes,), to be written [mm/s² or deg/s²].
    """
    first, count = ticks
    begin = min(max(first - 1, 1), len(position) - 1)
    end = min(max(first + count - 1, 1), len(position) - 1)
    time = max(end - begin, 1) * period
    for a in range(position.shape[1]):
        velocity[a] = (position[end, a] - position[begin, a]) / time
        first_step = position[begin, a] - position[begin - 1, a]
        last_step = position[end, a] - position[end - 1, a]
        acceleration[a] = (last_step - first_step) / period / time
