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

from gantrysim.base.arrays import Floats, compiled_view, spans
from gantrysim.base.columns import by_blocks
from gantrysim.base.jit import jit
from gantrysim.glue.bead.contacts import Needle, Sections, cells_of, contacts
from gantrysim.glue.bead.dots import Dot
from gantrysim.glue.bead.height_map import upright
from gantrysim.glue.bead.trace import BeadTrace

_WET_HEIGHT = 0.01  # height over a bead's top at which glue still wets the face, of the nozzle's gap
_BEAD_BEHIND = 2.0  # bead that counts as being laid, of its nominal width
_OPPOSITE_COSINE = -0.5  # cosine of the angle between two headings from which one goes back


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
        stretches: first tick of each pass and the one after its last.
        dry: number of the passes in most of which the dispenser is off.
    """

    length: float = 0.0
    passes: int = 0
    depth: float = 0.0
    dots: int = 0
    tick: int | None = None
    stretches: tuple[tuple[int, int], ...] = ()
    dry: int = 0

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
        behind = _BEAD_BEHIND * max([bead.widest, *(dot.diameter for dot in dots)]) + bead.run.face
        run = bead.run
        needle = Needle(
            nozzle=np.ascontiguousarray(run.nozzle),
            length=bead.length,
            dispense=np.ascontiguousarray(run.dispense),
            counted=np.ones(bead.length.size, bool),
            radius=0.5 * run.face,
            behind=behind,
            touching=_WET_HEIGHT * bead.gap,
        )
        cells = cells_of(sections, needle)
        depth, touched = contacts(needle, sections, cells)
        touches = spans(depth > -np.inf)
        joints = _joints(bead, touches[~_turns_back(bead, touches, behind)], (max(start, behind), max(stop, behind)))
        if len(joints):
            for first, after in joints.tolist():
                needle.counted[first:after] = False
            # of a long run there is no room for both
            del depth, touched
            depth, touched = contacts(needle, sections, cells)
        del needle
        passes = _joined_passes(spans(depth > -np.inf), bead.length, run.face)
        if not len(passes):
            return cls()
        lengths = [bead.length[after - 1] - bead.length[max(first - 1, 0)] for first, after in passes]
        first, after = passes[int(np.argmax(lengths))]
        dispensing = run.dispense[first - 1 : after - 1]
        rarely = dispensing != _is_mostly(dispensing)
        deepest = max(float(depth.max()), 0.0)
        depth[first:after][rarely] = -np.inf
        dotted = touched & sections.is_dot
        return cls(
            length=float(np.count_nonzero(touched & ~sections.is_dot)) * bead.ds
            + 2 * float(sections.half[dotted].sum()),
            passes=len(passes),
            depth=deepest,
            dots=int(np.count_nonzero(dotted)),
            tick=first + int(depth[first:after].argmax()),
            stretches=tuple(passes),
            dry=sum(not _is_mostly(run.dispense[begin - 1 : end - 1]) for begin, end in passes),
        )


def _is_mostly(dispensing: NDArray[np.bool_]) -> bool:
    """Return whether the dispenser is on in more than half of a pass."""
    return 2 * int(np.count_nonzero(dispensing)) > dispensing.size


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
        cosine=bead.direction[0, wet],
        sine=bead.direction[1, wet],
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
    surface = np.empty(bead.place.size)
    if run.dispense.any():
        ticks = bead.analysis.ticks
        foot = bead.analysis.nozzle
        above = by_blocks(lambda block: foot.offset[block, 2], ticks.size)
        trace = _Trace(compiled_view(run.nozzle), ticks, compiled_view(above), bead.length)
        if _found_surface(trace, bead.gap, bead.place, surface):
            return surface
    return bead.along(bead.surface())


class _Trace(NamedTuple):
    """The trace of the nozzle.

    Attributes:
        nozzle: in the work frame, (n, 3) [mm].
        ticks: of dispensing, (m,).
        above: height of the nozzle over the requested path at these ticks, (m,) [mm].
        length: of the trace up to each tick, (n,) [mm].
    """

    nozzle: Floats
    ticks: NDArray[np.intp]
    above: Floats
    length: Floats


@jit
def _found_surface(trace: _Trace, gap: float, places: Floats, surface: Floats) -> bool:
    """Write the surface below places along a trace, (r,) [mm], unless the nozzle nowhere moves along it.

    It is linear between the ticks of dispensing from which the nozzle moves no steeper than 45 degrees.
    """
    nozzle, ticks, above, length = trace
    place = 0
    before = 0.0  # length up to the last such tick, and the surface there
    height = 0.0
    is_first = True
    for j in range(ticks.size):
        k = ticks[j]
        if k + 1 == len(nozzle):
            break
        ahead = math.hypot(nozzle[k + 1, 0] - nozzle[k, 0], nozzle[k + 1, 1] - nozzle[k, 1])
        if not (ahead > 0.0 and abs(nozzle[k + 1, 2] - nozzle[k, 2]) <= ahead):
            continue
        here = nozzle[k, 2] - above[j] - gap
        slope = 0.0 if is_first else (here - height) / (length[k] - before)
        if is_first:
            height = here
        while place < places.size and places[place] < length[k]:
            surface[place] = slope * (places[place] - before) + height
            place += 1
        before = length[k]
        height = here
        is_first = False
    surface[place:] = height
    return not is_first


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
    if not begins.size:
        return np.zeros(here.size, bool)
    begun = begins[np.maximum(np.searchsorted(begins, here, "right") - 1, 0)]
    stations = [np.searchsorted(bead.place, place).clip(0, bead.place.size - 1) for place in (here, here - behind)]
    now, before = stations
    opposite = (bead.direction[:, now] * bead.direction[:, before]).sum(axis=0) < _OPPOSITE_COSINE
    apart = np.linalg.norm(bead.point[now, :2] - bead.point[before, :2], axis=1)
    return opposite & (apart < 0.5 * (bead.run.face + bead.widest)) & (here - behind >= begun)


def _joined_passes(passes: NDArray[np.intp], length: Floats, least: float) -> list[tuple[int, int]]:
    """Return passes, first tick and the one after the last, joined where less than `least` of motion parts them."""
    joined: list[tuple[int, int]] = []
    for first, after in passes.tolist():
        if joined and length[first] - length[joined[-1][1] - 1] < least:
            joined[-1] = (joined[-1][0], after)
        else:
            joined.append((first, after))
    return joined
