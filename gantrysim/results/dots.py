"""The verdict on dots, each against its volume, its place, and the string that the needle draws from it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from gantrysim.base.quantity import number_text
from gantrysim.glue.bead.dots import Dot
from gantrysim.glue.bead.trace import BeadTrace
from gantrysim.job.tolerance import Tolerance
from gantrysim.results.checks import FAIL, Check, Place, finite, worst
from gantrysim.results.verdict_quantities import DOT_PLACE_ERROR, DOT_STRING, DOT_VOLUME_ERROR

_MOST_NAMED = 5  # dots out of tolerance in a sentence


@dataclass(frozen=True)
class DotVerdict:
    """The verdict on a dot.

    Attributes:
        number: of the dot, from 1.
        dot: the dot.
        wanted: volume that it must have [mm³].
        place: of the needle when the dispenser is switched on.
        checks: of its volume, place and string.
    """

    number: int
    dot: Dot
    wanted: float
    place: Place
    checks: tuple[Check, ...]

    @property
    def state(self) -> str:
        """The worst of its checks."""
        return worst([check.state for check in self.checks])

    @property
    def volume_error(self) -> float:
        """Volume beyond the wanted one, nan where none is wanted [%]."""
        return self.dot.volume_error_percent(self.wanted)

    def content(self) -> dict[str, Any]:
        """Return the dot for JSON."""
        dot = self.dot
        return {
            "number": self.number,
            "state": self.state,
            **self.place.content(),
            "asked_mm": list(dot.asked),
            "laid_mm": list(dot.place),
            "volume_mm3": dot.volume,
            "requested_volume_mm3": self.wanted,
            "volume_error_percent": finite(self.volume_error),
            "diameter_mm": dot.diameter,
            "height_mm": dot.cap.height,
            "place_error_mm": dot.place_error,
            "string_percent": dot.string_percent,
        }


def dot_verdicts(bead: BeadTrace, tolerance: Tolerance, place_at: Callable[[int], Place]) -> tuple[DotVerdict, ...]:
    """Return the verdicts on the dots of a run, in their order."""
    verdicts = []
    for number, dot in enumerate(bead.dots, 1):
        target = bead.settings.dot_target
        wanted = dot.demand if target is None else target
        place = place_at(dot.stretch[0])
        error = dot.volume_error_percent(wanted)
        words = f"dot {number} too large by" if error > 0 else f"dot {number} too small by"
        checks = (
            Check.of(DOT_VOLUME_ERROR, tolerance.bound("dot_volume"), abs(error), words, place),
            Check.of(
                DOT_PLACE_ERROR,
                tolerance.bound("dot_place"),
                dot.place_error,
                f"dot {number} off its place by",
                place,
            ),
            Check.of(
                DOT_STRING,
                tolerance.bound("dot_string"),
                dot.string_percent,
                f"glue of dot {number} drawn into a string",
                place,
            ),
        )
        verdicts.append(DotVerdict(number, dot, wanted, place, checks))
    return tuple(verdicts)


def worst_checks(verdicts: Sequence[DotVerdict]) -> list[Check]:
    """Return the worst check of each kind among dots; of volumes that nothing requests, none."""
    kinds = zip(*(verdict.checks for verdict in verdicts), strict=True)
    return [max(checks, key=lambda check: -1.0 if math.isnan(check.usage) else check.usage) for checks in kinds]


def dots_remark(verdicts: Sequence[DotVerdict]) -> str:
    """Return number, volume and width of dots, and which are out of tolerance, in words."""
    dots = [verdict.dot for verdict in verdicts]
    total = number_text(sum(dot.volume for dot in dots), ".4g")
    widths = [number_text(width(dot.diameter for dot in dots), ".2f") for width in (min, max)]
    wide = widths[0] if widths[0] == widths[1] else " to ".join(widths)
    failed = [str(verdict.number) for verdict in verdicts if verdict.state == FAIL]
    named = ", ".join(failed[:_MOST_NAMED]) + (", ..." if len(failed) > _MOST_NAMED else "")
    out = f"{len(failed)} out of tolerance, no. {named}" if failed else "none out of tolerance"
    return f"{len(dots)} dot{'' if len(dots) == 1 else 's'}, {total} mm³ in all, {wide} mm wide on the work: {out}"
