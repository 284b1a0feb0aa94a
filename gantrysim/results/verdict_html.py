"""A verdict for a notebook: its headline, and a row for path, glue, stability and machine."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from gantrysim.results.checks import SYMBOLS
from gantrysim.results.colours import STATES
from gantrysim.results.row import Row

_CELL = "text-align:left;padding:2px 8px"


def verdict_html(headline: str, rows: Sequence[Row]) -> str:
    """Return the verdict as a table in HTML: shape, word and colour of each row, and its worst value with the limit."""
    lines = "".join(
        f"<tr><td>{_badge(row.state)}</td>"
        f'<th style="{_CELL}">{escape(row.name)}</th><td style="{_CELL}">{escape(next(iter(row.texts), ""))}</td></tr>'
        for row in rows
    )
    title = f'<caption style="text-align:left;font-weight:bold">verdict {escape(headline)}</caption>'
    return f"<table>{title}{lines}</table>"


def _badge(state: str) -> str:
    """Return a state as its shape and word on its colour, which stands on any background."""
    style = f"background:{STATES[state]};color:#fff;padding:1px 7px;border-radius:3px;white-space:nowrap"
    return f'<span style="{style}">{SYMBOLS[state]} {escape(state)}</span>'
