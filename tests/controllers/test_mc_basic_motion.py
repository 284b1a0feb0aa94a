"""What an MC-Basic program commands: paths, speeds, times, outputs and records."""

import csv
import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import Servo, simulate
from gantrysim.base.errors import InputError
from gantrysim.controllers.placement import Placement
from gantrysim.controllers.softmc import Basic, Group, Program
from gantrysim.controllers.softmc.basic.recording import rows_of
from gantrysim.controllers.softmc.stream import Leg, Rest

from support.runs import PERIOD
from support.soaked import examples

# Eight half circles about two centres in turn, each 5 mm higher, from (25, 0, 0).
BOWL = """
common shared bowl as group Axnm = a1 Axnm = a2 Axnm = a3
dim shared middle[8] as joint of XYZ
program
  dim k as long
  with bowl
  prftype = 0
  acc = 30000
  dec = acc
  call Fill
  move {25, 0, 0}
  for k = 1 to 8
    circle angle = 180 circlecenter = middle[k] + {0, 0, 5*k} vtran = 500
    while ismoving
      sleep 1
    end while
    print pcmd
  next
end program
sub Fill
  dim k as long
  for k = 1 to 8
    middle[k] = {0, 0, 0}
    if k mod 2 = 0 then middle[k] = {12.5, 0, 0}
  next
end sub
"""


def legs(basic):
    return [step for step in basic.task.time.steps if isinstance(step, Leg) and step.path.piece is not None]


def rests(basic):
    return [step.duration for step in basic.task.time.steps if isinstance(step, Rest)]


def half(leg):
    """The point at half of a leg's length, from its setpoints."""
    times = np.linspace(0, leg.duration, 20_001)
    s = leg.profile.position(times)
    place, _ = leg.coordinates(np.array([np.interp(leg.profile.length / 2, s, times)]))
    return place[0, :3]


def test_a_bowl_of_half_circles_is_that_of_the_table():
    basic = Basic(BOWL)
    assert len(legs(basic)) == 8
    side, x = 1, 25.0
    for k, leg in enumerate(legs(basic), 1):
        centre = 0.0 if k % 2 else 12.5
        radius = abs(x - centre)
        assert radius == 12.5 * (k + 1)
        np.testing.assert_allclose(leg.start, (x, 0, 5 * (k - 1), 0), atol=1e-9)
        np.testing.assert_allclose(half(leg), (centre, side * radius, 5 * k - 2.5), atol=2e-3)
        x = 2 * centre - x
        np.testing.assert_allclose(leg.path.end, (x, 0, 5 * k, 0), atol=1e-9)
        assert basic.printed[k - 1] == f"{{{x:g} , 0 , {5 * k}}}"
        side = -side
    assert basic.requested.length == pytest.approx(1728.458, abs=5e-4)
    assert sum(leg.duration for leg in legs(basic)) == pytest.approx(3.590, abs=5e-4)
    # a trapezoid of V and A over the length L takes L/V + V/A
    lengths = [math.hypot(math.pi * 12.5 * (k + 1), 5) for k in range(1, 9)]
    expected = [length / 500 + 500 / 30000 for length in lengths]
    np.testing.assert_allclose([leg.duration for leg in legs(basic)], expected, rtol=1e-9)


@pytest.mark.parametrize("profile", [0, 1, 2, 3, -1])
def test_commands_in_a_row_are_those_of_the_old_reader(profile):
    lines = f"""
Move G1 {{10, 0, 0}} VCruise=50 PrfType={profile}
Circle G1 Angle=90 CircleCenter={{0, 0, 3}} Vtran=80 Acc=2000 Dec=1000 PrfType={profile} Jerk=50000
Circle G1 CirclePoint={{-10, 0, 5}} TargetPoint={{0, -10, 2}} Vtran=30
Circle G1 Angle=-400 CircleCenter={{3, 4, 5}} CirclePlane=2 Dispense=0
Move G1 {{1, 2, 3}} Abs=0
"""
    group = Group(velocity=120, jerk=2e4)
    start = (1.0, 2.0, 3.0)
    new = Basic(lines, group=group, start=start, line_time=0.0)
    old = Program(lines, group=group, start=start)
    ours, theirs = new.setpoints(PERIOD), old.setpoints(PERIOD)
    np.testing.assert_array_equal(ours.position, theirs.position)
    np.testing.assert_array_equal(ours.dispense, theirs.dispense)
    assert ours.supervision == theirs.supervision
    assert new.requested.parameters() == old.requested.parameters()


