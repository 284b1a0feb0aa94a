"""The interpreter and the closed form of the Move Spiral hold each other to a picometre or so, tick by tick."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from gantrysim.base.errors import InputError
from gantrysim.controllers.placement import Placement
from gantrysim.controllers.trio import Basic, InterpreterTime, MoveSpiral, StatedSpiral
from gantrysim.paths.spirals import Involute

from support.soaked import examples, suite_runs

POSITION = 1e-9  # [mm]
PAGE = (Path(__file__).parent.parent.parent / "docs" / "trio-basic.md").read_text(encoding="utf-8")
NOTE = {"diameter": 120.0, "turns": 4, "thickness": 10.0, "speed": 100.0, "loop_period": 0.1}

ALL_AT_ONCE = """
BASE(6,7): MERGE=ON: SPEED={speed}
CONNECT(1,6) AXIS(0): CONNECT(1,7) AXIS(1)
fall=2*{thickness}*{speed}*{loop_period}/(PI*{diameter}^2)
FOR n=1 TO {turns}
  MOVECIRC(0,0,{side}*{diameter}/2,0,{clockwise})
NEXT n
k=0
WHILE MTYPE<>0
  IF 1-(k+1)*fall>=1/65536 THEN k=k+1
  x=1-k*fall
  SPEED={speed}/x
  CONNECT(x,6) AXIS(0)
  CONNECT(x,7) AXIS(1)
  WA(1000*{loop_period}*x)
