"""What outline tracing refuses: places out of reach, outlines that are none, values out of their bounds."""

import math

import numpy as np
import pytest
from hypothesis import given

from gantrysim.base.errors import InputError
from gantrysim.controllers.stage import OutlineTrace

from support.outlines import POSITION, RECTANGLE, Rounded, on_the_work, traces
from support.soaked import examples


def test_the_extremes_of_the_travel_are_within_corners():
    """With n_K at 45 deg the arc of radius 190 about its centre has its furthest place in the middle of a corner."""
    n = (-math.sqrt(0.5), math.sqrt(0.5))
    set_up = {"needle": (-200 * math.sqrt(0.5), 200 * math.sqrt(0.5)), "normal": n}
    s = np.linspace(0, 302.8318530717959, 400_001)
    th, x, y = OutlineTrace(**set_up).coordinates(s).T
    assert np.abs(th).max() > 300
    for name, values in (("travel_x", x), ("travel_y", y)):
        low, high = values.min(), values.max()
        OutlineTrace(**set_up, **{name: (low - 1e-6, high + 1e-6)})
        for bad in ((low + 1e-4, high + 1), (low - 1, high - 1e-4)):
            with pytest.raises(InputError, match=rf"needs stage {name[-1]} = "):
                OutlineTrace(**set_up, **{name: bad})


@given(traces())
@examples(40)
def test_travel_limits_hold_for_the_extremes_of_any_outline(job):
    trace = OutlineTrace(**job)
    s = np.concatenate(
        [np.linspace(a, b, 3001) for a, b in zip(trace.turning.s[:-1], trace.turning.s[1:], strict=True)]
    )
    x = trace.coordinates(s)[:, 1]
    OutlineTrace(**job, travel_x=(x.min() - 1e-3, x.max() + 1e-3))
    for bad in ((x.min() + 1e-6, x.max() + 1), (x.min() - 1, x.max() - 1e-6)):
        with pytest.raises(InputError, match="needs stage x = "):
            OutlineTrace(**job, travel_x=bad)


def test_travel_that_is_exactly_sufficient_is_accepted():
    OutlineTrace(travel_x=(-150, 150), travel_y=(-170, 170))


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        (
            {"travel_x": (-100, 100)},
            "outline piece 1 of 8, at 0 mm: needle (-200, 0) mm needs stage x = 150 mm at th = 0 deg: "
            "must be from -100 to 100 mm; move the needle, the work centre or the centre of rotation",
        ),
        (
            {"travel_y": (-170, 169)},
            "outline piece 6 of 8, at 207.1 mm: needle (-200, 0) mm needs stage y = 170 mm at th = 270 deg: "
            "must be from -170 to 169 mm; move the needle, the work centre or the centre of rotation",
        ),
        (
            {"travel_y": (-100, math.inf)},
            "outline piece 2 of 8, at 55.71 mm: needle (-200, 0) mm needs stage y = -170 mm at th = 90 deg: "
            "must be from -100 to inf mm; move the needle, the work centre or the centre of rotation",
        ),
        ({"travel_x": (3, 1)}, "travel_x = (3, 1) mm: must be a lower and an upper limit"),
        ({"travel_y": (1, 1)}, "travel_y = (1, 1) mm: must be a lower and an upper limit"),
        ({"travel_y": (1, 2, 3)}, "travel_y = (1, 2, 3) mm: must be a lower and an upper limit"),
        ({"travel_x": (math.nan, 1)}, "travel_x = (nan, 1) mm: must be a lower and an upper limit"),
        (
            {"corner_radius": 31},
            "corner_radius = 31 mm: must be at most 30 mm for edge 1 of 60 mm",
        ),
        (
            {"corners": ((0, 0), (100, 0), (100, 2), (50, 60), (0, 80)), "corner_radius": 20},
            "corner_radius = 20 mm: must be at most 1.45822 mm for edge 2 of 2 mm",
        ),
        (  # edge 1 lacks most, and edge 4 has room for less
            {"corners": ((-28, -71), (3, 94), (-27, 77), (-24, 64)), "corner_radius": 20},
            "corner_radius = 20 mm: must be at most 10.4569 mm for edge 4 of 135.059 mm",
        ),
        ({"corners": ((0, 0), (100, 0))}, "outline of 2 corners: must have at least 3"),
        ({"corners": ((0, 0), (9, 0), (9, 0), (0, 5))}, "outline: corners 2 and 3 coincide"),
        ({"corners": ((0, 0), (9, 0), (9, 9), (0, 0))}, "outline: corners 4 and 1 coincide"),
        (
            {"corners": ((0, 0), (100, 0), (50, 0))},
            "outline: has no area: its corners must not be collinear, nor its edges cross",
        ),
        ({"corners": ((0, 0), (100, 0), (50, 0), (50, 50))}, "outline: doubles back at corner 2"),
        ({"corners": ((50, 50), (0, 0), (100, 0), (50, 0))}, "outline: doubles back at corner 3"),
        (
            {"corners": ((0, 0), (100, 0), (10, 80), (100, 90))},
            "outline: edges 2 and 4 cross: must not",
        ),
        (
            {"corners": tuple((math.cos(0.8 * math.pi * k) * 50, math.sin(0.8 * math.pi * k) * 50) for k in range(5))},
            "outline: edges 1 and 3 cross: must not",
        ),
        ({"corners": ((0, 0), (1, math.inf), (5, 5))}, "outline corner 2 y = inf mm: must be finite"),
        ({"blend": 1e4}, "blend = 10000 mm: must be at most the length of the outline, 302.832 mm"),
        ({"blend": -1}, "blend = -1 mm: must be at least 0 mm"),
        (
            {"blend": 1, "corner_pieces": 2},
            "blend = 1 mm: must be 0 mm where corner_pieces is 2; linear pieces are not blended",
        ),
        ({"velocity": (1, 2)}, "velocity of 2 values: must be three, of th, x and y"),
        ({"velocity": (1, -2, 3)}, "velocity of x = -2 mm/s: must be greater than 0 mm/s"),
        ({"velocity": (0, 2, 3)}, "velocity of th = 0 deg/s: must be greater than 0 deg/s"),
        ({"acceleration": (0, 1, 1)}, "acceleration of th = 0 deg/s²: must be greater than 0 deg/s²"),
        ({"acceleration": (1, 1, math.nan)}, "acceleration of y = nan mm/s²: must be finite"),
        ({"acceleration": (1, -math.inf, 1)}, "acceleration of x = -inf mm/s²: must be finite"),
        ({"sigma": 0}, "sigma = 0: must be 1 or -1"),
        ({"normal": (0, 0)}, "normal = (0, 0): must have a direction"),
        ({"normal": (0, math.nan)}, "normal y = nan mm: must be finite"),
        ({"needle": (1, 2, 3)}, "needle = (1, 2, 3): must be two numbers, x and y [mm]"),
        ({"centre": (math.inf, 0)}, "centre x = inf mm: must be finite"),
        ({"work_centre": (0,)}, "work_centre = (0,): must be two numbers, x and y [mm]"),
        ({"corner_pieces": 1.5}, "corner_pieces = 1.5: must be a whole number"),
        ({"corner_pieces": -1}, "corner_pieces = -1: must be at least 0"),
        ({"width": 0}, "width = 0 mm: must be greater than 0 mm"),
        ({"height": -60}, "height = -60 mm: must be greater than 0 mm"),
        ({"corner_radius": 0}, "corner_radius = 0 mm: must be greater than 0 mm"),
        ({"speed": -1}, "speed = -1 mm/s: must be greater than 0 mm/s"),
    ],
)
def test_a_value_out_of_its_bound_is_named_in_full(changed, text):
    with pytest.raises(InputError) as error:
        OutlineTrace(**changed)
    assert str(error.value) == text


