"""The set point of a pump's flow by an output of Trio BASIC and of FANUC, as by M67 in G-code."""

import numpy as np
import pytest

from gantrysim import InputError
from gantrysim.controllers import fanuc
from gantrysim.controllers.gcode import linuxcnc, slicer
from gantrysim.controllers.trio.basic import Basic
from gantrysim.controllers.trio.basic.program import InterpreterTime
from gantrysim.controllers.valve import Dispense
from gantrysim.engine.simulate import perfect_follower
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.job.job import Job
from gantrysim.machine.machine import Machine

PERIOD = 1e-3
SPEED = 20.0

# two moves one after the other, an output before each
TRIO = """BASE(0,1)
SPEED=20
ACCEL=1000
DECEL=1000
{first}
OP(8,ON)
MOVE(20,0)
WAIT IDLE
{second}
MOVE(40,0)
WAIT IDLE
OP(8,OFF)
"""
FANUC = "G90 G21\n{first}\nG01 X20 F1200\n{second}\nG01 X60\nG00 X0\nM02\n"


def steady(points):
    """Set points on the first move and the second, away from their ends."""
    x = points.position[:, 0]
    on = points.dispense
    return points.analogue[on & (x > 2) & (x < 18)], points.analogue[on & (x > 22) & (x < 58)]


@pytest.mark.parametrize(
    ("word", "first", "second", "values"),
    [
        ("AOUT(0)", "AOUT(0)=2", "AOUT(0)=5", (2.0, 5.0)),
        ("AOUT(1)", "AOUT1=2", "AOUT1=AOUT(1)+3", (2.0, 5.0)),
        ("DAC AXIS(3)", "DAC AXIS(3)=2", "DAC AXIS(3)=5", (2.0, 5.0)),
        ("OP(9)", "OP(9,ON)", "OP(9,OFF)", (1.0, 0.0)),
        # bits 1 and 3 of outputs 16 to 19, then 0 and 2
        ("OP(16,19)", "OP(16,19,10)", "OP(16,19,5)", (10.0, 5.0)),
    ],
)
def test_an_output_of_trio_basic_is_the_set_point(word, first, second, values):
    program = Basic(text=TRIO.format(first=first, second=second), flow_output=word)
    points = program.setpoints(PERIOD)
    for found, value in zip(steady(points), values, strict=True):
        assert found.size > 500
        assert set(found.tolist()) == {value}
    assert Basic(text=program.text).setpoints(PERIOD).analogue is None
    notes = " ".join(program.notes)
    assert "DAC" not in notes
    assert "AOUT" not in notes


def test_the_set_point_of_trio_changes_at_the_statement_s_tick_of_the_program_s_loop():
    """20 mm at 20 mm/s, half of which is run in 10 mm / 20 mm/s and half the ramp of 20 ms."""
    text = "SPEED=20\nACCEL=1000\nDECEL=1000\nOP(8,ON)\nMOVE(20)\nWA(300)\nAOUT(0)=4\nWAIT IDLE\nOP(8,OFF)\n"
    times = InterpreterTime(statement=0.0, motion=0.0, wait=0.0)
    program = Basic(text=text, flow_output="AOUT(0)", interpreter_time=times)
    points = program.setpoints(PERIOD)
    changed = np.flatnonzero(np.diff(points.analogue))
    assert changed.tolist() == [299]
    assert points.analogue[300] == 4.0
    # the ramp costs half its time of 20 ms
    assert points.position[300, 0] == pytest.approx(SPEED * (0.3 - 0.01), abs=2 * SPEED * PERIOD)


