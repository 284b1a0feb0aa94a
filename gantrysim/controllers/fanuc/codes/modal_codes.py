"""Modes: look-ahead, plane, units, compensation, stops, distances."""

from __future__ import annotations

from gantrysim.controllers.fanuc.block_words import Words
from gantrysim.controllers.fanuc.codes.handlers import setting
from gantrysim.controllers.fanuc.modal_state import ModalState

INCH = 25.4  # [mm]


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


@setting
def g44(state: ModalState, words: Words) -> None:
    """Negative tool length, without an effect: the path is that of the nozzle's tip."""


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
