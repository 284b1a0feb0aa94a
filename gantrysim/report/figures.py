"""The figures of a page's sections as SVG elements of HTML; they may be drawn before the page is complete."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gantrysim.report.document import Section
from gantrysim.report.plots.pictures import Plot
from gantrysim.report.plots.style import common_style
from gantrysim.results.colours import INK

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gantrysim.report.document import Drawing


# a section's figures from left to right: SVG, width, and whether the viewer replaces it
Figures = list[dict[str, Any]]

_PIXELS_PER_INCH = 104  # of a figure: its type of 10 points is slightly smaller than the text

_SAVING: dict[Any, Any] = {
    "svg.fonttype": "none",  # text stays text, searchable and accessible
    "font.sans-serif": ["DejaVu Sans"],  # measures texts; the page's style sheet names others
    "path.simplify_threshold": 0.25,  # [pt]
}
_NO_METADATA: dict[str, Any] = dict.fromkeys(("Creator", "Date", "Format", "Type"))
_RASTER_DPI = 110  # of images
_PATH_LENGTH = 300_000  # characters of a path; longer ones become images
_POINTS_OF_A_LINE = 5000  # points of a line that may be one of these

_ROOT = re.compile(r"<svg[^>]*>\s*")
_VIEW_BOX = re.compile('viewBox="[^"]*"')
_STYLE_SHEET = re.compile("<style.*?</style>", re.DOTALL)
_TAG = re.compile("<[^>]*>")
_IMAGE = re.compile(r"(data:image/png;base64,)([^\"]*)")
_PATH = re.compile(' d="[^"]*"')
_COMMAND = re.compile(r"([MLQCz])\s*([-\d.\s]*)")
_HUNDREDTHS_OF_AN_INCH = 100.0
_ID = re.compile(r'( id="|href="#|url\(#)([^")]+)')


def figures_ahead(
    sections: Sequence[Section], folder: Path, progress: Callable[[float], None] | None = None
) -> dict[str, Figures]:
    """Return the figures of sections whose titles differ, by title; of `Plot`s, also write the pictures.

    A figure or picture that fails is left out: whoever needs it draws it again, and learns why it fails.

    Args:
        sections: of a page.
        folder: for the pictures.
        progress: called with the completed share.
    """
    figures = {}
    for k, section in enumerate(sections, 1):
        try:
            figures[section.title] = figures_of(section, section_name(section.title), folder)
        except Exception:  # raised again when the page is drawn
            continue
        if progress is not None:
            progress(k / len(sections))
    return figures


def figures_of(section: Section, name: str, folder: Path | None = None) -> Figures:
    """Return the figures of a section.

    Args:
        section: a section of a page.
        name: its name, unique on the page.
        folder: for the pictures of `Plot`s; None for none.
    """
    from markupsafe import Markup

    drawn = []
    replaced_by_viewer = several(section.still)
    for i, drawing in enumerate([*several(section.figure), *replaced_by_viewer], 1):
        figure = _figure_of(drawing, folder)
        alternative = ": ".join(filter(None, (section.title, description(figure))))
        svg = Markup(inline_svg(figure, f"{name}-f{i}", alternative))
        width = round(_PIXELS_PER_INCH * figure.get_size_inches()[0])
        drawn.append({"svg": svg, "width": width, "still": drawing in replaced_by_viewer})
    return drawn


def section_name(title: str) -> str:
    """Return the name of a section of a title, of lower-case letters, digits and hyphens."""
    return re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-") or "section"


def several(content: Any) -> list[Any]:
    """Return content of a section as a list: none, one, or several."""
    if content is None:
        return []
    return list(content) if isinstance(content, list | tuple) else [content]


def _figure_of(drawing: Drawing, folder: Path | None) -> Figure:
    if isinstance(drawing, Plot):
        return drawing.figure(folder)
    return drawing() if callable(drawing) else drawing


def inline_svg(figure: Figure, prefix: str, alternative: str) -> str:
    """Return a figure as an SVG element of an HTML page.

    It has no external references and no size but its view box; its ids begin with `prefix`. Black and the plots' ink
    become the text colour of the page. Coordinates of lines are rounded to hundredths of a point and written as steps
    from the point before, and lines simplified within a quarter of a point. Formulas should use plain characters, as
    √12: a page lacks the fonts of mathtext.
    """
    svg = _saved_svg(figure)
    if any(len(path) > _PATH_LENGTH for path in _PATH.findall(svg)):
        _rasterise_lines(figure)
        svg = _saved_svg(figure)
    root = _ROOT.search(svg)
    view_box = _VIEW_BOX.search(svg)
    assert root is not None
    assert view_box is not None
    # it would apply to the whole page
    content = _IMAGE.sub(_small_image, _STYLE_SHEET.sub("", svg[root.end() :]))
    ids: dict[str, str] = {}

    def new_id(match: re.Match[str]) -> str:
        # those of matplotlib return in other figures, or differ from one saving to the next
        return match[1] + ids.setdefault(match[2], f"{prefix}-{len(ids) + 1}")

    def adapted(tag: re.Match[str]) -> str:
        text = _PATH.sub(_short_path, tag[0])
        return _ID.sub(new_id, text).replace("#000000", "currentColor").replace(INK, "currentColor")

    title = f'<title id="{prefix}-title">{escape(alternative)}</title>'
    return f'<svg {view_box[0]} role="img" aria-labelledby="{prefix}-title">{title}{_TAG.sub(adapted, content)}'


def _short_path(match: re.Match[str]) -> str:
    """Return the attribute d of a path with its points as steps of hundredths, which is half as long."""
    path = ""
    last = ""
    x = y = 0
    start = (0, 0)
    for command, text in _COMMAND.findall(match[0]):
        numbers = [round(_HUNDREDTHS_OF_AN_INCH * float(number)) for number in text.split()]
        steps = [number - (x, y)[k % 2] for k, number in enumerate(numbers)]
        # steps of a line follow one another without its letter
        letter = "" if command == last == "L" else command.lower()
        path += letter + "".join(map(_hundredths, steps)).removeprefix(" " if letter else "")
        last = command
        x, y = numbers[-2:] if numbers else start
        start = (x, y) if command == "M" else start
    return f' d="{path}"'


def _small_image(match: re.Match[str]) -> str:
    """Return an image with the same pixels, compressed further where that is shorter."""
    from PIL import Image  # slow to import

    file = io.BytesIO()
    Image.open(io.BytesIO(base64.b64decode(match[2]))).save(file, format="png", optimize=True)
    short = base64.b64encode(file.getvalue()).decode("ascii")
    return match[1] + min(match[2], short, key=len)


def _hundredths(number: int) -> str:
    """Return a number of hundredths with what parts it from the one before."""
    ones, hundredths = divmod(abs(number), 100)
    text = f"{ones or ''}.{hundredths:02d}".rstrip("0").rstrip(".") or "0"
    return f"-{text}" if number < 0 else f" {text}"


def _saved_svg(figure: Figure) -> str:
    file = io.StringIO()
    with common_style(_SAVING):
        figure.savefig(file, format="svg", dpi=_RASTER_DPI, transparent=True, metadata=_NO_METADATA)
    return file.getvalue()


def _rasterise_lines(figure: Figure) -> None:
    """Let lines of many points be images: the path of a long program covers itself, and simplifies to megabytes."""
    for axes in figure.axes:
        for line in axes.get_lines():
            if np.size(line.get_xdata()) > _POINTS_OF_A_LINE:
                line.set_rasterized(True)


def description(figure: Figure) -> str:
    """Return a description of a figure, made from its titles, axis labels and line labels."""
    parts = []
    for axes in figure.axes:
        title = next((text for place in ("center", "left", "right") if (text := axes.get_title(loc=place))), "")
        against = " against ".join(label for label in (axes.get_ylabel(), axes.get_xlabel()) if label)
        lines = [str(line.get_label()) for line in axes.get_lines() if not str(line.get_label()).startswith("_")]
        sentence = ": ".join(part for part in (title, against) if part)
        if lines:
            sentence += f" ({', '.join(lines)})"
        if sentence.strip():
            parts.append(" ".join(sentence.split()))
    return ". ".join(parts)
