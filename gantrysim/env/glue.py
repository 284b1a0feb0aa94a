"""Glue laid by a pressure through a needle while its viscosity drifts, and the camera that measures the bead; compiled.

The bead is measured in pieces of its length. A piece with the volume V and the length l has the cross-section V / l;
the width of a sessile bead goes with its root.
"""

# mypy: allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit
from gantrysim.engine.native.pointers import floats_at, log_of, row_at
from gantrysim.machine.row import Log

PIECE = 0.5  # length of the pieces [mm]
PIECES = 64  # of the bead that are kept, more than lie between nozzle and camera

# the bead at the nozzle
BEAD = np.dtype(
    [
        ("pressure", np.float64),  # over the nominal one
        ("length", np.float64),  # of the current piece, laid so far [mm]
        ("volume", np.float64),  # of it [mm³]
        ("finished", np.int64),  # number of finished pieces
    ]
)

# widths of the pieces that are finished in an interval or an episode
WIDTHS = np.dtype(
    [
        ("pieces", np.float64),
        ("square", np.float64),  # sum of squared relative errors
        ("largest", np.float64),  # of their magnitudes
        ("outside", np.float64),  # pieces out of tolerance
    ]
)

# what the camera measures in an interval
SIGHT = np.dtype(
    [
        ("pieces", np.float64),  # that it saw
        ("error", np.float64),  # sum of the relative errors that it measured
    ]
)


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


# what is laid at a place of a batch: program and glue of its episode, with addresses of arrays
LAYING = np.dtype(
    [
        ("row", np.int64),  # address of the servo's row, whose log is read
        ("speeds", np.int64),  # address of the speeds of `Program`
        ("flow", np.int64),  # address of the flow of `LaidBead`
        ("reference", np.float64),  # as of `Program`
        ("override", np.float64),
        *((name, np.float64) for name in Glue._fields),
    ]
)


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


class LaidBead(NamedTuple):
    """The bead laid so far, updated in place.

    Attributes:
        bead: at the nozzle, of `BEAD`.
        errors: of the width of the last pieces, relative, taken in turns, (PIECES,).
        widths: of the interval, of `WIDTHS`; written.
        sight: of the interval, of `SIGHT`; written.
        flow: over the period after each tick, over the nominal one at the speed v0, (n,).
    """

    bead: Any
    errors: Floats
    widths: Any
    sight: Any
    flow: Floats


@jit
def lay(log: Log, ticks: tuple[int, int], program: Program, glue: Glue, camera: Camera, laid: LaidBead) -> None:
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
        laid: bead laid so far.
    """
    bead, errors, widths, sight, flows = laid
    reference = program.reference
    period = program.period
    index = glue.flow_index
    widths.pieces = 0.0
    widths.square = 0.0
    widths.largest = 0.0
    widths.outside = 0.0
    sight.pieces = 0.0
    sight.error = 0.0
    for k in range(max(ticks[0], 1), ticks[1]):
        tip = log.tick[k].nozzle
        before = log.tick[k - 1].nozzle
        # of a machine that a fault has torn apart
        if not np.isfinite(tip).all():
            continue
        time = k * period
        request = program.override * (program.speeds[log.tick[k - 1].setpoint] / reference) ** index
        bead.pressure += (request - bead.pressure) * -np.expm1(-period / glue.lag)
        thickness = glue.viscosity * glue.warming ** -np.expm1(-time / glue.warming_time)
        opening = glue.clog if time >= glue.clog_time else 1.0
        flow = opening * (bead.pressure / thickness) ** (1 / index)
        flows[k - 1] = flow
        bead.length += np.sqrt((tip[0] - before[0]) ** 2 + (tip[1] - before[1]) ** 2 + (tip[2] - before[2]) ** 2)
        bead.volume += flow * reference * period
        if bead.length < PIECE:
            continue
        error = np.sqrt(bead.volume / bead.length) - 1.0
        finished = bead.finished
        errors[finished % PIECES] = error
        bead.length = 0.0
        bead.volume = 0.0
        bead.finished = finished + 1
        widths.pieces += 1
        widths.square += error * error
        widths.largest = max(widths.largest, abs(error))
        widths.outside += abs(error) > camera.tolerance
        if finished >= camera.behind:
            piece = finished - camera.behind
            sight.pieces += 1
            sight.error += errors[piece % PIECES] + camera.noise[piece % camera.noise.size]


@jit
def lay_at_places(
    places: NDArray[np.intp],
    ticks: tuple[NDArray[np.int64], NDArray[np.int64]],
    period: float,
    laying: NDArray[np.void],
    cameras: Camera,
    laid: LaidBead,
) -> None:
    """Lay the glue of some ticks at places of a batch, see `lay`.

    Args:
        places: numbers of the places, (n,).
        ticks: the first at each of them, and the one after the last, (n,) each.
        period: servo period [s].
        laying: what is laid at each place of the batch, of `LAYING`.
        cameras: as of one place, but the noise has a row for each.
        laid: as of one place, with a row for each; its flow is not used.
    """
    firsts, lasts = ticks
    for k in range(len(places)):
        place = places[k]
        here = laying[place]
        program = Program(floats_at(here.speeds), here.reference, here.override, period)
        camera = Camera(cameras.behind, cameras.noise[place], cameras.tolerance)
        bead = LaidBead(
            laid.bead[place], laid.errors[place], laid.widths[place], laid.sight[place], floats_at(here.flow)
        )
        lay(log_of(row_at(here.row)), (firsts[k], lasts[k]), program, here, camera, bead)
