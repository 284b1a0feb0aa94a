"""What softMC would not run: nothing moves, and the error says line, text and reason."""

import math
import re

import pytest

from gantrysim.base.errors import InputError
from gantrysim.controllers.softmc import Circle, Group, Move, Program, SoftMCError


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (
            "Circle G1 CirclePoint={1, 0} TargetPoint={2, 0}",
            "the three points (0, 0, 0), (1, 0, 0) and (2, 0, 0) are collinear: must not be; "
            "use Move for a straight line",
        ),
        (
            "Circle G1 CirclePoint={1, 0} TargetPoint={0, 0}",
            "the three points (0, 0, 0), (1, 0, 0) and (0, 0, 0) coincide: must be distinct; "
            "use Angle and CircleCenter for a full circle",
        ),
        (
            "Circle G1 CirclePoint={1, 3} TargetPoint={1, 3}",
            "the three points (0, 0, 0), (1, 3, 0) and (1, 3, 0) coincide: must be distinct; "
            "use Angle and CircleCenter for a full circle",
        ),
        (
            "Circle Angle=90 CircleCenter={0, 0}",
            "radius = 0 mm, centre and start are both x = 0, y = 0: must be greater than 0 mm; "
            "move away from the centre first",
        ),
        ("Circle Angle=0 CircleCenter={1, 0}", "angle = 0 deg: must not be 0 deg; positive is counter-clockwise"),
        (
            "Circle Angle=90 CircleCenter={1, 0} CirclePlane=1",
            "plane = 1 (XZ): must be 0 (XY) with the axes x, y",
        ),
        ("Circle Angle=90 CircleCenter={1, 0} CirclePlane=3", "plane = 3: must be 0 (XY), 1 (XZ) or 2 (YZ)"),
        ("Circle Angle=90 CircleCenter={1, 0} CirclePlane=0.5", "plane = 0.5: must be 0 (XY), 1 (XZ) or 2 (YZ)"),
        ("Circle Angle=90 CircleCenter={1, 0} CirclePlane=inf", "plane = inf: must be 0 (XY), 1 (XZ) or 2 (YZ)"),
        ("Circle Angle=90 CircleCenter={1, 0} CirclePlane=nan", "plane = nan: must be 0 (XY), 1 (XZ) or 2 (YZ)"),
        (
            "Circle CirclePoint={1, 1} TargetPoint={2, 0} CirclePlane=1",
            "plane = 1 (XZ) with a circle through points: must be omitted; the three points define the plane",
        ),
        (
            "Circle G1 Angle=90",
            "circle by angle: must be by angle and centre, or by via and target; "
            "in text Angle and CircleCenter, or CirclePoint and TargetPoint",
        ),
        (
            "Circle G1",
            "circle by nothing: must be by angle and centre, or by via and target; "
            "in text Angle and CircleCenter, or CirclePoint and TargetPoint",
        ),
        (
            "Circle Angle=90 CircleCenter={1, 0} TargetPoint={2, 2}",
            "circle by angle and centre and target: must be by angle and centre, or by via and target; "
            "in text Angle and CircleCenter, or CirclePoint and TargetPoint",
        ),
        ("Circle G1 Angle", "Angle has no value: must be a number, after an ="),
        ("Circle Angle 90", "Angle has no value: must be a number, after an ="),
        ("Circle Angle= CircleCenter={0, 1}", "Angle has no value: must be a number, after an ="),
        (
            "Circle G1 CircleCenter=",
            "CircleCenter has no value: must be a point in braces, as in {0, 0, 5}, after an =",
        ),
        ("Circle Angle=ninety", "Angle = 'ninety': must be a number"),
        ("Circle Angle=9o", "Angle = '9o': must be a number"),
        ("Circle Angle={1, 2}", "Angle = {1, 2}: must be a number"),
        ("Circle CircleCenter=7", "CircleCenter = 7: must be a point in braces, as in {0, 0, 5}"),
        ("Circle CircleCenter={0, a}", "coordinate of CircleCenter = 'a': must be a number"),
        ("Circle Angle=nan CircleCenter={0, 1}", "angle = nan deg: must be finite"),
        ("Move {0, inf}", "coordinate of target = inf: must be finite"),
        (
            "Circle Angel=90",
            "unknown word 'Angel': did you mean Angle? known: Angle, Abs, Acc, CircleCenter, CirclePlane, CirclePoint, "
            "Dec, Dispense, Jerk, PrfType, Smooth, TargetPoint, VCruise, Vtran",
        ),
        ("Cirle Angle=90", "unknown command 'Cirle': did you mean Circle? known: Circle, Move"),
        ("{1, 2}", "unknown command '{1, 2}': known: Circle, Move"),
        ("Move G1 {1}", "target of 1 number: must be 2, of the axes x, y"),
        ("Move {1, 2, 3}", "target of 3 numbers: must be 2, of the axes x, y"),
        ("Move", "target is missing: must follow as {x, y, ...}"),
        (
            "Move {1, 2",
            "'{1, 2': must be words, numbers and points in braces, as in {0, 0, 5}",
        ),
        (
            "Move {1, 2} 55",
            "'55': must be one of the words Vtran, VCruise, Acc, Dec, Jerk, PrfType, Smooth, Abs, Dispense, "
            "with = and a value",
        ),
        ("Move {1, 2} Vtran=5 VCruise=6", "VCruise: velocity is given twice, must be once"),
        ("Move {1, 2} Vtran=0", "velocity = 0 mm/s: must be greater than 0 mm/s"),
        ("Move {1, 2} Abs=2", "Abs = 2: must be 0 or 1"),
        (
            "Move {1, 2} PrfType=7",
            "PrfType = 7: must be one of "
            "-1 (smooth), 0 (trapezoid), 1 (sine), 2 (trapezoidal acceleration), 3 (constant)",
        ),
        (
            "Move {1, 2} PrfType=-1 Smooth=101",
            "smooth = 101: must be a whole number, 0 to 100, or -1 to use the jerk",
        ),
        (
            "Move {1, 2} Smooth=5",
            "smooth = 5 with the profile 'trapezoid': must be the profile 'smooth', PrfType=-1",
        ),
        ("Move G2 {1, 2}", "group G2: must be G1, as in the lines before; a program moves one group"),
    ],
)
def test_an_invalid_line_is_reported_with_its_number_and_text(line, message):
    with pytest.raises(SoftMCError) as caught:
        Program(f"Move G1 {{0, 0}}\n\n  {line}  ' as the operator typed it\nMove {{5, 5}}")
    assert str(caught.value) == f'line 3 "{line}": {message}'