def test_the_suggested_largest_radius_is_accepted():
    corners = ((0, 0), (100, 0), (100, 2), (50, 60), (0, 80))
    assert OutlineTrace(corners=corners, corner_radius=1.4582).corner_radius == 1.4582
    corners = ((-28, -71), (3, 94), (-27, 77), (-24, 64))
    assert OutlineTrace(corners=corners, corner_radius=10.4569).corner_radius == 10.4569
    assert OutlineTrace(corner_radius=30).requested.length == pytest.approx(2 * 40 + 60 * math.pi)


def test_edges_of_zero_length_between_arcs_are_accepted():
    """A radius of half the height: the short edges are gone, and the long ones join half circles."""
    trace = OutlineTrace(corner_radius=30, acceleration=(3000.0, 3000.0, 3000.0))
    s = np.linspace(0, trace.requested.length, 2001)
    assert on_the_work(trace, trace.coordinates(s)) == pytest.approx(Rounded(RECTANGLE, 30)(s)[0], abs=POSITION)
    assert np.all(np.diff(trace.turning.s) > 1)


def test_a_corner_without_a_turn_is_accepted():
    corners = ((-50, -30), (-50, 0), (-50, 30), (50, 30), (50, -30))
    trace = OutlineTrace(corners=corners)
    s = np.linspace(0, trace.requested.length, 2001)
    assert trace.coordinates(s) == pytest.approx(OutlineTrace().coordinates(s), abs=POSITION)
    # nor does it halt there
    held, plain = (OutlineTrace(corners=c, acceleration=(3000.0,) * 3).duration for c in (corners, RECTANGLE))
    assert held == pytest.approx(plain, rel=1e-4)


@pytest.mark.parametrize(
    ("corners", "text"),
    [
        (((0, 0), (60, 0), (60, 60), (30, -30), (0, 60)), "edges 1 and 3 cross"),
        (((0, 0), (0, 60), (60, 0), (60, 90)), "edges 2 and 4 cross"),
    ],
)
def test_an_outline_whose_edges_cross_is_refused(corners, text):
    with pytest.raises(InputError, match=f"^outline: {text}: must not$"):
        OutlineTrace(corners=corners, corner_radius=2)


def test_an_outline_that_touches_itself_and_winds_twice_is_refused():
    corners = ((0, 0), (60, 0), (60, 60), (0, 60), (0, 0), (30, 0), (30, 30), (0, 30))  # two squares by one corner
    with pytest.raises(InputError, match=r"^outline: (turns by 720 deg in total: must not cross itself|.* coincide)"):
        OutlineTrace(corners=corners, corner_radius=2)
