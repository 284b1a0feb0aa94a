"""One spiral by three controllers: they agree but for what their methods make of it.

D = 120 mm, pitch 10 mm, 4 turns from (0, 0), first towards +y, about (60, 0) or what the method takes for it, down
to (40, 0). With the tangent's or polar angle phi since the start, a = pitch / 2 pi and rho = R - a phi:

    involute      p(phi) = (R - a sin(phi) - rho cos(phi),  a - a cos(phi) + rho sin(phi)),
    Archimedes'   q(phi) = (R - rho cos(phi),  rho sin(phi)).
"""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.controllers import fanuc, softmc
from gantrysim.controllers.trio import MoveSpiral

from support.soaked import examples

POSITION = 1e-8  # [mm]
TICK = 1e-3  # [s]


def trio(radius, pitch, turns, loop_period, speed=100.0):
    return MoveSpiral(2 * radius, turns, pitch, speed, loop_period=loop_period)


def block(radius, pitch, turns, speed=100.0):
    """FANUC's spiral interpolation about (R, 0), as one block."""
    spiral = fanuc.Spiral(end=(pitch * turns, 0.0), centre=(radius, 0.0), change=-pitch, feed=60 * speed)
    return fanuc.Program((spiral,), end_point_tolerance=1e-9)


def half_circles(radius, pitch, turns):
    """Half circles about two centres, a quarter of the pitch on either side of (R, 0)."""
    centres = [(radius + (-1) ** (k + 1) * pitch / 4, 0.0) for k in range(2 * turns)]
    circles = tuple(softmc.Circle(angle=-180.0, centre=centre) for centre in centres)
    group = softmc.Group(velocity=100.0, profile="constant")
    return softmc.Program(circles, group)


def polar(points, radius):
    """Distance from (R, 0), and the angle about it since the start, clockwise, not wrapped."""
    z = points[:, :2] @ [1, 1j] - radius
    return np.abs(z), -np.unwrap(np.angle(z * -1))


def involute(phi, radius, pitch):
    a = pitch / (2 * math.pi)
    rho = radius - a * phi
    x, y = radius - a * np.sin(phi) - rho * np.cos(phi), a - a * np.cos(phi) + rho * np.sin(phi)
    return np.stack([x, y], axis=1)


def tangent_angle(path, s):
    """Of a path that starts towards +y and turns clockwise."""
    return 0.5 * math.pi - path.heading(s)


spirals = st.tuples(st.floats(20, 200), st.integers(1, 6), st.floats(0.1, 0.95)).map(
    lambda drawn: (drawn[0], drawn[0] * drawn[2] / drawn[1], drawn[1])
)


@given(spirals)
@examples(40)
def test_trios_continuous_limit_less_fanucs_block_is_a_times_minus_sin_and_one_less_cos(spiral):
    """At the same angle both have the same rho: p - q = a (-sin(phi), 1 - cos(phi)), at most 2 a = pitch / pi."""
    radius, pitch, turns = spiral
    ours, theirs = trio(*spiral, loop_period=0), block(*spiral)
    q = theirs.setpoints(theirs.duration / 500.5).position
    rho, phi = polar(q, radius)
    a = pitch / (2 * math.pi)
    assert rho == pytest.approx(radius - a * phi, abs=POSITION)
    assert phi[-1] == pytest.approx(2 * math.pi * turns, abs=1e-7)
    # the involute's arc length at the angle phi
    p = ours.generated.position(radius * phi - 0.5 * a * phi**2)[:, :2]
    difference = a * np.stack([-np.sin(phi), 1 - np.cos(phi)], axis=1)
    assert p - q[:, :2] == pytest.approx(difference, abs=POSITION)
    assert np.linalg.norm(p - q[:, :2], axis=1).max() == pytest.approx(2 * a, rel=1e-3)
    # they meet at every whole turn
    whole = theirs.requested.position([0, theirs.requested.length])
    assert whole[:, :2] == pytest.approx(np.array([[0, 0], [pitch * turns, 0]]), abs=POSITION)


def test_the_block_of_the_notes_in_text():
    text = fanuc.Program("G17 G21 G90\nG02 X40 Y0 I60 J0 Q-10 F6000\nM30").setpoints(TICK)
    assert text.position == pytest.approx(block(60, 10, 4).setpoints(TICK).position, abs=POSITION)


