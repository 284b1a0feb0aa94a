"""When glue is laid, alike in all dialects: moves at feed, codes for the valve, moves straight up or down."""

import numpy as np
import pytest

from gantrysim.base.errors import InputError
from gantrysim.controllers import fanuc, softmc, trio
from gantrysim.controllers.gcode import linuxcnc, slicer
from gantrysim.controllers.gcode.move_table import KIND, LINE
from gantrysim.controllers.valve import Dispense

PERIOD = 1e-3
FANUC_WORDS = {"rapid": 6000.0}


def linuxcnc_program(text, **arguments):
    return linuxcnc.Program(text=f"G61\n{text}", **arguments)


def printer_program(text, **arguments):
    return slicer.Program(text=text, corner_tolerance=1e-3, **arguments)


def fanuc_program(text, **arguments):
    return fanuc.Program(text.replace(" P", " P"), acceleration=1000.0, **arguments)


DIALECTS = [linuxcnc_program, printer_program, fanuc_program]


def laid(program):
    """Ends of the stretches of dispensing, as x at their begins and ends [mm]."""
    setpoints = program.setpoints(PERIOD)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], setpoints.dispense, [False]])))
    x = setpoints.position[:, 0]
    return np.round(x[np.minimum(edges, len(x) - 1)], 0).reshape(-1, 2).tolist()


def length(program):
    """Commanded way with glue [mm]."""
    setpoints = program.setpoints(PERIOD)
    steps = np.linalg.norm(np.diff(setpoints.position, axis=0), axis=1)
    return float(steps[setpoints.dispense[:-1]].sum())


MILLED = """G21 G90
G0 X0 Y0 Z10 F6000
S1000 M3
G0 X50
G1 Z0 F600
G1 X100
G1 Z10
G0 X150 F6000
G1 Z0 F600
M5
G1 X160
M30"""


@pytest.mark.parametrize("program", DIALECTS)
def test_codes_for_the_valve_lay_glue_at_feed_but_not_straight_up_or_down(program):
    assert length(program(MILLED)) == pytest.approx(50, abs=0.1)
    assert laid(program(MILLED)) == [[50, 100]]


@pytest.mark.parametrize("program", DIALECTS)
def test_without_codes_every_move_at_feed_lays_glue_but_not_straight_up_or_down(program):
    plain = MILLED.replace("S1000 M3\n", "").replace("M5\n", "")
    assert laid(program(plain)) == [[50, 100], [150, 160]]
    # one that leads down and ahead lays glue
    slanted = plain.replace("G1 Z0 F600\nG1 X100", "G1 X60 Z0 F600\nG1 X100")
    assert laid(program(slanted)) == [[50, 100], [150, 160]]


@pytest.mark.parametrize("program", DIALECTS)
@pytest.mark.parametrize(
    ("on", "off"),
    [
        ("M3", "M5"),
        ("M4", "M5"),
        ("M03 S500", "M05"),
        ("M3 S500", "S0"),
        ("M7", "M9"),
        ("M8", "M9"),
        ("M62 P0", "M63 P0"),
        ("M64 P2", "M65 P2"),
        ("M64 P2", "M63 P2"),
        ("M106", "M107"),
        ("M106 S200", "M106 S0"),
    ],
)
def test_every_code_for_the_valve_switches_it_in_every_dialect(program, on, off):
    made = program(f"G0 X10 F6000\nG1 X20 F600\n{on}\nX30\nG0 X40 F6000\nG1 X50 F600\n{off}\nX60\n{on}\nX70\n{off}")
    assert laid(made) == [[20, 30], [40, 50], [60, 70]]
    (note,) = [note for note in made.notes if "opens the valve" in note]
    assert note.startswith(f"{on.replace('M0', 'M').removesuffix(' S500').removesuffix(' S200')} opens the valve and ")
    assert f"{off.replace('M0', 'M')} closes it: glue is laid in moves at feed, and in dwells" in note


