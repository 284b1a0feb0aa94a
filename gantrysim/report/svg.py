"""AnalysisValues as SVG that stands inside an HTML page."""

from __future__ import annotations

import io
import re
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

from gantrysim.plots.style import INK

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SAVING: dict[Any, Any] = {
    "svg.fonttype": "none",  # text stays text: it can be searched, copied and read aloud
    "path.simplify": True,
    "path.simplify_threshold": 0.25,  # points of the page, 1/72 inch
}
_HREF = "{http://www.w3.org/1999/xlink}href"
_NUMBER = re.compile(r"-?\d+\.\d+")
_FONT = re.compile(r"font: ([^;']*px) [^;]*")  # as matplotlib writes it in one, or the family by itself
_FAMILY = re.compile(r"font-family: [^;]*; ?")
_UPRIGHT = re.compile(r" ?rotate\(-?0 [^)]*\)")
_REFERENCE = re.compile(r"url\(#([^)]+)\)")
_COORDINATES = ("d", "x", "y")
_RASTER_DPI = 150  # of what is no line and no text
_DECIMALS = 2  # a hundredth of a point


def inline_svg(figure: Figure, prefix: str, alternative: str) -> str:
    """Return a figure's SVG element, ready to stand in an HTML page.

    It names no address, sets no size but its view box, draws what is black or of the plots' ink in the page's own
    colour of text, writes in the page's font, and its ids begin with `prefix`. A line is simplified where that moves
    it by less than a quarter of a point. Formulas are best written in plain characters, as √12: those of mathtext stand
    in fonts that a page does not have.

    Args:
        figure: a matplotlib figure.
        prefix: of the ids, unique in the page.
        alternative: the text that stands for the figure where it cannot be seen.
    """
    import matplotlib  # slow to import, and needed by the plots alone

    file = io.BytesIO()
    with matplotlib.rc_context(_SAVING):
        figure.savefig(file, format="svg", dpi=_RASTER_DPI, transparent=True)
    root = ElementTree.fromstring(file.getvalue())
    names = _names(root, prefix)
    for element in list(root.iter()):
        for child in list(element):
            if _local(child.tag) in ("metadata", "style"):
                element.remove(child)
        _make_local(element, names)
    for key in ("width", "height", "version"):
        root.attrib.pop(key, None)
    title = ElementTree.Element("title", {"id": f"{prefix}-title"})
    title.text = alternative
    root.insert(0, title)
    root.attrib.update({"role": "img", "aria-labelledby": f"{prefix}-title"})
    _drop_bare_groups(root)
    return ElementTree.tostring(root, encoding="unicode", short_empty_elements=True)


def description(figure: Figure) -> str:
    """Return what a figure shows, from its titles, the labels of its axes and those of its lines."""
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


def _names(root: ElementTree.Element, prefix: str) -> dict[str, str]:
    """Names of the page for the ids that are referred to, in the order in which they are given.

    Matplotlib's own come from numbers whose last digits the layout's solver leaves open.
    """
    used: set[str] = set()
    for element in root.iter():
        used.update(value[1:] for key, value in element.attrib.items() if key == _HREF and value.startswith("#"))
        used.update(*(_REFERENCE.findall(value) for value in element.attrib.values()))
    given = [element.attrib["id"] for element in root.iter() if element.attrib.get("id") in used]
    return {name: f"{prefix}-{k + 1}" for k, name in enumerate(given)}


def _make_local(element: ElementTree.Element, names: dict[str, str]) -> None:
    """Take an element out of its name space, its ids into the page's, its colours and fonts to the page's."""
    element.tag = _local(element.tag)
    own: dict[str, str] = {}
    for key, value in element.attrib.items():
        if key == "id":
            if value in names:
                own["id"] = names[value]
        elif key == _HREF:
            own["href"] = f"#{names[value[1:]]}" if value.startswith("#") else value
        elif key in _COORDINATES:
            own[key] = _NUMBER.sub(_rounded, value)
        else:
            text = _REFERENCE.sub(lambda match: f"url(#{names[match[1]]})", value)
            if key == "style":
                text = _FAMILY.sub("", _FONT.sub(r"font: \1 var(--sans)", text))
                for ink in ("#000000", INK):
                    text = text.replace(ink, "currentColor")
            elif key == "transform":
                text = _UPRIGHT.sub("", text)
            if text:
                own[key] = text
    element.attrib.clear()
    element.attrib.update(own)
    if element.text is not None and not element.text.strip():
        element.text = None
    if element.tail is not None and not element.tail.strip():
        element.tail = None


def _drop_bare_groups(root: ElementTree.Element) -> None:
    """Put the children of groups that say nothing into their parents."""
    for child in list(root):
        _drop_bare_groups(child)
    children: list[ElementTree.Element] = []
    for child in list(root):
        children.extend(list(child) if child.tag == "g" and not child.attrib else [child])
        root.remove(child)
    root.extend(children)


def _local(tag: str) -> str:
    return tag.rpartition("}")[2]


def _rounded(match: re.Match[str]) -> str:
    return f"{float(match[0]):.{_DECIMALS}f}".rstrip("0").rstrip(".")
