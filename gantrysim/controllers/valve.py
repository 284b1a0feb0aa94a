"""When glue is laid: one rule for every language of programs.

Glue is laid in moves at feed, but in none straight up or down. Where a program switches an output, it switches the
valve: glue is laid in moves at feed, and in dwells, while the output is on. Of several outputs it is the one that is
switched on most often, since a spindle, a pump or a light is on from begin to end. A program that feeds material by E
lays glue where it does.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.errors import InputError

_VALVE = "valve"  # output of the codes that a job names
_SPINDLE = "spindle"
_SPEED = "speed"  # the spindle, off at S0
_STOPS = "M5"
_STANDS = "S0"
_FAN = 106
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


@dataclass(frozen=True)
class Dispense:
    """When glue is laid.

    Attributes:
        by: "auto": in moves at feed, but for those straight up or down, and if the program has codes for the valve,
            only between them, dwells included; in a program that feeds material by E, where it does. "feed": in moves
            at feed, whatever codes the program has. "codes": in whatever happens between the codes. "extrusion": in
            moves that feed material by E.
        on: M codes that open the valve, such as "M3" or "M64 P0"; by default those of M3, M4, M7, M8, M62, M64 and M106
            with which the program switches on one output, the one that it switches most often.
        off: M codes that close the valve; by default those that switch this output off, of M5, M9, M63, M65 and M107.
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

    def switch(self, code: int, number: float | None) -> bool | None:
        """Return whether an M code with its P opens or closes the valve by `on` and `off`; None if it does neither."""
        switches = _switches(tuple(self.on), tuple(self.off))
        with_number = switches.get((code, number))
        return switches.get((code, None)) if with_number is None else with_number


@dataclass
class _Output:
    """How a program switches an output: codes in the order in which they were met, and how often it went on."""

    on: list[str] = field(default_factory=list)
    off: list[str] = field(default_factory=list)
    times: int = 0


class Outputs:
    """The outputs that M codes switch while a program runs.

    Args:
        dispense: when glue is laid; codes that it names switch an output of their own.

    Attributes:
        states: names of the outputs that were on at once, to which moves refer by `index`.
        index: of the present state.
    """

    def __init__(self, dispense: Dispense) -> None:
        self.states: list[tuple[str, ...]] = [()]
        self.index = 0
        self._dispense = dispense
        self._met: dict[str, _Output] = {}
        self._numbers: dict[tuple[str, ...], int] = {(): 0}
        # code with which the spindle turns
        self._turns = ""
        self._speed: float | None = None
        self._has_speeds = (
            False  # whether a speed other than 0 was met: a S0 that stands in every block switches nothing
        )

    @property
    def now(self) -> tuple[str, ...]:
        """Names of the outputs that are on."""
        return self.states[self.index]

    def switch(self, codes: Iterable[int], number: float | None, speed: float | None) -> None:
        """Apply the M codes of a block.

        Args:
            codes: numbers of the M codes.
            number: P.
            speed: S, of the spindle or of M106, which are off at 0.
        """
        on = dict.fromkeys(self.now)
        if speed is not None:
            self._speed = speed
            self._has_speeds |= speed != 0
        for code in codes:
            if self._dispense.on:
                switched = self._dispense.switch(code, number)
                if switched is not None:
                    self._set(on, _VALVE, f"M{code}", switched)
            elif code in CODES:
                self._apply(on, code, number, speed)
        if _SPINDLE in self._met:
            runs = self._turns and self._speed != 0
            self._set(on, _SPEED, self._turns if runs else _STANDS if self._turns else _STOPS, bool(runs))
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
        elif code == _FAN and speed == 0:
            name = f"{name} {_STANDS}"
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

    def valve(self, feeds_material: bool = False) -> Valve:
        """Return what opens the valve, at the end of a program.

        Args:
            feeds_material: whether its moves feed material by E.
        """
        by = self._dispense.by
        if by in ("feed", "extrusion") or (by == "auto" and feeds_material):
            return Valve("feed" if by == "feed" else "extrusion")
        order = [_VALVE, *dict.fromkeys(output for output, _ in CODES.values()), _SPEED]
        ranks = {name: order.index(name) if name in order else 0 for name in self._met}
        twin = _SPINDLE if self._has_speeds else _SPEED
        outputs = sorted(
            (name for name, met in self._met.items() if met.times and name != twin),
            key=lambda name: (-self._met[name].times, not self._met[name].off, ranks[name]),
        )
        if not outputs:
            return Valve("feed" if by == "auto" and not self._dispense.on else "codes")
        first, *others = outputs
        met = self._met[first]
        return Valve(
            by="codes",
            output=first,
            on=tuple(met.on) if first != _VALVE else self._dispense.on,
            off=tuple(met.off) if first != _VALVE else self._dispense.off,
            others=tuple((tuple(self._met[name].on), tuple(self._met[name].off)) for name in others),
            at_work=by == "auto",
        )


