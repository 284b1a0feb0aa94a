"""Cutter compensation of LinuxCNC's dialect: the path keeps its distance from the programmed one."""

import math

import numpy as np
import pytest

from gantrysim.base.errors import InputError
from gantrysim.controllers.gcode.linuxcnc import Program
from gantrysim.controllers.gcode.move_table import ANGLE, DWELL, END, KIND, SOURCE

STEP = 0.02  # of points along a path [mm]
# every kind of corner, inner and outer, and where LinuxCNC's own interpreter leads (2.10, read to six decimals)
CORNERS = """G21 F600
G0 X-10 Y0
G41.1 D4
G1 X0 Y0
Y20
G2 X20 Y40 R20
G1 X30 Y30
X40 Y44
G2 X64 Y40 R16
X80 Y10 R22
G3 X72 Y-14 R30
X50 Y-10 R16
G1 X40 Y-30
Z-1
G3 X20 Y-32 R18
G1 Y-20 Z-2
X0 Y0
G40 X-10
M2
"""
REACHED = [
    (-10, 0, 0),
    (-2, 2, 0),
    (-2, 20, 0),
    (20, 42, 0),
    (21.414214, 41.414214, 0),
    (29.74479, 33.083637, 0),
    (38.372533, 45.162476, 0),
    (38.713561, 45.531363, 0),
    (65.240678, 41.775186, 0),
    (81.847399, 9.233764, 0),
    (81.453798, 8.626512, 0),
    (73.987132, -13.773488, 0),
    (70.36907, -15.157613, 0),
    (51.545698, -11.380739, 0),
    (41.788854, -30.894427, 0),
    (41.788854, -30.894427, -1),
    (39.05399, -31.762119, -1),
    (21.276212, -33.539897, -1),
    (18, -32, -1),
    (18, -20.828427, -2),
    (-1.414214, -1.414214, -2),
    (-10, 0, -2),
]


def distances(points, corners):
    """Distances of points from a closed polygon."""
    a = np.asarray(corners, float)
    b = np.roll(a, -1, axis=0)
    along = b - a
    share = np.einsum("pij,ij->pi", points[:, None] - a, along) / (along**2).sum(axis=1)
    foot = a + np.clip(share, 0, 1)[..., None] * along
    return np.linalg.norm(points[:, None] - foot, axis=2).min(axis=1)


def test_corners_of_every_kind_lead_where_linuxcnc_does():
    table = Program(text=CORNERS).program.moves
    np.testing.assert_allclose(table[:, END : END + 3], REACHED, atol=1e-6)


@pytest.mark.parametrize("side", ["G41.1", "G42.1"])
@pytest.mark.parametrize("clockwise", [False, True])
@pytest.mark.parametrize("seed", range(1, 6))
def test_the_path_keeps_its_offset_from_a_star(side, clockwise, seed):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(5, 10))
    angles = np.sort(2 * np.pi * (np.arange(count) + rng.uniform(-0.2, 0.2, count)) / count)
    corners = rng.uniform(20, 32, count)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    if clockwise:
        corners = corners[::-1]
    entry = corners[0] + (corners[0] - corners[1])  # in line with the first side
    lap = [*corners, *corners[:3]]
    lines = [f"G1 X{x:.9f} Y{y:.9f}" for x, y in lap]
    text = f"F600\nG0 X{entry[0]:.9f} Y{entry[1]:.9f}\n{side} D2\n" + "\n".join(lines) + "\nG40 G0 X0 Y0\nM2"
    program = Program(text=text)
    source = program.program.moves[:, SOURCE]
    # from the second corner, which follows line 5, once round: there both sides of every corner have been run
    begin, end = (program.requested.ends[np.flatnonzero(source == line)[-1]] for line in (5, 5 + count))
    points = program.requested.position(np.arange(begin, end, STEP))[:, :2]
    np.testing.assert_allclose(distances(points, corners), 1.0, atol=1e-6)


