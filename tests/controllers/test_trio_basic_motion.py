"""Motion of Trio BASIC programs against closed forms and independent sums over the ticks."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.base.errors import InputError
from gantrysim.controllers.placement import Placement
from gantrysim.controllers.trio import Basic, InterpreterTime
from gantrysim.controllers.trio.basic import interpreter
from gantrysim.controllers.trio.basic.moves import Arc
from gantrysim.controllers.trio.basic.profile import Speed

from support.soaked import examples

POSITION = 1e-9  # of positions [mm]
NO_TIME = InterpreterTime(0, 0, 0, 0)
DT = 0.001


def basic(text, **changed):
    return Basic(**{"text": text, "interpreter_time": NO_TIME, "initial_acceleration": math.inf, **changed})


def moved(text, **changed):
    return basic(text, **changed).setpoints(DT).position


def trapezium(t, length, v, up, down):
    """Distance at times of a motion from rest to rest."""
    top = min(v, math.sqrt(2 * length * up * down / (up + down)))
    rise, fall = top / up, top / down
    cruise = (length - 0.5 * top * (rise + fall)) / top
    t = np.clip(t, 0, rise + cruise + fall)
    back = rise + cruise + fall - t
    return np.where(
        t < rise, 0.5 * up * t**2, np.where(back < fall, length - 0.5 * down * back**2, top * (t - 0.5 * rise))
    )


@given(
    st.floats(0.1, 50), st.floats(-50, 50), st.floats(20, 300), st.floats(100, 5000), st.floats(100, 5000),
    st.sampled_from([0.0005, 0.001, 0.002]),
)  # fmt: skip
@examples(30)
def test_move_is_a_trapezium_along_a_line(x, y, v, up, down, period):
    made = basic(f"BASE(0,1)\nSPEED={v:.17g}: ACCEL={up:.17g}: DECEL={down:.17g}\nMOVE({x:.17g},{y:.17g})\nWAIT IDLE")
    found = made.setpoints(period)
    length = math.hypot(x, y)
    s = trapezium(found.time, length, v, up, down)
    assert found.position == pytest.approx(s[:, None] * [x / length, y / length], abs=POSITION)
    assert found.position[-1] == pytest.approx([x, y], abs=POSITION)
    assert found.requested.length == pytest.approx(length)


@given(st.floats(0.5, 30), st.floats(20, 200), st.floats(200, 5000), st.booleans())
@examples(30)
def test_without_a_limit_of_accel_a_move_begins_at_the_speed_from_which_it_can_stop(length, v, down, merged):
    """v jumps to SPEED, or to sqrt(2 d l) on a way too short for that; then it falls at DECEL to rest."""
    parts = f"MERGE=ON: MOVE({0.4 * length:.17g}): MOVE({0.6 * length:.17g})" if merged else f"MOVE({length:.17g})"
    position = moved(f"SPEED={v:.17g}: DECEL={down:.17g}: {parts}: WAIT IDLE")[:, 0]
    top = min(v, math.sqrt(2 * down * length))
    cruise = (length - 0.5 * top**2 / down) / top
    t = np.arange(len(position)) * DT
    braked = np.clip(t - cruise, 0, top / down)
    expected = top * np.minimum(t, cruise) + top * braked - 0.5 * down * braked**2
    assert position == pytest.approx(expected, abs=1e-8)
    assert len(position) - 1 == pytest.approx((cruise + top / down) / DT, abs=2)


def test_speed_changes_in_motion_take_effect_at_the_next_tick():
    position = moved("SPEED=100: ACCEL=1000: DECEL=500: FORWARD: WA(300): SPEED=50: WA(300): CANCEL: WAIT IDLE")[:, 0]
    t = np.arange(len(position)) * DT
    up, cruise = 0.5 * 1000 * 0.1**2, 100 * 0.2
    law = np.select(
        [t <= 0.1, t <= 0.3, t <= 0.4, t <= 0.6],
        [500 * t**2, up + 100 * (t - 0.1), up + cruise + 100 * (t - 0.3) - 250 * (t - 0.3) ** 2, 32.5 + 50 * (t - 0.4)],
        42.5 + 50 * np.minimum(t - 0.6, 0.1) - 250 * np.minimum(t - 0.6, 0.1) ** 2,
    )
    assert position == pytest.approx(law, abs=POSITION)
    assert t[-1] == pytest.approx(0.7)


def test_moves_merge_without_a_stop_and_else_come_to_rest():
    moves = "MOVE(10): MOVE(20): MOVE(-5): WAIT IDLE"
    for merge, stops in (("OFF", [10, 30, 25]), ("ON", [25])):
        position = moved(f"MERGE={merge}: SPEED=100: ACCEL=2000: DECEL=2000: {moves}", buffers=4)[:, 0]
        still = position[1:][np.abs(np.diff(position)) < 1e-12]
        assert position[-1] == pytest.approx(25, abs=POSITION)
        assert max(np.abs(np.diff(np.diff(position))).max(), 0.002) == pytest.approx(0.002 if merge == "OFF" else 0.2)
        assert np.max(np.diff(position)) == pytest.approx(0.1)
        assert len(still) <= 2 * len(stops)
    # merged, only the last move's end is a stop: the way of 35 mm in one trapezium
    position = moved(f"MERGE=ON: SPEED=100: ACCEL=2000: DECEL=2000: {moves}", buffers=4)[:, 0]
    t = np.arange(len(position)) * DT
    s = trapezium(t, 35, 100, 2000, 2000)
    assert position == pytest.approx(np.where(s <= 30, s, 60 - s), abs=POSITION)


@pytest.mark.parametrize(
    "moves", ["MOVE(10): MOVE(20): MOVE(-1)", "MOVEABS(10): MOVEABS(30): MOVEABS(29)"], ids=["MOVE", "MOVEABS"]
)
def test_braking_begins_before_the_last_of_merged_moves_where_that_is_short(moves):
    position = moved(f"MERGE=ON: SPEED=100: ACCEL=2000: DECEL=2000: {moves}: WAIT IDLE", buffers=4)[:, 0]
    s = trapezium(np.arange(len(position)) * DT, 31, 100, 2000, 2000)  # whose last 2.5 mm are braked
    assert position == pytest.approx(np.where(s <= 30, s, 60 - s), abs=POSITION)


def test_a_full_buffer_holds_the_program():
    second = "MOVE(10)\nPRINT NTYPE[0]\nMOVE(10)\nPRINT MTYPE[0];NTYPE[0]"
    text = f"SPEED=100\nMOVE(10)\nPRINT NTYPE[0]\n{second}\nWAIT IDLE\nPRINT MTYPE[0]"
    log = basic(text).printed
    assert [line.text for line in log] == ["0", "1", "11", "0"]
    assert [line.time for line in log] == pytest.approx([0, 0, 0.1, 0.3])
    assert [line.time for line in basic(text, buffers=2).printed] == pytest.approx([0, 0, 0, 0.3])


@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(0.3, 6.0), st.booleans(), st.floats(-20, 20), st.booleans())
@examples(25)
def test_arcs_and_helices(cx, cy, angle, clockwise, rise, flat):
    radius = math.hypot(cx, cy)
    if radius < 1:
        return
    turn = -angle if clockwise else angle
    centre = complex(cx, cy)
    end = centre - centre * complex(math.cos(turn), math.sin(turn))
    arguments = f"{end.real:.17g},{end.imag:.17g},{cx:.17g},{cy:.17g},{int(clockwise)},{rise:.17g},{int(flat)}"
    made = basic(f"BASE(0,1,2): SPEED=50: MHELICAL({arguments}): WAIT IDLE", axis_numbers=(0, 1, 2))
    setpoints = made.setpoints(DT)
    length = radius * angle if flat else math.hypot(radius * angle, rise)
    share = np.minimum(setpoints.time * 50 / length, 1)
    place = centre * (1 - np.exp(1j * turn * share))
    assert setpoints.position == pytest.approx(np.column_stack([place.real, place.imag, rise * share]), abs=1e-8)
    assert setpoints.requested.length == pytest.approx(math.hypot(radius * angle, rise), rel=1e-9)
    assert setpoints.requested.project(setpoints.position).distance.max() < 1e-7


@given(
    st.floats(5, 50), st.floats(-math.pi, math.pi), st.floats(0.1, 2 * math.pi - 0.1), st.booleans(),
    st.sampled_from([1, 2, 3, 4, 5]),
)  # fmt: skip
@examples(60)
def test_an_arc_with_a_rounded_end_ends_on_its_circle(radius, begin, swept, clockwise, digits):
    """The stated end gives the angle alone: p = c + R e / |e|, with e from the centre to the stated end."""
    sense = -1 if clockwise else 1
    centre = -radius * np.exp(1j * begin)
    stated = centre + radius * np.exp(1j * (begin + sense * swept))
    cx, cy, ex, ey = (round(float(value), digits) for value in (centre.real, centre.imag, stated.real, stated.imag))
    made = basic(
        f"SPEED=50: ACCEL=1000: DECEL=1000: MERGE=ON\nMOVECIRC({ex:.5f},{ey:.5f},{cx:.5f},{cy:.5f},{int(clockwise)})\n"
        "MOVE(3,-4)\nWAIT IDLE"
    )
    centre = complex(cx, cy)
    arm = complex(ex, ey) - centre
    end = centre + abs(centre) * arm / abs(arm)
    angle = sense * float(np.angle(arm / -centre)) % (2 * math.pi)
    found = made.setpoints(DT)
    assert found.position[-1] == pytest.approx([end.real + 3, end.imag - 4], abs=POSITION)
    assert found.requested.length == pytest.approx(abs(centre) * angle + 5, abs=1e-7)
    assert found.requested.position(found.requested.length - 5)[0, :2] == pytest.approx([end.real, end.imag], abs=1e-7)
    # no step at the end of the arc
    assert np.abs(np.diff(found.position, axis=0)).max() <= 50 * DT * (1 + 1e-6)


def test_a_stated_end_off_the_circle_is_noted_with_its_distance():
    made = basic("MOVE(1,0)\nMOVECIRC(10.5,10,0,10,0)\nMOVECIRC(10.001,10,0,10,0)\nWAIT IDLE")
    off = [note for note in made.notes if "off its circle" in note]
    assert off == [
        "line 2: the arc's stated end lies 0.5 mm off its circle (1 such arcs): as on the controller, the stated end "
        "gives the angle alone, and the arc ends on the circle"
    ]
    assert made.setpoints(DT).position[-1] == pytest.approx([21, 20], abs=2e-9)


def test_absolute_moves_and_defpos():
    text = "BASE(0,1): SPEED=100\nMOVEABS(20,5): WAIT IDLE\nDEFPOS(0,0): MOVEABS(1,1): WAIT IDLE\n"
    text += "PRINT DPOS[1];DPOS AXIS(1)[1]"
    made = basic(text, start=(3.0, 4.0))
    assert made.setpoints(DT).position[0] == pytest.approx([3, 4])
    assert made.setpoints(DT).position[-1] == pytest.approx([21, 6], abs=POSITION)
    assert made.printed[0].text == "1.01.0"
    assert made.requested.length == pytest.approx(math.hypot(17, 1) + math.sqrt(2))


@pytest.mark.parametrize("bits", [0, 16])
def test_connect_follows_in_the_same_tick_with_its_ratio(bits):
    text = "BASE(5): SPEED=80: ACCEL=700: BASE(0): CONNECT(1/3,5): MOVE(50) AXIS(5)"
    text += ": WA(300): CONNECT(-2,5): WAIT IDLE AXIS(5)"
    position = moved(text, ratio_bits=bits)[:, 0]
    driver = moved("BASE(5): SPEED=80: ACCEL=700: MOVE(50): WAIT IDLE", axis_numbers=(5, 6))[:, 0]
    ratio = 1 / 3 if not bits else round(2**16 / 3) / 2**16
    steps = np.diff(driver)
    expected = np.cumsum(np.where(np.arange(steps.size) < 300, ratio, -2) * steps)
    assert position[1 : 1 + expected.size] == pytest.approx(expected, abs=POSITION)


def test_a_buffered_link_begins_at_the_tick_after_the_move_before_it():
    """The move ends at 10.5 ms; the link axis moves 0.1 mm per tick, of which the 89 after 11 ms count."""
    text = "SPEED=100: SPEED AXIS(5)=100: MOVE(10) AXIS(5): MOVE(1.05): CONNECT(1,5): WAIT IDLE AXIS(5)"
    position = moved(text)[:, 0]
    assert position[11] == pytest.approx(1.05, abs=POSITION)
    assert position[-1] == pytest.approx(1.05 + 8.9, abs=POSITION)


def test_connect_counts_edges():
    text = "UNITS=100: UNITS AXIS(5)=1000: CONNECT(0.5,5): SPEED AXIS(5)=100: MOVE(2) AXIS(5): WAIT IDLE AXIS(5)"
    assert moved(text)[-1, 0] == pytest.approx(2 * 1000 * 0.5 / 100, abs=POSITION)


def test_addax_adds_the_motion_of_another_axis_until_it_ends():
    text = "ADDAX(3): SPEED=10: SPEED AXIS(3)=30: MOVE(5): MOVE(9) AXIS(3): WA(100): ADDAX(-1): WAIT IDLE AXIS(3)"
    position = moved(text)[:, 0]
    assert position[100] == pytest.approx(1 + 3, abs=POSITION)
    assert position[-1] == pytest.approx(5 + 3, abs=POSITION)


def test_cam_runs_through_its_table_at_speed():
    text = "FOR k=0 TO 20: TABLE(100+k, 4*k*(20-k)): NEXT k: SPEED=40: CAM(100,120,0.01,20): WAIT IDLE"
    position = moved(text)[:, 0]
    at = np.minimum(np.arange(len(position)) * DT * 40 / 20, 1) * 20
    corners = 0.04 * np.arange(21) * (20 - np.arange(21))
    assert position == pytest.approx(np.interp(at, np.arange(21), corners), abs=POSITION)


def test_movelink_is_a_trapezium_over_the_link_axis():
    text = "SPEED AXIS(4)=100: MOVELINK(30,40,10,5,4): MOVELINK(-30,20,0,0,4): MOVE(80) AXIS(4): WAIT IDLE AXIS(4)"
    position = moved(text)[:, 0]
    link = np.minimum(np.arange(len(position)) * DT * 100, 80)
    rate = 30 / (40 - 7.5)
    speed = np.interp(link, [0, 10, 35, 40], [0, rate, rate, 0])
    s = np.concatenate([[0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(link))])
    expected = np.where(link <= 40, s, 30 - 1.5 * np.clip(link - 40, 0, 20))
    assert position == pytest.approx(expected, abs=1e-8)


def test_cambox_repeats_from_a_position_of_the_link_axis():
    table = "TABLE(0,0,1,3,4): SPEED AXIS(4)=100: "
    text = table + "CAMBOX(0,3,2,15,4,6,7): MOVE(52) AXIS(4): WAIT IDLE AXIS(4): CANCEL: WAIT IDLE"
    position = moved(text)[:, 0]
    link = np.minimum(np.arange(len(position)) * DT * 100, 52) - 7
    rounds = np.floor(np.maximum(link, 0) / 15 + 1e-9)
    expected = 8 * rounds + np.interp(np.maximum(link, 0) - 15 * rounds, [0, 5, 10, 15], [0, 2, 6, 8])
    assert position == pytest.approx(expected, abs=POSITION)


@pytest.mark.parametrize("before", [-6.0, 2.0, 4.0])
def test_a_link_begins_at_a_position_in_the_link_axis_own_coordinates(before):
    """DEFPOS has set the link axis' zero to 30; from there to `before`, then 10 is still ahead of it."""
    head = f"SPEED AXIS(4)=100: MOVE(30) AXIS(4): WAIT IDLE AXIS(4): DEFPOS(0) AXIS(4): MOVE({before}) AXIS(4)"
    text = f"{head}: WAIT IDLE AXIS(4): MOVELINK(20,20,0,0,4,2,10): MOVE(50) AXIS(4): WAIT IDLE AXIS(4)"
    position = moved(text)[:, 0]
    since = np.arange(len(position)) * DT - (30 + abs(before)) / 100
    link = before + 100 * np.clip(since, 0, 0.5)
    assert position == pytest.approx(np.clip(link - 10, 0, 20), abs=1e-8)


