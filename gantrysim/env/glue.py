"""Glue laid by a pressure through a needle while its viscosity drifts, and the camera that measures the bead; compiled.

The bead is measured in pieces of its length. A piece with the volume V and the length l has the cross-section V / l;
the width of a sessile bead goes with its root.
"""

# mypy: allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit
from gantrysim.machine.row import Log

PIECE = 0.5  # length of the pieces [mm]
PIECES = 64  # of the bead that are kept, more than lie between nozzle and camera

# state of a bead: pressure over the nominal one, laid length and volume of the current piece, number of finished pieces
STATE = ("pressure", "length", "volume", "pieces")
_PRESSURE = STATE.index("pressure")
_LENGTH = STATE.index("length")
_VOLUME = STATE.index("volume")
_FINISHED = STATE.index("pieces")

# an interval: finished pieces, sum of squared width errors, the largest, pieces out of tolerance; pieces that the
# camera saw, and the sum of the errors that it measured
SUMS = ("pieces", "square", "largest", "outside", "seen", "seen_error")
_PIECES = SUMS.index("pieces")
_SQUARE = SUMS.index("square")
_LARGEST = SUMS.index("largest")
_OUTSIDE = SUMS.index("outside")
_SEEN = SUMS.index("seen")
_SEEN_ERROR = SUMS.index("seen_error")


class Program(NamedTuple):
    """Speed and pressure of the program.

    Attributes:
        speeds: commanded path speed after each setpoint, (n,) [mm/s].
        reference: v0 [mm/s].
        override: u.
        period: servo period [s].
    """

    speeds: Floats
    reference: float
    override: float
    period: float


class Glue(NamedTuple):
    """Glue and needle of an episode, in the letters of `lay`.

    Attributes:
        viscosity: f0.
        warming: w.
        warming_time: tw [s].
        clog: k.
        clog_time: time of the clog [s].
        lag: T [s].
        flow_index: n.
    """

    viscosity: float
    warming: float
    warming_time: float
    clog: float
    clog_time: float
    lag: float
    flow_index: float


class Camera(NamedTuple):
    """The camera that measures the bead.

    Attributes:
        behind: pieces between nozzle and camera.
        noise: relative, one per piece, taken in turns, (k,).
        tolerance: of the width, relative.
    """

    behind: int
    noise: Floats
    tolerance: float


class BeadState(NamedTuple):
    """The bead laid so far, updated in place.

    Attributes:
        state: see `STATE`.
        ring: width errors of the last pieces, relative, (PIECES,).
        sums: of the interval, see `SUMS`; written.
    """

    state: Floats
    ring: Floats
    sums: Floats


@jit
def lay(log: Log, ticks: tuple[int, int], program: Program, glue: Glue, camera: Camera, bead: BeadState) -> None:
    """Lay the glue of some ticks.

    The program asks for the pressure p = u (v / v0)^n, over the nominal one, with the commanded speed v; with the
    nominal glue, and at rest of the lag, that lays one and the same cross-section at every speed. The pressure follows
    with a time constant T, and the flow is, over the nominal one at the speed v0,

        Q = c (p / f)^(1/n),  f = f0 w^(1 - exp(-t / tw)),  c = 1 before, and k from the time of the clog on.

    Args:
        log: the servo's, see `gantrysim.machine.row.Log`.
        ticks: the first, and the one after the last.
        program: of the motion.
        glue: of the episode.
        camera: that measures the bead.
        bead: laid so far.
    """
    state, ring, sums = bead
    reference = program.reference
    period = program.period
    index = glue.flow_index
    sums[:] = 0.0
    for k in range(max(ticks[0], 1), ticks[1]):
        tip = log.tick[k].nozzle
        before = log.tick[k - 1].nozzle
        if not np.isfinite(tip).all():  # of a machine that a fault has torn apart
            continue
        time = k * period
        request = program.override * (program.speeds[log.tick[k - 1].setpoint] / reference) ** index
        state[_PRESSURE] += (request - state[_PRESSURE]) * -np.expm1(-period / glue.lag)
        thickness = glue.viscosity * glue.warming ** -np.expm1(-time / glue.warming_time)
        opening = glue.clog if time >= glue.clog_time else 1.0
        flow = opening * (state[_PRESSURE] / thickness) ** (1 / index)
        state[_LENGTH] += np.sqrt((tip[0] - before[0]) ** 2 + (tip[1] - before[1]) ** 2 + (tip[2] - before[2]) ** 2)
        state[_VOLUME] += flow * reference * period
        if state[_LENGTH] < PIECE:
            continue
        error = np.sqrt(state[_VOLUME] / state[_LENGTH]) - 1.0
        finished = int(state[_FINISHED])
        ring[finished % PIECES] = error
        state[_LENGTH] = 0.0
        state[_VOLUME] = 0.0
        state[_FINISHED] = finished + 1
        sums[_PIECES] += 1
        sums[_SQUARE] += error * error
        sums[_LARGEST] = max(sums[_LARGEST], abs(error))
        sums[_OUTSIDE] += abs(error) > camera.tolerance
        if finished >= camera.behind:
            piece = finished - camera.behind
            sums[_SEEN] += 1
            sums[_SEEN_ERROR] += ring[piece % PIECES] + camera.noise[piece % camera.noise.size]
