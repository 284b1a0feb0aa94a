"""Every built-in job commands what its program says: path, length, height, speed and time in closed form.

The numbers of the programs stand here once more, so that a value changed in a job by mistake is noticed. Setpoints are
held against them, without a run.
"""

import cmath
import dataclasses
import math
from itertools import pairwise

import numpy as np
import pytest

from gantrysim import Job

from support.outlines import off_rounded_rectangle
from support.stepped import Controller

EXACT = 1e-8  # of places in closed form [mm]
CURVED = 5e-3  # of a speed by differences, where a corner or the end of a ramp falls into them, relative
TICKS = 2.5  # in which motions end that end between ticks


@dataclasses.dataclass
class Stream:
    """The setpoints of a job's controller, without the job's waits before and after."""

    position: np.ndarray
    glue: np.ndarray
    period: float
    requested: object

    @property
    def steps(self):
        return np.diff(self.position, axis=0)

    def speed(self, columns=slice(0, 3)):
        """Speed in some coordinates, of every step (n - 1,) [mm/s]."""
        return np.linalg.norm(self.steps[:, columns], axis=1) / self.period

    @property
    def duration(self):
        return (len(self.position) - 1) * self.period

    def near(self, time):
        """A time in whole ticks, as a duration."""
        return pytest.approx(time, abs=TICKS * self.period)

    def beads(self):
        """Slices of the position in which glue is laid without a break."""
        edges = np.flatnonzero(np.diff(np.concatenate([[0], self.glue.astype(int), [0]])))
        return [self.position[begin:end] for begin, end in edges.reshape(-1, 2)]

    def change(self, order, ticks):
        """Largest change of the path speed within some ticks: acceleration (1) or jerk (2) [mm/s² or mm/s³]."""
        return np.abs(np.diff(self.speed()[ticks], order)).max() / self.period**order

    @property
    def glue_time(self):
        return self.glue.sum() * self.period


def stream(name):
    job = Job.load(name)
    points = job.controller.setpoints(job.servo.period)
    return Stream(points.position, points.dispense, points.period, points.requested)


def length(points):
    return np.linalg.norm(np.diff(points, axis=0), axis=1).sum()


def trapezoid(way, speed, acceleration):
    """Time from rest to rest with constant accelerations [s]."""
    if way < speed**2 / acceleration:
        return 2 * math.sqrt(way / acceleration)
    return way / speed + speed / acceleration


def sine(way, speed, acceleration):
    """The same where the acceleration is half a sine, of that peak; the way is long enough to reach the speed."""
    ramp = 0.5 * math.pi * speed / acceleration
    assert way > speed * ramp
    return way / speed + ramp


def jerky(way, speed, acceleration, jerk):
    """The same where the acceleration rises at the jerk; the way is long enough to reach the speed."""
    ramp = speed / acceleration + acceleration / jerk
    if speed < acceleration**2 / jerk:
        ramp = 2 * math.sqrt(speed / jerk)
    assert way > speed * ramp
    return way / speed + ramp


@pytest.fixture(scope="module")
def note():
    """The controller of AN-225, tick by tick: D = 120 mm, 4 turns, 10 mm apart, V = 100 mm/s, ACCEL = 1000 mm/s²."""
    return Controller(
        diameter=120.0,
        turns=4,
        thickness=10.0,
        speed=100.0,
        servo_period=1e-3,
        acceleration=1000.0,
        wait_resolution=1e-3,
        ratio_bits=16,
    ).run()


