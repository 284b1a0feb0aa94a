"""Input shaping: setpoints through impulses that leave out the frequency at which the machine swings."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.memory import check_ticks
from gantrysim.record.setpoints import Setpoints
from gantrysim.servo.laws.parameters import ZV, ZVD
from gantrysim.servo.servo import Servo

_SHAPERS = (ZV, ZVD)


def impulses(law: str, frequency: float, damping: float, period: float) -> Floats:
    """Return the weights of the setpoints of 0, 1, 2, ... ticks ago, (n,).

        ZV: (1 + K q) / (1 + K),  ZVD: its square;    K = exp(-zeta pi / sqrt(1 - zeta^2))

    q is a delay of half a period of the damped mode (Singer and Seering, Journal of Dynamic Systems, Measurement, and
    Control 112, 1990). An impulse between two ticks is shared by them in proportion.

    Args:
        law: "zv" or "zvd".
        frequency: of the mode, undamped [Hz].
        damping: its damping ratio zeta, below 1.
        period: servo period [s].
    """
    root = math.sqrt(1 - damping**2)
    half = 1 / (2 * frequency * root) / period
    whole = int(half)
    two = np.zeros(whole + 2)
    strength = math.exp(-damping * math.pi / root)
    two[0] = 1.0
    two[whole] += strength * (1 - half + whole)
    two[whole + 1] += strength * (half - whole)
    two /= 1 + strength
    return two if law == ZV else np.convolve(two, two)


def shaped(servo: Servo, setpoints: Setpoints) -> Setpoints:
    """Return the setpoints as input shaping sends them; unchanged where the servo does not shape.

    All axes are shaped alike, by the modes of all, so that they stay together on their path. The stream becomes longer
    by the shaper, at its end and before each gate; the dispenser waits for the mean delay of the motion.

    Args:
        servo: the servo.
        setpoints: the program's own.
    """
    law = next((name for name in _SHAPERS if name in servo.law), None)
    if law is None:
        return setpoints
    modes = sorted({mode for mode in zip(servo.shaper_frequency, servo.shaper_damping, strict=True) if mode[0]})
    weights = np.ones(1)
    for frequency, damping in modes:
        weights = np.convolve(weights, impulses(law, frequency, damping, servo.period))
    more, gates = len(weights) - 1, setpoints.gates
    last = len(setpoints.position) - 1
    stays = np.union1d(gates, [last])
    check_ticks(last + 1 + more * len(stays), "input shaping", "use a higher shaper_frequency")
    source = np.repeat(np.arange(last + 1), np.where(np.isin(np.arange(last + 1), stays), more + 1, 1))
    moved = gates + more * (1 + np.arange(gates.size))
    delay = round(float(weights @ np.arange(more + 1)))
    late = np.maximum(np.arange(len(source)) - delay, 0)
    return replace(
        setpoints,
        position=_convolved(setpoints.position[source], weights),
        dispense=setpoints.dispense[source][late],
        gates=moved,
        torque=None if setpoints.torque is None else _convolved(setpoints.torque[source], weights),
    )


def _convolved(values: Floats, weights: Floats) -> Floats:
    """Return the weighted sum of each row and those before it; before the first it is as the first."""
    out = np.zeros_like(values)
    padded = np.pad(values, ((len(weights) - 1, 0), (0, 0)), "edge")
    for ago in np.flatnonzero(weights):
        begin = len(weights) - 1 - ago
        out += weights[ago] * padded[begin : begin + len(values)]
    return out
