"""The search for contacts of the needle with the sections of a bead; `gantrysim.glue.bead.ploughing` defines them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit

_EXAMINED_STEP = 0.125  # between the positions examined within a tick, of the needle's diameter
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
        steps = math.ceil(math.sqrt(dx * dx + dy * dy + dz * dz) / (_EXAMINED_STEP * 2.0 * needle.radius))
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
            end = cells.first[cell + 1]
            low = begin
            # in the order of the trace
            while low < end:
                middle = (low + end) // 2
                if place[cells.section[middle]] <= position.laid:
                    low = middle + 1
                else:
                    end = middle
    return cells.section[begin:end]


@jit
def _is_low(position: _Position, needle: Needle, sections: Sections, k: int) -> bool:
    """Return whether the face is low enough to touch a section."""
    return position.z <= sections.top[k] + needle.touching


@jit
def _along(position: _Position, sections: Sections, k: int) -> float:
    """Return the distance of the needle's axis from a section along the trace, 0 for a dot [mm]."""
    if sections.is_dot[k]:
        return 0.0
    dx = position.x - sections.x[k]
    dy = position.y - sections.y[k]
    return max(abs(dx * sections.cosine[k] + dy * sections.sine[k]) - sections.thickness, 0.0)


@jit
def _beside(position: _Position, sections: Sections, k: int) -> float:
    """Return the distance of the needle's axis from a section across the trace beyond its chord, or a dot's [mm]."""
    dx = position.x - sections.x[k]
    dy = position.y - sections.y[k]
    across = abs(dy * sections.cosine[k] - dx * sections.sine[k])
    if sections.is_dot[k]:
        across = math.sqrt(dx * dx + dy * dy)
    height = max(position.z - sections.surface[k], 0.0) / sections.steep[k] + sections.drop[k]
    radius = sections.radius[k]
    # products, as numba compiles a loop for a power
    chord = sections.flat[k] + math.sqrt(max(radius * radius - height * height, 0.0))
    return max(across - chord, 0.0)


@jit
def _axis_inside(position: _Position, needle: Needle, sections: Sections, entries: NDArray[np.int32]) -> bool:
    """Return whether the needle's axis passes through one of some sections, within half a radius along the trace."""
    for k in entries:
        # most sections of a cell are further along the trace, which is known soonest
        is_near = _along(position, sections, k) < 0.5 * needle.radius
        if is_near and _is_low(position, needle, sections, k) and _beside(position, sections, k) == 0.0:
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
        along = _along(position, sections, k)
        if along < needle.radius and _is_low(position, needle, sections, k):
            beside = _beside(position, sections, k)
            if along * along + beside * beside < needle.radius * needle.radius:
                touched[k] = True
                # glue that flows high above the work does not stand in the air: no face is deeper in it than it is high
                height = (sections.top[k] - sections.surface[k]) / sections.steep[k]
                depth = max(depth, min(sections.top[k] - position.z, height))
    return depth
