"""What a run must keep to: a figure of its row and the tolerance."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gantrysim.errors import positive, unknown
from gantrysim.study.cases import OK, Row

_UNITS = {"um": "µm", "mdeg": "mdeg", "mm": "mm", "mm_s": "mm/s", "s": "s"}  # by the end of a figure's name
_NOT_FIGURES = ("end_", "path_length", "duration", "bead_", "spacing_mean", "spacing_min", "spacing_max", "speed_mean")
_ERRORS = ("generation", "tracking", "measurement", "structure", "contour")


@dataclass(frozen=True)
class Criterion:
    """A figure that is the better the smaller it is, and the largest value that will do.

    Args:
        figure: of a case's row, by its name there or that without the unit, as contour_max.
        tolerance: in the figure's own unit.
    """

    figure: str
    tolerance: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "tolerance", positive("tolerance", self.tolerance))

    def key(self, row: Row) -> str:
        """Return the figure's full name.

        Args:
            row: of a case that has figures.

        Raises:
            InputError: it has none of that name.
        """
        names = list(row)
        figures = names[names.index("status") + 1 :]  # before it stand the tags
        known = {
            key: _without_unit(key)
            for key in figures
            if isinstance(row[key], float) and not key.startswith(_NOT_FIGURES)
        }
        for key, name in known.items():
            if self.figure in (key, name):
                return key
        raise unknown("figure", self.figure, known.values())

    def check(self, row: Row) -> None:
        """Refuse a figure that a row has none of; a row without any figures shows nothing.

        Raises:
            InputError: there is no such figure.
        """
        if row["status"] == OK:
            self.key(row)

    def value(self, row: Row) -> float:
        """Return the figure; inf of a case that a fault has ended or that was refused, or that has no such figure."""
        if row.get("status") != OK:
            return math.inf
        value = row[self.key(row)]
        return float(value) if isinstance(value, float) else math.inf

    def within(self, row: Row) -> bool:
        """Return whether a case has the figure and keeps to the tolerance."""
        return self.value(row) <= self.tolerance

    def unit(self, row: Row) -> str:
        """Return the figure's unit, as the name of it says."""
        key = self.key(row)
        return next((unit for ending, unit in _UNITS.items() if key.endswith(f"_{ending}")), "")

    @property
    def label(self) -> str:
        """The figure in words."""
        words = _without_unit(self.figure).split("_")
        what = {"max": "largest", "rms": "rms", "p95": "95 %", "std": "standard deviation of"}
        kind = next((word for word in words if word in what), None)
        rest = " ".join(word for word in words if word != kind)
        noun = f"{rest} error" if words[0] in _ERRORS else rest
        return f"{what[kind]} {noun}" if kind else noun


def _without_unit(key: str) -> str:
    for ending in sorted(_UNITS, key=len, reverse=True):
        if key.endswith(f"_{ending}"):
            return key.removesuffix(f"_{ending}")
    return key
