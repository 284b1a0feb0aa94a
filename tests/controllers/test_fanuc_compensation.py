"""FANUC's cutter compensation: lines by their normal, arcs and spirals along the radius."""

import math
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.controllers.fanuc import Alarm, Program

from support.soaked import examples

POSITION = 1e-8  # [mm]
JOINT = 1e-6  # [mm], between the end of a piece and the start of the next


def made(text, d=2.0, **parameters):
    return Program(text, offsets={"1": d}, **parameters)


def corners(program):
    path = program.requested
    return path.position(np.concatenate([[0], path.ends]))[:, :2]


def gaps(program):
    path = program.requested
    ends = path.ends[:-1]
    return np.linalg.norm(path.position(ends - 1e-9) - path.position(ends + 1e-9), axis=1)


SPIRAL = "G41 D1 G01 X0 Y100 F6000\nG02 X0 Y-30 I0 J-100 Q-20\nG40 G01 X0 Y-60"


@pytest.mark.parametrize(("side", "outward"), [("G41", 1), ("G42", -1)])
@pytest.mark.parametrize(("code", "sense"), [("G02", 1), ("G03", -1)])
def test_a_spiral_is_offset_along_its_radius(side, outward, code, sense):
    """Left of a clockwise path is outward; the same angle, another radius."""
    text = SPIRAL.replace("G41", side).replace("G02", code)
    piece = made(text, start=(0, 150, 0)).requested.pieces[1]
    change = outward * sense * 2.0
    assert piece.radius == pytest.approx((100 + change, 30 + change), abs=POSITION)
    assert abs(piece.angle) == pytest.approx(3.5 * 2 * math.pi)
    assert piece.centre == pytest.approx((0, 0, 0), abs=POSITION)


def test_start_up_and_cancel_are_straight_to_and_from_the_offset_point():
    points = corners(made(SPIRAL, start=(0, 150, 0)))
    assert points == pytest.approx(np.array([[0, 150], [0, 102], [0, -32], [0, -60]]), abs=1e-6)


def test_setpoints_are_those_of_the_offset_path():
    program = made(SPIRAL, start=(0, 150, 0))
    position = program.setpoints(0.01).position
    assert position[-1] == pytest.approx([0, -60], abs=POSITION)
    assert program.duration == pytest.approx(program.requested.length / 100)


SQUARE = "G{} D1 G01 X0 Y0 F600\nX40\nY40\nX0\nY0\nG40 X-10 Y-10"


@pytest.mark.parametrize(("side", "d"), [(41, 2.0), (42, 2.0), (41, -2.0)])
def test_a_square_is_offset_to_its_intersections(side, d):
    inside = (side == 41) == (d > 0)  # counter-clockwise, the left is inside
    points = corners(made(SQUARE.format(side), d, start=(-10, -10, 0)))
    off = 2.0 if inside else -2.0
    low, high = off, 40 - off
    # the first and the last are offset along their own normals: where compensation begins and ends no corner is cut
    expected = [[-10, -10], [0, low], [high, low], [high, high], [low, high], [low, 0], [-10, -10]]
    assert points == pytest.approx(np.array(expected), abs=1e-6)


def test_a_tangent_joint_stays_tangent():
    text = "G41 D1 G01 X0 Y0 F600\nX40\nG03 X50 Y10 J10\nG01 Y40\nG40 X60"
    program = made(text, start=(-10, 0, 0))
    pieces = program.requested.pieces
    assert len(pieces) == 5
    assert pieces[2].radius == pytest.approx((8, 8), abs=POSITION)
    assert gaps(program).max() < JOINT
    assert made(text.replace("G41", "G42"), start=(-10, 0, 0)).requested.pieces[2].radius == pytest.approx((12, 12))


def test_an_outer_corner_at_an_arc_is_extended_along_both_tangents():
    program = made("G41 D1 G01 X0 Y0 F600\nX40\nG02 X20 Y-20 I-20 J0\nG40 G01 X0", start=(-10, 0, 0))
    assert [type(piece).__name__ for piece in program.requested.pieces] == ["Line"] * 4 + ["Coil", "Line"]
    assert corners(program)[2:5] == pytest.approx(np.array([[40, 2], [42, 2], [42, 0]]), abs=POSITION)
    assert program.requested.pieces[4].radius == pytest.approx((22, 22), abs=POSITION)
    assert gaps(program).max() < JOINT