def test_a_circle_through_points_of_a_robot_with_four_coordinates():
    text = "attach ROBOT\nROBOT.en = 1\nmove ROBOT #{80, 0, 300, 0}\n" \
        "circle ROBOT circlepoint = #{0, 80, 300, 0} targetpoint = #{-80, 0, 300, 90}\ndetach ROBOT"  # fmt: skip
    basic = Basic(text, coordinates=("left", "right", "back", "turn"))
    assert basic.axes == ("left", "right", "back", "turn")
    position = basic.setpoints(PERIOD).position
    np.testing.assert_allclose(np.hypot(*position[:, :2].T), 80, atol=1e-9)
    assert set(position[:, 2]) == {300.0}
    np.testing.assert_allclose(position[-1], (-80, 0, 300, 90), atol=1e-9)
    angle = np.degrees(np.arctan2(position[1:-1, 1], position[1:-1, 0]))
    np.testing.assert_allclose(position[1:-1, 3], angle / 2, atol=1e-9)
    assert basic.notes[0].startswith("starts at the target of its first MOVE")
    assert basic.requested.length == pytest.approx(80 * math.pi)
    placed = Basic(text, start=(0, 0, 250, 0))
    assert placed.setpoints(PERIOD).position[0].tolist() == [0, 0, 250, 0]
    assert placed.notes == ()


@pytest.mark.parametrize(
    ("command", "start", "radius", "centre", "end", "angle"),
    [
        ("circlepoint = {0, 100} targetpoint = {-100, 0}", (100, 0), 100, (0, 0), (-100, 0), 180),
        ("angle = 90 circlecenter = {20, 10}", (0, 0), math.sqrt(500), (20, 10), (30, -10), 90),
        ("angle = -450 circlecenter = {20, 10}", (0, 0), math.sqrt(500), (20, 10), (10, 30), -450),
    ],
)
def test_a_circle_by_points_or_by_angle(command, start, radius, centre, end, angle):
    position = Basic(f"circle {command}", start=start).setpoints(PERIOD).position
    out = position - centre
    np.testing.assert_allclose(np.hypot(*out.T), radius, rtol=1e-9)
    np.testing.assert_allclose(position[-1], end, atol=1e-9)
    turned = np.unwrap(np.arctan2(out[:, 1], out[:, 0]))
    assert math.degrees(turned[-1] - turned[0]) == pytest.approx(angle)


def test_a_program_of_two_coordinates_moves_two_axes():
    assert Basic("move {0, 0}\nmove {5, 0}").axes == ("x", "y")
    assert Basic("move {0, 0, 0}\nmove {5, 0}").axes == ("x", "y", "z")


def test_factors_convert_units():
    # speeds in mm/min: 1/60000 mm/ms each; accelerations in m/s²
    text = "vfac = 1/1000/60\nafac = 1/1e3\nacc = 1\ndec = 1\nvcruise = 6000\nmove {0, 0}\nmove {50, 0}"
    (leg,) = legs(Basic(text))
    assert leg.duration == pytest.approx(50 / 100 + 100 / 1000)


