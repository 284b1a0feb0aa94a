"""The verdict on the glue: beads with width, blobs, gaps, starts, stops, clearance, the needle in them; and dots."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats, spans
from gantrysim.base.columns import Column, blocks, table_by_blocks
from gantrysim.base.quantity import contents, counted, number_text
from gantrysim.glue.bead import Bead, Ploughing
from gantrysim.glue.bead.dots import Dot
from gantrysim.glue.bead.trace import BeadTrace
from gantrysim.glue.bead.values import EXCESS_AT_STOP, MISSING_AT_START, excess_at_stop, missing_at_start
from gantrysim.job.tolerance import Tolerance
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.error_quantities import CONTOUR
from gantrysim.paths.feet import Projection
from gantrysim.record.run import Run
from gantrysim.results.checks import FAIL, UNJUDGED, WARN, Check, Place, Row, finite, worst
from gantrysim.results.verdict_quantities import (
    BEAD_WIDTH_ERROR,
    BLOBS,
    DOT_PLACE_ERROR,
    DOT_STRING,
    DOT_VOLUME_ERROR,
    GAPS,
    PASSES,
    PLOUGHED,
    PLOUGHED_DEPTH,
    TURN_CLEARANCE_ERROR,
    WIDTH_SHARE,
)

# place of a tick of the run
PlaceAt = Callable[[int], Place]

GLUE = "glue"
PASS_TIMES = f"{PASSES.key}_s"  # when each pass begins and ends
THROUGH_GLUE = "needle through its own"

# of the requested distance of the turns: beyond it, links that climb are longer than the distance asked in plan view
_LEVEL_LINKS = 0.01
_ROUNDING = 1e-9  # relative
_ASTRAY_SHARE = 0.05  # path error that may carry the needle into its bead, of its outer diameter
_TURNS_THAT_CLIMB = (
    "clearance of turns not judged: they lie at different heights, and their spacing is asked in plan view"
)
# dots out of tolerance that a sentence lists
_LISTED_DOTS = 5


def glue_row(bead: Bead, tolerance: Tolerance, place_at: PlaceAt, *, is_requested: bool = True) -> Row:
    """Return the verdict on the glue of a complete run: on its beads, and on each of its dots.

    Args:
        bead: the bead, with the dots.
        tolerance: of the run.
        place_at: returns the place of a tick.
        is_requested: whether the job's dispenser lays glue at all.
    """
    if not (bead.dots and is_requested):
        return _bead_row(bead, tolerance, place_at)
    verdicts = dot_verdicts(bead, tolerance, place_at)
    if not any(verdict.wanted for verdict in verdicts):
        count = "1 dot gets" if len(verdicts) == 1 else f"{len(verdicts)} dots get"
        remedy = "dispenser.flow lays it there, an area times the speed does not"
        dots = Row(GLUE, remark=f"{count} no glue: none is requested at rest; {remedy}", state=FAIL)
    else:
        dots = Row.of(GLUE, worst_checks(verdicts), dots_remark(verdicts))
    values = {"dots": [verdict.content() for verdict in verdicts]}
    if not len(bead.stretches):
        ploughing = Ploughing.of(bead, tolerance.start_length, tolerance.stop_length)
        checks = [*dots.checks, _ploughing_check(ploughing, tolerance, place_at)]
        remark = "; ".join([dots.remark, *_ploughing_remarks(ploughing, bead, tolerance)])
        both = Row.of(GLUE, checks, remark, {**values, **_passes_content(ploughing, bead)})
        return replace(both, state=worst([dots.state, both.state]))
    row = _bead_row(bead, tolerance, place_at)
    # the last part is what to do about a ploughed bead
    remark = "; ".join(filter(None, (dots.remark, row.remark)))
    both = Row.of(GLUE, [*row.checks, *dots.checks], remark, {**row.values, **values})
    return replace(both, state=worst([row.state, dots.state]))


def _bead_row(bead: Bead, tolerance: Tolerance, place_at: PlaceAt) -> Row:
    run = bead.run
    if not run.flow_demand.any():
        return Row(GLUE, remark="nothing was laid: no glue is requested", state=WARN)
    if bead.total_volume <= 0:
        return Row(GLUE, remark="nothing was laid, though glue is requested", state=FAIL)
    if bead.nominal <= 0:
        return Row(GLUE, remark="glue is requested only while the nozzle rests: no nominal width", state=UNJUDGED)
    width = BeadWidth(bead, tolerance)
    climbs = _climbs(bead)
    checks = _laid_checks(bead, width, tolerance, place_at)
    ploughing = Ploughing.of(bead, tolerance.start_length, tolerance.stop_length)
    checks.append(_ploughing_check(ploughing, tolerance, place_at))
    remarks = [width.remark, *([_TURNS_THAT_CLIMB] if climbs else ()), *_ploughing_remarks(ploughing, bead, tolerance)]
    return Row.of(GLUE, checks, "; ".join(remarks), {**width.content(), **_passes_content(ploughing, bead)})


def _laid_checks(bead: Bead, width: BeadWidth, tolerance: Tolerance, place_at: PlaceAt) -> list[Check]:
    """Return the checks of a bead with a nominal section, without the needle's passes through it."""
    checks = list(_end_checks(bead, tolerance, place_at))
    if width.judged.any():
        checks.append(width.check(place_at))
    if not _climbs(bead):
        checks += _clearance_checks(bead, tolerance, place_at)
    return checks


