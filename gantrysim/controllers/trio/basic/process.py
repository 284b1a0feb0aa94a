"""What programs act on: the controller's memory, inputs and outputs, its motion, and the processes that run on it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from gantrysim.base.errors import InputError
from gantrysim.controllers.basic.code import Code
from gantrysim.controllers.basic.tasks import Task
from gantrysim.controllers.trio.basic.motion import Motion

VR_SIZE = 65_536
TABLE_SIZE = 512_000
MOST_OUTPUTS = 1024
MOST_PROCESSES = 32
MOST_PRINTED = 10_000  # lines of the log; later ones are counted


@dataclass(frozen=True)
class ProgramCode:
    """A program that can be executed.

    Attributes:
        name: in capitals.
        statements: in their order.
    """

    name: str
    statements: Code[Process]


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


@dataclass(kw_only=True)
class Process(Task):
    """A running program.

    Attributes:
        state: of the controller that it runs on.
        name: of the program, in capitals.
        number: of the process.
        base: axes of BASE.
        ticks_zero: servo tick at which TICKS is 0.
    """

    state: State
    name: str
    number: int
    base: tuple[int, ...] = (0,)
    ticks_zero: float = 0.0

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
        processes: in the order of their start.
        printed: what programs print.
        unlogged: number of printed lines that the log does not keep.
        ignored: parameters without an effect that were set.
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
    processes: list[Process] = field(default_factory=list)
    printed: list[Printed] = field(default_factory=list)
    unlogged: int = 0
    ignored: set[str] = field(default_factory=set)

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
        if number is not None and (number not in range(1, MOST_PROCESSES + 1) or number in taken):
            raise InputError(f"RUN on process {number:g}: must be a free one of 1 to {MOST_PROCESSES}")
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

    def stop(self, name: str | None) -> None:
        """Stop the processes of a program, None for all."""
        if name is not None and name.upper() not in self.programs:
            raise InputError(f"STOP {name!r}: must be one of the programs {', '.join(self.programs)}")
        for process in self.processes:
            if name is None or process.name == name.upper():
                process.ended = True

    def log(self, channel: float | None, text: str) -> None:
        """Print a line."""
        if len(self.printed) < MOST_PRINTED:
            self.printed.append(Printed(self.time, None if channel is None else int(channel), text))
        else:
            self.unlogged += 1

    def wait(self, milliseconds: float) -> float:
        """Return the time that WA takes [s]."""
        wait = max(1e-3 * milliseconds, 0.0)  # a negative time does not wait
        if self.wait_resolution > 0:
            wait = math.floor(wait / self.wait_resolution + 1e-9) * self.wait_resolution
        return wait


def index(name: str, value: float, size: int) -> int:
    """Return a number as an index below `size`, or raise InputError."""
    if not 0 <= value < size or value != int(value):
        raise InputError(f"{name}({value:g}): must be a whole number from 0 to {size - 1}")
    return int(value)