def test_maxima_cap_silently_and_overrides_multiply():
    def peak(text, **arguments):
        return legs(Basic(f"prftype = 3\n{text}\nmove {{0, 0}}\nmove {{50, 0}}", **arguments))[0].profile.speed

    assert peak("vcruise = 500\nvmax = 120") == 120
    assert peak("vcruise = 100\nvord = 50") == 50
    assert peak("vcruise = 100\nvord = 50\nsys.vord = 50", override=200) == 50
    capped = legs(Basic("acc = 5000\namax = 2000\ndec = 400\ndmax = 300\nmove {0, 0}\nmove {50, 0}"))[0]
    assert (capped.profile.acceleration, capped.profile.deceleration) == (2000, 300)
    gentle = legs(Basic("prftype = 2\njerk = 5000\njmax = 2000\nmove {0, 0}\nmove {50, 0}"))[0]
    assert gentle.profile.shape.jerk == pytest.approx(2000)


def test_properties_hold_from_their_line_on_and_nodal_ones_for_their_command():
    text = "prftype = 3\nmove {0, 0}\nvcruise = 10\nmove {1, 0}\nmove {2, 0} vcruise = 40\nmove {3, 0}\n" \
        "vcruise = 20\nmove {4, 0}\nvtran = 30\ncircle angle = 360 circlecenter = {0, 0}\n" \
        "circle angle = 360 circlecenter = {0, 0} vcruise = 15\nmove {0, 0}"  # fmt: skip
    assert [leg.profile.speed for leg in legs(Basic(text))] == [10, 40, 10, 20, 30, 15, 20]


def test_incremental_coordinates_begin_where_the_group_is():
    basic = Basic("abs = 0\nmove {1, 2}\nmove {3, 4}\nabs = 1\nmove {0, 0}", start=(10, 10))
    ends = [leg.path.end[:2].tolist() for leg in legs(basic)]
    assert ends == [[11, 12], [14, 16], [0, 0]]
    for text in ("abs = 0\nmove {3, 4}\nmove {1, 0}", "circle angle = 90 circlecenter = {3, 4}"):
        basic = Basic(text)
        assert basic.setpoints(PERIOD).position[0].tolist() == [0, 0]
        assert basic.notes == ("starts at the origin; `start` places it elsewhere",)


# Time


def test_sleep_delay_and_polling_let_time_pass():
    move = 0.1 + 100 / 3000  # of 10 mm at 100 mm/s and 3000 mm/s²
    still = "move {0, 0}\nmove {10, 0}\n"
    for between, expected in [
        ("sleep 50\n", 0.0),  # while the group moves
        ("sleep 500\n", pytest.approx(0.5 - move)),
        ("delay 200\n", pytest.approx(0.2)),
        ("while ismoving\nsleep 1\nend while\nsleep 20\n", pytest.approx(0.02, abs=1.1e-3)),
    ]:
        basic = Basic(f"{still}{between}move {{20, 0}}", line_time=0.0)
        assert sum(rests(basic)) == expected
        assert basic.duration == pytest.approx(2 * move + sum(rests(basic)))


def test_statements_take_their_time():
    basic = Basic("move {0, 0}\n" + "a1.fmode = 0\n" * 100 + "print sys.clock\nmove {1, 0}", line_time=1e-3)
    assert basic.printed == ("102",)
    assert sum(rests(basic)) == pytest.approx(0.103)


def test_the_program_waits_to_issue_the_motion_after_the_next():
    text = "move {0, 0}\nmove {10, 0}\nprint sys.clock\nmove {20, 0}\nprint sys.clock\nmove {30, 0}\nprint sys.clock"
    first, second, third = map(float, Basic(text, line_time=0.0).printed)
    assert (first, second) == (0, 0)
    assert third == pytest.approx(1e3 * (0.1 + 100 / 3000))


