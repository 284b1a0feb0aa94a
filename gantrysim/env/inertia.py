"""Payload that changes during an episode, and inertia estimated from torque commands."""

# mypy: allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit
from gantrysim.env.friction import Changing
from gantrysim.machine.perturbation import Perturbation
from gantrysim.machine.row import Log

MOST_PAYLOAD = 4.0  # payload after a change [kg]


class ChangingPayload(Changing):
    """Source of episodes whose payload is another one from some moment on."""

    task: ClassVar[Mapping[str, tuple[float, float]]] = {
        "payload_later": (0.0, MOST_PAYLOAD),
        "payload_time": (0.2, 1.2),
    }
    moment: ClassVar[str] = "payload_time"

    def change(self, drawn: Mapping[str, float]) -> Perturbation:
        return Perturbation(payload=drawn["payload_later"] - drawn.get("payload_kg", 0.0))


# of the fit, by axis: sums of products of torques of inertia J, of friction F, and of the demand without viscous
# friction D, and these three after the low pass
SUMS = ("JJ", "JF", "FF", "JD", "FD", "J", "F", "D")


@jit
def fit(
    log: Log,
    ticks: tuple[int, int],
    motion: tuple[Floats, Floats],
    axes: Floats,
    decay: tuple[float, float],
    sums: Floats,
) -> None:
    """Add ticks to the least squares, which forget exponentially, of inertia and friction in the torque demand.

        L(demand - viscous dDPOS/T) = r L(inertia ddMPOS/T²) + h L(sliding)

    L is a low pass of first order, for the second difference of encoder counts is coarse. That is taken about one tick,
    the demand at the tick before, which acts by then, friction at that tick. An axis at rest adds and forgets nothing.

    Args:
        log: the servo's, see `gantrysim.machine.row.Log`.
        ticks: the first, and the one after the last.
        motion: torque of the nominal friction [N·m] and dDPOS, one row per setpoint, (n, axes) each.
        axes: inertia / T² and viscous / T of the nominal axes, (axes, 2) [N·m/mm].
        decay: exp(-T/tau) of the low pass, and of the sums.
        sums: of `SUMS`, (axes, 8), to be updated.
    """
    sliding, moved = motion
    smooth, forget = decay
    for k in range(max(ticks[0], 2), ticks[1]):
        setpoint = log.tick[k - 1].setpoint
        for a in range(len(sums)):
            if moved[setpoint, a] == 0.0:
                continue
            total = sums[a]
            inertia, viscous = axes[a]
            change = log.axis[k, a].encoder - 2 * log.axis[k - 1, a].encoder + log.axis[k - 2, a].encoder
            total[5] += (1 - smooth) * (inertia * change - total[5])
            total[6] += (1 - smooth) * (sliding[setpoint, a] - total[6])
            total[7] += (1 - smooth) * (log.axis[k - 2, a].demand - viscous * moved[setpoint, a] - total[7])
            j = total[5]
            f = total[6]
            d = total[7]
            total[0] = forget * total[0] + j * j
            total[1] = forget * total[1] + j * f
            total[2] = forget * total[2] + f * f
            total[3] = forget * total[3] + j * d
            total[4] = forget * total[4] + f * d


def ratios(sums: Floats) -> tuple[Floats, Floats]:
    """Return r of each axis, and the r that all axes have in common, each axis with its own h.

    Args:
        sums: of `SUMS`, (..., axes, 8), with JJ FF > JF².

    Returns:
        Ratios of the inertia to the nominal one, (..., axes) and (...,).
    """
    jj, jf, ff, jd, fd = np.moveaxis(sums[..., :5], -1, 0)
    above = jd - jf * fd / ff
    below = jj - jf * jf / ff
    return above / below, above.sum(axis=-1) / below.sum(axis=-1)