@pytest.mark.parametrize("name", ["an225", "an225-3d"])
def test_the_move_spiral_is_that_of_the_stepped_controller(note, name):
    """In mode 1 SPEED belongs to the circle, so the third axis changes nothing in the plane; in mode 0 it is slower."""
    found, expected = stream(name), np.array(note.places)
    assert abs(len(found.position) - len(expected)) <= 1
    n = min(len(found.position), len(expected)) - 1
    # the job's program acts between ticks, the stepped controller at the next tick: a pass begins up to a tick earlier
    assert np.abs(found.position[:n, :2] @ [1, 1j] - expected[:n]).max() < 100.0 * 1e-3
    assert complex(*found.position[-1, :2]) == pytest.approx(expected[-1], abs=0.01)
    assert found.glue_time == found.near(found.duration)
    # V but for the moments in which the virtual axis accelerates to V / x after a pass
    assert np.median(found.speed(slice(0, 2))) == pytest.approx(100.0, rel=2e-5)
    # the requested path is the involute of a circle of radius a = thickness / 2 pi, 4 turns of it in 40 mm of height
    a, turned = 10 / (2 * math.pi), 8 * math.pi
    plane = 60 * turned - 0.5 * a * turned**2
    end = found.requested.position(found.requested.length)[0]
    assert end[:2] == pytest.approx([40, 0], abs=EXACT)
    if name == "an225":
        assert found.requested.length == pytest.approx(plane, abs=EXACT)
        assert plane == pytest.approx(1005.310, abs=5e-4)
    else:
        assert end[2] == pytest.approx(40, abs=EXACT)
        slope = 40 / turned  # per radian, on which the plane path is rho long
        rho = 60 - a * np.linspace(0, turned, 20001)
        assert found.requested.length == pytest.approx(np.trapezoid(np.hypot(rho, slope), dx=turned / 20000), abs=1e-5)
        way = np.array(note.ways) / (math.pi * 120 * 4)
        assert found.position[:n, 2] == pytest.approx(40 * way[:n], abs=0.02)
        assert found.position[-1, 2] == pytest.approx(40, abs=EXACT)


def test_the_fanuc_spiral():
    """Table of the spiral's command: r = 100 - 20 turns, 3.5 turns, 1431.339 mm; the clamp v = 75 sqrt(r / 40)."""
    found = stream("fanuc-spiral")
    assert found.position[0] == pytest.approx([0, 0], abs=EXACT)
    assert found.position[-1] == pytest.approx([0, 0], abs=EXACT)
    (bead,) = found.beads()
    z = bead @ [1, 1j]
    turned = np.unwrap(np.angle(z) - math.pi / 2)
    assert abs(z) == pytest.approx(100 + 20 * turned / (2 * math.pi), abs=1e-6)
    assert z[0] == pytest.approx(100j, abs=0.1)
    assert z[-1] == pytest.approx(-30j, abs=0.1)
    assert turned[-1] == pytest.approx(-7 * math.pi, abs=0.01)
    assert found.requested.length == pytest.approx(1431.339 + 100 + 30, abs=6e-4)
    assert length(bead) == pytest.approx(1431.339, abs=0.2)
    steady = np.abs(np.diff(z))[100:-100] / 1e-3
    radius = abs(z)[100:-101]
    # an arc's radius is that of the curve, r (1 + u²)^1.5 / (1 + 2 u²) with u = r' / r, r' = 20 / 2 pi per radian
    u = 10 / math.pi / radius
    curved = radius * (1 + u**2) ** 1.5 / (1 + 2 * u**2)
    feed = np.minimum(100.0, 75.0 * np.sqrt(curved / 40))
    assert steady == pytest.approx(feed, rel=CURVED)
    assert found.change(1, slice(5, 60)) == pytest.approx(2000, rel=2e-3)
    # rapid moves at 12000 mm/min, each from rest to rest at 2000 mm/s²
    rapid = trapezoid(100, 200, 2000) + trapezoid(30, 200, 2000)
    ramps = 100 / 2000 / 2 + 75 * math.sqrt(30 / 40) / 2000 / 2
    r = np.linspace(30, 100, 70001)
    u = 10 / math.pi / r
    curved = r * (1 + u**2) ** 1.5 / (1 + 2 * u**2)
    slowness = np.hypot(1, 1 / u) / np.minimum(100.0, 75.0 * np.sqrt(curved / 40))
    spiral = np.trapezoid(slowness, dx=1e-3)
    assert found.duration == pytest.approx(rapid + spiral + ramps, abs=0.02)