def test_a_connect_that_waits_behind_a_link_begins_at_the_tick_after_its_end():
    """The link ends within a tick at 10 of 10.07; what the link axis moves after that tick counts by half."""
    text = "SPEED AXIS(4)=95: MOVELINK(10,10,0,0,4): CONNECT(0.5,4): MOVE(30) AXIS(4): WAIT IDLE AXIS(4)"
    position = moved(f"{text}: CANCEL: WAIT IDLE")[:, 0]
    link = np.minimum(np.arange(len(position)) * DT * 95, 30)
    begun = link[np.argmax(link >= 10)]
    assert position == pytest.approx(np.where(link < begun, link, 10 + 0.5 * (link - begun)), abs=1e-8)


def test_a_link_position_that_is_passed_is_refused_by_the_way_beyond_it():
    text = "MOVE(30) AXIS(4): WAIT IDLE AXIS(4): DEFPOS(14) AXIS(4): MOVELINK(20,20,0,0,4,2,10): WAIT IDLE"
    with pytest.raises(InputError, match="axis 4 is 4 past the link position: must be before it"):
        moved(text)


def test_a_link_can_follow_in_one_direction_alone():
    text = (
        "SPEED AXIS(4)=100: MOVELINK(30,30,0,0,4,32): MOVE(10) AXIS(4): MOVE(-20) AXIS(4): MOVE(40) AXIS(4): WAIT IDLE"
    )
    assert moved(text)[-1, 0] == pytest.approx(30, abs=POSITION)
    held = moved(text.replace("WAIT IDLE", "WA(290)"))[:, 0]
    assert held[100:301] == pytest.approx(np.full(201, 10), abs=POSITION)


