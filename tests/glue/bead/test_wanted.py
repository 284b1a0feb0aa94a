"""The section that a program wants: of each line its E per mm, by hand, on a machine that follows exactly."""

from types import SimpleNamespace

import numpy as np
import pytest

from gantrysim import Dispenser, perfect_follower
from gantrysim.controllers.gcode import slicer
from gantrysim.glue.bead import Bead, BeadSettings, Ploughing

PERIOD = 1e-3
PER_E = 10.0  # [mm³/mm]
SPEED = 20.0  # [mm/s]
FEED = f"F{60 * SPEED:g}"
# 1 and 2 mm² without a stop, and 3 mm² after a lift
WIDTHS = f"M83\nG1 X40 E4 {FEED}\nG1 X80 E8\nG0 Z5\nG0 X0 Y20\nG0 Z0\nG1 X40 E12 {FEED}\nG0 Z5\n"


def followed(machine, text, **dispenser):
    program = slicer.Program(text=text, start=(0, 0, 0), corner_tolerance=1e-3)
    setpoints = program.setpoints(PERIOD).hold(0.5)
    values = {"e_volume": PER_E} | dispenser
    return Bead(perfect_follower(machine, setpoints, dispenser=Dispenser(**values)), BeadSettings(contact_angle=90.0))


def near(bead, x, y):
    """The station nearest to a place on the work that has glue."""
    distance = np.hypot(bead.point[:, 0] - x, bead.point[:, 1] - y) + np.where(bead.area > 0, 0.0, 1e3)
    return int(distance.argmin())


def test_each_line_is_judged_against_its_own_section(xyz):
    bead = followed(xyz, WIDTHS)
    for x, y, area in ((20, 0, 1.0), (60, 0, 2.0), (20, 20, 3.0)):
        station = near(bead, x, y)
        assert bead.wanted[station] == pytest.approx(area, rel=1e-6)
        assert bead.area[station] == pytest.approx(area, rel=1e-6)
    inside = bead.dispensing & (bead.area > 0)
    error = bead.width[inside] / bead.wanted_section.width[inside] - 1
    # where a line ends its last station is not full
    assert np.quantile(np.abs(error), 0.98) < 0.01
    assert bead.requested_volume == pytest.approx(PER_E * 24, rel=1e-6)
    assert bead.values.ramp_error == pytest.approx(0.0, abs=1e-3)
    assert bead.total_volume == pytest.approx(PER_E * 24, rel=1e-6)
    assert bead.widest == pytest.approx(bead.wanted_section.width[near(bead, 20, 20)], rel=1e-6)


def test_a_step_from_one_width_to_the_next_keeps_its_volume_and_its_place(xyz):
    """The second line's surplus over the first is wanted, and stays on its side of the step."""
    bead = followed(xyz, WIDTHS)
    x, y = bead.point[:, 0], bead.point[:, 1]
    for low, high, area in ((5, 39, 1.0), (41, 75, 2.0)):
        line = (x > low) & (x < high) & (np.abs(y) < 1) & (bead.area > 0)
        assert bead.area[line] == pytest.approx(np.full(np.count_nonzero(line), area), rel=1e-6)


def test_a_lag_misses_the_same_length_at_the_start_of_each_width(xyz):
    """T v of each line's own section, and as much too much at its stop."""
    lag = 0.03
    values = followed(xyz, WIDTHS, opening=lag, closing=lag).values
    for length in (values.missing_at_start, values.excess_at_stop):
        assert (length.min, length.max) == pytest.approx((lag * SPEED, lag * SPEED), rel=5e-3)


def test_a_flow_that_does_not_follow_e_has_one_section(xyz):
    bead = followed(xyz, WIDTHS, e_volume=0.0, area=1.5)
    assert not bead.follows_material
    assert bead.wanted == pytest.approx(np.full(bead.place.size, 1.5))
    assert bead.requested_volume == pytest.approx(1.5 * 120, rel=1e-3)


def test_a_sharp_corner_of_a_wide_line_lies_within_the_glue_being_laid(xyz):
    """Two widths of the wide line, 16 mm, on either side of a corner of 34 deg; most of the path is a narrow line."""
    bead = followed(xyz, f"M83\nG1 X60 E0.6 {FEED}\nG1 X80 E40\nG1 X62 Y12 E40\n")
    assert Ploughing.of(bead, 4.0, 4.0) == Ploughing()


def test_a_station_counts_where_the_dispenser_is_on_and_one_of_a_stretch_that_is_shorter_than_their_distance(xyz):
    bead = followed(xyz, WIDTHS)
    ticks = np.flatnonzero(bead.run.dispense)
    ends = np.flatnonzero(np.diff(ticks) > 1)
    firsts = np.append(ticks[0], ticks[ends + 1])
    lasts = np.append(ticks[ends], ticks[-1]) + 1
    expected = np.zeros(bead.place.size, bool)
    for first, last in zip(firsts, np.minimum(lasts, bead.length.size - 1), strict=True):
        expected |= (bead.length[first] <= bead.place) & (bead.place <= bead.length[last])
    assert not expected.all()
    assert (bead.dispensing == expected).all()
    # a stretch between two stations has the one that is nearest to its begin
    short = SimpleNamespace(place=np.arange(5.0), length=np.array([0.0, 1.6, 1.8]), stretches=np.array([[1, 2]]))
    assert Bead.dispensing.func(short).tolist() == [False, False, True, False, False]
