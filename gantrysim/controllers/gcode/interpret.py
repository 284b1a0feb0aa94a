"""A program's text as a table of moves."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.controllers.gcode.flow import Flow
from gantrysim.controllers.gcode.lines import compact, compact_firmware
from gantrysim.controllers.gcode.modal import Modal
from gantrysim.controllers.gcode.moves import Moves


@dataclass(frozen=True)
class Interpreted:
    """A program that was run.

    Attributes:
        start: initial position [mm].
        moves: rows of `Moves`, (m, WIDTH).
        ignored: words without an effect on the path, and how often they were met.
    """

    start: tuple[float, float, float]
    moves: Floats
    ignored: Counter[str]


def interpret(
    text: str,
    others: Mapping[str, str],
    start: tuple[float, float, float],
    modal: Callable[[Moves], Modal],
    steps: int,
    skip: bool,
) -> Interpreted:
    """Run a program.

    Args:
        text: the main program.
        others: subprograms by name.
        start: initial position [mm].
        modal: makes the state that adds moves to a table.
        steps: most lines that may run.
        skip: whether lines that begin with a slash are skipped.

    Raises:
        InputError: a line that is refused, with its number.
    """
    moves = Moves(start)
    state = modal(moves)
    read = partial(compact_firmware, ignored=state.ignored) if state.dialect.lenient else compact
    flow = Flow(text, others, state.provided, steps, skip, state.left, read)
    try:
        for words in flow.words():
            state.line = flow.line
            state.depth = flow.depth
            if not state.run(words):
                break
    except InputError as error:
        raise InputError(f"{flow.where}: {error}") from None
    except OverflowError:
        raise InputError(f"{flow.where}: a number is too large") from None
    return Interpreted(start, moves.table, state.ignored)
