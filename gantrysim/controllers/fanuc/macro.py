"""The order in which blocks run: subprograms, macro variables, branches and loops.

Variables are local to a call (#1 to #33) or common; a word whose value is a variable that was never set is left out.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from gantrysim.base.errors import InputError
from gantrysim.controllers.fanuc.alarm import Alarm, Source
from gantrysim.controllers.fanuc.words import COMMENT, LETTERS, Words, words_of
from gantrysim.controllers.gcode.expressions import Scanner
from gantrysim.controllers.gcode.parameters import Parameters, Scope, System

_DEEPEST = 10  # calls
_MOST_DIGITS = 20  # of a block's or program's number
_LOCAL = 33
_HIGHEST = 9999
_MACRO = re.compile(r"[#\[=]|^(?:N\s*[0-9]+\s*)?(?:IF|WHILE|GOTO|DO|END|G\s*0*65(?![0-9.]))")
_LABEL = re.compile(r"N\s*([0-9]+)")
_PROGRAM = re.compile(r"(?:N[0-9]+)?O([0-9]+)")
_ENDS = (2, 30)
# letters of a call's arguments and their variables
_ARGUMENTS = dict(zip("ABCIJKDEFHMQRSTUVWXYZ", (1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 13, *range(17, 27)), strict=True))


@dataclass(frozen=True)
class _Block(Source):
    text: str


@dataclass
class _Call:
    """A call: the block that follows it, where the subprogram begins, its repetitions left, the caller's variables."""

    back: int
    start: int
    times: int
    scope: Scope


