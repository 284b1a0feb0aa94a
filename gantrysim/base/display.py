"""How results show themselves: one line in a terminal, a picture and a small table in a notebook."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from html import escape

from gantrysim.base.quantity import joined


def decimals_of(whole: float) -> int:
    """Return the decimals that show the parts of a quantity to a hundred-thousandth of the whole."""
    return min(max(0, 5 - math.ceil(math.log10(max(whole, 1e-9)))), 9)


class Shown(ABC):
    """Mixin: repr and HTML table from `facts`, most important first."""

    @abstractmethod
    def facts(self) -> Mapping[str, str]:
        """Return the facts by name; nothing that takes long to compute."""

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{name}: {value}' for name, value in self.facts().items())})"

    def _repr_html_(self) -> str:
        return table_html(type(self).__name__, (), self.facts().items())


def table_html(title: str, heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in HTML; the first cell of a row is its head."""
    head = "".join(f"<th>{escape(name)}</th>" for name in heads)
    body = "".join(
        f"<tr><th>{escape(first)}</th>{''.join(f'<td>{escape(joined(cell))}</td>' for cell in cells)}</tr>"
        for first, *cells in rows
    )
    return f"<table><caption>{escape(title)}</caption>{f'<tr>{head}</tr>' if head else ''}{body}</table>"


def picture_html(picture: str, table: str) -> str:
    """Return a picture beside a table, both in HTML; below one another where there is no room."""
    beside = "display:flex;flex-wrap:wrap;align-items:center;gap:1.5em"
    return f'<div style="{beside}"><div>{picture}</div><div style="flex:1 1 22em">{table}</div></div>'


def svg_picture(content: str, box: tuple[float, float, float, float], title: str, width: int = 320) -> str:
    """Return a drawing as an SVG element that stands in a page of any background.

    Args:
        content: elements, in coordinates with y upwards.
        box: left, bottom, width and height of what is drawn.
        title: what it shows.
        width: of the picture [pixels]; it is no higher.
    """
    x, y, wide, high = box
    margin = 0.04 * max(wide, high)
    wide += 2 * margin
    high += 2 * margin
    scale = width / max(wide, high)
    view = f"{x - margin:.4g} {-(y + high - margin):.4g} {wide:.4g} {high:.4g}"
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{view}" width="{scale * wide:.0f}" '
        f'height="{scale * high:.0f}" role="img" aria-label="{escape(title)}">'
        f'<g transform="scale(1,-1)">{content}</g></svg>'
    )