def test_the_fanuc_cone():
    """2.5 turns inwards and upwards, 25 mm each, in the plane 1081.871 mm; the rotary axis turns with the angle."""
    found = stream("fanuc-conical")
    assert found.position[0] == pytest.approx([0, 100, 0, 0], abs=EXACT)
    assert found.position[-1] == pytest.approx([-60, -37.5, 70, -900], abs=EXACT)
    plane = found.speed(slice(0, 2))
    on_cone = found.position[:, 3] > -900 + 1e-9
    z = found.position[:, :2] @ [1, 1j]
    inside = slice(30, np.flatnonzero(on_cone)[-1] - 30)  # away from the blends of 20 ms
    turned = np.unwrap(np.angle(z) - math.pi / 2)[inside] / (2 * math.pi)
    # a moving average over 20 ms of an arc of radius r lies (v t)² / 24 r inside of it
    assert abs(z[inside]) == pytest.approx(100 + 25 * turned, abs=(120 * 0.02) ** 2 / 24 / 37.5 + 1e-3)
    assert found.position[inside, 2] == pytest.approx(-25 * turned, abs=1e-3)
    assert found.position[inside, 3] == pytest.approx(360 * turned, abs=0.05)
    assert plane[200 : inside.stop - 200] == pytest.approx(np.full(inside.stop - 400, 120.0), rel=1e-3)
    assert found.requested.length == pytest.approx(1083.816 + 60 + 7.5, abs=6e-4)
    # feed in the plane; halves of the acceleration are for the pieces, the blend adds its time once
    begin, end = 120 / 1000 / 2, 120 / 1000 / 2
    cone, straight = 1081.871 / 120 + begin, 60 / 120 + end
    assert found.duration == pytest.approx(cone + straight + trapezoid(7.5, 200, 1000) + 0.02, abs=0.06)
    assert found.glue_time == pytest.approx(cone + straight, abs=0.06)


def arrive(name, moves, glued):
    """Hold the streams of MC-Basic against the places at which its motions end, and return it."""
    found = stream(name)
    assert found.position[0] == pytest.approx(moves[0], abs=EXACT)
    assert found.position[-1] == pytest.approx(moves[-1], abs=EXACT)
    for place in moves:
        assert np.abs(found.position - place).max(axis=1).min() < 0.1  # the middle of an arc may lie between ticks
    assert length(np.concatenate(found.beads())) == pytest.approx(glued, rel=1e-3)
    return found


def test_the_arcs_of_softmc():
    """Two half circles with moves between them, each from rest to rest with a sine acceleration of 3000 mm/s²."""
    moves = [(0, 0), (100, 0), (0, 100), (-100, 0), (-85, 0), (0, 85), (85, 0), (0, 0)]
    found = arrive("softmc-arc", moves, 100 * math.pi + 15 + 85 * math.pi)
    ways = [(100, 150), (100 * math.pi, 150), (15, 150), (85 * math.pi, 120), (85, 150)]
    times = [sine(way, speed, 3000) for way, speed in ways]
    assert found.change(1, slice(5, 100)) == pytest.approx(3000, rel=2e-3)
    assert found.duration == pytest.approx(sum(times), abs=6e-3)  # every move ends at a tick
    assert found.glue_time == found.near(sum(times[1:4]))
    radius = np.hypot(*np.concatenate(found.beads()).T)
    assert (np.abs(radius - 100) < EXACT).sum() * 1e-3 == found.near(times[1])
    assert (np.abs(radius - 85) < EXACT).sum() * 1e-3 == found.near(times[3])
    assert found.requested.length == pytest.approx(100 + 185 * math.pi + 15 + 85, abs=EXACT)


