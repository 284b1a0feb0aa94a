"""Drawings as text, written by hand, and distances between paths by brute force."""

import math

import numpy as np
from scipy.spatial import cKDTree


def group(*pairs):
    """DXF groups: codes and values, one in a line."""
    return "".join(
        f"{code}\n{value!r}\n" if isinstance(value, float) else f"{code}\n{value}\n" for code, value in pairs
    )


def dxf(*entities, insunits=4, tables="", blocks=""):
    """A DXF of entities, each a text."""
    header = group((0, "SECTION"), (2, "HEADER"), (9, "$ACADVER"), (1, "AC1009"))
    if insunits is not None:
        header += group((9, "$INSUNITS"), (70, insunits))
    header += group((0, "ENDSEC"))
    if tables:
        header += group((0, "SECTION"), (2, "TABLES")) + tables + group((0, "ENDSEC"))
    if blocks:
        header += group((0, "SECTION"), (2, "BLOCKS")) + blocks + group((0, "ENDSEC"))
    body = group((0, "SECTION"), (2, "ENTITIES")) + "".join(entities) + group((0, "ENDSEC"), (0, "EOF"))
    return header + body


def line(a, b, layer="0", *more):
    a, b = (*a, 0.0)[:3], (*b, 0.0)[:3]
    ends = [(code + k, float(end[k // 10])) for code, end in ((10, a), (11, b)) for k in (0, 10, 20)]
    return group((0, "LINE"), (8, layer), *more, *ends)


def circle(centre, radius, layer="0", *more):
    return group((0, "CIRCLE"), (8, layer), *more, (10, centre[0]), (20, centre[1]), (30, 0.0), (40, radius))


def arc(centre, radius, begin, end, *more):
    place = (10, centre[0]), (20, centre[1]), (30, 0.0), (40, radius)
    return group((0, "ARC"), (8, "0"), *place, (50, begin), (51, end), *more)


def polyline(vertices, closed=False, *more):
    """Vertices (x, y, bulge)."""
    text = group((0, "POLYLINE"), (8, "0"), (66, 1), (10, 0.0), (20, 0.0), (30, 0.0), (70, int(closed)), *more)
    for x, y, bulge in vertices:
        text += group((0, "VERTEX"), (8, "0"), (10, float(x)), (20, float(y)), (30, 0.0), (42, float(bulge)))
    return text + group((0, "SEQEND"), (8, "0"))


def svg(*elements, size=(100, 100), unit="mm"):
    """An SVG of elements on a page of user units that are mm."""
    head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{size[0]}{unit}" height="{size[1]}{unit}"'
    return f'{head} viewBox="0 0 {size[0]} {size[1]}">{"".join(elements)}</svg>'


def csv(points):
    return "\n".join(",".join(repr(float(value)) for value in point) for point in points)


def bulge_points(first, last, bulge, count=400):
    """Points of a bulge's arc, from its chord, angle and radius."""
    z, w = complex(*first), complex(*last)
    angle = 4 * math.atan(bulge)
    # about the centre, which sees the chord under the angle
    centre = (w - z * np.exp(1j * angle)) / (1 - np.exp(1j * angle))
    turned = centre + (z - centre) * np.exp(1j * angle * np.linspace(0, 1, count))
    return np.stack([turned.real, turned.imag], axis=1)


def sampled(path, spacing=0.02):
    """Points of a path, closely on every piece."""
    edges = np.append(0.0, path.ends)
    within = np.linspace(edges[:-1], edges[1:], 33)
    return path.position(np.unique(np.concatenate([np.arange(0.0, path.length, spacing), within.ravel()])))


def farthest(points, others):
    """Largest distance of points from the polyline through others: of its chords at the four points nearest to each.

    Of fewer chords it is not less.
    """
    others = np.asarray(others, float)
    tree = cKDTree(others)
    nearest = tree.query(points, k=min(4, len(others)))[1].reshape(len(points), -1)
    best = np.full(len(points), np.inf)
    for k in nearest.T:
        for step in (-1, 1):
            other = np.clip(k + step, 0, len(others) - 1)
            chord = others[other] - others[k]
            square = np.einsum("ij,ij->i", chord, chord)
            along = np.einsum("ij,ij->i", points - others[k], chord)
            share = np.clip(np.divide(along, square, out=np.zeros_like(along), where=square > 0), 0, 1)
            best = np.minimum(best, np.linalg.norm(points - others[k] - share[:, None] * chord, axis=1))
    return float(best.max())


def differences(setpoints):
    """Velocities and accelerations by differences, from rest to rest."""
    still = np.pad(setpoints.position, ((2, 2), (0, 0)), "edge")
    velocity = np.diff(still, axis=0) / setpoints.period
    return velocity, np.diff(velocity, axis=0) / setpoints.period