WEND
"""


def of_the_page():
    return re.search(r"```basic\n(.*?)```", PAGE, flags=re.DOTALL)[1]


def interpreted(text, spiral, **changed):
    """The program with the assumptions of a closed form."""
    arguments = {
        "text": text,
        "start": spiral.start,
        "initial_acceleration": spiral.acceleration,
        "ratio_bits": spiral.ratio_bits or 0,
        "wait_resolution": spiral.wait_resolution,
        "interpreter_time": InterpreterTime(0, 0, 0, spiral.interpreter_time),
        "time_limit": 100.0,
        "statement_limit": 500_000,
        "servo_period": spiral.servo_period,
    }
    return Basic(**{**arguments, **changed})


def check(program, spiral):
    closed = spiral.setpoints(spiral.servo_period).position
    found = program.trace(spiral.servo_period).position[:, : closed.shape[1]]
    n = len(closed) - 1
    assert len(found) >= n
    assert found[:n] == pytest.approx(closed[:n], abs=POSITION)
    assert found[n:] == pytest.approx(np.tile(closed[-1], (len(found) - n, 1)), abs=POSITION)


@st.composite
def jobs(draw):
    diameter = draw(st.floats(20, 60))
    turns = draw(st.integers(1, 4))
    speed = draw(st.floats(30, 200))
    servo_period = draw(st.sampled_from([0.0005, 0.001, 0.002]))
    period = max(math.pi * diameter * turns / speed / draw(st.floats(15, 200)), 4 * servo_period)
    return {
        "diameter": diameter,
        "turns": turns,
        "thickness": diameter * (1 - draw(st.floats(0.35, 0.95))) / (2 * turns),
        "speed": speed,
        "servo_period": servo_period,
        "loop_period": period,
        "interpreter_time": period * draw(st.sampled_from([0.0, 0.013, 0.1])),
        "start": draw(st.tuples(st.floats(-50, 50), st.floats(-50, 50))),
        "clockwise": draw(st.booleans()),
        "wait_resolution": draw(st.sampled_from([0.0, 0.001])) if period > 0.02 else 0.0,
        "ratio_bits": draw(st.sampled_from([None, 16])),
        "acceleration": draw(st.sampled_from([math.inf, speed / 0.01, speed / 0.1, speed / 0.3])),
    }


@given(jobs())
@examples(30)
def test_random_spirals_agree_with_the_closed_form(job):
    try:
        spiral = MoveSpiral(**job)
    except InputError:
        assume(False)
    # a pass without a wait takes a servo period in the closed form, and no time here
    assume(spiral.ratios[-1] * spiral.loop_period >= max(spiral.wait_resolution, 1e-4))
    exact = {name: f"{job[name]:.17g}" for name in ("diameter", "thickness", "speed", "loop_period")}
    signs = {"turns": job["turns"], "side": 1 if job["clockwise"] else -1, "clockwise": int(job["clockwise"])}
    check(interpreted(ALL_AT_ONCE.format(**exact, **signs), spiral, buffers=4), spiral)


@pytest.mark.parametrize(
    "limits",
    suite_runs(
        [
            {},
            {"ratio_bits": 16, "wait_resolution": 0.001, "acceleration": 1000.0},
            {"acceleration": 300.0, "servo_period": 0.002},
            {"interpreter_time": 0.005, "servo_period": 0.0005},
        ],
        0,
        2,
    ),
    ids=str,
)
def test_the_page_s_program_buffers_a_circle_at_a_time_and_agrees(limits):
    spiral = MoveSpiral(**{**NOTE, "servo_period": 0.001, **limits})
    check(interpreted(of_the_page(), spiral), spiral)


@pytest.mark.parametrize("changed", suite_runs([{"mode": 0}, {"mode": 1}], 0))
def test_a_third_virtual_axis_climbs(changed):
    mode = changed["mode"]
    spiral = MoveSpiral(
        **NOTE, servo_period=0.001, height=40.0, mhelical_mode=mode, acceleration=1000.0, deceleration=1000.0
    )
    text = of_the_page().replace("BASE(cx,cy)", "CONNECT(1,4) AXIS(5): BASE(cx,cy,4)")
    text = text.replace("MOVECIRC(0,0,outer/2,0,1)", f"MHELICAL(0,0,outer/2,0,1,40/turns,{mode})")
    check(interpreted(text, spiral, axis_numbers=(0, 1, 5)), spiral)


def test_statement_times_add_up_to_the_interpreter_time_of_a_pass():
    """Every statement counts: with 50 us each a pass of 8 takes 0.4 ms, but for those that buffer a circle."""
    spiral = MoveSpiral(**NOTE, servo_period=0.001, interpreter_time=0.0004)
    timed = interpreted(of_the_page(), spiral, interpreter_time=InterpreterTime(5e-5, 5e-5, 5e-5, 5e-5))
    free = interpreted(of_the_page(), spiral, interpreter_time=InterpreterTime(0, 0, 0, 0))
    ends = [one.setpoints(0.001).position[-1] for one in (timed, free, spiral)]
    assert ends[0] == pytest.approx(ends[2], abs=0.02)
    assert np.abs(ends[1] - ends[2]).max() > 0.2


def test_a_stated_spiral_is_the_requested_path():
    made = Basic(of_the_page(), spiral=StatedSpiral(120.0, 4, 10.0), placement=Placement(x=3, y=4, rotate=30))
    assert isinstance(made.requested, Involute)
    assert made.requested.turn_spacing == pytest.approx(10)
    position = made.setpoints(0.001).position
    points = np.column_stack([position, np.zeros(len(position))])
    assert made.requested.project(points).distance.max() < 1.5  # what the loop's limits cost
    assert position[0] == pytest.approx([3, 4])
    closed = MoveSpiral(**NOTE).requested
    plain = Basic(of_the_page(), spiral=StatedSpiral(120.0, 4, 10.0)).requested
    assert plain.parameters() == closed.parameters()


@pytest.mark.parametrize(
    ("changed", "error"),
    [
        ({"diameter": -1.0}, r"spiral\.diameter = -1 mm"),
        ({"turns": 0}, r"spiral\.turns = 0"),
        ({"turns": 7}, r"spiral\.thickness = 10 mm: must be at most diameter / \(2 turns\), 8\.57143 mm"),
    ],
)
def test_a_stated_spiral_is_checked(changed, error):
    with pytest.raises(InputError, match=f"^{error}"):
        StatedSpiral(**{"diameter": 120.0, "turns": 4, "thickness": 10.0, **changed})


def test_the_page_s_program_refuses_a_spiral_too_thick():
    made = Basic(of_the_page().replace("pitch=10", "pitch=16"))
    assert made.printed[0].text == "too many turns"
    assert np.ptp(made.trace(0.001).position, axis=0).max() == 0
