"""The texts of a program and its subprograms as one sequence of lines, in which O words are looked up."""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field

from gantrysim.base.errors import InputError, unknown
from gantrysim.controllers.gcode.lines import FirmwareCommand, Keywords, Words, compact, label_of
from gantrysim.controllers.macro.order import Flow, FlowRefusal
from gantrysim.controllers.macro.variables import Numbering, Parameters, System

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
        if not _O_LINE.search(text):  # most programs: one search of the text instead of one of each line
            return
        for place, line in enumerate(text.splitlines(), first):
            if "o" in line or "O" in line:
                with suppress(InputError):  # raised again where the line is run
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
        first, name = started
        return f"line {self.place - first + 1} of {name}"

    @property
    def called_files(self) -> frozenset[str]:
        """Names of the files whose subprograms were called."""
        return frozenset(file[1] for file in map(self._file_at, self.entered) if file is not None)

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
        number = int(values["P"])
        times = int(values.get("L", 1))
        if times < 1:
            return self.following
        return self.enter(self.start_of(str(number), ""), times)

    def start_of(self, name: str, keyword: str) -> int:
        """Return the first place of a subprogram that begins with a keyword."""
        self.check_depth()
        head = self.places.first(name, keyword)
        if head is None and not keyword:
            head = self.places.first(name, "SUB")
        if head is None:
            raise unknown("subprogram", name, [str(label) for label in self.places.labels(keyword)])
        return head + 1
