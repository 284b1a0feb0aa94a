"""Spirals by arc length: the involute of a circle and Archimedes' spiral."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.integrate import quad

from gantrysim.base.errors import InputError
from gantrysim.paths.lengths import arc_length, swept_along
from gantrysim.paths.spirals import Involute

from support.runs import archimedean
from support.soaked import examples

POSITION = 1e-9  # [mm]
QUADRATURE = 1e-10  # of Gauss' rule with 20 points over a tenth of a turn
FOOT = 1e-7  # arc length of a foot point [mm]
UNIT = 1e-12  # of a unit vector after tens of radians
PRINTED = 5e-4  # three decimals [mm]

BOTH = pytest.mark.parametrize("kind", [Involute, archimedean])
# D = 120 mm, 4 turns, thickness 10 mm; a = pitch / 2 pi
A = 10 / (2 * np.pi)


@st.composite
def spirals(draw):
    """Arguments of a spiral whose end radius is at least half a pitch."""
    pitch = draw(st.floats(1, 20))
    turns = draw(st.floats(0.2, 6))
    radius = pitch * turns + draw(st.floats(0.5 * pitch, 100))
    start = draw(st.tuples(st.floats(-100, 100), st.floats(-100, 100)))
    return radius, pitch, turns, start, draw(st.floats(-7, 7)), draw(st.booleans())


def gauss(function, low, high):
    """Integral of a function of the arc length, vector-valued, by Gauss' rule."""
    node, weight = np.polynomial.legendre.leggauss(20)
    return 0.5 * (high - low) * weight @ function(0.5 * (high + low) + 0.5 * (high - low) * node)


@BOTH
@given(spiral=spirals(), fraction=st.floats(0, 1))
@examples(50)
def test_tangent_is_unit_and_the_derivative_of_position_curvature_that_of_heading(kind, spiral, fraction):
    path = kind(*spiral)
    low = fraction * path.length
    reach = 0.1 * path.length / spiral[2]  # arcs of equal length turn more towards the end
    high = min(low + min(reach, 0.6 / abs(path.curvature(path.length)[0])), path.length)
    position, heading = path.position([low, high]), path.heading([low, high])
    scale = path.length
    assert position[1] - position[0] == pytest.approx(gauss(path.tangent, low, high), abs=QUADRATURE * scale)
    assert heading[1] - heading[0] == pytest.approx(gauss(path.curvature, low, high), abs=QUADRATURE * scale)
    tangent = path.tangent([low, high])
    assert np.linalg.norm(tangent, axis=1) == pytest.approx(np.ones(2), abs=1e-14)
    assert tangent == pytest.approx(np.stack([np.cos(heading), np.sin(heading), [0, 0]], axis=1), abs=1e-14)
    assert path.normal(low)[0] == pytest.approx(np.cross([0, 0, 1], tangent[0]), abs=UNIT)


@BOTH
@given(spiral=spirals())
@examples(50)
def test_starts_at_the_given_point_and_turns_in_the_given_sense(kind, spiral):
    path = kind(*spiral)
    sense = -1 if spiral[5] else 1
    assert path.position(0)[0] == pytest.approx([*spiral[3], 0], abs=POSITION)
    s = np.linspace(0, path.length, 20)
    assert np.all(sense * path.curvature(s) > 0)
    assert np.all(np.diff(sense * path.heading(s)) > 0)
    centre = [*spiral[3], 0] + spiral[0] * sense * np.array([-math.sin(spiral[4]), math.cos(spiral[4]), 0])
    # Archimedes' spiral is about that point; the involute's base circle lies a further on along the heading
    a = spiral[1] / (2 * np.pi)
    if kind is Involute:
        centre = centre + a * np.array([math.cos(spiral[4]), math.sin(spiral[4]), 0])
    assert path.centre == pytest.approx(centre, abs=POSITION)