def test_setpoints_of_trio_and_fanuc_at_the_servo_period():
    ours, theirs = trio(60, 10, 4, 0).setpoints(TICK), block(60, 10, 4).setpoints(TICK)
    phi = polar(theirs.position, 60)[1]
    a = 10 / (2 * math.pi)
    expected = theirs.position[:, :2] + a * np.stack([-np.sin(phi), 1 - np.cos(phi)], axis=1)
    assert involute(phi, 60, 10) == pytest.approx(expected, abs=POSITION)
    # Trio's own setpoints lie on that curve, 0.1 mm apart
    angle = (60 - np.sqrt(60**2 - 2 * a * np.minimum(100 * ours.time, ours.requested.length))) / a
    assert ours.position == pytest.approx(involute(angle, 60, 10), abs=POSITION)
    # at the same path speed FANUC takes longer by its longer way: 1006.183 against 1005.310
    assert block(60, 10, 4).requested.length == pytest.approx(1006.183, abs=5e-4)
    assert trio(60, 10, 4, 0).requested.length == pytest.approx(1005.310, abs=5e-4)
    assert (len(theirs.time) - len(ours.time)) * TICK == pytest.approx((1006.183 - 1005.310) / 100, abs=2 * TICK)
    for setpoints in (ours, theirs):
        speed = np.linalg.norm(np.diff(setpoints.position, axis=0), axis=1)[:-1] / TICK
        assert speed == pytest.approx(np.full(speed.size, 100), rel=2e-6)  # chords at R = 20 mm


@pytest.mark.parametrize("loop_period", [0.1, 0.01, 0.001])
def test_a_small_loop_period_deviates_from_the_continuous_limit_by_a_radius_step(loop_period):
    """The places differ by as much as a step of the radius and a little more.

    At the angle phi the loop's radius is below the involute's by e(phi), a saw from R change at the start of a pass
    to 0 at its end. The places differ by the integral of e exp(j phi). The saw's mean gives R change / 2 times at most
    |exp(j phi) - 1| = 2, so R change; the saw about its mean gives R change delta / 12 a radian, with delta = V T / R
    the angle of a pass, and as much as R change delta / 8 within one. FANUC's block is off by 2 a more.
    """
    spiral = trio(60, 10, 4, loop_period)
    path = spiral.generated
    s = np.linspace(0, path.length, 20_001)
    phi = tangent_angle(path, s)
    off = np.linalg.norm(path.position(s)[:, :2] - involute(phi, 60, 10), axis=1)
    step, delta = 60 * spiral.change, 100 * loop_period / 60
    bound = step * (1 + delta * (phi[-1] / 12 + 1 / 8))
    assert 0.9 * step <= off.max() <= bound
    a = 10 / (2 * math.pi)
    rho = 60 - a * phi
    archimedes = np.stack([60 - rho * np.cos(phi), rho * np.sin(phi)], axis=1)
    apart = np.linalg.norm(path.position(s)[:, :2] - archimedes, axis=1)
    assert 2 * a - bound <= apart.max() <= 2 * a + bound


