"""The dialects of G-code."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class GCodeDialect:
    """The rules of a dialect; its codes name it in `codes/`.

    Attributes:
        name: of the dialect.
        letters: words without an effect on the path.
        dwell: words of a dwell, by the factor to seconds.
        extrudes: whether E feeds material.
        lenient: whether words without a handler are counted instead of refused, and lines are read as printers'
            firmware reads them.
    """

    name: str
    letters: str
    dwell: tuple[tuple[str, float], ...]
    extrudes: bool = False
    lenient: bool = False


LINUXCNC = GCodeDialect(name="LinuxCNC", letters="STD$", dwell=(("P", 1.0),))
# firmware takes P of a dwell in milliseconds, S in seconds
SLICER = GCodeDialect(name="slicer", letters="STDHBCUVW", dwell=(("P", 1e-3), ("S", 1.0)), extrudes=True, lenient=True)