@BOTH
@given(spiral=spirals(), shift=st.tuples(st.floats(-50, 50), st.floats(-50, 50)), angle=st.floats(-4, 4))
@examples(50)
def test_moved_turned_and_mirrored_spirals_have_moved_turned_and_mirrored_points(kind, spiral, shift, angle):
    radius, pitch, turns, start, heading, clockwise = spiral
    s = np.linspace(0, kind(*spiral).length, 30)
    z = kind(*spiral).position(s)[:, :2] @ [1, 1j]
    turned = kind(radius, pitch, turns, shift, heading + angle, clockwise).position(s)[:, :2] @ [1, 1j]
    assert turned == pytest.approx(complex(*shift) + np.exp(1j * angle) * (z - complex(*start)), abs=POSITION)
    # mirrored on the x axis
    mirrored = kind(radius, pitch, turns, (start[0], -start[1]), -heading, not clockwise).position(s)[:, :2] @ [1, 1j]
    assert mirrored == pytest.approx(z.conj(), abs=POSITION)


@BOTH
@given(spiral=spirals(), fraction=st.floats(0, 1), lateral=st.floats(-0.4, 0.4))
@examples(50)
def test_projection_of_a_point_on_a_normal_gives_back_its_arc_length_and_offset(kind, spiral, fraction, lateral):
    path = kind(*spiral)
    s, e = fraction * path.length, lateral * path.pitch
    foot = path.project(path.position(s) + e * path.normal(s))
    assert foot.s[0] == pytest.approx(s, abs=FOOT)
    assert foot.lateral[0] == pytest.approx(e, abs=FOOT)
    assert foot.distance[0] == pytest.approx(abs(e), abs=FOOT)


@given(spirals(), st.floats(0, 1))
@examples(50)
def test_every_normal_of_an_involute_touches_its_base_circle(spiral, fraction):
    """The string that unwinds: from the touching point on the base circle it is as long as the radius of curvature."""
    path = Involute(*spiral)
    s = fraction * path.length
    a = spiral[1] / (2 * np.pi)
    phi = abs(path.heading(s)[0] - spiral[4])
    to_centre = path.centre - path.position(s)[0]
    inward = path.normal(s)[0] * (-1 if spiral[5] else 1)
    assert to_centre @ path.tangent(s)[0] == pytest.approx(a, abs=POSITION)
    assert to_centre @ inward == pytest.approx(spiral[0] - a * phi, abs=POSITION)
    assert 1 / abs(path.curvature(s)[0]) == pytest.approx(spiral[0] - a * phi, abs=POSITION)


@pytest.mark.validates(
    "pitch of the continuous spiral along its normal",
    "involute of a circle",
    "1e-9 mm",
)
@given(spirals(), st.floats(0, 1))
@examples(50)
def test_normal_pitch_of_an_involute_is_exactly_the_pitch(spiral, fraction):
    radius, pitch, turns, start, heading, clockwise = spiral
    path = Involute(radius + pitch, pitch, turns + 1, start, heading, clockwise)
    a = pitch / (2 * np.pi)

    def at(phi):
        return (radius + pitch) * phi - 0.5 * a * phi**2

    phi = fraction * 2 * np.pi * turns
    inward = path.normal(at(phi))[0] * (-1 if clockwise else 1)
    next_turn = path.position(at(phi + 2 * np.pi))[0]
    assert next_turn - path.position(at(phi))[0] == pytest.approx(pitch * inward, abs=POSITION)


@given(spirals())
@examples(50)
def test_length_of_an_involute_is_the_integral_of_its_radius_of_curvature(spiral):
    radius, pitch, turns = spiral[:3]
    integral, _ = quad(lambda phi: radius - pitch / (2 * np.pi) * phi, 0, 2 * np.pi * turns)
    path = Involute(*spiral)
    assert path.length == pytest.approx(integral, rel=1e-12)
    assert path.angle == pytest.approx(2 * np.pi * turns, rel=1e-15)
    assert abs(path.heading(path.length)[0] - spiral[4]) == pytest.approx(2 * np.pi * turns, abs=1e-6)


@given(spirals(), st.floats(0.001, 1))
@examples(50)
def test_archimedes_radius_falls_by_the_pitch_a_turn_of_the_polar_angle(spiral, fraction):
    radius, pitch, turns, _, heading, clockwise = spiral
    path = archimedean(*spiral)
    a = pitch / (2 * np.pi)
    psi = fraction * 2 * np.pi * turns

    def speed(angle):
        return math.hypot(radius - a * angle, a)

    s = quad(speed, 0, psi, epsabs=1e-11, epsrel=1e-13)[0]
    first = complex(math.sin(heading), -math.cos(heading)) * (-1 if clockwise else 1)
    z = complex(*path.centre[:2]) + (radius - a * psi) * first * np.exp(1j * psi * (-1 if clockwise else 1))
    assert path.position(s)[0] == pytest.approx([z.real, z.imag, 0], abs=POSITION)
    assert path.length == pytest.approx(quad(speed, 0, 2 * np.pi * turns, epsrel=1e-13)[0], rel=1e-12)


