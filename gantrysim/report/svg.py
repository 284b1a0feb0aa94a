"""Figures as SVG elements of an HTML page."""

from __future__ import annotations

import base64
import io
import re
from functools import lru_cache
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np

from gantrysim.plots.style import INK

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SAVING: dict[Any, Any] = {
    "svg.fonttype": "none",  # text stays text, searchable and accessible
    "path.simplify": True,
    "path.simplify_threshold": 0.25,  # [pt]
}
_HREF = "{http://www.w3.org/1999/xlink}href"
_NUMBER = re.compile(r"-?\d+\.\d+")
_FONT = re.compile(r"font: ([^;']*px) [^;]*")  # as matplotlib writes it
_FAMILY = re.compile(r"font-family: [^;]*; ?")
_REFERENCE = re.compile(r"url\(#([^)]+)\)")
_COMMAND = re.compile(r"([A-Za-z])([^A-Za-z]*)")
_POLYLINE = re.compile("M[^A-Za-z]*(L[^A-Za-z]*)*")
_LETTERS = re.compile("[ML]")
_COORDINATES = ("x", "y")
_PNG = "data:image/png;base64,"
_PALETTE = 256  # colours that an image with a palette has at most
_PATH = "{http://www.w3.org/2000/svg}path"
_RASTER_DPI = 150  # of images
_LONGEST = 300_000  # characters of a path; longer ones become images
_MANY = 5000  # points of a line that may be one of these
_DECIMALS = 2  # of coordinates [pt]


def inline_svg(figure: Figure, prefix: str, alternative: str) -> str:
    """Return a figure as an SVG element of an HTML page.

    It has no external references and no size but its view box; its ids begin with `prefix`. Black and the plots' ink
    become the text colour of the page, its fonts the page's. Lines are simplified within a quarter of a point.
    Formulas should use plain characters, as √12: a page lacks the fonts of mathtext.
    """
    import matplotlib  # slow to import

    with matplotlib.rc_context(_SAVING):
        root = _saved(figure)
        if any(len(path.get("d", "")) > _LONGEST for path in root.iter(_PATH)):
            _rasterise_lines(figure)
            root = _saved(figure)
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
    return ElementTree.tostring(root, encoding="unicode", short_empty_elements=True)


def _saved(figure: Figure) -> ElementTree.Element:
    file = io.BytesIO()
    figure.savefig(file, format="svg", dpi=_RASTER_DPI, transparent=True)
    return ElementTree.fromstring(file.getvalue())


def _rasterise_lines(figure: Figure) -> None:
    """Let lines of many points be images: the path of a long program covers itself, and simplifies to megabytes."""
    for axes in figure.axes:
        for line in axes.get_lines():
            if np.size(line.get_xdata()) > _MANY:
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


def _names(root: ElementTree.Element, prefix: str) -> dict[str, str]:
    """Return page-wide ids for those that are referred to, numbered in their order.

    Matplotlib's own are not reproducible: they are hashes of numbers from the layout solver.
    """
    used: set[str] = set()
    for element in root.iter():
        used.update(value[1:] for key, value in element.attrib.items() if key == _HREF and value.startswith("#"))
        used.update(*(_REFERENCE.findall(value) for value in element.attrib.values()))
    given = [element.attrib["id"] for element in root.iter() if element.attrib.get("id") in used]
    return {name: f"{prefix}-{k + 1}" for k, name in enumerate(given)}


def _make_local(element: ElementTree.Element, names: dict[str, str]) -> None:
    """Remove an element's namespace, and adapt its ids, colours and fonts to the page."""
    element.tag = _local(element.tag)
    attributes: dict[str, str] = {}
    for key, value in element.attrib.items():
        if key == "id":
            if value in names:
                attributes["id"] = names[value]
        elif key == _HREF:
            attributes["href"] = f"#{names[value[1:]]}" if value.startswith("#") else _with_palette(value)
        elif key == "d":
            attributes[key] = _short_path(value)
        elif key in _COORDINATES:
            attributes[key] = _NUMBER.sub(_rounded, value)
        else:
            text = _REFERENCE.sub(lambda match: f"url(#{names[match[1]]})", value)
            if key == "style":
                text = _FAMILY.sub("", _FONT.sub(r"font: \1 var(--sans)", text))
                for ink in ("#000000", INK):
                    text = text.replace(ink, "currentColor")
            attributes[key] = text
    element.attrib.clear()
    element.attrib.update(attributes)


