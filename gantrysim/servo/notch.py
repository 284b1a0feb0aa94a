"""A notch filter on the torque demand: it takes out the frequency at which the machine swings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, NamedTuple, TypedDict

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, positive
from gantrysim.servo.gains import PerAxis, parameters_of

NONE = 0.0  # frequency of an axis without a notch

# Narrow enough to leave phase at the crossover, wide enough for a mode that is off by a tenth.
NOTCH_WIDTH = 0.35
NOTCH_DEPTH = 0.1


class Notch(NamedTuple):
    """The notch of one axis, each value with its unit and meaning."""

    frequency: Annotated[float, "Hz", "frequency of the notch on the torque demand; 0 for none"] = NONE
    width: Annotated[float, "", "damping ratio of the notch's poles"] = NOTCH_WIDTH
    depth: Annotated[float, "", "gain of the notch at its frequency"] = NOTCH_DEPTH


class GivenNotches(TypedDict, total=False):
    """The notches as keywords of `Servo.derive`, for editors and type checkers."""

    notch_frequency: PerAxis
    notch_width: PerAxis
    notch_depth: PerAxis


NOTCH = parameters_of(Notch, "notch_")


class Coefficients(NamedTuple):
    """Of (b0 + b1/z + b2/z^2) / (1 + a1/z + a2/z^2)."""

    b0: float = 1.0
    b1: float = 0.0
    b2: float = 0.0
    a1: float = 0.0
    a2: float = 0.0


def coefficients(frequency: float, width: float, depth: float, period: float) -> Coefficients:
    """Return the notch as a filter from servo tick to servo tick.

        N(s) = (s^2 + 2 depth width w s + w^2) / (s^2 + 2 width w s + w^2),    w = 2 pi frequency

    by the bilinear transform, prewarped so that the notch is deepest at its frequency.

    Args:
        frequency: below half the servo's, 0 for no notch [Hz].
        width: damping ratio of the poles.
        depth: gain at the frequency.
        period: servo period [s].

    Raises:
        InputError: a frequency that is not below half the servo's, or a width or depth that is not above zero.
    """
    if frequency == NONE:
        return Coefficients()
    nyquist = 0.5 / period
    if not 0 < frequency < nyquist:
        raise InputError(
            f"notch_frequency = {frequency:g} Hz: must be below half the servo's, {nyquist:g} Hz, or 0 for no notch"
        )
    k = math.tan(math.pi * frequency * period)
    wide = 2 * positive("notch_width", width) * k
    narrow = positive("notch_depth", depth) * wide
    whole = 1 + wide + k**2
    middle = 2 * (k**2 - 1) / whole
    return Coefficients(
        (1 + narrow + k**2) / whole, middle, (1 - narrow + k**2) / whole, middle, (1 - wide + k**2) / whole
    )


def without_notches(frequency: PerAxis) -> bool:
    """Return whether no axis may have a notch, as the frequencies that are given are all 0.

    Args:
        frequency: of all axes or of each, None if none is given [Hz].
    """
    if frequency is None:
        return False
    return not np.any(frequency)


def lag(frequency: float, width: float, depth: float) -> float:
    """Return the time by which the notch delays what is slow against it [s]."""
    return 2 * width * (1 - depth) / (2 * math.pi * frequency) if frequency != NONE else 0.0


def filtered_output(
    value: float, filter: Sequence[float] | Floats, first: float, second: float
) -> tuple[float, float, float]:
    """Return the filter's output at one tick and its two states after it (direct form II, transposed).

    Args:
        value: input at this tick.
        filter: in the order of `Coefficients`.
        first: a state after the last tick, 0 at rest.
        second: the other.
    """
    # by index, as compiled code takes an array or a tuple
    out = filter[0] * value + first
    return out, filter[1] * value - filter[3] * out + second, filter[2] * value - filter[4] * out
