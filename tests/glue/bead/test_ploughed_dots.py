"""The needle's passes through dots that it has laid, against chords of a cap, by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gantrysim import Dispenser, Machine, perfect_follower
from gantrysim.controllers.gcode.linuxcnc import Program
from gantrysim.glue.bead import Bead, BeadSettings, Ploughing

XYZ = Machine("xyz")
FACE = 0.8  # [mm]
GAP = 0.5  # [mm]
HEIGHT = 1.2  # of a dot [mm]
VOLUME = 4.0  # [mm³]
RADIUS = math.sqrt((6 * VOLUME / (math.pi * HEIGHT) - HEIGHT**2) / 3)  # of its foot
SPHERE = (RADIUS**2 + HEIGHT**2) / (2 * HEIGHT)
DOT = "G0 X{x} Y{y}\nG0 Z{z}\nM3\nG4 P0.2\nM5\n"


def laid(*lines):
    text = "G21 G90 G61 F1200\n" + "".join(line + "\n" for line in lines)
    setpoints = Program(text=text, start=(-20, 0, 5)).setpoints(1e-3).hold(0.2)
    run = perfect_follower(XYZ, setpoints, dispenser=Dispenser(flow=VOLUME / 0.2))
    return Bead(replace(run, face=FACE, gap=GAP), BeadSettings(dot_height=HEIGHT))


def dot(x=0.0, y=0.0, z=0.0):
    return DOT.format(x=x, y=y, z=z)


def ploughed(bead):
    return Ploughing.of(bead, 4.0, 4.0)


def reach(z):
    """Distance from a dot's middle at which a needle at a height touches it: the cap's chord, and half the face."""
    return math.sqrt(SPHERE**2 - (z + GAP + SPHERE - HEIGHT) ** 2) + FACE / 2


def passed(z, y):
    """A dot in the origin, and a dry pass beside its middle at a height."""
    return laid(dot(), "G0 Z5", f"G0 X-10 Y{y}", f"G0 Z{z}", f"G0 X10 Y{y}", "G0 Z5")


@pytest.mark.parametrize("z", [0.0, 0.4])
@pytest.mark.parametrize(("beside", "touches"), [(0.0, True), (-0.02, True), (0.02, False)])
def test_a_needle_that_passes_a_dot_within_its_chord_ploughs_it(z, beside, touches):
    y = reach(z) + beside if beside else 0.0
    found = ploughed(passed(z, y))
    if not touches:
        assert found == Ploughing()
        return
    assert (found.passes, found.dots) == (1, 1)
    assert found.length == pytest.approx(2 * RADIUS, rel=1e-6)
    assert found.depth == pytest.approx(HEIGHT - GAP - z, abs=1e-6)


@pytest.mark.parametrize(("above", "passes"), [(0.02, 0), (-0.02, 1)])
def test_a_needle_above_a_dot_is_free(above, passes):
    assert ploughed(passed(HEIGHT - GAP + above, 0.0)).passes == passes


@pytest.mark.parametrize(("beside", "dots"), [(-0.1, 1), (0.1, 0)])
def test_a_bead_through_a_dot_ploughs_it_where_the_needles_axis_passes(beside, dots):
    y = reach(0.0) - FACE / 2 + beside
    found = ploughed(laid(dot(), "G0 Z5", f"G0 X-15 Y{y}", "G0 Z0", "M3", "G1 X15", "M5", "G0 Z5"))
    assert found.dots == dots


def test_a_needle_ploughs_neither_the_dot_that_it_lays_nor_one_that_it_leaves():
    lifted = laid(dot(), "G0 Z5", dot(10), "G0 Z5")
    assert len(lifted.dots) == 2
    assert ploughed(lifted) == Ploughing()
    # a dot dragged along draws a string, which is another matter
    assert ploughed(laid(dot(), "G0 X20", "G0 Z5")) == Ploughing()


def test_a_dot_upon_a_dot_is_a_joint():
    twice = laid(dot(), "G0 Z5", "G0 X20", dot(), "G0 Z5", "G0 X20")
    assert len(twice.dots) == 2
    assert ploughed(twice) == Ploughing()


def test_a_low_way_back_over_a_row_of_dots_ploughs_all_but_the_last():
    row = [line for x in (0, 8, 16, 24) for line in (dot(x), "G0 Z5")]
    found = ploughed(laid(*row, "G0 X30", "G0 Z0.2", "G0 X-10", "G0 Z5"))
    assert (found.passes, found.dots) == (4, 4)
    # without the lift after the last
    found = ploughed(laid(*row[:-1], "G0 X-10", "G0 Z5"))
    assert (found.passes, found.dots) == (3, 3)
    assert found.length == pytest.approx(3 * 2 * RADIUS, rel=1e-6)


def test_a_dot_among_beads_keeps_its_place_in_their_order():
    """A stroke before the dot and one after it; the way back crosses all three."""
    strokes = ["G0 X{0} Y-10", "G0 Z0", "M3", "G1 X{0} Y10", "M5", "G0 Z5"]
    before, after = ([line.format(x) for line in strokes] for x in (-12, 12))
    crossing = ["G0 X30 Y0", "G0 Z0", "G0 X-30 Y0", "G0 Z5"]
    found = ploughed(laid(*before, dot(), "G0 Z5", *after, *crossing))
    assert (found.passes, found.dots) == (3, 1)
    strip = found.length - 2 * RADIUS
    # of each stroke a diameter of the needle, to a station at either edge
    assert np.abs(strip - 2 * FACE) < 4 * 0.25
