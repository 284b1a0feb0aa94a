"""A page of sections with text, tables, figures and video, written as one self-contained HTML file."""

from __future__ import annotations

import base64
import os
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gantrysim.base.errors import InputError
from gantrysim.base.files import replaced
from gantrysim.base.quantity import Quantity, number_text
from gantrysim.plots.style import INK

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    Drawing = Figure | Callable[[], Figure]

_WIDE = 600  # width of a figure above which a narrow page has a narrow one of its own [pixels]
_PIXELS_PER_INCH = 104  # of a figure: its type of 10 points is slightly smaller than the text


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
        code: preformatted text.
        viewer: content of the page's viewer as JSON, see `gantrysim.report.viewer_data`; one section of a page at most.
        in_space: whether the viewer has a 3-D view, whose script is twice as large as the rest.
        still: figures that the viewer replaces on a screen; they remain in print and where scripts do not run.
        folded: whether only the heading is seen at first; on a page with a viewer, only where scripts run.
    """

    title: str
    text: str | Sequence[str] | None = None
    figure: Drawing | Sequence[Drawing] | None = None
    table: Table | Sequence[Table] | None = None
    facts: Sequence[tuple[str, str, str]] = ()
    video: Path | None = None
    code: str | None = None
    viewer: str | None = None
    in_space: bool = False
    still: Drawing | Sequence[Drawing] | None = None
    folded: bool = False

    @property
    def lacks_video(self) -> bool:
        """Whether the section is nothing but a video, and that does not exist."""
        missing = self.video is not None and not self.video.exists()
        return missing and self.viewer is None and self.figure is None


def with_minus(text: str) -> str:
    """Return a number as text with a minus sign in the place of a hyphen."""
    return f"−{text[1:]}" if text.startswith("-") else text


def write_page(
    file: str | os.PathLike[str],
    title: str,
    subtitle: str,
    sections: Sequence[Section],
    warning: str | None = None,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Draw and write a page, see `draw_page` and `DrawnPage.write`."""
    draw_page(title, subtitle, sections, warning, progress).write(file)


@dataclass(frozen=True)
class DrawnPage:
    """A page whose figures are drawn, which takes seconds; what takes longer, as a film, may come before it is written.

    Attributes:
        title: title of the page.
        subtitle: line below the title.
        sections: the unique name of each section, the section, and its figures as SVG with their widths.
        warning: shown above all else.
    """

    title: str
    subtitle: str
    sections: Sequence[tuple[str, Section, list[dict[str, Any]]]]
    warning: str | None = None

    def write(self, file: str | os.PathLike[str]) -> None:
        """Write the page as one HTML file that includes style, figures and video; an earlier one stays until then.

        The same content gives the same bytes. All text is escaped.

        Args:
            file: to write or replace.

        Raises:
            InputError: the file cannot be written.
        """
        from jinja2 import Environment, StrictUndefined  # slow to import
        from markupsafe import Markup

        folder = files("gantrysim.report")
        environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
        environment.filters.update(several=_several, base64=_base64)
        template = environment.from_string((folder / "page.html").read_text(encoding="utf-8"))
        content = template.render(
            title=self.title,
            subtitle=self.subtitle,
            warning=self.warning,
            style=Markup((folder / "page.css").read_text(encoding="utf-8")),
            viewer=_viewer_files() if any(section.viewer for _, section, _ in self.sections) else None,
            space=_space_script() if any(section.in_space for _, section, _ in self.sections) else None,
            sections=[entry for entry in self.sections if not entry[1].lacks_video],
        )
        with replaced(file) as partial:
            partial.write_text(content, encoding="utf-8")


def draw_page(
    title: str,
    subtitle: str,
    sections: Sequence[Section],
    warning: str | None = None,
    progress: Callable[[float], None] | None = None,
) -> DrawnPage:
    """Return a page with its figures drawn.

    Args:
        title: title of the page.
        subtitle: line below the title.
        sections: from top to bottom.
        warning: shown above all else, such as a fault that ended the run.
        progress: called with the completed share.
    """
    return DrawnPage(title, subtitle, list(_with_figures(sections, progress or (lambda share: None))), warning)


def _base64(file: Path) -> str:
    return base64.b64encode(file.read_bytes()).decode("ascii")


def _with_figures(
    sections: Sequence[Section], progress: Callable[[float], None]
) -> Iterator[tuple[str, Section, list[dict[str, Any]]]]:
    """Yield the unique name of each section, the section, and its figures as SVG."""
    names: set[str] = set()
    for k, section in enumerate(sections, 1):
        name = re.sub(r"[^a-z0-9]+", "-", section.title.lower()).strip("-") or "section"
        if name in names:
            name += f"-{k}"
        names.add(name)
        yield name, section, _drawn(section, f"f{k}")
        progress(k / len(sections))


def _drawn(section: Section, prefix: str) -> list[dict[str, Any]]:
    from markupsafe import Markup

    from gantrysim.report.narrow import make_narrow
    from gantrysim.report.svg import description, inline_svg

    drawn = []
    replaced_by_viewer = _several(section.still)
    for i, drawing in enumerate([*_several(section.figure), *replaced_by_viewer], 1):
        figure = drawing() if callable(drawing) else drawing
        alternative = ": ".join(filter(None, (section.title, description(figure))))
        svg = Markup(inline_svg(figure, f"{prefix}-{i}", alternative))
        width = round(_PIXELS_PER_INCH * figure.get_size_inches()[0])
        still = drawing in replaced_by_viewer
        narrow = None
        # not where it is folded, as a page's size and time count more there
        if width > _WIDE and not still and not section.folded and make_narrow(figure):
            narrow = Markup(inline_svg(figure, f"{prefix}-{i}n", alternative))
        drawn.append({"svg": svg, "width": width, "still": still, "narrow": narrow})
    return drawn


def _viewer_files() -> dict[str, Any]:
    """Return the viewer's script and style, which the page includes."""
    from markupsafe import Markup

    web = files("gantrysim.report") / "web"
    script = (web / "viewer.min.js").read_text(encoding="utf-8")
    style = "".join((web / name).read_text(encoding="utf-8") for name in ("uplot.css", "viewer.css"))
    return {"script": Markup(script), "style": Markup(style)}


def _space_script() -> str:
    """Return the script of the viewer's 3-D view, compressed by gzip, in base64; the page expands it."""
    script = files("gantrysim.report") / "web" / "viewer3d.min.js.gz"
    return base64.b64encode(script.read_bytes()).decode("ascii")


def _several(content: Any) -> list[Any]:
    if content is None:
        return []
    return list(content) if isinstance(content, list | tuple) else [content]


def _cell(cell: Any, form: str) -> str:
    if isinstance(cell, str):
        return cell
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    return with_minus(str(cell) if isinstance(cell, Integral) else number_text(cell, form))
