"""Drawings in DXF: the entities of the model space, in mm."""

from __future__ import annotations

import io
import logging
import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.base.extras import extra
from gantrysim.controllers.drawings.shapes import Ellipse, Segment, Shape, Sheet, Spline, Stroke, bulged_line, point

BINARY = "AutoCAD Binary DXF"
_NAMES = {1: "red", 2: "yellow", 3: "green", 4: "cyan", 5: "blue", 6: "magenta", 7: "white"}  # of colour numbers
# $INSUNITS: inch, foot, mile, mm, cm, m, km, microinch, mil, yard, angstrom, nm, um, dm [mm]
_UNITS = {1: 25.4, 2: 304.8, 3: 1609344.0, 4: 1.0, 5: 10.0, 6: 1e3, 7: 1e6, 8: 25.4e-6, 9: 0.0254, 10: 914.4}
_UNITS |= {11: 1e-7, 12: 1e-6, 13: 1e-3, 14: 100.0}
# attributes without which an entity would be drawn with the library's defaults, such as a radius of 1
_REQUIRED_ATTRIBUTES = {
    "LINE": ("start", "end"),
    "CIRCLE": ("center", "radius"),
    "ARC": ("center", "radius", "start_angle", "end_angle"),
    "ELLIPSE": ("center", "major_axis", "ratio"),
    "POINT": ("location",),
}
_BY_BLOCK = 0
_BY_LAYER = 256
_NESTED_BLOCKS = 32  # nested blocks
_NAMED = 5  # entities in a remark
_MOST_ENTITIES = 200_000  # entities, those of blocks counted each time
_MOST_REPEATED = 10_000  # of these, beyond those that stand in the file
_X_CODES = range(10, 19)  # group codes of coordinates x,
_TO_Y = 10  # and from them to those of y
_SPLINE_FRAME = 16  # flag of a vertex that is a control point

logging.getLogger("ezdxf").addHandler(logging.NullHandler())  # its repairs are not printed


@dataclass
class _Reading:
    """The state of reading a drawing.

    Attributes:
        document: of ezdxf.
        dots: whether points are traced.
        ignored: entities that are not traced, by kind.
        without_extent: names of entities that lie in one point.
        count: entities so far.
    """

    document: Any
    dots: bool
    ignored: Counter[str] = field(default_factory=Counter)
    without_extent: list[str] = field(default_factory=list)
    count: int = 0


@dataclass(frozen=True)
class _Block:
    """Layer and colours that the entities of a block inherit from its reference."""

    layer: str
    colours: frozenset[str]


def read_dxf(text: str, unit: float | None, dots: bool) -> Sheet:
    """Return the strokes of a DXF drawing.

    Args:
        text: the file's content.
        unit: length of a unit of the drawing, instead of $INSUNITS; None for that [mm].
        dots: whether points are traced.

    Raises:
        InputError: a drawing that is binary, malformed or too large.
    """
    with extra("drawings", "dxf"):
        import ezdxf

    if text.startswith(BINARY):
        raise InputError("dxf: binary: must be saved as an ASCII DXF")
    repairs: tuple[str, ...] = ()
    try:
        document = ezdxf.read(io.StringIO(text.lstrip()))
    except Exception as error:  # ezdxf raises errors of many kinds for malformed drawings
        document, repairs = _repaired_document(text, _short(error))
    try:
        reading = _Reading(document, dots)
        strokes = tuple(_strokes(reading, document.modelspace(), None, 1))
        factor, remarks = _unit(document, unit, "$INSUNITS" in text)
    except InputError:
        raise
    except Exception as error:  # as above, while entities are read
        raise InputError(f"dxf: {_short(error)}: must be a valid drawing") from None
    scaled = tuple(stroke.moved(lambda points: factor * points) for stroke in strokes)
    return Sheet(scaled, dict(reading.ignored), (*remarks, *repairs, *_remarks(reading.without_extent)))


