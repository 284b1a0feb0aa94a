"""The order in which blocks run: subprograms, macro variables, branches and loops.

Variables are local to a call (#1 to #33) or common; a word whose value is a variable that was never set is left out.
"""

from __future__ import annotations

import math
import re
from bisect import bisect_right
from collections.abc import Callable, Hashable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TypeVar

from gantrysim.base.errors import InputError
from gantrysim.controllers.fanuc.alarm import Alarm, BlockSource
from gantrysim.controllers.fanuc.blocks import COMMENT, CORNERS, LETTERS, OF_FILE, Words, labelled_block, words_of
from gantrysim.controllers.macro.order import END, Flow, FlowRefusal
from gantrysim.controllers.macro.scanner import (
    FUNCTIONS,
    OPERATORS,
    SHORT_WORD,
    Grammar,
    Scanner,
    rounded_from_zero,
    rounded_to_zero,
)
from gantrysim.controllers.macro.variables import LocalParameters, Numbering, Parameters, System

# Blocks of letters with variables and expressions.

GRAMMAR = Grammar(
    OPERATORS, {**FUNCTIONS, "FIX": rounded_to_zero, "FUP": rounded_from_zero}, one_tangent=True, shortened=True
)
_ARGUMENT_LETTERS = "EUVW"  # which only a call has, for its arguments
_VARIABLE = re.compile(r"#([0-9]+)")


def computed_words(text: str, source: BlockSource, variables: Parameters) -> Words:
    """Return the words of a block without spaces, with the values that they have now.

    Raises:
        Alarm: an invalid word.
        InputError: an invalid value.
    """
    codes: list[float] = []
    auxiliary: list[float] = []
    values: dict[str, float] = {}
    for letter, number in list(_numbers(text, source, variables)):
        if letter == "G":
            codes.append(number)
        elif letter == "M":
            auxiliary.append(number)
        elif letter in values:
            raise source.fail(9, f"address {letter} is given twice in the block")
        else:
            values[letter] = number
    for letter in "NO":
        values.pop(letter, None)
    return Words(source.name, source.line, tuple(codes), tuple(auxiliary), values)


def _numbers(text: str, source: BlockSource, variables: Parameters) -> Iterator[tuple[str, float]]:
    """The letters of a block and their values, without those of variables that were never set."""
    scanner = Scanner(text, GRAMMAR)
    while scanner.remaining:
        comma = "," if scanner.take(",") else ""
        letter = scanner.remaining[:1]
        if comma and comma + letter not in CORNERS:
            raise source.fail(9, f"',{letter}': a comma must stand before R or C")
        if letter not in LETTERS + _ARGUMENT_LETTERS:
            raise source.fail(9, f"address {letter!r}: must be one of {', '.join(LETTERS)}")
        scanner.take(letter)
        start = scanner.position
        value = scanner.value(letter)
        variable = _VARIABLE.fullmatch(text, start, scanner.position)
        if variable and variables.vacant(float(variable[1])):
            continue
        number = value(variables)
        if not math.isfinite(number):
            raise InputError(f"{letter} = {number:g}: must be finite")
        yield comma + letter, number


# The texts of a program and its subprograms as one sequence of blocks, with the places of the programs.

MOST_DIGITS = 20  # of a block's or program's number
_PROGRAM = re.compile(r"(?:N[0-9]+)?O([0-9]+)")
_FILE_NUMBER = re.compile(r"O?([0-9]+)", re.IGNORECASE)


@dataclass(frozen=True)
class ProgramSource:
    """A program and how it is read.

    Attributes:
        text: the program, with subprograms.
        subprograms: texts in files of their own, by file name without its suffix.
        skip: whether blocks that begin with a slash are skipped.
        most_steps: blocks that may run.
    """

    text: str
    subprograms: Mapping[str, str] = field(default_factory=dict)
    skip: bool = False
    most_steps: int = 1_000_000


@dataclass(frozen=True)
class ProgramBlock(BlockSource):
    """A block, in capitals and without comments; line 0 in a file of subprograms, whose line its name then has."""

    text: str


