"""Ranges of the values drawn for an episode: presets, and ranges given by the names of the values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from gantrysim.base.errors import InputError, finite, unknown
from gantrysim.machine.geometry import ERRORS

Range = tuple[float, float]  # the lowest and the highest value, drawn uniformly

NOMINAL = "nominal"
TRAINING = "training"
SHIFTED = "shifted"
PRESETS = {
    NOMINAL: "nothing varies: the nominal machine, the middle of the spiral's ranges, nominal values of the task",
    TRAINING: "the ranges of the settings and of the task",
    SHIFTED: "values of the task beyond those of training, and 1.5 times the tolerances of the machine",
}
SHIFTED_TOLERANCES = 1.5

POSITIVE_VALUES: Range = (math.nextafter(0.0, 1.0), math.inf)
NOT_NEGATIVE: Range = (0.0, math.inf)


class RandomValue(NamedTuple):
    """A value that a task draws for an episode.

    Attributes:
        nominal: its value where nothing varies.
        training, shifted: its ranges in these presets.
        limits: its lowest and highest value in any range.
        unit: of it.
        meaning: of it.
    """

    nominal: float
    training: Range
    shifted: Range
    limits: Range
    unit: str
    meaning: str

    def range_of(self, preset: str) -> Range:
        """Return the range in a preset."""
        return {NOMINAL: (self.nominal, self.nominal), TRAINING: self.training, SHIFTED: self.shifted}[preset]


def task_ranges(values: Mapping[str, RandomValue], preset: str, given: Mapping[str, float | Range]) -> dict[str, Range]:
    """Return the ranges of a task's values.

    Args:
        values: of the task.
        preset: one of `PRESETS`.
        given: ranges that replace those of the preset, by name; other names are left to the machine.

    Raises:
        InputError: a range out of its limits.
    """
    ranges = {name: value.range_of(preset) for name, value in values.items()}
    return ranges | {name: _checked_range(name, given[name], values[name].limits) for name in values if name in given}


def machine_ranges(
    columns: Mapping[str, float], values: Mapping[str, RandomValue], given: Mapping[str, float | Range]
) -> dict[str, Range]:
    """Return the ranges given for values of the machine.

    Args:
        columns: of the machine, by the names that `info` of a reset has.
        values: of the task.
        given: ranges by name.

    Raises:
        InputError: a name of neither the machine nor the task, or a range out of its limits.
    """
    ranges = {}
    for name, bounds in given.items():
        if name in values:
            continue
        if name not in columns:
            raise unknown("random value", name, (*columns, *values))
        if name == "payload_kg":
            limits = NOT_NEGATIVE
        else:
            limits = (-math.inf, math.inf) if name.startswith(ERRORS) else POSITIVE_VALUES
        ranges[name] = _checked_range(name, bounds, limits)
    return ranges


def _checked_range(name: str, bounds: float | Range, limits: Range) -> Range:
    """Return a range, or raise InputError where it is not within the limits."""
    low, high = bounds if isinstance(bounds, tuple) else (bounds, bounds)
    if finite(f"ranges: highest {name}", high) < finite(f"ranges: lowest {name}", low):
        raise InputError(f"ranges: {name} = ({low:g}, {high:g}): must be the lowest, then the highest")
    least, most = limits
    if least <= low and high <= most:
        return low, high
    at_least = "greater than 0" if limits == POSITIVE_VALUES else f"at least {least:g}"
    at_most = "" if most == math.inf else f" and at most {most:g}"
    raise InputError(f"ranges: {name} = ({low:g}, {high:g}): must be {at_least}{at_most}")