def laid_row(bead: Bead, tolerance: Tolerance) -> Row:
    """Return the verdict on starts, stops, width and clearance of the beads of a complete run, without their places.

    These are checks of `glue_row`, and take half as long; the row is empty where that has no such checks.
    """
    if not (len(bead.stretches) and bead.total_volume > 0 and bead.nominal > 0):
        return Row(GLUE)
    nowhere = Place()
    return Row.of(GLUE, _laid_checks(bead, BeadWidth(bead, tolerance), tolerance, lambda _: nowhere))


class BeadWidth:
    """Deviation of the bead's width from the wanted one, away from starts and stops.

    A blob is a contiguous stretch of the bead wider than the tolerance admits, a gap one narrower. Stations within
    `Tolerance.start_length` of where the dispenser opens, and within `stop_length` of where it closes, are not judged.

    Args:
        bead: the bead, with a nominal section.
        tolerance: of the run.

    Attributes:
        error: deviation at the stations, (r,) [%].
        judged: stations that are judged, (r,).
    """

    def __init__(self, bead: BeadTrace, tolerance: Tolerance) -> None:
        self.error: Floats = 100 * (bead.width / bead.wanted_section.width - 1)
        self.judged = _away_from_ends(bead, tolerance)
        self._bead = bead
        self._tolerance = tolerance

    @property
    def blobs(self) -> int:
        """Number of contiguous stretches that are too wide."""
        return len(spans(self.judged & (self.error > self._limit)))

    @property
    def gaps(self) -> int:
        """Number of contiguous stretches that are too narrow."""
        return len(spans(self.judged & (self.error < -self._limit)))

    @property
    def share(self) -> float:
        """Share of the judged length whose width is out of tolerance, nan where nothing is judged."""
        stations = np.count_nonzero(self.judged)
        out = np.count_nonzero(self.judged & (np.abs(self.error) > self._limit))
        return float(out / stations) if stations else float("nan")

    @property
    def remark(self) -> str:
        """Share, blobs and gaps in words."""
        if not self.judged.any():
            return "width not judged: every stretch of bead is shorter than a start and a stop"
        return (
            f"{WIDTH_SHARE.label} on {WIDTH_SHARE.text(self.share)} of the length between starts and stops: "
            f"{counted(self.blobs, 'blob')}, {counted(self.gaps, 'gap')}"
        )

    def content(self) -> dict[str, float | None]:
        """Return share, blobs and gaps for JSON; null where nothing is judged."""
        return contents((WIDTH_SHARE, BLOBS, GAPS), self if self.judged.any() else None)

    def check(self, place_at: PlaceAt) -> Check:
        """Return the check of the largest deviation."""
        bead = self._bead
        station = int(np.where(self.judged, np.abs(self.error), -1.0).argmax())
        tick = int(np.searchsorted(bead.length, bead.place[station]).clip(0, bead.length.size - 1))
        error = float(self.error[station])
        words = "bead too wide by" if error > 0 else "bead too narrow by"
        return Check.of(BEAD_WIDTH_ERROR, self._tolerance.bound("bead_width"), abs(error), words, place_at(tick))

    @property
    def _limit(self) -> float:
        return self._tolerance.bead_width * (1 + _ROUNDING)