class ProgramBlocks:
    """The blocks of a program and its subprograms.

    Args:
        source: their texts.

    Attributes:
        blocks: in their order, those of files of their own at the end.
        files: places of the first blocks of files of subprograms, by name, in order.
        programs: places of the blocks with the number of a program, by that number.
    """

    def __init__(self, source: ProgramSource) -> None:
        self.blocks: list[ProgramBlock] = []
        self.programs: dict[int, int] = {}
        self.files: dict[str, int] = {}
        self._skip = source.skip
        self._add(source.text)
        for name, text in source.subprograms.items():
            self.files[name] = len(self.blocks)
            number = _FILE_NUMBER.fullmatch(name.strip())
            if number and not _begins_with_number(text):
                # a call enters the block after the number
                self._add_block(f"O{number[1]}", BlockSource(f"block 0{OF_FILE}{name}", 0))
            self._add(text, name)

    def _add(self, text: str, file: str = "") -> None:
        """Add the blocks of a text, which may be that of a file of subprograms."""
        first = len(self.blocks)
        for line, written in enumerate(text.splitlines(), 1):
            for plain in _plain_blocks(written):
                if plain.startswith("/") and self._skip:
                    continue
                name = f"block {len(self.blocks) - first + 1}"
                place = BlockSource(f"{name}{OF_FILE}{file}, line {line}", 0) if file else BlockSource(name, line)
                self._add_block(plain.removeprefix("/").lstrip(), place)

    def _add_block(self, text: str, place: BlockSource) -> None:
        program = _PROGRAM.match("".join(text.split()))
        if program:
            self.programs.setdefault(block_number(program[1]), len(self.blocks))
        self.blocks.append(ProgramBlock(place.name, place.line, text))


def _plain_blocks(line: str) -> list[str]:
    """Return the blocks of a line, in capitals and without comments."""
    parts = (part.strip().upper() for part in re.sub(COMMENT, " ", line).split(";"))
    return [part for part in parts if part and not part.startswith("%")]


def _begins_with_number(text: str) -> bool:
    """Return whether the first block of a text has the number of a program."""
    for line in text.splitlines():
        for plain in _plain_blocks(line):
            return _PROGRAM.match("".join(plain.split())) is not None
    return False


def block_number(digits: str) -> int:
    """Return the number of a block or program; one of more digits than Python reads is that of no other."""
    return int(digits) if len(digits) <= MOST_DIGITS else -1


_NUMBERING = Numbering(local=33, highest=9999)
_ALARMS = {FlowRefusal.STEPS: 114, FlowRefusal.DEPTH: 77, FlowRefusal.UNMATCHED: 124}
_MACRO = re.compile(r"[#\[=]|^(?:N\s*[0-9]+\s*)?(?:IF|WH|GO|DO|EN|G\s*0*65(?![0-9.]))")
_LABEL = re.compile(r"N\s*([0-9]+)")
_LOOP = re.compile(r"(DO|END?)([1-3])$")
# letters of a call's arguments and their variables
_ARGUMENTS = dict(zip("ABCIJKDEFHMQRSTUVWXYZ", (1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 13, *range(17, 27)), strict=True))

Executed = tuple[int, Words | None]  # the next place, and the words of the block, if any
ControlHandler = Callable[["Sequence", Scanner], int | None]
CallHandler = Callable[["Sequence", Words], Executed]
Control = TypeVar("Control", bound=ControlHandler)
_CONTROLS: dict[str, ControlHandler] = {}  # by the word with which a block begins, the whole one before its short form
ENDS = frozenset({"M02", "M30"})  # codes that end the program
CALLS: dict[str, CallHandler] = {}  # by the code, in the order of their precedence


def control(word: str) -> Callable[[Control], Control]:
    """Add a method as what a block does that begins with a word, or with the first two letters of it.

    It returns None where the block is no such one.
    """

    def add(handler: Control) -> Control:
        _CONTROLS[word] = handler
        _CONTROLS.setdefault(word[:SHORT_WORD], handler)
        return handler

    return add


def call(handler: CallHandler) -> CallHandler:
    """Add a method `m98` as what a block with M98 does."""
    CALLS[handler.__name__.upper()] = handler
    return handler


