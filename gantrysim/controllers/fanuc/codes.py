"""The tables of codes, each a function named after the code, with its meaning in the docstring.

`g05_1` is G05.1. The decorator says when the function is called, and enters it in a table. Calls of subprograms and
the end of the program, which change the order of the blocks, are in `sequence.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from gantrysim.controllers.fanuc.blocks import PLANES, Arc, Block, Dwell, Line, Rapid, Spiral, Words
from gantrysim.controllers.fanuc.modal_state import ENDS, SYSTEMS, ModalState
from gantrysim.controllers.placement import higher

Setting = Callable[[ModalState, Words], None]
Action = Callable[[ModalState, Words], list[Block]]
Motion = Callable[[ModalState, Words, dict[str, Any]], Block]  # with the arguments that all motions have

_SHORTEST_RANGE = 2  # codes that are listed one by one

# by the name of the code
SETTINGS: dict[str, Setting] = {}  # applied where they stand among the codes of their block
ACTIONS: dict[str, Action] = {}  # carried out once, with the words of their block
MOTIONS: dict[str, Motion] = {}  # carried out with the axis words of their block and of those that follow

CENTRES = "IJK"

INCH = 25.4  # [mm]


def name_of(handler: Callable[..., Any]) -> str:
    """Return the code of a function, as G05.1 of `g05_1`."""
    return handler.__name__.upper().replace("_", ".")


def setting(handler: Setting) -> Setting:
    """Add a code that sets a mode."""
    SETTINGS[name_of(handler)] = handler
    return handler


def action(handler: Action) -> Action:
    """Add a code that is carried out once."""
    ACTIONS[name_of(handler)] = handler
    return handler


def motion(handler: Motion) -> Motion:
    """Add a code of motion."""
    MOTIONS[name_of(handler)] = handler
    return handler


def g_codes() -> list[str]:
    """Return the names of all G codes, ascending."""
    return sorted({*SETTINGS, *ACTIONS, *MOTIONS}, key=lambda name: float(name[1:]))


def g_codes_in_short() -> str:
    """Return the names of all G codes with a range for three or more consecutive ones, as "G00 to G04, G05.1"."""
    runs: list[list[str]] = []
    for name in g_codes():
        follows = runs and float(name[1:]) == float(runs[-1][-1][1:]) + 1
        if follows:
            runs[-1].append(name)
        else:
            runs.append([name])
    short = [f"{run[0]} to {run[-1]}" if len(run) > _SHORTEST_RANGE else ", ".join(run) for run in runs]
    return ", ".join(short)


@motion
def g00(state: ModalState, words: Words, arguments: dict[str, Any]) -> Block:
    """Line at the rapid feed."""
    return Rapid(**arguments)


@motion
def g01(state: ModalState, words: Words, arguments: dict[str, Any]) -> Block:
    """Line at feed."""
    return Line(feed=state.required_feed(words), **arguments)


@motion
def g02(state: ModalState, words: Words, arguments: dict[str, Any]) -> Block:
    """Arc, helix, spiral or cone, clockwise."""
    return _round(state, words, {**arguments, "clockwise": True})


@motion
def g03(state: ModalState, words: Words, arguments: dict[str, Any]) -> Block:
    """Arc, helix, spiral or cone, counter-clockwise."""
    return _round(state, words, {**arguments, "clockwise": False})


def _round(state: ModalState, words: Words, arguments: dict[str, Any]) -> Block:
    """A spiral if Q, L, or a height per turn with an end along the normal is given, else an arc or a helix."""
    arguments["feed"] = state.required_feed(words)
    first, second, across = PLANES[state.plane]
    values = words.values
    i = values.pop(CENTRES[first], None)
    j = values.pop(CENTRES[second], None)
    # posts write the third centre word of an arc in the plane, too
    height_per_turn = values.pop(CENTRES[across], None)
    if height_per_turn == 0:
        height_per_turn = None
        state.zero_height = True
    change = values.pop("Q", None)
    turns = values.pop("L", None)
    radius = values.pop("R", None)
    arm = state.turn.direction(complex(i or 0.0, j or 0.0), state.plane)
    centre = (arm.real, arm.imag)
    arguments["clockwise"] = arguments["clockwise"] == (state.turn.sense(state.plane) > 0)
    if height_per_turn is not None:
        height_per_turn *= state.turn.sign(across)
    climbs = height_per_turn is not None and arguments["end"][across] is not None
    if change is None and turns is None and not climbs:
        if height_per_turn is not None:
            plane = {"xy": "G17", "zx": "G18", "yz": "G19"}[state.plane]
            letters = f"{CENTRES[first]} and {CENTRES[second]}"
            raise words.fail(21, f"address {CENTRES[across]} in {plane}: the centre must be given by {letters}")
        by_radius = radius is not None or (i is None and j is None)  # R has priority
        return Arc(centre=None if by_radius else centre, radius=radius, **arguments)
    if radius is not None:
        raise words.fail(5122, "R in a spiral: the centre must be given by I, J, K of its plane")
    return Spiral(centre=centre, change=change, turns=turns, height_per_turn=height_per_turn, **arguments)


@action
def g04(state: ModalState, words: Words) -> list[Block]:
    """Dwell of X seconds or P milliseconds; without both the exact stop alone."""
    seconds = words.values.pop("X", None)
    milliseconds = words.values.pop("P", None)
    time = seconds if seconds is not None else (milliseconds or 0.0) * 1e-3
    if words.values or time < 0 or (seconds is not None and milliseconds is not None):
        raise words.fail(9, "G04 must have X [s] or P [ms], at least 0, and no other address")
    return [Dwell(time=time)]


@setting
def g05_1(state: ModalState, words: Words) -> None:
    """Look-ahead on, Q1, or off, Q0."""
    state.look_ahead = _switch(words, "G5.1", "Q")


@setting
def g08(state: ModalState, words: Words) -> None:
    """Look-ahead on, P1, or off, P0."""
    state.look_ahead = _switch(words, "G8", "P")


def _switch(words: Words, name: str, letter: str) -> bool:
    value = words.values.pop(letter, None)
    if value not in (0, 1):
        raise words.fail(9, f"{name} must have {letter}0 or {letter}1")
    return value == 1


@setting
def g17(state: ModalState, words: Words) -> None:
    """Arcs and compensation in the XY plane."""
    state.plane = "xy"


@setting
def g18(state: ModalState, words: Words) -> None:
    """Arcs and compensation in the ZX plane."""
    state.plane = "zx"


@setting
def g19(state: ModalState, words: Words) -> None:
    """Arcs and compensation in the YZ plane."""
    state.plane = "yz"


@setting
def g20(state: ModalState, words: Words) -> None:
    """Lengths in inches."""
    state.unit = INCH


@setting
def g21(state: ModalState, words: Words) -> None:
    """Lengths in millimetres."""
    state.unit = 1.0


@setting
def g40(state: ModalState, words: Words) -> None:
    """Cutter compensation off."""
    state.side = 0


@setting
def g41(state: ModalState, words: Words) -> None:
    """Cutter compensation to the left of the path."""
    state.side = 1


@setting
def g42(state: ModalState, words: Words) -> None:
    """Cutter compensation to the right of the path."""
    state.side = -1


@setting
def g43(state: ModalState, words: Words) -> None:
    """Tool length, without an effect: the path is that of the nozzle's tip."""
    state.ignored["G43"] += 1