def test_lengths_of_the_four_turn_spiral():
    assert Involute(60, 10, 4).length == pytest.approx(1005.310, abs=PRINTED)
    assert archimedean(60, 10, 4).length == pytest.approx(1006.183, abs=PRINTED)


def test_involute_of_the_four_turn_spiral_by_its_formula():
    path = Involute(60, 10, 4)
    phi = np.linspace(0, 8 * np.pi, 101)
    rho = 60 - A * phi
    x = 60 - A * np.sin(phi) - rho * np.cos(phi)
    y = A - A * np.cos(phi) + rho * np.sin(phi)
    s = 60 * phi - 0.5 * A * phi**2
    assert path.position(s) == pytest.approx(np.stack([x, y, 0 * x], axis=1), abs=POSITION)
    assert path.phi(s) == pytest.approx(phi, abs=1e-10)
    assert path.centre == pytest.approx([60, A, 0], abs=POSITION)
    assert path.position(path.length)[0] == pytest.approx([40, 0, 0], abs=POSITION)


def test_ends_of_the_four_turn_involute_from_its_true_centre():
    path = Involute(60, 10, 4)
    start, end = np.linalg.norm(path.position([0, path.length]) - path.centre, axis=1)
    assert start == pytest.approx(60.0211, abs=5e-5)
    assert end == pytest.approx(20.0632, abs=5e-5)


def test_involute_differs_from_archimedes_spiral_by_a_circle_of_radius_a():
    """At the same angle about the centre the difference is a (-sin phi, 1 - cos phi)."""
    for phi in np.linspace(0, 8 * np.pi, 33):
        s = quad(lambda angle: math.hypot(60 - A * angle, A), 0, phi, limit=200)[0]
        involute = Involute(60, 10, 4).position(60 * phi - 0.5 * A * phi**2)[0]
        difference = involute - archimedean(60, 10, 4).position(s)[0]
        assert difference == pytest.approx([-A * math.sin(phi), A * (1 - math.cos(phi)), 0], abs=POSITION)


def test_involute_about_a_given_point_starts_at_minus_a():
    path = Involute(60, 10, 4, start=(0, -A))
    assert path.centre == pytest.approx([60, 0, 0], abs=POSITION)


@BOTH
def test_counter_clockwise_is_the_mirror_image_with_its_centre_to_the_left(kind):
    right, left = kind(60, 10, 4), kind(60, 10, 4, clockwise=False)
    s = np.linspace(0, right.length, 50)
    assert left.position(s) == pytest.approx(right.position(s) * [-1, 1, 1], abs=POSITION)
    assert left.curvature(s) == pytest.approx(-right.curvature(s), abs=1e-12)
    assert right.centre[0] == pytest.approx(60, abs=POSITION)
    assert left.centre[0] == pytest.approx(-60, abs=POSITION)


@BOTH
def test_spiral_into_its_very_centre_ends_there(kind):
    path = kind(40, 10, 4)
    end = path.position(path.length)[0]
    # the involute ends on its base circle, at the distance a from the centre
    reach = A if kind is Involute else 0
    assert np.linalg.norm(end - path.centre) == pytest.approx(reach, abs=1e-6)
    assert np.isfinite(path.curvature(np.linspace(0, path.length, 100))).all()
    s = np.linspace(0, path.length, 2001)
    chords = np.linalg.norm(np.diff(path.position(s), axis=0), axis=1).sum()
    assert chords == pytest.approx(path.length, rel=1e-4)


@pytest.mark.parametrize("name", ["radius", "pitch", "turns"])
@pytest.mark.parametrize("value", [0, -1, math.nan, math.inf, "wide", None])
def test_a_parameter_out_of_its_bound_is_named(name, value):
    unit = "" if name == "turns" else " mm"
    text = {
        0: f"{name} = 0{unit}: must be greater than 0{unit}",
        -1: f"{name} = -1{unit}: must be greater than 0{unit}",
        math.inf: f"{name} = inf{unit}: must be finite",
        "wide": f"{name} = 'wide': must be a number",
        None: f"{name} = None: must be a number",
    }.get(value, f"{name} = nan{unit}: must be finite")
    with pytest.raises(InputError, match=f"^{text}$"):
        Involute(**{"radius": 60, "pitch": 10, "turns": 4, name: value})