def test_rapidstop_ends_links_at_once_and_slows_moves_down():
    text = "SPEED AXIS(3)=100: DECEL AXIS(3)=1000: CONNECT(1,3): FORWARD AXIS(3): WA(200)"
    text += ": RAPIDSTOP: WAIT IDLE AXIS(3): PRINT DPOS AXIS(3)[9]"
    made = basic(text)
    assert made.setpoints(DT).position[-1, 0] == pytest.approx(20, abs=POSITION)
    assert float(made.printed[0].text) == pytest.approx(25, abs=1e-8)


def test_rapidstop_leaves_the_buffered_move_of_a_group():
    """A move that ends at once, without DECEL, makes way for the buffered one, which its other axes do not cancel."""
    position = moved("BASE(0,1): SPEED=100: MOVE(30,40): MOVE(-3,-4): WA(50): RAPIDSTOP: WAIT IDLE")
    assert position[-1] == pytest.approx([3 - 3, 4 - 4], abs=POSITION)
    position = moved("BASE(0,1): SPEED=100: MOVE(30,40): MOVE(-3,-4): WA(50): RAPIDSTOP(2): WAIT IDLE")
    assert position[-1] == pytest.approx([3, 4], abs=POSITION)


def test_virtual_axes_need_no_drive():
    text = "WDOG=OFF: SPEED=100: MOVE(5) AXIS(3): WAIT IDLE AXIS(3): WDOG=ON: MOVE(1): WAIT IDLE"
    assert moved(text)[-1, 0] == pytest.approx(1, abs=POSITION)


