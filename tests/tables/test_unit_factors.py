"""Factors of units, each from its definition: in metres, seconds, kilograms and turns."""

import math

import pytest

from gantrysim.base.errors import InputError
from gantrysim.tables.units import KINDS, factor

INCH = 0.0254
POUND_FORCE = 0.45359237 * 9.80665
TURN = 360.0
RADIAN = TURN / (2 * math.pi)
LITRE = 1e-3
MINUTE = 60.0

# by kind: what the package's unit is worth, and what each other one is worth, in SI or degrees
WORTH = {
    "s": (1.0, {"s sec": 1.0, "ms": 1e-3, "us µs μs": 1e-6, "ns": 1e-9, "min": MINUTE}),
    "mm": (
        1e-3,
        {"mm": 1e-3, "um µm μm": 1e-6, "nm": 1e-9, "cm": 1e-2, "m": 1.0, "in inch": INCH, "mil thou": 1e-3 * INCH},
    ),
    "deg": (
        1.0,
        {"deg °": 1.0, "mdeg": 1e-3, "rad": RADIAN, "mrad": 1e-3 * RADIAN, "rev": TURN, "arcmin": 1 / 60}
        | {"arcsec": 1 / 3600},
    ),
    "N·m": (
        1.0,
        {"N·m Nm N*m N.m": 1.0, "mN·m mNm mN*m": 1e-3, "N·cm Ncm": 1e-2, "kN·m kNm": 1e3}
        | {"lbf·in": POUND_FORCE * INCH, "ozf·in": POUND_FORCE / 16 * INCH},
    ),
    "mm/s": (
        1e-3,
        {"mm/s": 1e-3, "um/s µm/s μm/s": 1e-6, "cm/s": 1e-2, "m/s": 1.0, "mm/min": 1e-3 / MINUTE, "m/min": 1 / MINUTE}
        | {"in/s": INCH, "in/min": INCH / MINUTE},
    ),
    "deg/s": (
        1.0,
        {"deg/s °/s": 1.0, "rad/s": RADIAN, "mrad/s": 1e-3 * RADIAN, "rev/s": TURN}
        | {"rpm r/min 1/min min-1 rev/min U/min": TURN / MINUTE},
    ),
    "kPa": (
        1e3,
        {"kPa": 1e3, "Pa": 1.0, "hPa mbar": 100.0, "bar": 1e5, "MPa": 1e6, "psi psig": POUND_FORCE / INCH**2},
    ),
    "mg": (1e-6, {"mg": 1e-6, "g": 1e-3, "kg": 1.0, "ug µg μg": 1e-9}),
    "mm³/s": (
        1e-9,
        {"mm³/s mm3/s ul/s µl/s μl/s": 1e-6 * LITRE, "nl/s": 1e-9 * LITRE, "ml/s mL/s": 1e-3 * LITRE}
        | {"mm³/min ul/min µl/min μl/min": 1e-6 * LITRE / MINUTE, "ml/h": 1e-3 * LITRE / 3600}
        | {"ml/min mL/min cc/min cm³/min": 1e-3 * LITRE / MINUTE},
    ),
    "g/cm³": (
        1e3,
        {"g/cm³ g/cm3 g/ml g/mL g/cc kg/l mg/mm³ mg/mm3": 1e3, "kg/m³ kg/m3": 1.0},
    ),
}  # fmt: skip
UNITS = [(kind, unit, worth / own) for kind, (own, units) in WORTH.items() for names, worth in units.items()
         for unit in names.split()]  # fmt: skip


@pytest.mark.parametrize(("kind", "unit", "share"), UNITS)
def test_a_unit_is_worth_its_definition(kind, unit, share):
    assert factor(unit, kind, "column") == pytest.approx(share, rel=1e-8)


def test_every_unit_is_defined_above():
    known = {(kind, unit) for kind, units in KINDS.items() for unit in units if kind and unit != "N m"}
    assert known == {(kind, unit) for kind, unit, _ in UNITS}


@pytest.mark.parametrize(("share", "size"), [("‰", 1e-3), ("0.1 %", 1e-3), ("%", 1e-2), ("percent", 1e-2)])
def test_a_share_of_a_rated_value_needs_that_value(share, size):
    assert factor(f"{share} of 1.27 N·m", "N·m", "torque") == pytest.approx(1.27 * size)
    assert factor(f"{share} of 300 mN·m", "N·m", "torque") == pytest.approx(0.3 * size)
    with pytest.raises(InputError) as refused:
        factor(share, "N·m", "torque")
    assert str(refused.value) == f"torque is in {share!r}: must say of what, as in '{share} of 1.27 N·m'"


def test_a_current_is_no_torque_without_its_constant():
    with pytest.raises(InputError) as refused:
        factor("mA", "N·m", "x torque")
    assert str(refused.value).startswith("x torque is in 'mA': must be in N·m, Nm, ")
    assert str(refused.value).endswith("; a current has a torque by its constant, COLUMN*0.0302 N·m")
    with pytest.raises(InputError, match=r"must be in mm, um, .*thou$"):
        factor("mA", "mm", "x position")
    assert factor("counts", "mm", "x position", {"counts": 5e-3}) == 5e-3
