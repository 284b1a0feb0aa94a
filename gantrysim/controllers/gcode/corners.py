"""Corners of a program that nearly stop it, and what would pass them faster."""

from __future__ import annotations

from typing import NamedTuple


class Corners(NamedTuple):
    """The corners of a path.

    Attributes:
        stops: corners between moves at feed passed at less than a tenth of the feed.
        roundable: those of them that a rounding passes faster: they join lines, and do not turn back.
        by_firmware: those of them whose speed the program sets by words of a printer's firmware.
        small: median length of the moves before the stops; 0 without [mm].
        cut: largest distance of the path from corners that are rounded without a tolerance; 0 without [mm].
    """

    stops: int
    roundable: int
    by_firmware: int
    small: float
    cut: float

    def note(self, remedy: str) -> str:
        """Return a note on the stops, with what passes them faster; empty without stops.

        Args:
            remedy: sentence on the rounding of corners between lines, which may pass some of them faster.
        """
        if not self.stops:
            return ""
        remedies = []
        if self.by_firmware:
            remedies.append(
                f"The program itself limits {self.by_firmware} of them, by M205 or SQUARE_CORNER_VELOCITY: a larger "
                "value there passes them faster, and the job's rounding does not act."
            )
        if self.roundable:
            remedies.append(remedy)
        others = self.stops - self.by_firmware - self.roundable
        if others:
            remedies.append(f"{others} of them turn back or join an arc, which no rounding passes faster.")
        return (
            f"{self.stops} corners between moves at feed are passed at less than a tenth of the feed; the moves before "
            f"them are {self.small:.3g} mm long at the median. {' '.join(remedies)}"
        )