def test_what_remains_of_a_move_and_where_it_ends():
    """Of a FORWARD, which has no end, nothing remains, and its end is where the axis is."""
    shown = 'PRINT REMAIN[4];" ";DPOS[4];" ";ENDMOVE[4]'
    moves = f"MOVE(3): WAIT IDLE: MOVE(10): WA(50): {shown}: WAIT IDLE"
    text = f"SPEED=100: {moves}: {shown}: FORWARD: WA(50): {shown}: CANCEL"
    moving, ended, endless = ([float(word) for word in line.text.split()] for line in basic(text).printed)
    remaining, position, end = moving
    assert 0 < remaining < 10
    assert (remaining + position, end) == pytest.approx((13, 13), abs=2e-4)
    assert ended == [0, 13, 13]
    assert endless[0] == 0
    assert endless[2] == endless[1] > 13


@pytest.mark.parametrize("move", ["SPEED=100: MOVE(60,80)", "SPEED=300: FORCE_SPEED=100: MOVESP(60,80)"])
def test_cancel_of_a_move_slows_down_along_its_line(move):
    position = moved(f"BASE(0,1): ACCEL=1000: DECEL=500: {move}: WA(500): CANCEL: WAIT IDLE")
    t = np.arange(len(position)) * DT
    braked = np.clip(t - 0.5, 0, 0.2)
    way = np.where(t < 0.1, 500 * t**2, 5 + 100 * (np.minimum(t, 0.5) - 0.1)) + 100 * braked - 250 * braked**2
    assert way[-1] == pytest.approx(55)
    assert np.hypot(*position.T) == pytest.approx(way, abs=0.11)  # a tick, at which CANCEL is met
    assert position[-1] == pytest.approx([0.6 * 55, 0.8 * 55], abs=0.11)


