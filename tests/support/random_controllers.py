"""Random programs in the language of every controller, from a generator of random numbers: `KINDS`."""

import cmath
import math
from itertools import pairwise

import numpy as np

from gantrysim.base.errors import InputError
from gantrysim.controllers import fanuc, softmc
from gantrysim.controllers.drawings.drawing import Drawing
from gantrysim.controllers.gcode import linuxcnc, slicer
from gantrysim.controllers.placement import Placement
from gantrysim.controllers.stage import OutlineTrace
from gantrysim.controllers.trio import Basic, MoveSpiral
from gantrysim.controllers.valve import Dispense

from support.drawings import arc, csv, dxf, line, svg
from support.random_figures import log_uniform, random_strokes

LEAST_STROKES = 3
TABLE = 440.0  # travel of the stage's table [deg]
LINES_BEFORE = 2  # the first move, in a FANUC program
PAGE = 200.0  # of an SVG [mm]


class Draw:
    """What programs of every kind share: a generator, a figure, a speed and an acceleration."""

    def __init__(self, rng, duration):
        self.rng = rng
        self.speed = log_uniform(rng, 8, 150)
        self.acceleration = float(rng.choice([500, 1000, 3000, 8000]))
        self.strokes = random_strokes(rng, self.speed, duration)
        if len(self.strokes) < LEAST_STROKES:
            raise InputError(f"figure of {len(self.strokes)} strokes in the room: too few")
        self.decimals = int(rng.choice([3, 4, 5]))

    def number(self, value):
        return f"{value:.{self.decimals}f}"


def g_code(draw, dwell="G4 P{:.3f}"):
    """Lines of moves, with I and J of the arcs; points as they are written."""
    here = draw.strokes[0].start
    for stroke in draw.strokes:
        end = f"X{draw.number(stroke.end.real)} Y{draw.number(stroke.end.imag)}"
        if stroke.bend:
            centre = stroke.centre - here
            yield f"G{2 if stroke.bend < 0 else 3} {end} I{centre.real:.5f} J{centre.imag:.5f}"
        else:
            yield f"G1 {end}"
        if stroke.rest:
            yield dwell.format(stroke.rest)
        here = complex(round(stroke.end.real, draw.decimals), round(stroke.end.imag, draw.decimals))


def linuxcnc_program(draw, mode):
    lines = ["G21 G17 G90 G94", *([mode] if mode else []), f"F{60 * draw.speed:.1f}", "G0 X0 Y0", *g_code(draw), "M2"]
    return linuxcnc.Program(text="\n".join(lines), acceleration=draw.acceleration)


def linuxcnc_default(draw):
    return linuxcnc_program(draw, draw.rng.choice(["", "G64"]))


def linuxcnc_tolerance(draw):
    tolerance = log_uniform(draw.rng, 0.005, 5)
    merging = draw.rng.choice(["", f" Q{log_uniform(draw.rng, 0.001, 0.5):.4f}"])
    return linuxcnc_program(draw, f"G64 P{tolerance:.4f}{merging}")


def linuxcnc_exact(draw):
    return linuxcnc_program(draw, "G61")


def grbl(draw):
    """As a sender writes it: units, spindle codes that switch the valve, F on the first move."""
    first, *others = g_code(draw)
    lines = ["G90 G21 G17", "G0 X0 Y0", "M3 S1000", f"{first} F{60 * draw.speed:.0f}", *others, "M5", "G0 X5 Y5", "M30"]
    dispense = Dispense(by="codes", on=("M3",), off=("M5",))
    return linuxcnc.Program(text="\n".join(lines), acceleration=draw.acceleration, dispense=dispense)


def marlin(draw):
    """A printer's file, with the corner speed set, or a deviation, or the default."""
    rng = draw.rng
    corner = [
        [],
        [f"M205 J{log_uniform(rng, 0.005, 0.5):.4f}"],
        [f"M205 X{rng.integers(1, 30)} Y{rng.integers(1, 30)}"],
        [f"SET_VELOCITY_LIMIT SQUARE_CORNER_VELOCITY={rng.integers(1, 20)}"],
    ]
    lines = [
        "G21",
        "G90",
        "M83",
        f"M204 S{draw.acceleration:.0f}",
        *corner[rng.integers(4)],
        f"G1 F{60 * draw.speed:.0f}",
    ]
    moves = g_code(draw, dwell="G4 S{:.3f}")
    lines += [text if text.startswith("G4") else f"{text} E0.5" for text in moves]
    return slicer.Program(text="\n".join(lines), corner_tolerance=log_uniform(rng, 0.01, 5))


def fanuc_text(draw):
    return "\n".join(["G17 G21 G90", f"F{60 * draw.speed:.0f}", *g_code(draw), "M30"])