class Sequence(Flow[Words]):
    """Runs the blocks of a text in their order.

    Args:
        source: texts, and how they are read.
        system: variables that the controller provides.
    """

    def __init__(self, source: ProgramSource, system: System) -> None:
        super().__init__(Parameters(system, _NUMBERING), source.most_steps, "blocks")
        text = ProgramBlocks(source)
        self._blocks = text.blocks
        self._programs = text.programs
        self._files = text.files
        self._starts = sorted({0, *self._programs.values()})
        self._source: BlockSource = BlockSource("block 1", 0)
        self._mark_labels()

    def _mark_labels(self) -> None:
        """Note block numbers and the ends of loops, each in its program of the text."""
        for place, block in enumerate(self._blocks):
            label = _LABEL.match(block.text)
            if label and len(label[1]) <= MOST_DIGITS:
                self.places.mark((self._program_at(place), block_number(label[1])), "N", place)
            loop = _LOOP.search("".join(block.text.split()))
            if loop:
                word = "DO" if loop[1] == "DO" else "END"
                self.places.mark((self._program_at(place), loop[2]), word, place)

    def _program_at(self, place: int) -> int:
        """First block of the program that a block belongs to."""
        return self._starts[bisect_right(self._starts, place) - 1]

    @property
    def called_files(self) -> frozenset[str]:
        """Names of the files whose subprograms were called."""
        names = list(self._files)
        firsts = list(self._files.values())
        counts = [bisect_right(firsts, place) for place in self.entered]
        return frozenset(names[count - 1] for count in counts if count)

    def has(self, pattern: str) -> bool:
        """Return whether a pattern occurs in a block."""
        return any(re.search(pattern, block.text) for block in self._blocks)

    def runs(self, place: int) -> bool:
        if place >= len(self._blocks):
            return False
        # the main program ends where another begins
        return self.depth > 0 or place == 0 or place not in self._starts

    def refusal(self, fault: FlowRefusal, detail: str) -> Alarm:
        # the step that is too many has not begun: the source is still that of the step before
        source = self._blocks[self.place] if fault is FlowRefusal.STEPS else self._source
        return source.fail(_ALARMS[fault], detail)

    def unmatched(self, label: Hashable, words: tuple[str, ...], ahead: bool) -> Alarm:
        assert isinstance(label, tuple)
        detail = f"{words[0]}{label[1]}: must be in the program, to match this block"
        return self.refusal(FlowRefusal.UNMATCHED, detail)

    def execute(self) -> Executed:
        block = self._blocks[self.place]
        self._source = block
        try:
            following, words = self._execute(block)
        except Alarm:
            raise
        except (InputError, OverflowError) as error:
            raise block.fail(114, str(error)) from None
        if words is None:
            return following, None
        if not ENDS.isdisjoint(words.names):
            following = END
        return following, words if words.names or words.values else None

    def _execute(self, block: ProgramBlock) -> Executed:
        if not _MACRO.search(block.text):
            return self._call_or_return(words_of(block.text, block.name, block.line))
        label = _LABEL.match(block.text)
        compact = "".join(block.text[label.end() if label else 0 :].split())
        self._source = BlockSource(labelled_block(block.name, label[1]) if label else block.name, block.line)
        for word, handler in _CONTROLS.items():
            if compact.startswith(word):
                scanner = Scanner(compact, GRAMMAR)
                scanner.take(word)
                following = handler(self, scanner)
                if following is not None:
                    return following, None
        return self._call_or_return(computed_words(compact, self._source, self.parameters))

    @control("IF")
    def jump_or_assign_if(self, scanner: Scanner) -> int:
        """IF with GOTO, or with THEN and an assignment."""
        holds = scanner.value("IF")(self.parameters)
        if scanner.take("GOTO") or scanner.take("GO"):
            return self.jump(scanner) if holds else self.following
        if not (scanner.take("THEN#") or scanner.take("TH#")):
            raise self._source.fail(114, "IF: must be followed by GOTO or by THEN and an assignment")
        return self.assign(scanner) if holds else self.following

    @control("GOTO")
    def jump(self, scanner: Scanner) -> int:
        """To the block with a number."""
        number = scanner.value("GOTO")(self.parameters)
        return self._label_position(self._program_at(self.place), number)

    @control("WHILE")
    def begin_while(self, scanner: Scanner) -> int:
        """WHILE with DO1 to DO3."""
        holds = scanner.value("WHILE")(self.parameters)
        loop = re.fullmatch("DO([1-3])", scanner.remaining)
        if not loop:
            raise self._source.fail(114, "WHILE: must be followed by DO1, DO2 or DO3")
        return self.enter_loop(bool(holds), (self._program_at(self.place), loop[1]), "END")

    @control("DO")
    def begin_loop(self, scanner: Scanner) -> int | None:
        """DO1 to DO3 without a condition."""
        if not _is_loop(scanner.remaining):
            return None
        # its end, without which the controller does not run it
        self.ahead((self._program_at(self.place), scanner.remaining), ("END",))
        return self.following

    @control("END")
    def end_loop(self, scanner: Scanner) -> int | None:
        """END1 to END3: back to the head of the loop."""
        if not _is_loop(scanner.remaining):
            return None
        return self.behind((self._program_at(self.place), scanner.remaining), ("DO",))

    @control("#")
    def assign(self, scanner: Scanner) -> int:
        """Set a variable."""
        target = scanner.target()
        if not scanner.take("="):
            raise InputError(f"{scanner.quoted_rest}: an assignment must have = after the variable")
        value = scanner.expression("=")
        if scanner.remaining:
            raise InputError(f"{scanner.quoted_rest}: must be an operator or the end of the block")
        self.parameters.set(target, value(self.parameters))
        return self.following

    def _label_position(self, program: int, number: float) -> int:
        place = self.places.first((program, number), "N")
        if place is None:
            raise self._source.fail(78, f"N{number:g}: must be a block of the program")
        return place

    def _call_or_return(self, words: Words) -> Executed:
        """Enter or leave a subprogram."""
        for name, handler in CALLS.items():
            if name in words.names:
                return handler(self, words)
        return self.following, words

    @call
    def g65(self, words: Words) -> Executed:
        """Call a subprogram with its arguments as local variables."""
        start = self._enter_subprogram(words)
        if start is None:
            return self.following, None
        numbers = {_ARGUMENTS[letter]: value for letter, value in words.values.items() if letter in _ARGUMENTS}
        self.parameters.scope = LocalParameters(numbers)
        return start, None

    @call
    def m98(self, words: Words) -> Executed:
        """Call a subprogram; the other words of the block are run before it."""
        start = self._enter_subprogram(words)
        if start is None:
            return self.following, None
        for letter in "PL":
            words.values.pop(letter, None)
        return start, words

    def _enter_subprogram(self, words: Words) -> int | None:
        """Call the subprogram P, L times, and return its first place; None for no repetition.

        P may also give the repetitions, before the last four digits, which are the number.
        """
        values = words.values
        if "P" not in values:
            raise words.fail(76, "a call must have the number of the subprogram, P")
        for letter, value in values.items():
            if letter in "PL" and (value < 0 or value != int(value)):
                raise words.fail(9, f"{letter}{value:g} of a call: must be a whole number of at least 0")
        times, number = divmod(int(values["P"]), 10000)
        times = int(values.get("L", times or 1))
        if number not in self._programs:
            known = ", ".join(f"O{known}" for known in sorted(self._programs)) or "none"
            raise words.fail(78, f"O{number}: must be one of the text's programs, {known}")
        self._source = words
        self.check_depth()
        return self.enter(self._programs[number] + 1, times) if times >= 1 else None

    @call
    def m99(self, words: Words) -> Executed:
        """Return from a subprogram, to the block P if given; the end of the main program.

        The other words of the block are run before it, as in `X100.0 Y100.0 M99` or `G90 M99`.
        """
        if not self.depth:
            return END, words
        back = self.calls[-1].back
        depth = self.depth
        following = self.end_repetition()
        words.values.pop("L", None)
        number = words.values.pop("P", None)
        if self.depth < depth and number is not None:
            self._source = words
            return self._label_position(self._program_at(back - 1), number), words
        return following, words


def _is_loop(digit: str) -> bool:
    return re.fullmatch("[1-3]", digit) is not None
