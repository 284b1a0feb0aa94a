"""The order in which the lines of a program run: calls of subprograms, their repetitions, loops and jumps."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from bisect import bisect_left, bisect_right
from collections.abc import Hashable, Iterator
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Generic, TypeVar

from gantrysim.base.errors import InputError
from gantrysim.controllers.macro.variables import LocalParameters, Parameters

END = -1  # the place that follows the last line that runs
_NESTED_CALLS = 10  # calls
MOST_TIME = 5.0  # of the processor, for lines that run without anything for the machine [s]
_LOOKS = 1000  # steps after which the clock is read
Line = TypeVar("Line")  # what a line holds for the machine, as its words


class FlowRefusal(Enum):
    """The reasons for which the order of a program is refused; a controller may number them."""

    STEPS = auto()
    DEPTH = auto()
    UNMATCHED = auto()


class Places:
    """The places of control words in a program, by their label, ascending."""

    def __init__(self) -> None:
        self._places: dict[Hashable, list[int]] = {}
        self._words: dict[Hashable, list[str]] = {}

    def mark(self, label: Hashable, word: str, place: int) -> None:
        """Note a control word; those of one label in the order of their places."""
        self._places.setdefault(label, []).append(place)
        self._words.setdefault(label, []).append(word)

    def first(self, label: Hashable, word: str) -> int | None:
        """Return the first place of a word, if any."""
        return self.next(label, (word,), -1)

    def next(self, label: Hashable, words: tuple[str, ...], place: int) -> int | None:
        """Return the first place of any of the words that follows a place, if any."""
        places = self._places.get(label, [])
        for k in range(bisect_right(places, place), len(places)):
            if self._words[label][k] in words:
                return places[k]
        return None

    def last(self, label: Hashable, words: tuple[str, ...], place: int) -> int | None:
        """Return the last place of any of the words that precedes a place, if any."""
        places = self._places.get(label, [])
        for k in reversed(range(bisect_left(places, place))):
            if self._words[label][k] in words:
                return places[k]
        return None

    def labels(self, word: str) -> list[Hashable]:
        """Return the labels at which a word stands."""
        return [label for label, words in self._words.items() if word in words]


@dataclass
class Call:
    """A call of a subprogram; the outermost is the main program's.

    Attributes:
        back: place to which it returns.
        start: first place of the subprogram.
        scope: the caller's local parameters.
        times: repetitions to go, with the one that runs.
        repeats: repetitions to go of the loops within, by their places.
    """

    back: int
    start: int
    scope: LocalParameters
    times: int = 1
    repeats: dict[int, int] = field(default_factory=dict)


class Flow(ABC, Generic[Line]):
    """Runs the lines of a program in their order. A line is known by its place, from 0.

    Args:
        parameters: of the program.
        most_steps: lines that may run.
        unit: of the steps, "lines" or "blocks", for the message.

    Attributes:
        place: of the line that runs.
        places: of the control words.
        parameters: of the program.
        calls: those that have not returned; the first is the main program's.
        entered: first places of the subprograms that were called.
    """

    def __init__(self, parameters: Parameters, most_steps: int, unit: str) -> None:
        self.parameters = parameters
        self.place = 0
        self.places = Places()
        self.calls = [Call(0, 0, parameters.scope)]
        self.entered = frozenset[int]()
        self._most_steps = most_steps
        self._unit = unit

    @abstractmethod
    def runs(self, place: int) -> bool:
        """Return whether a place is a line of the program that runs; the program ends where it is not."""

    @abstractmethod
    def execute(self) -> tuple[int, Line | None]:
        """Run the line at `place`; return the next place, and what the line holds for the machine, if anything."""

    @abstractmethod
    def refusal(self, fault: FlowRefusal, detail: str) -> InputError:
        """Return the error of the line that runs."""

    @abstractmethod
    def unmatched(self, label: Hashable, words: tuple[str, ...], ahead: bool) -> InputError:
        """Return the error where none of the words with a label stands ahead, or behind."""

    def subprogram_ends(self) -> None:
        """Note that the subprogram of the innermost call is about to return."""

    @property
    def depth(self) -> int:
        """Number of subprograms that have not returned."""
        return len(self.calls) - 1

    @property
    def following(self) -> int:
        """The place after the line that runs."""
        return self.place + 1

    def run(self) -> Iterator[Line]:
        """What the lines that run hold for the machine, in their order.

        Raises:
            InputError: a line that cannot be read or run, or too many of them.
        """
        following = 0
        steps = 0
        # when the clock was first read after a line with something for the machine
        last_motion = time.thread_time()
        is_still = True
        while following != END and self.runs(following):
            self.place = following
            steps += 1
            if steps > self._most_steps:
                raise self.refusal(
                    FlowRefusal.STEPS,
                    f"{self._most_steps} {self._unit} have run: must end before; is there an endless loop?",
                )
            if steps % _LOOKS == 0 and not is_still:
                last_motion = time.thread_time()
                is_still = True
            elif steps % _LOOKS == 0 and time.thread_time() - last_motion > MOST_TIME:
                raise self.refusal(
                    FlowRefusal.STEPS,
                    f"{self._unit} have run for {MOST_TIME:g} s without a motion: is there an endless loop?",
                )
            following, line = self.execute()
            if line is not None:
                yield line
                is_still = False

    def check_depth(self) -> None:
        """Raise InputError where no further call is allowed."""
        if self.depth >= _NESTED_CALLS:
            raise self.refusal(FlowRefusal.DEPTH, f"calls nested deeper than {_NESTED_CALLS} levels")

    def enter(self, start: int, times: int = 1) -> int:
        """Call a subprogram that begins at a place; return that place. The caller's parameters stay in force."""
        self.calls.append(Call(self.following, start, self.parameters.scope, times))
        if start not in self.entered:
            self.entered |= {start}
        return start

    def end_repetition(self) -> int:
        """Return the place that follows the end of a subprogram: its start again, or that after the call."""
        call = self.calls[-1]
        call.times -= 1
        return call.start if call.times > 0 else self.leave()

    def leave(self) -> int:
        """Return from the innermost subprogram, to the place that is returned."""
        self.subprogram_ends()
        call = self.calls.pop()
        self.parameters.scope = call.scope
        return call.back

    def enter_loop(self, holds: bool, label: Hashable, end: str) -> int:
        """Return the place that follows the head of a loop: its first line, or that after its end."""
        return self.following if holds else self.ahead(label, (end,)) + 1

    def ahead(self, label: Hashable, words: tuple[str, ...], place: int | None = None) -> int:
        """Return the next place of any of the words with a label.

        Args:
            label: of the words.
            words: any of which is looked for.
            place: after which it must stand; by default the line that runs.

        Raises:
            InputError: there is none.
        """
        target = self.places.next(label, words, self.place if place is None else place)
        if target is None:
            raise self.unmatched(label, words, ahead=True)
        return target

    def behind(self, label: Hashable, words: tuple[str, ...]) -> int:
        """Return the last place of any of the words with a label before the line that runs.

        Raises:
            InputError: there is none.
        """
        target = self.places.last(label, words, self.place)
        if target is None:
            raise self.unmatched(label, words, ahead=False)
        return target
