"""Programs as posts of ten kinds write them: glue is laid where their authors mean the valve to be open."""

import numpy as np
import pytest

from gantrysim.controllers import fanuc
from gantrysim.controllers.gcode import linuxcnc, slicer
from gantrysim.controllers.placement import Placement
from gantrysim.controllers.valve import Dispense

PERIOD = 1e-3


def mill(text, **arguments):
    return linuxcnc.Program(text=f"G61\n{text}", **arguments)


def printer(text, **arguments):
    return slicer.Program(text=text, corner_tolerance=1e-3, **arguments)


def control(text, **arguments):
    return fanuc.Program(text, acceleration=1000.0, **arguments)


def laid(program):
    """Stretches of dispensing: x at begin and end, z, and the time at rest in them [mm, s]."""
    setpoints = program.setpoints(PERIOD)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], setpoints.dispense, [False]])))
    stretches = []
    for begin, after in edges.reshape(-1, 2).tolist():
        place = setpoints.position[begin : after + 1]
        stands = np.abs(np.diff(place, axis=0)).max(axis=1) < 1e-9
        x = np.round(place[[0, -1], 0], 1).tolist()
        z = place[0, 2] if place.shape[1] > 2 else 0.0
        stretches.append((*x, round(float(z), 1), round(float(stands.sum() * PERIOD), 1)))
    return stretches


# solder paste: turned forwards by M3, a dwell until it flows, the pads, then backwards by M4, a dwell, and off
PASTE = """G21 G90 G94
G00 Z15
G00 X10 Y0
G01 F120 Z0.05
M03 S300
G4 P0.5
G01 F180 Z0.2
G01 F300 X14
M05
G01 Z0.1
M04 S300
G4 P0.3
M05
G00 Z15
G00 X30
G01 F120 Z0.05
M03 S300
G4 P0.5
G01 F180 Z0.2
G01 F300 X34
M05
M04 S300
G4 P0.3
M05
G00 Z15
"""
# the same without the M5 between, and travel at feed while the pump still turns back
BACKWARDS = (
    "G0 Z5\nG0 X10\nG1 Z0.2 F300\nM3 S300\nG1 X14\nM4 S300\nG4 P0.3\nG1 Z5\nG1 X30\nG1 Z0.2\nM3 S300\nG1 X34\nM5"
)
# engraving of a circuit board: the spindle gets up to speed before the tool goes down
ENGRAVED = (
    "G21 G90\nG00 X0 Y0\nM03\nG04 P1\nG00 Z10\nG00 X5\nG01 Z1 F600\nG01 X25 F600\nG00 Z10\nG00 X40\n"
    "G01 Z1\nX50\nG00 Z10\nM05\nM02"
)
HIGH = ENGRAVED.replace("M03", "G00 Z20\nM03")
# dots of paste by a fan's output: needle down, on, time, off, needle up
PADS = "G21\nG90\nG0 F20000\nG0 Z4\n" + "".join(
    f"G0 X{x} Y10 Z2.5\nG1 Z1.7\nM106\nG4 P{time}\nM107\nG1 Z2.5\nG1 Z5\n"
    for x, time in ((10, 130), (13, 130), (16, 210))
)
# a plotter's pen on a servo, whose angles are no speeds
PEN = (
    "G21\nG90\nG1 X5 F3000\nM300 S30.00\nG4 P150\nG1 X25\nM300 S50.00\nG4 P150\nG1 X40\nM300 S30\n"
    "G4 P150\nG1 X50\nM300 S50\nM300 S255"
)
# a laser's power in the moves: M4 is on, in a file of its own and beside M3
LASER = "G21\nG90\nM4 S0\nG0 X5\nG1 X25 S800 F1200\nG0 X40\nG1 X50\nM5"
LASERS = "M3 S0\nG0 X5\nG1 X25 S800 F1200\nM4 S0\nG0 X40\nG1 X50 S400\nM5"
OUTPUTS = (
    "G90\nG0 Z5\nG0 X5\nG0 Z0\nM64 P1\nM62 P0\nG1 X25 F1200\nM63 P0\nG0 Z5\nG0 X40\nG0 Z0\nM62 P0\n"
    "G1 X50\nM63 P0\nG0 Z5\nM65 P1\nM2"
)
MIST = (
    "G90\nM3 S12000\nG0 Z5\nG0 X5\nG1 Z0 F300\nM7\nG1 X25 F1200\nM9\nG0 Z5\nG0 X40\nG1 Z0 F300\nM7\n"
    "G1 X50\nM9\nG0 Z5\nM5\nM30"
)
POWER = (
    "G90\nG0 Z5\nG0 X5\nG1 Z0 F300\nM106 S255\nG1 X25 F1200\nM106 S0\nG1 Z5\nG1 X40\nG1 Z0\nM106 S128\n"
    "G1 X50\nM106 S0\nG1 Z5"
)
SEALANT = (
    "O0100\nG21 G90\nG00 X5. Z5.\nG01 Z0. F300.\nM08\nG01 X25. F1200.\nM09\nG00 Z5.\nG00 X40.\n"
    "G01 Z0. F300.\nM08\nG01 X50.\nM09\nG00 Z5.\nM30"
)
TWO = [(5.0, 25.0, 0.0, 0.0), (40.0, 50.0, 0.0, 0.0)]
TWO_AT_1 = [(5.0, 25.0, 1.0, 0.0), (40.0, 50.0, 1.0, 0.0)]


