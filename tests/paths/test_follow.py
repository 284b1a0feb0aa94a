"""A trace is followed in the order of the motion where the path retraces, nearly retraces or crosses itself.

The oracle is the progress with which each trace was made: the test knows the arc length of every point.
"""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from gantrysim import Budget, Job, Machine, Servo, metrics, perfect_follower, simulate
from gantrysim.base.errors import InputError
from gantrysim.controllers import fanuc
from gantrysim.paths import nearest
from gantrysim.paths.chain import Chain
from gantrysim.paths.pieces import Coil, Line

from support.soaked import examples

EXACT = 1e-9  # [mm]
SAGITTA = 5e-6  # [mm] of a chord: of two legs as near as that the further one may be taken
NEAR_A_TIP = 1e-3  # [mm] of arc length: where a path retraces itself its two sides are not told apart


def chain(lengths, inner, arcs):
    """A chain with an inner angle at each corner, 0 where it retraces [deg]; of lines, and arcs of some angle [rad]."""
    position, heading, pieces = np.zeros(3), 0.3, []
    for length, angle, bend in zip(lengths, [None, *inner], arcs, strict=True):
        if angle is not None:
            heading += math.pi - math.radians(angle)
        way = np.array([math.cos(heading), math.sin(heading), 0.0])
        if bend:
            radius, left = length / abs(bend), np.array([-way[1], way[0], 0.0]) * math.copysign(1, bend)
            centre = position + radius * left
            begin = math.atan2(*(position - centre)[1::-1])
            pieces.append(Coil(tuple(centre), (radius, radius), begin, bend))
            heading += bend
            end = begin + bend
            position = centre + radius * np.array([math.cos(end), math.sin(end), 0.0])
        else:
            pieces.append(Line(tuple(position), tuple(position + length * way)))
            position = position + length * way
    return Chain(pieces)


def progress(path, step, rests):
    """Arc lengths of a trace of even steps that rests at some shares of the path, (n,)."""
    s = np.linspace(0, path.length, max(int(path.length / step), 2))
    for share in rests:
        k = int(share * (len(s) - 1))
        s = np.insert(s, k, np.full(20, s[k]))
    return s


def wave(path, s, size, period):
    return path.position(s) + (size * np.sin(2 * math.pi * s / period))[:, None] * path.normal(s)


@pytest.mark.parametrize("inner", [0.5, 5.0, 30.0, 90.0])
def test_a_follower_on_the_path_is_found_behind_a_corner(inner):
    """5 mm behind the command: behind a sharp corner both are near, but the follower is on the leg before."""
    path = chain([40.0, 40.0], [inner], [0.0, 0.0])
    s = np.linspace(0, path.length, 4001)
    behind = np.maximum(s - 5, 0)
    command = path.position(s)
    follower = path.position(behind)
    foot = path.near(follower, s, path.stretches(lambda block: [command[block], follower[block]], s))
    assert foot.distance.max() < EXACT
    assert foot.s == pytest.approx(behind, abs=1e-6)


def test_a_follower_is_found_before_a_tip_that_its_command_has_passed_within_a_tick():
    """At a corner of 11 degrees: 0.1 mm before and behind the tip, and the follower 0.07 mm before it."""
    path = Chain([Line((0, 0, 0), (10, 0, 0)), Line((10, 0, 0), (0, 2, 0))])
    s = np.array([9.9, 10.1])
    follower = np.array([[9.88, 0.0, 0.0], [9.93, 0.0, 0.0]])
    foot = path.near(follower, s, path.stretches(lambda block: [path.position(s[block]), follower[block]], s))
    assert foot.s == pytest.approx([9.88, 9.93], abs=1e-6)
    assert foot.distance.max() < EXACT


angles = st.one_of(st.sampled_from([0.0, 0.0, 0.5, 1.0, 2.0, 5.0, 90.0, 180.0]), st.floats(0, 180))


@st.composite
def paths(draw):
    count = draw(st.integers(2, 6))
    lengths = draw(st.lists(st.floats(1, 30), min_size=count, max_size=count))
    if draw(st.booleans()):  # to and fro over the same stretch
        lengths = [lengths[0]] * count
    inner = draw(st.lists(angles, min_size=count - 1, max_size=count - 1))
    arcs = draw(st.lists(st.sampled_from([0.0, 0.0, 0.0, 0.7, -1.5]), min_size=count, max_size=count))
    try:
        return chain(lengths, inner, arcs)
    except InputError:
        assume(False)


