"""The needle's passes through glue that it has laid before.

The needle is a vertical cylinder; its lower face is a disc of the needle's outer diameter f at the nozzle's height z in
the work frame. At a station of the trace the bead fills its cross-section, square to the trace, from the surface to its
top. The needle passes through it where the face is no higher than the top and its disc meets the chord that the section
has at the height of the face,

    a^2 + max(|u| - w(z), 0)^2 < (f / 2)^2,

with a and u the distances of the needle's axis from the section, along the trace and across it, and w half the chord.
A face within a hundredth of the nozzle's gap over the top touches the glue, which wets it.

Three kinds of contact belong to laying a bead and do not count:

- Glue being laid: the last two widths of bead, and a diameter of the needle, behind it, with corners of 30 deg or more.
- Neighbouring turns, which the face may brush while it dispenses: there the needle passes through a bead only where its
  axis does. How close turns lie is judged by their clearance.
- Joints: a stretch of dispensing that begins or ends at a bead, its own in an outline that closes, with all of the
  contact there within the reach of that begin or end. The reach is the length of glue being laid, or `start` and `stop`
  where those are longer. An overlap beyond it counts, and so does a stretch that lies on another bead throughout.

A dot is one round section: its chord is the same in all directions, and it counts as laid where its stretch of
dispensing ends. A dot upon glue is a joint, too.

The round ends of a bead and the hollow between shoulders are left out: a section there is as long as at its station.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats, spans
from gantrysim.base.jit import jit
from gantrysim.glue.bead.dots import Dot
from gantrysim.glue.bead.height_map import upright
from gantrysim.glue.bead.trace import BeadTrace

# The search for contacts of the needle with the sections of a bead; `ploughing` defines them.

_STEP = 0.125  # between the positions examined within a tick, of the needle's diameter
_MOST_CELLS = 4e6  # of the search


class Needle(NamedTuple):
    """The needle at every tick.

    Attributes:
        nozzle: its tip, (n, 3) [mm].
        length: of its trace, (n,) [mm].
        dispense: dispenser command, (n,).
        radius: of its face [mm].
        counted: whether its contacts from the tick before to each one count, (n,).
        behind: length of trace behind it on which glue counts as being laid [mm].
        touching: height over a top at which the face still touches the glue [mm].
    """

    nozzle: Floats
    length: Floats
    dispense: NDArray[np.bool_]
    counted: NDArray[np.bool_]
    radius: float
    behind: float
    touching: float


class Sections(NamedTuple):
    """The bead's sections at the stations that have glue, and its dots, in the order of the trace, (r,) each.

    Attributes:
        place: of the stations along the trace [mm].
        x, y: of the stations in plan view [mm].
        cosine, sine: of the trace's heading.
        surface: height of the surface below [mm].
        top: height of the bead's top [mm].
        steep: vertical height over that square to the surface.
        radius: of the segments of the section [mm].
        drop: height of the segments' middle below the surface [mm].
        flat: half the width of the flat [mm].
        half: half the width of the section [mm].
        is_dot: whether it is a dot.
        thickness: half the length of bead that a station stands for, where stations are rarer than the face [mm].
    """

    place: Floats
    x: Floats
    y: Floats
    cosine: Floats
    sine: Floats
    surface: Floats
    top: Floats
    steep: Floats
    radius: Floats
    drop: Floats
    flat: Floats
    half: Floats
    is_dot: NDArray[np.bool_]
    thickness: float


class Cells(NamedTuple):
    """Cells of the plan, and the sections that the needle in each may touch.

    Attributes:
        x, y: lower corner of the first cell [mm].
        size: of a cell [mm].
        columns, rows: number of cells.
        first: index of each cell's first entry, and the number of all, (columns * rows + 1,).
        section: entries, in each cell in the order of the trace.
        highest: top of the sections of each cell, (columns * rows,) [mm].
    """

    x: float
    y: float
    size: float
    columns: int
    rows: int
    first: NDArray[np.int64]
    section: NDArray[np.int32]
    highest: Floats


def cells_of(sections: Sections, needle: Needle) -> Cells:
    """Return the cells in which the needle may touch the sections."""
    reach = sections.half + needle.radius + sections.thickness
    low_x = float((sections.x - reach).min())
    low_y = float((sections.y - reach).min())
    wide = float((sections.x + reach).max()) - low_x
    high = float((sections.y + reach).max()) - low_y
    size = max(float(np.median(reach)), math.sqrt(wide * high / _MOST_CELLS))
    columns = int(wide / size) + 1
    rows = int(high / size) + 1
    boxes = np.empty((reach.size, 4), np.int32)
    for k, (place, low) in enumerate(((sections.x, low_x), (sections.y, low_y))):
        boxes[:, 2 * k] = (place - reach - low) / size
        boxes[:, 2 * k + 1] = (place + reach - low) / size
    np.minimum(boxes[:, 1], columns - 1, out=boxes[:, 1])
    np.minimum(boxes[:, 3], rows - 1, out=boxes[:, 3])
    size_of_box = (boxes[:, 1] - boxes[:, 0] + 1).astype(np.int64) * (boxes[:, 3] - boxes[:, 2] + 1)
    first = np.zeros(columns * rows + 1, np.int64)
    section = np.empty(int(size_of_box.sum()), np.int32)
    highest = np.full(columns * rows, -np.inf)
    _sort(boxes, sections.top, columns, first, section, highest)
    return Cells(low_x, low_y, size, columns, rows, first, section, highest)


@jit
def _sort(
    boxes: NDArray[np.int32],
    top: Floats,
    columns: int,
    first: NDArray[np.int64],
    section: NDArray[np.int32],
    highest: Floats,
) -> None:
    """Sort sections into the cells of their boxes, by counting.

    Args:
        boxes: first and last column, first and last row of each section's cells, (r, 4).
        top: of the sections, (r,) [mm].
        columns: of the grid.
        first: zeros, into which this field of `Cells` is written.
        section: into which this field is written.
        highest: -inf, into which this field is written.
    """
    for k in range(boxes.shape[0]):
        for j in range(boxes[k, 2], boxes[k, 3] + 1):
            for i in range(boxes[k, 0], boxes[k, 1] + 1):
                cell = j * columns + i
                first[cell] += 1
                highest[cell] = max(highest[cell], top[k])
    # each cell counts down from its end, so that the sections go in from the last
    total = 0
    for cell in range(first.size):
        total += first[cell]
        first[cell] = total
    for k in range(boxes.shape[0] - 1, -1, -1):
        for j in range(boxes[k, 2], boxes[k, 3] + 1):
            for i in range(boxes[k, 0], boxes[k, 1] + 1):
                cell = j * columns + i
                first[cell] -= 1
                section[first[cell]] = k


class _Position(NamedTuple):
    """The needle at an instant.

    Attributes:
        x, y, z: of the middle of its face [mm].
        laid: place on the trace up to which glue counts as laid before [mm].
    """

    x: float
    y: float
    z: float
    laid: float


def contacts(needle: Needle, sections: Sections, cells: Cells) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the depth of the face below tops at every tick, -inf without contact, (n,), and the sections touched."""
    depth = np.full(needle.length.size, -np.inf)
    touched = np.zeros(sections.place.size, np.bool_)
    _search(needle, sections, cells, depth, touched)
    return depth, touched


