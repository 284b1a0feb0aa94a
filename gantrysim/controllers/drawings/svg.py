"""Drawings in SVG: shapes with all transforms applied, in mm, y up from the lower edge of the page."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Iterator
from typing import Any
from xml.etree import ElementTree

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.base.extras import extra
from gantrysim.controllers.drawings.shapes import Ellipse, Segment, Shape, Sheet, Stroke, bezier, point

_NAMESPACE = "{http://www.w3.org/2000/svg}"
_LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"
_NESTED_ELEMENTS = 100  # nested elements
_MOST_ELEMENTS = 100_000  # elements, those that are reused counted each time
_MOST_REUSED = 10_000  # of these, beyond those that stand in the file
_MOST_NUMBERS = 400_000  # of all paths and points: twice as many as a drawing may have pieces
_MOST_DIGITS = 100  # of one of them
_ATTRIBUTE_LENGTH = 10_000  # characters of any other attribute that is read
_ABSOLUTE = re.compile(r"\s*[+]?((?:\d+(?:\.\d*)?|\.\d+)(e[+-]?\d+)?)(?:\s*(px|pt|pc|mm|cm|in))?\s*", re.IGNORECASE)
_IN_PX = {"px": 1.0, "pt": 96 / 72, "pc": 16.0, "mm": 96 / 25.4, "cm": 960 / 25.4, "in": 96.0}
_DIGITS = re.compile(r"[0-9.]+")
# no longer a name than there is: on a long run of letters the time would grow with the square of its length
_FUNCTION = re.compile(r"([a-z]{1,10})\s*\(([^()]*)\)[\s,]*", re.IGNORECASE)
_ARGUMENT = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?(?:px|pt|pc|mm|cm|in|deg|grad|rad|turn)?", re.IGNORECASE)
# numbers that each function of a transform takes
_TRANSFORM_NUMBERS = {
    **{name: {1} for name in ("translatex", "translatey", "scalex", "scaley", "skewx", "skewy")},
    **{name: {1, 2} for name in ("translate", "scale", "skew")},
    "rotate": {1, 3},
    "matrix": {6},
}
_CONTAINERS = {"svg", "g", "a", "switch", "symbol", "use", "defs", "style", "title", "desc", "metadata"}
_SHAPES = {"path", "rect", "circle", "ellipse", "line", "polyline", "polygon"}


def read_svg(text: str, unit: float | None) -> Sheet:
    """Return the strokes of an SVG document.

    Args:
        text: the file's content.
        unit: length of a user unit, instead of what width, height and viewBox state; None for that [mm].

    Raises:
        InputError: a document that is malformed or too large.
    """
    with extra("drawings", "svg"):
        import svgelements

    try:
        root = ElementTree.fromstring(text.strip())
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(f"svg: {error}: must be well-formed XML") from None
    if root.tag.removeprefix(_NAMESPACE) != "svg":
        raise InputError(f"svg: document <{root.tag[:40]}>: must be <svg>")
    if not root.tag.startswith(_NAMESPACE):
        raise InputError('svg: must state its namespace, xmlns="http://www.w3.org/2000/svg"')
    ignored = _check(root)
    _check_lengths(root)
    for item in root.iter(f"{_NAMESPACE}style"):
        item.text = _rules(item.text or "")
    remarks, px = _size(root, unit)
    remarks += _dropped_transforms(root)
    _hide_symbols(root)
    plain = ElementTree.tostring(root, encoding="unicode")
    try:
        document = svgelements.SVG.parse(io.StringIO(plain), reify=False, ppi=96.0, on_error="raise")
    except Exception as error:  # svgelements raises errors of many kinds for malformed attributes
        raise InputError(f"svg: {_short(error)}: must be a valid drawing") from None
    height = document.height if isinstance(document.height, int | float) else 0.0
    strokes: list[Stroke] = []
    for element, names in _elements(document, frozenset()):
        if element.values.get("visibility") in ("hidden", "collapse"):
            ignored["invisible"] = ignored.get("invisible", 0) + 1
            continue
        try:
            strokes += _strokes(element, names, px, float(height))
        except InputError:
            raise
        except Exception as error:  # as above, while shapes are computed
            raise InputError(f"svg: {_where(element)}: {_short(error)}: must be a valid shape") from None
    return Sheet(tuple(strokes), ignored, remarks)


def _short(error: Exception) -> str:
    # the library raises errors without a text for numbers and commands that it cannot read
    return " ".join(str(error).split())[:100].rstrip(". ") or "a path, length or transform that cannot be read"


def _check(root: ElementTree.Element) -> dict[str, int]:
    """Check depth and size of a document, reused elements among it; return the elements that are not traced."""
    ignored: dict[str, int] = {}
    named = {item.get("id"): item for item in root.iter() if item.get("id")}
    written = sum(1 for _ in root.iter())
    count = 0
    waiting = [(root, 1)]
    while waiting:
        item, depth = waiting.pop()
        count += 1
        if depth > _NESTED_ELEMENTS:
            raise InputError(f"svg: elements nested, or reused, more than {_NESTED_ELEMENTS} deep: must be at most so")
        if count > _MOST_ELEMENTS:
            raise InputError(f"svg: more than {_MOST_ELEMENTS} elements: must be at most so many")
        if count > written + _MOST_REUSED:
            raise InputError(
                f"svg: <use> repeats more than {_MOST_REUSED} elements: must be fewer, or real copies (Inkscape: "
                "unlink the clones)"
            )
        kind = str(item.tag).removeprefix(_NAMESPACE)
        if kind not in _CONTAINERS | _SHAPES and str(item.tag).startswith(_NAMESPACE):
            ignored[f"<{kind}>"] = ignored.get(f"<{kind}>", 0) + 1
            if kind not in {"clipPath", "mask", "marker", "pattern"}:
                continue
        waiting += [(child, depth + 1) for child in item]
        if kind == "use":
            link = item.get("href") or item.get("{http://www.w3.org/1999/xlink}href") or ""
            target = named.get(link.removeprefix("#"))
            if target is not None:
                waiting.append((target, depth + 1))
    return ignored


def _check_lengths(root: ElementTree.Element) -> None:
    """Raise InputError for attributes so long that the library, whose time grows faster than they, would take minutes.

    Long attributes of elements that are not traced, such as an image's, are removed.
    """
    numbers = 0
    for item in root.iter():
        traced = str(item.tag).removeprefix(_NAMESPACE) in _CONTAINERS | _SHAPES
        for name, value in list(item.attrib.items()):
            if name in ("d", "points"):
                item.set(name, " ".join(value.split()))
                runs = list(map(len, _DIGITS.findall(value)))
                numbers += len(runs)
                if max(runs, default=0) > _MOST_DIGITS:
                    raise InputError(
                        f"svg: number of {max(runs)} characters in {name}: must have at most {_MOST_DIGITS}"
                    )
            elif len(value) > _ATTRIBUTE_LENGTH and (not traced or name.startswith("{")):
                del item.attrib[name]
            elif len(value) > _ATTRIBUTE_LENGTH:
                raise InputError(
                    f"svg: {name[:40]} of {len(value)} characters: must have at most {_ATTRIBUTE_LENGTH}, as only d "
                    "and points may have more"
                )
    if numbers > _MOST_NUMBERS:
        raise InputError(
            f"svg: {numbers} numbers in paths and points: must be at most {_MOST_NUMBERS}; simplify or divide the "
            "drawing"
        )


def _rules(style: str) -> str:
    """Return the rules of a style sheet, "selector{body}" each, without comments, incomplete rules and runs of blanks.

    On other text the time of the library's regular expressions would grow with the third power of its length.
    """
    parts = style.split("/*")
    plain = " ".join([parts[0], *(part.partition("*/")[2] for part in parts[1:])])
    rules = [" ".join(part.split()) for part in plain.split("}")[:-1]]
    return "".join(f"{rule}}}\n" for rule in rules if rule.count("{") == 1)


def _size(root: ElementTree.Element, unit: float | None) -> tuple[tuple[str, ...], float]:
    """Give the document a size in px; return remarks and the length of a px [mm]."""
    box = re.split(r"[\s,]+", (root.get("viewBox") or "").strip())
    stated = [_ABSOLUTE.fullmatch(root.get(name) or "") for name in ("width", "height")]
    sizes = [float(size[1]) * _IN_PX[(size[3] or "px").lower()] for size in stated if size]
    remarks: tuple[str, ...] = ()
    if unit is None and len(sizes) == 2:
        pass
    elif len(box) == 4 and all(map(_ABSOLUTE.fullmatch, box[2:])):
        sizes = [float(length) for length in box[2:]]
    else:  # user units are px
        root.attrib.pop("viewBox", None)
        sizes = sizes if len(sizes) == 2 else [0.0, 0.0]
    if unit is None and not all(size and size[3] for size in stated):
        remarks = ("unit: the drawing states no length; a px is taken as 25.4/96 mm",)
    for name, size in zip(("width", "height"), sizes, strict=True):
        root.set(name, repr(size))
    return remarks, 25.4 / 96 if unit is None else unit


def _dropped_transforms(root: ElementTree.Element) -> tuple[str, ...]:
    """Remove transforms that are none, of which the library would apply a part; return a remark that names the first.

    Browsers draw such an element without its transform.
    """
    dropped = []
    for item in root.iter():
        stated = item.get("transform", "").strip()
        if stated and stated != "none" and not _is_transform(stated):
            del item.attrib["transform"]
            dropped.append(
                f"<{str(item.tag).removeprefix(_NAMESPACE)}> {item.get('id') or ''}".strip() + f": {stated[:60]}"
            )
    if not dropped:
        return ()
    others = f", and {len(dropped) - 1} more" if len(dropped) > 1 else ""
    return (f"transform that cannot be read ({dropped[0]}{others}): without it, as browsers draw it",)


def _is_transform(stated: str) -> bool:
    """Return whether a text is a list of functions, each with as many numbers as it takes."""
    for name, numbers in _FUNCTION.findall(stated):
        between = _ARGUMENT.sub("", numbers).replace(",", " ")
        if between.strip() or len(_ARGUMENT.findall(numbers)) not in _TRANSFORM_NUMBERS.get(name.lower(), set()):
            return False
    return not _FUNCTION.sub("", stated).strip()


def _hide_symbols(root: ElementTree.Element) -> None:
    """Put symbols into definitions: they are drawn only where they are used."""
    for parent in list(root.iter()):
        for k, child in enumerate(parent):
            if child.tag == f"{_NAMESPACE}symbol":
                parent[k] = ElementTree.Element(f"{_NAMESPACE}defs")
                parent[k].append(child)


def _elements(group: Any, names: frozenset[str]) -> Iterator[tuple[Any, frozenset[str]]]:
    """Shapes in their order, with the names of their groups."""
    from svgelements import Shape

    for element in group:
        all_names = names | _names(element)
        if isinstance(element, Shape):
            yield element, all_names
        elif isinstance(element, list):
            yield from _elements(element, all_names)


def _names(element: Any) -> frozenset[str]:
    """Return the id, Inkscape's label and the stroke's colour of an element itself."""
    attributes = (getattr(element, "values", None) or {}).get("attributes", {})
    names = {str(attributes[key]).lower() for key in ("id", _LABEL) if attributes.get(key)}
    colour = getattr(element, "stroke", None)
    if colour is not None and colour.value is not None:
        names.add(str(colour.hexrgb).lower())
    return frozenset(names)


def _where(element: Any) -> str:
    return f"<{element.values.get('tag', 'path')}> {element.id or ''}".strip()


def _strokes(element: Any, names: frozenset[str], px: float, height: float) -> list[Stroke]:
    from svgelements import Move

    where = f"svg: {_where(element)}"
    m = element.transform
    turn = px * np.array([[m.a, m.c, 0.0], [-m.b, -m.d, 0.0], [0.0, 0.0, 0.0]], float)
    shift = px * point(m.e, height - m.f)

    def place(points: Floats) -> Floats:
        # numbers too large to be placed are refused by their stroke
        with np.errstate(over="ignore", invalid="ignore"):
            placed: Floats = points @ turn.T + shift
        return placed

    subpaths: list[list[Shape]] = [[]]
    for segment in element.segments(transformed=False):
        if isinstance(segment, Move):
            subpaths.append([])
            continue
        if segment.start is None or segment.end is None:
            raise InputError(f"{where}: must begin with a move")
        _append(subpaths[-1], _shape(segment).moved(place))
    return [Stroke(tuple(shapes), where, names) for shapes in subpaths if shapes]


def _append(shapes: list[Shape], shape: Shape) -> None:
    """Append a shape that has a length; an arc is joined to the arc of the same ellipse before it."""
    before = shapes[-1] if shapes else None
    if isinstance(shape, Segment):
        if not np.array_equal(shape.begin, shape.finish):
            shapes.append(shape)
    elif isinstance(shape, Ellipse) and not (shape.u.any() or shape.v.any()):
        return
    elif isinstance(shape, Ellipse) and isinstance(before, Ellipse) and _continues(before, shape):
        finish = (shape.finish - shape.begin) + before.finish
        shapes[-1] = Ellipse(before.centre, before.u, before.v, before.begin, finish)
    else:
        shapes.append(shape)


def _continues(before: Ellipse, after: Ellipse) -> bool:
    same = all(np.array_equal(getattr(before, name), getattr(after, name)) for name in ("centre", "u", "v"))
    gap = math.remainder(after.begin - before.finish, 2 * math.pi)
    return same and abs(gap) < 1e-9 and (after.finish > after.begin) == (before.finish > before.begin)


def _shape(segment: Any) -> Shape:
    from svgelements import Arc, CubicBezier, QuadraticBezier

    begin = _point(segment.start)
    end = _point(segment.end)
    if isinstance(segment, QuadraticBezier):
        return bezier(begin, _point(segment.control), end)
    if isinstance(segment, CubicBezier):
        return bezier(begin, _point(segment.control1), _point(segment.control2), end)
    # SVG: without a radius it is a straight line
    if isinstance(segment, Arc) and segment.rx and segment.ry:
        rotation = float(segment.get_rotation())
        c = math.cos(rotation)
        s = math.sin(rotation)
        u = float(segment.rx) * point(c, s)
        v = float(segment.ry) * point(-s, c)
        first = float(segment.get_start_t())
        return Ellipse(_point(segment.center), u, v, first, first + float(segment.sweep))
    # a line, or the closing one
    return Segment(begin, end)


def _point(place: Any) -> Floats:
    return point(float(place.x), float(place.y))
