"""FANUC's mirror image G51.1, rotation G68, rounded corners `,R` and chamfers `,C`."""

import math

import numpy as np
import pytest

from gantrysim.controllers.fanuc import Program
from gantrysim.controllers.fanuc.alarm import Alarm

SHAPE = "X30 Y0\nG02 X50 Y20 I20 J0\nG03 X60 Y30 R10\nG01 X60 Y40 Z2\nG91 X5 Y-3\nX-40\nG90 X10"
STEP = 0.5  # of points along a path [mm]


def points(text):
    """Points of the path of a program, from the end of its first move on, which leads to (20, 5)."""
    path = Program(f"G01 X20 Y5 F600\n{text}", acceleration=1000.0).requested
    return path.position(np.arange(path.ends[0], path.length, STEP))


def turned(places, degrees, x, y):
    arm = places[:, 0] - x + 1j * (places[:, 1] - y)
    arm *= np.exp(1j * math.radians(degrees))
    return np.column_stack([x + arm.real, y + arm.imag, places[:, 2]])


def test_g68_turns_all_that_follows_about_its_centre():
    plain = points(f"{SHAPE}")
    path = points(f"G68 X20 Y5 R33\n{SHAPE}\nG69")
    np.testing.assert_allclose(path, turned(plain, 33, 20, 5), atol=1e-9)


def test_without_a_centre_the_present_place_is_it():
    about_here = points(f"G68 R-90\n{SHAPE}\nG69\nX0 Y0")
    np.testing.assert_array_equal(about_here, points(f"G68 X20 Y5 R-90\n{SHAPE}\nG69\nX0 Y0"))
    # absolute places are the program's own again, from where the nozzle is
    assert np.linalg.norm(about_here[-1]) < math.hypot(STEP, 2)  # at the height that the shape ends at


def test_increments_turn_with_the_coordinates():
    ends = [leg.piece.end for leg in Program("G01 X5 F600\nG68 R90\nG91 X5\nY2\nG69\nX5").legs if leg.piece]
    np.testing.assert_allclose(ends, [(5, 0, 0), (5, 5, 0), (3, 5, 0), (8, 5, 0)], atol=1e-12)


@pytest.mark.parametrize(("axis", "column"), [("X", 0), ("Y", 1)])
def test_g51_1_mirrors_arcs_and_lines(axis, column):
    plain = points(f"{SHAPE}")
    place = (20, 5)[column]
    mirrored = plain.copy()
    mirrored[:, column] = 2 * place - plain[:, column]
    np.testing.assert_allclose(points(f"G51.1 {axis}{place}\n{SHAPE}\nG50.1 {axis}0"), mirrored, atol=1e-9)


def test_a_mirrored_program_is_turned_afterwards():
    plain = points(f"{SHAPE}")
    mirrored = np.column_stack([40 - plain[:, 0], plain[:, 1:]])
    path = points(f"G51.1 X20\nG68 X20 Y5 R20\n{SHAPE}\nG69\nG50.1")
    np.testing.assert_allclose(path, turned(mirrored, 20, 20, 5), atol=1e-9)


def test_a_mirror_exchanges_the_sides_of_cutter_compensation():
    # about x = 10, where the program begins, so that the start-up is mirrored as well
    moves = "{}G41 D1 X{a}\nY30\nX{b}\nG40 Y50"
    mirror = Program("G01 X10 F600\n" + moves.format("G51.1 X10\n", a=20, b=40), offsets={"1": 2.0})
    by_hand = Program("G01 X10 F600\n" + moves.replace("G41", "G42").format("", a=0, b=-20), offsets={"1": 2.0})
    np.testing.assert_allclose(
        mirror.requested.position([5, 25, 60]), by_hand.requested.position([5, 25, 60]), atol=1e-9
    )


def test_variables_show_the_programmed_place():
    assert Program("G01 X10 Y5 F600\nG68 X0 Y0 R90\nX7 Y3\n#1=#5001\n#2=#5002\nG69\nX#1 Y#2").legs[-1].piece.end == (
        pytest.approx((7, 3, 0))
    )


def test_corners_between_lines_are_tangent_arcs_and_chamfers():
    pieces = [leg.piece for leg in Program("G01 X20 F600,R5\nY20,C3\nX0").legs]
    assert [type(piece).__name__ for piece in pieces] == ["Line", "Coil", "Line", "Line", "Line"]
    np.testing.assert_allclose(pieces[0].end, (15, 0, 0), atol=1e-12)
    np.testing.assert_allclose(pieces[1].centre, (15, 5, 0), atol=1e-12)
    assert pieces[1].angle == pytest.approx(math.pi / 2)
    np.testing.assert_allclose(pieces[3].start, (20, 17, 0), atol=1e-12)
    np.testing.assert_allclose(pieces[3].end, (17, 20, 0), atol=1e-12)