def fanuc_stops(draw):
    """With a stop at each corner, some of straight moves rounded by the program itself."""
    lines = fanuc_text(draw).splitlines()
    rounding = draw.rng.choice([0.0, draw.rng.uniform(0.05, 0.4)])
    if rounding and not any(stroke.rest for stroke in draw.strokes):
        for k, (stroke, after) in enumerate(pairwise(draw.strokes), LINES_BEFORE):
            turn = abs(cmath.phase((after.end - after.start) / (stroke.end - stroke.start)))
            if not (stroke.bend or after.bend) and 0.1 < turn < 3:
                radius = rounding * min(stroke.length, after.length) / math.tan(0.5 * turn)
                lines[k] += f",R{radius:.4f}"
    return fanuc.Program("\n".join(lines), acceleration=float(draw.rng.choice([draw.acceleration, math.inf])))


def fanuc_blended(draw):
    blend = log_uniform(draw.rng, 0.004, 0.3)
    return fanuc.Program(fanuc_text(draw), acceleration=draw.acceleration, blend_time=blend)


def fanuc_spiral(draw):
    rng = draw.rng
    radius = log_uniform(rng, 3, 20)
    turns = int(rng.integers(1, 4))
    pitch = radius * rng.uniform(0.1, 0.9) / turns
    feed = min(60 * draw.speed, 60 * 2 * math.pi * radius * turns / 0.3)
    spiral = f"G17 G21 G90\nG02 X{pitch * turns:.4f} Y0 I{radius:.4f} J0 Q{-pitch:.6f} F{feed:.0f}"
    after = f"\nG01 X{pitch * turns + rng.uniform(-20, 20):.3f} Y{rng.uniform(-20, 20):.3f}\nM30"
    return fanuc.Program(spiral + after, acceleration=draw.acceleration, blend_time=float(rng.choice([0.0, 0.02])))


def pair(place):
    return f"{{{place.real:.6f},{place.imag:.6f}}}"


def softmc_commands(draw, target="{} G1 ", rest=None):
    for stroke in draw.strokes:
        if stroke.bend:
            yield f"{target.format('Circle')}CirclePoint={pair(stroke.middle)} TargetPoint={pair(stroke.end)}"
        else:
            yield f"{target.format('Move')}{pair(stroke.end)}"
        if stroke.rest and rest is not None:
            yield rest.format(1000 * stroke.rest)


def softmc_program(draw):
    profile = str(draw.rng.choice(["trapezoid", "sine", "trapezoidal acceleration"]))
    group = softmc.Group(velocity=draw.speed, acceleration=draw.acceleration, profile=profile, jerk=1e6)
    return softmc.Program(program="\n".join(softmc_commands(draw)), group=group)


def softmc_basic(draw):
    motion = "\n".join(f"  {command}" for command in softmc_commands(draw, "{} ", "  sleep {:.0f}"))
    rates = f"acc={draw.acceleration}: dec={draw.acceleration}: vcruise={draw.speed:.3f}".replace(": ", "\n  ")
    head = (
        "common shared g as group Axnm = a1 Axnm = a2\nwith g\nprogram\n  abs=1\n  vfac=0.001\n  afac=1e-6\n  jfac=1e-9"
    )
    limits = "amax=1e4\n  dmax=1e4\n  jmax=1e6\n  vmax=400\n  jerk=1e6\n  prftype=0"
    return softmc.Basic(text=f"{head}\n  {limits}\n  {rates}\n  attach g\n  en=1\n{motion}\n  detach g\nend program\n")


def trio_basic(draw):
    rng = draw.rng
    rules = ["MERGE=ON", "MERGE=OFF", "MERGE=ON: CORNER_MODE=2: DECEL_ANGLE=0.3: STOP_ANGLE=1.6"]
    rates = f"SPEED={draw.speed:.3f}: ACCEL={draw.acceleration}: DECEL={draw.acceleration}"
    lines = [f"BASE(0,1): {rates}", str(rng.choice(rules)), "OP(8,ON)"]
    for stroke in draw.strokes:
        end = stroke.end - stroke.start
        if stroke.bend:
            centre = stroke.centre - stroke.start
            circle = f"{end.real:.12g},{end.imag:.12g},{centre.real:.12g},{centre.imag:.12g},{int(stroke.bend < 0)}"
            lines.append(f"MOVECIRC({circle})")
        else:
            lines.append(f"MOVE({end.real:.12g},{end.imag:.12g})")
        if stroke.rest:
            lines += ["WAIT IDLE", f"WA({1000 * stroke.rest:.0f})"]
    return Basic(text="\n".join([*lines, "WAIT IDLE", "OP(8,OFF)", "STOP"]), initial_acceleration=draw.acceleration)