def _away_from_ends(bead: BeadTrace, tolerance: Tolerance) -> NDArray[np.bool_]:
    """Stations of the stretches of dispensing without their starts and stops, (r,)."""
    judged = np.zeros(bead.place.size, bool)
    last = bead.length.size - 1
    for first, after in bead.stretches.tolist():
        low = float(bead.length[first]) + tolerance.start_length
        high = float(bead.length[min(after, last)]) - tolerance.stop_length
        begin, end = np.searchsorted(bead.place, [low, high])
        judged[begin : max(begin, end)] = True
    return judged


def _end_checks(bead: Bead, tolerance: Tolerance, place_at: PlaceAt) -> Iterator[Check]:
    """Yield the checks of the worst start and the worst stop."""
    missing = bead.missing_at_starts
    start = int(np.abs(missing).argmax())
    length = float(missing[start])
    place = place_at(int(bead.stretches[start, 0]))
    yield Check.of(MISSING_AT_START, tolerance.bound("start_length"), abs(length), missing_at_start(length), place)
    excess = bead.excess_at_stops
    if excess.size:
        stop = int(np.abs(excess).argmax())
        length = float(excess[stop])
        place = place_at(int(bead.stretches[stop, 1]))
        yield Check.of(EXCESS_AT_STOP, tolerance.bound("stop_length"), abs(length), excess_at_stop(length), place)


def _clearance_checks(bead: Bead, tolerance: Tolerance, place_at: PlaceAt) -> Iterator[Check]:
    """Yield the check of the distance between the edges of neighbouring turns, which do not climb, if there are any."""
    analysis = bead.analysis
    spacing = analysis.spacing
    asked = bead.run.requested.turn_spacing
    if asked is None or not spacing.distance.size:
        return
    s = analysis.nozzle.s
    ends = [s[0] + tolerance.start_length, s[-1] - tolerance.stop_length]
    inside = (np.minimum(spacing.s, spacing.next_s) > ends[0]) & (np.maximum(spacing.s, spacing.next_s) < ends[1])
    if not inside.any() or len(bead.stretches) > 1:
        return
    error = np.where(inside, bead.clearance() - (asked - float(bead.nominal_section.width[0])), 0.0)
    link = int(np.abs(error).argmax())
    place = place_at(int(analysis.ticks[np.abs(s - spacing.s[link]).argmin()]))
    bound = tolerance.bound("turn_clearance")
    yield Check.of(TURN_CLEARANCE_ERROR, bound, abs(float(error[link])), place=place)


def _climbs(bead: Bead) -> bool:
    """Return whether neighbouring turns lie at different heights."""
    asked = bead.run.requested.turn_spacing
    return asked is not None and bead.analysis.spacing.rise > _LEVEL_LINKS * asked


def _passes_content(ploughing: Ploughing, bead: Bead) -> dict[str, Any]:
    """Return the number of the passes through glue for JSON, and when each begins and ends [s]."""
    time = bead.run.time
    times = [[float(time[max(first - 1, 0)]), float(time[after - 1])] for first, after in ploughing.stretches]
    return {PASSES.key: ploughing.passes, PASS_TIMES: times}


def _ploughing_check(ploughing: Ploughing, tolerance: Tolerance, place_at: PlaceAt) -> Check:
    """Return the check of the bead that the needle passes through after it has laid it."""
    place = None if ploughing.tick is None else place_at(ploughing.tick)
    return Check.of(PLOUGHED, tolerance.bound("bead_ploughed"), ploughing.length, place=place)