class Macro:
    """Runs the blocks of a text in their order.

    Args:
        text: the program and its subprograms.
        skip: whether blocks that begin with a slash are skipped.
        steps: most blocks that may run.
        system: variables that the controller provides.
    """

    def __init__(self, text: str, skip: bool, steps: int, system: System) -> None:
        self._blocks: list[_Block] = []
        self._programs: dict[int, int] = {}
        for line, written in enumerate(text.splitlines(), 1):
            for part in re.sub(COMMENT, " ", written).split(";"):
                plain = part.strip().upper()
                if not plain or plain.startswith("%"):
                    continue
                if plain.startswith("/"):
                    if skip:
                        continue
                    plain = plain[1:].lstrip()
                program = _PROGRAM.match("".join(plain.split()))
                if program:
                    self._programs.setdefault(_numbered(program[1]), len(self._blocks))
                self._blocks.append(_Block(f"block {len(self._blocks) + 1}", line, plain))
        self._starts = sorted({0, *self._programs.values()})
        self._variables = Parameters(system, _LOCAL, _HIGHEST)
        self._calls: list[_Call] = []
        self._steps = steps
        self._found: dict[tuple[int, str], int] = {}

    def has(self, pattern: str) -> bool:
        """Return whether a pattern occurs in a block."""
        return any(re.search(pattern, block.text) for block in self._blocks)

    def blocks(self) -> Iterator[Words]:
        """The words of every block that runs, up to M02 or M30.

        Raises:
            Alarm: a block that cannot be read or run.
        """
        at = 0
        count = 0
        while 0 <= at < len(self._blocks):
            if at and at in self._starts and not self._calls:
                return  # the main program's end
            block = self._blocks[at]
            count += 1
            if count > self._steps:
                raise block.fail(114, f"{self._steps} blocks have run: must end before; is there an endless loop?")
            try:
                at, words = self._run(at, block)
            except Alarm:
                raise
            except (InputError, OverflowError) as error:
                raise block.fail(114, str(error)) from None
            if words is None:
                continue
            if words.codes or words.auxiliary or words.values:
                yield words
            if any(code in _ENDS for code in words.auxiliary):
                return

    def _run(self, at: int, block: _Block) -> tuple[int, Words | None]:
        """Run a block; return the next one, -1 for the end, and the words of the block, if any."""
        if not _MACRO.search(block.text):
            words = words_of(block.text, block.name, block.line)
        else:
            label = _LABEL.match(block.text)
            compact = "".join(block.text[label.end() if label else 0 :].split())
            named = Source(f"N{label[1]}" if label else block.name, block.line)
            there = self._control(at, compact, named)
            if there is not None:
                return there, None
            words = self._words(compact, named)
        return self._called(at, words)

    def _control(self, at: int, text: str, block: Source) -> int | None:
        """Run a control word or an assignment; return the next block, None if it is neither."""
        scanner = Scanner(text, truncating=True)
        if scanner.take("IF"):
            holds = scanner.value("IF")(self._variables)
            if scanner.take("GOTO"):
                return self._labelled(at, scanner.value("GOTO")(self._variables), block) if holds else at + 1
            if not scanner.take("THEN#"):
                raise block.fail(114, "IF: must be followed by GOTO or by THEN and an assignment")
            if holds:
                self._assign(scanner)
            return at + 1
        if scanner.take("GOTO"):
            return self._labelled(at, scanner.value("GOTO")(self._variables), block)
        if scanner.take("WHILE"):
            holds = scanner.value("WHILE")(self._variables)
            if not re.fullmatch("DO[1-3]", scanner.rest):
                raise block.fail(114, "WHILE: must be followed by DO1, DO2 or DO3")
            return at + 1 if holds else self._matching(at, f"END{scanner.rest[2]}", 1, block) + 1
        if re.fullmatch("DO[1-3]", text):
            return at + 1
        if re.fullmatch("END[1-3]", text):
            return self._matching(at, f"DO{text[3]}", -1, block)
        if scanner.take("#"):
            self._assign(scanner)
            return at + 1
        return None

    def _assign(self, scanner: Scanner) -> None:
        target = scanner.target()
        if not scanner.take("="):
            raise InputError(f"{scanner.rest[:12]!r}: an assignment must have = after the variable")
        value = scanner.expression()
        if scanner.rest:
            raise InputError(f"{scanner.rest[:12]!r}: must be an operator or the end of the block")
        self._variables.set(target, value(self._variables))

    def _words(self, text: str, block: Source) -> Words:
        """The words of a block with variables or expressions."""
        scanner = Scanner(text, truncating=True)
        found: list[tuple[str, float]] = []
        while scanner.rest:
            letter = scanner.rest[0]
            if letter not in LETTERS + "EUVW":
                raise block.fail(9, f"address {letter!r}: must be one of {', '.join(LETTERS)}")
            scanner.at += 1
            written = scanner.rest
            value = scanner.value(letter)
            number = re.fullmatch(r"#([0-9]+)", written[: len(written) - len(scanner.rest)])
            if not (number and self._variables.vacant(float(number[1]))):
                found.append((letter, value(self._variables)))
        values: dict[str, float] = {}
        for letter, number_ in found:
            if letter in values and letter not in "GM":
                raise block.fail(9, f"address {letter} is given twice in the block")
            values[letter] = number_
        for letter in "GMNO":
            values.pop(letter, None)
        codes = tuple(value for letter, value in found if letter == "G")
        auxiliary = tuple(value for letter, value in found if letter == "M")
        return Words(block.name, block.line, codes, auxiliary, values)

    def _called(self, at: int, words: Words) -> tuple[int, Words | None]:
        """Enter or leave a subprogram, M98, M99 and G65; return as `_run`."""
        values = words.values
        if 98 in words.auxiliary or 65 in words.codes:
            if "P" not in values:
                raise words.fail(76, "a call must have the number of the subprogram, P")
            times, number = divmod(int(values["P"]), 10000)
            times = int(values.get("L", times or 1))
            if number not in self._programs:
                known = ", ".join(f"O{known}" for known in sorted(self._programs)) or "none"
                raise words.fail(78, f"O{number}: must be one of the text's programs, {known}")
            if len(self._calls) >= _DEEPEST:
                raise words.fail(77, f"calls nested deeper than {_DEEPEST} levels")
            if times < 1:
                return at + 1, None
            start = self._programs[number] + 1
            self._calls.append(_Call(at + 1, start, times, self._variables.scope))
            if 65 in words.codes:
                numbered = {_ARGUMENTS[k]: value for k, value in values.items() if k in _ARGUMENTS}
                self._variables.scope = Scope(numbered)
                return start, None
            for letter in "PL":
                values.pop(letter, None)
            return start, words
        if 99 in words.auxiliary:
            if not self._calls:
                return -1, words
            call = self._calls[-1]
            call.times -= 1
            if call.times > 0:
                return call.start, None
            self._calls.pop()
            self._variables.scope = call.scope
            if "P" in values:
                return self._labelled(call.back - 1, values["P"], words), None
            return call.back, None
        return at + 1, words

    def _section(self, at: int) -> tuple[int, int]:
        """First block of the program that a block belongs to, and that after its last."""
        first = max(start for start in self._starts if start <= at)
        return first, min((start for start in self._starts if start > at), default=len(self._blocks))

    def _labelled(self, at: int, number: float, block: Source) -> int:
        first, last = self._section(at)
        key = (first, f"N{number:g}")
        if key not in self._found:
            for k in range(first, last):
                label = _LABEL.match(self._blocks[k].text)
                if label and _numbered(label[1]) == number:
                    self._found[key] = k
                    break
            else:
                raise block.fail(78, f"N{number:g}: must be a block of the program")
        return self._found[key]

    def _matching(self, at: int, word: str, step: int, block: Source) -> int:
        """The nearest block before or after that ends with a control word."""
        if (at, word) not in self._found:
            first, last = self._section(at)
            k = at + step
            while first <= k < last and not "".join(self._blocks[k].text.split()).endswith(word):
                k += step
            if not first <= k < last:
                raise block.fail(124, f"{word}: must be in the program, to match this block")
            self._found[at, word] = k
        return self._found[at, word]


def _numbered(digits: str) -> int:
    """Return the number of a block or program; one of more digits than Python reads is that of no other."""
    return int(digits) if len(digits) <= _MOST_DIGITS else -1
