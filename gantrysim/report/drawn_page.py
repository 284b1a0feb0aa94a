"""A page of sections drawn, and written as one self-contained HTML file."""

from __future__ import annotations

import base64
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

from gantrysim.base.files import replaced_file
from gantrysim.base.quantity import joined
from gantrysim.report.answer import written_on
from gantrysim.report.document import Section
from gantrysim.report.encoding import packed
from gantrysim.report.figures import Figures, figures_of, section_name, several
from gantrysim.results.colours import css_variables


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
        date: when it was made.
    """

    title: str
    subtitle: str
    sections: Sequence[tuple[str, Section, Figures]]
    warning: str | None = None
    date: str = ""

    def write(self, file: str | os.PathLike[str]) -> None:
        """Write the page as one HTML file; an earlier one stays until then.

        Args:
            file: to write or replace.

        Raises:
            InputError: the file cannot be written.
        """
        content = self.html()
        with replaced_file(file) as partial:
            partial.write_text(content, encoding="utf-8")

    def html(self) -> str:
        """Return the page in HTML, with style, figures and video in it.

        The same content gives the same bytes. All text is escaped.
        """
        from jinja2 import Environment, StrictUndefined  # slow to import
        from markupsafe import Markup

        folder = files("gantrysim.report")
        environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
        environment.filters.update(several=several, base64=_base64, joined=joined, packed=packed)
        template = environment.from_string((folder / "page.html").read_text(encoding="utf-8"))
        return template.render(
            title=self.title,
            subtitle=self.subtitle,
            warning=self.warning,
            date=self.date,
            style=Markup(css_variables() + (folder / "page.css").read_text(encoding="utf-8")),
            viewer=_viewer_files() if any(section.viewer for _, section, _ in self.sections) else None,
            space=_space_script() if any(section.in_space for _, section, _ in self.sections) else None,
            sections=[entry for entry in self.sections if not entry[1].lacks_video],
        )


def draw_page(
    title: str,
    subtitle: str,
    sections: Sequence[Section],
    warning: str | None = None,
    progress: Callable[[float], None] | None = None,
    figures: Mapping[str, Figures] | None = None,
) -> DrawnPage:
    """Return a page with its figures drawn.

    Args:
        title: title of the page.
        subtitle: line below the title.
        sections: from top to bottom.
        warning: shown above all else, such as a fault that ended the run.
        progress: called with the completed share.
        figures: by a section's title, those that are drawn already, see `figures_ahead`.
    """
    ahead = figures or {}
    drawn = []
    for name, section in _with_names(sections):
        drawn.append((name, section, ahead.get(section.title) or figures_of(section, name)))
        if progress is not None:
            progress(len(drawn) / len(sections))
    return DrawnPage(title, subtitle, drawn, warning, written_on())


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode("ascii")


def _with_names(sections: Sequence[Section]) -> Iterator[tuple[str, Section]]:
    """Yield the unique name of each section, and the section."""
    names: set[str] = set()
    for k, section in enumerate(sections, 1):
        name = section_name(section.title)
        if name in names:
            name += f"-{k}"
        names.add(name)
        yield name, section


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
