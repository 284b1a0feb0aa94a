"""NURBS of LinuxCNC's dialect beside scipy's B-splines of their weighted control points."""

import math

import numpy as np
import pytest
from scipy.interpolate import BSpline

from gantrysim.base.errors import InputError
from gantrysim.controllers.gcode.curves import Nurbs
from gantrysim.controllers.gcode.linuxcnc import Program
from gantrysim.controllers.gcode.move_table import END

CHORD = 1e-3  # [mm]


def curve(order, points, weights, knots, count=4_001):
    """Points of a curve, by scipy."""
    weighted = np.column_stack([np.asarray(points) * np.asarray(weights)[:, None], weights])
    spline = BSpline(np.asarray(knots, float), weighted, order - 1)
    values = spline(np.linspace(knots[order - 1], knots[len(points)], count))
    return values[:, :2] / values[:, 2:]


def gap(points, ends):
    """Largest distance of points from a polyline."""
    a = ends[:-1]
    along = np.diff(ends, axis=0)
    worst = 0.0
    for block in np.array_split(points, 100):
        share = np.einsum("pij,ij->pi", block[:, None] - a, along) / (along**2).sum(axis=1)
        foot = a + np.clip(share, 0, 1)[..., None] * along
        worst = max(worst, np.linalg.norm(block[:, None] - foot, axis=2).min(axis=1).max())
    return worst


def ends(text):
    moves = Program(text=text).program.moves
    return moves[:, END : END + 3]


@pytest.mark.parametrize("order", [3, 4, 5])
def test_a_curve_of_uniform_knots_is_scipys(order):
    rng = np.random.default_rng(order)
    points = np.round(rng.uniform(-30, 30, (9, 2)), 4)
    weights = np.round(rng.uniform(0.3, 4.0, 9), 3)
    words = "\n".join(f"X{x} Y{y} P{w}" for (x, y), w in zip(points[1:], weights[1:], strict=True))
    x, y = points[0]
    path = ends(f"F600\nG0 X{x} Y{y}\nG5.2 P{weights[0]} L{order}\n{words}\nG5.3\nG0 X0 Y0")[:-1, :2]
    inner = 9 - order + 1
    knots = [0] * order + list(range(1, inner)) + [inner] * order
    assert gap(curve(order, points, weights, knots), path) < CHORD
    np.testing.assert_allclose(path[-1], points[-1], atol=1e-12)


def test_a_curve_of_its_own_knots_is_scipys():
    rng = np.random.default_rng(7)
    points = np.round(rng.uniform(-30, 30, (7, 2)), 4)
    weights = [1, 0.5, 3, 1, 2, 1, 1]
    knots = [0, 0, 0, 0, 0.7, 1, 2.5, 3, 3, 3, 3]
    words = [f"G6.2 X{points[0][0]} Y{points[0][1]} R1 K0 P4 Q1"]
    words += [f"X{x} Y{y} R{w} K{k}" for (x, y), w, k in zip(points[1:], weights[1:], knots[1:7], strict=True)]
    words += [f"G6.2 K{k}" for k in knots[7:]]
    path = ends("F600\nG0 X{} Y{}\n".format(*points[0]) + "\n".join(words) + "\nG1 X0 Y0")[:-1, :2]
    assert gap(curve(4, points, weights, knots), path) < CHORD


@pytest.mark.parametrize(
    ("plane", "letters", "axes"), [("G17", "XY", (0, 1)), ("G18", "ZX", (2, 0)), ("G19", "YZ", (1, 2))]
)
def test_weights_make_a_quarter_of_a_circle_in_every_plane(plane, letters, axes):
    u, v = letters
    half = math.sqrt(0.5)
    path = ends(f"F600 {plane}\nG0 {u}10\nG5.2 P1\n{u}10 {v}10 P{half:.16f}\n{u}0 {v}10 P1\nG5.3")[1:]
    np.testing.assert_allclose(np.hypot(path[:, axes[0]], path[:, axes[1]]), 10, atol=1e-9)
    np.testing.assert_allclose(path[-1][list(axes)], (0, 10), atol=1e-12)


def test_chords_are_as_fine_as_the_tolerance():
    square = (0j, 10 + 0j, 10 + 10j)
    shape = Nurbs(3, square, (1.0, 1.0, 1.0), (0, 0, 0, 1, 1, 1))
    coarse = list(shape.chords(0.1))
    fine = list(shape.chords(1e-5))
    assert 3 < len(coarse) < len(fine) / 10


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("G5.2 X1 Y1 P1\nX2 Y3 P1\nG1 X5", "line 4: G1 among the control points of G5.2: must follow G5.3"),
        ("G5.2 X1 Y1 P1\nG5.3", "line 3: NURBS of 2 control points: must have at least its order, 3"),
        ("G5.2 X1 Y1 P1", "line 2: G5.2: the program ends before the curve does"),
        ("G5.2 X1 P1", "line 2: control point of a NURBS: must have both X and Y"),
        ("G5.2 X1 Y1", "line 2: G5.2: every control point must have a weight P"),
        ("G5.3", "line 2: G5.3: must follow control points of G5.2"),
        ("G5.2 X1 Y1 P1\nX2 Y2 P-1\nG5.3", "line 4: NURBS weight = -1: must be greater than 0"),
        ("G6.2 X1 Y1 R1 K0", "line 2: G6.2: the first control point must have the order P"),
        ("G6.2 X1 Y1 R1 P3", "line 2: G6.2: every control point must have a knot K"),
        ("G6.2 X1 Y1 K1 P3\nX2 Y2 K1\nX3 Y3 K0\nK0\nK0", "line 6: NURBS of 2 control points"),
        ("G6.2 X1 Y1 R1 K0 P1.5", "line 2: P = 1.5: must be the order of a NURBS, from 2 to 30"),
        ("G41.1 D2\nG5.2 X1 Y1 P1", "line 3: G5.2 under cutter compensation: must follow G40"),
    ],
)
def test_what_is_no_curve_is_refused(text, message):
    with pytest.raises(InputError, match=message):
        _ = Program(text=f"F600\n{text}").program


@pytest.mark.parametrize(
    ("words", "control"),
    [
        ("G5.1 X10 Y4 I6", [0, 6, 10 + 4j]),
        ("G5.1 X10 Y4 J6", [0, 6j, 10 + 4j]),
        ("G5 X10 Y4 I3 P-2 Q1", [0, 3, 8 + 5j, 10 + 4j]),
        ("G5 X10 Y4 J3 P-2 Q1", [0, 3j, 8 + 5j, 10 + 4j]),
        ("G5 X10 Y4 I3 J3 P-2", [0, 3 + 3j, 8 + 4j, 10 + 4j]),
        ("G5 X10 Y4 I3 J3 Q1", [0, 3 + 3j, 10 + 5j, 10 + 4j]),
    ],
)
def test_an_offset_that_a_spline_does_not_state_is_0(words, control):
    """Beside the Bézier curve of its control points, by Bernstein's polynomials."""
    degree = len(control) - 1
    t = np.linspace(0, 1, 2001)
    curve = sum(math.comb(degree, k) * t**k * (1 - t) ** (degree - k) * point for k, point in enumerate(control))
    path = np.concatenate([[[0.0, 0.0]], ends(f"F600\n{words}")[:, :2]])
    assert gap(np.column_stack([curve.real, curve.imag]), path) < CHORD