def test_the_helix_of_softmc_about_two_centres():
    """Eight half circles of 25 to 112.5 mm about x = 0 and 12.5 by turns, each 5 mm higher and 180° further."""
    places, at = [(25.0, 0.0, 0.0, 0.0)], 25.0
    for k in range(1, 9):
        at = 2 * (0.0 if k % 2 else 12.5) - at
        places.append((at, 0.0, 5.0 * k, 180.0 * k))
    assert [place[0] for place in places[1:6]] == [-25, 50, -50, 75, -75]
    found = stream("softmc-helical")
    radii = 25 + 12.5 * np.arange(8)
    ways = np.hypot(math.pi * radii, 5)
    assert ways.sum() == pytest.approx(1728.458, abs=5e-4)
    assert found.requested.length == pytest.approx(ways.sum(), abs=EXACT)
    begins = [int(np.argmin(np.abs(found.position - place).max(axis=1))) for place in places]
    time = 0.0
    for k, (begin, end) in enumerate(pairwise(begins)):
        centre = 0.0 if k % 2 == 0 else 12.5
        arc = found.position[begin + 2 : end - 1]
        z = arc[:, 0] - centre + 1j * arc[:, 1]
        assert abs(z) == pytest.approx(np.full(len(z), radii[k]), abs=EXACT)
        swept = np.angle(z * cmath.exp(1j * math.pi * (k % 2)))
        assert swept.min() > -1e-9
        assert arc[:, 2] == pytest.approx(5 * (k + swept / math.pi), abs=EXACT)
        assert arc[:, 3] == pytest.approx(180 * (k + swept / math.pi), abs=1e-6)
        # the needle's axis keeps 360°/s, 3600°/s² and the jerk that belongs to it
        ratio = ways[k] / 180
        time += jerky(ways[k], min(200, 360 * ratio), min(3000, 3600 * ratio), min(1e5, 1.2e5 * ratio))
        assert np.abs(found.position[begins[k + 1]] - places[k + 1]).max() < 1e-6
    last = slice(begins[7] + 2, begins[7] + 90)
    assert found.change(1, last) == pytest.approx(3000, rel=1e-3)
    assert found.change(2, last) == pytest.approx(1e5, rel=0.01)
    assert found.duration == pytest.approx(time, abs=8 * 1e-3)  # every half circle ends at a tick
    assert found.glue.mean() > 0.99


def test_the_petals_of_mc_basic():
    """Six full circles through the middle about (30 cos, 30 sin), each from rest to rest, with 20 ms between them."""
    found = stream("softmc-basic")
    hubs = 30 * np.exp(2j * math.pi * np.arange(1, 7) / 6)
    beads = found.beads()
    z = np.concatenate(beads) @ [1, 1j]
    off = np.abs(np.abs(z[:, None] - hubs) - 30)
    assert off.min(axis=1).max() < EXACT
    # in their order, counter-clockwise: a quarter on, the place is the hub turned by a quarter about itself
    whole = found.position @ [1, 1j]
    quarters = [int(np.argmin(np.abs(whole - hub * (1 - 1j)))) for hub in hubs]
    assert np.abs(whole[quarters] - hubs * (1 - 1j)).max() < 0.12
    assert (np.diff(quarters) > 0).all()
    petal = jerky(60 * math.pi, 120, 4000, 0.8e5)
    assert found.glue_time == pytest.approx(6 * petal, abs=6 * TICKS * 1e-3)
    assert found.change(2, slice(2, 60)) == pytest.approx(0.8e5, rel=0.01)
    # between petals the program sleeps for 20 ms, after it has polled every millisecond
    assert 6 * petal + 5 * 0.020 < found.duration < 6 * petal + 6 * 0.0245
    assert found.requested.length == pytest.approx(360 * math.pi, abs=EXACT)
    assert np.abs(found.position[[0, -1]]).max() < EXACT


def test_the_half_circle_of_the_delta():
    """R = 100 mm at z = 426 mm from (100, 0) to (-100, 0), r from 0 to 180°, at 150 mm/s."""
    found = stream("delta-arc")
    x, y, z, r = found.position.T
    angle = np.arctan2(y, x)
    assert np.hypot(x, y) == pytest.approx(np.full(len(x), 100.0), abs=EXACT)
    assert z == pytest.approx(np.full(len(z), 426.0), abs=EXACT)
    assert r == pytest.approx(np.degrees(angle), abs=1e-6)
    assert (angle[0], angle[-1]) == pytest.approx((0, math.pi), abs=1e-9)
    assert found.duration == found.near(sine(100 * math.pi, 150, 3000))
    assert found.change(1, slice(5, 100)) == pytest.approx(3000, rel=2e-3)
    assert found.glue_time == found.near(found.duration)


