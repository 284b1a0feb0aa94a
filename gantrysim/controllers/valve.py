"""When glue is laid: one rule for every language of programs.

Glue is laid in moves at feed, but in none straight up or down. Where a program switches an output, it switches the
valve: glue is laid in moves at feed, and in dwells, while the output is on. Of several outputs it is the one that is
switched on most often, since a spindle, a pump or a light is on from begin to end. A program that feeds material by E
lays glue where it does.

A spindle's codes have two meanings more. In a dwell before the needle goes down with the output on, a spindle gets up
to speed: nothing is laid in the air. M4 beside M3 reverses a paste pump, which sucks the paste back: the valve is
closed, unless the program goes on to work with it, as one for a laser does.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.errors import InputError

_VALVE = "valve"  # output of the codes that a job names
_SPINDLE = "spindle"
_SPEED = "speed"  # the spindle, off at S0
_REVERSE = "reverse"  # the spindle by M4
_STOPS = "M5"
_STANDSTILL = "S0"
_SUCKS = "M4"
_FAN = 106
_BACKWARDS = 4
# codes that take an S, by the word that sets the flow with them
_WITH_S = {"S": {"M3", "M4"}, "M106": {"M106"}}
_PIN = 42  # of printers' firmware, off at S0
SPEED_CODES = frozenset({3, 4, _FAN})  # whose S is a speed
# the output that an M code switches, and whether on
CODES = {
    62: ("M62", True),
    63: ("M62", False),
    64: ("M64", True),
    65: ("M64", False),
    7: ("coolant", True),
    8: ("coolant", True),
    9: ("coolant", False),
    3: (_SPINDLE, True),
    4: (_SPINDLE, True),
    5: (_SPINDLE, False),
    106: ("fan", True),
    107: ("fan", False),
}
NUMBERED = frozenset(range(62, 66))  # with a P, which numbers one output for all four
_MOST_OUTPUTS = 256
_MOST_STATES = 10_000  # of them together
SAME_PLACE = 1e-6  # in plan view; more is not rounding [mm]


# P and S beside an M code
_Words = tuple[float | None, float | None]


@dataclass(frozen=True)
class Dispense:
    """When glue is laid.

    Attributes:
        by: "auto": in moves at feed, but for those straight up or down, and if the program has codes for the valve,
            only between them, dwells included; in a program that feeds material by E, where it does. "feed": in moves
            at feed, whatever codes the program has. "codes": in whatever happens between the codes. "extrusion": in
            moves that feed material by E.
        on: M codes that open the valve, such as "M3", "M64 P0" or "M300 S30"; by default those of M3, M4, M7, M8, M42,
            M62, M64 and M106 with which the program switches on one output, the one that it switches most often.
        off: M codes that close the valve; by default those that switch this output off, of M5, M9, M42 with S0, M63,
            M65 and M107.
    """

    by: Literal["auto", "feed", "codes", "extrusion"] = "auto"
    on: tuple[str, ...] = ()
    off: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.by not in ("auto", "feed", "codes", "extrusion"):
            raise InputError(f"dispense.by = {self.by!r}: must be auto, feed, codes or extrusion")
        _switches(tuple(self.on), tuple(self.off))
        if self.off and not self.on:
            raise InputError(f"dispense.off = {', '.join(self.off)} without dispense.on: must be with it")

    def switch(self, code: int, words: _Words) -> bool | None:
        """Return whether an M code with P and S opens or closes the valve by `on` and `off`; None if neither."""
        switches = _switches(tuple(self.on), tuple(self.off))
        p, s = words
        # the code with the most words first
        for named in ((p, s), (p, None), (None, s), (None, None)):
            opens = switches.get((code, named))
            if opens is not None:
                return opens
        return None


@dataclass
class _Output:
    """How a program switches an output: codes in the order in which they were met, and how often it went on."""

    on: list[str] = field(default_factory=list)
    off: list[str] = field(default_factory=list)
    times: int = 0


class Motions(NamedTuple):
    """What decides in which moves and dwells of a program glue is laid.

    Attributes:
        work: whether it is a move at feed, not straight up or down; or a dwell at the bottom of a cycle, (m,).
        dwell: whether it is a dwell, (m,).
        rise: change of height, (m,) [mm].
        upright: whether it is a move straight up or down, (m,).
        feeds: whether it feeds material, (m,).
        is_on: returns whether an output is on in them, (m,).
    """

    work: NDArray[np.bool_]
    dwell: NDArray[np.bool_]
    rise: NDArray[np.float64]
    upright: NDArray[np.bool_]
    feeds: NDArray[np.bool_]
    is_on: Callable[[str], NDArray[np.bool_]]

    def in_the_air(self, is_on: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return the dwells with an output that stays on while the needle then goes straight down, (m,).

        Before the program has gone to any height, it may go straight up, too.
        """
        landmarks = self.work | self.upright
        places = np.where(landmarks, np.arange(landmarks.size), landmarks.size)
        # of each, the next that tells where the needle was
        following = np.minimum.accumulate(places[::-1])[::-1]
        moved = np.logical_or.accumulate(self.work | (self.rise != 0))
        lifted = np.append(self.upright & is_on, False)[following]
        lowered = lifted & (np.append(self.rise, 0.0)[following] < 0)
        return is_on & self.dwell & ~self.work & (lowered | (lifted & ~moved))

    @property
    def reverse_sucks_back(self) -> bool:
        """Whether what follows every M4 is a dwell or a move straight up or down, not work."""
        reverse = self.is_on(_REVERSE)
        begins = reverse & ~np.append(False, reverse[:-1])
        return not (begins & ~self.dwell & ~self.upright).any()