@pytest.mark.parametrize("plane", ["G17", "G18", "G19"])
@pytest.mark.parametrize(
    "text",
    [
        "{u}20,R{r}\nG02 {u}40 {v}0 R10\nG01 {v}-20",  # line to arc
        "{u}20 {v}5\nG03 {u}40 {v}5 R12,R{r}\nG01 {u}60",  # arc to line
        "{u}20\nG02 {u}40 {v}0 R12,R{r}\nG02 {u}70 {v}0 R20",  # arc to arc
        "{u}20,R{r}\n{u}0 {v}9",  # a sharp corner
    ],
)
def test_rounded_corners_are_tangent_to_both_motions(plane, text):
    u, v = {"G17": "XY", "G18": "ZX", "G19": "YZ"}[plane]
    radius = 1.5
    program = Program(f"{plane} G01 F600 {text.format(u=u, v=v, r=radius)}", acceleration=1000.0)
    path = program.requested
    sharp = Program(f"{plane} G01 F600 {text.format(u=u, v=v, r=0)}", acceleration=1000.0).requested
    assert len(path.ends) == len(sharp.ends) + 1
    assert path.corners.size == sharp.corners.size - 1
    arcs = [leg.piece.radius for leg in program.legs if type(leg.piece).__name__ == "Coil"]
    assert any(radii == pytest.approx((radius, radius)) for radii in arcs)
    np.testing.assert_allclose(path.position(path.length), sharp.position(sharp.length), atol=1e-9)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("G01 X3 F600,R5\nY20", "055 MISSING MOVE VALUE IN CNR/CHF in block 1 .*,R5: the motions before and after"),
        ("G01 X30 F600,R5\nG04 P1\nY20", "051 MISSING MOVE AFTER CNR/CHF in block 1 .*must be followed by a motion"),
        ("G01 X30 F600,C5", "051 MISSING MOVE AFTER CNR/CHF in block 1 .*,C5"),
        ("G01 X30 F600,R5\nG00 Y9", "051 MISSING MOVE AFTER CNR/CHF in block 1"),
        ("G00 X30,R5\nG01 Y9 F600", "050 CHF/CNR NOT ALLOWED IN THIS BLOCK in block 1 .*,R in G00"),
        ("G01 X30 Z3 F600,R5\nY9", "050 CHF/CNR NOT ALLOWED IN THIS BLOCK in block 1 .*in the plane of the next"),
        (
            "G02 X30 R20 F600,C2\nG01 Y9",
            "050 CHF/CNR NOT ALLOWED IN THIS BLOCK in block 1 .*chamfer must be between two",
        ),
        (
            "G01 X30 F600,C2\nG02 X50 Y20 R20",
            "050 CHF/CNR NOT ALLOWED IN THIS BLOCK in block 1 .*chamfer must be between two",
        ),
        ("G01 X30 F600,Q5\nY9", "009 ILLEGAL ADDRESS INPUT in block 1 .*a comma must stand before R or C"),
        ("G01 X#1 F600,Q5\nY9", "009 ILLEGAL ADDRESS INPUT in block 1 .*a comma must stand before R or C"),
        ("G01 X30 F600,R-5\nY9", "009 ILLEGAL ADDRESS INPUT in block 1 .*,R = -5 mm: must be at least 0 mm"),
        ("G68 X0", "009 ILLEGAL ADDRESS INPUT in block 1 .*G68 must have R"),
        ("G51.1", "009 ILLEGAL ADDRESS INPUT in block 1 .*G51.1 must have X, Y or Z"),
        ("G68 R9\nG55 X1", "010 IMPROPER G-CODE in block 2 .*G55 in G51.1 or G68: must follow G50.1 and G69"),
        ("G51.1 X0\nG28 X0", "010 IMPROPER G-CODE in block 2 .*G28 in G51.1 or G68"),
    ],
)
def test_what_is_no_corner_or_turn_is_an_alarm(text, message):
    with pytest.raises(Alarm, match=message):
        Program(text)


def test_a_variable_sets_the_radius_of_a_corner():
    assert len(Program("#1=2\nG01 X20 F600 ,R#1\nY9").legs) == 3