def trio_spiral(draw):
    rng = draw.rng
    diameter = log_uniform(rng, 8, 40)
    turns = int(rng.integers(1, 4))
    thickness = diameter * rng.uniform(0.1, 0.7) / (2 * turns)
    speed = max(draw.speed, math.pi * diameter * turns / 2)
    return MoveSpiral(
        diameter,
        turns,
        thickness,
        speed,
        loop_period=float(rng.choice([0.005, 0.02, 0.05])),
        start=(-0.5 * diameter, 0.0),
        clockwise=bool(rng.integers(2)),
        acceleration=float(rng.choice([math.inf, draw.acceleration])),
        ratio_bits=rng.choice([None, 16]),
    )


def stage_outline(draw):
    """A convex or concave polygon on the rotary stage, blended or not."""
    rng = draw.rng
    count = int(rng.integers(3, 7))
    size = log_uniform(rng, 8, 25)
    angles = [2 * math.pi * (k + rng.uniform(-0.3, 0.3)) / count for k in range(count)]
    places = [size * rng.uniform(0.3, 1) * cmath.exp(-1j * angle) for angle in angles]
    corners = tuple((place.real, place.imag) for place in places)
    trace = OutlineTrace(
        corners=corners,
        corner_radius=log_uniform(rng, 0.3, 0.3 * size),
        speed=max(draw.speed, 20.0),
        velocity=(360.0, 1000.0, 1000.0),
        acceleration=(float(rng.choice([2000, 8000])), 2000.0, 2000.0),
        blend=float(rng.choice([0.0, 1.0, log_uniform(rng, 0.2, 15)])),
    )
    if np.abs(trace.setpoints(0.01).position[:, 0]).max() > TABLE:
        raise InputError("outline: turns beyond the table's travel")
    return trace


def drawn(draw, text, **more):
    rng = draw.rng
    limit = draw.acceleration
    return Drawing(
        text=text,
        speed=draw.speed,
        corner_tolerance=float(rng.choice([0.0, log_uniform(rng, 0.005, 5)])),
        corner_speed=float(rng.choice([0.0, 2.0, 20.0])),
        acceleration=(limit, limit, limit),
        **more,
    )


def svg_drawing(draw):
    middle = complex(0.5 * PAGE, 0.5 * PAGE)
    start = draw.strokes[0].start + middle
    words = [f"M {start.real:.5f} {start.imag:.5f}"]
    for stroke in draw.strokes:
        end = stroke.end + middle
        if stroke.bend:
            flags = f"{int(abs(stroke.bend) > math.pi)} {int(stroke.bend > 0)}"
            words.append(f"A {stroke.radius:.7f} {stroke.radius:.7f} 0 {flags} {end.real:.5f} {end.imag:.5f}")
        else:
            words.append(f"L {end.real:.5f} {end.imag:.5f}")
    path = f'<path d="{" ".join(words)}" fill="none" stroke="black"/>'
    return drawn(draw, svg(path, size=(PAGE, PAGE)), placement=Placement(x=-0.5 * PAGE, y=-0.5 * PAGE))


def dxf_drawing(draw):
    entities = []
    for stroke in draw.strokes:
        if stroke.bend:
            first, last = (math.degrees(cmath.phase(end - stroke.centre)) for end in (stroke.start, stroke.end))
            begin, end = (first, last) if stroke.bend > 0 else (last, first)
            entities.append(arc((stroke.centre.real, stroke.centre.imag), stroke.radius, begin, end))
        else:
            entities.append(line((stroke.start.real, stroke.start.imag), (stroke.end.real, stroke.end.imag)))
    order = str(draw.rng.choice(["drawn", "nearest"]))
    return drawn(draw, dxf(*entities), order=order, reverse=bool(draw.rng.integers(2)))


def csv_drawing(draw):
    places = [draw.strokes[0].start, *(stroke.end for stroke in draw.strokes)]
    curve = str(draw.rng.choice(["lines", "lines", "spline"]))
    return drawn(draw, csv([(place.real, place.imag) for place in places]), curve=curve, format="csv")


KINDS = {
    "linuxcnc-default": linuxcnc_default,
    "linuxcnc-tolerance": linuxcnc_tolerance,
    "linuxcnc-exact": linuxcnc_exact,
    "grbl": grbl,
    "marlin": marlin,
    "fanuc": fanuc_stops,
    "fanuc-blend": fanuc_blended,
    "fanuc-spiral": fanuc_spiral,
    "softmc": softmc_program,
    "softmc-basic": softmc_basic,
    "trio-basic": trio_basic,
    "trio-spiral": trio_spiral,
    "stage-outline": stage_outline,
    "svg": svg_drawing,
    "dxf": dxf_drawing,
    "csv": csv_drawing,
}
