"""The content of a page's viewer: the columns of a run that it draws, and what it needs to label them.

A number has 16 bits: it differs from the run's by at most 1 / 131,068 of its column's range (`encoding.encoded`), for
errors within ± 1 mm by 0.008 µm. Times, program lines and the state of the dispenser are exact. Above
`thinning.MOST_ROWS` ticks the columns are thinned so that the extremes of each remain.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gantrysim.base import memory
from gantrysim.base.arrays import Floats
from gantrysim.base.columns import blocks, by_blocks, extent
from gantrysim.base.quantity import UM
from gantrysim.glue.bead import Bead
from gantrysim.glue.bead.trace import leaves_plane
from gantrysim.job.basis import program_lines_at
from gantrysim.job.job import Job
from gantrysim.job.tolerance import Tolerance
from gantrysim.machine.outline import Part, Solid, outline
from gantrysim.metrics.analysis import path_speed
from gantrysim.metrics.budget import DESCRIPTIONS
from gantrysim.metrics.parts import CORNER
from gantrysim.record.run import Run
from gantrysim.report.encoding import MOST_ROWS, encoded_ascending, encoded_numbers, encoded_runs, shown_rows
from gantrysim.report.plots.plan import magnification
from gantrysim.report.plots.style import COLOURS, DASHES
from gantrysim.results.checks import FAIL, PASS
from gantrysim.results.glue import PASS_TIMES, DotVerdict
from gantrysim.results.run_results import RunResults
from gantrysim.results.verdict import GLUE
from gantrysim.results.verdict_quantities import PASSES, PLOUGHED

# What the page's 3-D view needs beside the columns of the viewer: the bead's height and the machine's poses.
#
# Only jobs whose bead leaves a plane have the view, see `gantrysim.glue.bead.trace`.

POSES = 800  # of the machine in a run, between which the page interpolates by cubics
_FEWEST_POSES = 100
_CONSTANT = 1e-6  # extent of a coordinate below which it is one number [mm, or of a quaternion]


def space_content(results: RunResults, poses: int = POSES) -> dict[str, Any]:
    """Return the gap and the machine in so many poses, at ticks evenly spread over the run, and its solids apart.

    The gap between nozzle and surface is in mm, positions and sizes of the machine are in mm in the frame of the work.
    The solids of each part are those of other runs, too, so that they need not be sent again.
    """
    run = results.budget.analysis.run
    ticks = pose_ticks(run, poses)
    parts = outline(results.machine, run.encoder[ticks])
    gap = run.gap if results.bead is None else results.bead.gap
    return {
        "space": {"gap": gap, "poses": int(ticks.size), "parts": [_part_content(part) for part in parts]},
        "solids": [_solid_contents(part.solids) for part in parts],
    }


def pose_ticks(run: Run, poses: int = POSES) -> NDArray[np.intp]:
    """Return the ticks of the poses, evenly spread and no more than the run has, (poses,)."""
    last = len(run.time) - 1
    return np.rint(np.linspace(0, last, min(poses, last + 1))).astype(np.intp)


def bead_height(bead: Bead, rows: NDArray[np.intp]) -> Floats:
    """Return the height of the bead below the nozzle at ticks of the run, (m,) [mm]."""
    return np.interp(bead.length[rows], bead.place, bead.height)


def _part_content(part: Part) -> dict[str, Any]:
    return {
        "name": part.name,
        "pose": [_coordinate_content(values) for values in (*part.position.T, *part.rotation.T)],
    }


def _solid_contents(solids: Sequence[Solid]) -> list[list[Any]]:
    """Return of each solid kind, size, position, rotation and whether it is the needle in a row, within 0.01 mm."""
    lengths = np.round([[*solid.size, *solid.position] for solid in solids], 2).tolist()
    rotations = np.round([solid.rotation for solid in solids], 4).tolist()
    return [
        [solid.kind, *length, *rotation, solid.needle]
        for solid, length, rotation in zip(solids, lengths, rotations, strict=True)
    ]


def _coordinate_content(values: Floats) -> Any:
    if np.ptp(values) < _CONSTANT:
        return round(float(values[0]), 6)
    return encoded_numbers(values)


_LEVEL_HEIGHT = 1e-6  # [mm], vertical parts below it are rounding
_LISTED_LINES = 2000  # lines of a program that is listed whole; of a longer one only the lines that run
_CORNER_DECIMALS = 4
_DOT_DECIMALS = 4
_DIGITS = 3  # significant, of a column's largest value
_PLACE_DECIMALS = 2  # [mm]
# finest steps of columns: of the last digit that is shown; of the nozzle's offset, which the plan magnifies up to 1000
# times, and of a height [mm]
_STEP_OF_DIGIT = 0.1
_OFFSETS = ("dx", "dy")
_PLACE_COLUMNS = ("s", "x", "y", "z")  # as fine as 16 bits are
_OFFSET_STEP = 1e-5
_HEIGHT_STEP = 1e-4

ERROR = "error"
BEAD = "bead"
MOTION = "motion"


@dataclass(frozen=True, eq=False)
class Series:
    """A column of the viewer.

    Attributes:
        name: unique name.
        label: as the page shows it.
        unit: in which the page shows it.
        group: of columns with a scale in common: `ERROR`, `BEAD`, `MOTION`, or none for positions.
        values: returns the values at `ticks` in this unit, (m,).
        ticks: ticks of the run at which it has values, ascending; None for all.
        meaning: in a few words.
    """

    name: str
    label: str
    unit: str
    group: str
    values: Callable[[], Floats]
    ticks: NDArray[np.intp] | None = None
    meaning: str = ""

    def at(self, rows: NDArray[np.intp]) -> Floats:
        """Return the values at ticks of the run, NaN where there is none, (m,)."""
        values = self.values()
        if self.ticks is None:
            return values[rows]
        places = np.minimum(np.searchsorted(self.ticks, rows), self.ticks.size - 1)
        return np.where(self.ticks[places] == rows, values[places], np.nan)

    def content(self, values: Floats) -> dict[str, Any]:
        """Return its label, unit, decimals and colour for the page."""
        largest = float(np.nanmax(np.abs(values), initial=1.0))
        # three digits of the largest value; of places hundredths
        decimals = _DIGITS - 1 - int(np.log10(largest)) if self.group else _PLACE_DECIMALS
        return {
            "name": self.name,
            "label": self.label,
            "unit": self.unit,
            "group": self.group,
            "decimals": int(np.clip(decimals, 0, _DIGITS - 1)),
            "colour": COLOURS.get(self.name),
            "dash": DASHES.get(self.name, []),
            "meaning": self.meaning,
        }


class ViewerData:
    """The columns of a run for its page.

    Args:
        results: of the run.
        most: about the largest number of ticks shown.
        flat_in_space: whether a bead that leaves no plane has the 3-D view too.
    """

    def __init__(self, results: RunResults, most: int = MOST_ROWS, *, flat_in_space: bool = False) -> None:
        self.results = results
        self._most = most
        self._flat_in_space = flat_in_space

    @cached_property
    def series(self) -> tuple[Series, ...]:
        """The columns, but for ticks, program lines and the state of the dispenser."""
        bead = () if self._bead is None else tuple(_bead_series(self._bead))
        return (*self._positions(), *self._errors(), *bead, *self._motion())

    @cached_property
    def in_space(self) -> bool:
        """Whether there is a 3-D view: the bead leaves a plane, or flat ones have it too."""
        return self._flat_in_space or leaves_plane(self.results.budget.analysis.run)

    @property
    def _bead(self) -> Bead | None:
        bead = self.results.bead
        return bead if bead is not None and bead.nominal > 0 else None

    def _positions(self) -> Iterator[Series]:
        budget = self.results.budget
        run = budget.analysis.run
        ticks = budget.analysis.ticks
        nozzle = budget.analysis.nozzle
        yield Series("s", "s", "mm", "", lambda: nozzle.s, ticks, "distance along the requested path")
        for axis, name in enumerate("xyz"):
            if name == "z" and extent(lambda block: run.nozzle[block, 2], len(run.time)) < _LEVEL_HEIGHT:
                continue
            position = partial(_coordinate, run, "nozzle", axis)
            yield Series(name, name, "mm", "", position, None, "nozzle in the work frame")
            if name != "z":
                yield Series(f"d{name}", f"d{name}", "mm", "", partial(_coordinate, nozzle, "offset", axis), ticks)

    def _errors(self) -> Iterator[Series]:
        budget = self.results.budget
        ticks = budget.analysis.ticks
        corner = {} if budget.corner is None else {CORNER: budget.corner}
        parts = {"contour": budget.contour, **budget.parts, **corner}
        for name, part in parts.items():
            lateral = partial(_micrometres, part, "lateral")
            yield Series(name, name, "µm", ERROR, lateral, ticks, DESCRIPTIONS.get(name, ""))
        contour = budget.contour
        nozzle = budget.analysis.nozzle
        if _largest(lambda block: nozzle.distance[block] - np.abs(contour.lateral[block]), ticks.size) > _LEVEL_HEIGHT:
            if _largest(lambda block: contour.vertical[block], ticks.size) > _LEVEL_HEIGHT:
                vertical = partial(_micrometres, contour, "vertical")
                yield Series("vertical", "vertical", "µm", ERROR, vertical, ticks, "normal to path")
            distance = partial(_micrometres, nozzle, "distance")
            yield Series("distance", "distance", "µm", "", distance, ticks, "nozzle to requested path")

    def _motion(self) -> Iterator[Series]:
        run = self.results.budget.analysis.run
        if run.flow_demand.any():
            yield Series("flow", "flow", "mm³/s", MOTION, lambda: run.flow, None, "out of the needle")
        yield Series("speed", "path speed", "mm/s", MOTION, lambda: path_speed(run), None, "of the nozzle")

    @cached_property
    def rows(self) -> NDArray[np.intp]:
        """Ticks of the run that are shown, (m,)."""
        run = self.results.budget.analysis.run
        ticks = len(run.time)
        columns = ((series.ticks, series.values()) for series in self.series)
        states: list[NDArray[Any]] = [run.dispense]
        # of a longer run the lines are unknown
        if self._most < ticks <= memory.LONG_RUN:
            states.append(self._lines(np.arange(ticks)))
        return shown_rows(ticks, columns, len(self.series), states, self._most)

    def _lines(self, rows: NDArray[np.intp]) -> NDArray[np.intp]:
        """Return the lines of the program at ticks of the run, 0 where they are unknown, (m,)."""
        run = self.results.budget.analysis.run
        return program_lines_at(self.results.basis, len(run.time), run.time[rows])

    def corners(self) -> list[list[float]]:
        """Return arc length, x and y of the requested path's corners [mm]; none of a path that has too many to show."""
        path = self.results.budget.analysis.run.requested
        if path.corners.size > self._most:
            return []
        table = np.column_stack([path.corners, path.position(path.corners)[:, :2]])
        rounded: list[list[float]] = table.round(_CORNER_DECIMALS).tolist()
        return rounded

    @cached_property
    def _tolerance(self) -> Tolerance:
        """The job's tolerances, also of a run that is not judged, for its colours."""
        return self.results.basis.limits(self.results.budget.analysis.run.face)

    @property
    def _width_tolerance(self) -> float:
        """Tolerance of the bead's width; of the volume of dots where there is no bead, which is coloured then [%]."""
        tolerance = self._tolerance
        return tolerance.dot_volume if self._bead is None and self.results.dots else tolerance.bead_width

    @property
    def _unjudged_ends(self) -> list[float] | None:
        """Lengths of bead after a start and before a stop over which its width is not judged [mm]; None without any."""
        tolerance = self.results.verdict.tolerance
        return None if tolerance is None or self._bead is None else [tolerance.start_length, tolerance.stop_length]

    @property
    def _program_text(self) -> str:
        job = self.results.basis
        if not isinstance(job, Job):
            return ""
        text = job.program.get(job.controller.text_argument, "")
        return text if isinstance(text, str) else ""

    @property
    def _worst_row(self) -> int | None:
        """Row at which the verdict is worst, where the cursor begins; None where no time of it is known."""
        place = self.results.verdict.worst_place
        if place is None or place.time is None:
            return None
        times = self.results.budget.analysis.run.time[self.rows]
        return int(np.abs(times - place.time).argmin())

    @property
    def _worst_value(self) -> str:
        """What is worst there, in words; empty where nothing is."""
        verdict = self.results.verdict
        check = verdict.placed_check
        if check is None:
            return ""
        # the place is that of one pass
        is_sum = check.name == PLOUGHED.name and verdict[GLUE].values[PASSES.key] > 1
        return f"{check.measured} in all" if is_sum else check.measured

    def _ploughed_ticks(self, rows: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Whether the needle passes through its own glue at ticks of the run, (m,)."""
        verdict = self.results.verdict
        time = self.results.budget.analysis.run.time[rows]
        ploughed = np.zeros(rows.size, bool)
        passes = verdict[GLUE].values.get(PASS_TIMES, ()) if verdict.rows else ()
        for begin, end in passes:
            # a pass between two rows shows at both
            ploughed[max(np.searchsorted(time, begin, "right") - 1, 0) : np.searchsorted(time, end) + 1] = True
        return ploughed

    def content(self) -> dict[str, Any]:
        """Return what the viewer reads: columns, their series, the program's text, nominal values and tolerances."""
        run = self.results.budget.analysis.run
        rows = self.rows
        lines = self._lines(rows)
        columns = {
            "tick": encoded_ascending(rows),
            "dispense": encoded_runs(run.dispense[rows]),
            "line": encoded_runs(lines),
        }
        if (ploughed := self._ploughed_ticks(rows)).any():
            columns["ploughed"] = encoded_runs(ploughed)
        contents = []
        for series in self.series:
            values = series.at(rows)
            shown = series.content(values)
            finest = _OFFSET_STEP if series.name in _OFFSETS else _STEP_OF_DIGIT * 10.0 ** -shown["decimals"]
            columns[series.name] = encoded_numbers(values, 0.0 if series.name in _PLACE_COLUMNS else finest)
            contents.append(shown)
        verdict = self.results.verdict
        bead = self._bead
        if self.in_space and bead is not None:
            columns["height"] = encoded_numbers(bead_height(bead, rows), _HEIGHT_STEP)
        return {
            "rows": int(rows.size),
            "ticks": len(run.time),
            "period": run.period,
            "start": float(run.time[0]),
            "columns": columns,
            "series": contents,
            "corners": self.corners(),
            "program": _listing(self._program_text, lines),
            "magnification": magnification(self.results.budget.analysis),
            "worst": self._worst_row,
            "worst_value": self._worst_value,
            "passes": verdict.state == PASS,
            "shown": verdict.shown_row,
            "path_statistic": verdict.path_statistic,
            "path_tolerance": UM * (verdict.path_limit or self._tolerance.path_max),
            "width": None if bead is None else float(bead.nominal_section.width[0]),
            "width_tolerance": self._width_tolerance,
            "unjudged_ends": self._unjudged_ends,
            "dots": [_dot_content(verdict, rows) for verdict in self.results.dots],
            **(space_content(self.results, self._poses) if self.in_space else {"space": None, "solids": None}),
        }

    @property
    def _poses(self) -> int:
        """Number of the machine's poses, in proportion to the rows: a pose takes longer to compute than a row."""
        return max(POSES * self._most // MOST_ROWS, _FEWEST_POSES)

    def text(self) -> str:
        """Return the content as JSON that may stand in an HTML script element."""
        return json.dumps(self.content(), allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


# These take a table and the name of its column, as the columns of a long run must not all be in memory together.


def _coordinate(table: object, column: str, axis: int) -> Floats:
    def coordinate(block: slice) -> Floats:
        # for each block, as the rows that have been read stay in memory
        points: Floats = getattr(table, column)
        return points[block, axis]

    return by_blocks(coordinate, len(getattr(table, column)))


def _micrometres(table: object, column: str) -> Floats:
    error: Floats = getattr(table, column)
    return UM * error


def _largest(values: Callable[[slice], Floats], rows: int) -> float:
    """Return the largest size of values that are computed for one block after the other."""
    return max(float(np.abs(values(block)).max(initial=0.0)) for block in blocks(rows))


def _dot_content(verdict: DotVerdict, rows: NDArray[np.intp]) -> dict[str, Any]:
    """Return place and size of a dot [mm], its volume error [%], whether it fails, and the row in which it is laid."""
    dot = verdict.dot
    error = verdict.volume_error
    last = dot.stretch[1] - 1
    return {
        **{name: round(value, _DOT_DECIMALS) for name, value in zip("xyz", dot.foot, strict=True)},
        "radius": round(dot.cap.radius, _DOT_DECIMALS),
        "height": round(dot.cap.height, _DOT_DECIMALS),
        "error": round(error, 1) if np.isfinite(error) else None,
        "failed": verdict.state == FAIL,
        "row": min(int(np.searchsorted(rows, last)), int(rows.size) - 1),
    }


def _bead_series(bead: Bead) -> Iterator[Series]:
    def width() -> Floats:
        return by_blocks(lambda block: np.interp(bead.length[block], bead.place, bead.width), len(bead.length))

    yield Series("width", "bead width", "mm", BEAD, width, None, "of the bead laid")


def _listing(text: str, lines: NDArray[np.intp]) -> dict[str, str] | None:
    """Return the lines of a program's text by number: all, or of a long program those that run; None without any."""
    active = set(np.unique(lines).tolist()) - {0}
    if not active:
        return None
    by_number = dict(enumerate(text.rstrip().split("\n"), 1))
    if len(by_number) > _LISTED_LINES:
        by_number = {number: line for number, line in by_number.items() if number in active}
    return {str(number): line.rstrip() for number, line in by_number.items()}