@pytest.mark.parametrize("program", DIALECTS)
def test_other_spindle_words_between_leave_the_valve_open(program):
    assert laid(program("G1 X10 F600\nM3\nX20\nM4\nX30\nM5\nX40")) == [[10, 30]]


@pytest.mark.parametrize("program", DIALECTS)
def test_a_dwell_lays_glue_while_codes_hold_the_valve_open(program):
    for switches, dwells in ((True, 1), (False, 0)):
        on, off = ("M8\n", "M9\n") if switches else ("", "")
        made = program(f"G1 X10 F600\n{on}G4 P500\n{off}G0 X20")
        if program is linuxcnc_program:
            made = program(f"G1 X10 F600\n{on}G4 P0.5\n{off}G0 X20")
        setpoints = made.setpoints(PERIOD)
        stands = np.append(np.diff(setpoints.position[:, 0]) == 0, False)
        assert setpoints.dispense[stands].sum() * PERIOD == pytest.approx(0.5 * dwells, abs=0.01)


@pytest.mark.parametrize("program", DIALECTS)
def test_the_output_that_is_switched_most_often_is_the_valve(program):
    text = "M3\nG1 X10 F600\nM8\nX20\nM9\nX30\nM8\nX40\nM9\nM5"
    made = program(text)
    assert laid(made) == [[10, 20], [30, 40]]
    other = """M3 and M5 do not switch it; to let them, --set 'program.dispense={on = ["M3"], off = ["M5"]}'."""
    assert any(other in note for note in made.notes)
    assert laid(program(text, dispense=Dispense(on=("M3",), off=("M5",)))) == [[0, 40]]


@pytest.mark.parametrize("program", DIALECTS)
def test_of_two_digital_outputs_the_one_that_is_switched_most_often_is_the_valve(program):
    text = "M64 P1\nG1 X10 F600\nM64 P0\nX20\nM65 P0\nX30\nM64 P0\nX40\nM65 P0\nM65 P1"
    assert laid(program(text)) == [[10, 20], [30, 40]]


@pytest.mark.parametrize("program", DIALECTS)
def test_codes_that_only_close_are_none_for_the_valve(program):
    made = program("M5\nM9\nG1 X10 F600\nM5")
    assert laid(made) == [[0, 10]]
    assert not any("opens the valve" in note for note in made.notes)


@pytest.mark.parametrize("program", DIALECTS)
def test_a_valve_that_nothing_closes_stays_open(program):
    made = program("G1 X10 F600\nM3\nX20")
    assert laid(made) == [[10, 20]]
    assert any("M3 opens the valve and nothing closes it" in note for note in made.notes)


@pytest.mark.parametrize("program", DIALECTS)
@pytest.mark.parametrize(
    ("dispense", "expected"),
    [
        (Dispense("feed"), [[50, 100], [150, 160]]),
        (Dispense("codes"), [[0, 150]]),
        (Dispense("auto", on=("M8",)), []),
        (Dispense("extrusion"), []),
    ],
)
def test_the_job_decides_where_it_says_so(program, dispense, expected):
    """By codes the valve is as they leave it, in rapid moves and straight down, too."""
    assert laid(program(MILLED, dispense=dispense)) == expected


def test_material_that_e_feeds_goes_before_codes():
    text = "M106 S255\nG0 X10 F6000\nG1 X20 E1 F600\nG0 X30\nG1 X40 E2\nM107"
    made = printer_program(text)
    assert laid(made) == [[10, 20], [30, 40]]
    assert not any("opens the valve" in note for note in made.notes)
    assert any("M106 (1)" in note for note in made.notes)


def test_times_and_temperatures_are_no_speeds_of_the_spindle():
    assert laid(printer_program("M3 S100\nG1 X10 F600\nG4 S0\nM104 S0\nG1 X20\nM5")) == [[0, 20]]
    assert laid(printer_program("M3\nG1 X10 S100 F600\nG1 X20 S0\nG1 X30 S90\nM5")) == [[0, 10], [20, 30]]


