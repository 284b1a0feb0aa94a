"""Checkpoints of a program that runs, at which another run of it, from another start, takes over its moves.

What a program does next depends on its text and its state alone. So two runs of a text that have come to the same state
go on alike, until they use their starts again, to which G28 leads: a program that has once moved every axis to an
absolute coordinate no longer depends on where it began. States are compared to the last bit, by digests.
"""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from hashlib import sha256
from io import BytesIO
from typing import Any, NamedTuple

from gantrysim.base.arrays import Floats
from gantrysim.controllers.gcode.o_words import ProgramFlow
from gantrysim.controllers.gcode.program_state import ProgramState
from gantrysim.controllers.macro.variables import System

# lines between two checkpoints, at least; a large state, of many parameters, takes as long as more lines
_INTERVAL = 1000
_BYTES_PER_LINE = 4
_MOST_SECTIONS = 8  # with a snapshot each


class Checkpoint(NamedTuple):
    """The state of a program after some of its lines.

    Attributes:
        lines: with words that have run; -1 at the end of the program.
        rows: of the table of moves.
        reads: of the start; between checkpoints with equal ones the program does not use it.
        digest: of the state.
        snapshot: the state; None at all but the last of the checkpoints with equal reads.
    """

    lines: int
    rows: int
    reads: int
    digest: bytes
    snapshot: bytes | None


class Snapshots:
    """Takes and restores the state of a program that runs.

    Args:
        flow: order of its lines.
        state: of the program.
        system: parameters that the controller provides.
    """

    def __init__(self, flow: ProgramFlow, state: ProgramState, system: System) -> None:
        self.state = state
        self._flow = flow
        # what a snapshot refers to by name: the moves are many, and the start is what two runs differ in
        self._fixed = {"moves": state.moves, "start": state.frames.start, "system": system}
        self._names = {id(part): name for name, part in self._fixed.items()}

    @property
    def is_possible(self) -> bool:
        """Whether the moves so far are final: under cutter compensation the next one changes the last."""
        return not self.state.compensation.is_on

    def taken(self) -> bytes:
        """Return the state, to the last bit."""
        moves = self.state.moves
        last = moves.row(len(moves) - 1) if len(moves) else None
        content = BytesIO()
        _Pickler(content, self._names).dump((self._flow.progress, self.state.progress, len(moves), last))
        return content.getvalue()

    def restore(self, snapshot: bytes) -> None:
        """Return to a state of this program, or of another run of it."""
        flow, state, _, _ = _Unpickler(BytesIO(snapshot), self._fixed).load()
        vars(self._flow).update(flow)
        vars(self.state).update(state)


class Recorder:
    """Takes the checkpoints of a run.

    Args:
        snapshots: of the program.
    """

    def __init__(self, snapshots: Snapshots) -> None:
        self._snapshots = snapshots
        self._lines = 0
        self._due = _INTERVAL
        self._checkpoints: list[Checkpoint] = []
        self._sections = 0

    def ends_after_line(self) -> bool:
        """Note that a line has run; return whether the program is at its end."""
        self._lines += 1
        if self._lines == self._due:
            self._due += max(_INTERVAL, self._take(self._lines) // _BYTES_PER_LINE)
        return False

    def finished(self) -> tuple[Checkpoint, ...]:
        """Note that the program has ended, and return the checkpoints; none of a short one."""
        if self._checkpoints:
            self._take(-1)
        return tuple(self._checkpoints)

    def _take(self, lines: int) -> int:
        """Take a checkpoint where that is possible, and return its size [B]."""
        reads = self._snapshots.state.frames.start.reads
        before = self._checkpoints[-1] if self._checkpoints else None
        continues = before is not None and before.reads == reads
        if not self._snapshots.is_possible or (self._sections == _MOST_SECTIONS and not continues):
            return 0
        if continues:
            self._checkpoints[-1] = self._checkpoints[-1]._replace(snapshot=None)
        else:
            self._sections += 1
        snapshot = self._snapshots.taken()
        rows = len(self._snapshots.state.moves)
        self._checkpoints.append(Checkpoint(lines, rows, reads, _digest(snapshot), snapshot))
        return len(snapshot)


class Follower:
    """Takes over the moves of an earlier run where this one has come to the same state.

    Args:
        snapshots: of the program.
        checkpoints: of the earlier run.
        table: its moves.
    """

    def __init__(self, snapshots: Snapshots, checkpoints: Sequence[Checkpoint], table: Floats) -> None:
        self._snapshots = snapshots
        self._checkpoints = checkpoints
        self._table = table
        self._lines = 0
        self._index = 0  # of the next checkpoint

    def ends_after_line(self) -> bool:
        """Note that a line has run; return whether the program is at its end, be it by what was taken over."""
        self._lines += 1
        if self._index == len(self._checkpoints) or self._lines != self._checkpoints[self._index].lines:
            return False
        checkpoint = self._checkpoints[self._index]
        self._index += 1
        if not self._snapshots.is_possible or _digest(self._snapshots.taken()) != checkpoint.digest:
            return False
        while self._index < len(self._checkpoints) and self._checkpoints[self._index].reads == checkpoint.reads:
            self._index += 1
        last = self._checkpoints[self._index - 1]
        assert last.snapshot is not None
        self._snapshots.state.moves.extend(self._table[checkpoint.rows : last.rows])
        self._snapshots.restore(last.snapshot)
        self._lines = last.lines
        return last.lines < 0

    def finished(self) -> tuple[Checkpoint, ...]:
        """Return no checkpoints: the earlier run has them."""
        return ()


class _Pickler(pickle.Pickler):
    def __init__(self, content: BytesIO, names: dict[int, str]) -> None:
        super().__init__(content, pickle.HIGHEST_PROTOCOL)
        self._names = names

    def persistent_id(self, part: Any) -> str | None:
        return self._names.get(id(part))


class _Unpickler(pickle.Unpickler):
    def __init__(self, content: BytesIO, parts: dict[str, Any]) -> None:
        super().__init__(content)
        self._parts = parts

    def persistent_load(self, name: str) -> Any:
        return self._parts[name]


def _digest(snapshot: bytes) -> bytes:
    return sha256(snapshot).digest()
