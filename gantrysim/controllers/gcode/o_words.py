"""What the lines of a program do to its order: O words, subroutines, loops, M98 and M99."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Hashable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import NamedTuple

from gantrysim.base.errors import InputError, unknown, whole_number
from gantrysim.controllers.gcode.lines import (
    FirmwareCommand,
    Keywords,
    ParsedLine,
    Words,
    compact,
    label_of,
    plain_line,
    plain_words,
    read_firmware,
    sender_command,
    statement,
)
from gantrysim.controllers.macro.order import END, Flow, FlowRefusal
from gantrysim.controllers.macro.variables import LocalParameters, Numbering, Parameters, System

# The texts of a program and its subprograms as one sequence of lines, in which O words are looked up.

NUMBERING = Numbering(local=30, highest=5602)
_O_LINE = re.compile(
    r"^[^\S\n]*(?:/[^\S\n]*)?(?:[nN][^\S\n]*[0-9.]+[^\S\n]*)?(?:\([^()\n]*\)[^\S\n]*)*[oO].*", re.MULTILINE
)


@dataclass(frozen=True)
class ProgramText:
    """A program and how it is read.

    Attributes:
        main: text of the program.
        subprograms: texts in files of their own, by name.
        max_steps: most lines that may run.
        block_skip: whether lines that begin with a slash are skipped.
        firmware: whether lines are read as printers' firmware reads them.
    """

    main: str
    subprograms: Mapping[str, str] = field(default_factory=dict)
    max_steps: int = 10_000_000
    block_skip: bool = False
    firmware: bool = False


class ProgramLines(Flow[Words | FirmwareCommand]):
    """The lines of a program and its subprograms; a subclass says what a line does.

    Args:
        program: its text.
        system: parameters that the controller provides.
        subprogram_ends: called with the depth of a subroutine that ends.
        keywords: of O words.
    """

    def __init__(
        self, program: ProgramText, system: System, subprogram_ends: Callable[[int], None], keywords: Keywords
    ) -> None:
        super().__init__(Parameters(system, NUMBERING), program.max_steps, "lines")
        self.program = program
        self._subprogram_ends = subprogram_ends
        self.lines = program.main.splitlines()
        self.main_lines = len(self.lines)
        self._keywords = keywords
        self._files: list[tuple[int, str]] = []
        self._mark_o_words(program.main, 0)
        for name, text in program.subprograms.items():
            first = len(self.lines)
            self._files.append((first, name))
            self.lines += text.splitlines()
            self._mark_o_words(text, first)

    def _mark_o_words(self, text: str, first: int) -> None:
        """Note the O words of a file whose lines begin at a place."""
        # most programs: one search of the text instead of one of each line
        if not _O_LINE.search(text):
            return
        for place, line in enumerate(text.splitlines(), first):
            if "o" in line or "O" in line:
                # raised again where the line is run
                with suppress(InputError):
                    plain = compact(line).lstrip("/")
                    mark = label_of(plain, self._keywords) if re.match(r"(N[0-9.]+)?O", plain) else None
                    if mark:
                        self.places.mark(*mark, place)

    @property
    def line(self) -> int:
        """The main program's line that runs or has called the one that runs, from 1."""
        place = self.place
        calls = len(self.calls)
        while place >= self.main_lines:
            calls -= 1
            place = self.calls[calls].back - 1
        return place + 1

    @property
    def where(self) -> str:
        """The line that runs, in words."""
        started = self._file_at(self.place)
        if started is None:
            return f"line {self.place + 1}"
        return f"line {self._line_of(self.place)} of {started[1]}"

    @property
    def called_files(self) -> frozenset[str]:
        """Names of the files whose subprograms were called."""
        return frozenset(file[1] for file in map(self._file_at, self.entered) if file is not None)

    def _line_of(self, place: int) -> int:
        """Return the number of a line in its file, from 1."""
        started = self._file_at(place)
        return place + 1 - (started[0] if started else 0)

    def _file_at(self, place: int) -> tuple[int, str] | None:
        """Return the first place and the name of the file of a line, None for the main program."""
        started = [file for file in self._files if file[0] <= place]
        return started[-1] if started else None

    def runs(self, place: int) -> bool:
        return place < (len(self.lines) if len(self.calls) > 1 else self.main_lines)

    def refusal(self, fault: FlowRefusal, detail: str) -> InputError:
        return InputError(detail)

    def unmatched(self, label: Hashable, words: tuple[str, ...], ahead: bool) -> InputError:
        follow = "be followed by" if ahead else "follow"
        return InputError(f"O word {label}: must {follow} {' or '.join(words).lower()} with the same label")

    def subprogram_ends(self) -> None:
        self._subprogram_ends(self.depth)

    def m98(self, values: dict[str, float]) -> int:
        """Call a subprogram by its number; the caller's parameters stay in force."""
        if "P" not in values:
            raise InputError("M98 without P: must have the number of a subprogram")
        number = whole_number("M98 P", values["P"], 0)
        times = whole_number("M98 L", values.get("L", 1), 0)
        if times < 1:
            return self.following
        return self.enter(self.start_of(str(number), ""), times)

    def start_of(self, name: str, keyword: str) -> int:
        """Return the first place of a subprogram that begins with a keyword."""
        self.check_depth()
        head = self.places.first(name, keyword)
        if head is None:
            raise unknown("subprogram", name, [str(label) for label in self.places.labels(keyword)])
        return head + 1


