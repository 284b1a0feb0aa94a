"""How results show themselves: one line in a terminal, a small table in a notebook."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from html import escape


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
        f"<tr><th>{escape(first)}</th>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>"
        for first, *cells in rows
    )
    return f"<table><caption>{escape(title)}</caption>{f'<tr>{head}</tr>' if head else ''}{body}</table>"