@jit
def _search(needle: Needle, sections: Sections, cells: Cells, depth: Floats, touched: NDArray[np.bool_]) -> None:
    """Search for contacts; depth and touched, as of `contacts`, are written."""
    nozzle = needle.nozzle
    length = needle.length
    for k in range(1, length.size):
        if not needle.counted[k]:
            continue
        dx = nozzle[k, 0] - nozzle[k - 1, 0]
        dy = nozzle[k, 1] - nozzle[k - 1, 1]
        dz = nozzle[k, 2] - nozzle[k - 1, 2]
        steps = math.ceil(math.sqrt(dx * dx + dy * dy + dz * dz) / (_STEP * 2.0 * needle.radius))
        on = needle.dispense[k - 1]
        for step in range(steps):
            f = (step + 1) / steps
            position = _Position(
                x=nozzle[k - 1, 0] + f * dx,
                y=nozzle[k - 1, 1] + f * dy,
                z=nozzle[k - 1, 2] + f * dz,
                laid=length[k - 1] + f * (length[k] - length[k - 1]) - needle.behind,
            )
            entries = _laid_before(position, needle.touching, sections.place, cells)
            # mostly: a call that takes the sections costs more than all else
            if not entries.size or (on and not _axis_inside(position, needle, sections, entries)):
                continue
            depth[k] = max(depth[k], _touch(position, needle, sections, entries, touched))


