"""Results of a check of a log or of a fit."""

from __future__ import annotations

from typing import NamedTuple

from gantrysim.base.errors import InputError

VISCOUS = ("viscous", "viscous_forward", "viscous_back")
FRICTION = (*VISCOUS, "coulomb", "static")


class NotIdentifiedError(InputError):
    """A log that is well formed and shows no value of the machine, with the quantity, its value and the bound."""


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