def test_too_many_turns_for_the_radius_are_named_with_the_sum():
    bound = r"end radius = -10 mm \(radius 60 - turns 7 x pitch 10\): must be at least 0 mm"
    with pytest.raises(InputError, match=bound):
        Involute(60, 10, 7)
    assert Involute(60, 10, 6).length > 0


# The length of ds = sqrt((r + b phi)^2 + c^2) d(phi)

LENGTH = 1e-12  # of an arc length, relative

powers = st.floats(-12, 3).map(lambda x: 10**x)
nothing_or_more = st.one_of(st.just(0.0), powers)
signed = st.one_of(st.just(0.0), powers, powers.map(lambda x: -x))
angles = st.floats(-6, math.log10(900)).map(lambda x: 10**x)


def integral(r, b, c, angle):
    """The length by quadrature over pieces that double on the way from where the radius is smallest.

    There the speed is c; it changes over c / b, which one rule over the whole angle would miss.
    """
    centre = min(max(-r / b, 0.0), angle) if b else 0.0
    first = min(max(abs(c / b), 1e-12 * angle), angle) if b else angle
    reach = first * 2.0 ** np.arange(60)
    edges = np.unique(np.clip([0, angle, centre, *(centre + reach), *(centre - reach)], 0, angle))
    node, weight = np.polynomial.legendre.leggauss(40)
    low, high = edges[:-1, None], edges[1:, None]
    phi = 0.5 * (high + low) + 0.5 * (high - low) * node
    return float((0.5 * (high - low) * weight * np.hypot(r + b * phi, c)).sum())


@given(r=nothing_or_more, b=signed, c=nothing_or_more, angle=angles)
@examples(500)
def test_arc_length_is_the_integral_of_the_speed_over_all_magnitudes(r, b, c, angle):
    assert arc_length(r, b, c, angle)[0] == pytest.approx(integral(r, b, c, angle), rel=LENGTH, abs=1e-300)


@given(r=st.floats(0, 200), b=st.floats(-5, 5), c=st.floats(0.01, 20), angle=st.floats(1e-6, 30))
@examples(100)
@example(r=8.7e-305, b=-3.0, c=2.0625, angle=2.0)
def test_arc_length_is_that_of_quadpack_and_only_the_square_of_c_counts(r, b, c, angle):
    points = [-r / b] if b and 1e-9 < -r / b < angle else None  # QUADPACK warns of a part without a length
    expected = quad(lambda phi: math.hypot(r + b * phi, c), 0, angle, epsabs=0, epsrel=1e-12, limit=500, points=points)[
        0
    ]
    assert arc_length(r, b, c, angle)[0] == pytest.approx(expected, rel=1e-10, abs=1e-300)
    assert arc_length(r, b, -c, angle)[0] == arc_length(r, b, c, angle)[0]


def swept_angle(r, b, c, s, most):
    return swept_along(float(r), float(b), float(c), np.array([s], float), float(most))[0]


@pytest.mark.parametrize("c", [0.0, 5e-324, 1e-310, 1e-200, 1e-160, 1e-20])
@pytest.mark.parametrize(("r", "b", "expected"), [(3, 1, 8), (3, -1, 4), (0, 1, 2), (2, -1, 2), (4, 0, 8)])
def test_arc_length_of_a_vanishing_c_is_that_of_the_radius_alone(r, b, c, expected):
    assert arc_length(r, b, c, 2.0)[0] == pytest.approx(expected, rel=LENGTH)
    assert swept_angle(r, b, c, expected, 2.0) == pytest.approx(2.0, rel=1e-7)