class Outputs:
    """The outputs that M codes switch while a program runs.

    Args:
        dispense: when glue is laid; codes that it names switch an output of their own.
        has_pins: whether M42 switches an output, as in printers' firmware.

    Attributes:
        states: names of the outputs that were on at once, to which moves refer by `index`.
        index: of the present state.
    """

    def __init__(self, dispense: Dispense, has_pins: bool = False) -> None:
        self.states: list[tuple[str, ...]] = [()]
        self.index = 0
        self._dispense = dispense
        self._has_pins = has_pins
        self._met: dict[str, _Output] = {}
        self._numbers: dict[tuple[str, ...], int] = {(): 0}
        # code with which the spindle turns
        self._turns = ""
        self._speed: float | None = None
        # whether a speed other than 0 was met: a S0 that stands in every block switches nothing
        self._has_speeds = False

    @property
    def now(self) -> tuple[str, ...]:
        """Names of the outputs that are on."""
        return self.states[self.index]

    @property
    def is_reverse(self) -> bool:
        """Whether M4 is on."""
        return _REVERSE in self.now

    def switch(
        self, codes: Iterable[int], number: float | None, speed: float | None, word: float | None = None
    ) -> None:
        """Apply the M codes of a block.

        Args:
            codes: numbers of the M codes.
            number: P.
            speed: S, of the spindle or of M106, which are off at 0.
            word: S, whatever it is.
        """
        on = dict.fromkeys(self.now)
        if speed is not None:
            self._speed = speed
            self._has_speeds |= speed != 0
        for code in codes:
            if self._dispense.on:
                switched = self._dispense.switch(code, (number, speed if word is None else word))
                if switched is not None:
                    self._set(on, _VALVE, f"M{code}", switched)
            elif code in CODES:
                self._apply(on, code, number, speed)
            elif self._has_pins and code == _PIN and word is not None:
                pin = "M42" if number is None else f"M42 P{number:g}"
                self._set(on, pin, f"{pin} S{word:g}", word != 0)
        if _SPINDLE in self._met:
            runs = self._turns and self._speed != 0
            self._set(on, _SPEED, self._turns if runs else _STANDSTILL if self._turns else _STOPS, bool(runs))
        self._enter(on)

    def set_line(self, name: str, *, opens: bool) -> None:
        """Switch an output that the program sets by its name, as #1100 of FANUC, unless the job names codes."""
        is_on = name in self.now
        if self._dispense.on or is_on == opens:
            return
        on = dict.fromkeys(self.now)
        self._set(on, name, f"{name}={opens:d}", opens)
        self._enter(on)

    def _enter(self, on: dict[str, None]) -> None:
        state = tuple(on)
        if state not in self._numbers:
            if max(len(self._met) / _MOST_OUTPUTS, len(self.states) / _MOST_STATES) > 1:
                raise InputError(f"more than {_MOST_OUTPUTS} outputs, or {_MOST_STATES} states of them, are switched")
            self._numbers[state] = len(self.states)
            self.states.append(state)
        self.index = self._numbers[state]

    def _apply(self, on: dict[str, None], code: int, number: float | None, speed: float | None) -> None:
        output, opens = CODES[code]
        name = f"M{code}"
        if number is not None and code in NUMBERED:
            output = f"P{number:g}"
            name = f"{name} P{number:g}"
        if output == _SPINDLE:
            self._turns = name if opens else ""
            self._set(on, _REVERSE, name, code == _BACKWARDS)
        elif code == _FAN and speed == 0:
            name = f"{name} {_STANDSTILL}"
            opens = False
        self._set(on, output, name, opens)

    def _set(self, on: dict[str, None], output: str, code: str, opens: bool) -> None:
        met = self._met.setdefault(output, _Output())
        if opens:
            met.times += output not in on
            on[output] = None
        else:
            on.pop(output, None)
        codes = met.on if opens else met.off
        if code not in codes:
            codes.append(code)

    def valve(self, moves: Motions) -> Valve:
        """Return what opens the valve, at the end of a program, and in which of its moves glue is laid."""
        by = self._dispense.by
        if by in ("feed", "extrusion") or (by == "auto" and moves.feeds.any()):
            return Valve("feed", moves.work) if by == "feed" else Valve("extrusion", moves.feeds)
        order = [_VALVE, *dict.fromkeys(output for output, _ in CODES.values()), _SPEED]
        ranks = {name: order.index(name) if name in order else 0 for name in self._met}
        twin = _SPINDLE if self._has_speeds else _SPEED
        outputs = sorted(
            (name for name, met in self._met.items() if met.times and name not in (twin, _REVERSE)),
            key=lambda name: (-self._met[name].times, not self._met[name].off, ranks[name]),
        )
        if not outputs:
            if by == "auto" and not self._dispense.on:
                return Valve("feed", moves.work)
            return Valve("codes", np.zeros(moves.work.size, bool))
        first, *others = outputs
        met = self._met[first]
        opens = tuple(met.on) if first != _VALVE else self._dispense.on
        closes = tuple(met.off) if first != _VALVE else self._dispense.off
        is_on = moves.is_on(first)
        sucks = _sucks_back(first, opens) and moves.reverse_sucks_back
        if sucks:
            is_on = is_on & ~moves.is_on(_REVERSE)
            opens = tuple(code for code in opens if code != _SUCKS)
            closes = (*closes, _SUCKS)
        at_work = by == "auto"
        in_the_air = moves.in_the_air(is_on)
        laid = is_on & (moves.work | moves.dwell) & ~in_the_air if at_work else is_on
        return Valve(
            by="codes",
            laid=laid,
            output=first,
            on=opens,
            off=closes,
            others=tuple((tuple(self._met[name].on), tuple(self._met[name].off)) for name in others),
            at_work=at_work,
            sucks_back=sucks,
            dry_dwells=int(np.count_nonzero(in_the_air)) if at_work else 0,
            open_in_rapids=at_work and not (laid & moves.work).any() and bool((is_on & ~moves.dwell & ~laid).any()),
        )