def _repaired_document(text: str, damage: str) -> tuple[Any, tuple[str, ...]]:
    """Return the document of a damaged drawing whose geometry is whole, and a remark on the repairs.

    Args:
        text: the file's content.
        damage: why the drawing cannot be read as it stands.

    Raises:
        InputError: a drawing that cannot be repaired, or where that would change numbers or lose sections.
    """
    from ezdxf import recover
    from ezdxf.audit import AuditError

    refused = f"dxf: {damage}: must be a valid ASCII DXF"
    # here the repair reads 1.0 from "1,5", and leaves out what is not in a section
    lossy = {
        AuditError.INVALID_FLOATING_POINT_VALUE,
        AuditError.INVALID_INTEGER_VALUE,
        AuditError.MISSING_SECTION_TAG,
        AuditError.MISSING_ENDSEC_TAG,
        AuditError.FOUND_TAG_OUTSIDE_SECTION,
    }
    if not _has_whole_tags(text):
        raise InputError(refused)
    try:
        document, auditor = recover.read(io.BytesIO(text.lstrip().encode("utf-8", "replace")))
    except Exception:  # as above
        raise InputError(refused) from None
    entries = [*auditor.errors, *auditor.fixes]
    if any(entry.code in lossy for entry in entries) or not len(document.modelspace()):
        raise InputError(refused)
    repairs = [_shortened_name(entry.message) for entry in entries]
    return document, (
        f"damaged: {damage}; repaired: {_listed_names(repairs) or 'yes'}; compare it with what was drawn",
    )


def _has_whole_tags(text: str) -> bool:
    """Return whether all group codes are numbers, and the entities have as many y as x; the repair drops any others."""
    coordinates: Counter[int] = Counter()
    for code in text.lstrip().splitlines()[::2]:
        try:
            number = int(code)
        except ValueError:
            return False
        if number == 0:
            if any(coordinates[x] != coordinates[x + _TO_Y] for x in _X_CODES):
                return False
            coordinates.clear()
        elif number in _X_CODES or number - _TO_Y in _X_CODES:
            coordinates[number] += 1
    return True


def _remarks(without_extent: list[str]) -> tuple[str, ...]:
    if not without_extent:
        return ()
    return (f"not traced, as they have no extent: {_listed_names(without_extent)}",)


def _listed_names(names: list[str]) -> str:
    unnamed = len(names) - _NAMED
    return ", ".join(names[:_NAMED]) + (f" and {unnamed} more" if unnamed > 0 else "")


def _short(error: Exception) -> str:
    return _shortened_name(str(error)) or type(error).__name__


def _shortened_name(text: str) -> str:
    return " ".join(text.split())[:100].rstrip(". ")


def _unit(document: Any, unit: float | None, is_stated: bool) -> tuple[float, tuple[str, ...]]:
    if unit is not None:
        return unit, ()
    # ezdxf takes a drawing without a header as one in metres
    code: Any = document.header.get("$INSUNITS", 0) if is_stated else 0
    if code == 0:
        return 1.0, ("unit: the drawing states none ($INSUNITS); taken as mm",)
    if code not in _UNITS:
        raise InputError(f"dxf: $INSUNITS = {code}: must be one of {', '.join(map(str, _UNITS))}; unit states another")
    return _UNITS[code], ()


