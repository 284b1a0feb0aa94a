"""Sizes in words, for sentences: no exponents, and shares beyond all measure as multiples."""

from __future__ import annotations

_LARGEST_PERCENT = 10.0  # share from which it is a multiple


def share_words(share: float, digits: int = 2) -> str:
    """Return a share of something that follows, as "25 % of", "2.5 % of" or "380 times"."""
    return times_words(share) if abs(share) >= _LARGEST_PERCENT else f"{_plain(100 * share, digits)} % of"


def change_words(share: float) -> str:
    """Return a change of a value by a share of it, as "35 %" or "380 times its value"."""
    return f"{times_words(share)} its value" if abs(share) >= _LARGEST_PERCENT else f"{_plain(100 * share, 2)} %"


def times_words(ratio: float, digits: int = 3) -> str:
    """Return a ratio, as "2.91 times" or "2,940 times"."""
    return f"{_plain(ratio, digits)} times"


def times_beside(ratio: float, *bounds: float) -> str:
    """Return a ratio as "2.91 times", with further digits where it would read as a bound that it misses."""
    words = times_words(ratio)
    return times_words(ratio, 6) if words in map(times_words, bounds) else words


def count_words(counts: float) -> str:
    """Return a size in counts of an encoder, as "3.2 counts" or "2,300 counts"."""
    return f"{_plain(counts, 2)} counts"


def number_words(value: float) -> str:
    """Return a number of four digits, a larger one as "80,070"."""
    return _plain(value, 4)


def _plain(value: float, digits: int) -> str:
    """Return a number of some digits, a larger one as a whole number."""
    return f"{value:,.0f}" if abs(value) >= 10**digits - 0.5 else f"{value:.{digits}g}"
