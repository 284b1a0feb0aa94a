"""Mirror image and rotation of the coordinates."""

from __future__ import annotations

from gantrysim.controllers.fanuc.block_words import Words
from gantrysim.controllers.fanuc.blocks import PLANES, Block
from gantrysim.controllers.fanuc.codes.handlers import action, setting
from gantrysim.controllers.fanuc.modal_state import ENDS, ModalState


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
    place = state.turn.programmed(state.program_place)
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
