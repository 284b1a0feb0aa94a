"""Glue laid by a pressure through a needle while its viscosity drifts, and the camera that measures the bead; compiled.

The bead is measured in pieces of its length. A piece with the volume V and the length l has the cross-section V / l;
the width of a sessile bead goes with its root.
"""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

import numpy as np

from gantrysim.base.jit import jit

PIECE = 0.5  # length of the pieces [mm]
PIECES = 64  # of the bead that are kept, more than lie between nozzle and camera

# state of a bead: pressure over the nominal one, laid length and volume of the current piece, number of finished pieces
STATE = ("pressure", "length", "volume", "pieces")
# an interval: finished pieces, sum of squared width errors, the largest, pieces out of tolerance; pieces that the
# camera saw, and the sum of the errors that it measured
SUMS = ("pieces", "square", "largest", "outside", "seen", "seen_error")


@jit
def lay(log, first, last, speeds, reference, override, glue, behind, noise, tolerance, period, state, ring, sums):
    """Lay the glue of the ticks from `first` to before `last`.

    The program asks for the pressure p = u (v / v0)^n, over the nominal one, with the commanded speed v; with the
    nominal glue, and at rest of the lag, that lays one and the same cross-section at every speed. The pressure follows
    with a time constant T, and the flow is, over the nominal one at the speed v0,

        Q = c (p / f)^(1/n),  f = f0 w^(1 - exp(-t / tw)),  c = 1 before, and k from the time of the clog on.

    Args:
        log: the servo's, see `gantrysim.native.row.Log`.
        first: the first tick.
        last: the tick after the last.
        speeds: commanded path speed after each setpoint, (n,) [mm/s].
        reference: v0 [mm/s].
        override: u.
        glue: f0, w, tw [s], k, time of the clog [s], T [s], n.
        behind: pieces between nozzle and camera.
        noise: of the camera, relative, one per piece, taken in turns, (k,).
        tolerance: of the width, relative.
        period: servo period [s].
        state: of the bead, `STATE`, to be updated.
        ring: width errors of the last pieces, relative, (PIECES,), to be updated.
        sums: of the interval, `SUMS`, to be written.
    """
    start, warming, warming_time, clog, clog_time, lag, index = glue
    sums[:] = 0.0
    for k in range(max(first, 1), last):
        tip, before = log.tick[k].nozzle, log.tick[k - 1].nozzle
        if not np.isfinite(tip).all():
            continue
        time = k * period
        request = override * (speeds[log.tick[k - 1].setpoint] / reference) ** index
        state[0] += (request - state[0]) * -np.expm1(-period / lag)
        thickness = start * warming ** -np.expm1(-time / warming_time)
        flow = (clog if time >= clog_time else 1.0) * (state[0] / thickness) ** (1 / index)
        state[1] += np.sqrt((tip[0] - before[0]) ** 2 + (tip[1] - before[1]) ** 2 + (tip[2] - before[2]) ** 2)
        state[2] += flow * reference * period
        if state[1] < PIECE:
            continue
        error = np.sqrt(state[2] / state[1]) - 1.0
        done = int(state[3])
        ring[done % PIECES] = error
        state[1], state[2], state[3] = 0.0, 0.0, done + 1
        sums[0] += 1
        sums[1] += error * error
        sums[2] = max(sums[2], abs(error))
        sums[3] += abs(error) > tolerance
        if done >= behind:
            sums[4] += 1
            sums[5] += ring[(done - behind) % PIECES] + noise[(done - behind) % noise.size]
