"""Results of a check of a fit."""

from __future__ import annotations

from typing import NamedTuple

FRICTION = ("viscous", "coulomb", "static")


class Finding(NamedTuple):
    """A check that failed.

    Attributes:
        check: its name.
        values: that are therefore not identified; all of the axis where empty.
        reason: with quantity, value and bound.
    """

    check: str
    values: tuple[str, ...]
    reason: str


class Doubt(NamedTuple):
    """Uncertainty that a check adds to a fit.

    Attributes:
        deviations: standard deviation by parameter, to be added in squares [unit of the parameter].
        findings: checks that failed.
    """

    deviations: dict[str, float]
    findings: list[Finding]