def test_the_flanges_of_linuxcnc():
    """Two frames about (-40, 0) and (40, 0), each with a ring of dots at 9 mm, 100 ms of glue on every dot."""
    found = stream("linuxcnc-flanges")
    beads = found.beads()
    frames = [bead for bead in beads if length(bead) > 1]
    dots = [bead for bead in beads if length(bead) <= 1]
    frame = 45 + 2.5 * math.pi + 25 + 50 + 30
    assert [length(bead) for bead in frames] == pytest.approx([frame, frame], abs=0.15)  # corners are cut by 20 µm
    for bead, centre in zip(frames, (-40, 40), strict=True):
        assert bead[0] == pytest.approx([centre - 25, -15], abs=0.15)
        assert bead[30:].min(axis=0) == pytest.approx([centre - 25, -15], abs=0.021)
        assert bead.max(axis=0) == pytest.approx([centre + 25, 15], abs=0.021)
        z = bead @ [1, 1j] - centre
        corner = z[(z.real > 20.05) & (z.imag < -10.05)]
        assert abs(corner - (20 - 10j)) == pytest.approx(np.full(len(corner), 5.0), abs=0.02)
        assert speed_along(bead)[150:-150].max() == pytest.approx(40.0, rel=1e-6)
    rings = [(-40, 6), (40, 4)]
    places = [c + 9 * cmath.exp(2j * math.pi * k / count) for c, count in rings for k in range(count)]
    assert len(dots) == 10
    for bead, place in zip(dots, places, strict=True):
        at = bead @ [1, 1j]
        assert np.abs(at - place).max() < 1e-6
        assert len(at) * 1e-3 == pytest.approx(0.1, abs=TICKS * 1e-3)
    # rapid moves by the faster of two axes at 6000 mm/min and 1000 mm/s²
    stops = [0j]
    for (centre, _), first in zip(rings, (0, 6), strict=True):
        stops += [centre - 25 - 15j, *places[first : first + (6 if first == 0 else 4)]]
    ways = [max(abs((b - a).real), abs((b - a).imag)) for a, b in pairwise([*stops, 0j])]
    least = sum(trapezoid(way, 100, 1000) for way in ways) + 10 * 0.1 + 2 * frame / 40
    assert least < found.duration < least + 2 * 6 * 0.08
    assert np.abs(found.position[[0, -1]]).max() < EXACT


def speed_along(points):
    return np.linalg.norm(np.diff(points, axis=0), axis=1) / 1e-3


def test_the_squares_of_the_slicer():
    """Perimeters of 40 and 32 mm at 30 mm/s and diagonals of 24 mm at 20 mm/s; travel between them is dry."""
    found = stream("slicer-square")
    beads = found.beads()
    assert [length(bead) for bead in beads] == pytest.approx([160, 128, 24 * 2**0.5, 24 * 2**0.5], abs=0.3)
    for bead, half in zip(beads[:2], (20, 16), strict=True):
        on_sides = np.abs(bead[30:])  # glue begins on the arc that rounds the corner after the travel
        assert np.abs(on_sides.max(axis=1) - half).max() < 0.06
        assert on_sides.max() == pytest.approx(half, abs=EXACT)
        assert speed_along(bead).max() == pytest.approx(30, rel=1e-6)
        assert bead[0] == pytest.approx([-half, -half], abs=0.25)
    for bead, (begin, end) in zip(beads[2:], (((-12, -12), (12, 12)), ((-12, 12), (12, -12))), strict=True):
        assert bead[0] == pytest.approx(begin, abs=0.1)
        assert bead[-1] == pytest.approx(end, abs=0.06)
        assert speed_along(bead).max() == pytest.approx(20, rel=1e-6)
        assert len(bead) * 1e-3 == pytest.approx(trapezoid(24 * 2**0.5, 20, 1000), abs=0.03)
    assert np.abs(found.position[[0, -1]]).max() < EXACT
    ways = [(20, 20), (4, 4), (4, 4), (0, 24), (12, 12)]
    travel = sum(trapezoid(math.hypot(*way), 100, 1000) for way in ways)  # its feed is the speed along the path
    laid = 160 / 30 + 128 / 30 + 2 * trapezoid(24 * 2**0.5, 20, 1000)
    assert laid < found.glue_time < laid + 8 * 0.035
    assert found.duration == pytest.approx(found.glue_time + travel, abs=0.1)
    # material: 1.2 per side of 40 mm, and in all 4.8 + 3.84 + 2
    moves = Job.load("slicer-square").controller.program.moves
    assert moves[:, 13].sum() == pytest.approx(10.64, abs=1e-9)