@pytest.mark.parametrize(
    "after",
    ["X10 Y-5", "X-60 Y-0.1", "X40 Y-30", "X70 Y-90", "G02 X20 Y-20 I-20 J0", "G02 X30 Y-10 I-5 J-5", "G02 X40 I-9"],
)
def test_no_place_is_nearer_to_an_outer_corner_than_the_offset(after):
    program = made(f"G41 D1 G01 X0 Y0 F600\nX40\n{after}\nG40 G01 Y-200", start=(-10, 0, 0))
    ends = program.requested.ends
    s = np.linspace(ends[0], ends[-2], 20001)
    distance = np.linalg.norm(program.requested.position(s)[:, :2] - [40, 0], axis=1)
    assert distance.min() == pytest.approx(2, abs=1e-3)
    assert gaps(program).max() < JOINT


def test_the_rotary_axis_stands_while_a_corner_is_rounded():
    text = "G41 D1 G01 X0 Y0 F600\nX40\nG02 X20 Y-20 I-20 J0 C90\nG40 G01 X0"
    angle = made(text, start=(-10, 0, 0)).setpoints(0.01).position[:, 2]
    assert np.diff(angle).min() >= 0
    assert np.diff(angle).max() < 0.5
    assert angle[-1] == 90


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "G41 D1 G01 X0 Y0 F600\nX40\nN5 G03 X43 Y3 J3\nG40 G01 Y20",
            "alarm 041 INTERFERENCE IN CUTTER COMPENSATION in block N5 (line 3): radius = 3 mm: must be greater than "
            "the offset, 5 mm",
        ),
        (
            "G41 D1 G01 X0 Y0 F600\nY40\nN5 G18 Z9\nG40 X9",
            "alarm 037 CAN NOT CHANGE PLANE IN CRC in block N5 (line 3): plane zx under cutter compensation in plane "
            "xy: must be selected after G40",
        ),
        (
            "G41 D1 G01 X0 Y0 F600\nX40\nN5 Y3\nX0\nG40 Y20",
            "alarm 041 INTERFERENCE IN CUTTER COMPENSATION in block N5 (line 3): straight move too short for the "
            "offset of 5 mm at its corners",
        ),
        (
            "G41 D1 G01 X0 Y0 F600\nX40\nN5 G02 X60 Y0 I10\nG40 G01 X80",
            "alarm 041 INTERFERENCE IN CUTTER COMPENSATION in block N5 (line 3): inner corner of 90 deg at an arc: the "
            "offset paths do not meet there",
        ),
        (
            "G41 D1 G01 X0 Y0 F600\nX40\nN5 G40 G02 X60 Y0 I10",
            "alarm 034 NO CIRC ALLOWED IN ST-UP/EXT BLK in block N5 (line 3): cutter compensation begins or ends in "
            "an arc: must be in a straight move",
        ),
        (
            "G41 D7 G01 X0 Y0 F600",
            "alarm 009 ILLEGAL ADDRESS INPUT in block 1 (line 1): D7: must be one of the program's offsets, 1",
        ),
    ],
)
def test_an_impossible_offset_is_an_alarm(text, message):
    with pytest.raises(Alarm) as raised:
        made(text, 5.0, start=(-10, 0, 0))
    assert str(raised.value) == message


def test_an_unknown_offset_without_compensation_is_no_alarm():
    """As in T1 D1 M06 at the head of a program that compensates nothing."""
    plain = "G01 X40 Y0 F600\nY30"
    assert made("T1 D7 M06\n" + plain, 5.0).requested.length == made(plain, 5.0).requested.length


@pytest.mark.parametrize(
    ("text", "end"),
    [
        ("G41 D1 G01 Y10 F100\nN20 G02 X10 Y10 I10 Q-10", "end"),
        ("G41 D1 G01 Y10 F100\nN20 G02 X10 Y10 I0 J0 Q10", "start"),
    ],
)
def test_a_spiral_to_or_from_its_centre_has_no_offset(text, end):
    with pytest.raises(Alarm, match=f"alarm 5124 .* in block N20 .*: {end} at the centre"):
        made(text)


def test_a_height_move_keeps_its_place_beside_the_path():
    text = "G41 D1 G01 X0 Y0 F600\nX40\nZ5\nX80\nG40 X90"
    program = made(text, start=(-10, 0, 0))
    assert gaps(program).max() < JOINT
    path = program.requested
    assert path.position(path.length)[0] == pytest.approx([90, 0, 5], abs=POSITION)
    assert path.position(60.0)[0][1] == pytest.approx(2, abs=0.1)


def test_a_height_move_after_start_up_does_not_hide_the_next_direction():
    points = corners(made("G41 D1 G01 X0 Y0 F600\nZ-5\nX40\nY40\nG40 Y50", start=(-10, 0, 0)))
    expected = [[-10, 0], [0, 2], [0, 2], [38, 2], [38, 40], [40, 50]]
    assert points == pytest.approx(np.array(expected), abs=1e-6)