@pytest.mark.validates(
    "feet of a trace on chains with inner angles of 0 to 180 deg",
    "the progress it was made with",
    "1e-9 mm",
)
@given(paths(), st.floats(0.02, 0.3), st.lists(st.floats(0, 1), max_size=3))
@examples(100)
def test_a_trace_on_its_path_is_followed_as_it_was_made(path, step, rests):
    s = progress(path, step, rests)
    foot = path.follow(path.position(s), s)
    assert foot.distance.max() < EXACT
    assert np.abs(foot.s - s).max() <= 2 * step + NEAR_A_TIP


@given(paths(), st.floats(0.02, 0.2), st.floats(0, 0.1), st.floats(3, 20))
@examples(100)
def test_a_trace_beside_its_path_is_no_further_than_it_was_made(path, step, size, period):
    s = progress(path, step, [0.5])
    trace = wave(path, s, size, period)
    foot = path.follow(trace, s)
    own = np.linalg.norm(trace - path.position(s), axis=1)
    assert (foot.distance <= own + SAGITTA).all()
    assert foot.distance == pytest.approx(np.linalg.norm(trace - path.position(foot.s), axis=1), abs=EXACT)
    assert np.abs(foot.s - s).max() <= 2 * step + NEAR_A_TIP + 15 * size


@given(paths(), st.floats(0.05, 0.2), st.floats(0, 2 * math.pi))
@examples(20)
def test_a_turned_path_has_the_same_feet(path, step, angle):
    turn = np.array([[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1]])
    s = progress(path, step, [])
    trace = wave(path, s, 0.03, 7.0)
    pieces = []
    for piece in path.pieces:
        if isinstance(piece, Line):
            pieces.append(Line(tuple(turn @ piece.start), tuple(turn @ piece.end)))
        else:
            pieces.append(Coil(tuple(turn @ piece.centre), piece.radius, piece.begin + angle, piece.angle))
    turned = Chain(pieces).follow(trace @ turn.T, s)
    assert turned.distance == pytest.approx(path.follow(trace, s).distance, abs=1e-6)


PROGRAMS = {
    "there and back": ("G1 X10 F3000\nX0", 0.01),
    "four legs, two of them steep": ("G1 X37 Y11 F3000\nX0 Y0\nX-3 Y29\nX0 Y0.4", 0.2),
    "zigzag of half a millimetre": ("G1 X20 F3000\nX0 Y0.5\nX20 Y1\nX0 Y1.5\nX20 Y2", 0.06),
}


@pytest.mark.parametrize("name", PROGRAMS)
def test_programs_that_retrace_have_the_errors_of_their_motion(name, xy):
    text, largest = PROGRAMS[name]
    servo = Servo.derive(xy.axes)
    setpoints = fanuc.Program(f"{text}\nM02", acceleration=1000.0).setpoints(servo.period)
    command = Budget(perfect_follower(xy, setpoints)).values
    assert command.contour.max < 1e-6  # the command lies on the path
    run = simulate(xy, servo, setpoints)
    values = metrics.values(run)
    assert values.program.max < 1e-6
    assert values.contour.max < largest
    assert Budget(run).values.contour.max == pytest.approx(values.contour.max, abs=EXACT)
    assert Budget(run).values.contour.rms == pytest.approx(values.contour.rms, abs=EXACT)


@pytest.mark.parametrize("name", ["fanuc-conical", "stage-outline"])
def test_the_budget_s_contour_error_is_the_distance_to_the_path(name):
    budget = Budget(Job.load(name).run())
    assert budget.contour.size == pytest.approx(budget.analysis.nozzle.distance, abs=EXACT)


def test_an_overshoot_beyond_the_end_is_an_error(xy: Machine):
    path = Chain([Line((0, 0, 0), (10, 0, 0))])
    foot = path.follow(np.array([[9.0, 0, 0], [10.2, 0.1, 0]]))
    assert foot.beyond == pytest.approx([0, 0.2])
    assert foot.lateral == pytest.approx([0, 0.1])
    assert foot.distance == pytest.approx(np.hypot(*[[0, 0.2], [0, 0.1]]))


def test_traces_are_followed_by_one_kind_of_code():
    """Numba compiles anew for arrays that are read-only: a record's are, and a selection of their rows is not."""
    path = chain([20.0, 15.0], [90.0], [0.0, 0.0])
    trace = path.position(np.linspace(0.0, path.length, 400))
    trace.flags.writeable = False
    compiled = (nearest.find_feet, nearest.find_stretches, nearest.find_assignment)
    path.follow(trace)
    kinds = [len(function.signatures) for function in compiled]
    path.follow(trace.copy())
    path.follow(trace, np.linspace(0.0, path.length, 400))
    path.project(trace)
    assert [len(function.signatures) for function in compiled] == kinds