@pytest.mark.parametrize("program", DIALECTS)
def test_a_speed_of_0_in_every_block_switches_nothing(program):
    assert laid(program("G1 X10 F600\nM3 S0\nX20\nM5\nX30\nM3 S0\nX40\nM5\nX50")) == [[10, 20], [30, 40]]


def test_a_code_that_does_not_run_switches_nothing():
    text = "o1 if [0 EQ 1]\nM3\no1 endif\nG1 X10 F600\nM5"
    assert laid(linuxcnc_program(text)) == [[0, 10]]
    assert laid(fanuc_program("IF [0 EQ 1] GOTO 9\nGOTO 5\nN9 M3\nN5 G01 X10 F600\nM5")) == [[0, 10]]


def test_a_move_straight_up_in_basic_lays_no_glue_where_nothing_switches_the_valve():
    moved = softmc.Program("Move {0, 0, 5} VCruise=20\nMove {20, 0, 5}\nMove {20, 0, 10}", start=(0, 0, 0))
    text = "BASE(0,1,2)\nSPEED=20: ACCEL=2000: DECEL=2000\nMOVE(0,0,5)\nMOVE(20,0,0)\nMOVE(0,0,5)\nWAIT IDLE\n"
    for program in (moved, trio.Basic(text=text)):
        assert length(program) == pytest.approx(20, abs=0.05)
        assert laid(program) == [[0, 20]]


@pytest.mark.parametrize("bad", ["3", "M", "M3 Q1", "M64 P1 2"])
def test_a_code_of_the_valve_is_an_m_code(bad):
    with pytest.raises(InputError, match="must be an M code"):
        Dispense("codes", on=(bad,))


def test_dispense_is_one_of_four_and_closes_what_it_opens():
    with pytest.raises(InputError, match=r"dispense\.by = 'light': must be auto, feed, codes or extrusion"):
        Dispense("light")
    with pytest.raises(InputError, match=r"dispense\.off = M9 without dispense\.on: must be with it"):
        Dispense(off=("M9",))


def test_a_program_switches_a_bounded_number_of_outputs():
    text = "#1=0\no1 while [#1 LT 300]\nM64 P#1\n#1=[#1+1]\no1 endwhile\nG1 X1 F60"
    with pytest.raises(InputError, match="more than 256 outputs"):
        linuxcnc_program(text).setpoints(PERIOD)


def lifted(text, **arguments):
    return linuxcnc.Program(text=text, **arguments).with_lift(3.0)["text"].splitlines()


def test_the_needle_is_lifted_where_no_glue_is_laid():
    each = ["G0 X5", "M03", "G1 X10 F600", "M05", "G0 Y5", "M03", "G1 X0", "M05"]
    up, down = "G0 Z3", "G0 Z0"
    strokes = [up, "G0 X5", down, "M03", "G1 X10 F600", "M05", up, up, "G0 Y5", down, "M03", "G1 X0", "M05", up]
    assert lifted("\n".join(each)) == strokes
    # a valve that is open throughout lays none in rapid moves, unless the job says that it does
    through = "M03\nG1 X10 F600\nG0 Y5\nG1 X0\nM05"
    assert lifted(through) == [down, "M03", "G1 X10 F600", up, "G0 Y5", down, "G1 X0", "M05", up]
    by_codes = lifted(through, dispense=Dispense("codes"))
    assert by_codes == [down, "M03", "G1 X10 F600", "G0 Y5", "G1 X0", "M05", up]
    assert lifted("G1 X10 F600\nG0 Y5\nG1 X0") == ["G1 X10 F600", up, "G0 Y5", down, "G1 X0"]


