"""The tables of codes, each a function named after the code, with its meaning in the docstring.

`g05_1` is G05.1. The decorator says when the function is called, and enters it in a table. Calls of subprograms and
the end of the program, which change the order of the blocks, are in `sequence.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from gantrysim.controllers.fanuc.block_words import Words
from gantrysim.controllers.fanuc.blocks import Block
from gantrysim.controllers.fanuc.modal_state import ModalState

Setting = Callable[[ModalState, Words], None]
Action = Callable[[ModalState, Words], list[Block]]
Motion = Callable[[ModalState, Words, dict[str, Any]], Block]  # with the arguments that all motions have

_SHORTEST_RANGE = 2  # codes that are listed one by one

# by the name of the code
SETTINGS: dict[str, Setting] = {}  # applied where they stand among the codes of their block
ACTIONS: dict[str, Action] = {}  # carried out once, with the words of their block
MOTIONS: dict[str, Motion] = {}  # carried out with the axis words of their block and of those that follow


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