def test_the_commanded_position_is_read_while_moving():
    text = "prftype = 3\nmove {0, 0}\ncircle angle = 180 circlecenter = {10, 0} vtran = 31.4159265358979\n" \
        "sleep 500\nprint pcmd, ismoving, setpoint{2}\nsleep 501\nprint pcmd, ismoving"  # fmt: skip
    basic = Basic(text, line_time=0.0, placement=Placement(x=50, rotate=30))
    assert basic.printed == ("{10 , -10} 1 -10", "{20 , 0} 0")


def test_the_line_of_a_time():
    basic = Basic("move {0, 0}\nmove {10, 0}\n\ndelay 100\nmove {20, 0}", line_time=0.0)
    move = math.ceil(1e3 * (0.1 + 100 / 3000)) * 1e-3
    assert [basic.line_at(t) for t in (0.05, move + 0.05, move + 0.15, 5.0)] == [2, 5, 5, None]


# Dispensing, settling, speed


def test_an_output_dispenses():
    text = "move {0, 0}\nsys.dout.1 = on\nmove {10, 0}\nwhile ismoving\nsleep 10\nend while\n" \
        "sys.dout.1 = off\nsys.dout.2 = on\nmove {20, 0}"  # fmt: skip
    dispense = Basic(text, line_time=0.0).setpoints(PERIOD).dispense
    assert np.flatnonzero(np.diff(dispense.astype(int))).size == 1
    assert dispense[0]
    # the poll 140 ms after the start, 6.7 ms after the end of the motion, which is tick 134
    assert np.count_nonzero(dispense) == 141
    during = "move {0, 0}\nmove {10, 0}\nsleep 50\nsys.dout.1 = 1\nmove {20, 0}\nsleep 33.2\nsys.dout.1 = 0\n" \
        "sleep 100\nsys.dout.1 = 1\nsleep 10\nsys.dout.1 = 0"  # fmt: skip
    # the second switching on lies in the second motion, which begins at 133.3 ms, in tick 134
    np.testing.assert_array_equal(
        np.flatnonzero(Basic(during, line_time=0.0).setpoints(PERIOD).dispense), [*range(50, 84), *range(184, 194)]
    )
    other = Basic(text, output=2).setpoints(PERIOD).dispense
    assert not other[0]
    assert other[-1]
    assert Basic("move {0, 0}\nmove {10, 0}\nmove {20, 0} dispense = 0").setpoints(
        PERIOD
    ).dispense.mean() == pytest.approx(0.5, abs=0.01)


def test_a_start_in_position_waits_for_settling():
    def gates(text, **arguments):
        basic = Basic(f"PositionErrorSettle = 0.1\n{text}", line_time=0.0, **arguments)
        return basic.setpoints(PERIOD).gates.tolist()

    assert gates("move {0, 0}\nmove {10, 0}\nmove {20, 0}") == []
    assert gates("move {0, 0}\nmove {10, 0}\nmove {20, 0} starttype = inposition") == [134]
    assert gates("move {0, 0}\nmove {10, 0}\nwhile not issettled\nsleep 1\nend while\nmove {20, 0}") == [134]


def test_without_a_settle_error_nothing_waits_for_it():
    """Every position counts as settled at once, so a program that asks passes on without a gate."""
    text = "move {0, 0}\nmove {10, 0}\nwhile not issettled\nsleep 1\nend while\nmove {20, 0} starttype = inposition"
    assert Basic(text).setpoints(PERIOD).gates.size == 0
    assert Basic(f"pesettle = 0.1\n{text}").setpoints(PERIOD).gates.size > 0


def test_the_dispenser_stays_as_it_is_while_the_axes_settle():
    text = "pesettle = 0.1\nmove {0, 0}\nmove {10, 0}\nmove {20, 0} starttype = inposition dispense = 0"
    dispense = Basic(text, line_time=0.0).setpoints(PERIOD).dispense
    assert np.flatnonzero(dispense).tolist() == list(range(135))  # up to the gate


