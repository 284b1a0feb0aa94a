"""The dialects of G-code as tables."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Literal

from gantrysim.base.errors import InputError


@dataclass(frozen=True)
class Dialect:
    """The words of a dialect; codes in tenths.

    Attributes:
        name: of the dialect.
        nothing: G codes without an effect on the path.
        refused: G codes by what they do.
        unheeded: M codes without an effect on the path.
        letters: words without an effect on the path.
        extrudes: whether E feeds material.
        dwell: words of a dwell and their unit [s].
        lenient: whether words that the table lacks are counted instead of refused.
    """

    name: str
    nothing: frozenset[int]
    refused: dict[int, str]
    unheeded: frozenset[int]
    letters: str
    dwell: dict[str, float]
    extrudes: bool = False
    lenient: bool = False


_CYCLES = dict.fromkeys((730, 740, 760, *range(810, 900, 10)), "milling cycle")
_LATHE = dict.fromkeys((700, 710, 711, 712, 720, 721, 722), "lathe cycle")
_PROBE = dict.fromkeys((382, 383, 384, 385), "probing")

LINUXCNC = Dialect(
    name="LinuxCNC",
    nothing=frozenset({800, 960, 970, 980, 990}),
    refused={
        **_CYCLES,
        **_LATHE,
        **_PROBE,
        330: "motion synchronised with the spindle",
        331: "rigid tapping",
        52: "NURBS",
        53: "NURBS",
        62: "NURBS",
        63: "NURBS",
    },
    unheeded=frozenset(
        {0, 1, 3, 4, 5, 6, 7, 8, 9, 19, 48, 49, 50, 51, 52, 53, 60, 61, *range(62, 69), *range(100, 200)}
    ),
    letters="STD$",
    dwell={"P": 1.0},
)

SLICER = Dialect(
    name="slicer",
    nothing=frozenset({100, 110, 220, 280, 290, 310, 320, 800, 940}),
    refused={**_CYCLES, **_PROBE, 50: "spline"},
    unheeded=frozenset(range(2000)) - {2, 30, 82, 83, 98, 99},
    letters="STDHBCUVW",
    dwell={"P": 1e-3, "S": 1.0},
    extrudes=True,
    lenient=True,
)


@dataclass(frozen=True)
class Dispense:
    """When the valve is open.

    Attributes:
        by: "feed", in all moves at feed; "codes", between M codes; "extrusion", in moves that feed material by E.
        on: M codes that open the valve, as "M3" or "M64 P0".
        off: M codes that close it.
    """

    by: Literal["feed", "codes", "extrusion"] = "feed"
    on: tuple[str, ...] = ("M3", "M4")
    off: tuple[str, ...] = ("M5",)

    def __post_init__(self) -> None:
        if self.by not in ("feed", "codes", "extrusion"):
            raise InputError(f"dispense.by = {self.by!r}: must be feed, codes or extrusion")
        _switches(tuple(self.on), tuple(self.off))

    def switch(self, code: int, number: float | None) -> bool | None:
        """Return whether an M code with its P opens or closes the valve; None if it does neither."""
        switches = _switches(tuple(self.on), tuple(self.off))
        found = switches.get((code, number))
        return switches.get((code, None)) if found is None else found


@dataclass(frozen=True)
class ByExtrusion(Dispense):
    """When the valve is open, in a slicer's program.

    Attributes:
        by: "extrusion", in moves that feed material by E; "feed", in all moves at feed; "codes", between M codes.
        on: M codes that open the valve, as "M3" or "M64 P0".
        off: M codes that close it.
    """

    by: Literal["feed", "codes", "extrusion"] = "extrusion"


@cache
def _switches(on: tuple[str, ...], off: tuple[str, ...]) -> dict[tuple[int, float | None], bool]:
    return {_code(name): opens for names, opens in ((on, True), (off, False)) for name in names}


def _code(name: str) -> tuple[int, float | None]:
    parts = name.upper().split()
    try:
        if not 1 <= len(parts) <= 2 or parts[0][0] != "M" or (len(parts) == 2 and parts[1][0] != "P"):
            raise ValueError
        return int(parts[0][1:]), float(parts[1][1:]) if len(parts) == 2 else None
    except ValueError:
        raise InputError(f"dispense code {name!r}: must be an M code, as M3, or with its P, as M64 P0") from None
