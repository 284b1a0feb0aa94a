"""The dialects of G-code, and firmware, to which a few words of a slicer's program mean different things."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

Firmware = Literal["marlin", "klipper", "reprapfirmware"]

# the line that sets the pressure advance [s]
ADVANCE_WORDS: dict[Firmware, str] = {
    "marlin": "M900 K{:g}",
    "klipper": "SET_PRESSURE_ADVANCE ADVANCE={:g}",
    "reprapfirmware": "M572 D0 S{:g}",
}
# what slicers write: a line of their settings, or Cura's header
_STATED_FLAVOUR = re.compile(r"^;\s*(?:gcode_flavor\s*=|FLAVOR:)\s*(\w+)", re.IGNORECASE | re.MULTILINE)
_FILAMENT = re.compile(r"^;\s*filament_diameter\s*[=:]\s*([0-9.]+)", re.IGNORECASE | re.MULTILINE)
_KLIPPER = re.compile(r"^\s*[A-Z]+(?:_[A-Z0-9]+)+\b", re.IGNORECASE | re.MULTILINE)  # its commands have names
_REPRAP = re.compile(r"^\s*M(?:566|567|572)\b", re.IGNORECASE | re.MULTILINE)


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


LINUXCNC = GCodeDialect(name="LinuxCNC", letters="ST$", dwell=(("P", 1.0),))
# firmware takes P of a dwell in milliseconds, S in seconds
SLICER = GCodeDialect(name="slicer", letters="STDHBCUVW", dwell=(("P", 1e-3), ("S", 1.0)), extrudes=True, lenient=True)


def firmware_of(text: str) -> Firmware:
    """Return the firmware that a program states in a comment, or else has words of; Marlin without either."""
    stated = _STATED_FLAVOUR.search(text)
    if stated:
        name = stated[1].lower()
        if "klipper" in name:
            return "klipper"
        return "reprapfirmware" if name in ("reprapfirmware", "rrf", "duet", "reprap") else "marlin"
    if _KLIPPER.search(text):
        return "klipper"
    return "reprapfirmware" if _REPRAP.search(text) else "marlin"


def stated_filament(text: str) -> float | None:
    """Return the diameter of the filament that a slicer wrote into a comment [mm]; None without one."""
    stated = _FILAMENT.search(text)
    try:
        diameter = float(stated[1]) if stated else 0.0
    except ValueError:
        return None
    return diameter if diameter > 0 else None