@jit
def _laid_before(position: _Position, touching: float, place: Floats, cells: Cells) -> NDArray[np.int32]:
    """Return the sections that count as laid before, in the cell of a position; none where the needle is above all."""
    column = (position.x - cells.x) / cells.size
    row = (position.y - cells.y) / cells.size
    begin = 0
    end = 0
    if 0.0 <= column < cells.columns and 0.0 <= row < cells.rows:
        cell = int(row) * cells.columns + int(column)
        if position.z <= cells.highest[cell] + touching:
            begin = cells.first[cell]
            end = begin
            while end < cells.first[cell + 1] and place[cells.section[end]] <= position.laid:
                end += 1
    return cells.section[begin:end]


@jit
def _is_low(position: _Position, needle: Needle, sections: Sections, k: int) -> bool:
    """Return whether the face is low enough to touch a section."""
    return position.z <= sections.top[k] + needle.touching


@jit
def _chord(position: _Position, sections: Sections, k: int) -> tuple[float, float]:
    """Distances of the needle's axis from a section: along the trace, and across it beyond the chord [mm].

    Those from a dot are 0, and beyond its circle.
    """
    dx = position.x - sections.x[k]
    dy = position.y - sections.y[k]
    along = abs(dx * sections.cosine[k] + dy * sections.sine[k])
    across = abs(dy * sections.cosine[k] - dx * sections.sine[k])
    if sections.is_dot[k]:
        along = 0.0
        across = math.sqrt(dx * dx + dy * dy)
    height = max(position.z - sections.surface[k], 0.0) / sections.steep[k] + sections.drop[k]
    radius = sections.radius[k]
    # products, as numba compiles a loop for a power
    chord = sections.flat[k] + math.sqrt(max(radius * radius - height * height, 0.0))
    return max(along - sections.thickness, 0.0), max(across - chord, 0.0)


@jit
def _axis_inside(position: _Position, needle: Needle, sections: Sections, entries: NDArray[np.int32]) -> bool:
    """Return whether the needle's axis passes through one of some sections, within half a radius along the trace."""
    for k in entries:
        if _is_low(position, needle, sections, k):
            along, beside = _chord(position, sections, k)
            if beside == 0.0 and along < 0.5 * needle.radius:
                return True
    return False


@jit
def _touch(
    position: _Position,
    needle: Needle,
    sections: Sections,
    entries: NDArray[np.int32],
    touched: NDArray[np.bool_],
) -> float:
    """Note which of some sections the face touches, and return its depth below the highest of their tops [mm]."""
    depth = -math.inf
    for k in entries:
        if _is_low(position, needle, sections, k):
            along, beside = _chord(position, sections, k)
            if along * along + beside * beside < needle.radius * needle.radius:
                touched[k] = True
                # glue that flows high above the work does not stand in the air: no face is deeper in it than it is high
                height = (sections.top[k] - sections.surface[k]) / sections.steep[k]
                depth = max(depth, min(sections.top[k] - position.z, height))
    return depth


_TOUCHING = 0.01  # height over a bead's top at which glue still wets the face, of the nozzle's gap
_BEHIND = 2.0  # bead that counts as being laid, of its nominal width
_OPPOSITE = -0.5  # cosine of the angle between two headings from which one goes back