def test_the_supervision_is_that_of_the_group():
    text = "PEMax = 2\nPositionErrorDelay = 3\nPESettle = 0.5\nTimeSettle = 20\nVelocitySafetyLimit = 700\n"
    found = Basic(text + "move {0, 0}\nmove {1, 0}").setpoints(PERIOD).supervision
    assert (found.position_error, found.position_error_delay, found.settle_error) == (2, 3, 0.5)
    assert (found.settle_time, found.velocity_limit) == (0.02, 700)


def test_the_speed_changes_by_the_override():
    text = "prftype = 3\nmove {0, 0}\nvcruise = 10\nmove {10, 0}\nmove {20, 0} vcruise = 40"
    basic = Basic(text)
    assert basic.programmed_speed == 40
    faster = Basic(text, **basic.arguments_at(80.0))
    assert [leg.profile.speed for leg in legs(faster)] == [20, 80]


@examples(25)
@given(
    x=st.floats(-50, 50),
    y=st.floats(-50, 50),
    turn=st.floats(-360, 360),
    scale=st.floats(0.2, 5),
    plane=st.integers(0, 2),
    z_down=st.booleans(),
)
def test_a_placement_moves_every_setpoint(x, y, turn, scale, plane, z_down):
    text = "move {5, 1, 2}\nmove {7, 3, 1}\n" \
        f"circle angle = 200 circlecenter = {{1, 2, 3}} circleplane = {plane}\n" \
        "circle circlepoint = {0, 9, 4} targetpoint = {4, 2, 8}"  # fmt: skip
    placement = Placement(x, y, turn, scale, z_down=z_down)
    plain, placed = Basic(text), Basic(text, placement=placement)
    for ours, theirs in zip(legs(placed), legs(plain), strict=True):
        np.testing.assert_allclose(ours.path.end[:3], placement.point(theirs.path.end[:3]), atol=1e-9)
    s = np.linspace(0, 1, 50)
    np.testing.assert_allclose(
        placed.requested.position(s * placed.requested.length),
        placement.point(plain.requested.position(s * plain.requested.length)),
        atol=1e-7,
    )
    assert placed.setpoints(PERIOD).position[-1] == pytest.approx(placement.point(legs(plain)[-1].path.end[:3]))


def test_a_placement_turns_the_orientation():
    placed = Basic("move {0, 0, 0, 10}\nmove {10, 0, 0, 100}", placement=Placement(rotate=30.0)).setpoints(PERIOD)
    np.testing.assert_allclose(placed.position[[0, -1], 3], (40, 130))
    np.testing.assert_allclose(placed.position[-1, :2], (10 * math.cos(math.pi / 6), 5), atol=1e-12)


# Records


RECORDING = """
PositionErrorSettle = 0.05
TimeSettle = 5
move {0, 0}
record first.rec 100000 gap = 3 recdata = pcmd{1}, pfb, setpoint{2}, sys.clock
move {10, 0} vcruise = 50
delay 40
recordon
move {10, 8} starttype = inposition
move {0, 8} starttype = inposition
delay 30
recordclose
record "second.rec" 7 recdata = a2.pcmd, vcmd{2}, pe{1}
recordon
move {0, 0}
delay 10
recordoff
delay 10
recordon
"""


@pytest.fixture(scope="module")
def recorded(xy, tmp_path_factory):
    basic = Basic(RECORDING)
    run = simulate(xy, Servo.derive(xy.axes, PERIOD), basic.setpoints(PERIOD))
    folder = tmp_path_factory.mktemp("record")
    assert run.fault is None
    assert basic.write_record(run, folder / "record.csv")
    files = {}
    for name in ("record.csv", "record-2.csv"):
        with (folder / name).open(encoding="utf-8") as stream:
            head, *rows = csv.reader(stream)
        files[name] = head, np.array(rows, float)
    return basic, run, files