def _strokes(reading: _Reading, entities: Any, block: _Block | None, depth: int) -> Iterator[Stroke]:
    if depth > _NESTED_BLOCKS:
        raise InputError(f"dxf: blocks nested more than {_NESTED_BLOCKS} deep: must be at most so")
    for entity in entities:
        reading.count += max(entity.mcount, 1) if entity.dxftype() == "INSERT" else 1
        if reading.count > _MOST_ENTITIES:
            raise InputError(
                f"dxf: more than {_MOST_ENTITIES} entities, those of blocks counted each time: must be fewer"
            )
        if reading.count > len(reading.document.entitydb) + _MOST_REPEATED:
            raise InputError(
                f"dxf: references to blocks repeat more than {_MOST_REPEATED} entities: must be fewer, or exploded in "
                "the CAD program"
            )
        kind = entity.dxftype()
        layer = str(entity.dxf.get("layer", "0"))
        # DXF: entities on layer 0 of a block are on the layer of its reference
        if block is not None and layer == "0":
            layer = block.layer
        inherited = _Block(layer, _colours(reading, entity, block))
        if not _visible(reading, entity, layer):
            reading.ignored["invisible"] += 1
        elif kind == "INSERT":
            references = entity.multi_insert() if entity.mcount > 1 else (entity,)
            for reference in references:
                yield from _referenced_strokes(reading, reference, inherited, depth + 1)
            reading.ignored.update(["ATTRIB"] * len(entity.attribs))
        else:
            names = frozenset({layer.lower()}) | inherited.colours
            name = f"{kind} {entity.dxf.get('handle') or ''}".strip()
            where = f"dxf: {name}"
            missing = [
                attribute for attribute in _REQUIRED_ATTRIBUTES.get(kind, ()) if not entity.dxf.hasattr(attribute)
            ]
            if missing:
                raise InputError(f"{where}: {', '.join(missing)} is missing: must be stated")
            if _has_no_extent(entity):
                reading.without_extent.append(name)
                continue
            try:
                stroke = _stroke(reading, entity, where, names)
            except InputError as error:
                raise InputError(f"{where}: {error}") from None
            if stroke is None:
                reading.ignored[kind] += 1
            else:
                yield stroke


def _referenced_strokes(reading: _Reading, reference: Any, inherited: _Block, depth: int) -> Iterator[Stroke]:
    """The strokes of a block at a reference; programs for plane drawings scale its height by 0."""
    dxf = reference.dxf
    if dxf.xscale == 0 or dxf.yscale == 0:
        reading.without_extent.append(f"INSERT {dxf.get('handle') or ''}".strip())
        return
    if dxf.zscale != 0:
        yield from _strokes(reading, reference.virtual_entities(), inherited, depth)
        return
    dxf.zscale = dxf.xscale  # ezdxf divides by it
    height = _vector(reference.ocs().to_wcs(dxf.insert))[2]
    for stroke in _strokes(reading, reference.virtual_entities(), inherited, depth):
        yield stroke.moved(lambda points: np.concatenate([points[..., :2], np.full_like(points[..., 2:], height)], -1))


def _has_no_extent(entity: Any) -> bool:
    """Whether a curve of an entity's kind shrinks to a point: CAD programs leave such arcs where they trim others."""
    kind = entity.dxftype()
    dxf = entity.dxf
    if kind in ("ARC", "CIRCLE"):
        return float(dxf.radius) == 0
    if kind == "ELLIPSE":
        return not _vector(dxf.major_axis).any()
    if kind == "SPLINE":
        points = entity.control_points if len(entity.control_points) else entity.fit_points
        return len({tuple(place) for place in points}) <= 1
    return False


def _visible(reading: _Reading, entity: Any, layer: str) -> bool:
    table = reading.document.layers
    hidden = layer in table and (table.get(layer).is_off() or table.get(layer).is_frozen())
    return not hidden and not entity.dxf.get("invisible", 0)


def _colours(reading: _Reading, entity: Any, block: _Block | None) -> frozenset[str]:
    from ezdxf.colors import aci2rgb, int2rgb

    number = entity.dxf.get("color", _BY_LAYER)
    true = entity.dxf.get("true_color")
    if number == _BY_BLOCK and block is not None:
        return block.colours
    layer = entity.dxf.get("layer", "0")
    if number == _BY_LAYER and true is None:
        if block is not None and layer == "0":
            return block.colours
        table = reading.document.layers
        number = 7
        if layer in table:
            number = table.get(layer).dxf.get("color", 7)
            true = table.get(layer).dxf.get("true_color")
    if true is not None:
        return frozenset({"#{:02x}{:02x}{:02x}".format(*int2rgb(true))})
    if not 1 <= number <= 255:
        return frozenset()
    names = {f"aci:{number}", "#{:02x}{:02x}{:02x}".format(*aci2rgb(number))}
    if number in _NAMES:
        names.add(_NAMES[number])
    return frozenset(names)


