"""From the text of a drawing to its strokes, whatever its format; names of their layers and colours."""

from __future__ import annotations

import re
from functools import lru_cache
from itertools import pairwise

from gantrysim.base.errors import unknown
from gantrysim.base.extras import extra
from gantrysim.controllers.drawings.dxf import BINARY, read_dxf
from gantrysim.controllers.drawings.points import read_points
from gantrysim.controllers.drawings.shapes import Sheet
from gantrysim.controllers.drawings.svg import read_svg

# Units of length of a drawing.

UNITS = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3, "in": 25.4, "ft": 304.8, "pt": 25.4 / 72, "px": 25.4 / 96}


def millimetres(unit: str) -> float | None:
    """Return the length of a unit [mm], None of "auto".

    Raises:
        InputError: an unknown unit.
    """
    if unit != "auto" and unit not in UNITS:
        raise unknown("unit", unit, ("auto", *UNITS))
    return UNITS.get(unit)


def kind_of(text: str) -> str:
    """Return the format of a text: svg begins with "<", dxf with a pair of lines, a group code and its value."""
    lines = [line.strip() for line in text.lstrip("\ufeff \t\r\n")[:10_000].splitlines()[:200]]
    if text.startswith(BINARY):
        return "dxf"
    if lines and lines[0].startswith("<"):
        return "svg"
    codes = [code == "0" and value in ("SECTION", "EOF") for code, value in pairwise(lines)]
    return "dxf" if any(codes) else "csv"


@lru_cache(maxsize=4)
def read_sheet(kind: str, text: str, unit: str, curve: str, dots: bool) -> Sheet:
    """Return the strokes of a drawing; arguments as of `Drawing`, `dots` for whether points are traced.

    The last few are remembered: a job's checks, its path and its notes all ask for the same drawing.
    """
    text = text.removeprefix("\ufeff")
    length = millimetres(unit)
    if kind == "dxf":
        return read_dxf(text, length, dots)
    if kind == "svg":
        return read_svg(text, length)
    return read_points(text, length, curve, dots)


def matches(name: str, present: set[str]) -> set[str]:
    """Return the names in a drawing, layers and colours as "#rrggbb", that a layer or a colour of CSS means."""
    spellings = {name.lower()}
    if any(other.startswith("#") for other in present):
        spellings.add(_hex_of(name))
    return spellings & present


def _hex_of(name: str) -> str:
    """Return a colour of CSS as "#rrggbb", any other name unchanged."""
    # not words of a to f alone, which svgelements takes for hexadecimal digits
    if not re.fullmatch(r"#([0-9a-fA-F]{3}){1,2}|[a-fA-F]*[g-zG-Z][a-zA-Z]*", name):
        return name
    with extra("drawings", f"layer or colour {name}"):
        from svgelements import Color

    try:
        colour = Color(name)
    except ValueError:
        return name
    return name if colour.value is None else str(colour.hexrgb).lower()