def test_cancel_of_the_buffer_leaves_the_executing_move():
    assert moved("SPEED=100: MOVE(10): MOVE(10): CANCEL(1): WAIT IDLE")[-1, 0] == pytest.approx(10, abs=POSITION)
    assert moved("SPEED=100: MOVE(10): MOVE(7): WA(50): CANCEL: WAIT IDLE")[-1, 0] == pytest.approx(12, abs=POSITION)
    assert moved("SPEED=100: MOVE(10): MOVE(7): WA(50): CANCEL(2): WAIT IDLE")[-1, 0] == pytest.approx(5, abs=POSITION)
    # a CONNECT has no speed to lose: the MOVE behind it is the executing one at once
    types = "PRINT MTYPE[0];NTYPE[0]"
    made = basic(f"CONNECT(1,2): MOVE(5): {types}: CANCEL: {types}: WAIT IDLE")
    assert [line.text for line in made.printed] == ["211", "10"]


def test_a_real_z_axis_is_told_from_a_virtual_one():
    assert basic("SPEED=100: MOVE(1): MOVE(2) AXIS(2)").axes == ("x", "y", "z")
    assert basic("SPEED=100: MOVE(1): ATYPE AXIS(2)=0: MOVE(2) AXIS(2)").axes == ("x", "y")
    assert basic("SPEED=100: CONNECT(1,2): MOVE(2) AXIS(2)").axes == ("x", "y")
    assert basic("SPEED=100: CONNECT(1,2): MOVE(2) AXIS(2)", axis_numbers=(0, 1, 2)).axes == ("x", "y", "z")


