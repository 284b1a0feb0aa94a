"""Tables of points as spreadsheets, teach pendants and board programs write them, beside what they mean by hand."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.controllers.drawings.drawing import Drawing
from gantrysim.controllers.drawings.shapes import Ellipse, Segment

TICK = 1e-3

KICAD = """### Footprint positions - created on Monday ###
### Printed by KiCad version
## Unit = {unit}, Angle = deg.
## Side : top
# Ref     Val       Package                PosX       PosY       Rot  Side
C1        100n      C_0402              {0}  {1}   90.0000  top
R12       "4k7 1%"  R_0603              {2}  {3}    0.0000  top
## End
"""

BOARD_CSV = """Designator,Comment,Layer,Mid X,Mid Y,Rotation
"C1","100n, 16 V","TopLayer","10.5mm","2mm","90"
"""


def dots(drawing):
    return np.array([stroke.dot for stroke in drawing.sheet.strokes])


@pytest.mark.parametrize(("unit", "length"), [("mm", 1.0), ("inches", 25.4)])
def test_the_places_of_a_board_s_parts_are_dots(unit, length):
    drawing = Drawing(KICAD.format(10.5, -2.25, 30.0, 4.0, unit=unit), lift=2.0)
    assert dots(drawing) == pytest.approx(length * np.array([[10.5, -2.25, 0], [30, 4, 0]]), rel=1e-12)
    setpoints = drawing.setpoints(TICK)
    for place in dots(drawing)[:, :2]:
        there = np.abs(setpoints.position[:, :2] - place).max(axis=1) < 1e-9
        assert (there & setpoints.dispense).sum() * TICK == pytest.approx(0.2, abs=2 * TICK)
    assert any("columns that are not used: Ref, Val, Package, Rot, Side" in note for note in drawing.notes)


def test_a_teach_pendant_s_table_has_kinds_speeds_times_and_z_downwards():
    text = (
        "No;Type;X [mm];Y [mm];Z down [mm];Line speed;Dwell [ms]\n"
        "1;Point Dispense;5;5;2,5;;150\n"
        "2;Line Start;10;0;2;;\n"
        "3;Line Passing;20;0;2;30;\n"
        "4;Arc Point;25;5;2;20;\n"
        "5;Line End;20;10;2;20;\n"
        "6;Line Start;0;20;1;;\n"
        "7;Line End;0;30;1;;\n"
    )
    drawing = Drawing(text, speed=40.0)
    dot, first, second = drawing.sheet.strokes
    assert dot.dot.tolist() == [5, 5, -2.5]
    assert dot.dot_time == pytest.approx(0.15)
    line, arc = first.shapes
    assert isinstance(line, Segment)
    assert isinstance(arc, Ellipse)
    assert first.speed == (30, 20)
    # half a circle of radius 5 about (20, 5), through (25, 5)
    assert arc.centre == pytest.approx([20, 5, -2])
    assert arc.finish == pytest.approx(math.pi)
    assert arc.at(np.array([0.5 * math.pi]))[0][0] == pytest.approx([25, 5, -2])
    assert second.start.tolist() == [0, 20, -1]
    laid = sum(leg.length for leg in drawing.route.legs if leg.glue)
    assert laid == pytest.approx(10 + 5 * math.pi + 10, rel=1e-6)
    setpoints = drawing.setpoints(TICK)
    there = np.abs(setpoints.position - [5, 5, -2.5]).max(axis=1) < 1e-9
    assert (there & setpoints.dispense).sum() * TICK == pytest.approx(0.15, abs=2 * TICK)


@given(
    centre=st.tuples(*[st.floats(-50, 50)] * 3),
    radius=st.floats(0.1, 50),
    angles=st.lists(st.floats(0.05, 2), min_size=3, max_size=3),
    tilt=st.floats(-1, 1),
)
def test_an_arc_passes_through_its_three_points_in_their_order(centre, radius, angles, tilt):
    def on_circle(angle):
        flat = radius * math.cos(angle), radius * math.sin(angle)
        return np.add(centre, (flat[0], flat[1] * math.cos(tilt), flat[1] * math.sin(tilt)))

    points = [on_circle(angle) for angle in np.cumsum(angles)]
    rows = [",".join(map(repr, point.tolist())) for point in points]
    table = "x,y,z,kind\n" + "\n".join(f"{row},{kind}" for row, kind in zip(rows, ("start", "arc", "end"), strict=True))
    (stroke,) = Drawing(table, unit="mm").sheet.strokes
    (arc,) = stroke.shapes
    assert arc.centre == pytest.approx(centre, abs=1e-5 * radius + 1e-9)
    assert arc.finish == pytest.approx(angles[1] + angles[2], rel=1e-5)
    assert arc.ends[1] == pytest.approx(points[2], abs=1e-9 * (60 + radius))


def test_single_points_are_dots_only_where_they_are_meant():
    lines_and_points = "0,0\n10,0\n\n20,0\n"
    assert "ignored: 1 single point" in Drawing(lines_and_points).notes
    with_dots = Drawing(lines_and_points, dot_time=0.1)
    assert [stroke.dot is None for stroke in with_dots.sheet.strokes] == [True, False]
    assert Drawing("0,0\n\n5,0\n").setpoints(TICK).dispense.sum() * TICK == pytest.approx(0.4, abs=3 * TICK)


def test_the_unit_of_a_head_counts_unless_another_is_given():
    text = "x [in];y [in]\n0;0\n1;0\n"
    assert Drawing(text).requested.length == pytest.approx(25.4)
    assert Drawing(text, unit="mm").requested.length == pytest.approx(1)


def test_speeds_are_changed_in_tables_of_any_dialect():
    text = 'point;x;y;speed\nA;0;0;\n"B; last";30;0;20,5\n'
    changed = Drawing(text).with_speeds(lambda speed: 2 * speed)["text"]
    assert [leg.speed for leg in Drawing(changed).route.legs] == [41]
    assert changed.splitlines()[2] == '"B; last";30;0;41'