@pytest.mark.parametrize("side", ["G41.1", "G42.1"])
@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("arc_first", [True, False])
def test_where_the_path_turns_back_along_an_arc_the_nozzle_keeps_its_offset(side, sense, arc_first):
    """Round the tip where the nozzle is on the arc's inside; on its outside, up to where it fits between line and arc.

    In the first half of the cases a quarter of a circle is followed by a line back along its last tangent, in the other
    half a line by a quarter of a circle back along it.
    """
    radius, length, angles = 20.0, 30.0, np.linspace(0, np.pi / 2, 4001)
    arc = 1j * sense * radius * (1 - np.exp(1j * sense * angles))
    line = -length * np.linspace(0, 1, 4001)
    if arc_first:
        line = arc[-1] + line * 1j * sense
        lead_in, first, second = -10.0, arc, line
    else:
        lead_in, first, second = line[-1] - 10.0, line[::-1], -arc.conjugate()
    # the arc that follows a line turns back, mirrored
    centre = 1j * radius * sense
    code = {1: "G3", -1: "G2"}[sense if arc_first else -sense]
    moves = [f"G1 X{place.real:.9f} Y{place.imag:.9f}" for place in (first[0], first[-1], second[-1])]
    curved = 1 if arc_first else 2
    moves[curved] = f"{code}{moves[curved][2:]} I0 J{centre.imag:.9f}"
    text = f"F600\nG0 X{lead_in:.9f} Y0\n{side} D2\n" + "\n".join(moves) + "\nG40 G0 X90 Y90\nM2"
    program = Program(text=text)
    source = program.program.moves[:, SOURCE]
    begin, end = (program.requested.ends[np.flatnonzero(source == line_number)[-1]] for line_number in (4, 6))
    nozzle = program.requested.position(np.arange(begin, end, STEP))[:, :2] @ [1, 1j]
    programmed = np.concatenate([first, second])
    apart = [np.abs(programmed - place).min() for place in nozzle]
    np.testing.assert_allclose(apart, 1.0, atol=1e-4)


def test_almost_straight_corners_have_no_arc_as_in_linuxcnc():
    turned = [30 * np.exp(1j * 0.049 * k) for k in range(6)]
    places = np.cumsum([0, *turned])
    text = "F600\nG0 X-9\nG42.1 D8\n" + "\n".join(f"G1 X{p.real:.9f} Y{p.imag:.9f}" for p in places) + "\nG40 G0 Y-50"
    table = Program(text=text).program.moves
    assert len(table) == len(places) + 2
    ends = table[2:-1, END] + 1j * table[2:-1, END + 1]
    np.testing.assert_allclose(ends, places[1:] - 4j * np.exp(1j * 0.049 * np.arange(6)), atol=1e-6)


def test_a_round_trip_about_a_circle_has_the_radius_of_both():
    text = "F600\nG0 X-30 Y-10\nG42.1 D3\nG1 X0 Y-10\nG3 X0 Y-10 J10\nG1 X20\nG40 G0 Y-30\nM2"
    table = Program(text=text).program.moves
    arc = table[table[:, ANGLE] != 0][0]
    np.testing.assert_allclose(arc[END : END + 2], (0, -11.5), atol=1e-12)
    assert arc[ANGLE] == pytest.approx(2 * math.pi)


def test_what_follows_across_the_plane_and_dwells_stay_at_the_cut_corner():
    table = Program(text="F600\nG0 X-9\nG42.1 D2\nG1 X0\nX20\nZ-3\nG4 P1\nZ0\nY-20\nG40 X40").program.moves
    np.testing.assert_allclose(table[3:6, END : END + 2], [(19, -1)] * 3, atol=1e-12)
    assert table[4, KIND] == DWELL
    np.testing.assert_allclose(table[6, END : END + 3], (19, -20, 0), atol=1e-12)


def test_after_compensation_a_height_move_returns_to_the_path_but_not_after_a_change_of_the_tool():
    text = "F600\nG0 X-9\nG42.1 D2\nG1 X0\nX20\nG40\n{}G0 Z5\nM2"
    for change, place in (("", (20, 0, 5)), ("T2 M6\n", (20, -1, 5))):
        np.testing.assert_allclose(
            Program(text=text.format(change)).program.moves[-1, END : END + 3], place, atol=1e-12
        )


def test_a_dwell_after_compensation_does_not_hide_the_way_back():
    text = "F600 G61\nG0 X-9\nG42.1 D2\nG1 X0\nX20\nG40\n{}G1 X20 Y0\nX30\nM2"
    with_dwell = Program(text=text.format("G4 P1\n"))
    plain = Program(text=text.format(""))
    assert with_dwell.requested.length == pytest.approx(plain.requested.length, abs=1e-12)
    assert with_dwell.duration == pytest.approx(plain.duration + 1, abs=0.1)