@pytest.mark.parametrize(
    ("word", "first", "second", "values"),
    [
        ("S", "S2", "S5", (2.0, 5.0)),
        ("#1132", "#1132=2", "#1132=#1132+3", (2.0, 5.0)),
        ("#1133", "#1133=70000", "#1133=5", (70000.0, 5.0)),
        ("#1100", "#1100=1", "#1100=0", (1.0, 0.0)),
    ],
)
def test_an_output_of_fanuc_is_the_set_point_from_the_block_on_at_which_it_stands(word, first, second, values):
    text = FANUC.format(first=first, second=second)
    program = fanuc.Program(text, flow_output=word, dispense=Dispense(by="feed"))
    points = program.setpoints(PERIOD)
    for found, value in zip(steady(points), values, strict=True):
        assert found.size > 500
        assert set(found.tolist()) == {value}
    # at the point itself: at constant speed the second block begins after 1 s
    assert np.flatnonzero(np.diff(points.analogue))[-1] == pytest.approx(20 / SPEED / PERIOD, abs=1)
    assert fanuc.Program(program.program).setpoints(PERIOD).analogue is None


def test_the_moving_average_of_fanuc_delays_the_set_point_as_it_does_the_valve():
    text = "G90 G21\nS2 M08\nG01 X20 F1200\nS0 M09\nG01 X60\nM02\n"
    for blend in (0.0, 0.05, 0.051):
        points = fanuc.Program(text, flow_output="S", acceleration=2000.0, blend_time=blend).setpoints(PERIOD)
        on = points.dispense
        assert points.analogue.shape == on.shape
        assert set(points.analogue[on].tolist()) == {2.0}
        # both end at the same tick
        last = int(np.flatnonzero(on)[-1])
        assert points.analogue[last + 1] == 0.0


@pytest.mark.parametrize(
    ("program", "word"),
    [
        ({"controller": "trio.Basic", "text": TRIO.format(first="AOUT(0)=2", second="AOUT(0)=5")}, "AOUT(0)"),
        ({"controller": "fanuc.Program", "program": FANUC.format(first="S2", second="S5")}, "S"),
        (
            {"controller": "linuxcnc.Program", "text": "M67 E0 Q2\nG1 X20 F1200\nM67 E0 Q5\nG1 X60\n"},
            "M67 E0",
        ),
    ],
)
def test_every_dialect_lays_the_set_point_times_its_unit_and_the_note_names_the_output(program, word):
    """Two lines of 20 and 40 mm at 20 mm/s: 6 mm³/s in 1 s and 15 mm³/s in 2 s, and what the ramps take."""
    content = {"name": "j", "machine": "xy", "program": {**program, "flow_output": word}}
    job = Job.of_content({**content, "dispenser": {"per_output": 3.0}}, "job j")
    (note,) = [note for note in job.notes if "sets the flow" in note]
    assert note == f"{word} sets the flow: 3 mm³/s for each unit of its value, while glue is laid."
    run = job.follow()
    np.testing.assert_allclose(run.flow, 3.0 * run.analogue * run.dispense, rtol=1e-12)
    assert run.flow.sum() * run.period == pytest.approx(6.0 * 1.0 + 15.0 * 2.0, rel=0.03)
    without = Job.of_content({**content, "dispenser": {"flow": 3.0}}, "job j")
    assert any(note.startswith(f"{word} is flow_output, but without effect") for note in without.notes)


def test_a_driven_dispenser_and_the_bounds_of_the_key():
    text = TRIO.format(first="AOUT(0)=2", second="AOUT(0)=5")
    with pytest.raises(InputError, match="per_output multiplies the program's flow_output, which is not stated"):
        perfect_follower(Machine("xy"), Basic(text=text).setpoints(PERIOD), dispenser=Dispenser(per_output=3.0))
    # before anything is simulated
    with pytest.raises(InputError, match="per_output multiplies the program's flow_output, which is not stated"):
        Dispenser(per_output=3.0).check(Basic(text=text).setpoints(PERIOD))
    assert any("AOUT(0): set without effect" in note for note in Basic(text=text).notes)
    for word in ("AOUT", "M67 E0", "OP(5,2)", "OP(0,40)", "AOUT(64)", "AOUT(0,1)", "DAC AXIS(99)"):
        with pytest.raises(InputError, match="flow_output = "):
            Basic(text=text, flow_output=word)
    for word in ("#100", "#1116", "M67 E0"):
        with pytest.raises(InputError, match=r'flow_output = .*must be "S", or the variable of an output'):
            fanuc.Program(FANUC.format(first="S2", second="S5"), flow_output=word)


