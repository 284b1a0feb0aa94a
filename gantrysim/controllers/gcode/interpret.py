"""A program's text as a table of moves."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import AxisError, InputError
from gantrysim.controllers.gcode.motion_limits import MotionLimits
from gantrysim.controllers.gcode.move_table import DWELL, END, FLOW, KIND, LINE, OUTPUTS, WORK, MoveTable
from gantrysim.controllers.gcode.o_words import ProgramFlow, ProgramText
from gantrysim.controllers.gcode.program_state import ProgramSetup, ProgramState
from gantrysim.controllers.gcode.system import provided
from gantrysim.controllers.gcode.word_blocks import Interpreter
from gantrysim.controllers.valve import SAME_PLACE, Outputs, Valve


@dataclass(frozen=True)
class Interpreted:
    """A program that was run.

    Attributes:
        start: initial position [mm].
        moves: rows of `MoveTable`, (m, WIDTH).
        glue: whether glue is laid in them, (m,).
        valve: what opens it.
        ignored: words without an effect on the path, and how often they were met.
        without_feed: moves at a feed that the program has not stated.
        limits: to which the moves refer.
        assumed_feeds: names of the machine's feeds that the program reads and that nobody gave.
        subroutines: names of those that the text holds.
        called_files: names of the files of subprograms that were called.
        without_diameter: tools of cutter compensation whose diameter nobody gave.
    """

    start: tuple[float, float, float]
    moves: Floats
    glue: NDArray[np.bool_]
    valve: Valve
    ignored: Counter[str]
    without_feed: int = 0
    limits: tuple[MotionLimits, ...] = (MotionLimits(),)
    assumed_feeds: tuple[str, ...] = ()
    subroutines: tuple[str, ...] = ()
    called_files: frozenset[str] = frozenset()
    without_diameter: tuple[int, ...] = ()

    @property
    def without_moves(self) -> str:
        """What a program without moves lacks, in words."""
        if not self.subroutines:
            return "must have a block that does"
        return f"its subroutines ({', '.join(self.subroutines[:3])}) run where another program calls them"


def interpret(program: ProgramText, start: tuple[float, float, float], setup: ProgramSetup) -> Interpreted:
    """Run a program.

    Args:
        program: its text.
        start: initial position [mm].
        setup: what it is run with.

    Raises:
        InputError: a line that is refused, with its number.
    """
    moves = MoveTable(start)
    state = ProgramState(moves, setup)
    interpreter = Interpreter(state)

    def system(key: float | str) -> float | None:
        state.line = flow.line  # of the expression that reads #<_line>, before the words of its line are run
        return provided(state, key)

    flow = ProgramFlow(program, system, state.subprogram_ends)
    subroutines = tuple(str(label) for label in flow.places.labels("SUB"))
    try:
        for line in flow.run():
            state.line = flow.line
            state.depth = flow.depth
            if not interpreter.run(line):
                break
        if state.curve is not None:
            raise InputError(f"{state.curve.name}: the program ends before the curve does")
    except InputError as error:
        kind = AxisError if isinstance(error, AxisError) else InputError
        raise kind(f"{flow.where}: {error}") from None
    except OverflowError:
        raise InputError(f"{flow.where}: a number is too large") from None
    called_files = flow.called_files
    flow.lines.clear()  # the flow and its parameters refer to one another, and would keep them until a collection
    table = moves.table
    fed = (table[:, FLOW] > 0) & (table[:, KIND] != DWELL)
    valve = state.outputs.valve(feeds_material=bool(fed.any()))
    for code in (*valve.on, *valve.off):
        state.ignored.pop(code.split()[0], None)
    return Interpreted(
        start=start,
        moves=table,
        glue=valve.lays(_is_work(table, start), table[:, KIND] == DWELL, _is_on(table, state.outputs, valve), fed),
        valve=valve,
        ignored=state.ignored,
        without_feed=state.without_feed,
        limits=tuple(state.limits.rows),
        assumed_feeds=tuple(sorted(state.assumed_feeds)),
        subroutines=subroutines,
        called_files=called_files,
        without_diameter=tuple(sorted(state.tools.without_diameter)),
    )


def _is_work(table: Floats, start: tuple[float, float, float]) -> NDArray[np.bool_]:
    """Whether moves and dwells are at work, but for those straight up or down, (m,)."""
    work: NDArray[np.bool_] = table[:, WORK] != 0
    plan = np.concatenate([[start[:2]], table[:, END : END + 2]])
    stands = np.abs(np.diff(plan, axis=0)).max(axis=1, initial=0.0) <= SAME_PLACE
    work[stands & (table[:, KIND] == LINE)] = False
    return work


def _is_on(table: Floats, outputs: Outputs, valve: Valve) -> NDArray[np.bool_]:
    """Whether the output that opens the valve is on in moves and dwells, (m,)."""
    on = np.array([valve.output in state for state in outputs.states])
    return np.asarray(on[table[:, OUTPUTS].astype(np.intp)])
