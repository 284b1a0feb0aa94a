"""The order in which a program's lines run: O words, subroutines, loops, M98 and M99."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field

from gantrysim.base.errors import InputError, unknown
from gantrysim.controllers.gcode.lines import Statement, Words, compact, label_of, plain_words, statement
from gantrysim.controllers.gcode.parameters import Parameters, Scope, System

_DEEPEST = 10  # calls
_ARGUMENTS = 30
_O_LINE = re.compile(
    r"^[^\S\n]*(?:/[^\S\n]*)?(?:[nN][^\S\n]*[0-9.]+[^\S\n]*)?(?:\([^()\n]*\)[^\S\n]*)*[oO].*", re.MULTILINE
)


@dataclass
class _Frame:
    """A call: where it returns to, the caller's parameters, and the repetitions left of loops and of the call."""

    back: int
    start: int
    scope: Scope
    times: int = 1
    repeats: dict[int, int] = field(default_factory=dict)


class Flow:
    """Runs the lines of a program in their order.

    Args:
        text: the main program.
        others: subprograms in files of their own, by name.
        system: parameters that the controller provides.
        steps: most lines that may run.
        skip: whether lines that begin with a slash are skipped.
        left: called with the depth of a subroutine that ends.
        compact: makes a line compact.
    """

    def __init__(
        self,
        text: str,
        others: Mapping[str, str],
        system: System,
        steps: int,
        skip: bool,
        left: Callable[[int], None],
        compact: Callable[[str], str] = compact,
    ) -> None:
        self._lines = text.splitlines()
        self._main = len(self._lines)
        self._files: list[tuple[int, str]] = []
        for name, other in others.items():
            self._files.append((len(self._lines), name))
            self._lines += other.splitlines()
        self._steps = steps
        self._skip = skip
        self._left = left
        self._compact = compact
        self._labels: dict[str, list[tuple[int, str]]] = {}
        self._statements: dict[int, Statement] = {}
        self._frames = [_Frame(0, 0, Scope())]
        self._at = 0
        self.parameters = Parameters(system, _ARGUMENTS, 5602)
        first = 0
        for part in (text, *others.values()):
            self._index(part, first)
            first += len(part.splitlines())

    def _index(self, text: str, first: int) -> None:
        """Note the O words of a file whose lines begin at `first`."""
        if not _O_LINE.search(text):
            return
        for k, line in enumerate(text.splitlines(), first):
            if "o" in line or "O" in line:
                with suppress(InputError):  # raised again where the line is run
                    plain = compact(line).lstrip("/")
                    found = label_of(plain) if re.match(r"(N[0-9.]+)?O", plain) else None
                    if found:
                        self._labels.setdefault(found[0], []).append((k, found[1]))

    @property
    def depth(self) -> int:
        """Number of calls that have not returned."""
        return len(self._frames) - 1

    @property
    def line(self) -> int:
        """The main program's line that runs or has called the one that runs, from 1."""
        for place in (self._at, *(frame.back - 1 for frame in reversed(self._frames))):
            if place < self._main:
                return place + 1
        return 0

    @property
    def where(self) -> str:
        """The line that runs, in words."""
        inside = [(first, name) for first, name in self._files if first <= self._at]
        return f"line {self._at - inside[-1][0] + 1} of {inside[-1][1]}" if inside else f"line {self._at + 1}"

    def words(self) -> Iterator[Words]:
        """The words of every line that runs, in its order; `line` and `where` tell of the last one.

        Raises:
            InputError: a line that cannot be read, or too many of them.
        """
        lines = self._lines
        count = 0
        delimited = False
        after = 0
        while after < len(lines) and not (len(self._frames) == 1 and after >= self._main):
            self._at = after
            after += 1
            count += 1
            if count > self._steps:
                raise InputError(f"{self._steps} lines have run: must end before; is there an endless loop?")
            text = self._compact(lines[self._at])
            if not text:
                continue
            if text[0] == "/":
                if self._skip:
                    continue
                text = text[1:]
            if text[:1] == "%":
                if delimited and self._at < self._main:
                    return
                delimited = True
                continue
            found = plain_words(text)
            if found is None or text[0] == "O" or "O" in text:
                made = self._statements.get(self._at)
                if made is None:
                    made = self._statements[self._at] = statement(text)
                if made.label is not None:
                    after = self._control(made)
                    if after < 0:
                        return
                    continue
                found = made.evaluated(self.parameters)
                values = [value(self.parameters) for _, value in made.settings]
                for (target, _), value in zip(made.settings, values, strict=True):
                    self.parameters.set(target, value)
            if found:
                if "M" in text:
                    there = self._called(found)
                    if there is not None:
                        yield [word for word in found if word[0] not in "MPLN"]
                        if there < 0:
                            return
                        after = there
                        continue
                yield found

    def _called(self, words: Words) -> int | None:
        """Return the line that follows M98 or M99, -1 for the program's end; None for other lines."""
        codes = [value for letter, value in words if letter == "M"]
        if 98.0 in codes:
            values = {letter: value for letter, value in words if letter in "PL"}
            if "P" not in values:
                raise InputError("M98 without P: must have the number of a subprogram")
            number = int(values["P"])
            times = int(values.get("L", 1))
            if times < 1:
                return self._at + 1
            frame = self._enter(str(number), "")
            frame.times = times  # the caller's parameters stay in force
            return frame.start
        if 99.0 in codes:
            frame = self._frames[-1]
            if len(self._frames) == 1:
                return -1
            frame.times -= 1
            return frame.start if frame.times > 0 else self._leave()
        return None

    def _enter(self, name: str, keyword: str) -> _Frame:
        if len(self._frames) > _DEEPEST:
            raise InputError(f"calls nested deeper than {_DEEPEST} levels")
        start = next((k for k, word in self._labels.get(name, ()) if word == keyword), None)
        if start is None and not keyword:
            start = next((k for k, word in self._labels.get(name, ()) if word == "SUB"), None)
        if start is None:
            names = [key for key, places in self._labels.items() if any(word == keyword for _, word in places)]
            raise unknown("subprogram", name, names)
        frame = _Frame(self._at + 1, start + 1, self.parameters.scope)
        self._frames.append(frame)
        return frame

    def _leave(self) -> int:
        self._left(self.depth)
        frame = self._frames.pop()
        self.parameters.scope = frame.scope
        return frame.back

    def _control(self, made: Statement) -> int:
        """Run an O word; return the line that follows, -1 for the program's end."""
        store = self.parameters
        keyword = made.keyword
        after = self._at + 1
        label = made.label
        assert label is not None
        key = label if isinstance(label, str) else str(round(label(store)))
        if keyword == "CALL":
            values = [value(store) for value in made.arguments]
            if len(values) > _ARGUMENTS:
                raise InputError(f"call with {len(values)} arguments: must be at most {_ARGUMENTS}")
            frame = self._enter(key, "SUB")
            numbers = {k: values[k - 1] if k <= len(values) else 0.0 for k in range(1, _ARGUMENTS + 1)}
            store.scope = Scope(numbers)
            return frame.start
        if keyword == "SUB":  # met on the way, not called
            return self._next(key, ("ENDSUB",)) + 1
        if keyword in ("ENDSUB", "RETURN"):
            if len(self._frames) == 1:
                if keyword == "RETURN":
                    return -1
                raise InputError(f"endsub of {key}: must be in a subroutine that was called")
            value = made.arguments[0](store) if made.arguments else 0.0
            after = self._leave()
            store.set("_value", value)
            store.set("_value_returned", float(bool(made.arguments)))
            return after
        if keyword == "":
            return after
        return self._structured(key, made)

    def _structured(self, key: str, made: Statement) -> int:
        store = self.parameters
        keyword = made.keyword
        after = self._at + 1
        repeats = self._frames[-1].repeats
        if keyword in ("IF", "ELSEIF"):
            return self._branch(key, made)
        if keyword == "ELSE":
            return self._next(key, ("ENDIF",)) + 1
        if keyword == "WHILE" and not self._closes_do(key):
            return after if made.arguments[0](store) else self._next(key, ("ENDWHILE",)) + 1
        if keyword == "WHILE":
            return self._last(key, ("DO",)) + 1 if made.arguments[0](store) else after
        if keyword == "ENDWHILE":
            return self._last(key, ("WHILE",))
        if keyword == "REPEAT":
            repeats[self._at] = round(made.arguments[0](store))
            return after if repeats[self._at] > 0 else self._next(key, ("ENDREPEAT",)) + 1
        if keyword == "ENDREPEAT":
            head = self._last(key, ("REPEAT",))
            repeats[head] = repeats.get(head, 0) - 1
            return head + 1 if repeats[head] > 0 else after
        if keyword in ("BREAK", "CONTINUE"):
            end = self._next(key, ("ENDWHILE", "ENDREPEAT", "WHILE"))
            return end + 1 if keyword == "BREAK" else end
        return after  # DO, ENDIF

    def _branch(self, key: str, made: Statement) -> int:
        """Go to the first branch whose condition holds."""
        if made.keyword == "ELSEIF":  # met at the end of a branch that was taken
            return self._next(key, ("ENDIF",)) + 1
        holds = made.arguments[0](self.parameters)
        at = self._at
        while not holds:
            at = self._next(key, ("ELSEIF", "ELSE", "ENDIF"), at)
            made = self._statements.get(at) or statement(compact(self._lines[at]).lstrip("/"))
            self._statements[at] = made
            holds = made.keyword != "ELSEIF" or made.arguments[0](self.parameters)
        return at + 1

    def _closes_do(self, key: str) -> bool:
        before = [word for k, word in self._labels.get(key, ()) if k < self._at and word in ("DO", "WHILE", "ENDWHILE")]
        return bool(before) and before[-1] == "DO"

    def _next(self, key: str, keywords: tuple[str, ...], after: int | None = None) -> int:
        at = self._at if after is None else after
        for k, word in self._labels.get(key, ()):
            if k > at and word in keywords:
                return k
        raise InputError(f"O word {key}: must be followed by {' or '.join(keywords).lower()} with the same label")

    def _last(self, key: str, keywords: tuple[str, ...]) -> int:
        for k, word in reversed(self._labels.get(key, ())):
            if k < self._at and word in keywords:
                return k
        raise InputError(f"O word {key}: must follow {' or '.join(keywords).lower()} with the same label")
