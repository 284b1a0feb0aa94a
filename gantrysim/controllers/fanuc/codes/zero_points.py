"""Coordinate systems and their shifts, and the move home."""

from __future__ import annotations

from gantrysim.controllers.fanuc.block_words import Words
from gantrysim.controllers.fanuc.blocks import PLANES, Block, Rapid
from gantrysim.controllers.fanuc.codes.handlers import action, setting
from gantrysim.controllers.fanuc.modal_state import ENDS, SYSTEMS, ModalState
from gantrysim.controllers.placement import higher

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
