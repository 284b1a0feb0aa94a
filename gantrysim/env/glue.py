"""Glue laid by a pressure through a needle while its viscosity drifts, and the camera that measures the bead; compiled.

The bead is measured in pieces of its length. A piece with the volume V and the length l has the cross-section V / l;
the width of a sessile bead goes with its root.
"""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numba
import numpy as np
from numba import types

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit
from gantrysim.engine.native.pointers import floats_at, log_of, pointer, row_at
from gantrysim.engine.native.stages import compiled_stage
from gantrysim.env.interval import MEASURED_SPAN, measure_interval
from gantrysim.machine.row import Log

PIECE = 0.5  # length of the pieces [mm]
PIECES = 64  # of the bead that are kept, more than lie between nozzle and camera
NOISES = 1024  # values of the camera's noise, which it takes in turns

# the bead at the nozzle
BEAD = np.dtype(
    [
        ("pressure", np.float64),  # over the nominal one
        ("length", np.float64),  # of the current piece, laid so far [mm]
        ("volume", np.float64),  # of it [mm³]
        ("finished", np.int64),  # number of finished pieces
        ("errors", np.float64, (PIECES,)),  # of the width of the last of them, relative, taken in turns
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


# what is laid at a place in an interval, with addresses of arrays
LAYING = np.dtype(
    [
        ("span", np.int64),  # address of the `MEASURED_SPAN` of the interval
        ("speeds", np.int64),  # address of the speeds of `Program`
        ("flow", np.int64),  # address of the flow of `LaidBead`
        ("noise", np.int64),  # address of the noise of `Camera`, (NOISES,)
        ("reference", np.float64),  # as of `Program`
        ("override", np.float64),
        *((name, np.float64) for name in Glue._fields),
        ("behind", np.int64),  # as of `Camera`
        ("tolerance", np.float64),
        ("before", BEAD),  # the interval, unchanged, as MuJoCo's steps may be taken back and made again
        ("after", BEAD),  # it, to be written
        ("widths", WIDTHS),  # as of `LaidBead`
        ("sight", SIGHT),
    ]
)
_LAYING = numba.from_dtype(LAYING)
_MEASURED_SPAN = numba.from_dtype(MEASURED_SPAN)
_FLOAT = types.float64


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
        widths: of the interval, of `WIDTHS`; written.
        sight: of the interval, of `SIGHT`; written.
        flow: over the period after each tick, over the nominal one at the speed v0, (n,).
    """

    bead: Any
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
    bead, widths, sight, flows = laid
    errors = bead.errors
    reference = program.reference
    period = program.period
    index = glue.flow_index
    widths.pieces = 0.0
    widths.square = 0.0
    widths.largest = 0.0
    widths.outside = 0.0
    sight.pieces = 0.0
    sight.error = 0.0
    follows = -np.expm1(-period / glue.lag)
    for k in range(max(ticks[0], 1), ticks[1]):
        tip = log.tick[k].nozzle
        before = log.tick[k - 1].nozzle
        # of a machine that a fault has torn apart
        if not np.isfinite(tip).all():
            continue
        time = k * period
        request = program.override * (program.speeds[log.tick[k - 1].setpoint] / reference) ** index
        bead.pressure += (request - bead.pressure) * follows
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


@cache
def laying_stage() -> int:
    """Return the address of a C function that measures an interval and lays its glue; its argument is that of `LAYING`.

    It is the observer of a servo's row, as is that of `gantrysim.env.interval.measuring_stage`.
    """

    def stage(address, argument):
        laying = numba.carray(pointer(argument, _LAYING), (1,))[0]
        row = row_at(address)
        span = numba.carray(pointer(laying.span, _MEASURED_SPAN), (1,))[0]
        measure_interval(row, span)
        _lay_interval(row, span, laying)

    return compiled_stage(stage)


@jit
def _lay_interval(row: Any, span: Any, laying: Any) -> None:
    """Lay the glue of the ticks of a servo's row since `before`, and write the bead after them."""
    before = laying.before
    after = laying.after
    after.pressure = before.pressure
    after.length = before.length
    after.volume = before.volume
    after.finished = before.finished
    for k in range(PIECES):
        after.errors[k] = before.errors[k]
    program = Program(floats_at(laying.speeds), laying.reference, laying.override, row.period)
    noise = numba.carray(pointer(laying.noise, _FLOAT), (NOISES,))
    camera = Camera(laying.behind, noise, laying.tolerance)
    laid = LaidBead(after, laying.widths, laying.sight, floats_at(laying.flow))
    lay(log_of(row), (span.before.tick, row.tick), program, laying, camera, laid)