def test_the_valve_is_an_output_and_else_follows_the_motion():
    text = "SPEED=100: WA(20): OP(9,ON): MOVE(10): WAIT IDLE: OP(9,OFF): WA(30)"
    on = basic(text, valve=9).setpoints(DT).dispense
    assert np.flatnonzero(on).tolist() == list(range(20, 120))
    on = basic(text).setpoints(DT).dispense
    assert np.flatnonzero(on).tolist() == list(range(20, 121))


def test_lines_of_the_program_at_the_setpoints():
    made = basic("SPEED=100\nWA(20)\nMOVE(10)\nMOVE(5)\nWAIT IDLE\nWA(10)")
    assert [made.line_at(t) for t in (0.01, 0.05, 0.13, 0.175, 1.0, -1.0)] == [2, 3, 4, 6, None, None]
    assert len(made.lines) == len(made.setpoints(DT).position)


@given(st.floats(-180, 180), st.floats(-50, 50))
@examples(20)
def test_placement_turns_and_shifts_axes_and_requested_path(rotate, x):
    text = "BASE(0,1): SPEED=100: MOVE(10,5): MOVECIRC(0,8,0,4,0): WAIT IDLE"
    plain, placed = basic(text), basic(text, placement=Placement(x=x, y=2.0, rotate=rotate))
    here, there = plain.setpoints(DT), placed.setpoints(DT)
    turned = (here.position @ [1, 1j]) * np.exp(1j * math.radians(rotate)) + complex(x, 2)
    assert there.position @ [1, 1j] == pytest.approx(turned, abs=POSITION)
    assert there.requested.length == pytest.approx(here.requested.length)
    points = np.column_stack([there.position, np.zeros(len(turned))])
    assert there.requested.project(points).distance.max() < 1e-7


def test_scale_is_refused():
    with pytest.raises(InputError, match=r"^placement\.scale = 2: must be 1, a program computes its lengths itself$"):
        basic("MOVE(1)", placement=Placement(scale=2.0))


def test_the_trace_stands_for_a_path_that_is_not_stated():
    made = basic("BASE(0): CONNECT(1,4): BASE(1): CONNECT(1,5): BASE(4,5): SPEED=50: MOVECIRC(0,0,20,0,1): WAIT IDLE")
    setpoints = made.setpoints(DT)
    position = setpoints.position
    points = np.column_stack([position, np.zeros(len(position))])
    assert made.requested.follow(points, setpoints.progress).distance.max() <= 5.1e-4
    assert made.requested.length == pytest.approx(40 * math.pi, rel=1e-5)
    assert "the moves alone do not state the axes' path: the commanded trace is the requested path" in made.notes