def test_outputs_of_trio_other_than_the_valve_are_named():
    text = "SPEED=20\nOP(12,ON)\nOP(5,ON)\nMOVE(20)\nWAIT IDLE\nOP(5,OFF)\n"
    assert any(
        note.endswith("down; OP(5), OP(12) are, and --set program.valve=5 makes one the valve")
        for note in Basic(text=text).notes
    )
    assert not any("never switched" in note for note in Basic(text=text, valve=5).notes)


def test_an_output_of_trio_that_is_not_the_one_of_the_flow_is_said_to_have_no_effect():
    text = TRIO.format(first="AOUT(0)=2", second="AOUT(1)=5")
    for flow, unused in (("AOUT(0)", "AOUT(1)"), ("AOUT(1)", "AOUT(0)"), ("", "AOUT(0), AOUT(1)")):
        notes = [note for note in Basic(text=text, flow_output=flow).notes if "set without effect" in note]
        assert [note.partition(": set without effect")[0] for note in notes] == [unused]
    both = Basic(text=text.replace("AOUT(1)", "AOUT(0)"), flow_output="AOUT(0)")
    assert not any("set without effect" in note for note in both.notes)


MOVES = "G90 G21\nG00 X0 Y0\n{first}\nG01 X20 F1200\n{second}\nG01 X60\n{last}\nG00 X0\nM02\n"


@pytest.mark.parametrize(
    ("controller", "first", "second", "last", "sentence"),
    [
        (linuxcnc.Program, "M3 S200", "S400.5", "M5", "S is 200 to 400.5, but sets no flow"),
        (linuxcnc.Program, "M67 E1 Q2.5", "", "M67 E1 Q0", "M67 E1 is 2.5, but sets no flow"),
        (linuxcnc.Program, "M62 P1\nM67 E0 Q2", "M68 E0 Q7", "M63 P1", "M67 E0 is 2 to 7, but sets no flow"),
        (slicer.Program, "M106 S80", "M106 S255", "M107", "M106 is 80 to 255, but sets no flow"),
        (fanuc.Program, "M03 S200", "S400", "M05", "S is 200 to 400, but sets no flow"),
        (fanuc.Program, "#1132=250", "", "#1132=0", "#1132 is 250, but sets no flow"),
        # one speed, and one of a spindle that is not the valve, tell nothing of the flow
        (linuxcnc.Program, "M3 S200", "", "M5", ""),
        (linuxcnc.Program, "M8 S200", "S400", "M9", ""),
        (fanuc.Program, "M03 S200", "", "M05", ""),
        (fanuc.Program, "M08 S200", "S400", "M09", ""),
        (fanuc.Program, "", "", "", ""),
    ],
)
def test_a_word_that_states_a_flow_and_sets_none_is_named(controller, first, second, last, sentence):
    text = MOVES.format(first=first, second=second, last=last)
    argument = "program" if controller is fanuc.Program else "text"
    program = controller(**{argument: text})
    found = [note for note in program.notes if "sets no flow" in note]
    assert [note.partition(";")[0] for note in found] == ([sentence] if sentence else [])
    if sentence:
        word = sentence.partition(" is ")[0]
        assert f"--set 'program.flow_output=\"{word}\"'" in found[0]
        obeyed = controller(**{argument: text}, flow_output=word)
        assert not [note for note in obeyed.notes if "sets no flow" in note]
        largest = max(float(number) for number in sentence.partition(" is ")[2].partition(",")[0].split(" to "))
        assert obeyed.setpoints(PERIOD).analogue.max() == largest


def test_a_fan_beside_material_states_no_flow():
    text = MOVES.format(first="M106 S80", second="M106 S255", last="M107").replace("X20 F", "X20 E1 F")
    assert not [note for note in slicer.Program(text=text).notes if "sets no flow" in note]