@pytest.mark.parametrize(
    ("program", "text", "expected", "words"),
    [
        # the needle rises to its height between dwell and pad, which lays nothing
        (
            mill,
            PASTE,
            [(10, 10, 0.1, 0.5), (10, 14, 0.2, 0), (30, 30, 0.1, 0.5), (30, 34, 0.2, 0)],
            "M3 opens the valve and M5 or M4 closes it, M4 by sucking back:",
        ),
        (mill, BACKWARDS, [(10, 14, 0.2, 0), (30, 34, 0.2, 0)], "M3 opens the valve and M5 or M4 closes it"),
        (mill, ENGRAVED, TWO_AT_1, "None is laid in a dwell before the needle goes down to work."),
        (mill, HIGH, TWO_AT_1, "None is laid in a dwell before the needle goes down to work."),
        (printer, PADS, [(10, 10, 1.7, 0.1), (13, 13, 1.7, 0.1), (16, 16, 1.7, 0.2)], "M106 opens the valve and M107"),
        (printer, LASER, TWO, "M4 opens the valve and S0 or M5 closes it"),
        (mill, LASER, TWO, "M4 opens the valve and S0 or M5 closes it"),
        (mill, LASERS, TWO, "M3 or M4 opens the valve"),
        (mill, OUTPUTS, TWO, "M62 P0 opens the valve and M63 P0 closes it"),
        (mill, MIST, TWO, "M7 opens the valve and M9 closes it"),
        (printer, POWER, TWO, "M106 opens the valve and M106 S0 closes it"),
        (control, SEALANT, TWO, "M8 opens the valve and M9 closes it"),
    ],
)
def test_a_post_lays_glue_where_its_author_means_it(program, text, expected, words):
    made = program(text)
    assert laid(made) == [pytest.approx(stretch, abs=0.051) for stretch in expected]
    assert any(words in note for note in made.notes), made.notes


def test_other_codes_of_the_valve_are_named_by_the_job():
    pen = Dispense(on=("M300 S30",), off=("M300 S50", "M300 S255"))
    assert laid(printer(PEN, dispense=pen)) == [
        pytest.approx(stretch, abs=0.051) for stretch in [(5, 25, 0, 0.15), (40, 50, 0, 0.15)]
    ]


def test_a_pump_open_in_rapid_moves_alone_lays_none_and_a_note_has_the_remedy():
    """As files that draw with batter are written, whose moves are all G0."""
    batter = "G0 X10 F6000\nM106\nG4 P450\nG0 X30\nM107\nG0 X50"
    made = printer(batter)
    assert laid(made) == [(10, 10, 0, pytest.approx(0.45, abs=0.06))]
    assert any(
        "It is open in rapid moves alone; --set program.dispense.by=codes lays glue in them." in n for n in made.notes
    )
    assert laid(printer(batter, dispense=Dispense("codes")))[0][1] == pytest.approx(30, abs=0.2)


def test_a_dot_where_the_program_begins_is_laid():
    """Its output is off before the needle rises."""
    made = mill("G0 X0 Y0\nG0 Z0\nM3\nG4 P0.5\nM5\nG0 Z5\nG0 X10\nG0 Z0\nM3\nG4 P0.5\nM5\nG0 Z5")
    assert [stretch[:2] for stretch in laid(made)] == [(0, 0), (10, 10)]


def test_dots_on_steps_that_lead_down_are_laid():
    made = mill("G0 Z5\nG0 X5\nM3\nG4 P0.5\nM5\nG0 Z3\nG0 X10\nM3\nG4 P0.5\nM5\nG0 Z1")
    assert [stretch[::2] for stretch in laid(made)] == [(5, 5), (10, 3)]


def test_depths_that_point_down_change_nothing_of_when_glue_is_laid():
    deep = "G0 Z-5\nG0 X10\nG1 Z0 F300\nM3\nG4 P0.5\nM5\nG0 Z-5\nG0 X30\nG1 Z0\nM3\nG4 P0.5\nM5\nG0 Z-5"
    made = mill(deep, placement=Placement(z_down=True))
    assert [stretch[:2] for stretch in laid(made)] == [(10, 10), (30, 30)]


@pytest.mark.parametrize("program", [mill, printer, control])
def test_m4_beside_m3_in_moves_at_work_is_on(program):
    assert [s[:2] for s in laid(program("G1 X10 F600\nM3\nX20\nM5\nM4\nX30\nM5\nX40"))] == [(10, 30)]