@given(spirals)
@examples(12)
def test_two_centred_half_circles_meet_archimedes_at_every_half_turn_and_bulge_in_between(spiral):
    """Half circles of the radii R - pitch/4 - k pitch/2 about (R -+ pitch/4, 0) begin and end on Archimedes' spiral.

    About (R, 0) a circle whose centre is e = pitch/4 off has the polar radius e cos(psi) + sqrt(r^2 - e^2 sin^2(psi)),
    and r = R_k - e where R_k is the spiral's radius at the half turn's start. Less the spiral's R_k - pitch psi / 2 pi,

        (pitch/4) (cos(psi) - 1 + 2 psi / pi) - e^2 sin^2(psi) / 2 r ...

    whose first term is at most (pitch/4) (sqrt(1 - 4/pi^2) - 1 + (2/pi) asin(2/pi)) = 0.0526 pitch, at
    sin(psi) = 2 / pi, and as far inward in the second quarter; the root is short of r by at most e^2 / r there.
    """
    radius, pitch, turns = spiral
    theirs, exact = half_circles(*spiral), block(*spiral)
    path = theirs.requested
    e = pitch / 4
    radii = radius - e - 0.5 * pitch * np.arange(2 * turns)
    ends = np.concatenate([[0], np.cumsum(math.pi * radii)])
    assert path.length == pytest.approx(ends[-1], rel=1e-12)
    # every half turn both are at the same place
    joints = path.position(ends)[:, :2]
    rho, phi = radius - 0.5 * pitch * np.arange(2 * turns + 1), math.pi * np.arange(2 * turns + 1)
    archimedes = np.stack([radius - rho * np.cos(phi), rho * np.sin(phi)], axis=1)
    assert joints == pytest.approx(archimedes, abs=POSITION)
    at = exact.requested.position(np.linspace(0, exact.requested.length, 40_001))
    assert polar(at, radius)[0] == pytest.approx(radius - pitch / 2 / math.pi * polar(at, radius)[1], abs=POSITION)
    # between them it is off by the bound, outward first and then inward
    s = np.linspace(0, path.length, 4000 * turns + 1)
    r, psi = polar(path.position(s), radius)
    off = r - (radius - pitch * psi / (2 * math.pi))
    bulge = pitch / 4 * (math.sqrt(1 - 4 / math.pi**2) - 1 + 2 / math.pi * math.asin(2 / math.pi))
    assert bulge == pytest.approx(0.0526 * pitch, rel=1e-3)
    assert off.max() <= bulge + 1e-9
    assert off.min() >= -bulge - e**2 / radii[-1]
    assert off.max() >= bulge - e**2 / radii[0]
    assert off.min() <= -0.99 * bulge


@given(spirals)
@examples(20)
def test_two_centred_half_circles_are_exactly_as_long_as_the_involute(spiral):
    """pi sum (R - pitch/4 - k pitch/2) over 2 n half turns is 2 pi n R - pi n^2 pitch = R phi - a phi^2 / 2."""
    ours = trio(*spiral, loop_period=0).requested.length
    assert half_circles(*spiral).requested.length == pytest.approx(ours, rel=1e-12)
    assert block(*spiral).requested.length > ours


def test_the_involute_and_two_centred_half_circles_differ_by_no_more_than_both_bounds():
    """2 a from the involute to Archimedes', and 0.0526 pitch with the root's part from there to the half circles."""
    ours, theirs = trio(60, 10, 4, 0).setpoints(TICK).position, half_circles(60, 10, 4).setpoints(TICK).position
    a, e = 10 / (2 * math.pi), 2.5
    psi = polar(theirs, 60)[1]
    off = np.linalg.norm(theirs[:, :2] - involute(psi, 60, 10), axis=1)
    assert off.max() <= 2 * a + 0.0527 * 10 + e**2 / 22.5
    assert off.max() >= 2 * a - 0.0527 * 10 - e**2 / 22.5
    assert len(ours) - len(theirs) == pytest.approx(0, abs=8)  # a tick is lost or won at the end of a half circle
    assert ours[-1] == pytest.approx(theirs[-1, :2], abs=POSITION)


@pytest.mark.soak
def test_the_pitch_of_all_three_along_a_ray_through_the_centre():
    """10 mm on every ray for the two about (60, 0), and for the involute along its own normals."""
    for program in (block(60, 10, 4), half_circles(60, 10, 4)):
        path = program.requested
        r, psi = polar(path.position(np.linspace(0, path.length, 400_001)), 60)
        turn = np.interp(psi[psi < 6 * math.pi] + 2 * math.pi, psi, r)
        gap = r[psi < 6 * math.pi] - turn
        # the half circles' bulges repeat but for the part of the root
        assert gap == pytest.approx(
            np.full(gap.size, 10), abs=POSITION if program.requested.turn_spacing else 2.5**2 / 22.5
        )
    path = trio(60, 10, 4, 0).requested
    s = np.linspace(0, path.length, 2001)
    phi = tangent_angle(path, s)
    inner = phi <= 6 * math.pi
    normal = np.stack([np.cos(phi), -np.sin(phi)], axis=1)[inner]
    assert path.position(s)[inner, :2] + 10 * normal == pytest.approx(
        involute(phi[inner] + 2 * math.pi, 60, 10), abs=1e-8
    )
