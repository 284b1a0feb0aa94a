"""Lines and arcs beside their programmed paths: they meet where both pass, and the lengths of parts add up."""

import cmath
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.paths.plane_moves import PlaneMove, meeting

places = st.builds(complex, st.floats(-50, 50), st.floats(-50, 50))
headings = st.floats(-math.pi, math.pi)
# of a line 0, of an arc signed: positive for a centre on its left [1/mm]
curvatures = st.one_of(st.just(0.0), st.floats(0.02, 0.5), st.floats(-0.5, -0.02))


def move_about(place, heading, curvature, back, onward):
    """Return the move that passes a place with a heading, from `back` before it to `onward` after it [mm]."""
    along = cmath.rect(1.0, heading)
    if curvature == 0:
        return PlaneMove(place - back * along, place + onward * along)
    centre = place + 1j * along / curvature
    start = centre + (place - centre) * cmath.rect(1.0, -back * curvature)
    end = centre + (place - centre) * cmath.rect(1.0, onward * curvature)
    return PlaneMove(start, end, centre, (back + onward) * curvature)


def length_of(move):
    if move.centre is None:
        return abs(move.end - move.start)
    return abs(move.angle) * abs(move.end - move.centre)


def on_curve(move, place):
    """Distance of a place from the whole line or circle of a move [mm]."""
    if move.centre is not None:
        return abs(abs(place - move.centre) - abs(move.end - move.centre))
    along = (move.end - move.start) / abs(move.end - move.start)
    return abs(((place - move.start) * along.conjugate()).imag)


@given(
    places,
    headings,
    st.floats(0.3, 2.8),
    st.booleans(),
    curvatures,
    curvatures,
    st.floats(0.01, 0.4),
    st.floats(0.01, 0.4),
)
def test_two_moves_that_pass_a_place_meet_there(place, heading, corner, left, first, second, over, early):
    """Their other crossing, if circles have one, lies further away than what is cut off."""
    before = move_about(place, heading, first, 3.0, over)
    after = move_about(place, heading + (corner if left else -corner), second, early, 3.0)
    met = meeting(before, after)
    assert met is not None
    assert on_curve(before, met) < 1e-6
    assert on_curve(after, met) < 1e-6
    assert met == pytest.approx(place, abs=1e-5)


@given(places, headings, st.floats(0.3, 2.8), st.floats(0.1, 20))
def test_lines_that_stop_before_their_crossing_do_not_meet(place, heading, corner, gap):
    before = move_about(place, heading, 0.0, 3.0 + gap, -gap)
    after = move_about(place, heading + corner, 0.0, -gap, 3.0 + gap)
    reaching = move_about(place, heading, 0.0, 3.0, 0.1)
    begun = move_about(place, heading + corner, 0.0, 0.1, 3.0)
    assert meeting(before, begun) is None
    assert meeting(reaching, after) is None
    parallel = move_about(place + cmath.rect(gap, heading + math.pi / 2), heading, 0.0, 1.0, 3.0)
    assert meeting(reaching, parallel) is None


@given(places, headings, st.floats(0.02, 0.5), st.floats(0.02, 0.5), st.floats(0.1, 50))
def test_circles_and_lines_that_do_not_reach_each_other_do_not_meet(centre, heading, first, second, gap):
    away = cmath.rect(1.0, heading)
    circle = PlaneMove(centre + 1 / first, centre - 1 / first, centre, math.pi)
    other = centre + (1 / first + 1 / second + gap) * away
    further = PlaneMove(other + 1 / second, other - 1 / second, other, math.pi)
    assert meeting(circle, further) is None
    inside = PlaneMove(centre + 0.1 / first, centre - 0.1 / first, centre, math.pi)
    assert meeting(circle, inside) is None
    beside = centre + (1 / first + gap) * away
    line = PlaneMove(beside, beside + 1j * away)
    assert meeting(circle, line) is None
    assert meeting(line, circle) is None


@given(places, headings, curvatures, st.floats(0.5, 3), st.floats(0.5, 3))
def test_the_parts_of_a_move_before_and_behind_a_place_are_as_long_as_it(place, heading, curvature, back, onward):
    move = move_about(place, heading, curvature, back, onward)
    radius = 1.0 if curvature == 0 else 1 / abs(curvature)
    assert move.onward(place) * radius == pytest.approx(back, abs=1e-7)
    assert move.back(place) * radius == pytest.approx(onward, abs=1e-7)
    before = move.until(place)
    after = move.without(place)
    assert (before.start, before.end, after.start, after.end) == (move.start, place, place, move.end)
    assert length_of(before) == pytest.approx(back, abs=1e-7)
    assert length_of(after) == pytest.approx(onward, abs=1e-7)
    assert before.angle * curvature >= 0
    assert after.angle * curvature >= 0
    begun = move.begun_at(place)
    assert length_of(begun) == pytest.approx(onward if curvature else back + onward, abs=1e-7)


@given(places, headings, curvatures, st.floats(-1, 1))
def test_a_move_at_an_offset_keeps_its_distance_and_its_tangents(place, heading, curvature, offset):
    move = move_about(place, heading, curvature, 1.0, 2.0)
    beside = move.offset_move(offset)
    left = 1j * cmath.rect(offset, heading)
    assert on_curve(beside, place + left) < 1e-9
    assert (beside.start - move.start) / (1j * move.first_tangent) == pytest.approx(offset, abs=1e-9)
    assert (beside.end - move.end) / (1j * move.last_tangent) == pytest.approx(offset, abs=1e-9)
    # a circle about a centre on the left shrinks by an offset to the left
    assert length_of(beside) == pytest.approx(3.0 * (1 - curvature * offset), abs=1e-9)
    assert move.turns_towards(1.0) == (curvature > 0)
    assert move.turns_towards(-1.0) == (curvature < 0)


def test_a_move_of_less_than_a_picometre_stands():
    assert PlaneMove(1 + 1j, 1 + 1j + 1e-12).stands
    assert not PlaneMove(1 + 1j, 1 + 1j + 1e-6).stands
    assert not PlaneMove(1 + 1j, 1 + 1j, 2 + 1j, 2 * math.pi).stands
    unequal = PlaneMove(3 + 0j, 0 + 3.001j, 0j, math.pi / 2)
    assert unequal.smallest_radius == 3