def test_the_outline_on_the_stage():
    """u = C + R(-TH)(K - C) - W - sigma S is on the outline of 302.8319 mm everywhere, at 50 mm/s or less."""
    found = stream("stage-outline")
    th, x, y = found.position.T
    u = np.exp(-1j * np.radians(th)) * -200 + (x + 1j * y)
    assert np.abs(off_rounded_rectangle(u, 100, 60, 10)).max() < 1e-6
    assert u[0] == pytest.approx(-50 - 20j, abs=EXACT)
    assert u[-1] == pytest.approx(-50 - 20j, abs=EXACT)
    assert (th[0], th[-1]) == pytest.approx((0, 360), abs=1e-9)
    speed = np.abs(np.diff(u)) / 1e-3
    assert speed.max() == pytest.approx(50, rel=1e-3)
    assert found.requested.length == pytest.approx(302.8319, abs=5e-5)
    assert np.abs(np.diff(u)).sum() == pytest.approx(302.8319, abs=5e-3)
    # middles of the edges and corners, clockwise, with the normal on the needle
    for angle, place in ((0, -50), (45, -47.0711 + 27.0711j), (90, 30j), (180, 50), (270, -30j)):
        at = np.abs(u - place).argmin()
        assert th[at] == pytest.approx(angle, abs=1.0 if angle % 90 else 1e-6)
    velocity, acceleration = found.steps / 1e-3, np.diff(found.steps, axis=0) / 1e-6
    assert (np.abs(velocity).max(axis=0) <= np.array([360, 1000, 1000]) * 1.001).all()
    assert (np.abs(acceleration).max(axis=0) <= 2000 * 1.01).all()
    assert np.abs(acceleration).max() == pytest.approx(2000, rel=0.01)  # of the limits, one is reached
    # the straight parts beyond 10 mm of a corner run at full speed or on a ramp
    assert found.duration > 302.8319 / 50
    assert found.glue_time == found.near(found.duration)