def test_a_line_without_a_group_uses_the_one_before():
    assert len(Program("Move G1 {1, 1}\nMove {2, 2}\nmove g1 {3, 3}\nMOVE {4, 4}").legs) == 4
    with pytest.raises(SoftMCError, match=r'^line 3 "Move G2 \{3, 3\}": group G2: must be G1, as in the lines before'):
        Program("Move G1 {1, 1}\nMove {2, 2}\nMove G2 {3, 3}")


@pytest.mark.parametrize(
    ("commands", "start", "message"),
    [
        (
            [Move((1, 1)), Circle(angle=90, centre=(1, 1), velocity=5)],
            (0, 0),
            "command 2 Circle(velocity=5.0, angle=90.0, centre=(1.0, 1.0)): "
            "radius = 0 mm, centre and start are both x = 1, y = 1: must be greater than 0 mm; "
            "move away from the centre first",
        ),
        (
            [Circle(90, (1, 1), plane=2)],
            (0, 0, 0),
            "command 1 Circle(angle=90.0, centre=(1.0, 1.0), plane=2): "
            "centre of 2 numbers in plane 2 (YZ): must have y and z",
        ),
        ([Move((1, 2, 3, 4, 5))], (0, 0, 0, 0), "command 1 Move(target=(1.0, 2.0, 3.0, 4.0, 5.0)): "
            "target of 5 numbers: must be 2 to 4, of the axes x, y, z, r"),
        (["Move {1, 1}"], (0, 0), "command 1 = 'Move {1, 1}': must be a Circle or a Move"),
        ([], (0, 0), "program moves none of x, y, z: must have at least one command that does"),
        ("' nothing", (0, 0), "program moves none of x, y, z: must have at least one command that does"),
        (
            [Move((0, 0, 0, 90))],
            (0, 0, 0, 0),
            "program moves none of x, y, z: must have at least one command that does",
        ),
    ],
)  # fmt: skip
def test_an_invalid_command_is_reported_with_its_number(commands, start, message):
    with pytest.raises(SoftMCError) as caught:
        Program(commands, start=start)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Program("Move {1, 1}", start=(0,)), "start = (0,): must be 2 to 4 numbers, x, y[, z[, r]]"),
        (lambda: Program("Move {1, 1}", start=3), "start = 3: must be 2 to 4 numbers, x, y[, z[, r]]"),
        (lambda: Program("Move {1, 1}", start=(0, math.nan)), "start y = nan: must be finite"),
        (lambda: Group(velocity=-1), "velocity = -1 mm/s: must be greater than 0 mm/s"),
        (lambda: Group(vmax=0), "vmax = 0 mm/s: must be greater than 0 mm/s"),
        (lambda: Group(vmax=math.nan), "vmax = nan mm/s: must be finite"),
        (lambda: Group(deceleration=0), "deceleration = 0 mm/s²: must be greater than 0 mm/s²"),
        (lambda: Group(jerk=math.inf), "jerk = inf mm/s³: must be finite"),
        (lambda: Group(vrot=0), "vrot = 0 deg/s: must be greater than 0 deg/s"),
        (lambda: Group(smooth=0.5), "smooth = 0.5: must be a whole number, 0 to 100, or -1 to use the jerk"),
        (lambda: Group(smooth=-2), "smooth = -2: must be a whole number, 0 to 100, or -1 to use the jerk"),
        (lambda: Group(position_error=0), "position_error = 0 mm: must be greater than 0 mm"),
        (lambda: Group(position_error_delay=-1), "position_error_delay = -1: must be at least 0"),
        (lambda: Group(position_error_delay=1.5), "position_error_delay = 1.5: must be a whole number"),
        (lambda: Group(settle_time=-1), "settle_time = -1 s: must be at least 0 s"),
        (lambda: Group(settle_timeout=0), "settle_timeout = 0 s: must be greater than 0 s"),
        (
            lambda: Group(profile="cosine"),
            "unknown profile 'cosine': did you mean sine? "
            "known: sine, constant, smooth, trapezoid, trapezoidal acceleration",
        ),
        (lambda: Move((1, 2), velocity=0), "velocity = 0 mm/s: must be greater than 0 mm/s"),
        (
            lambda: Move((1, 2), profile="ramp"),
            "unknown profile 'ramp': known: constant, sine, smooth, trapezoid, trapezoidal acceleration",
        ),
        (lambda: Move(5), "target = 5: must be coordinates [mm]"),
        (lambda: Move("12"), "target = '12': must be coordinates [mm]"),
        (lambda: Circle(90, (1, None)), "coordinate of centre = None: must be a number"),
    ],
)
def test_a_value_out_of_its_bound_is_named(make, message):
    with pytest.raises(InputError, match=f"^{re.escape(message)}$"):
        make()


def test_a_program_of_too_many_ticks_is_refused():
    program = Program([Move((300, 0), velocity=0.01)] * 1 + [Move((0, 0), velocity=0.01)])
    with pytest.raises(InputError, match=r"^program of 6e\+07 ticks of 0\.001 s: must be at most 5e\+07$"):
        program.setpoints(1e-3)
    with pytest.raises(InputError, match=r"^30000 s in periods of 1e-05 s: makes 3e\+09 ticks, at most 5e\+07$"):
        program.setpoints(1e-5)


@pytest.mark.parametrize("rate", ["Jerk", "Acc", "Dec", "Vtran"])
@pytest.mark.parametrize("value", ["1e-300", "1e-13", "1e16", "1e300"])
@pytest.mark.parametrize("profile", ["PrfType=2", "PrfType=-1 Smooth=-1"])
def test_rates_whose_products_are_no_numbers_are_refused(rate, value, profile):
    with pytest.raises(SoftMCError, match=r'^line 1 ".*": \w+ = .*: must be at (least 1e-12|most 1e.15) mm/s'):
        Program(f"Move G1 {{10, 0}} {rate}={value} {profile}")
