"""The sections of a page: text, tables, figures and video; and what a search for changes in a job adds to it."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from gantrysim.base.errors import InputError
from gantrysim.base.quantity import Quantity, number_text, with_minus
from gantrysim.results.colours import INK

LEAD = 30  # words of the sentence with which a page begins
_LEAST_LEAD = 8  # words; a shorter clause is taken with what follows it
_SENTENCE_END = re.compile(r"(?<=[.!?])\s+(?=[A-Z])")

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gantrysim.report.answer import Answer, Remedy
    from gantrysim.report.plots.pictures import Plot

    Drawing: TypeAlias = Figure | Plot | Callable[[], Figure]


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes:
        head: its title, with the unit in brackets.
        format: format of its numbers that are not integers, as in ".1f".
    """

    head: str
    format: str = ".4g"

    @classmethod
    def of(cls, quantity: Quantity[Any]) -> Column:
        """Return the column of a quantity, whose cells are numbers in its unit."""
        return cls(quantity.head, quantity.form)


@dataclass(frozen=True)
class Table:
    """A table; a column without text is numeric and right-aligned.

    Attributes:
        columns: titles with units in brackets, or columns with a format.
        rows: rows of cells: text, numbers, or None for an empty cell.
        caption: what the table shows.
        colours: colour of the mark before the first cell of a row, by the text of that cell, as in a plot's legend.
        folded: heading that alone is seen at first, where scripts run; empty for a table that is seen.
    """

    columns: Sequence[str | Column]
    rows: Sequence[Sequence[Any]]
    caption: str | None = None
    colours: dict[str, str] = field(default_factory=dict)
    folded: str = ""

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise InputError(f"table row {list(row)}: has {len(row)} cells, must have {len(self.columns)}")

    def mark(self, cell: str) -> str | None:
        """Return the CSS colour of the mark before a cell, the text's own for the plots' ink; None for no mark."""
        colour = self.colours.get(cell)
        return "currentColor" if colour == INK else colour

    @property
    def heads(self) -> list[str]:
        return [column if isinstance(column, str) else column.head for column in self.columns]

    @property
    def numeric(self) -> list[bool]:
        """Whether each column is numeric."""
        columns = [[row[k] for row in self.rows if row[k] is not None] for k in range(len(self.columns))]
        return [bool(cells) and not any(isinstance(cell, str) for cell in cells) for cells in columns]

    @property
    def cells(self) -> list[list[str]]:
        """The cells as text."""
        formats = [Column("").format if isinstance(column, str) else column.format for column in self.columns]
        return [[_cell(cell, form) for cell, form in zip(row, formats, strict=True)] for row in self.rows]


@dataclass(frozen=True)
class Section:
    """A section of a page.

    Attributes:
        title: heading, also listed in the page's contents.
        text: a paragraph, or several.
        figure: a matplotlib figure, or several, side by side where there is room: the page is 10.7 inches wide. A
            function draws its own only when it is its turn, as figures take memory.
        table: a table, or several.
        facts: values shown large: name, value with its unit, and a remark.
        video: MP4 file, read when the page is written; without it a section of nothing else is left out.
        poster: returns a JPEG picture that stands in the film's place until it plays.
        code: preformatted text.
        viewer: content of the page's viewer as JSON, see `gantrysim.report.viewer_data`; one section of a page at most.
        in_space: whether the viewer has a 3-D view, whose script is twice as large as the rest.
        still: figures that the viewer replaces on a screen; they remain in print and where scripts do not run.
        folded: whether only the heading is seen at first; on a page with a viewer, only where scripts run.
        answer: what the first screen says of a run; its section also holds the viewer's first view.
    """

    title: str
    text: str | Sequence[str] | None = None
    figure: Drawing | Sequence[Drawing] | None = None
    table: Table | Sequence[Table] | None = None
    facts: Sequence[tuple[str, str, str]] = ()
    video: Path | None = None
    poster: Callable[[], bytes] | None = None
    code: str | None = None
    viewer: str | None = None
    in_space: bool = False
    still: Drawing | Sequence[Drawing] | None = None
    folded: bool = False
    answer: Answer | None = None

    @property
    def has_figures(self) -> bool:
        """Whether there are figures, on a screen or in print."""
        return self.figure is not None or self.still is not None

    def content(self) -> dict[str, Any]:
        """Return what can be read of it for JSON: paragraphs, facts, tables and code."""
        text = [self.text] if isinstance(self.text, str) else [*(self.text or ())]
        tables = [self.table] if isinstance(self.table, Table) else [*(self.table or ())]
        return {
            "title": self.title,
            "text": text,
            "facts": [list(fact) for fact in self.facts],
            "tables": [
                {"caption": table.caption, "heads": table.heads, "rows": table.cells, "numeric": table.numeric}
                for table in tables
            ],
            "code": self.code,
        }

    @property
    def lacks_video(self) -> bool:
        """Whether the section is nothing but a video, and that does not exist."""
        missing = self.video is not None and not self.video.exists()
        return missing and self.viewer is None and self.figure is None


@dataclass(frozen=True)
class Changes:
    """What a search for changes in a job has found.

    Attributes:
        remedy: in short, for the first screen.
        section: in full.
    """

    remedy: Remedy
    section: Section


def lead_of(text: str) -> str:
    """Return the sentence with which a page begins, of `LEAD` words at most: the first of a text, or its first clauses.

    A text that has no such clause is returned whole.
    """
    sentence = _SENTENCE_END.split(text.strip(), maxsplit=1)[0]
    if len(sentence.split()) <= LEAD:
        return sentence
    depth = 0
    ends: dict[str, int] = {}
    for k, letter in enumerate(sentence):
        if letter in ";:," and sentence[k + 1 : k + 2] == " " and not depth and len(sentence[:k].split()) <= LEAD:
            ends["clause" if letter in ";:" else "part"] = k
        depth += (letter == "(") - (letter == ")")
    end = ends.get("clause", ends.get("part"))
    if end is not None and len(sentence[:end].split()) < _LEAST_LEAD:
        end = max(ends.values())
    return sentence if end is None else f"{sentence[:end]}."


def _cell(cell: Any, form: str) -> str:
    if isinstance(cell, str):
        return cell
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    return with_minus(str(cell)) if isinstance(cell, Integral) else number_text(cell, form)