_ARGUMENTS = NUMBERING.local  # a call sets all local parameters

# what ends a branch or loop

_ENDS = {"IF": "ENDIF", "WHILE": "ENDWHILE", "DO": "WHILE", "REPEAT": "ENDREPEAT"}


class _Begun(NamedTuple):
    """A branch or loop that has begun: its first word, and where that stands."""

    keyword: str
    place: int


Handler = Callable[["ProgramFlow", ParsedLine, str], int]
_HANDLERS: dict[str, Handler] = {}  # by the keyword
_CONDITIONS: set[str] = set()


def o_word(handler: Handler) -> Handler:
    """Add a method `o_call` as what CALL does; it takes the statement and its label, and returns the next place."""
    _HANDLERS[_keyword(handler)] = handler
    return handler


def o_condition(handler: Handler) -> Handler:
    """Add a method as what a keyword with one value in brackets does."""
    _CONDITIONS.add(_keyword(handler))
    return o_word(handler)


def _keyword(handler: Handler) -> str:
    return handler.__name__.removeprefix("o_").upper()


class ProgramFlow(ProgramLines):
    """Runs the lines of a program in their order.

    Args:
        program: its text.
        system: parameters that the controller provides.
        subprogram_ends: called with the depth of a subroutine that ends.

    Attributes:
        unclosed: notes on the branches and loops that ran without an end.
    """

    def __init__(self, program: ProgramText, system: System, subprogram_ends: Callable[[int], None]) -> None:
        super().__init__(program, system, subprogram_ends, KEYWORDS)
        self.unclosed: list[str] = []
        self._statements: dict[int, ParsedLine] = {}  # by their places
        # the branches and loops that have begun, by the subroutine's start and the label
        self._begun: dict[tuple[int, str], _Begun] = {}
        # places at which subroutines were met or called, by their labels
        self._subroutines: dict[str, int] = {}
        # whether a line of % has run
        self._delimited = False

    def execute(self) -> tuple[int, Words | FirmwareCommand | None]:
        line = self.lines[self.place]
        words = plain_line(line)
        if words is not None:
            return self.place + 1, words
        if self.program.firmware:
            read = read_firmware(line)
            if isinstance(read, FirmwareCommand):
                return self.following, read
            text = read
        else:
            text = compact(line)
        if text[:1] == "/":
            if self.program.block_skip:
                return self.following, None
            text = text[1:]
        if not text:
            return self.following, None
        command = sender_command(text)
        if command is not None:
            return self.following, command
        if text[0] == "%":
            # the second delimiter ends the program; files of subprograms have their own
            ends = self._delimited and self.place < self.main_lines
            self._delimited = True
            return END if ends else self.following, None
        words = plain_words(text)
        if words is None or "O" in text:
            parsed = self._statements.get(self.place)
            if parsed is None:
                parsed = statement(text, KEYWORDS)
                self._statements[self.place] = parsed
            if parsed.label is not None:
                return self._place_of_o_word(parsed), None
            words = self._words_of_assignment(parsed)
        if "M" in text:
            following = self._place_of_call(words)
            if following is not None:
                return following, [word for word in words if word[0] not in "MPLN"]
        return self.following, words or None

    def _words_of_assignment(self, read: ParsedLine) -> Words:
        """Return the words of a line, and then set its parameters: it reads the values from before."""
        words = read.evaluated(self.parameters)
        values = [value(self.parameters) for _, value in read.settings]
        for (target, _), value in zip(read.settings, values, strict=True):
            self.parameters.set(target, value)
        return words

    def _place_of_call(self, words: Words) -> int | None:
        """Return the place that follows M98 or M99; None for other lines."""
        codes = [value for letter, value in words if letter == "M"]
        if 98.0 in codes:
            return self.m98({letter: value for letter, value in words if letter in "PL"})
        if 99.0 in codes:
            return self.end_repetition() if self.depth else END
        return None

    def _place_of_o_word(self, read: ParsedLine) -> int:
        """Run an O word; return the place that follows."""
        label = read.label
        assert label is not None
        key = label if isinstance(label, str) else str(_whole("label", label(self.parameters)))
        # a label without a keyword begins a subprogram of M98
        return _HANDLERS[read.keyword](self, read, key) if read.keyword else self.following

    def _first_argument(self, read: ParsedLine) -> float:
        return read.arguments[0](self.parameters)

    def _begin(self, label: str, keyword: str) -> None:
        """Note that a branch or loop begins, whose label no other one of its subroutine may have."""
        key = (self.calls[-1].start, label)
        begun = self._begun.get(key)
        if begun is None:
            self._begun[key] = _Begun(keyword, self.place)
            self._note_unclosed(label, keyword)
        elif begun.place != self.place:
            raise InputError(
                f"{keyword.lower()} of {label}: must have a label of its own, as LinuxCNC finds the end by it; "
                f"{begun.keyword.lower()} in line {self._line_of(begun.place)} has this one"
            )

    def _note_unclosed(self, label: str, keyword: str) -> None:
        end = _ENDS[keyword]
        if self.places.next(label, (end,), self.place) is None:
            runs = "as its branch" if keyword == "IF" else "once"
            self.unclosed.append(
                f"{keyword.lower()} of {label} in {self.where} has no {end.lower()}: as in LinuxCNC, all that follows "
                f"runs {runs}."
            )

    def _inside(self, label: str, keyword: str, owners: tuple[str, ...]) -> None:
        """Raise InputError unless one of the owners, with this label, has begun."""
        begun = self._begun.get((self.calls[-1].start, label))
        if begun is None or begun.keyword not in owners:
            raise InputError(f"{keyword} of {label}: must follow {' or '.join(owners).lower()} with the same label")

    @o_word
    def o_sub(self, read: ParsedLine, label: str) -> int:
        """A subroutine that is met on the way, not called, is passed over."""
        met = self._subroutines.setdefault(label, self.place)
        if met != self.place:
            raise InputError(
                f"sub of {label}: must be the only one of its name, and stand before its first call or behind the end "
                f"of the program; line {self._line_of(met)} comes first"
            )
        return self.ahead(label, ("ENDSUB",)) + 1

    @o_word
    def o_endsub(self, read: ParsedLine, label: str) -> int:
        if not self.depth:
            raise InputError(f"endsub of {label}: must be in a subroutine that was called")
        return self._place_of_return(read)

    @o_word
    def o_return(self, read: ParsedLine, label: str) -> int:
        if not self.depth:
            raise InputError(f"return of {label}: must be in a subroutine that was called")
        return self._place_of_return(read)

    def _place_of_return(self, read: ParsedLine) -> int:
        """Return from a subroutine with its value, which the caller reads as #<_value>."""
        value = self._first_argument(read) if read.arguments else 0.0
        following = self.leave()
        self.parameters.set("_value", value)
        self.parameters.set("_value_returned", float(bool(read.arguments)))
        return following

    @o_word
    def o_call(self, read: ParsedLine, label: str) -> int:
        values = [value(self.parameters) for value in read.arguments]
        if len(values) > _ARGUMENTS:
            raise InputError(f"call with {len(values)} arguments: must be at most {_ARGUMENTS}")
        self._subroutines.setdefault(label, self.place)
        start = self.enter(self.start_of(label, "SUB"))
        values += [0.0] * (_ARGUMENTS - len(values))
        self.parameters.scope = LocalParameters(dict(enumerate(values, 1)))
        return start

    @o_condition
    def o_if(self, read: ParsedLine, label: str) -> int:
        """Go to the first branch whose condition holds."""
        self._begin(label, "IF")
        place = self.place
        holds = bool(self._first_argument(read))
        while not holds:
            place = self.ahead(label, ("ELSEIF", "ELSE", "ENDIF"), place)
            branch = self._statements.get(place) or statement(compact(self.lines[place]).lstrip("/"), KEYWORDS)
            self._statements[place] = branch
            holds = branch.keyword != "ELSEIF" or bool(self._first_argument(branch))
        return place + 1

    @o_condition
    def o_elseif(self, read: ParsedLine, label: str) -> int:
        """Met at the end of a branch that was taken."""
        self._inside(label, "elseif", ("IF",))
        return self.ahead(label, ("ENDIF",)) + 1

    @o_word
    def o_else(self, read: ParsedLine, label: str) -> int:
        """Met at the end of a branch that was taken."""
        self._inside(label, "else", ("IF",))
        return self.ahead(label, ("ENDIF",)) + 1

    @o_word
    def o_endif(self, read: ParsedLine, label: str) -> int:
        self._inside(label, "endif", ("IF",))
        return self.following

    @o_condition
    def o_while(self, read: ParsedLine, label: str) -> int:
        """The head of a loop, or after a DO its end."""
        begun = self._begun.get((self.calls[-1].start, label))
        holds = bool(self._first_argument(read))
        if begun is not None and begun.keyword == "DO":
            return begun.place + 1 if holds else self.following
        self._begin(label, "WHILE")
        return self.enter_loop(holds, label, "ENDWHILE")

    @o_word
    def o_endwhile(self, read: ParsedLine, label: str) -> int:
        return self.behind(label, ("WHILE",))

    @o_word
    def o_do(self, read: ParsedLine, label: str) -> int:
        self._begin(label, "DO")
        return self.following

    @o_condition
    def o_repeat(self, read: ParsedLine, label: str) -> int:
        self._begin(label, "REPEAT")
        times = _whole("repeat", self._first_argument(read))
        self.calls[-1].repeats[self.place] = times
        return self.enter_loop(times > 0, label, "ENDREPEAT")

    @o_word
    def o_endrepeat(self, read: ParsedLine, label: str) -> int:
        head = self.behind(label, ("REPEAT",))
        repeats = self.calls[-1].repeats
        repeats[head] = repeats.get(head, 0) - 1
        return head + 1 if repeats[head] > 0 else self.following

    @o_word
    def o_break(self, read: ParsedLine, label: str) -> int:
        return self._end_of_loop(label, "break") + 1

    @o_word
    def o_continue(self, read: ParsedLine, label: str) -> int:
        return self._end_of_loop(label, "continue")

    def _end_of_loop(self, label: str, keyword: str) -> int:
        # LinuxCNC leaves no repeat early
        self._inside(label, keyword, ("WHILE", "DO"))
        return self.ahead(label, ("ENDWHILE", "WHILE"))


KEYWORDS = Keywords(tuple(_HANDLERS), frozenset(_CONDITIONS))


def _whole(name: str, number: float) -> int:
    if math.isnan(number):
        raise InputError(f"O word: {name} = nan: must be a number")
    return round(number)
