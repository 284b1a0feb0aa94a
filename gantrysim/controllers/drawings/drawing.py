"""A drawing traced by the axes: text of any format in, setpoints out."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.columns import blocks
from gantrysim.base.errors import InputError, at_least, finite, plane_point, positive, unknown
from gantrysim.base.extras import extra
from gantrysim.base.quantity import counted
from gantrysim.controllers.controller import Controller
from gantrysim.controllers.drawings.dxf import BINARY, read_dxf
from gantrysim.controllers.drawings.planning import Paused, planned_progress
from gantrysim.controllers.drawings.points import read_points, with_row_speeds, with_speeds
from gantrysim.controllers.drawings.routing import Manner, Route, routed_path
from gantrysim.controllers.drawings.shapes import FASTEST_SPEED, Sheet, Stroke, checked_stroke
from gantrysim.controllers.drawings.svg import read_svg
from gantrysim.controllers.placement import Placement
from gantrysim.controllers.speeds import Stretches
from gantrysim.paths.chain import Chain
from gantrysim.record.setpoints import Setpoints, SetpointTable, ticks

Three = tuple[float, float, float]

_PATH_DEVIATION = 0.1  # deviation of the requested path from a drawn curve, in units of the chord tolerance
_CHOICES = {
    "format": ("auto", "dxf", "svg", "csv"),
    "curve": ("lines", "spline"),
    "order": ("drawn", "nearest"),
}
_LEAST_LIFT = 1e-6  # [mm]
_SHOWN = 30  # names in a message
_DOT_TIME = 0.2  # of a drawing of nothing but dots [s]

# Units of length of a drawing.

UNITS = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3, "in": 25.4, "ft": 304.8, "pt": 25.4 / 72, "px": 25.4 / 96}


@dataclass(frozen=True)
class Drawing(Controller):
    """Traces the lines and curves of a drawing at the fastest speed within the limits of the axes.

    It reads DXF (LINE, ARC, CIRCLE, ELLIPSE, LWPOLYLINE, POLYLINE, SPLINE, POINT, and INSERT of these), SVG (all shapes
    and transforms) and tables of points (x, y[, z][, glue][, speed], or
    columns by their heads). Strokes are traced in the order and the
    direction in which they are drawn. A stroke that begins where the one before ends continues it; between others the
    axes travel with the dispenser off.

    Lines and arcs are exact, other curves become arcs within a tolerance. Corners are rounded within a tolerance, or
    passed at a limited jump of the axes' velocities. The speed is the highest that the programmed one and the limits of
    the axes allow; the first and the last speed are 0.

    Attributes:
        text: text of the drawing.
        placement: placement of the drawing on the work.
        format: "dxf", "svg" or "csv"; "auto" recognises it from the text.
        unit: "mm", "cm", "m", "um", "in", "ft", "pt" or "px"; "auto" for the drawing's own.
        layers: layers, groups or colours that are traced; all by default.
        glue: layers, groups or colours that lay glue, as a list, or as a table of true and false; all by default. The
            others are traced at the travel speed with the dispenser off.
        curve: how points of a CSV are joined: by "lines" or a "spline".
        order: order of the strokes: as "drawn", or always the "nearest" next.
        reverse: whether strokes may be traced backwards, where that joins them or saves travel.
        speed: path speed where glue is laid [mm/s].
        travel_speed: path speed where no glue is laid [mm/s].
        height: height of the drawing's zero plane [mm].
        lift: height of travel moves above the strokes; 0 stays at their height [mm].
        start: x and y of the initial position; by default the start of the first stroke [mm].
        join_tolerance: largest gap between strokes that are joined [mm].
        corner_tolerance: largest deviation of rounded corners from the drawing; 0 rounds none [mm].
        chord_tolerance: largest deviation of the arcs that approximate a curve [mm].
        corner_speed: largest jump of an axis' velocity where a corner is not rounded; 0 stops there [mm/s].
        velocity: speed limits of x, y and z; inf for none [mm/s].
        acceleration: acceleration limits of x, y and z; inf for none [mm/s²].
        dot_time: dispensing time of a dot, which is a POINT of DXF or a single point of a table that states no time; 0
            ignores dots. By default 0.2 s in a drawing of nothing but dots; beside lines, dots are ignored [s].

    Raises:
        InputError: a value out of bounds, or a drawing that cannot be read.
    """

    speed_scaling: ClassVar[str] = "speed and the speeds of a CSV, changed in one proportion; travel_speed stays"
    suffixes: ClassVar[tuple[str, ...]] = (".dxf", ".svg", ".csv", ".pos")
    ramp_arguments: ClassVar[tuple[str, ...]] = ("acceleration",)
    corner_argument: ClassVar[str | None] = "corner_tolerance"

    text: str
    placement: Placement = field(default_factory=Placement)
    format: str = "auto"
    unit: str = "auto"
    layers: tuple[str, ...] | None = None
    glue: tuple[str, ...] | dict[str, bool] | None = None
    curve: str = "lines"
    order: str = "drawn"
    reverse: bool = False
    speed: float = 50.0
    travel_speed: float = 200.0
    height: float = 0.0
    lift: float = 0.0
    start: tuple[float, float] | None = None
    join_tolerance: float = 0.01
    corner_tolerance: float = 0.05
    chord_tolerance: float = 0.01
    corner_speed: float = 0.0
    velocity: Three = (500.0, 500.0, 200.0)
    acceleration: Three = (2000.0, 2000.0, 1000.0)
    dot_time: float | None = None

    def with_lift(self, height: float) -> dict[str, Any] | None:
        return {"lift": height} if height > self.lift else None

    def __post_init__(self) -> None:
        for name, choices in _CHOICES.items():
            if getattr(self, name) not in choices:
                raise unknown(name, str(getattr(self, name)), choices)
        millimetres(self.unit)
        for name in ("speed", "travel_speed"):
            positive(name, getattr(self, name), "mm/s", FASTEST_SPEED)
        positive("chord_tolerance", self.chord_tolerance, "mm")
        finite("height", self.height, "mm")
        lengths = [(name, "mm") for name in ("lift", "join_tolerance", "corner_tolerance")]
        for name, unit in (*lengths, ("corner_speed", "mm/s")):
            at_least(name, getattr(self, name), 0, unit)
        if self.dot_time is not None:
            at_least("dot_time", self.dot_time, 0, "s")
        if 0 < self.lift < _LEAST_LIFT:
            raise InputError(f"lift = {self.lift:g} mm: must be 0 or at least {_LEAST_LIFT:g} mm")
        if self.start is not None:
            object.__setattr__(self, "start", plane_point("start", self.start))
        for name, unit in (("velocity", "mm/s"), ("acceleration", "mm/s²")):
            values = tuple(getattr(self, name))
            if len(values) != 3:
                raise InputError(f"{name} of {len(values)} values: must be three, of x, y and z")
            for axis, value in zip("xyz", values, strict=True):
                if value != math.inf:
                    positive(f"{name} of {axis}", value, unit)
            object.__setattr__(self, name, tuple(map(float, values)))
        for name in ("layers", "glue"):
            if isinstance(getattr(self, name), str):
                raise InputError(f"{name} = {getattr(self, name)!r:.60}: must be a list of names")
            if isinstance(getattr(self, name), list):
                object.__setattr__(self, name, tuple(getattr(self, name)))
        if self.curve == "spline" and self.kind != "csv":
            raise InputError(f'curve = "spline": must be for points of a csv, the drawing is {self.kind}')
        if not self._strokes:
            raise InputError(f"drawing: nothing is traced{self._left_out}; must have a line, an arc or a curve")

    @cached_property
    def kind(self) -> str:
        """The format of the text."""
        return kind_of(self.text) if self.format == "auto" else self.format

    @cached_property
    def sheet(self) -> Sheet:
        """The drawing, in its own place, in mm; beside lines, points are mostly marks of the construction."""
        sheet = read_sheet(self.kind, self.text, self.unit, self.curve, self.dot_time is None or self.dot_time > 0)
        if self.dot_time is not None:
            return sheet
        marks = [stroke for stroke in sheet.strokes if stroke.dot is not None and stroke.dot_time is None]
        if not marks or all(stroke.dot is not None for stroke in sheet.strokes):
            return sheet
        strokes = tuple(stroke for stroke in sheet.strokes if stroke.dot is None or stroke.dot_time is not None)
        mark = "POINT" if self.kind == "dxf" else "single point"
        return replace(sheet, strokes=strokes, ignored={**sheet.ignored, mark: len(marks)})

    @cached_property
    def _strokes(self) -> tuple[Stroke, ...]:
        """Those that are traced, on the work."""
        raised = np.array([0.0, 0.0, self.height])
        traced = self._matching("layers", self.layers)
        glue = self._laying()
        strokes = []
        for stroke, is_traced, lays in zip(self.sheet.strokes, traced, glue, strict=True):
            if is_traced:
                placed = self._with_glue(stroke, lays).moved(lambda points: self.placement.point(points) + raised)
                strokes.append(checked_stroke(placed))
        return tuple(strokes)

    def _matching(self, key: str, names: tuple[str, ...] | None) -> list[bool]:
        """Whether each stroke has one of the names."""
        if names is None:
            return [True] * len(self.sheet.strokes)
        present: set[str] = set().union(*(stroke.names for stroke in self.sheet.strokes))
        wanted: set[str] = set()
        for name in names:
            matching = matches(name, present)
            if not matching:
                raise unknown(f"{key}: layer or colour", name, sorted(present)[:_SHOWN])
            wanted |= matching
        return [bool(stroke.names & wanted) for stroke in self.sheet.strokes]

    def _laying(self) -> list[bool]:
        """Whether each stroke lays glue by the names of its layers."""
        if isinstance(self.glue, dict):
            off = self._matching("glue", tuple(name for name, on in self.glue.items() if not on))
            self._matching("glue", tuple(self.glue))
            return [not is_off for is_off in off]
        return self._matching("glue", self.glue)

    @staticmethod
    def _with_glue(stroke: Stroke, lays: bool) -> Stroke:
        stated = stroke.glue or (True,) * max(len(stroke.shapes), 1)
        return replace(stroke, glue=tuple(lays and stated_glue for stated_glue in stated))

    @cached_property
    def _manner(self) -> Manner:
        start = None if self.start is None else np.array([*self.start, self.height])
        return Manner(
            speed=self.speed,
            travel_speed=self.travel_speed,
            lift=self.lift,
            join=self.join_tolerance,
            chord=self.chord_tolerance,
            corner=self.corner_tolerance,
            dot_time=_DOT_TIME if self.dot_time is None else self.dot_time,
            nearest=self.order == "nearest",
            reverse=self.reverse,
            start=start,
        )

    @cached_property
    def route(self) -> Route:
        """The commanded path: curves approximated, corners rounded."""
        return routed_path(list(self._strokes), self._manner)

    @cached_property
    def requested(self) -> Chain:
        """The path as drawn, with the travel between: its corners are sharp, its curves ten times finer."""
        return self._requested_route.chain

    @cached_property
    def _requested_route(self) -> Route:
        fine = replace(self._manner, chord=_PATH_DEVIATION * self.chord_tolerance, corner=0.0)
        return routed_path(list(self._strokes), fine)

    @cached_property
    def profile(self) -> Paused:
        """Progress along the commanded path."""
        return planned_progress(self.route, self.velocity, self.acceleration, self.corner_speed)

    @property
    def duration(self) -> float:
        return self.profile.duration

    @cached_property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes: x, y, and z unless everything lies at the height 0."""
        ends = [leg.start for leg in self.route.legs] + [leg.end for leg in self.route.legs]
        return ("x", "y", "z") if np.abs(np.array(ends)[:, 2]).max() > 0 else ("x", "y")

    def with_speeds(self, change: Callable[[float], float]) -> dict[str, Any]:
        changed: dict[str, Any] = {"speed": change(self.speed)}
        text = with_speeds(self.text, change) if self.kind == "csv" else None
        return changed if text is None else {**changed, "text": text}

    @property
    def programmed_speed(self) -> float:
        """The fastest speed at which glue is laid: a table may state one for every point [mm/s]."""
        return max((leg.speed for leg in self._requested_route.legs if leg.glue), default=self.speed)

    def stretches(self, period: float) -> Stretches:
        """As `Controller.stretches`: the rows of a table of points, each with the speed on the way to it."""
        if self.kind != "csv":
            return super().stretches(period)
        route = self._requested_route
        lines = np.array([leg.line for leg in route.legs], np.intp)
        speeds = np.array([leg.speed if leg.line else 0.0 for leg in route.legs])
        last = np.append(np.diff(lines) != 0, True)
        return Stretches(route.chain.ends[last], lines[last], speeds[last])

    def with_stretch_speeds(self, speeds: Mapping[int, float]) -> dict[str, Any]:
        """As `Controller.with_stretch_speeds`: the column of speeds of a table of points, where they change."""
        if self.kind != "csv":
            return super().with_stretch_speeds(speeds)
        stated = {leg.line: leg.speed for leg in self._requested_route.legs}
        changed = {line: speed for line, speed in speeds.items() if speed != stated.get(line)}
        return {"text": with_row_speeds(self.text, changed)} if changed else {}

    @property
    def program_suffix(self) -> str:
        return f".{self.kind}"

    def line_at(self, time: float) -> int | None:
        """Return the row of a table of points on the way to whose point the nozzle is at a time [s]."""
        return int(self.lines_at(np.array([time]))[0]) or None

    def lines_at(self, times: Floats) -> NDArray[np.intp]:
        """As `Controller.lines_at`."""
        s = self.profile.position(times)
        legs = self.route.legs
        lines = np.array([leg.line for leg in legs], np.intp)
        return lines[np.clip(np.searchsorted(self.route.chain.ends, s, side="right"), 0, len(legs) - 1)]

    def setpoints(self, period: float) -> Setpoints:
        positive("period", period, "s")
        # before the profile is planned, which takes long for many pieces
        ticks(self._ideal_duration, period)
        count = ticks(self.profile.duration, period) + 1
        parts = (self._commands(period, block, count) for block in blocks(count))
        return Setpoints.of_blocks(period, self.axes, parts, count, self.requested)

    @property
    def _ideal_duration(self) -> float:
        """Duration without limits of the axes and stops [s]."""
        return sum(leg.length / leg.speed + leg.pause for leg in self.route.legs)

    def _commands(self, period: float, block: slice, count: int) -> SetpointTable:
        """Return the setpoints of a block out of so many."""
        time = np.arange(block.start, block.stop) * period
        s = self.profile.position(time)
        if block.stop == count:
            s[-1] = self.route.chain.length
        laying, dots = self._glue_of_legs
        k = np.clip(np.searchsorted(self.route.chain.ends, s, side="right"), 0, len(laying) - 1)
        dispense = laying[k]
        resting = self.profile.resting(time)
        dispense[resting >= 0] = dots[resting[resting >= 0]]
        position = self.route.chain.position(s)[:, : len(self.axes)]
        return SetpointTable(position, dispense, self.route.progress(s, self._requested_route))

    @cached_property
    def _glue_of_legs(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Whether each leg lays glue, and whether each pause does."""
        legs = self.route.legs
        return np.array([leg.glue for leg in legs], bool), np.array([leg.dot for leg in legs if leg.pause > 0], bool)

    @property
    def _left_out(self) -> str:
        if not self.sheet.ignored:
            return ""
        return f"; ignored: {_counts(self.sheet.ignored)}"

    @property
    def notes(self) -> tuple[str, ...]:
        """Strokes traced and ignored, assumptions, corners, and the effect of the axes' limits."""
        legs = self.route.legs
        corners = self.route.corners
        laid = sum(leg.length for leg in legs if leg.glue)
        dots = sum(stroke.dot is not None for stroke in self._strokes)
        lines = len(self._strokes) - dots
        traced = [counted(lines, "stroke")] if lines or not dots else []
        traced += [counted(dots, "dot")] if dots else []
        notes = [
            f"drawing: {self.kind}, {' and '.join(traced)} in {self.route.stretches} "
            f"stretch{'' if self.route.stretches == 1 else 'es'}; "
            f"{laid:.1f} mm of glue, {self.route.chain.length - laid:.1f} mm of travel"
        ]
        ignored = dict(self.sheet.ignored)
        untraced = len(self.sheet.strokes) - len(self._strokes)
        if untraced:
            ignored["stroke of other layers"] = untraced
        if ignored:
            notes.append(f"ignored: {_counts(ignored)}")
        notes += self.sheet.remarks
        if corners.rounded or corners.sharp:
            passed = f"passed at a jump of {self.corner_speed:g} mm/s" if self.corner_speed else "with a stop"
            notes.append(
                f"corners: {corners.rounded} rounded within {self.corner_tolerance:g} mm, {corners.sharp} {passed}"
            )
        ideal = self._ideal_duration
        if self.duration > ideal * (1 + 1e-6):
            notes.append(
                f"speed: the axes' limits and stops increase the duration from {ideal:.3f} s to {self.duration:.3f} s"
            )
        return tuple(notes)


def _counts(ignored: dict[str, int]) -> str:
    # of what has a name in the drawing, as TEXT or <text>, the name alone
    return ", ".join(
        counted(count, kind) if kind[0].islower() and kind != "invisible" else f"{count} {kind}"
        for kind, count in sorted(ignored.items())
    )


def millimetres(unit: str) -> float | None:
    """Return the length of a unit [mm], None of "auto".

    Raises:
        InputError: an unknown unit.
    """
    if unit != "auto" and unit not in UNITS:
        raise unknown("unit", unit, ("auto", *UNITS))
    return UNITS.get(unit)


def kind_of(text: str) -> str:
    """Return the format of a text: svg begins with "<", dxf with a pair of lines, a group code and its value."""
    lines = [line.strip() for line in text.lstrip("\ufeff \t\r\n")[:10_000].splitlines()[:200]]
    if text.startswith(BINARY):
        return "dxf"
    if lines and lines[0].startswith("<"):
        return "svg"
    codes = [code == "0" and value in ("SECTION", "EOF") for code, value in pairwise(lines)]
    return "dxf" if any(codes) else "csv"


@lru_cache(maxsize=4)
def read_sheet(kind: str, text: str, unit: str, curve: str, dots: bool) -> Sheet:
    """Return the strokes of a drawing; arguments as of `Drawing`, `dots` for whether points are traced.

    The last few are remembered: a job's checks, its path and its notes all ask for the same drawing.
    """
    text = text.removeprefix("\ufeff")
    length = millimetres(unit)
    if kind == "dxf":
        return read_dxf(text, length, dots)
    if kind == "svg":
        return read_svg(text, length)
    return read_points(text, length, curve, dots)


def matches(name: str, present: set[str]) -> set[str]:
    """Return the names in a drawing, layers and colours as "#rrggbb", that a layer or a colour of CSS means."""
    spellings = {name.lower()}
    if any(other.startswith("#") for other in present):
        spellings.add(_hex_of(name))
    return spellings & present


def _hex_of(name: str) -> str:
    """Return a colour of CSS as "#rrggbb", any other name unchanged."""
    # not words of a to f alone, which svgelements takes for hexadecimal digits
    if not re.fullmatch(r"#([0-9a-fA-F]{3}){1,2}|[a-fA-F]*[g-zG-Z][a-zA-Z]*", name):
        return name
    with extra("drawings", f"layer or colour {name}"):
        from svgelements import Color

    try:
        colour = Color(name)
    except ValueError:
        return name
    return name if colour.value is None else str(colour.hexrgb).lower()
