"""The feet of every controller's programs against brute force over the whole path, and against distances alone.

The oracle samples the path by `Path.position` and searches all of it; see `support.brute_force_feet`.
"""

import math
from itertools import pairwise

import numpy as np
import pytest

from gantrysim import Budget, Machine, Servo, simulate
from gantrysim.controllers.gcode import linuxcnc
from gantrysim.paths.arcs import ArcChain
from gantrysim.paths.chain import Chain
from gantrysim.paths.pieces import Line

from support.brute_force_feet import FLAT, Polyline, coupled
from support.feet_checks import feet_checks
from support.random_programs import KINDS, random_program
from support.soaked import suite_runs

SUITE = 1  # program of each kind in the suite
SOAK = 125  # and in the soak: 2,000 of 16 kinds
FINE_STEP = 12.5e-6  # [s]
STEP = 0.01  # of a value, between two physics steps, relative
LEAST_STEP = 5e-4  # the same [mm]

ONE_CORNER = "G21 G90\nF3600\nG0 X0 Y0\nG1 X40 Y0\nG1 X11.33 Y20.075\nM2"
TEETH = "\n".join(f"G1 X{0.4 * (k % 2):.1f} Y{0.075 * (k - 1):.3f}" for k in range(1, 41))
PAD = f"G21 G90 G17 G94 G64 P0.1\nF6000\nG0 X0 Y0 Z1\nG0 Z0\n{TEETH}\nG1 X60 Y5\nG1 X60 Y40\nG0 Z5\nM2"


def polygon(*points):
    return Chain([Line((*start, 0.0), (*end, 0.0)) for start, end in pairwise(points)])


def test_the_nearest_point_of_a_circle_and_of_a_line_in_closed_form():
    circle = ArcChain((10.0, 0.0), 0.5 * math.pi, [0.1], [20 * math.pi])
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.uniform(-20, 20, (200, 2)), rng.uniform(-1, 1, 200)])
    distance = Polyline(circle).distances(points).min(axis=1)
    assert distance == pytest.approx(np.hypot(np.hypot(*points[:, :2].T) - 10, points[:, 2]), abs=1.1 * FLAT)
    beside = np.hypot(points[:, 1], points[:, 2])
    ends = np.abs(points[:, 0]) > 10
    outside = np.hypot(beside, np.abs(points[:, 0]) - 10)
    distance = Polyline(polygon((-10, 0), (10, 0))).distances(points).min(axis=1)
    assert distance == pytest.approx(np.where(ends, outside, beside), abs=1e-5)


def test_the_order_of_motion_tells_a_way_back_from_the_way_there():
    """Two legs 0.1 mm apart, and a trace 0.08 mm off each, 0.02 mm off the other; but for a reach about the turn."""
    path = Polyline(polygon((0, 0), (20, 0), (20, 0.1), (0, 0.1)))
    x = np.linspace(2, 18, 400)
    there = np.column_stack([x, np.full(400, 0.08), np.zeros(400)])
    back = np.column_stack([x[::-1], np.full(400, 0.02), np.zeros(400)])
    distances = path.distances(np.vstack([there, back]))
    assert distances.min(axis=1) == pytest.approx(np.full(800, 0.02), abs=1e-6)
    found = coupled(distances, path.cell, 0.0)
    # within a cell of the turn the order is not told
    turn = slice(395, 405)
    assert np.delete(found.distance, turn) == pytest.approx(np.full(790, 0.08), abs=1e-5)
    progress = np.append(x, 40.1 - x[::-1])
    assert np.delete(found.progress - progress, turn) == pytest.approx(np.zeros(790), abs=2 * path.cell)


@pytest.mark.parametrize(
    ("text", "rms", "largest"),
    [(ONE_CORNER, 553.0, 2884.3), (PAD, 7.24, 69.65)],
    ids=["one corner", "teeth"],
)
def test_a_rounded_corner_and_teeth_before_long_legs(text, rms, largest):
    """The whole chain on the built-in machine; the values by brute force, in µm."""
    program = linuxcnc.Program(text=text)
    machine = Machine("xyz" if "z" in program.axes else "xy")
    run = simulate(machine, Servo.derive(machine.axes, 1e-3, integral_time=0.03), program.setpoints(1e-3))
    checks = feet_checks(run)
    assert checks.lower == pytest.approx((1e-3 * rms, 1e-3 * largest), rel=2e-3)
    assert checks.upper == pytest.approx((1e-3 * rms, 1e-3 * largest), rel=0.05)
    assert checks.contour == pytest.approx((1e-3 * rms, 1e-3 * largest), rel=0.05)
    assert checks.broken == []


def test_programs_follow_from_their_seeds():
    first, again, other = (random_program("marlin", number) for number in (1, 1, 2))
    assert first.text == again.text != other.text
    assert len({random_program(kind, number).seed for kind in ("svg", "grbl") for number in (0, 1)}) == 4


@pytest.mark.validates(
    "contour error of random programs of every controller",
    "distance in the order of motion, by dynamic programming over the whole path",
    "between the bounds of `tests/support/feet_checks.py`",
)
@pytest.mark.parametrize("kind", KINDS)
def test_the_feet_of_some_programs_of_a_kind(kind):
    check(kind, range(SUITE))


@pytest.mark.soak
@pytest.mark.parametrize("kind", KINDS)
def test_the_feet_of_many_programs_of_a_kind(kind, record_property):
    record_property("attack", "random programs, feet against brute force")
    record_property("tries", SOAK)
    check(kind, range(SUITE, SUITE + SOAK))


def check(kind, numbers):
    """Check programs of a kind, and tell of all that are wrong, the seed first."""
    wrong = {}
    for number in numbers:
        program = random_program(kind, number)
        broken = feet_checks(program.run()).broken
        if broken:
            wrong[program.seed] = "\n".join([*broken, program.text])
    assert not wrong, "\n\n".join(f"seed {seed} of {len(numbers)} programs\n{text}" for seed, text in wrong.items())


@pytest.mark.parametrize(
    "kind", suite_runs(["linuxcnc-default", "marlin", "fanuc-blend", "softmc", "trio-basic", "svg"], 0, 2, 5)
)
def test_contour_and_links_do_not_depend_on_the_physics_step(kind):
    program = next(p for p in (random_program(kind, k) for k in range(20)) if p.machine == "smooth")
    coarse, fine = (Budget(program.run(step)) for step in (None, FINE_STEP))
    for name in (*coarse.parts, "contour"):
        for size in ("rms", "max"):
            first, second = (getattr(budget.values.rows[name], size) for budget in (coarse, fine))
            assert first == pytest.approx(second, rel=STEP, abs=LEAST_STEP), name