@setting
def g44(state: ModalState, words: Words) -> None:
    """Negative tool length, without an effect: the path is that of the nozzle's tip."""
    state.ignored["G44"] += 1


@setting
def g49(state: ModalState, words: Words) -> None:
    """No tool length."""


@setting
def g61(state: ModalState, words: Words) -> None:
    """Exact stop at the end of every motion."""
    state.exact_stop = True
    state.continuous = False


@setting
def g64(state: ModalState, words: Words) -> None:
    """Motions pass into each other."""
    state.exact_stop = False
    state.continuous = True


@setting
def g80(state: ModalState, words: Words) -> None:
    """No cycle, as it always is."""


@setting
def g90(state: ModalState, words: Words) -> None:
    """Absolute ends."""
    state.absolute = True


@setting
def g91(state: ModalState, words: Words) -> None:
    """Incremental ends."""
    state.absolute = False


@setting
def g94(state: ModalState, words: Words) -> None:
    """F is per minute, as it always is."""


# Mirror image and rotation of the coordinates.


@action
def g51_1(state: ModalState, words: Words) -> list[Block]:
    """Mirror the axes that are given, about the places X, Y, Z."""
    lengths = _taken_lengths(state, words)
    if not lengths:
        raise words.fail(9, "G51.1 must have X, Y or Z, the place of the mirror")
    state.turn.mirrors |= lengths
    return []


