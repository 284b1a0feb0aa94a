"""The round ends of a bead on its height map."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats, lengths
from gantrysim.base.errors import InputError
from gantrysim.glue.bead.section import Section
from gantrysim.glue.bead.trace import BeadTrace

SAMPLES = 3.0  # per cell, across the bead and along it
MOST_CELLS = 2e7


@dataclass(frozen=True, eq=False)
class End:
    """A round end of a stretch of bead, or a round drop.

    Attributes:
        station: about which it is round.
        radius: of its rim [mm].
        points: in plan view, (k, 2) [mm].
        volumes: at the points, (k,) [mm³].
        gap: vertical height of the nozzle [mm].
        top: vertical height of the crest [mm].
    """

    station: int
    radius: float
    points: Floats
    volumes: Floats
    gap: float
    top: float


def round_ends(bead: BeadTrace, volume: Floats) -> Iterator[End]:
    """Yield the round ends of all stretches of a bead.

    An end takes the volume of its half body of revolution from the intervals of the last stations, whose `volume` is
    set to 0; a stretch shorter than its two ends is one round drop.
    """
    drops = bead.drops.tolist()
    half = bead.end_length
    for first, after in bead.wet_stretches.tolist():
        if [first, after] in drops:
            whole = slice(max(first - 1, 0), after)
            total = float(volume[whole].sum())
            volume[whole] = 0.0
            middle = (first + after - 1) // 2
            gap = bead.section.gap[middle : middle + 1]
            yield _round(bead, middle, bead.drop(total, gap), total, None)
            continue
        stations = np.arange(first, after)
        begin = np.flatnonzero(bead.ds * (stations - first + 0.5) >= half[stations])
        end = np.flatnonzero(bead.ds * (after - 1 - stations + 0.5) >= half[stations])
        for station, taken, away in (
            (stations[begin[0]], slice(max(first - 1, 0), stations[begin[0]]), np.pi),
            (stations[end[-1]], slice(stations[end[-1]], after), 0.0),
        ):
            total = float(volume[taken].sum())
            volume[taken] = 0.0
            if total > 0:
                area = bead.area[station : station + 1]
                gap = bead.section.gap[station : station + 1]
                section = Section(area, gap, bead.settings.contact_angle, bead.run.face)
                yield _round(bead, station, section, total, bead.heading[station] + away)


def _round(bead: BeadTrace, station: int, section: Section, volume: float, towards: float | None) -> End:
    """Points and volumes of a body of revolution about a station, or of its half `towards` an angle."""
    rim = 0.5 * float(section.width[0])
    check_cells(bead, (2 * rim / bead.cell, 2 * rim / bead.cell))
    rings = math.ceil(rim * SAMPLES / bead.cell) + 1
    r = rim * (np.arange(rings) + 0.5) / rings
    span = 2 * np.pi if towards is None else np.pi
    around = math.ceil(span * rings)
    angle = (0.0 if towards is None else towards - 0.5 * np.pi) + span * (np.arange(around) + 0.5) / around
    weight = np.repeat((section.profile(r)[0] * r)[:, None], around, axis=1)
    weight *= volume / weight.sum()
    points = bead.point[station, :2] + r[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    gap = float(upright(bead)[station])
    top = float(section.height[0]) * gap / float(bead.nozzle_height[station])
    return End(station, rim, points.reshape(-1, 2), weight.ravel(), gap, top)


def upright(bead: BeadTrace) -> Floats:
    """Vertical height of the nozzle over the surface, more than the normal one where the path climbs, (r,) [mm]."""
    along = np.gradient(bead.point, axis=0)
    ahead = lengths(along[:, :2])
    length = lengths(along)
    cosine = np.divide(ahead, length, out=np.ones_like(length), where=length > 0)
    return bead.nozzle_height / np.maximum(cosine, math.sqrt(0.5))


def check_cells(bead: BeadTrace, count: ArrayLike, layers: int = 1) -> None:
    """Raise InputError for a height map of too many cells, given as their number along x and along y."""
    cells = layers * float(np.prod(np.asarray(count, float)))
    if not cells <= MOST_CELLS:
        stacked = f" in {layers} layers" if layers > 1 else ""
        wide = float(bead.nominal_section.width[0])
        widest = float(bead.width.max())
        raise InputError(
            f"cell = {bead.cell:g} mm: the height map of a bead {wide:.4g} mm wide, {widest:.4g} mm at its "
            f"widest, has {cells:.3g} cells{stacked}, at most {MOST_CELLS:g}"
        )
