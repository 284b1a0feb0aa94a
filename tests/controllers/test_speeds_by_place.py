"""Programs whose stretches have speeds of their own: words F, Vtran and SPEED over turns, written and read again."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gantrysim.base.errors import InputError
from gantrysim.controllers import fanuc, softmc, trio
from gantrysim.controllers.drawings.drawing import Drawing
from gantrysim.controllers.drawings.points import with_row_speeds
from gantrysim.controllers.gcode.linuxcnc import Program as LinuxCNC
from gantrysim.controllers.gcode.slicer import Program as Slicer
from gantrysim.controllers.speeds import with_feed_words, with_flow_words
from gantrysim.job.job import Job

from support.soaked import suite_runs

PERIOD = 0.001  # [s]
SEMICOLON = r"\([^)]*\)|;.*"


@pytest.mark.parametrize(
    ("text", "feeds", "written"),
    [
        # modal: one word serves the lines after it
        ("G1 X1 F600\nG1 X2\nG1 X3", {1: 600.0, 2: 300.0, 3: 300.0}, "G1 X1 F600\nG1 X2 F300\nG1 X3"),
        # a line that is not listed keeps its word, which then is in force
        ("F900\nG1 X1\nG0 X5 F3000\nG1 X2", {2: 900.0, 4: 900.0}, "F900\nG1 X1\nG0 X5 F3000\nG1 X2 F900"),
        # comments and layout stay
        ("G1 X1 (F600) \nG1X2F600 ; F1", {1: 60.5, 2: 30.0}, "G1 X1 F60.5 (F600) \nG1X2F30 ; F1"),
        # expressions are replaced by numbers
        ("G1 X1 F[#1*60]\nG1 X2 F#<feed>", {1: 100.0, 2: 200.0}, "G1 X1 F100\nG1 X2 F200"),
        # after the end of a loop the feed is stated again
        (
            "o1 while [#1 LT 3]\nG1 X#1\no1 endwhile\nG1 X9",
            {2: 500.0, 4: 500.0},
            "o1 while [#1 LT 3]\nG1 X#1 F500\no1 endwhile\nG1 X9 F500",
        ),
        # a program that jumps states it in every line
        ("N1 G1 X1\nN2 G1 X2\nGOTO 1", {1: 500.0, 2: 500.0}, "N1 G1 X1 F500\nN2 G1 X2 F500\nGOTO 1"),
    ],
)
def test_words_f_are_as_few_as_set_the_feeds(text, feeds, written):
    assert with_feed_words(text, feeds, SEMICOLON) == written


def stated(controller):
    stretches = controller.stretches(PERIOD)
    return dict(zip(stretches.places.tolist(), stretches.speeds.tolist(), strict=True))


def with_speeds(controller, speeds):
    return replace(controller, **controller.with_stretch_speeds(speeds))


def cruise(controller, place):
    """The commanded speed on most of a stretch [mm/s]."""
    setpoints = controller.setpoints(PERIOD)
    stretches = controller.stretches(PERIOD)
    steps = np.diff(setpoints.progress) / PERIOD
    return np.median(steps[stretches.places[stretches.at(setpoints.progress[:-1])] == place])


SQUARE = "{}G1 X40 F3000\nG1 Y40 (side)\nG1 X0 F1200\nG1 Y0\n"


@pytest.mark.parametrize(("units", "scale"), [("G21\n", 1.0), ("G20\n", 25.4)])
@pytest.mark.parametrize("override", [1.0, 0.5])
def test_g_code_runs_each_line_at_its_own_speed(units, scale, override):
    text = SQUARE.format(units)
    program = LinuxCNC(text=text, feed_override=override, acceleration=20000.0, rapid=60000.0 * scale)
    own = stated(program)
    assert own == pytest.approx(
        {2: 50 * scale * override, 3: 50 * scale * override} | dict.fromkeys((4, 5), 20 * scale * override)
    )
    wanted = {2: 30.0, 3: 62.5, 4: 62.5, 5: 8.0}
    changed = with_speeds(program, wanted)
    assert stated(changed) == pytest.approx(wanted, rel=1e-7)
    assert changed.requested.length == pytest.approx(160 * scale)
    for line, speed in wanted.items():
        assert cruise(changed, line) == pytest.approx(speed, rel=1e-3)


def test_a_line_that_runs_twice_has_the_slowest_of_its_speeds():
    text = "#1=0\no1 while [#1 LT 2]\n#1=[#1+1]\nG1 X[40*#1] F[600*#1]\no1 endwhile\nM2"
    program = LinuxCNC(text=text, acceleration=20000.0)
    assert stated(program)[4] == 10.0
    assert stated(with_speeds(program, {4: 35.0}))[4] == pytest.approx(35.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("G93\nG1 X10 F6\nG1 X20 F6", r"has G93, in which F is no path speed"),
        ("G20 G1 X1 F60\nG21 G1 X1 F600", r"has G20 and G21, so that a word F has no one unit"),
    ],
)
def test_g_code_whose_f_is_no_one_speed_is_refused(text, message):
    with pytest.raises(InputError, match=message):
        LinuxCNC(text=text).stretches(PERIOD)


def test_fanuc_runs_each_block_at_its_own_speed():
    text = "O1\nG21 G90\nG01 X40 F3000\nY40 (side)\nG00 X0\nG01 Y0\nM30"
    program = fanuc.Program(text, acceleration=20000.0)
    assert stated(program) == {3: 50.0, 4: 50.0, 5: 0.0, 6: 50.0}
    wanted = {3: 12.5, 4: 40.0, 6: 40.0}
    changed = with_speeds(program, wanted)
    assert changed.program == "O1\nG21 G90\nG01 X40 F750\nY40 F2400 (side)\nG00 X0\nG01 Y0\nM30"
    for line, speed in wanted.items():
        assert cruise(changed, line) == pytest.approx(speed, rel=1e-3)


@pytest.mark.parametrize("is_text", [True, False])
def test_softmc_writes_vtran_only_where_the_speed_is_not_the_group_s(is_text):
    text = "Move G1 {40, 0} Vtran=20 ' first\nCircle G1 Angle=90 CircleCenter={40, 10}\nMove G1 {50, 50}"
    commands = (
        softmc.Move(target=(40, 0), velocity=20.0),
        softmc.Circle(angle=90, centre=(40, 10)),
        softmc.Move(target=(50, 50)),
    )
    group = softmc.Group(velocity=80.0, acceleration=20000.0)
    program = softmc.Program(text if is_text else commands, group)
    assert stated(program) == {1: 20.0, 2: 80.0, 3: 80.0}
    arguments = program.with_stretch_speeds({1: 80.0, 2: 12.5, 3: 80.0})
    assert set(arguments) == {"program"}
    if is_text:
        assert arguments["program"] == (
            "Move G1 {40, 0} ' first\nCircle G1 Angle=90 CircleCenter={40, 10} Vtran=12.5\nMove G1 {50, 50}"
        )
        changed = softmc.Program(arguments["program"], group)
        assert stated(changed) == {1: 80.0, 2: 12.5, 3: 80.0}
        assert cruise(changed, 2) == pytest.approx(12.5, rel=1e-3)
    else:
        assert [command.get("velocity") for command in arguments["program"]] == [None, 12.5, None]


SPIRAL = {"diameter": 60.0, "turns": 2, "thickness": 8.0, "speed": 40.0, "loop_period": 0.004, "servo_period": 0.001}


def test_a_spiral_with_one_speed_in_its_table_is_the_spiral_without():
    plain = trio.MoveSpiral(**SPIRAL, acceleration=2000.0)
    tabled = trio.MoveSpiral(**SPIRAL, acceleration=2000.0, speeds=((0.5, 40.0), (2.0, 40.0)))
    expected = plain.setpoints(PERIOD).position
    assert tabled.setpoints(PERIOD).position == pytest.approx(expected, abs=1e-9)
    assert plain.with_stretch_speeds(dict.fromkeys(range(1, 34), 40.0)) == {"speed": 40.0, "speeds": []}


def test_the_speed_along_a_spiral_is_linear_between_the_places_of_its_table():
    spiral = trio.MoveSpiral(**SPIRAL, speeds=((1.0, 80.0), (1.5, 80.0), (2.0, 20.0)))
    setpoints = spiral.setpoints(PERIOD)
    speed = np.diff(setpoints.progress) / PERIOD
    # turns so far, from the length of an involute: s = R phi - a phi² / 2
    radius, a = 30.0, 8.0 / (2 * math.pi)
    turns = (radius - np.sqrt(radius**2 - 2 * a * setpoints.progress[:-1])) / a / (2 * math.pi)
    expected = np.interp(turns, [0.0, 1.0, 1.5, 2.0], [40.0, 80.0, 80.0, 20.0])
    # within a pass of the loop, 4 ms, it changes by up to 0.5 mm/s
    assert speed[5:-20] == pytest.approx(expected[5:-20], abs=0.7)


@pytest.mark.parametrize("waits", suite_runs([0.0, 0.001], 1))
@pytest.mark.parametrize("height", [0.0, 5.0])
def test_the_listing_moves_the_axes_as_the_spiral_does(waits, height):
    spiral = trio.MoveSpiral(
        **{**SPIRAL, "loop_period": 0.02},
        acceleration=1500.0,
        ratio_bits=16,
        wait_resolution=waits,
        speeds=((0.25, 70.0), (1.75, 70.0), (2.0, 30.0)),
        height=height,
        clockwise=height == 0,
    )
    program = trio.Basic(
        spiral.program_text,
        ratio_bits=16,
        wait_resolution=waits,
        interpreter_time=trio.InterpreterTime(0.0, 0.0, 0.0, 0.0),
    )
    closed = spiral.setpoints(PERIOD).position
    interpreted = program.trace(PERIOD).position[:, : closed.shape[1]]
    ticks = len(closed) - 1
    assert len(interpreted) >= ticks
    assert interpreted[:ticks] == pytest.approx(closed[:ticks], abs=1e-9)
    assert interpreted[-1] == pytest.approx(closed[-1], abs=1e-9)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"speeds": ((1.0, 50.0), (1.0, 60.0))}, r"speeds 2, turns = 1: must be above 1 and at most turns, 2"),
        ({"speeds": ((0.0, 50.0),)}, r"speeds 1, turns = 0: must be above 0"),
        ({"speeds": ((2.5, 50.0),)}, r"at most turns, 2"),
        ({"speeds": ((1.0, 0.0),)}, r"speeds 1 = 0 mm/s"),
        ({"speeds": (50.0,)}, r"must be two numbers, turns and a speed"),
        ({"speeds": ((1.0, 50.0),), "loop_period": 0.0, "servo_period": 0.0}, r"speeds of 1 places: must be none"),
        ({"speeds": ((1.0, 50.0),), "as_published": True}, r"must be none with as_published"),
    ],
)
def test_bad_tables_of_a_spiral_are_refused(changed, message):
    with pytest.raises(InputError, match=message):
        trio.MoveSpiral(**{**SPIRAL, **changed})


def test_the_speeds_of_a_spiral_scale_with_its_speed():
    job = Job.load("an225").changed({"program.speeds": [[2.0, 150.0]]})
    assert job.controller.programmed_speed == 150.0
    slower = job.changed({f"program.{key}": value for key, value in job.controller.arguments_at(75.0).items()})
    assert (slower.controller.speed, slower.controller.speeds) == (50.0, ((2.0, 75.0),))


@pytest.mark.parametrize("name", ["stage-outline", "svg-gasket"])
def test_a_program_without_speeds_by_place_says_so(name):
    controller = Job.load(name).controller
    with pytest.raises(InputError, match="states one speed for its whole path, so that none can be set by place"):
        controller.stretches(PERIOD)
    with pytest.raises(InputError, match="states one speed for its whole path"):
        controller.with_stretch_speeds({1: 10.0})


def test_trio_basic_runs_each_move_at_its_own_speed_and_brakes_before_a_slower_one():
    text = (
        "BASE(0,1): ACCEL=5000: DECEL=5000: SPEED=80: MERGE=ON\n"
        "MOVE(60,0) ' MOVE(1,1)\n"
        "MOVECIRC(0,20,0,10,0): MOVE(-60,0)\n"
        "MOVEABS(0,0)\n"
    )
    program = trio.Basic(text)
    assert {line: speed for line, speed in stated(program).items() if speed} == pytest.approx(
        dict.fromkeys((2, 3, 4), 80.0), rel=0.02
    )
    wanted = {2: 60.0, 3: 25.0, 4: 90.0}
    changed = with_speeds(program, wanted)
    assert changed.text == (
        "BASE(0,1): ACCEL=5000: DECEL=5000: SPEED=80: MERGE=ON\n"
        "FORCE_SPEED=60: STARTMOVE_SPEED=60: MOVESP(60,0) ' MOVE(1,1)\n"
        "FORCE_SPEED=25: STARTMOVE_SPEED=25: MOVECIRCSP(0,20,0,10,0): MOVESP(-60,0)\n"
        "FORCE_SPEED=90: STARTMOVE_SPEED=90: MOVEABSSP(0,0)\n"
    )
    assert {line: speed for line, speed in stated(changed).items() if speed} == pytest.approx(wanted)
    assert changed.requested.length == pytest.approx(program.requested.length)
    for line, speed in wanted.items():
        assert cruise(changed, line) == pytest.approx(speed, rel=1e-3)
    setpoints = changed.setpoints(PERIOD)
    speed = np.diff(setpoints.progress) / PERIOD
    # on the arc, from 60 to 91 mm of the path
    on_arc = (setpoints.progress[:-1] > 60.1) & (setpoints.progress[:-1] < 91.0)
    # within what DECEL takes off in a tick
    assert speed[on_arc].max() < 25.0 + 5.0


def test_trio_basic_with_linked_axes_has_no_speed_by_place():
    spiral = trio.MoveSpiral(**SPIRAL)
    with pytest.raises(InputError, match="linked to others"):
        trio.Basic(spiral.program_text).stretches(PERIOD)


@pytest.mark.parametrize(
    ("text", "values", "output", "written"),
    [
        # modal as F; a word in force serves
        (
            "M67 E0 Q2\nG1 X1\nG1 X2\nG1 X3",
            {2: 2.0, 3: 3.5, 4: 3.5},
            "M67 E0",
            "M67 E0 Q2\nG1 X1\nG1 X2 M67 E0 Q3.5\nG1 X3",
        ),
        # another output stays, and so do comments
        (
            "M67 E1 Q9\nG1 X1 m67e0q[#1] (Q3)\nM68 E0 Q7\nG1 X2 ; S",
            {2: 4.0, 4: 7.0},
            "M67 E0",
            "M67 E1 Q9\nG1 X1 M67 E0 Q4 (Q3)\nM68 E0 Q7\nG1 X2 ; S",
        ),
        ("M3 S100\nG1 X1\nG1 X2 S50", {2: 120.0, 3: 120.0}, "S", "M3 S100\nG1 X1 S120\nG1 X2 S120"),
    ],
)
def test_words_of_the_flow_are_as_few_as_set_it(text, values, output, written):
    assert with_flow_words(text, values, SEMICOLON, output) == written


@pytest.mark.parametrize(
    "program",
    [
        LinuxCNC(text="M67 E0 Q2\nM3 S1\nG1 X40 F3000\nG1 Y40\nM67 E1 Q3\nG2 X0 R40\nM5", flow_output="M67 E0"),
        LinuxCNC(text="M3 S2\nG1 X40 F3000\nM5\nG1 Y40\nM3\nG2 X0 R40\nM5", flow_output="S"),
        fanuc.Program("M3 S2\nG1 X40 F3000\nG1 Y40 S3\nM5\nM3\nG2 X0 Y40 R30\nM5", flow_output="S"),
    ],
)
def test_each_line_lays_the_flow_that_is_written_for_it(program):
    places = [place for place, speed in stated(program).items() if speed > 0]
    assert len(places) == 3
    wanted = dict(zip(places, (1.25, 3.0, 70.5), strict=True))
    changed = replace(program, **program.with_stretch_flows(wanted))
    points = changed.setpoints(PERIOD)
    lines = changed.lines_at(points.time)
    for place, value in wanted.items():
        values = points.analogue[lines == place][1:-1]
        assert values.size > 100
        assert set(values.tolist()) == {value}
    np.testing.assert_array_equal(points.position, program.setpoints(PERIOD).position)


@pytest.mark.parametrize(
    "controller",
    [
        LinuxCNC(text="G1 X9 F600"),
        Slicer(text="M106 S9\nG1 X9 F600", flow_output="M106"),
        fanuc.Program("#1132=1\nG1 X9 F600", flow_output="#1132"),
        trio.Basic(text="AOUT(0)=1\nSPEED=10\nMOVE(9)\nWAIT IDLE", flow_output="AOUT(0)"),
    ],
)
def test_a_program_without_such_words_refuses_flows_by_line(controller):
    with pytest.raises(InputError, match="has no output for the flow whose value each stretch can have"):
        controller.with_stretch_flows({1: 2.0})


TABLE = "x,y,glue,speed\n0,0\n60,0,1,40\n60,30,1,40\n\n0,30\n0,60,0,\n30,60,1,40\n"


@pytest.mark.parametrize(
    ("text", "wanted", "written"),
    [
        (TABLE, {3: 25.0, 4: 40.0, 8: 62.5}, TABLE.replace("60,0,1,40", "60,0,1,25").replace("60,1,40", "60,1,62.5")),
        # without heads: z and glue as they are read
        ("0 0\n60 0\n60 30\n", {2: 25.0, 3: 40.0}, "0 0\n60 0 0 1 25\n60 30\n"),
        # a column is added; a decimal comma stays
        ("x;y\n0;0\n60;0,0\n60;30,5\n", {3: 62.5, 4: 40.0}, "x;y;speed\n0;0\n60;0,0;62,5\n60;30,5\n"),
    ],
)
def test_a_table_of_points_has_a_speed_in_each_row(text, wanted, written):
    program = Drawing(text=text, speed=40.0, velocity=(1000.0,) * 3, acceleration=(20000.0,) * 3, corner_tolerance=0.5)
    own = stated(program)
    assert {line: own[line] for line in wanted} == dict.fromkeys(wanted, 40.0)
    changed = with_speeds(program, own | wanted)
    assert changed.text.splitlines() == written.splitlines()
    assert {line: stated(changed)[line] for line in wanted} == wanted
    assert changed.requested.length == pytest.approx(program.requested.length)
    for line, speed in wanted.items():
        assert cruise(changed, line) == pytest.approx(speed, rel=1e-3)
        points = changed.setpoints(PERIOD)
        steps = np.hypot(*np.diff(points.position[:, :2], axis=0).T) / PERIOD
        assert np.median(steps[changed.lines_at(points.time)[:-1] == line]) == pytest.approx(speed, rel=1e-3)


def test_a_drawing_that_is_no_table_says_so():
    square = '<svg xmlns="http://www.w3.org/2000/svg" width="9mm" viewBox="0 0 9 9"><path d="M0 0H9V9"/></svg>'
    with pytest.raises(InputError, match="states one speed for its whole path"):
        Drawing(text=square).stretches(PERIOD)
    with pytest.raises(InputError, match="has no column speed, and no line of heads"):
        with_row_speeds("# x y\n0 0\n9 0\n", {3: 5.0})
