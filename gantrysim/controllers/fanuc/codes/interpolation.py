"""Motions, and the dwell."""

from __future__ import annotations

from typing import Any

from gantrysim.controllers.fanuc.block_words import Words
from gantrysim.controllers.fanuc.blocks import PLANES, Arc, Block, Dwell, Line, Rapid, Spiral
from gantrysim.controllers.fanuc.codes.handlers import action, motion
from gantrysim.controllers.fanuc.modal_state import ModalState

CENTRES = "IJK"


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
    if words.values or time < 0:
        raise words.fail(9, "G04 must have X [s] or P [ms], at least 0, and no other address")
    return [Dwell(time=time)]