@dataclass(frozen=True)
class Valve:
    """What opens the valve in a program.

    Attributes:
        by: "feed": moves at feed; "codes": an output; "extrusion": moves that feed material.
        output: name of the output; empty where none does.
        on: codes that switch it on.
        off: codes that switch it off.
        others: codes on and off of the outputs that do not open it.
        at_work: whether the output opens it in moves at feed and dwells alone.
    """

    by: Literal["feed", "codes", "extrusion"]
    output: str = ""
    on: tuple[str, ...] = ()
    off: tuple[str, ...] = ()
    others: tuple[tuple[tuple[str, ...], tuple[str, ...]], ...] = ()
    at_work: bool = False

    def lays(
        self, work: NDArray[np.bool_], dwell: NDArray[np.bool_], is_on: NDArray[np.bool_], feeds: NDArray[np.bool_]
    ) -> NDArray[np.bool_]:
        """Return in which moves and dwells glue is laid, (m,).

        Args:
            work: whether it is a move at feed, not straight up or down; or a dwell at the bottom of a cycle, (m,).
            dwell: whether it is a dwell, (m,).
            is_on: whether the output is on, (m,).
            feeds: whether it feeds material, (m,).
        """
        match self.by:
            case "feed":
                return work
            case "extrusion":
                return feeds
        return is_on & (work | dwell) if self.at_work else is_on

    @property
    def note(self) -> str | None:
        """Which codes of the program switch the valve, in a sentence; None where none do, or the job names them."""
        if not self.output or self.output == _VALVE:
            return None
        closes = f"{_all(self.off)} closes it" if self.off else "nothing closes it"
        where = "in moves at feed, and in dwells" if self.at_work else "in all moves and dwells"
        sentence = (
            f"{_all(self.on)} opens the valve and {closes}: glue is laid {where}, while it is open; "
            "--set program.dispense.by=feed lays it in all moves at feed."
        )
        for on, off in self.others:
            named = {
                name: [code for code in codes if _STANDS not in code] for name, codes in (("on", on), ("off", off))
            }
            table = ", ".join(f"{name} = {json.dumps(codes)}" for name, codes in named.items() if codes)
            verb, them = ("do", "them") if off else ("does", "it")
            codes = " and ".join((*on, *off))
            sentence += f" {codes} {verb} not switch it; to let {them}, --set 'program.dispense={{{table}}}'."
        return sentence


def _all(codes: Sequence[str]) -> str:
    return " or ".join([", ".join(codes[:-1]), codes[-1]] if len(codes) > 1 else codes)


def is_upright(start: Sequence[float], end: Sequence[float]) -> bool:
    """Return whether a move leads straight up or down, from and to x, y, z [mm]."""
    return max(abs(end[0] - start[0]), abs(end[1] - start[1])) <= SAME_PLACE < abs(end[2] - start[2])


@cache
def _switches(on: tuple[str, ...], off: tuple[str, ...]) -> dict[tuple[int, float | None], bool]:
    return {_code(name): opens for names, opens in ((on, True), (off, False)) for name in names}


def _code(name: str) -> tuple[int, float | None]:
    parts = name.upper().split()
    try:
        if not 1 <= len(parts) <= 2 or parts[0][0] != "M" or (len(parts) == 2 and parts[1][0] != "P"):
            raise ValueError
        return int(parts[0][1:]), float(parts[1][1:]) if len(parts) == 2 else None
    except ValueError:
        raise InputError(f"dispense code {name!r}: must be an M code, as M3, or with its P, as M64 P0") from None
