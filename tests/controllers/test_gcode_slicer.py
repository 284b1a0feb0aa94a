"""Slicers' dialect: extrusion, travel, long programs in bounded time and memory."""

import math
import time
import tracemalloc

import numpy as np
import pytest

from gantrysim.base.errors import InputError
from gantrysim.controllers.gcode.move_table import END, FEED, FLOW, KIND
from gantrysim.controllers.gcode.slicer import Program
from gantrysim.controllers.valve import Dispense

PART = """; layer 0
M104 S210 T0
M117 Laying glue (slowly
START_PRINT BED=60 ; a macro
N7 M105*36
G28 ; home
G21
G90
M82
G92 E0
G0 X10 Y10 Z0.3 F6000
G1 X20 E1 F1200
G1 X20 Y20 E2.5
G1 E1.5 F1800
G0 X10
G1 E2.5
G2 X20 Y20 I5 E4 F1200
M83
G1 Y30 E0.5
G91
G1 X1 E-0.1
M106 S255
"""


def circle(count, radius=60.0, step=0.1):
    """Text of consecutive short pieces around a circle, laying glue."""
    a = np.arange(1, count + 1) * step / radius
    rows = [f"G1 X{radius * math.sin(t):.4f} Y{radius * math.cos(t):.4f} E{0.01 * k:.4f}" for k, t in enumerate(a, 1)]
    return "\n".join([f"G0 X0 Y{radius} F6000", "F3000", *rows])


def test_a_part_s_moves_are_its_words():
    program = Program(text=PART).program
    expected = [
        # kind, x, y, feed or time, glue, material
        (0, 10, 10, 100, 0, 0),
        (0, 20, 10, 20, 1, 1),
        (0, 20, 20, 20, 1, 1.5),
        (2, 20, 20, 1 / 30, 0, -1),  # a retraction of 1 mm at 30 mm/s
        (0, 10, 20, 30, 0, 0),
        (2, 10, 20, 1 / 30, 0, 1),
        (1, 20, 20, 20, 1, 1.5),
        (0, 20, 30, 20, 1, 0.5),
        (0, 21, 30, 20, 0, -0.1),
    ]
    table = np.column_stack([program.moves[:, [KIND, END, END + 1, FEED]], program.glue, program.moves[:, FLOW]])
    np.testing.assert_allclose(table, expected, atol=1e-9)


def test_what_is_not_simulated_is_counted_and_said():
    program = Program(text=PART)
    assert program.program.ignored == {"M104": 1, "M117": 1, "G28": 1, "M106": 1, "M105": 1, "START_PRINT": 1}
    assert (
        program.notes[0]
        == "Words without an effect on the path: G28 (1), M104 (1), M105 (1), M106 (1), M117 (1), START_PRINT (1)."
    )
    assert "E feeds 4.5 mm, 0.05 to 0.15 mm per mm" in program.notes[-1]  # 0.1, 0.15 and 0.05 on lines


def test_a_dwell_without_a_time_takes_none():
    with_dwell, without = (Program(text=f"G1 X10 F600\n{dwell}\nG1 X20") for dwell in ("G4", "G4 P0"))
    assert with_dwell.duration == without.duration
    assert with_dwell.duration < Program(text="G1 X10 F600\nG4 P10\nG1 X20").duration - 0.0099


def test_the_valve_follows_the_job():
    by_feed = Program(text=PART, dispense=Dispense("feed")).program.glue
    assert by_feed.tolist() == [False, True, True, False, False, False, True, True, True]


def test_travel_is_dry_and_extrusion_is_not():
    points = Program(text="G0 X10 F6000\nG1 X20 E1 F600\nG0 X30 F6000").setpoints(1e-3)
    x = points.position[:, 0]
    assert not points.dispense[(x < 9.8) | (x > 20.2)].any()
    assert points.dispense[(x > 10.2) & (x < 19.8)].all()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("G0 X1 F60\nG81 Z1", "line 2: G81: milling cycle"),
        ("G5 X1 I1", "line 1: G5: spline"),
        ("G1 X1 F60 A", "line 1: A"),
    ],
)
def test_what_would_change_the_path_is_refused(text, message):
    with pytest.raises(InputError, match=message):
        _ = Program(text=text).duration


def test_a_corner_tolerance_must_be_positive():
    with pytest.raises(InputError, match=r"corner_tolerance = 0 mm: must be greater than 0 mm"):
        Program(text="", corner_tolerance=0.0)


@pytest.mark.soak
def test_a_hundred_thousand_lines_are_planned_in_seconds():
    text = circle(100_000)
    assert Program(text=circle(10)).duration > 0  # compiled
    begun = time.process_time()
    program = Program(text=text)
    length = program.requested.length
    assert program.duration == pytest.approx(length / 50, rel=0.01)
    assert time.process_time() - begun < 10  # 3 s on two shared cores


@pytest.mark.soak
def test_memory_grows_by_few_numbers_per_line():
    def peak(count):
        text = circle(count)
        tracemalloc.start()
        _ = Program(text=text).program
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    assert (peak(20_000) - peak(10_000)) / 10_000 < 400  # [bytes]: a row of 14 numbers, the line's text, growth


@pytest.mark.soak
def test_a_million_lines_are_planned():
    program = Program(text=circle(1_000_000))
    assert program.duration == pytest.approx(program.requested.length / 50, rel=0.01)
    assert len(program.setpoints(0.004).position) > 400_000


@pytest.mark.parametrize(
    ("head", "diameter"),
    [
        ("", None),
        ("; filament_diameter = 2.85\n", 2.85),
        (";Filament_Diameter: 1.75,1.75\n", 1.75),
        ("; filament_diameter = 0\n", None),
        ("; filament_diameter = 1.2.3\n", None),
        # M200 says how the firmware reads E
        ("; filament_diameter = 2.85\nM200 D1.75\n", 1.75),
        ("; filament_diameter = 2.85\nM200 S0\n", 2.85),
    ],
)
def test_the_filament_is_that_of_m200_or_of_the_slicer_s_comment(head, diameter):
    assert Program(text=f"{head}G1 X10 E1 F600\n").filament == diameter


@pytest.mark.parametrize("word", ["P0 L1", "P1", "L2"])
def test_settings_of_a_tool_are_neither_a_retraction_nor_a_move(word):
    text = "G28\nM83\nM207 S2\nG1 X10 E1 F600\nG10 {} X5 Y40\nG1 X20 E1"
    plain, settings = (Program(text=text.replace("G10 {} X5 Y40\n", line)) for line in ("", f"G10 {word} X5 Y40\n"))
    assert settings.requested.length == plain.requested.length
    assert settings.setpoints(1e-3).duration == plain.setpoints(1e-3).duration
    assert any("G10 of a tool" in note for note in settings.notes)