@pytest.mark.parametrize(
    "text",
    [
        "MOVE(10): MOVE(10) AXIS(1): WAIT IDLE",  # at the same time
        "MOVE(10): WA(50): CANCEL: WAIT IDLE: MOVE(3,4): WAIT IDLE",  # not to its end
        "ADDAX(5): MOVE(10): WAIT IDLE",
        "TABLE(0,0,1): CAM(0,1,1,1): WAIT IDLE: MOVE(5): WAIT IDLE",
    ],
)
def test_motions_that_are_no_sequence_of_moves_state_no_path(text):
    made = basic("SPEED=100: BASE(0,1): " + text)
    assert any("commanded trace" in note for note in made.notes)
    position = made.setpoints(DT).position
    assert made.requested.project(np.column_stack([position, 0 * position[:, 0]])).distance.max() <= 5.1e-4


def test_speeds_change_in_the_text():
    made = basic('SPEED=100: PRINT "SPEED=7" \' SPEED=8\nSPEED AXIS(1) = 50\nVR(1)=VP_SPEED\nMOVE(1)')
    assert made.programmed_speed == 100
    text = made.arguments_at(50)["text"]
    assert text == 'SPEED=50: PRINT "SPEED=7" \' SPEED=8\nSPEED AXIS(1) =25\nVR(1)=VP_SPEED\nMOVE(1)'


OUTLINE = (
    "BASE(0,1): SPEED=90: ACCEL=800: DECEL=500: MERGE=ON: OP(8,ON)\nMOVE(20,3): MOVECIRC(5,5,0,5,0): MOVEABS(1,-9)\n"
)
SLOW = "BASE(0,1): SPEED=50"
OTHER = "'$PROGRAM OTHER\nBASE(2): SPEED=7: FORWARD: WA(333.5): CANCEL: WAIT IDLE: RAPIDSTOP(2): WA(50): MOVE(4)"


@pytest.mark.parametrize(
    ("text", "changed"),
    [
        (f"{OUTLINE}WAIT IDLE: WA(77): MOVE(-1,-2): WAIT LOADED: OP(8,OFF): MOVEABS(0,0): PRINT DPOS;MSPEED", {}),
        (f"{OUTLINE}MOVE(3,3): MOVE(9,2): WA(20): DECEL=3000: WAIT IDLE AXIS(1)", {"buffers": 8}),
        (f"{OUTLINE}WAIT UNTIL REMAIN<2: PRINT DPOS", {"initial_acceleration": 900.0}),
        (f'RUN "OTHER"\n{OUTLINE}WAIT IDLE: MOVE(5,5): WAIT IDLE\n{OTHER}', {"interpreter_time": InterpreterTime()}),
        ('RUN "OTHER": MOVE(5): WAIT IDLE: MOVE(1)\n\'$PROGRAM OTHER\nWA(100): RAPIDSTOP: WA(300)', {}),
        ("TABLE(0,0,1,4,9,2): SPEED=9: CAM(0,4,1,5): WAIT IDLE: CONNECT(2,4) AXIS(1): MOVE(3) AXIS(4): MOVE(2)", {}),
        (f"{SLOW}: MOVE(3,3): BASE(1): MOVE(4): BASE(0): MOVE(9): BASE(1,0): MOVE(1,2): WA(3000)", {}),
        (f"{SLOW}: MOVE(3,3): BASE(1,2): MOVE(4,4): BASE(2,0): MOVE(9,9): WA(3000)", {}),
    ],
    ids=[
        *("waits", "merged", "until a position", "two programs", "a move that another ends", "cam"),
        *("a move that waits for an axis", "moves that wait for one another's axes"),
    ],
)
def test_periods_passed_at_once_are_those_passed_one_by_one(text, changed, monkeypatch):
    at_once = basic(text, **changed).trace(DT)
    monkeypatch.setattr(interpreter, "_PASSED_PERIODS", 1)
    one_by_one = basic(text, **changed).trace(DT)
    for name in ("position", "outputs", "lines"):
        assert np.array_equal(getattr(at_once, name), getattr(one_by_one, name))
    assert at_once.state.printed == one_by_one.state.printed
    assert at_once.state.motion.axes[0].step == one_by_one.state.motion.axes[0].step


OUT_OF_REACH = 1e12  # stretch that no period reaches the end of [mm]