@dataclass(frozen=True, eq=False)
class Valve:
    """What opens the valve in a program.

    Attributes:
        by: "feed": moves at feed; "codes": an output; "extrusion": moves that feed material.
        laid: in which moves and dwells of the program glue is laid, (m,).
        output: name of the output; empty where none does.
        on: codes that switch it on.
        off: codes that switch it off.
        others: codes on and off of the outputs that do not open it.
        at_work: whether the output opens it in moves at feed and dwells alone.
        sucks_back: whether M4 closes it.
        dry_dwells: dwells with the output on, in which nothing is laid, as the needle goes down afterwards.
        open_in_rapids: whether the output is on in moves, but none of them is at feed.
    """

    by: Literal["feed", "codes", "extrusion"]
    laid: NDArray[np.bool_]
    output: str = ""
    on: tuple[str, ...] = ()
    off: tuple[str, ...] = ()
    others: tuple[tuple[tuple[str, ...], tuple[str, ...]], ...] = ()
    at_work: bool = False
    sucks_back: bool = False
    dry_dwells: int = 0
    open_in_rapids: bool = False

    @property
    def note(self) -> str | None:
        """Which codes of the program switch the valve, in a sentence; None where none do, or the job names them."""
        if not self.output or self.output == _VALVE:
            return None
        closes = f"{_all(self.off)} closes it" if self.off else "nothing closes it"
        if self.sucks_back:
            closes = f"{closes}, {_SUCKS} by sucking back"
        where = "in moves at feed, and in dwells" if self.at_work else "in all moves and dwells"
        sentence = (
            f"{_all(self.on)} opens the valve and {closes}: glue is laid {where}, while it is open; "
            "--set program.dispense.by=feed lays it in all moves at feed."
        )
        if self.dry_dwells:
            plural = "a dwell" if self.dry_dwells == 1 else f"{self.dry_dwells} dwells"
            sentence += f" None is laid in {plural} before the needle goes down to work."
        if self.open_in_rapids:
            sentence += " It is open in rapid moves alone; --set program.dispense.by=codes lays glue in them."
        for on, off in self.others:
            # the S0 of a spindle or a fan is no code of its own
            named = {
                name: [code for code in codes if _STANDSTILL not in code or code.startswith(f"M{_PIN}")]
                for name, codes in (("on", on), ("off", off))
            }
            table = ", ".join(f"{name} = {json.dumps(codes)}" for name, codes in named.items() if codes)
            verb, them = ("do", "them") if off else ("does", "it")
            codes = " and ".join((*on, *off))
            # the job names M codes alone
            remedy = f"; to let {them}, --set 'program.dispense={{{table}}}'" if on[0].startswith("M") else ""
            sentence += f" {codes} {verb} not switch it{remedy}."
        return sentence

    @property
    def switching_codes(self) -> frozenset[str]:
        """Names of the M codes that switch it, as "M3", however the job writes them."""
        names = (name for name in (*self.on, *self.off) if name.upper().startswith("M"))
        return frozenset(f"M{_code(name)[0]}" for name in names)

    @property
    def dryness(self) -> str:
        """Why the program lays no glue, in words, if it lays none."""
        if self.by == "feed":
            return "the program has no moves at feed but those straight up or down"
        if self.by == "extrusion":
            return "E feeds material in no move of the program"
        if not self.output:
            return "no code of the program opens the valve (program.dispense)"
        where = "in no move at feed but those straight up or down, and in no dwell at the work"
        return f"{_all(self.on)} opens the valve {where if self.at_work else 'in no move and no dwell'}"