def test_a_record_samples_the_run_between_its_statements(recorded):
    _, run, files = recorded
    head, rows = files["record.csv"]
    assert head == ["pcmd{1} [mm]", "pfb{1} [mm]", "pfb{2} [mm]", "setpoint{2} [mm]", "sys.clock [ms]"]
    clock = rows[:, 4]
    np.testing.assert_allclose(np.diff(clock), 3.0)
    at = np.round(clock * 1e-3 / PERIOD).astype(int)
    np.testing.assert_array_equal(rows[:, 0], run.commanded[at, 0])
    np.testing.assert_array_equal(rows[:, 1:3], run.encoder[at])
    np.testing.assert_array_equal(rows[:, 3], run.commanded_tip[at, 1])
    # it begins at rest at (10, 0), before the first wait for settling, and ends 30 ms after the rest at (0, 8)
    moving = np.flatnonzero(np.any(np.diff(run.commanded, axis=0) != 0, axis=1))
    third = int(np.flatnonzero(run.commanded[:, 1] == 8)[0])
    end = int(np.flatnonzero((run.commanded[:, 0] == 0) & (np.arange(len(run.time)) > third))[0])
    first = int(np.flatnonzero(run.commanded[:, 0] == 10)[0])
    assert first + 38 <= at[0] <= first + 43
    assert end + 26 <= at[-1] <= end + 33
    assert moving[0] < at[0]


def test_a_record_ends_at_its_number_of_points(recorded):
    _, _, files = recorded
    head, rows = files["record-2.csv"]
    assert head == ["a2.pcmd [mm]", "vcmd{2} [mm/s]", "pe{1} [mm]"]
    assert len(rows) == 7
    assert rows[0, 0] == 8
    assert np.all(np.diff(rows[:, 0]) <= 0)
    np.testing.assert_allclose(rows[1:, 1], np.diff(rows[:, 0]) / PERIOD, atol=1e-9)


def test_gates_shift_the_record_by_the_wait(recorded):
    basic, run, files = recorded
    gates = basic.setpoints(PERIOD).gates
    assert len(gates) == 2
    assert len(run.time) > len(basic.setpoints(PERIOD).position)
    clock = files["record.csv"][1][:, 4]
    ticks = 1 + round(clock[-1] - clock[0])
    assert ticks > 2 * 5  # it holds both waits of at least 5 ms


def test_a_record_holds_both_its_ends(tmp_path):
    text = "move {0, 0}\nmove {10, 0}\ndelay 20\nrecord a.rec 100 recdata = sys.clock, setpoint\nrecordon\nsleep 10\n" \
        "recordoff\nsleep 5\nrecordon\nsleep 2\nrecordclose"  # fmt: skip
    basic = Basic(text, line_time=0.0)
    setpoints = basic.setpoints(PERIOD)
    position = setpoints.position
    tip = np.pad(position, ((0, 0), (0, 1)))
    time = setpoints.time
    run = SimpleNamespace(
        axes=("x", "y"),
        units=("mm", "mm"),
        period=PERIOD,
        time=time,
        commanded=position,
        encoder=position,
        commanded_tip=tip,
    )
    assert basic.write_record(run, tmp_path / "a.csv")
    head, *rows = (tmp_path / "a.csv").read_text(encoding="utf-8").splitlines()
    assert head == "sys.clock [ms],setpoint{1} [mm],setpoint{2} [mm]"
    # the motion of 133.3 ms ends in tick 134
    assert [float(row.split(",")[0]) for row in rows] == [*range(154, 165), *range(169, 172)]
    assert {row.split(",", 1)[1] for row in rows} == {"10.0,0.0"}


def test_no_record_is_written_where_none_is_kept(recorded, tmp_path):
    _, run, _ = recorded
    assert not Basic("move {0, 0}\nmove {1, 0}").write_record(run, tmp_path / "none.csv")
    assert not (tmp_path / "none.csv").exists()
    with pytest.raises(InputError, match=r"^line 2: a record is open: must be closed by RECORDCLOSE$"):
        Basic("record a.rec 5 recdata = pcmd\nrecord b.rec 5 recdata = pcmd")