def test_lines_that_climb_meet_at_the_programmed_height():
    path = made("G41 D1 G01 X0 Y0 F600\nX40 Z10\nY40 Z30\nG40 Y50", start=(-10, 0, 0)).requested
    points = path.position(np.concatenate([[0], path.ends]))
    expected = [[-10, 0, 0], [0, 2, 0], [38, 2, 10], [38, 40, 30], [40, 50, 30]]
    assert points == pytest.approx(np.array(expected), abs=1e-6)


@pytest.mark.parametrize("degrees", [45, 90, 135, 170])
def test_an_outer_corner_is_extended_up_to_a_right_angle_and_cut_off_beyond(degrees):
    turn = math.radians(degrees)
    place = 40 + 40 * np.exp(-1j * turn)
    text = f"G41 D1 G01 X0 Y0 F600\nX40\nX{place.real:.5f} Y{place.imag:.5f}\nG40 Y100"
    points = corners(made(text, start=(-10, 0, 0)))
    if degrees <= 90:
        assert points[2] == pytest.approx([40 + 2 * math.tan(turn / 2), 2], abs=1e-4)
    else:
        back = 40 + (2j - 2) * np.exp(-1j * turn)
        assert points[2:5] == pytest.approx(np.array([[40, 2], [42, 2], [back.real, back.imag]]), abs=1e-4)


def test_a_zero_offset_has_no_effect():
    plain = Program(SPIRAL.replace("G41 D1 ", "").replace("G40 ", ""), start=(0, 150, 0))
    assert made(SPIRAL, 0.0, start=(0, 150, 0)).requested.parameters() == plain.requested.parameters()


@given(st.lists(st.floats(0.1, 0.9), min_size=2, max_size=12), st.floats(0.1, 3), st.booleans())
@examples(60)
def test_beside_a_convex_outline_every_point_is_as_far_as_the_offset_or_further(turns, d, left):
    """Against the distance to the programmed path itself."""
    heading, place, words = 0.0, 0j, []
    for turn in turns:
        place += 30 * np.exp(1j * heading)
        words.append(f"G01 X{place.real:.4f} Y{place.imag:.4f}")
        heading += turn * min(1, 3 / sum(turns))  # less than half around: it does not come back to itself
    text = "G{} D1 G01 X0 Y0 F600\n{}\nG40 X0 Y500".format(41 if left else 42, "\n".join(words))
    program = made(text, d, start=(-10, 0, 0))
    plain = Program("F600\n" + "\n".join(words))
    ends = np.concatenate([[0], program.requested.ends])
    s = np.linspace(ends[1], ends[-2], 400)
    distance = plain.requested.project(program.requested.position(s)).distance
    # the first line is offset from its beginning on, so the nearest place is never nearer than the offset
    assert distance.min() == pytest.approx(d, abs=1e-4)
    assert gaps(program).max() < JOINT


@pytest.mark.parametrize("code", ["G18", "G19"])
def test_compensation_in_the_other_planes_is_that_of_the_first_with_axes_permuted(code):
    first, second, across = {"G18": (2, 0, 1), "G19": (1, 2, 0)}[code]
    flat = made("G41 D1 G01 X0 Y0 F600\nX40\nY40\nG03 X30 Y50 I-10\nG40 G01 X0", start=(-10, 0, 0))
    a, b, i = "XYZ"[first], "XYZ"[second], "IJK"[first]
    start = [0.0, 0.0, 0.0]
    start[first] = -10.0
    text = f"{code} G41 D1 G01 {a}0 {b}0 F600\n{a}40\n{b}40\nG03 {a}30 {b}50 {i}-10\nG40 G01 {a}0"
    tilted = made(text, start=tuple(start))
    s = np.linspace(0, flat.requested.length, 200)
    assert tilted.requested.position(s)[:, [first, second, across]] == pytest.approx(
        flat.requested.position(s), abs=POSITION
    )


@pytest.mark.soak
def test_the_time_to_offset_grows_with_the_program_alone():
    def seconds(n):
        angle = np.linspace(0, 6, n)
        words = "\n".join(f"G01 X{100 * math.cos(a):.4f} Y{100 * math.sin(a):.4f}" for a in angle)
        begun = time.process_time()
        made(f"F600 G41 D1\n{words}", 1.0)
        return time.process_time() - begun

    seconds(50)
    assert min(seconds(3200) for _ in range(2)) < 0.5 * 8**2 * min(seconds(400) for _ in range(3))