def test_the_radius_is_that_of_the_tool():
    body = "G1 X0\nX20\nY20\nG40 X40"
    given = Program(text=f"F600\nG0 X-9\nG41.1 D6\n{body}").program.moves
    for select in ("T3 M6\nG41", "G41 D3", "M61 Q3\nG41", "G10 L1 P3 R3\nG41 D3"):
        tools = {} if "G10" in select else {"3": 6.0}
        moves = Program(text=f"F600\nG0 X-9\n{select}\n{body}", tool_diameters=tools).program.moves
        # M6 is carried out at rest
        np.testing.assert_array_equal(moves[moves[:, KIND] != DWELL][:, END : END + 3], given[:, END : END + 3])
    inch = Program(text=f"G20 F600\nG0 X-.354330709\nG41.1 D[6/25.4]\nG21\n{body}").program.moves
    np.testing.assert_allclose(inch[1:, END : END + 3], given[1:, END : END + 3], atol=1e-6)


def test_a_tool_of_unknown_diameter_follows_the_programmed_path():
    body = "G1 X0\nX20\nY20\nG40 X40\nG2 X50 Y30 R12"
    program = Program(text=f"F600\nT4 M6\nG0 X-9\nG42 D4\n{body}")
    plain = Program(text=f"F600\nT4 M6\nG0 X-9\n{body}")
    np.testing.assert_array_equal(program.program.moves[:, END : END + 3], plain.program.moves[:, END : END + 3])
    assert any("tool 4, whose diameter was not given" in note for note in program.notes)
    assert not any("diameter" in note for note in plain.notes)


def test_d_is_the_diameter_of_compensation_alone_and_may_be_negative():
    with pytest.raises(InputError, match="line 1: D1: is not used in this block"):
        Program(text="T1 M6 D1\nG0 X1").setpoints(1e-3)
    right = Program(text="F9\nG0 X-9\nG42.1 D4\nG1 X0\nX20\nY20\nG40 X40").program.moves
    left = Program(text="F9\nG0 X-9\nG41.1 D-4\nG1 X0\nX20\nY20\nG40 X40").program.moves
    np.testing.assert_array_equal(left, right)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "G41.1 D6\nG1 X2",
            r"line 3: cutter compensation begins in a move of 2 mm: must be longer than its offset, 3 mm",
        ),
        ("G41.1 D6\nG1 Z2", r"line 3: cutter compensation begins in a move across its plane"),
        ("G41.1 D6\nG1 X9\nG3 X9 Y4 J2", r"line 4: radius = 2 mm: must be greater than the offset"),
        ("G41.1 D6\nG1 X9\nX10\nY9", r"line 5: inner corner of cutter compensation: the move before must be longer"),
        ("G41.1 D6\nG1 X9\nX30\nY2", r"line 5: inner corner of cutter compensation: the move must be longer"),
        ("G41.1 D6\nG1 X9\nG40\nG2 X12 R9", r"line 5: arc after cutter compensation has ended: must follow a straight"),
        ("G41.1 D6\nG41.1 D6", r"line 3: cutter compensation is on already: must end with G40"),
        ("G19 G41.1 D6", r"line 2: cutter compensation in G19: must be in G17 or G18"),
        ("G41.1 D6\nG18", r"line 3: G18 under cutter compensation in G17: must follow G40"),
        ("G41.1 D6\nG92 X0", r"line 3: G92 under cutter compensation: must follow G40"),
        ("G41.1 D6\nG55", r"line 3: G55 under cutter compensation: must follow G40"),
        ("G41.1 D6\nG28", r"line 3: G28 under cutter compensation: must follow G40"),
        ("G41.1 D6\nG81 X1 R1 Z0", r"line 3: G81 under cutter compensation: must follow G40"),
        ("G41.1 D6\nT2 M6", r"line 3: M6 under cutter compensation: must follow G40"),
        ("G5 X9 Y9 I1 J1 P1 Q1\nG41.1 D6\nX20 Y20 I1 J1 P1 Q1", r"line 4: G5 under cutter compensation: must follow"),
        ("G41.1", r"line 2: G41.1: must have a diameter D"),
        ("G41 D1.5", r"line 2: D1.5: must be the number of a tool"),
    ],
)
def test_what_has_no_room_or_no_meaning_is_refused(text, message):
    with pytest.raises(InputError, match=message):
        _ = Program(text=f"F600\n{text}").program
