"""Outlines, set-ups of the stage, and what its commanded positions do to the work, for the tests."""

import math

import numpy as np
from hypothesis import strategies as st

POSITION = 1e-9  # of the needle on the outline [mm]
ANGLE = 1e-9  # of the outward normal at the needle [deg]
SPEED = 1e-6  # relative, of the needle on the work where no limit bites
VELOCITY = 1e-5  # relative, beyond a limit of an axis
# The law keeps a thousandth of an acceleration in hand for what lies between its nodes. A corner where axes
# turn by a radian a millimetre may need more of it.
ACCELERATION = 2e-3
NODES = 0.05  # between places where the limits are looked at: a halt costs up to as much at the path speed [mm]
TABLE = 5e-5  # what the note's figures leave open


def rotation(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.moveaxis(np.array([[c, -s], [s, c]]), (0, 1), (-2, -1))


def turned(vectors, angle):
    """Vectors (n, 2) or (2,) turned by angles (n,) or one [rad]."""
    return np.einsum("...ij,...j->...i", rotation(np.asarray(angle)), np.asarray(vectors, float))


def on_the_work(trace, position):
    """Place of the work under the needle, (n, 2), by the forward transformation, for axes th, x, y."""
    th, stage = np.radians(position[:, 0]), position[:, 1:]
    needle, centre, work = (np.array(v, float) for v in (trace.needle, trace.centre, trace.work_centre))
    # R(-TH) (K - C) = W + u + sigma S - C
    return turned(np.broadcast_to(needle - centre, stage.shape), -th) + centre - work - trace.sigma * stage


class Rounded:
    """A polygon with rounded corners: points and outward normals over the arc length, in the order of its corners."""

    def __init__(self, corners, radius):
        p = np.array(corners, float)
        m = len(p)
        way = np.roll(p, -1, axis=0) - p
        way /= np.linalg.norm(way, axis=1)[:, None]
        area = 0.5 * sum(p[k][0] * p[(k + 1) % m][1] - p[k][1] * p[(k + 1) % m][0] for k in range(m))
        self.outside = -1.0 if area > 0 else 1.0  # left of the way, where clockwise
        self.edges, self.arcs, self.ends = [], [], [0.0]
        cut = np.empty(m)
        self.turn = np.empty(m)
        for k in range(m):  # the corner at the end of edge k
            a, b = way[k], way[(k + 1) % m]
            self.turn[k] = math.atan2(a[0] * b[1] - a[1] * b[0], a @ b)
            cut[k] = radius * math.tan(0.5 * abs(self.turn[k]))
        self.room = min(
            np.linalg.norm(p[(k + 1) % m] - p[k]) * radius / (cut[k] + cut[k - 1]) for k in range(m)
        )  # largest radius for which all arcs have room
        self.pieces = []
        for k in range(m):
            begin, end = p[k] + cut[k - 1] * way[k], p[(k + 1) % m] - cut[k] * way[k]
            left = np.array([-way[k][1], way[k][0]])
            self.pieces.append(("edge", begin, way[k], left))
            self.ends.append(self.ends[-1] + (end - begin) @ way[k])
            side = math.copysign(1.0, self.turn[k])
            self.pieces.append(("arc", end + side * radius * left, -side * left, side / radius))
            self.ends.append(self.ends[-1] + radius * abs(self.turn[k]))
        self.ends = np.array(self.ends)
        self.length = self.ends[-1]

    def __call__(self, s):
        points, normals = np.empty((len(s), 2)), np.empty((len(s), 2))
        k = np.clip(np.searchsorted(self.ends, s, side="right") - 1, 0, len(self.pieces) - 1)
        for i, (kind, place, first, second) in enumerate(self.pieces):
            here = k == i
            rest = s[here] - self.ends[i]
            if kind == "edge":
                points[here] = place + rest[:, None] * first
                normals[here] = self.outside * second
            else:
                radial = turned(np.broadcast_to(first, (rest.size, 2)), rest * second)
                points[here] = place + radial / abs(second)
                normals[here] = radial * -math.copysign(1.0, second) * self.outside
        return points, normals


INF = math.inf
SET_UP = {"needle": (-120.0, 30.0), "centre": (-40.0, -20.0), "normal": (-1.0, 0.4), "speed": 60.0}
RECTANGLE = ((-50, -30), (-50, 30), (50, 30), (50, -30))  # clockwise, the left edge first, upwards
ELL = ((0, 0), (60, 0), (60, -30), (120, -30), (120, 60), (0, 60))  # one corner is concave


@st.composite
def polygons(draw):
    """Corners of a polygon about a place of its own: 3 to 6, some concave, in either sense."""
    m = draw(st.integers(3, 6))
    angles = [2 * math.pi * (k + draw(st.floats(-0.2, 0.2))) / m for k in range(m)]
    radii = [draw(st.floats(30, 120)) for _ in range(m)]
    x, y = draw(st.floats(-50, 50)), draw(st.floats(-50, 50))
    corners = [(x + r * math.cos(a), y + r * math.sin(a)) for r, a in zip(radii, angles, strict=True)]
    return tuple(corners if draw(st.booleans()) else reversed(corners))


place = st.tuples(st.floats(-300, 300), st.floats(-300, 300))


@st.composite
def traces(draw, **fixed):
    corners = draw(polygons())
    direction = draw(st.floats(-math.pi, math.pi))
    return {
        "corners": corners,
        "corner_radius": draw(st.floats(0.1, 0.9)) * Rounded(corners, 1.0).room,
        "speed": draw(st.floats(5, 200)),
        "needle": draw(place),
        "centre": draw(place),
        "work_centre": draw(place),
        "normal": (draw(st.floats(0.1, 10)) * math.cos(direction), math.sin(direction)),
        "sigma": draw(st.sampled_from([-1, 1])),
        **fixed,
    }


def angle_between(a, b):
    """From b to a, [deg]."""
    return np.degrees(np.arctan2(b[..., 0] * a[..., 1] - b[..., 1] * a[..., 0], np.sum(a * b, axis=-1)))


def velocities(setpoints):
    return np.diff(setpoints.position, axis=0)[:-1] / setpoints.period


def accelerations(setpoints):
    return np.diff(velocities(setpoints), axis=0) / setpoints.period


def off_rounded_rectangle(points, width, height, radius):
    """Signed distance of complex points from a rounded rectangle about 0, positive outside of it, (n,)."""
    inner = np.abs(points.real) - (0.5 * width - radius) + 1j * (np.abs(points.imag) - (0.5 * height - radius))
    beyond = np.hypot(np.maximum(inner.real, 0), np.maximum(inner.imag, 0))
    return beyond + np.minimum(np.maximum(inner.real, inner.imag), 0) - radius
