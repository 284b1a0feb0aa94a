"""A page of sections with text, tables, figures and video, written as one HTML file."""

from __future__ import annotations

import base64
import math
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gantrysim.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NOTHING = "–"
_PIXELS_PER_INCH = 104  # of a figure: its type of 10 points is a little smaller than the text's


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes:
        head: what stands in it, with the unit in brackets.
        format: of its numbers that are not whole, as in ".1f".
    """

    head: str
    format: str = ".4g"


@dataclass(frozen=True)
class Table:
    """Rows under heads. A column without any text is one of numbers and stands to the right.

    Attributes:
        columns: the heads, with units in brackets, or columns with a format of their own.
        rows: of cells: text, numbers, or None for what there is not.
        caption: what the table shows.
        colours: of a mark before the first cell of a row, by that cell's text, as in a figure's legend.
    """

    columns: Sequence[str | Column]
    rows: Sequence[Sequence[Any]]
    caption: str | None = None
    colours: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise InputError(f"row {list(row)} of a table: has {len(row)} cells, must have {len(self.columns)}")

    @property
    def heads(self) -> list[str]:
        return [column if isinstance(column, str) else column.head for column in self.columns]

    @property
    def numeric(self) -> list[bool]:
        """Of each column, whether its cells are numbers."""
        return [
            any(cell is not None for cell in cells) and not any(isinstance(cell, str) for cell in cells)
            for cells in ([row[k] for row in self.rows] for k in range(len(self.columns)))
        ]

    @property
    def cells(self) -> list[list[str]]:
        """The cells as they are shown."""
        formats = [Column("").format if isinstance(column, str) else column.format for column in self.columns]
        return [[_cell(cell, form) for cell, form in zip(row, formats, strict=True)] for row in self.rows]


@dataclass(frozen=True)
class Section:
    """A part of a page; what it has is shown in this order.

    Attributes:
        title: heads the section, and the page's contents.
        text: a paragraph, or several.
        facts: single figures shown large: what, the value with its unit, and a remark.
        figure: a matplotlib figure, or several that stand side by side where there is room: one of 10.7 inches
            fills the width, and so do two of 5.3.
        table: a table, or several.
        alternative: for each figure the text that stands for it; without one it is made from the labels.
        html: markup that is put in as it is; what it holds must have been escaped.
        video: content of an MP4 file.
        code: text in which every space counts.
    """

    title: str
    text: str | Sequence[str] | None = None
    figure: Figure | Sequence[Figure] | None = None
    table: Table | Sequence[Table] | None = None
    html: str | None = None
    facts: Sequence[tuple[str, str, str]] = ()
    alternative: str | Sequence[str] | None = None
    video: bytes | None = None
    code: str | None = None


def write_page(
    file: str | os.PathLike[str],
    title: str,
    subtitle: str,
    sections: Sequence[Section],
    warning: str | None = None,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Write a page: one HTML file with style, figures and video in it, whole or not at all.

    The same content gives the same bytes. All text is escaped but `Section.html`.

    Args:
        file: the file to write; one that is there is replaced.
        title: of the page.
        subtitle: one line below the title.
        sections: from top to bottom.
        warning: what the reader must know before all else, as that a fault ended the run.
        progress: called with the share that is done.

    Raises:
        InputError: a section has more alternative texts than figures, or fewer.
        OSError: the file cannot be written.
    """
    from jinja2 import Environment, StrictUndefined  # slow to import, and needed by the reports alone
    from markupsafe import Markup

    own = files("gantrysim.report")
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    template = environment.from_string((own / "page.html").read_text(encoding="utf-8"))
    content = template.render(
        title=title,
        subtitle=subtitle,
        warning=warning,
        style=Markup((own / "page.css").read_text(encoding="utf-8")),
        sections=_shown(sections, progress or (lambda share: None)),
    )
    target = Path(file)
    partial = target.with_name(f".partial-{target.name}")
    try:
        partial.write_text(content, encoding="utf-8")
        partial.replace(target)
    finally:
        partial.unlink(missing_ok=True)


def _shown(sections: Sequence[Section], progress: Callable[[float], None]) -> list[dict[str, Any]]:
    """What the template shows of the sections."""
    from markupsafe import Markup

    from gantrysim.report.svg import description, inline_svg

    shown, names = [], set()
    for k, section in enumerate(sections):
        name = re.sub(r"[^a-z0-9]+", "-", section.title.lower()).strip("-") or "section"
        if name in names:
            name += f"-{k + 1}"
        names.add(name)
        drawn = _several(section.figure)
        given = _several(section.alternative) or [description(figure) for figure in drawn]
        if len(given) != len(drawn):
            raise InputError(
                f"section {section.title}: {len(given)} alternative texts, must be {len(drawn)}, one for each figure"
            )
        figures = [
            {
                "svg": Markup(inline_svg(figure, f"f{k + 1}-{i + 1}", text or section.title)),
                "width": round(_PIXELS_PER_INCH * figure.get_size_inches()[0]),
            }
            for i, (figure, text) in enumerate(zip(drawn, given, strict=True))
        ]
        shown.append(
            {
                "name": name,
                "title": section.title,
                "paragraphs": _several(section.text),
                "facts": section.facts,
                "tables": _several(section.table),
                "figures": figures,
                "html": None if section.html is None else Markup(section.html),
                "video": None if section.video is None else base64.b64encode(section.video).decode("ascii"),
                "code": section.code,
            }
        )
        progress((k + 1) / len(sections))
    return shown


def _several(content: Any) -> list[Any]:
    if content is None:
        return []
    return list(content) if isinstance(content, list | tuple) else [content]


def _cell(cell: Any, form: str) -> str:
    if cell is None:
        return _NOTHING
    if isinstance(cell, str):
        return cell
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    if math.isnan(cell):
        return _NOTHING
    if math.isinf(cell):
        return "∞" if cell > 0 else "−∞"
    text = str(cell) if isinstance(cell, Integral) else format(float(cell), form)
    if not text.startswith("-"):
        return text
    return f"−{text[1:]}" if float(text) else text[1:]  # what is rounded to zero has no sign
