"""Code: instructions in one list with jumps, the frame in which they run, and their assembly from a program's text.

The assembly takes statements in the order of the text, and resolves blocks and labels to jumps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, NamedTuple, TypeVar

from gantrysim.base.errors import InputError

STATEMENT = "statement"  # kind of statement with no time of its own
MOST_RETURNS = 256  # nested GOSUBs

FrameType = TypeVar("FrameType", bound="Frame")
Act = Callable[[FrameType], int | None]

# the words that end the blocks of a program's text
ENDS = {"IF": "ENDIF", "WHILE": "WEND", "REPEAT": "UNTIL", "FOR": "NEXT", "DO": "LOOP"}


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


@dataclass
class OpenBlock:
    """A block of which the end is not reached yet.

    Attributes:
        kind: its keyword.
        line: at which it begins.
        first: index of its first instruction.
        past: where its test jumps to, past its branch; None where nothing does.
        exits: targets of the jumps to its end.
        variable: of a FOR loop.
    """

    kind: str
    line: int
    first: int
    past: Target | None = None
    exits: list[Target] = field(default_factory=list)
    variable: str = ""


Condition = Callable[[FrameType], object]


class Assembler(Generic[FrameType]):
    """Assembles code.

    Blocks end as they begin, in the order of the text, whatever the syntax that a dialect has for them: it may read
    line by line, or walk a tree. Parts of a statement that cost nothing have the cost None.

    Attributes:
        code: the instructions so far.
    """

    def __init__(self) -> None:
        self.code: Code[FrameType] = []
        self._blocks: list[OpenBlock] = []
        self._labels: dict[str, int] = {}
        self._jumps: list[tuple[str, int, Target]] = []

    @property
    def here(self) -> int:
        """Index of the instruction that comes next."""
        return len(self.code)

    def emit(self, line: int, act: Act[FrameType], cost: str | None = STATEMENT, pure: bool = False) -> None:
        """Add an instruction."""
        self.code.append(Instruction(line, act, cost, pure))

    def jump(self, line: int, cost: str | None = STATEMENT) -> Target:
        """Add a jump and return its target, to be filled in."""
        target = Target()
        self.emit(line, lambda frame: target.index, cost, pure=True)
        return target

    def test(self, line: int, condition: Condition[FrameType], cost: str | None = STATEMENT) -> Target:
        """Add an instruction that jumps where a condition is false; return its target, to be filled in."""
        target = Target()
        self.emit(line, lambda frame: None if condition(frame) else target.index, cost, pure=True)
        return target

    def finish(self) -> Code[FrameType]:
        """Return the code.

        Raises:
            InputError: a block without its end, or a label that stands nowhere.
        """
        if self._blocks:
            block = self._blocks[-1]
            raise InputError(f"line {block.line}: {block.kind} without its {ENDS[block.kind]}")
        for name, line, target in self._jumps:
            if name not in self._labels:
                raise InputError(f"line {line}: label {name}: must stand before a colon at the start of a line")
            target.index = self._labels[name]
        return self.code

    # blocks

    def close(self, word: str, *kinds: str) -> OpenBlock:
        """Return the innermost block, which a word ends.

        Raises:
            InputError: it is of another kind, or there is none.
        """
        if not self._blocks or self._blocks[-1].kind not in kinds:
            inside = f" inside the {self._blocks[-1].kind} of line {self._blocks[-1].line}" if self._blocks else ""
            raise InputError(f"{word} without {' or '.join(kinds)}{inside}")
        return self._blocks.pop()

    def is_inside(self, kind: str) -> bool:
        """Whether the innermost open block is of a kind."""
        return bool(self._blocks) and self._blocks[-1].kind == kind

    def begin_if(self, line: int, condition: Condition[FrameType]) -> None:
        """Begin the branch of an IF."""
        first = self.here
        self._blocks.append(OpenBlock("IF", line, first, self.test(line, condition)))

    def begin_elseif(self, line: int, condition: Condition[FrameType], cost: str | None = STATEMENT) -> None:
        """End a branch and begin the next."""
        block = self._end_branch("ELSEIF", line)
        block.past = self.test(line, condition, cost)

    def begin_else(self, line: int) -> None:
        """End a branch and begin the last, which is run where no condition holds."""
        self._end_branch("ELSE", line)

    def _end_branch(self, word: str, line: int) -> OpenBlock:
        block = self.close(word, "IF")
        if block.past is None:
            raise InputError(f"{word} after the ELSE of the IF of line {block.line}")
        block.exits.append(self.jump(line, None))
        block.past.index = self.here
        block.past = None
        self._blocks.append(block)
        return block

    def end_if(self) -> None:
        """End an IF."""
        block = self.close("ENDIF", "IF")
        for target in (*block.exits, block.past):
            if target is not None:
                target.index = self.here

    def begin_while(self, line: int, condition: Condition[FrameType]) -> None:
        """Begin a loop that is tested before each pass."""
        first = self.here
        self._blocks.append(OpenBlock("WHILE", line, first, self.test(line, condition)))

    def end_while(self, line: int) -> None:
        """End a loop that is tested before each pass."""
        block = self.close("WEND", "WHILE")
        self.jump(line).index = block.first
        if block.past is not None:
            block.past.index = self.here

    def test_again(self, line: int, condition: Condition[FrameType]) -> None:
        """End a loop that is tested before each pass, where its end is no statement: the test stands here again."""
        block = self.close("WEND", "WHILE")
        body = block.first + 1
        self.emit(line, lambda frame: body if condition(frame) else None, pure=True)
        if block.past is not None:
            block.past.index = self.here

    def begin_repeat(self, line: int) -> None:
        """Begin a loop that is tested after each pass."""
        self._blocks.append(OpenBlock("REPEAT", line, self.here))

    def end_repeat(self, line: int, condition: Condition[FrameType]) -> None:
        """End a loop that goes on until a condition holds."""
        again = self.test(line, condition)
        again.index = self.close("UNTIL", "REPEAT").first

    def begin_do(self, line: int, condition: Condition[FrameType] | None = None) -> None:
        """Begin a loop that is tested before each pass, or not there."""
        first = self.here
        if condition is None:
            self.jump(line).index = first + 1
            self._blocks.append(OpenBlock("DO", line, first))
        else:
            self._blocks.append(OpenBlock("DO", line, first, self.test(line, condition)))

    def end_do(self, line: int, until: Condition[FrameType] | None = None) -> None:
        """End a loop of DO: go on until a condition holds, or for ever."""
        block = self.close("LOOP", "DO")
        again = self.jump(line) if until is None else self.test(line, until)
        again.index = block.first
        if block.past is not None:
            block.past.index = self.here

    def begin_for(self, line: int, variable: str, start: Callable[[FrameType], ForLoop]) -> None:
        """Begin a FOR loop.

        Args:
            line: of the text.
            variable: name of its variable.
            start: sets the variable to its first value.
        """
        key = self.here
        past = Target()

        def act(frame: FrameType) -> int | None:
            loop = start(frame)
            frame.loops[key] = loop
            return None if loop.inside else past.index

        self.emit(line, act)
        self._blocks.append(OpenBlock("FOR", line, key, past, variable=variable))

    def end_for(self, line: int, block: OpenBlock) -> None:
        """End a FOR loop, given its block."""
        key = block.first

        def act(frame: FrameType) -> int | None:
            if key not in frame.loops:
                raise InputError(f"NEXT without having run the FOR of line {block.line}")
            loop = frame.loops[key]
            loop.assign(loop.value() + loop.step)
            return key + 1 if loop.inside else None

        self.emit(line, act)
        if block.past is not None:
            block.past.index = self.here

    def select(self, line: int, choice: Callable[[FrameType], int], branches: Sequence[Callable[[], None]]) -> None:
        """Add branches of which one is run.

        Args:
            line: of the text.
            choice: index of the branch; one that there is not runs none.
            branches: each adds its statements.
        """
        targets: dict[int, Target] = {}
        self._choose(line, choice, targets, lambda frame, index: index)
        skip = self.jump(line, None)
        exits = [skip]
        for k, branch in enumerate(branches):
            targets[k] = Target(self.here)
            branch()
            exits.append(self.jump(line, None))
        for target in exits:
            target.index = self.here

    # labels and jumps

    def label(self, name: str) -> None:
        """Name the instruction that comes next.

        Raises:
            InputError: the label stands in two places.
        """
        if name in self._labels:
            raise InputError(f"label {name}: stands in two places, must be in one")
        self._labels[name] = self.here

    def goto(self, line: int, label: str) -> None:
        """Jump to a label."""
        target = self._label_target(line, label)
        self.emit(line, lambda frame: target.index, pure=True)

    def gosub(self, line: int, label: str) -> None:
        """Call the subroutine at a label."""
        after = self.here + 1
        target = self._label_target(line, label)
        self.emit(line, lambda frame: frame.call(after, target.index))

    def on_error(self, line: int, label: str) -> None:
        """Name the label at which the task goes on after an error."""
        target = self._label_target(line, label)
        self.emit(line, lambda frame: frame.watch(target.index))

    def leave(self, line: int) -> None:
        """Return from a subroutine."""
        self.emit(line, lambda frame: frame.leave())

    def goto_one_of(self, line: int, choice: Callable[[FrameType], int], labels: Sequence[str]) -> None:
        """Jump to the label of a number from 1 on, to none where it has none."""
        self._choose(line, choice, self._label_targets(line, labels), lambda frame, index: index)

    def gosub_one_of(self, line: int, choice: Callable[[FrameType], int], labels: Sequence[str]) -> None:
        """Call the subroutine at the label of a number from 1 on, none where it has none."""
        after = self.here + 1
        self._choose(line, choice, self._label_targets(line, labels), lambda frame, index: frame.call(after, index))

    def _choose(
        self,
        line: int,
        choice: Callable[[FrameType], int],
        targets: dict[int, Target],
        jump: Callable[[FrameType, int], int],
    ) -> None:
        def act(frame: FrameType) -> int | None:
            target = targets.get(choice(frame))
            return None if target is None else jump(frame, target.index)

        self.emit(line, act)

    def _label_target(self, line: int, label: str) -> Target:
        """Return the target that a label of a line stands for, known at the end."""
        target = Target()
        self._jumps.append((label.upper(), line, target))
        return target

    def _label_targets(self, line: int, labels: Sequence[str]) -> dict[int, Target]:
        return {k: self._label_target(line, label) for k, label in enumerate(labels, 1)}