def _local(tag: str) -> str:
    return tag.rpartition("}")[2]


def _with_palette(address: str) -> str:
    """Return the address of an image, whose colours are numbered where there are 256 at most: it is the same picture.

    The height map's image takes a seventh of the space then.
    """
    from PIL import Image

    if not address.startswith(_PNG):
        return address
    image = Image.open(io.BytesIO(base64.b64decode(address.removeprefix(_PNG)))).convert("RGBA")
    pixels = np.asarray(image).reshape(-1, 4).copy().view("<u4").ravel()
    starts = np.concatenate([[0], np.flatnonzero(np.diff(pixels)) + 1])  # of neighbours of one colour, to sort few
    colours, of_runs = np.unique(pixels[starts], return_inverse=True)
    if colours.size > _PALETTE:
        return address
    numbers = np.repeat(of_runs.astype(np.uint8), np.diff(starts, append=pixels.size))
    indexed = Image.fromarray(numbers.reshape(image.height, image.width), "P")
    palette = colours.view(np.uint8).reshape(-1, 4)
    indexed.putpalette(palette[:, :3].tobytes())
    file = io.BytesIO()
    indexed.save(file, "PNG", transparency=palette[:, 3].tobytes())
    return _PNG + base64.b64encode(file.getvalue()).decode("ascii")


def _short_path(data: str) -> str:
    """Return the commands of a path with coordinates relative to the point before, which have fewer digits.

    Differences are those of rounded coordinates, so that errors do not add up.

    Args:
        data: commands M, L, Q, C and Z in absolute coordinates, as matplotlib writes them.
    """
    if _POLYLINE.fullmatch(data):
        return _short_line(data)
    unit = 10**_DECIMALS
    here = [0, 0]
    start = here
    parts = []
    last = ""
    for command, text in _COMMAND.findall(data):
        numbers = [round(float(number) * unit) for number in text.split()]
        if command.upper() == "Z":
            parts.append("z")
            here = start
        elif command not in "MLQC":
            raise ValueError(f"path command {command}: must be M, L, Q, C or Z")
        else:
            name = command.lower()
            relative = [_short(number - here[k % 2]) for k, number in enumerate(numbers)]
            parts.append(_joined("" if name == last and name != "m" else name, relative))
            here = numbers[-2:]
            start = here if name == "m" else start
        last = command.lower()
    return "".join(parts)


def _short_line(data: str) -> str:
    """Return the commands of one line, see `_short_path`: most points of a page are those of lines."""
    points = np.array(_LETTERS.sub(" ", data).split(), dtype=np.float64).reshape(-1, 2)
    counts = np.rint(points * 10**_DECIMALS).astype(np.int64)
    steps = np.diff(counts, axis=0).ravel().tolist()
    move = _joined("m", [_short(count) for count in counts[0].tolist()])
    return move + _joined("l", [_short(step) for step in steps]) if steps else move


def _joined(command: str, numbers: list[str]) -> str:
    """Return a command, empty for the one before again, with its numbers; a minus separates as a space does."""
    text = " ".join(numbers).replace(" -", "-")
    return f" {text}" if not command and not text.startswith("-") else command + text


@lru_cache(maxsize=1 << 16)  # steps from point to point are small, and often the same
def _short(count: int) -> str:
    """Return a number of the smallest units, `10**-_DECIMALS`, as short text."""
    text = f"{count / 10**_DECIMALS:.{_DECIMALS}f}".rstrip("0").rstrip(".")
    return text.replace("0.", ".", 1) if text.startswith(("0.", "-0.")) else text


def _rounded(match: re.Match[str]) -> str:
    return f"{float(match[0]):.{_DECIMALS}f}".rstrip("0").rstrip(".")