def _ploughing_remarks(ploughing: Ploughing, bead: Bead, tolerance: Tolerance) -> Iterator[str]:
    """Yield a sentence on the passes through glue and what prevents them; none where there are none."""
    if ploughing.tick is None:
        return
    passes = f"{ploughing.passes} pass{'' if ploughing.passes == 1 else 'es'}"
    if 0 < ploughing.dry < ploughing.passes:
        passes = f"{passes} ({ploughing.dry} in dry moves, {ploughing.passes - ploughing.dry} while it dispenses)"
    below = PLOUGHED_DEPTH.number(ploughing.depth) != "0"
    # the place of the worst value is that of one pass
    length = f"{PLOUGHED.text(ploughing.length)}{'' if ploughing.passes == 1 else ' in all'}"
    depth = f"up to {PLOUGHED_DEPTH.text(ploughing.depth)} deep" if below else "touching its top"
    glue = f"glue, {counted(ploughing.dots, 'dot')} among it" if ploughing.dots else "bead"
    reason = _off_the_path(bead, tolerance) or _remedy(ploughing.tick, bead)
    yield f"{THROUGH_GLUE} {glue}: {passes}, {length}, {depth}; {reason}"


def _off_the_path(bead: Bead, tolerance: Tolerance) -> str:
    """Return that the path error carries the needle into the bead, in words; empty where the requested path does."""
    run = bead.run
    # a smaller error is not what brings a needle to a bead
    error = float(bead.analysis.nozzle.distance.max(initial=0.0))
    if run.progress is None or error < _ASTRAY_SHARE * run.face:
        return ""
    count = len(run.time)
    nozzle = table_by_blocks((_Nozzle.on_path(run, block) for block in blocks(count)), count)
    on_path = run.replaced(nozzle=vars(nozzle)["place"])
    ideal = Bead(on_path, bead.settings, _OnPath(on_path, bead.analysis.ticks))
    if Ploughing.of(ideal, tolerance.start_length, tolerance.stop_length).passes:
        return ""
    return f"on the requested path it would touch none: reduce the path error of up to {CONTOUR.text(error)}"


@dataclass(frozen=True)
class _Nozzle:
    """Places of a nozzle, (n, 3) [mm]; in a file where there are many."""

    place: Column[Floats] = Column()

    @classmethod
    def on_path(cls, run: Run, block: slice) -> _Nozzle:
        """Return those of some ticks of a run on its requested path."""
        assert run.progress is not None
        return cls(run.requested.position(run.progress[block]))


class _OnPath(Analysis):
    """The analysis of a run whose nozzle is everywhere on the requested path, where its command stands.

    Args:
        run: the run.
        ticks: its ticks of dispensing, which another analysis holds.
    """

    def __init__(self, run: Run, ticks: NDArray[np.intp]) -> None:
        super().__init__(run)
        self.ticks = ticks

    @cached_property
    def nozzle(self) -> Projection:
        """Projection of the nozzle, but for the path's curvature."""
        count = self.ticks.size
        zero = np.broadcast_to(0.0, count)
        return Projection(self.progress, np.broadcast_to(0.0, (count, 3)), zero, zero, zero, zero, zero)


def _remedy(tick: int, bead: Bead) -> str:
    """Return what prevents a pass through glue, in words."""
    run = bead.run
    has_z = "z" in run.axes
    if run.dispense[tick - 1]:
        how = "valve closed" if has_z else "z axis, valve closed"
        return (
            "the path crosses its own bead while it dispenses: lay the bead without crossings, or lift the needle over "
            f"them ({how})"
        )
    height = run.nozzle[:, 2] - bead.surface()
    top = max([float(bead.nominal_section.height[0]), *(dot.cap.height for dot in bead.dots)])
    if float(height.max()) > top + bead.gap:
        return "a dry move leads through it: lift the needle before this dry move"
    where = "" if has_z else " (on a machine with a z axis)"
    return f"it never lifts: lift the needle before dry moves{where}, or order them so that none crosses the bead"


