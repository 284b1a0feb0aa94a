"""What programs act on: the controller's memory, inputs and outputs, its motion, and the processes that run on it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from gantrysim.base.errors import InputError
from gantrysim.controllers.basic.code import Code
from gantrysim.controllers.basic.tasks import Task
from gantrysim.controllers.trio.basic.motion import Motion

VR_SIZE = 65_536
TABLE_SIZE = 512_000
MOST_OUTPUTS = 1024
MOST_ANALOGUE = 64  # outputs
MOST_PROCESSES = 32
MOST_CHARACTERS = 4096  # of a printed line
MOST_PRINTED = 10_000  # lines of the log; later ones are counted


@dataclass(frozen=True)
class ProgramCode:
    """A program that can be executed.

    Attributes:
        name: in capitals.
        statements: in their order.
        remarks: on what its text writes otherwise than the controller reads it.
    """

    name: str
    statements: Code[Process]
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class Printed:
    """A line that a program printed.

    Attributes:
        time: [s].
        channel: number of the channel, None for PRINT without one.
        text: the line.
    """

    time: float
    channel: int | None
    text: str


class Ordered(NamedTuple):
    """The last move that a process has ordered: the axis that holds it, and the servo period."""

    axis: int
    tick: int


@dataclass(kw_only=True)
class Process(Task):
    """A running program.

    Attributes:
        state: of the controller that it runs on.
        name: of the program, in capitals.
        number: of the process.
        base: axes of BASE.
        ticks_zero: servo tick at which TICKS is 0.
        error_line: line of its last error that it has handled, 0 for none.
        kinds: types that DIM gives to variables.
        arrays: those of DIM, with their sizes, by name.
        ordered: its last move; None before the first.
    """

    state: State
    name: str
    number: int
    base: tuple[int, ...] = (0,)
    ticks_zero: float = 0.0
    error_line: int = 0
    kinds: dict[str, str] = field(default_factory=dict)
    arrays: dict[str, tuple[tuple[int, ...], dict[tuple[int, ...], float]]] = field(default_factory=dict)
    ordered: Ordered | None = None

    def recovers(self, error: str, ready: float) -> bool:
        """Go on at the label of ON BASICERROR, where there is one; the error is noted."""
        if not super().recovers(error, ready):
            return False
        self.error_line = self.line
        self.state.handled.append(error)
        return True

    def assign(self, name: str, value: float) -> None:
        """Set a variable of this process, or the cell of VR for which GLOBAL has given its name."""
        if name in self.state.constants:
            raise InputError(f"{name.lower()} = ...: is a CONSTANT, which cannot be assigned")
        if name in self.state.globals and name not in self.variables:
            self.state.vr[self.state.globals[name]] = value
        else:
            self.variables[name] = self._converted_value(name, value)

    def element(self, name: str, places: list[float]) -> float:
        """Return an element of an array."""
        place = self._place(name, places)
        return self.arrays[name][1].get(place, 0.0)

    def set_element(self, name: str, places: list[float], value: float) -> None:
        """Set an element of an array."""
        place = self._place(name, places)
        self.arrays[name][1][place] = self._converted_value(name, value)

    def _converted_value(self, name: str, value: float) -> float:
        kind = self.kinds.get(name)
        if kind == "INTEGER":
            return float(math.trunc(value))
        if kind == "BOOLEAN":
            return -1.0 if value else 0.0
        return value

    def _place(self, name: str, places: list[float]) -> tuple[int, ...]:
        if name not in self.arrays:
            raise InputError(f"{name.lower()}(...): the DIM of the array must be executed before")
        sizes = self.arrays[name][0]
        if len(places) != len(sizes):
            raise InputError(f"{name.lower()} with {len(places)} indices: must have {len(sizes)}")
        return tuple(index(name.lower(), place, size) for place, size in zip(places, sizes, strict=True))

    def axes(self, count: int) -> tuple[int, ...]:
        """Return the axes of a command with `count` values: those of BASE, then the following numbers."""
        following = range(self.base[-1] + 1, self.base[-1] + 1 + count - len(self.base))
        return (*self.base[:count], *following)


@dataclass
class State:
    """What the programs of a controller share.

    Attributes:
        motion: its axes.
        programs: their statements by name.
        inputs: numbers of the inputs that are on.
        wait_resolution: waits are truncated to a multiple of it, 0 for exact waits [s].
        tick: number of servo periods since the start.
        vr, table: global memory.
        outputs: numbers of the outputs that are on.
        switched: outputs that a program has switched.
        hasty: notes on outputs that were switched before the moves above had run, by output.
        analogue: values of the analogue outputs that a program has set, by number.
        processes: in the order of their start.
        printed: what programs print.
        unlogged: number of printed lines that the log does not keep.
        ignored: parameters without an effect that were set.
        constants: values of CONSTANT, by name.
        globals: cells of VR that GLOBAL has named.
        handled: errors after which a process has gone on.
        latest: the process that was started last, by number.
        stopped: line at which stop_after has stopped the programs, 0 if it has not.
        line_is_open: whether what is printed next continues a line.
    """

    motion: Motion
    programs: dict[str, ProgramCode]
    inputs: frozenset[int]
    wait_resolution: float
    tick: int = 0
    vr: dict[int, float] = field(default_factory=dict)
    table: dict[int, float] = field(default_factory=dict)
    outputs: set[int] = field(default_factory=set)
    switched: set[int] = field(default_factory=set)
    hasty: dict[int, list[str]] = field(default_factory=dict)
    analogue: dict[int, float] = field(default_factory=dict)
    processes: list[Process] = field(default_factory=list)
    printed: list[Printed] = field(default_factory=list)
    unlogged: int = 0
    ignored: set[str] = field(default_factory=set)
    constants: dict[str, float] = field(default_factory=dict)
    globals: dict[str, int] = field(default_factory=dict)
    handled: list[str] = field(default_factory=list)
    latest: dict[float, Process] = field(default_factory=dict)
    stopped: int = 0
    line_is_open: bool = False

    @property
    def time(self) -> float:
        """Time of the current servo tick [s]."""
        return self.tick * self.motion.period

    def run(self, name: str, ready: float, number: float | None = None) -> None:
        """Start a program.

        Raises:
            InputError: it is unknown, the process number is taken, or too many processes run.
        """
        code = self.programs.get(name.upper())
        if code is None:
            raise InputError(f"RUN {name!r}: must be one of the programs {', '.join(self.programs)}")
        taken = {process.number for process in self.processes if not process.ended}
        free = [n for n in range(1, MOST_PROCESSES + 1) if n not in taken]
        if number is not None and (number not in range(MOST_PROCESSES + 1) or number in taken):
            raise InputError(f"RUN on process {number:g}: must be a free one of 0 to {MOST_PROCESSES}")
        if not free:
            raise InputError(f"RUN {name!r}: at most {MOST_PROCESSES} processes run at once")
        process = Process(
            code=code.statements,
            ready=ready,
            state=self,
            name=code.name,
            number=free[0] if number is None else int(number),
        )
        self.processes.append(process)
        self.latest[process.number] = process

    def set_analogue(self, output: float, value: float) -> None:
        """Set an analogue output."""
        self.analogue[index("AOUT", output, MOST_ANALOGUE)] = value

    def stop(self, name: str | None) -> None:
        """Stop the processes of a program, None for all."""
        if name is not None and name.upper() not in self.programs:
            raise InputError(f"STOP {name!r}: must be one of the programs {', '.join(self.programs)}")
        for process in self.processes:
            if name is None or process.name == name.upper():
                process.ended = True

    def shared_value(self, name: str) -> float:
        """Return what a name stands for in all programs: a CONSTANT or a GLOBAL, else 0."""
        if name in self.constants:
            return self.constants[name]
        return self.vr.get(self.globals[name], 0.0) if name in self.globals else 0.0

    def log(self, channel: float | None, text: str, continues: bool = False) -> None:
        """Print a line, or a part of one that the next PRINT continues."""
        was_open = self.line_is_open
        self.line_is_open = continues
        if was_open and self.printed:
            self.printed[-1] = replace(self.printed[-1], text=(self.printed[-1].text + text)[:MOST_CHARACTERS])
        elif len(self.printed) < MOST_PRINTED:
            self.printed.append(Printed(self.time, None if channel is None else int(channel), text))
        else:
            self.unlogged += 1

    def wait(self, milliseconds: float) -> float:
        """Return the time that WA takes [s]."""
        # a negative time does not wait
        wait = max(1e-3 * milliseconds, 0.0)
        if self.wait_resolution > 0:
            wait = math.floor(wait / self.wait_resolution + 1e-9) * self.wait_resolution
        return wait


def index(name: str, value: float, size: int) -> int:
    """Return a number as an index below `size`, or raise InputError."""
    if not 0 <= value < size or value != int(value):
        raise InputError(f"{name}({value:g}): must be a whole number from 0 to {size - 1}")
    return int(value)