@action
def g50_1(state: ModalState, words: Words) -> list[Block]:
    """No mirror image for the axes that are given, by default for any."""
    axes = _taken_lengths(state, words) or dict(state.turn.mirrors)
    for axis in axes:
        state.turn.mirrors.pop(axis, None)
    return []


@action
def g68(state: ModalState, words: Words) -> list[Block]:
    """Turn the coordinates of the plane about a centre by R; without its coordinates about the present place."""
    if "R" not in words.values:
        raise words.fail(9, "G68 must have R, the angle of the turn [deg]")
    degrees = words.values.pop("R")
    place = state.turn.programmed_point(state.program_place)
    for axis, length in _taken_lengths(state, words).items():
        place[axis] = length
    first, second, _ = PLANES[state.plane]
    state.turn.turn_by(degrees, state.plane, complex(place[first], place[second]))
    return []


@setting
def g69(state: ModalState, words: Words) -> None:
    """No turn of the coordinates."""
    state.turn.end_turn()


def _taken_lengths(state: ModalState, words: Words) -> dict[int, float]:
    """Take the words X, Y and Z of a block; by axis [mm]."""
    return {axis: words.values.pop(letter) * state.unit for axis, letter in enumerate(ENDS) if letter in words.values}


@action
def g10(state: ModalState, words: Words) -> list[Block]:
    """Set the coordinate system P, with L2."""
    lengths = _taken_lengths(state, words)
    number = words.values.pop("P", 0.0)
    if words.values.pop("L", None) != 2 or not 1 <= number <= SYSTEMS or number != int(number):
        raise words.fail(9, f"G10 must be with L2 and P1 to P{SYSTEMS}, the coordinate systems")
    zero = state.systems[int(number) - 1]
    for axis, length in lengths.items():
        zero[axis] = length + (0.0 if state.absolute else zero[axis])
    return []


@action
def g28(state: ModalState, words: Words) -> list[Block]:
    """Rapid moves of the given axes to the initial position, by way of the end."""
    lengths = _taken_lengths(state, words)
    way = tuple(state.end(lengths.get(axis), axis) for axis in range(3))
    places = list(state.home)
    # the reference point of z is above the work: the needle does not go down to the initial height
    height = state.here[2] if way[2] is None else way[2]
    places[2] = higher(state.upward, places[2], height)
    home = tuple(places[axis] if axis in lengths else None for axis in range(3))
    moves: list[Block] = [Rapid(end=end, plane=state.plane, exact_stop=True, dispense=False) for end in (way, home)]
    for axis in lengths:
        state.here[axis] = places[axis]
    return moves


@action
def g30(state: ModalState, words: Words) -> list[Block]:
    """As G28: to the second reference point, or that of P, which a program does not state."""
    words.values.pop("P", None)
    return g28(state, words)


@action
def g52(state: ModalState, words: Words) -> list[Block]:
    """Local shift of the coordinates."""
    for axis, length in _taken_lengths(state, words).items():
        state.shift[axis] = length
    return []


@setting
def g53(state: ModalState, words: Words) -> None:
    """Coordinates of the machine, in this block."""
    state.in_machine = True


@setting
def g54(state: ModalState, words: Words) -> None:
    """Coordinate system 1."""
    state.system = 0


@setting
def g55(state: ModalState, words: Words) -> None:
    """Coordinate system 2."""
    state.system = 1


@setting
def g56(state: ModalState, words: Words) -> None:
    """Coordinate system 3."""
    state.system = 2


@setting
def g57(state: ModalState, words: Words) -> None:
    """Coordinate system 4."""
    state.system = 3


@setting
def g58(state: ModalState, words: Words) -> None:
    """Coordinate system 5."""
    state.system = 4


@setting
def g59(state: ModalState, words: Words) -> None:
    """Coordinate system 6."""
    state.system = 5


@action
def g92(state: ModalState, words: Words) -> list[Block]:
    """Shift that gives the position these coordinates."""
    for axis, length in _taken_lengths(state, words).items():
        state.shift[axis] = state.here[axis] - state.systems[state.system][axis] - length
    return []
