"""The figures of a page's sections as SVG; they may be drawn before the page is complete."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gantrysim.report.document import Section
from gantrysim.report.plots.pictures import Plot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gantrysim.report.document import Drawing

# a section's figures from left to right: SVG, width, and whether the viewer replaces it
Figures = list[dict[str, Any]]

_PIXELS_PER_INCH = 104  # of a figure: its type of 10 points is slightly smaller than the text


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

    from gantrysim.report.svg import description, inline_svg

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
