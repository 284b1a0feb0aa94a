"""Names and units in the heads of a table's columns, and the units as factors to those of the package."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from gantrysim.base.errors import InputError

TIME = "s"
LENGTH = "mm"
ANGLE = "deg"
TORQUE = "N·m"
SPEED = "mm/s"
TURNING = "deg/s"
PRESSURE = "kPa"
MASS = "mg"
FLOW = "mm³/s"
DENSITY = "g/cm³"
NUMBER_OF = ""

NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"  # regular expression of a decimal number

_GAPS = re.compile(r"[\s_.]+")
_OPENING = "[("
_CLOSING = "])"

# factors to s, mm, deg, N·m, mm/s, deg/s, kPa, mg, mm³/s and g/cm³; µ has two code points, of the micro sign and of
# the Greek letter
KINDS: dict[str, dict[str, float]] = {
    TIME: {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ns": 1e-9, "min": 60.0},
    LENGTH: {
        "mm": 1.0, "um": 1e-3, "µm": 1e-3, "μm": 1e-3, "nm": 1e-6, "cm": 10.0, "m": 1e3,
        "in": 25.4, "inch": 25.4, "mil": 0.0254, "thou": 0.0254,
    },
    ANGLE: {
        "deg": 1.0, "°": 1.0, "mdeg": 1e-3, "rad": 180 / math.pi, "mrad": 0.18 / math.pi, "rev": 360.0,
        "arcmin": 1 / 60, "arcsec": 1 / 3600,
    },
    TORQUE: {
        "N·m": 1.0, "Nm": 1.0, "N*m": 1.0, "N.m": 1.0, "N m": 1.0, "mN·m": 1e-3, "mNm": 1e-3, "mN*m": 1e-3,
        "N·cm": 1e-2, "Ncm": 1e-2, "kN·m": 1e3, "kNm": 1e3, "lbf·in": 0.112984829, "ozf·in": 0.00706155181,
    },
    SPEED: {
        "mm/s": 1.0, "um/s": 1e-3, "µm/s": 1e-3, "μm/s": 1e-3, "cm/s": 10.0, "m/s": 1e3,
        "mm/min": 1 / 60, "m/min": 1e3 / 60, "in/s": 25.4, "in/min": 25.4 / 60,
    },
    TURNING: {
        "deg/s": 1.0, "°/s": 1.0, "rad/s": 180 / math.pi, "mrad/s": 0.18 / math.pi, "rev/s": 360.0,
        "rpm": 6.0, "r/min": 6.0, "1/min": 6.0, "min-1": 6.0, "rev/min": 6.0, "U/min": 6.0,
    },
    PRESSURE: {
        "kPa": 1.0, "Pa": 1e-3, "hPa": 0.1, "mbar": 0.1, "bar": 100.0, "MPa": 1e3, "psi": 6.894757293,
        "psig": 6.894757293,
    },
    MASS: {"mg": 1.0, "g": 1e3, "kg": 1e6, "ug": 1e-3, "µg": 1e-3, "μg": 1e-3},
    FLOW: {
        "mm³/s": 1.0, "mm3/s": 1.0, "ul/s": 1.0, "µl/s": 1.0, "μl/s": 1.0, "nl/s": 1e-3, "ml/s": 1e3, "mL/s": 1e3,
        "mm³/min": 1 / 60, "ul/min": 1 / 60, "µl/min": 1 / 60, "μl/min": 1 / 60, "ml/min": 1e3 / 60,
        "mL/min": 1e3 / 60, "cc/min": 1e3 / 60, "cm³/min": 1e3 / 60, "ml/h": 1e3 / 3600,
    },
    DENSITY: {
        "g/cm³": 1.0, "g/cm3": 1.0, "g/ml": 1.0, "g/mL": 1.0, "g/cc": 1.0, "kg/l": 1.0, "mg/mm³": 1.0, "mg/mm3": 1.0,
        "kg/m³": 1e-3, "kg/m3": 1e-3,
    },
    NUMBER_OF: {"": 1.0, "-": 1.0, "1": 1.0},
}  # fmt: skip

# of positions in a machine's log that gives none, by the package's unit
SI = {"mm": "m", "deg": "rad"}

_SHARE_UNITS = {
    "‰": 1e-3, "per mille": 1e-3, "0.1%": 1e-3, "0.1 %": 1e-3, "0,1%": 1e-3, "0,1 %": 1e-3,
    "%": 1e-2, "per cent": 1e-2, "percent": 1e-2,
}  # fmt: skip
_CURRENTS = ("A", "mA", "Arms")
_SHARE_OF_RATED = re.compile(rf"({'|'.join(map(re.escape, _SHARE_UNITS))})(?:\s+of\s+({NUMBER})\s*(\S.*))?")

# names of an encoder's counts, which the machine's table gives a size
COUNTS = ("counts", "count", "cts", "edges", "pulses", "pulse", "ticks", "tick", "increments", "incr", "inc", "Inkr")

# units that may end a column's name without brackets, as in "time_ms"
SUFFIXES = ("s", "ms", "us", "mm", "um", "deg", "Nm")


def name_and_unit(head: str) -> tuple[str, str]:
    """Return the name and the unit of a head such as "x position [mm]"; the unit is "" where none is in brackets.

    The time is linear in the head's length, whatever brackets and blanks it has.
    """
    text = head.strip()
    if not text.endswith(tuple(_CLOSING)):
        return text, ""
    inside = max(text.rfind(bracket, 0, -1) for bracket in _CLOSING) + 1
    openings = [text.find(bracket, inside) for bracket in _OPENING]
    if max(openings) < 0:
        return text, ""
    first = min(opening for opening in openings if opening >= 0)
    return text[:first].rstrip(), text[first + 1 : -1].strip()


def spaced_name(name: str) -> str:
    """Return a name with single blanks for its blanks, underscores and points, such as "x position"."""
    return _GAPS.sub(" ", name.strip())


def factor(unit: str, kind: str, label: str, further: Mapping[str, float] | None = None) -> float:
    """Return the factor of a unit to that of the package.

    Args:
        unit: of the values; a share as "‰ of 1.27 N·m", as drives log torque by that which is rated.
        kind: one of `KINDS`.
        label: names the column in errors.
        further: units that are known besides, as counts of an encoder.

    Raises:
        InputError: a unit of another kind.
    """
    known = KINDS[kind] | dict(further or {})
    rated = _SHARE_OF_RATED.fullmatch(unit.strip())
    if rated:
        share, value, whole_unit = rated.groups()
        if not value:
            raise InputError(f"{label} is in {unit!r}: must say of what, as in '{share} of 1.27 {kind}'")
        return _SHARE_UNITS[share] * float(value) * factor(whole_unit, kind, label, further)
    if unit not in known:
        is_current = kind == TORQUE and unit in _CURRENTS
        cure = "; a current has a torque by its constant, COLUMN*0.0302 N·m" if is_current else ""
        raise InputError(f"{label} is in {unit!r}: must be in {', '.join(known)}{cure}")
    return known[unit]


# what no quantity of the package is in, but columns beside it are, and parts of units
_OTHER_UNITS = frozenset(
    (
        "-", "%", "‰", "1", "A", "mA", "Arms", "V", "mV", "W", "kW", "J", "N", "kN", "Ω", "ohm", "Hz", "kHz", "K", "C",
        "°C", "°F", "bar", "Pa", "kPa", "MPa", "g", "kg", "bit", "bool", "r", "U", "turns", "samples", "kpulse",
        *COUNTS,
    )
)  # fmt: skip
_UNIT_LENGTH = 20  # characters of a unit
_POWER = re.compile(r"(?:\^?-?\d|[⁻²³]+)$")
_NUMBER_BEFORE_UNIT = re.compile(r"(?:x\s*)?\d+(?:\.\d+)?\s*(?=[^\d\s/])")


def is_unit(text: str) -> bool:
    """Return whether a cell is a unit, as below the names of a table's columns: mm, [µm/s²], 0.1%, or none."""
    bare = text.strip().strip("[]()").strip()
    if (
        not bare
        or bare in _OTHER_UNITS
        or _SHARE_OF_RATED.fullmatch(bare)
        or any(bare in units for units in KINDS.values())
    ):
        return True
    if len(bare) > _UNIT_LENGTH:
        return False
    parts = [_POWER.sub("", part.strip()) for part in re.split(r"[/·*⋅]", _NUMBER_BEFORE_UNIT.sub("", bare, count=1))]
    return all(part in _OTHER_UNITS or any(part in units for units in KINDS.values()) for part in parts)
