"""What to change where no loop keeps its margins: each proposal is a servo that was derived and checked."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from gantrysim.base.errors import InputError
from gantrysim.servo.derivation import LARGEST_PEAK, LEAST_GAIN_MARGIN, NoLoopError, natural_frequency
from gantrysim.servo.drive_settings import LOOPS
from gantrysim.servo.laws import ADDITIONS, P_PI, PID
from gantrysim.servo.request import LARGEST_BANDWIDTH, Parts, ServoRequest

_PREFERRED_NUMBERS = (1.0, 1.25, 1.6, 2.0, 2.5, 3.2, 4.0, 5.0, 6.3, 8.0)  # steps of 10^(1/10), rounded
_LONGEST_INTEGRAL = 1e4  # longest integral time proposed, relative to that given
_WIDER_LOOPS = (2.0, 4.0, 8.0, 16.0)  # factors on current loops
_NARROWER_LOOPS = (2.0, 4.0, 8.0, 16.0)  # divisors of velocity loops
_SHORTER_PERIODS = (2, 4, 8)  # divisors of periods
_MOST_CHANGES = 3  # single changes named
_IDLE_LOOP = 0.1  # natural frequency of a loop not worth its name beside a useful one, relative to that
_NEARLY_STRONGEST = 0.5  # natural frequency with which a milder change will do, relative to that of the strongest
_USEFUL_LOOP = 0.1  # natural frequency of a loop that is worth a change, relative to what the lags leave room for


@dataclass(frozen=True)
class Change:
    """A value of a servo that can keep all loops from their margins, and values to take in its place.

    Attributes:
        name: argument of `Servo.derive`.
        present: its value, in words.
        values: to take in its place, from the nearest on, the last being the one that helps most.
        in_words: each of them, in words.
    """

    name: str
    present: str
    values: tuple[Any, ...]
    in_words: tuple[str, ...]

    def proposal(self, index: int) -> str:
        """Return the change to one of the values, in words."""
        return f"{self.name} = {self.in_words[index]}"


class _Tries:
    """Requests that were tried, each with one or more changes, and how fast a loop each gave."""

    def __init__(self, request: ServoRequest, attempt: Callable[[ServoRequest], Parts]) -> None:
        self._request = request
        self._attempt = attempt
        self._speeds: dict[tuple[tuple[str, int], ...], float] = {}
        self.useful = _USEFUL_LOOP * natural_frequency(request.task.lag, request.damping)

    def speed(self, chosen: Mapping[Change, int]) -> float:
        """Return the natural frequency of the slowest axis with some changes, 0 where no loop keeps its margins [Hz].

        Args:
            chosen: the changes, each to the value of an index; a value out of its bounds gives no loop.
        """
        key = tuple(sorted((change.name, index % len(change.values)) for change, index in chosen.items()))
        if key not in self._speeds:
            changed = self._request
            for change, index in chosen.items():
                changed = _with(changed, change.name, change.values[index])
            try:
                self._speeds[key] = _slowest(changed, self._attempt(changed))
            except InputError:
                self._speeds[key] = 0.0
        return self._speeds[key]

    def nearest(self, change: Change, others: Mapping[Change, int]) -> dict[Change, int]:
        """Return the changes with the nearest value of one that serves nearly as well as its last, by bisection."""
        high = len(change.values) - 1
        enough = min(self.useful, _NEARLY_STRONGEST * self.speed({**others, change: high}))
        low = -1
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if self.speed({**others, change: middle}) >= enough else (middle, high)
        return {**others, change: high}


def _slowest(request: ServoRequest, servo: Parts) -> float:
    """Return the natural frequency of the slowest axis, kp / 2 pi of one around a velocity loop [Hz]."""
    rates = [
        gains.kp if mode == "velocity" else math.sqrt(gains.kp / axis.inertia)
        for gains, mode, axis in zip(servo.gains, servo.modes, request.axes, strict=True)
        if mode != "stepper"
    ]
    return min(rates, default=math.inf) / (2 * math.pi)


def refusal(request: ServoRequest, error: NoLoopError, attempt: Callable[[ServoRequest], Parts]) -> InputError:
    """Return the error for a servo without loops that keep their margins, with changes that were tried and have them.

    Args:
        request: what was asked for.
        error: which margins are too small.
        attempt: derives a servo from a request and checks its margins, and raises InputError where it has none.
    """
    request = request.checked()
    changes = _changes(request)
    tries = _Tries(request, attempt)
    remedies = _remedies(changes, tries)
    blamed = list(dict.fromkeys(change for remedy in remedies for change in remedy)) or changes
    present = ", ".join(f"{change.name} = {change.present}" for change in blamed)
    return InputError(
        f"servo {present}: no loop keeps a gain margin of {LEAST_GAIN_MARGIN:g} and a peak of |S| of at most "
        f"{LARGEST_PEAK:g} on every axis ({error.trouble}): {_advice(remedies, changes, tries)}"
    )


def _advice(remedies: Sequence[Mapping[Change, int]], changes: Sequence[Change], tries: _Tries) -> str:
    """Return what to change, in words."""
    if not remedies:
        strongest = " with ".join(change.proposal(-1) for change in changes)
        return f"tried in vain: {strongest}; give the gains" if changes else "give the gains"
    proposals = [
        f"{' with '.join(change.proposal(index) for change, index in remedy.items())} ({tries.speed(remedy):.3g} Hz)"
        for remedy in remedies
    ]
    advice = f"use {' or '.join(proposals)}, each tried"
    if any(change.name == "integral_time" for remedy in remedies for change in remedy):
        return f"an integral term makes slow loops unstable; {advice}"
    return advice


def _remedies(changes: Sequence[Change], tries: _Tries) -> list[dict[Change, int]]:
    """Return changes that each give a loop, the likeliest first: single ones, and several where none gives a fast one.

    A change comes with the index of its value.
    """
    single = [change for change in changes if tries.speed({change: -1})]
    remedies = [tries.nearest(change, {}) for change in single[:_MOST_CHANGES]]
    if any(tries.speed(remedy) >= tries.useful for remedy in remedies):
        return [remedy for remedy in remedies if tries.speed(remedy) >= _IDLE_LOOP * tries.useful]
    together = {change: len(change.values) - 1 for change in changes}
    if tries.speed(together) < tries.useful and (remedies or not tries.speed(together)):
        return remedies
    enough = min(tries.useful, tries.speed(together))
    # the first of the list are the likeliest causes, and stay the longest
    for change in reversed(changes):
        fewer = {other: index for other, index in together.items() if other is not change}
        if tries.speed(fewer) >= enough:
            together = fewer
    for change in list(together):
        others = {other: index for other, index in together.items() if other is not change}
        together = tries.nearest(change, others)
    in_order = {change: together[change] for change in changes if change in together}
    return remedies if in_order in remedies else [*remedies, in_order]


def _changes(request: ServoRequest) -> list[Change]:
    """Return what can keep the loops from their margins, the likeliest first."""
    changes = [
        _integral_time(request),
        _feedback(request),
        _current_bandwidth(request),
        _number("velocity_bandwidth", request.velocity_bandwidth, "Hz", _NARROWER_LOOPS),
        _feedback_delay(request),
        _delay(request),
        _law(request),
        Change("damping", f"{request.damping:g}", (1.0,), ("1",)) if request.damping != 1 else None,
        _period(request),
        _number("drive_period", request.inner_period, "s", _SHORTER_PERIODS) if LOOPS & set(request.modes) else None,
    ]
    return [change for change in changes if change is not None]


def _integral_time(request: ServoRequest) -> Change | None:
    time = request.used_integral_time
    if time == math.inf:
        return None
    longest = min(_LONGEST_INTEGRAL * time, sys.float_info.max)
    decades = range(math.floor(math.log10(time)), math.ceil(math.log10(longest)))
    longer = [float(f"{number}e{decade}") for decade in decades for number in _PREFERRED_NUMBERS]
    finite = [value for value in longer if time < value <= longest]
    in_words = (*(f"{value:g} s" for value in finite), "inf")
    return Change("integral_time", f"{time:g} s", (*finite, math.inf), in_words)


def _feedback(request: ServoRequest) -> Change | None:
    if "load" not in request.places:
        return None
    present = tuple(dict.fromkeys(request.places))
    motors = tuple("motor" if place == "load" else place for place in request.places)
    word = repr(present[0]) if len(present) == 1 else repr(list(request.places))
    return Change("feedback", word, (motors,), (repr("motor") if set(motors) == {"motor"} else repr(list(motors)),))


def _current_bandwidth(request: ServoRequest) -> Change | None:
    widths = request.bandwidths
    if not any(widths):
        return None
    wider = [tuple(_as_shown(min(factor * width, LARGEST_BANDWIDTH)) for width in widths) for factor in _WIDER_LOOPS]
    return Change("current_bandwidth", _in_words(widths), tuple(wider), tuple(_in_words(values) for values in wider))


def _in_words(widths: Sequence[float]) -> str:
    """Return bandwidths in words, in one number where they are the same."""
    if len(set(widths)) == 1:
        return f"{widths[0]:g} Hz"
    return f"[{', '.join(f'{width:g}' for width in widths)}] Hz"


def _feedback_delay(request: ServoRequest) -> Change | None:
    late = request.feedback_delay
    fewer = tuple(dict.fromkeys((late // 2, 0)))
    return Change("feedback_delay", str(late), fewer, tuple(map(str, fewer))) if late else None


def _delay(request: ServoRequest) -> Change | None:
    if not request.delay:
        return None
    half = _as_shown(0.5 * request.delay)
    return Change("delay", f"{request.delay:g} s", (half, 0.0), (f"{half:g} s", "0 s"))


def _law(request: ServoRequest) -> Change | None:
    """Return the law without what lies in its loop."""
    names = request.laws
    in_loop = [law.name for law in ADDITIONS.values() if law.answers_to_position]
    plain = tuple(PID.name if name == P_PI.name else name for name in names if name not in in_loop)
    if plain == names or not all(isinstance(name, str) for name in names):
        return None
    return Change("law", repr(list(names)), (plain,), (repr(list(plain)),))


def _period(request: ServoRequest) -> Change | None:
    """Return the change to a shorter servo period, no shorter than the servo's delay."""
    if set(request.modes) == {"position"}:
        # the loops are in the drives
        return None
    divisors = [divisor for divisor in _SHORTER_PERIODS if request.period / divisor >= request.delay]
    return _number("period", request.period, "s", divisors) if divisors else None


def _number(name: str, value: float | None, unit: str, divisors: Sequence[float]) -> Change | None:
    """Return the change of a number to a part of it."""
    if value is None:
        return None
    parts = tuple(_as_shown(value / divisor) for divisor in divisors)
    return Change(name, f"{value:g} {unit}", parts, tuple(f"{part:g} {unit}" for part in parts))


def _as_shown(value: float) -> float:
    """Return a value as a message shows it: what is proposed is what was tried."""
    return float(f"{value:g}")


def _with(request: ServoRequest, name: str, value: Any) -> ServoRequest:
    """Return a request with another value."""
    if name == "current_bandwidth":
        return replace(request, given={**request.given, name: value})
    return replace(request, **{name: value})