@given(r=nothing_or_more, b=signed, c=nothing_or_more, angle=angles, share=st.floats(0, 1))
@examples(500)
def test_swept_angle_is_the_inverse_of_the_arc_length(r, b, c, angle, share):
    b = max(b, -r / angle)  # as far as to the very centre
    s = arc_length(r, b, c, share * angle)[0]
    phi = swept_angle(r, b, c, s, angle)
    assert 0 <= phi <= angle
    whole = arc_length(r, b, c, angle)[0]
    assert arc_length(r, b, c, phi)[0] == pytest.approx(s, abs=LENGTH * whole)
    if r > 0 and b >= 0:  # the speed does not vanish, so the angle is as good
        assert phi == pytest.approx(share * angle, rel=LENGTH, abs=1e-14)


def test_arc_length_broadcasts():
    r, angle = np.array([1.0, 2.0, 3.0]), np.linspace(0.1, 40, 3)
    one_by_one = [float(arc_length(r[k], -0.01, 0.5, angle[k])[0]) for k in range(3)]
    together = arc_length(r, -0.01, 0.5, angle)
    assert together == pytest.approx(one_by_one, rel=1e-14)


def test_swept_angle_stays_at_the_ends_beyond_them():
    assert [swept_angle(10, -0.1, 0.5, s, 20) for s in (-1, 1e9)] == [0, 20]


# The involute that climbs


@given(spirals(), st.floats(-80, 80), st.floats(1e-6, 1))
@examples(100)
def test_an_involute_with_a_height_lies_over_the_flat_one_and_climbs_evenly_with_the_angle(spiral, height, share):
    radius, pitch, turns = spiral[:3]
    path, flat = Involute(*spiral, height=height), Involute(*spiral)
    a, climb = pitch / (2 * math.pi), height / (2 * math.pi * turns)
    phi = share * 2 * math.pi * turns

    def way(angle):
        return quad(lambda x: math.hypot(radius - a * x, climb), 0, angle, epsabs=0, epsrel=1e-13)[0]

    s = way(phi)
    assert path.length == pytest.approx(way(2 * math.pi * turns), rel=LENGTH)
    assert path.phi(s)[0] == pytest.approx(phi, abs=1e-10)
    below = flat.position(radius * phi - 0.5 * a * phi**2)[0]
    assert path.position(s)[0] == pytest.approx([*below[:2], climb * phi], abs=POSITION)
    assert path.climb(s)[0] == pytest.approx(climb / math.hypot(radius - a * phi, climb), abs=UNIT)
    sense = -1 if spiral[5] else 1
    assert path.heading(s)[0] == pytest.approx(spiral[4] + sense * phi, abs=1e-10)
    assert path.curvature(s)[0] == pytest.approx(sense / math.hypot(radius - a * phi, climb), rel=1e-9)
    assert path.position(path.length)[0, 2] == pytest.approx(height, abs=POSITION)


@given(spirals(), st.floats(-80, 80), st.floats(0, 1))
@examples(50)
def test_tangent_of_an_involute_that_climbs_is_the_derivative_of_position(spiral, height, fraction):
    path = Involute(*spiral, height=height)
    low = fraction * path.length
    high = min(low + 0.5 / np.abs(path.curvature([0, path.length])).max(), path.length)
    position, heading = path.position([low, high]), path.heading([low, high])
    assert position[1] - position[0] == pytest.approx(gauss(path.tangent, low, high), abs=QUADRATURE * path.length)
    assert heading[1] - heading[0] == pytest.approx(gauss(path.curvature, low, high), abs=QUADRATURE * path.length)


def test_height_is_part_of_the_parameters_and_must_be_finite():
    path = Involute(60, 10, 4, height=12)
    assert type(path)(**path.parameters()) == path
    for height in (math.nan, math.inf):
        with pytest.raises(InputError, match=rf"^height = {height} mm: must be finite$"):
            Involute(60, 10, 4, height=height)


@given(spirals())
def test_points_of_an_involute_are_rounded_as_its_equations_are_by_numpy(arguments):
    path = Involute(*arguments)
    s = np.linspace(0, path.length, 101)
    phi, a = path.phi(s), path.pitch / (2 * np.pi)
    rho = path.radius - a * phi
    u = a - a * np.cos(phi) + rho * np.sin(phi)
    w = path.radius - a * np.sin(phi) - rho * np.cos(phi)
    c, d, left = np.cos(path.heading_start), np.sin(path.heading_start), -w if path.clockwise else w
    x, y = path.start[0] + u * c - left * d, path.start[1] + u * d + left * c
    assert np.array_equal(path.position(s), np.stack([x, y, np.zeros(101)], axis=1))
