"""The dialects of G-code, and the words that open the valve."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Literal

from gantrysim.base.errors import InputError


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


@dataclass(frozen=True)
class Dispense:
    """When the valve is open.

    Attributes:
        by: "feed": open in all moves at feed; "codes": between M codes; "extrusion": in moves that feed material by E.
        on: M codes that open the valve, such as "M3" or "M64 P0".
        off: M codes that close the valve.
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
        with_number = switches.get((code, number))
        return switches.get((code, None)) if with_number is None else with_number


@dataclass(frozen=True)
class ByExtrusion(Dispense):
    """When the valve is open, in a slicer's program.

    Attributes:
        by: "extrusion": open in moves that feed material by E; "feed": in all moves at feed; "codes": between M codes.
        on: M codes that open the valve, such as "M3" or "M64 P0".
        off: M codes that close the valve.
    """

    by: Literal["feed", "codes", "extrusion"] = "extrusion"


_PAIRS = {  # what programs for other heads switch the valve with: outputs, then coolant, then the spindle
    "M65": ("M64",),
    "M63": ("M62",),
    "M9": ("M8", "M7"),
    "M5": ("M3", "M4"),
}


def codes_beside_feed(dispense: Dispense, without_effect: Mapping[str, int]) -> Dispense | None:
    """Return how the program's own M codes would open and close the valve, where they do not.

    Args:
        dispense: when the valve is open.
        without_effect: words of the program without an effect, and how often they were met.

    Returns:
        None where the valve is not open in all moves at feed, or no code of the program switches on and off.
    """
    if dispense.by != "feed":
        return None
    for off, ons in _PAIRS.items():
        met = tuple(on for on in ons if on in without_effect)
        if off in without_effect and met:
            return Dispense("codes", met, (off,))
    return None


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