@dataclass(frozen=True)
class Ploughing:
    """Passes of the needle through glue that it has laid before.

    Attributes:
        length: bead that the needle has passed through, each piece counted once, and each dot by its diameter [mm].
        passes: number of passes; two with less than a needle's diameter of motion in between are one.
        depth: greatest depth of the face below the glue's top; 0 where it only touches [mm].
        dots: number of dots among it.
        tick: where the face is deepest in the longest pass, while it dispenses if it does so in most of that pass; None
            without any.
    """

    length: float = 0.0
    passes: int = 0
    depth: float = 0.0
    dots: int = 0
    tick: int | None = None

    @classmethod
    def of(cls, bead: BeadTrace, start: float, stop: float) -> Ploughing:
        """Return the passes through a bead and its dots.

        Args:
            bead: with a nominal section, or dots.
            start: length after the begin of a stretch on which it may lie on a bead [mm].
            stop: length before the end of a stretch on which it may do so [mm].
        """
        wet = _wet(bead)
        dots = [dot for dot in bead.dots if dot.volume > 0]
        if not (wet.any() or dots):
            return cls()
        sections = _with_dots(_sections(bead, wet), bead, dots)
        behind = _BEHIND * max([bead.widest, *(dot.diameter for dot in dots)]) + bead.run.face
        run = bead.run
        needle = Needle(
            nozzle=np.ascontiguousarray(run.nozzle),
            length=bead.length,
            dispense=np.ascontiguousarray(run.dispense),
            counted=np.ones(bead.length.size, bool),
            radius=0.5 * run.face,
            behind=behind,
            touching=_TOUCHING * bead.gap,
        )
        cells = cells_of(sections, needle)
        depth, touched = contacts(needle, sections, cells)
        touches = spans(depth > -np.inf)
        joints = _joints(bead, touches[~_turns_back(bead, touches, behind)], (max(start, behind), max(stop, behind)))
        if len(joints):
            for first, after in joints.tolist():
                needle.counted[first:after] = False
            depth, touched = contacts(needle, sections, cells)
        passes = _joined_passes(spans(depth > -np.inf), bead.length, run.face)
        if not len(passes):
            return cls()
        lengths = [bead.length[after - 1] - bead.length[max(first - 1, 0)] for first, after in passes]
        first, after = passes[int(np.argmax(lengths))]
        dispensing = run.dispense[first - 1 : after - 1]
        mostly = dispensing == (2 * np.count_nonzero(dispensing) > dispensing.size)
        dotted = touched & sections.is_dot
        return cls(
            length=float(np.count_nonzero(touched & ~sections.is_dot)) * bead.ds
            + 2 * float(sections.half[dotted].sum()),
            passes=len(passes),
            depth=max(float(depth.max()), 0.0),
            dots=int(np.count_nonzero(dotted)),
            tick=first + int(np.where(mostly, depth[first:after], -np.inf).argmax()),
        )


def _wet(bead: BeadTrace) -> NDArray[np.bool_]:
    """Whether there is glue at the stations, (r,)."""
    wet = np.zeros(bead.place.size, bool)
    for first, after in bead.wet_stretches.tolist():
        wet[first:after] = True
    return wet


def _sections(bead: BeadTrace, wet: NDArray[np.bool_]) -> Sections:
    section = bead.section
    steep = upright(bead) / bead.nozzle_height
    surface = _surface(bead)
    angle = math.radians(bead.settings.contact_angle)
    return Sections(
        place=bead.place[wet],
        x=bead.point[wet, 0],
        y=bead.point[wet, 1],
        cosine=np.cos(bead.heading[wet]),
        sine=np.sin(bead.heading[wet]),
        surface=surface[wet],
        top=(surface + section.height * steep)[wet],
        steep=steep[wet],
        radius=section.radius[wet],
        drop=section.radius[wet] * math.cos(angle),
        flat=0.5 * section.flat[wet],
        half=0.5 * section.width[wet],
        is_dot=np.zeros(np.count_nonzero(wet), bool),
        thickness=0.5 * max(bead.ds - 0.5 * bead.run.face, 0.0),
    )


def _with_dots(sections: Sections, bead: BeadTrace, dots: list[Dot]) -> Sections:
    """Return the sections with those of dots among them, in the order of the trace."""
    if not dots:
        return sections
    last = bead.length.size - 1
    radius = np.array([dot.cap.radius for dot in dots])
    height = np.array([dot.cap.height for dot in dots])
    x, y, foot = np.array([dot.foot for dot in dots]).T
    sphere = (radius**2 + height**2) / (2 * height)
    ones = np.ones(len(dots))
    capped = Sections(
        place=bead.length[[min(dot.stretch[1], last) for dot in dots]],
        x=x,
        y=y,
        cosine=ones,
        sine=0 * ones,
        surface=foot,
        top=foot + height,
        steep=ones,
        radius=sphere,
        drop=sphere - height,
        flat=0 * ones,
        half=radius,
        is_dot=ones > 0,
        thickness=sections.thickness,
    )
    order = np.argsort(np.concatenate([sections.place, capped.place]), kind="stable")
    both = zip(sections[:-1], capped[:-1], strict=True)
    columns: list[Any] = [*(np.concatenate(pair)[order] for pair in both), sections.thickness]
    return Sections(*columns)


