"""The instants of a log's rows: its sampling period, and the pieces between rows that are missing.

A model of a sampled servo has one period. A stamp that is off by a tenth of it shifts a position by a tenth of a step,
more than any delay that a log shows. Stamps that a program has rounded are no instants: then the period is given, and
they only show where rows are missing.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats, spans
from gantrysim.base.errors import InputError
from gantrysim.identify.sizes import share_words

EVEN_STAMP = 0.1  # largest deviation of a time stamp from an even one, of the period
_MISSING_ROWS = 1.5  # between two stamps, from which rows are missing, of the usual step
_AGREEING_PERIOD = 0.01  # largest difference between a given period and that of the stamps, of the period
LOG_ROWS = 100  # rows of a log
PIECE_ROWS = 20  # rows of a piece
_NAMED = 3  # places that a note names


class Instants(NamedTuple):
    """The instants of a log's rows.

    Attributes:
        period: of the samples [s].
        pieces: rows without a gap in between.
        begins: instant of the first row of each piece [s].
        notes: which rows are left out, and where a piece ends.
    """

    period: float
    pieces: tuple[slice, ...]
    begins: tuple[float, ...]
    notes: tuple[str, ...]


def instants_of(whole: NDArray[np.bool_], time: Floats | None, period: float | None, first: int = 1) -> Instants:
    """Return the instants of a log's rows.

    Args:
        whole: whether a row has all values, (n,).
        time: stamps of the rows, rising within a piece, (n,) [s]; None without.
        period: of the samples, where it is given [s]; stamps are then taken as rounded.
        first: number of the first row, for errors.

    Raises:
        InputError: too few rows, or stamps that are not even or not those of the given period.
    """
    if time is None and period is None:
        raise InputError("has neither time nor period")
    if time is not None:
        whole = whole & np.isfinite(time)
    stretches = [slice(int(begin), int(end)) for begin, end in spans(whole)]
    pieces = stretches if time is None else [part for piece in stretches for part in _parts(time, piece, period)]
    used = tuple(piece for piece in pieces if _size(piece) >= PIECE_ROWS)
    samples = sum(map(_size, used))
    if samples < LOG_ROWS:
        if time is not None and period is None and max(map(_size, stretches), default=0) >= LOG_ROWS:
            # no row is missing, but hardly a stamp is even
            _even_period(time, stretches, first)
        without = "" if samples == whole.size else f" in pieces of at least {PIECE_ROWS} without a gap"
        raise InputError(f"has {samples} samples{without}, must have at least {LOG_ROWS}")
    if time is None:
        begins = tuple(float(period or 0.0) * piece.start for piece in used)
        return _with_notes(whole.size, used, begins, float(period or 0.0))
    begins = tuple(float(time[piece.start]) for piece in used)
    if period is None:
        return _with_notes(whole.size, used, begins, _even_period(time, used, first))
    return _with_notes(whole.size, used, begins, period, _rounded_stamps(time, used, period))


def _size(piece: slice) -> int:
    return int(piece.stop - piece.start)


def _parts(time: Floats, rows: slice, period: float | None) -> list[slice]:
    """Return the parts of a stretch of rows between which others are missing, or the recording begins anew."""
    steps = np.diff(time[rows])
    if not steps.size:
        return [rows]
    if period is None:
        longest = _MISSING_ROWS * float(np.median(steps))
    else:
        # rounded stamps stand still for rows, or vary by what the period is not a multiple of
        shortest = float(steps[steps > 0].min(initial=np.inf))
        rounding = shortest if (steps == 0).any() else max(period - shortest, 0.0)
        longest = _MISSING_ROWS * period + rounding
    bounds = [rows.start, *(rows.start + 1 + np.flatnonzero((steps > longest) | (steps < 0))).tolist(), rows.stop]
    return [slice(a, b) for a, b in pairwise(bounds)]


def _even_period(time: Floats, pieces: Sequence[slice], first: int) -> float:
    """Return the period of even stamps, from all of them: a single difference may be rounded [s].

    Raises:
        InputError: stamps that repeat, or are uneven.
    """
    steps = sum(_size(piece) - 1 for piece in pieces)
    period = sum(float(time[piece.stop - 1] - time[piece.start]) for piece in pieces) / steps
    cure = "log at every servo tick, with all digits; if only the stamps are rounded, give the period by --period"
    for piece in pieces:
        stamps = time[piece]
        differences = np.diff(stamps)
        if not (differences > 0).all():
            row = int(np.argmin(differences > 0))
            raise InputError(
                f"time does not rise: rows {first + piece.start + row} and {first + piece.start + row + 1} have "
                f"{stamps[row]:g} and {stamps[row + 1]:g} s; {cure}"
            )
        late = np.abs(stamps - stamps[0] - period * np.arange(stamps.size))
        worst = int(np.argmax(late))
        if late[worst] > EVEN_STAMP * period:
            raise InputError(
                f"its samples are not even: at t = {stamps[worst]:g} s one is off by "
                f"{share_words(late[worst] / period, 3)} the period, {1e3 * period:.4g} ms: must be within "
                f"{share_words(EVEN_STAMP)} it; {cure}"
            )
    return period


def _rounded_stamps(time: Floats, pieces: Sequence[slice], period: float) -> str:
    """Return by how much stamps are off a given period, in a note; "" where they are even.

    Raises:
        InputError: the stamps are of another period.
    """
    worst = 0.0
    for piece in pieces:
        stamps = time[piece]
        steps = np.diff(stamps)
        rounding = float(steps[steps > 0].min(initial=np.inf))
        length = (stamps.size - 1) * period
        lasting = float(stamps[-1] - stamps[0])
        if abs(lasting - length) > _AGREEING_PERIOD * length + max(rounding, period):
            raise InputError(
                f"period = {period:g} s is given, but {stamps.size} rows last {lasting:.4g} s by their time, "
                f"{lasting / (stamps.size - 1):.4g} s each: must agree within {share_words(_AGREEING_PERIOD)} it"
            )
        ticks = np.arange(stamps.size)
        late = stamps - np.polyval(np.polyfit(ticks, stamps, 1), ticks)
        worst = max(worst, 0.5 * float(np.ptp(late)))
    if worst <= EVEN_STAMP * period:
        return ""
    return (
        f"log: its time stamps are off even ones by up to {share_words(worst / period)} the period; its samples are "
        f"taken to be even, {1e3 * period:.4g} ms apart, as the period is given"
    )


def _with_notes(
    rows: int, pieces: tuple[slice, ...], begins: tuple[float, ...], period: float, note: str = ""
) -> Instants:
    """Return the instants, with notes on the rows that are left out and on the places where a piece ends."""
    notes = [note] if note else []
    samples = sum(map(_size, pieces))
    if len(pieces) > 1:
        ends = [begin + period * (_size(piece) - 1) for begin, piece in zip(begins, pieces, strict=True)][:-1]
        places = ", ".join(f"{end:g} s" for end in ends[:_NAMED])
        further = f" and {len(ends) - _NAMED} times more" if len(ends) > _NAMED else ""
        notes.append(
            f"log: of {rows} rows, {samples} are used, in {len(pieces)} pieces, as rows or values are missing after "
            f"{places}{further}"
        )
    elif samples < rows:
        end = begins[0] + period * (samples - 1)
        notes.append(f"log: of {rows} rows, {samples} are used, those without a gap from {begins[0]:g} s to {end:g} s")
    return Instants(period, pieces, begins, tuple(notes))