def test_an_interface_output_of_fanuc_switches_the_valve_as_an_m_code_does():
    text = (
        "M08\nG00 X5\n#1100=1\nG01 X20 F1200\n#1100=0\nG01 X30\n#1100=1\nG01 X40\nG00 X50\n#1100=0\nM09\nG01 X60\nM30"
    )
    program = fanuc_program(text)
    assert laid(program) == [[5, 20], [30, 40]]
    (note,) = [note for note in program.notes if "opens the valve" in note]
    assert note.startswith("#1100=1 opens the valve and #1100=0 closes it: glue is laid in moves at feed")
    assert 'M8 and M9 do not switch it; to let them, --set \'program.dispense={on = ["M8"], off = ["M9"]}\'.' in note
    assert laid(fanuc_program(text, dispense=Dispense(on=("M8",), off=("M9",)))) == [[5, 40]]
    assert laid(fanuc_program(text, dispense=Dispense(by="feed"))) == [[5, 40], [50, 60]]
    # beside an M code that switches more often, no key of the job names it
    other = fanuc_program("#1101=1\nM8\nG01 X20 F1200\nM9\nG01 X30\nM8\nG01 X40\nM9\nM30")
    assert laid(other) == [[0, 20], [30, 40]]
    assert any(note.endswith("#1101=1 does not switch it.") for note in other.notes)


@pytest.mark.parametrize("program", DIALECTS)
def test_a_dot_is_laid_though_the_needle_is_lifted_before_the_valve_closes(program):
    """Only a dwell before the needle goes down is one in the air."""
    text = "G21 G90\nG0 X10 Y0 Z10 F6000\nG1 Z0 F600\nS1000 M3\nG4 P{}\nG1 Z10\nM5\nG0 X50 F6000\nM30"
    setpoints = program(text.format("200" if program in (fanuc_program, printer_program) else "0.2")).setpoints(PERIOD)
    assert setpoints.dispense.sum() * PERIOD == pytest.approx(0.2, abs=3 * PERIOD)
    assert np.ptp(setpoints.position[setpoints.dispense, 2]) < 0.01


def test_a_pin_of_printers_firmware_switches_the_valve():
    """As M42 drives the solenoid of a dispenser; the way back at feed is dry."""
    text = "G1 X10 F1200\nM42 P4 S255\nG1 X40\nM42 P4 S0\nG1 X0\nM42 P2 S1"
    program = slicer.Program(text=text).program
    assert program.glue[program.moves[:, KIND] == LINE].tolist() == [False, True, False]
    assert "M42 P4 S255 opens the valve and M42 P4 S0 closes it" in program.valve.note


@pytest.mark.parametrize("named", ["M03", "m3", "M3"])
@pytest.mark.parametrize("program", [linuxcnc_program, fanuc_program])
def test_a_code_that_switches_the_valve_is_no_word_without_an_effect(program, named):
    """However the job writes it."""
    text = "G1 X1 F60\nM3\nG1 X5\nM5\nG1 X9"
    notes = program(text, dispense=Dispense(on=(named,), off=("M05",))).notes
    assert not any("without an effect" in note for note in notes)
    notes = program(text, dispense=Dispense(on=("M8",), off=("M9",))).notes
    assert any(note == "Words without an effect on the path: M3 (1), M5 (1)." for note in notes)


@pytest.mark.parametrize(
    ("text", "dispense", "reason"),
    [
        ("G0 X20\nG0 Y20", {}, "the program has no moves at feed but those straight up or down"),
        ("G0 X20\nM5", {}, "the program has no moves at feed but those straight up or down"),
        (
            "M3\nG0 X20\nM5\nG1 X40 F600",
            {},
            "M3 opens the valve in no move at feed but those straight up or down, and in no dwell at the work",
        ),
        (
            "G1 X20 F600\nM3\nM5",
            {},
            "M3 opens the valve in no move at feed but those straight up or down, and in no dwell at the work",
        ),
        ("G1 X20 F600\nM3\nM5\nM2", {"by": "codes"}, "M3 opens the valve in no move and no dwell"),
        ("M3\nG1 X20 F600\nM5", {"on": ["M8"]}, "no code of the program opens the valve (program.dispense)"),
    ],
)
@pytest.mark.parametrize("program", [linuxcnc_program, fanuc_program])
def test_why_a_program_lays_no_glue(program, text, dispense, reason):
    dry = program(text, dispense=Dispense(**{key: tuple(v) if key == "on" else v for key, v in dispense.items()}))
    assert not dry.setpoints(PERIOD).dispense.any()
    assert dry.dryness == reason