def _surface(bead: BeadTrace) -> Floats:
    """Return the height of the surface below the stations, (r,) [mm].

    Glue that flows while the nozzle dives or rises lies on the spot: only motion along the surface gives its height.
    """
    run = bead.run
    step = np.diff(run.nozzle, axis=0)
    ahead = np.hypot(step[:, 0], step[:, 1])
    along = (ahead > 0) & (np.abs(step[:, 2]) <= ahead) & run.dispense[:-1]
    ticks = np.flatnonzero(along)
    if not ticks.size:
        return bead.along(bead.surface())
    return np.interp(bead.place, bead.length[ticks], bead.surface()[ticks])


def _joints(bead: BeadTrace, touches: NDArray[np.intp], reach: tuple[float, float]) -> NDArray[np.intp]:
    """Return the contacts at the begins and ends of stretches of dispensing and at dots, first tick and the one after.

    Args:
        bead: with its trace.
        touches: contacts, first tick and the one after the last, (m, 2).
        reach: of the begin and of the end of a stretch, within which a contact there lies [mm].
    """
    low = bead.length[np.maximum(touches[:, 0] - 1, 0)]
    high = bead.length[touches[:, 1] - 1]
    radius = 0.5 * bead.run.face
    # the glue laid at a begin or end reaches the other bead
    near = radius + 0.5 * max([bead.widest, *(dot.diameter for dot in bead.dots)])
    begins = bead.length[bead.stretches[:, 0]]
    ends = bead.length[np.minimum(bead.stretches[:, 1], bead.length.size - 1)]
    dots = bead.length[[dot.stretch[0] for dot in bead.dots]] if bead.dots else begins[:0]
    is_joint = np.zeros(len(touches), bool)
    for places, within in ((begins, reach[0]), (ends, reach[1]), (dots, near)):
        # the contact comes near a place, and none of it lies farther than the reach from there
        nearest = np.searchsorted(places, np.maximum(low - near, high - within))
        is_joint |= nearest < np.searchsorted(places, np.minimum(high + near, low + within), "right")
    first = np.searchsorted(begins, low - radius)
    # a stretch that lies on other glue throughout; a dot has no length that could
    is_whole = np.append(ends, np.inf)[first] <= high + radius
    return touches[is_joint & ~is_whole]


def _turns_back(bead: BeadTrace, touches: NDArray[np.intp], behind: float) -> NDArray[np.bool_]:
    """Return which contacts are with the glue that the same stretch has laid just before, in the other direction.

    There glue comes into contact as it ceases to count as being laid.

    Args:
        bead: with its trace.
        touches: contacts, first tick and the one after the last, (m, 2).
        behind: length of trace on which glue counts as being laid [mm].
    """
    here = bead.length[touches[:, 0]]
    begins = bead.length[bead.stretches[:, 0]]
    own = (
        begins[np.maximum(np.searchsorted(begins, here, "right") - 1, 0)] if begins.size else np.full(here.size, np.inf)
    )
    stations = [np.searchsorted(bead.place, place).clip(0, bead.place.size - 1) for place in (here, here - behind)]
    now, before = stations
    opposite = np.cos(bead.heading[now] - bead.heading[before]) < _OPPOSITE
    apart = np.linalg.norm(bead.point[now, :2] - bead.point[before, :2], axis=1)
    return opposite & (apart < 0.5 * (bead.run.face + bead.widest)) & (here - behind >= own)


def _joined_passes(passes: NDArray[np.intp], length: Floats, least: float) -> list[tuple[int, int]]:
    """Return passes, first tick and the one after the last, joined where less than `least` of motion parts them."""
    joined: list[tuple[int, int]] = []
    for first, after in passes.tolist():
        if joined and length[first] - length[joined[-1][1] - 1] < least:
            joined[-1] = (joined[-1][0], after)
        else:
            joined.append((first, after))
    return joined