@given(
    value=st.floats(0.1, 300), target=st.sampled_from([0.0, 50.0, 300.0, None]), remaining=st.floats(1e-3, 500),
    down=st.sampled_from([100.0, 5000.0, math.inf]), period=st.sampled_from([1e-3, 0.03, 2e-12, 1e-12, 5e-13]),
)  # fmt: skip
@examples(100)
def test_a_period_is_the_same_with_an_end_that_it_does_not_reach(value, target, remaining, down, period):
    """Without that end a period at SPEED, far from where the axis brakes, is passed without a look at its phases.

    A period that is rounding, such as is left after a joint, moves nothing either way.
    """
    rates = (value if target is None else target, 800.0, down, period)
    ways = []
    for stretch in (math.inf, OUT_OF_REACH):
        speed = Speed(value)
        ways.append((*speed.advance_to(stretch, remaining, rates), speed.value, speed.braking))
    assert ways[0] == ways[1]
    assert period > 1e-12 or ways[0][:2] == (0.0, period)


@given(
    st.floats(0.1, 50), st.floats(-4, 4), st.floats(0.1, 6.2), st.booleans(), st.floats(-20, 20) | st.none(),
)  # fmt: skip
@examples(50)
def test_places_along_an_arc_are_the_same_one_by_one(radius, begin, angle, clockwise, rise):
    centre = (-radius * math.cos(begin), -radius * math.sin(begin))
    last = begin + (-angle if clockwise else angle)
    end = (centre[0] + radius * math.cos(last), centre[1] + radius * math.sin(last))
    arc = Arc(end, centre, clockwise, rise)
    s = np.linspace(0.0, 0.999, 40) * arc.length
    assert arc.displacements(s).T.tolist() == [list(arc.displacement(distance)) for distance in s.tolist()]


@pytest.mark.soak
def test_a_condition_that_cannot_come_about_is_refused_long_before_the_time_limit():
    text = "BASE(0)\nSPEED=10\nMOVE(2)\nWAIT UNTIL MPOS>{}\nMOVE(2)"
    said = r"^line 4: waits for 300 s while nothing moves: what it waits for must come about$"
    with pytest.raises(InputError, match=said):
        _ = basic(text.format(3)).setpoints(0.001)
    assert basic(text.format(1)).setpoints(0.001).position[-1, 0] == pytest.approx(4)


@pytest.mark.soak
def test_a_wait_for_another_process_or_the_clock_is_none_for_ever():
    setpoints = basic("SPEED=10\nMOVE(2)\nTICKS=200000\nWAIT UNTIL TICKS<0\nMOVE(2)").setpoints(0.001)
    assert len(setpoints.position) > 200_000


SQUARE = "BASE(0,1)\nSPEED=50\nACCEL=1000\nDECEL=1000\nMERGE=OFF\nOP(8,ON)\nMOVE(50,0)\nMOVE(0,20)\nMOVE(-50,0)\n"


@pytest.mark.parametrize(
    ("wait", "moves"),
    [("", "2 moves above it are"), ("WAIT LOADED", None), ("WAIT IDLE", None), ("WA(300)", None)],
)
def test_an_output_that_is_switched_right_after_buffered_moves_is_noted(wait, moves):
    """The last move waits in the buffer until the first has ended, so that the second and it are still to run."""
    program = Basic(f"{SQUARE}{wait}\nOP(8,OFF)\nWAIT IDLE")
    noted = [note for note in program.notes if note.startswith("OP(8) is switched")]
    line = SQUARE.count("\n") + 2
    assert noted == (
        [f"OP(8) is switched in line {line} while {moves} still to run: OP does not wait, WAIT IDLE does"]
        if moves
        else []
    )


def test_another_output_than_the_valve_may_be_switched_at_any_time():
    assert not any("is switched in line" in note for note in Basic(f"{SQUARE}OP(9,ON)\nWAIT IDLE\nOP(8,OFF)").notes)


def test_an_output_beside_a_motion_without_an_end_is_not_noted():
    text = (
        "BASE(0)\nSPEED=20\nACCEL=200\nDECEL=200\nOP(8,OFF)\nFORWARD\nOP(8,ON)\nWA(500)\nCANCEL\nWAIT IDLE\nOP(8,OFF)"
    )
    assert not any("is switched in line" in note for note in Basic(text).notes)
