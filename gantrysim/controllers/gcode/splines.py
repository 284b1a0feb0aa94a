"""Quadratic and cubic splines in the XY plane: Bézier curves as chords."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

from gantrysim.base.errors import InputError
from gantrysim.controllers.gcode.program_state import ProgramState, WordBlock

_CHORD = 1e-3  # largest distance of a chord from its curve [mm]
_MOST = 20_000  # chords of a curve


@dataclass(frozen=True)
class _Words:
    """The words of a spline, as x + iy in the program's coordinates [mm].

    Attributes:
        start: of the curve.
        end: of the curve.
        first: control point I J from the start; None without both.
        last: control point P Q from the end.
        start_height: z at the start [mm].
        rise: from the start to the end [mm].
    """

    start: complex
    end: complex
    first: complex | None
    last: complex
    start_height: float
    rise: float


def add_cubic(state: ProgramState, block: WordBlock) -> None:
    """Add a cubic curve; without I and J it goes on smoothly from the cubic curve before."""
    words = _taken(state, block)
    first = state.spline_control if words.first is None else words.first
    if first is None:
        raise InputError("G5 without I and J: must follow another G5")
    _add_chords(state, words, [words.start, words.start + first, words.end + words.last, words.end])
    state.spline_control = -words.last


def add_quadratic(state: ProgramState, block: WordBlock) -> None:
    """Add a quadratic curve."""
    words = _taken(state, block)
    state.spline_control = None
    _add_chords(state, words, [words.start, words.start + (words.first or 0j), words.end])


def _taken(state: ProgramState, block: WordBlock) -> _Words:
    if state.modes.plane:
        raise InputError(f"G5 in G{17 + state.modes.plane}: must be in G17")
    frames = state.frames
    before = frames.program(frames.here)
    i, j, p, q = (_length(block, letter, frames.unit) for letter in "IJPQ")
    after = frames.program(frames.end(block.values, in_machine=False))
    return _Words(
        start=complex(before[0], before[1]),
        end=complex(after[0], after[1]),
        first=None if i is None and j is None else complex(i or 0.0, j or 0.0),
        last=complex(p or 0.0, q or 0.0),
        start_height=before[2],
        rise=after[2] - before[2],
    )


def _length(block: WordBlock, letter: str, unit: float) -> float | None:
    value = block.values.pop(letter, None)
    return None if value is None else value * unit


def _add_chords(state: ProgramState, words: _Words, points: list[complex]) -> None:
    feed = state.feed_at(abs(words.end - words.start))
    for place, share in chords(points):
        height = words.start_height + share * words.rise
        state.line_to(state.frames.machine([place.real, place.imag, height]), feed)


def chords(points: list[complex]) -> Iterator[tuple[complex, float]]:
    """Yield the ends of chords of a quadratic or cubic Bézier curve, and the completed share of its parameter.

    With n chords of equal parameter a chord's distance is at most max |c''| / (8 n^2), and |c''| at most
    d (d - 1) times the largest second difference of the d + 1 control points.
    """
    degree = len(points) - 1
    second = max(abs(a - 2 * b + c) for a, b, c in zip(points, points[1:], points[2:], strict=False))
    n = max(math.ceil(math.sqrt(degree * (degree - 1) * second / (8 * _CHORD))), 1)
    if n > _MOST:
        raise InputError(f"spline of {n} chords: must be at most {_MOST}")
    for k in range(1, n + 1):
        level = points
        t = k / n
        while len(level) > 1:  # de Casteljau: points between neighbours, until one is left
            level = [(1 - t) * a + t * b for a, b in pairwise(level)]
        yield (points[-1] if k == n else level[0]), t
