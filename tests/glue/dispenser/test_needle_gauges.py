"""Gauges of needles: the nominal inches of regular-wall tubes, in millimetres."""

import pytest

from gantrysim.base.errors import InputError
from gantrysim.glue.dispenser.needle import GAUGES, Needle

# inner and outer diameter [inch]
INCHES = {
    "14G": (0.063, 0.083),
    "15G": (0.054, 0.072),
    "16G": (0.047, 0.065),
    "17G": (0.042, 0.058),
    "18G": (0.033, 0.050),
    "19G": (0.027, 0.042),
    "20G": (0.02375, 0.03575),
    "21G": (0.02025, 0.03225),
    "22G": (0.01625, 0.02825),
    "23G": (0.01325, 0.02525),
    "24G": (0.01225, 0.02225),
    "25G": (0.01025, 0.02025),
    "27G": (0.00825, 0.01625),
    "28G": (0.00725, 0.01425),
    "30G": (0.00625, 0.01225),
}


@pytest.mark.parametrize("gauge", INCHES)
def test_a_gauge_has_its_nominal_diameters(gauge):
    inner, outer = (25.4 * size for size in INCHES[gauge])
    assert GAUGES[gauge] == (pytest.approx(inner, abs=6e-4), pytest.approx(outer, abs=6e-4))
    needle = Needle(bore=gauge, length=12.0, consistency=1.0)
    assert (needle.inner, needle.face) == (GAUGES[gauge][0], pytest.approx(GAUGES[gauge][1]))


def test_other_gauges_are_refused():
    assert GAUGES.keys() == INCHES.keys()
    with pytest.raises(InputError, match="31G"):
        Needle(bore="31G", length=12.0, consistency=1.0)