def unused_set_points(values: Mapping[str, Iterable[float]], valve: Valve) -> Iterator[str]:
    """Yield notes on words of a program that state a flow, as a pump's speed, but do not set it.

    An analogue output states one by any value. S does only where the codes with it open the valve, and it changes: a
    spindle that runs at one speed tells nothing of the flow.

    Args:
        values: of the words.
        valve: of the program.
    """
    opening = {code.split()[0] for code in valve.on}
    for word, given in values.items():
        stated = sorted({value for value in given if value})
        with_valve = _WITH_S.get(word)
        if not stated or (with_valve is not None and (len(stated) < 2 or opening.isdisjoint(with_valve))):
            continue
        extent = f"{stated[0]:g}" if len(stated) == 1 else f"{stated[0]:g} to {stated[-1]:g}"
        yield (
            f"{word} is {extent}, but sets no flow; --set 'program.flow_output=\"{word}\"' makes it the set point of "
            "the flow, with dispenser.per_output."
        )


def _sucks_back(output: str, opens: Sequence[str]) -> bool:
    """Return whether M4 may suck back: only beside M3, the forward direction of a pump."""
    return output in (_SPINDLE, _SPEED) and {"M3", _SUCKS} <= set(opens)


def _all(codes: Sequence[str]) -> str:
    return " or ".join([", ".join(codes[:-1]), codes[-1]] if len(codes) > 1 else codes)


def is_upright(start: Sequence[float], end: Sequence[float]) -> bool:
    """Return whether a move leads straight up or down, from and to x, y, z [mm]."""
    return max(abs(end[0] - start[0]), abs(end[1] - start[1])) <= SAME_PLACE < abs(end[2] - start[2])


@cache
def _switches(on: tuple[str, ...], off: tuple[str, ...]) -> dict[tuple[int, _Words], bool]:
    return {_code(name): opens for names, opens in ((on, True), (off, False)) for name in names}


def _code(name: str) -> tuple[int, _Words]:
    code, *others = name.upper().split() or [""]
    words = {word[0]: word[1:] for word in others}
    try:
        if code[:1] != "M" or len(words) != len(others) or not words.keys() <= {"P", "S"}:
            raise ValueError
        p, s = (float(words[letter]) if letter in words else None for letter in "PS")
        return int(code[1:]), (p, s)
    except ValueError:
        raise InputError(
            f"dispense code {name!r}: must be an M code, as M3, or with its P or S, as M64 P0 or M300 S30"
        ) from None