def ploughing_reason(row: Row) -> str:
    """Return why the needle passes through glue, and what prevents it; empty where a row's worst check is another."""
    check = row.worst_check
    # the last part of the remark
    return row.remark.rpartition("; ")[2] if check is not None and check.name == PLOUGHED.name else ""


def ploughing_remedy(row: Row) -> str:
    """Return what prevents the passes of the needle through glue, as an order, likewise."""
    return ploughing_reason(row).rpartition(": ")[2]


@dataclass(frozen=True)
class DotVerdict:
    """The verdict on a dot.

    Attributes:
        number: of the dot, from 1.
        dot: the dot.
        wanted: volume that it must have [mm³].
        place: of the needle when the dispenser is switched on.
        checks: of its volume, place and string.
    """

    number: int
    dot: Dot
    wanted: float
    place: Place
    checks: tuple[Check, ...]

    @property
    def state(self) -> str:
        """The worst of its checks."""
        return worst([check.state for check in self.checks])

    @property
    def volume_error(self) -> float:
        """Volume beyond the wanted one, nan where none is wanted [%]."""
        return self.dot.volume_error_percent(self.wanted)

    def content(self) -> dict[str, Any]:
        """Return the dot for JSON."""
        dot = self.dot
        return {
            "number": self.number,
            "state": self.state,
            **self.place.content(),
            "asked_mm": list(dot.asked),
            "laid_mm": list(dot.place),
            "volume_mm3": dot.volume,
            "requested_volume_mm3": self.wanted,
            "volume_error_percent": finite(self.volume_error),
            "diameter_mm": dot.diameter,
            "height_mm": dot.cap.height,
            "place_error_mm": dot.place_error,
            "string_percent": dot.string_percent,
        }


def dot_verdicts(bead: BeadTrace, tolerance: Tolerance, place_at: PlaceAt) -> tuple[DotVerdict, ...]:
    """Return the verdicts on the dots of a run, in their order."""
    verdicts = []
    for number, dot in enumerate(bead.dots, 1):
        target = bead.settings.dot_target
        wanted = dot.demand if target is None else target
        place = place_at(dot.stretch[0])
        error = dot.volume_error_percent(wanted)
        words = f"dot {number} too large by" if error > 0 else f"dot {number} too small by"
        checks = (
            Check.of(DOT_VOLUME_ERROR, tolerance.bound("dot_volume"), abs(error), words, place),
            Check.of(
                DOT_PLACE_ERROR,
                tolerance.bound("dot_place"),
                dot.place_error,
                f"dot {number} off its place by",
                place,
            ),
            Check.of(
                DOT_STRING,
                tolerance.bound("dot_string"),
                dot.string_percent,
                f"glue of dot {number} drawn into a string",
                place,
            ),
        )
        verdicts.append(DotVerdict(number, dot, wanted, place, checks))
    return tuple(verdicts)


def worst_checks(verdicts: Sequence[DotVerdict]) -> list[Check]:
    """Return the worst check of each kind among dots; of volumes that nothing requests, none."""
    kinds = zip(*(verdict.checks for verdict in verdicts), strict=True)
    return [max(checks, key=lambda check: -1.0 if math.isnan(check.usage) else check.usage) for checks in kinds]


def dots_remark(verdicts: Sequence[DotVerdict]) -> str:
    """Return number, volume and width of dots, and which are out of tolerance, in words."""
    dots = [verdict.dot for verdict in verdicts]
    total = number_text(sum(dot.volume for dot in dots), ".4g")
    widths = [number_text(width(dot.diameter for dot in dots), ".2f") for width in (min, max)]
    wide = widths[0] if widths[0] == widths[1] else " to ".join(widths)
    failed = [str(verdict.number) for verdict in verdicts if verdict.state == FAIL]
    named = ", ".join(failed[:_LISTED_DOTS]) + (", ..." if len(failed) > _LISTED_DOTS else "")
    out = f"{len(failed)} out of tolerance, no. {named}" if failed else "none out of tolerance"
    return f"{len(dots)} dot{'' if len(dots) == 1 else 's'}, {total} mm³ in all, {wide} mm wide on the work: {out}"
