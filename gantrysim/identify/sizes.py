"""Sizes in words, for sentences: counts are whole numbers, and shares beyond all measure are multiples."""

from __future__ import annotations

_LARGEST_PERCENT = 10.0  # share from which it is a multiple


def share_words(share: float) -> str:
    """Return a share of something that follows, as "25 % of", "2.5 % of" or "380 times"."""
    if abs(share) >= _LARGEST_PERCENT:
        return f"{times_words(share)}"
    return f"{_plain(100 * share)} % of"


def times_words(ratio: float) -> str:
    """Return a ratio, as "2.9 times" or "2,940 times"."""
    return f"{_plain(ratio)} times"


def count_words(counts: float) -> str:
    """Return a size in counts of an encoder, as "3.2 counts" or "2,300 counts"."""
    return f"{_plain(counts)} counts"


def _plain(value: float) -> str:
    """Return a number of two digits or more, without an exponent where it is large."""
    return f"{value:,.0f}" if abs(value) >= _WHOLE else f"{value:.2g}"


_WHOLE = 99.5  # from which two digits would be an exponent