def test_the_gasket_of_svg():
    """A rounded outline, a bore and two bolt holes, at 60 mm/s in the plane z = 0; the needle is lifted by 4 mm."""
    found = stream("svg-gasket")
    beads = found.beads()
    outline = 45 + 30 + 50 + 30 + 45 + 2 * (5 + 15) * math.pi
    assert sorted(length(bead) for bead in beads) == pytest.approx(
        sorted([outline, 12 * math.pi, 12 * math.pi, 44 * math.pi]), abs=0.1
    )
    by_length = sorted(beads, key=length)
    # x right, y upwards from the bottom of the drawing of 80 mm, moved by (-60, -40)
    for bead, (centre, radius) in zip(
        [*sorted(by_length[:2], key=lambda bead: bead[0, 0]), by_length[2]],
        [(-42 - 22j, 6), (42 - 22j, 6), (2j, 22)],
        strict=True,
    ):
        z = bead[:, :2] @ [1, 1j]
        assert np.abs(z - centre) == pytest.approx(np.full(len(z), radius), abs=1e-6)
        assert speed_along(bead).max() == pytest.approx(60, rel=1e-5)
        assert len(bead) * 1e-3 == pytest.approx(trapezoid(2 * math.pi * radius, 60, 2000), abs=0.02)
    outer = by_length[3]
    assert outer[:, :2].min(axis=0) == pytest.approx([-55, -35], abs=1e-6)
    assert outer[:, :2].max(axis=0) == pytest.approx([55, 35], abs=1e-6)
    z = outer[:, :2] @ [1, 1j]
    for centre, radius in ((-25 + 5j, 30), (25 + 5j, 30), (-45 - 25j, 10), (45 - 25j, 10)):
        outward = z - centre
        inside = (outward.real * centre.real > 0) & (outward.imag * centre.imag > 0)
        assert inside.sum() > 100
        assert np.abs(z[inside] - centre) == pytest.approx(np.full(inside.sum(), radius), abs=1e-6)
    assert len(outer) * 1e-3 == pytest.approx(trapezoid(outline, 60, 2000), abs=0.02)
    assert np.abs(np.concatenate(beads)[:, 2]).max() < EXACT
    heights = found.position[~found.glue, 2]
    assert (heights.max(), found.position[[0, -1], 2].tolist()) == (pytest.approx(4, abs=EXACT), pytest.approx([4, 4]))
    dry = found.speed()[~found.glue[1:] & ~found.glue[:-1]]
    assert dry.max() == pytest.approx(150, rel=1e-3)
    ups = found.requested.length - outline - 68 * math.pi
    assert ups > 7 * 4  # three pairs of lifts, and one down at the start


def test_the_frames_of_trio_basic():
    """Two rounded frames at 120 mm/s; merged moves do not stop, and 200 ms pass after each."""
    found = stream("trio-basic")
    beads = found.beads()
    frames = [(0, 110, 80, 20), (14, 82, 52, 13)]
    assert len(beads) == 2
    rounds = [2 * (w + h) - 8 * r + 2 * math.pi * r for _, w, h, r in frames]
    for bead, (inset, w, h, r), way in zip(beads, frames, rounds, strict=True):
        z = bead @ [1, 1j] - (inset + 0.5 * w) - 1j * (inset + 0.5 * h)
        assert np.abs(off_rounded_rectangle(z, w, h, r)).max() < 1e-6
        assert bead[0] == pytest.approx([inset + r, inset], abs=0.05)
        assert bead[-1] == pytest.approx([inset + r, inset], abs=0.05)
        assert bead[len(bead) // 8, 1] < bead[len(bead) // 3, 1]  # counter-clockwise
        assert length(bead) == pytest.approx(way, abs=0.1)
        assert len(bead) * 1e-3 == pytest.approx(trapezoid(way, 120, 2500), abs=5e-3)
        assert speed_along(bead).max() == pytest.approx(120, rel=1e-6)
    moves = [20, abs(7 + 14j), abs(27 + 14j)]
    expected = sum(trapezoid(way, 120, 2500) for way in [*rounds, *moves]) + 2 * 0.2
    assert found.duration == pytest.approx(expected, abs=0.02)
    assert found.change(1, slice(2, 40)) == pytest.approx(2500, rel=1e-6)
    still = np.flatnonzero(found.speed() == 0)
    pauses = [len(part) * 1e-3 for part in np.split(still, np.flatnonzero(np.diff(still) > 1) + 1)]
    assert [pause for pause in pauses if pause > 0.1] == pytest.approx([0.2, 0.2], abs=3.5e-3)
    assert np.abs(found.position[[0, -1]]).max() < EXACT
    assert found.requested.length == pytest.approx(sum(rounds) + sum(moves), abs=1e-6)


@pytest.mark.parametrize(
    ("name", "limits"),
    [
        ("softmc-basic", {"position_error": 2.0, "position_error_delay": 3, "settle_error": 0.05}),
        ("softmc-helical", {"position_error": math.inf, "settle_error": 0.05, "settle_time": 0.005}),
        ("softmc-arc", {"position_error": math.inf, "settle_error": math.inf}),
    ],
)
def test_the_supervision_is_that_of_the_program(name, limits):
    supervision = Job.load(name).controller.setpoints(1e-3).supervision
    assert {key: getattr(supervision, key) for key in limits} == limits
