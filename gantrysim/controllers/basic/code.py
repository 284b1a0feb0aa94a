"""Code: instructions in one list with jumps, and the frame in which they run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Generic, NamedTuple, TypeVar

from gantrysim.base.errors import InputError

STATEMENT = "statement"  # kind of statement with no time of its own
MOST_RETURNS = 256  # nested GOSUBs

FrameType = TypeVar("FrameType", bound="Frame")
Act = Callable[[FrameType], int | None]


@dataclass(slots=True)
class Target:
    """The place that jumps go to, shared with them until it is known.

    Attributes:
        index: of its instruction.
    """

    index: int = -1


@dataclass(slots=True)
class Instruction(Generic[FrameType]):
    """A statement, or a part of one, as it is executed.

    Attributes:
        line: of the text.
        act: executes it; returns the index of the next instruction, None for the following one.
        cost: kind of statement that its time is counted as; None for a part of the statement before, without time.
        pure: whether it only tests, jumps and lets time pass.
    """

    line: int
    act: Act[FrameType]
    cost: str | None = STATEMENT
    pure: bool = False


Code = list[Instruction[FrameType]]


class ForLoop(NamedTuple):
    """A FOR loop under way.

    Attributes:
        value: returns the value of its variable.
        assign: sets the variable.
        end: last value.
        step: added on every pass, not 0.
    """

    value: Callable[[], float]
    assign: Callable[[float], None]
    end: float
    step: float

    @property
    def inside(self) -> bool:
        """Whether the variable has not passed the end."""
        value = self.value()
        return value <= self.end if self.step > 0 else value >= self.end


@dataclass
class Frame:
    """Code under way with its variables: a program, or a call of a routine.

    Attributes:
        code: its instructions.
        variables: of this frame, by name.
        shared: variables that all frames of a program see, unless they have one of that name.
        position: index of the next instruction.
        returns: indices of the instructions that GOSUBs return to.
        loops: those whose FOR was run, by its index.
        error_target: index of the instruction at which it goes on after an error, None for an end with the error.
    """

    code: Code[Any] = field(default_factory=list)
    variables: dict[str, Any] = field(default_factory=dict)
    shared: dict[str, Any] = field(default_factory=dict)
    position: int = 0
    returns: list[int] = field(default_factory=list)
    loops: dict[int, ForLoop] = field(default_factory=dict)
    error_target: int | None = None

    def find(self, name: str) -> Any:
        """Return what a name stands for, of this frame or shared; None where it is unknown."""
        return self.variables.get(name) or self.shared.get(name)

    def run(self, begin: Callable[[int, str], None]) -> None:
        """Execute the code to its end.

        Args:
            begin: is given line and cost of each instruction that costs something, before it is executed.
        """
        code = self.code
        count = len(code)
        while self.position < count:
            instruction = code[self.position]
            if instruction.cost is not None:
                begin(instruction.line, instruction.cost)
            goal = instruction.act(self)
            if not instruction.pure:
                self.note_change()
            if goal is not None and goal <= self.position:
                self.come_back(goal)
            self.position = self.position + 1 if goal is None else goal

    def note_change(self) -> None:
        """Note that an instruction has done more than test, jump and let time pass."""

    def come_back(self, goal: int) -> None:
        """Act before a jump back to an instruction, from the end of a pass of a loop to its beginning."""

    def call(self, after: int, target: int) -> int:
        """Return the index of a subroutine, and remember where it returns to.

        Raises:
            InputError: too many calls within one another.
        """
        if len(self.returns) >= MOST_RETURNS:
            raise InputError(f"GOSUB nested more than {MOST_RETURNS} deep: must return before")
        self.returns.append(after)
        return target

    def watch(self, target: int) -> None:
        """Go on at an instruction after an error."""
        self.error_target = target

    def leave(self) -> int:
        """Return the index that a subroutine returns to.

        Raises:
            InputError: no subroutine was called.
        """
        if not self.returns:
            raise InputError("RETURN without GOSUB")
        return self.returns.pop()