def _stroke(reading: _Reading, entity: Any, where: str, names: frozenset[str]) -> Stroke | None:
    kind = entity.dxftype()
    dxf = entity.dxf
    shapes: list[Shape]
    if kind == "LINE":
        shapes = [Segment(_vector(dxf.start), _vector(dxf.end))]
    elif kind in ("ARC", "CIRCLE"):
        shapes = [_round(entity)]
    elif kind == "ELLIPSE":
        begin = float(dxf.start_param)
        sweep = (float(dxf.end_param) - begin) % (2 * math.pi)
        # a whole ellipse ends where it begins, but for rounding
        end = begin + (sweep if sweep > 1e-9 else 2 * math.pi)
        shapes = [Ellipse(_vector(dxf.center), _vector(dxf.major_axis), _vector(entity.minor_axis), begin, end)]
    elif kind == "SPLINE":
        tool = entity.construction_tool()
        weights = np.array(tool.weights() or [1.0] * tool.count, float)
        control = np.array([tuple(place) for place in tool.control_points], float)
        shapes = [Spline(np.array(tool.knots(), float), control, weights, int(tool.degree))]
    elif kind == "LWPOLYLINE":
        z = float(dxf.get("elevation", 0.0))
        vertices = [(point(x, y, z), bulge) for x, y, bulge in entity.get_points("xyb")]
        shapes = _polyline(vertices, bool(entity.closed), entity.ocs())
    elif kind == "POLYLINE" and (entity.is_2d_polyline or entity.is_3d_polyline):
        shapes = _vertices(entity)
    elif kind == "POINT" and reading.dots:
        return Stroke((), where, names, dot=_vector(dxf.location))
    else:
        return None
    return Stroke(tuple(shapes), where, names) if shapes else None


def _round(entity: Any) -> Ellipse:
    """An arc or a circle, counter-clockwise about its normal."""
    dxf = entity.dxf
    ocs = entity.ocs()
    begin = 0.0
    end = 360.0
    if entity.dxftype() == "ARC":
        begin = float(dxf.start_angle)
        end = float(dxf.end_angle)
        # equal angles are a whole circle
        end = begin + ((end - begin) % 360.0 or 360.0)
    radius = float(dxf.radius)
    if not 0 < radius < math.inf:
        raise InputError(f"radius = {radius:g}: must be greater than 0 and finite")
    u, v = (_vector(ocs.to_wcs(axis)) for axis in ((radius, 0, 0), (0, radius, 0)))
    return Ellipse(_vector(ocs.to_wcs(dxf.center)), u, v, math.radians(begin), math.radians(end))


def _vertices(entity: Any) -> list[Shape]:
    """Lines and arcs of a POLYLINE, without the control points of a spline through it."""
    vertices = [vertex.dxf for vertex in entity.vertices if not vertex.dxf.get("flags", 0) & _SPLINE_FRAME]
    places = [_vector(vertex.location) for vertex in vertices]
    if entity.is_3d_polyline:
        return _polyline([(place, 0.0) for place in places], bool(entity.is_closed), None)
    z = _vector(entity.dxf.get("elevation", (0, 0, 0)))[2]
    bulges = [float(vertex.get("bulge", 0)) for vertex in vertices]
    flat = [(point(place[0], place[1], z), bulge) for place, bulge in zip(places, bulges, strict=True)]
    return _polyline(flat, bool(entity.is_closed), entity.ocs())


def _polyline(vertices: list[tuple[Floats, float]], closed: bool, ocs: Any) -> list[Shape]:
    if closed and vertices:
        vertices = [*vertices, vertices[0]]
    shapes: list[Shape] = []
    for (first, bulge), (last, _) in pairwise(vertices):
        if not math.isfinite(bulge):
            raise InputError(f"bulge = {bulge:g}: must be finite")
        if not np.array_equal(first, last):
            shapes.append(bulged_line(first, last, float(bulge)))
    if ocs is None or not ocs.transform:
        return shapes
    turn = np.array([tuple(ocs.to_wcs(axis)) for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1))])
    return [shape.moved(lambda points: points @ turn) for shape in shapes]


def _vector(value: Any) -> Floats:
    x, y, *z = value
    return point(x, y, *z)