@pytest.mark.parametrize(
    ("declared", "first"), [("", "a1"), ("common shared bench as group Axnm = a2 Axnm = a1\n", "a2")]
)
def test_joints_are_the_axes_of_the_group_in_its_order(declared, first):
    """Without declared axes j1 and j2 are a1 and a2; a group that names its axes orders them."""
    wait = "while ismoving <> 0\nsleep 1\nend while\n"
    text = f"{declared}move {{0, 0}}\nmove {{10, 20}}\n{wait}print j1.pcmd; j2.pcmd; {first}.pcmd\nj1.vmax = 7\n"
    assert list(Basic(f"{text}print {first}.vmax").printed) == ["10 20 10", "7"]


@pytest.mark.parametrize(("axes", "beyond"), [("Axnm = a1 Axnm = a2", "j3"), ("Axnm = a1 Axnm = a2 Axnm = a3", "j4")])
def test_a_joint_beyond_those_of_the_group_is_none(axes, beyond):
    text = f"common shared bench as group {axes}\nmove {{1, 2}}\n{beyond}.vmax = 4\n"
    with pytest.raises(InputError, match=f"{beyond}: must be an axis or a group; the group is bench"):
        _ = Basic(text, coordinates=("x", "y", "z")).printed


@pytest.mark.parametrize(
    ("run", "rows"),
    [
        ([0, 1, 2, 2, 3, 4], [0, 1, 2, 3, 4, 5]),
        # two more rows at the gate, where the command rests
        ([0, 1, 2, 2, 2, 2, 3, 4], [0, 1, 2, 3, 6, 7]),
        # a fault ends the run at the gate, which nothing is known to follow
        ([0, 1, 2, 2, 2], [0, 1, 2, 3, 4, 5]),
    ],
)
def test_a_setpoint_behind_a_gate_has_the_row_at_which_the_command_goes_on(run, rows):
    setpoints = SimpleNamespace(position=np.array([[0.0], [1], [2], [2], [3], [4]]), gates=np.array([3]))
    record = SimpleNamespace(commanded=np.array(run, float)[:, None], time=np.arange(len(run)))
    assert rows_of(record, setpoints).tolist() == rows


# An output that is switched while motions are still to run.

LINES = """vcruise = 40
acc = 800
dec = 800
move {0, 0}
sys.dout.1 = 1
move {50, 0}
circle angle = 180 circlecenter = {50, 10}
move {0, 20}
%s
sys.dout.1 = 0
move {0, 40}"""
WAIT = "while ismoving\nsleep 1\nend while"


def test_an_output_that_does_not_wait_for_the_motions_above_it_is_noted():
    """It closes when the line begins to wait, at the begin of the arc; each of v takes its length / v + v / a."""
    early = Basic(LINES % "")
    ahead = (math.pi * 10 / 40 + 40 / 800) + (50 / 40 + 40 / 800)
    note = (
        f"sys.dout.1 is switched in line 10, {ahead:.3g} s before the motions above it end: statements do not wait for "
        "motions, a loop on IsMoving does"
    )
    assert note in early.notes
    dry = np.count_nonzero(~early.setpoints(1e-3).dispense[:-1]) * 1e-3
    assert dry == pytest.approx(ahead + 20 / 40 + 40 / 800, abs=0.01)
    waiting = Basic(LINES % WAIT)
    assert not any("before the motions above it end" in note for note in waiting.notes)


def test_an_output_in_a_motion_that_the_program_watches_is_not_noted():
    """Time has passed since the motion was issued: it is switched there on purpose."""
    text = "vcruise = 40\nmove {0, 0}\nmove {50, 0}\nsleep 300\nsys.dout.1 = 1\nsleep 400\nsys.dout.1 = 0"
    assert not any("before the motions" in note for note in Basic(text).notes)
