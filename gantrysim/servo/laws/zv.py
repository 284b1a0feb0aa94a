"""Input shaping by two impulses: a filter of the setpoints that leaves out a resonance of the machine."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.base.memory import check_ticks
from gantrysim.record.setpoints import Setpoints
from gantrysim.servo.gains import Parameter
from gantrysim.servo.laws.law import Law, LawDesign, in_words

PARAMETERS = (
    Parameter("shaper_frequency", "Hz", "frequency that input shaping removes from the command; 0 for none"),
    Parameter("shaper_damping", "", "damping ratio of the mode at that frequency"),
)


def impulses(frequency: float, damping: float, period: float) -> Floats:
    """Return the weights of the setpoints of 0, 1, 2, ... ticks ago, (n,).

        (1 + K q) / (1 + K),    K = exp(-zeta pi / sqrt(1 - zeta^2))

    q is a delay of half a period of the damped mode (Singer and Seering, Journal of Dynamic Systems, Measurement, and
    Control 112, 1990). An impulse between two ticks is shared by them in proportion.

    Args:
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
    return two


def shaped_setpoints(
    values: Mapping[str, Sequence[float]],
    setpoints: Setpoints,
    weights_of_mode: Callable[[float, float, float], Floats],
) -> Setpoints:
    """Return the setpoints as input shaping sends them.

    All axes are shaped alike, by the modes of all, so that they stay together on their path. The stream becomes longer
    by the shaper, at its end and before each gate; the dispenser waits for the mean delay of the motion.

    Args:
        values: shaper_frequency and shaper_damping, one per axis each.
        setpoints: the program's own.
        weights_of_mode: returns the weights that leave out a mode, of its frequency, damping ratio and the period.
    """
    frequencies = values["shaper_frequency"]
    modes = {mode for mode in zip(frequencies, values["shaper_damping"], strict=True) if mode[0]}
    weights = np.ones(1)
    for frequency, damping in sorted(modes):
        weights = np.convolve(weights, weights_of_mode(frequency, damping, setpoints.period))
    longer = len(weights) - 1
    gates = setpoints.gates
    last = len(setpoints.position) - 1
    stays = np.union1d(gates, [last])
    check_ticks(last + 1 + longer * len(stays), "input shaping", "use a higher shaper_frequency")
    source = np.repeat(np.arange(last + 1), np.where(np.isin(np.arange(last + 1), stays), longer + 1, 1))
    moved = gates + longer * (1 + np.arange(gates.size))
    delay = round(float(weights @ np.arange(longer + 1)))
    late = np.maximum(np.arange(len(source)) - delay, 0)
    fed: dict[str, Any] = {}
    for name, column in setpoints.material.items():
        fed[name] = _weighted_sums(column[source, None], weights)[:, 0]
    return replace(
        setpoints,
        position=_weighted_sums(setpoints.position[source], weights),
        dispense=setpoints.dispense[source][late],
        gates=moved,
        torque=None if setpoints.torque is None else _weighted_sums(setpoints.torque[source], weights),
        progress=None if setpoints.progress is None else _shaped_progress(setpoints.progress[source], weights),
        **fed,
    )


def _shaped_progress(progress: Floats, weights: Floats) -> Floats:
    """Return a progress filtered as the positions are; rounding of the sums must not make it fall."""
    filtered: Floats = np.maximum.accumulate(_weighted_sums(progress[:, None], weights)[:, 0])
    return np.minimum(filtered, progress[-1], out=filtered)


def _weighted_sums(values: Floats, weights: Floats) -> Floats:
    """Return the weighted sum of each row and those before it; before the first it is as the first."""
    out = np.zeros_like(values)
    padded = np.pad(values, ((len(weights) - 1, 0), (0, 0)), "edge")
    for ago in np.flatnonzero(weights):
        begin = len(weights) - 1 - ago
        out += weights[ago] * padded[begin : begin + len(values)]
    return out


class Zv(Law):
    """The law as one of the ladder. It has no linear model: it changes the setpoints, not the loop."""

    name = "zv"
    meaning = "input shaping by two impulses"
    parameters = PARAMETERS
    excludes = ("zvd",)

    def derived(self, design: LawDesign) -> dict[str, float]:
        frequency, damping = design.slowest_swing()
        return {"shaper_frequency": frequency, "shaper_damping": damping}

    def check(self, values: Mapping[str, Sequence[float]], period: float) -> None:
        nyquist = 0.5 / period
        frequencies = values["shaper_frequency"]
        # an axis without a mode has the frequency 0, but not all axes
        if not any(frequencies) or max(frequencies) >= nyquist:
            raise InputError(
                f"shaper_frequency = {in_words(frequencies)} Hz: must be above 0 and below half the servo's, "
                f"{nyquist:g} Hz"
            )
        if max(values["shaper_damping"]) >= 1:
            raise InputError(f"shaper_damping = {in_words(values['shaper_damping'])}: must be below 1")

    def sent(self, values: Mapping[str, Sequence[float]], setpoints: Setpoints) -> Setpoints:
        return shaped_setpoints(values, setpoints, impulses)


ZV = Zv()
