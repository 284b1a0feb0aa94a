"""The stream from a motion controller to its servo: one position per axis and servo tick."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats, read_only
from gantrysim.base.columns import Column, OptionalColumn, Stored, array_of, blocks, by_blocks, table_by_blocks
from gantrysim.base.display import Shown, picture_html, svg_picture
from gantrysim.base.errors import InputError, at_least, check_type, positive, whole_number, wrong_type
from gantrysim.base.memory import check_ticks
from gantrysim.base.quantity import number_text
from gantrysim.paths.path import Path
from gantrysim.paths.profile import Constant, PointToPoint, Profile

MAX_TICKS = 50_000_000
MATERIAL = ("extrusion", "extruder", "analogue")  # columns of what a program asks of the dispenser
_ROUNDING = 1e-9  # relative, of lengths

_MOST_POINTS = 800  # of a drawn line
_FAINT_OPACITY = 0.5  # opacity of the path without glue


@dataclass(frozen=True)
class Supervision:
    """Limits that the controller monitors during motion; inf for none.

    The position error is the root sum of squares of the linear axes' errors, each between the measured position and
    the command sent `position_error_delay` ticks before, which allows for transmission times.

    Attributes:
        position_error: limit of the group's position error [mm].
        position_error_delay: in servo periods.
        settle_error: largest error of a settled axis [mm or deg].
        settle_time: time for which the error must stay below that [s].
        settle_timeout: wait for settling after which a fault is raised [s].
        velocity_limit: speed limit of a linear axis [mm/s].
    """

    position_error: float = math.inf
    position_error_delay: int = 0
    settle_error: float = math.inf
    settle_time: float = 0.0
    settle_timeout: float = 1.0
    velocity_limit: float = math.inf

    def __post_init__(self) -> None:
        for name, unit in (("position_error", "mm"), ("settle_error", "mm"), ("velocity_limit", "mm/s")):
            if getattr(self, name) != math.inf:
                positive(name, getattr(self, name), unit)
        whole_number("position_error_delay", self.position_error_delay, 0)
        settle_time = at_least("settle_time", self.settle_time, 0, "s")
        at_least("settle_timeout", self.settle_timeout, settle_time, "s")


_COLUMNS: dict[str, type[np.generic]] = {
    "position": np.float64,
    "dispense": np.bool_,
    "progress": np.float64,
    "extrusion": np.float64,
    "extruder": np.float64,
    "analogue": np.float64,
}


@dataclass(frozen=True)
class SetpointTable:
    """Columns of consecutive setpoints, as in `Setpoints`; in a file where there are many.

    Attributes:
        position: (n, axes) [mm or deg].
        dispense: (n,).
        progress: (n,) [mm].
        extrusion: (n,) [mm]; None without.
        extruder: (n,) [mm]; None without.
        analogue: (n,); None without.
    """

    position: Column[Floats] = Column()
    dispense: Column[NDArray[np.bool_]] = Column()
    progress: Column[Floats] = Column()
    extrusion: OptionalColumn[Floats] = OptionalColumn()
    extruder: OptionalColumn[Floats] = OptionalColumn()
    analogue: OptionalColumn[Floats] = OptionalColumn()


@dataclass(frozen=True, repr=False)
class Setpoints(Shown):
    """Commanded positions at every servo period, the dispenser command, and the requested path.

    Attributes:
        period: time from one setpoint to the next [s].
        axes: names of the axes, one per column of `position`.
        position: commanded positions at the times k * period, (n, axes) [mm or deg]; read-only.
        dispense: dispenser command, (n,); read-only.
        requested: the requested path as exact geometry.
        supervision: limits that the controller monitors.
        gates: indices of the setpoints at which the stream waits until all axes settle, ascending, (m,); read-only.
        torque: torque demands that the servo adds to its own, (n, axes) [N·m]; read-only; None for none.
        progress: arc length along the requested path for which each setpoint stands, never falling, (n,) [mm];
            read-only; None where it is not known. Without it an analysis assigns one, which takes long.
        extrusion: material that the program has fed so far by E, less what it has pulled back, (n,) [mm]; read-only;
            None for a program without E.
        extruder: position to which pressure advance sends the extruder's motor, (n,) [mm]; read-only; None where that
            is `extrusion`.
        analogue: set point of the flow, as the program sets it by an output, (n,); read-only; None without.
    """

    period: float
    axes: tuple[str, ...]
    position: Column[Floats] = Column()
    dispense: Column[NDArray[np.bool_]] = Column()
    requested: Path  # type: ignore[misc]  # columns are descriptors, no defaults
    supervision: Supervision = Supervision()
    gates: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    torque: Floats | None = None
    progress: OptionalColumn[Floats] = OptionalColumn()
    extrusion: OptionalColumn[Floats] = OptionalColumn()
    extruder: OptionalColumn[Floats] = OptionalColumn()
    analogue: OptionalColumn[Floats] = OptionalColumn()

    def __post_init__(self) -> None:
        positive("period", self.period, "s")
        given = {name: dtype for name, dtype in _COLUMNS.items() if vars(self)[name] is not None}
        stored = {name: _own(vars(self)[name], dtype) for name, dtype in given.items()}
        position = array_of(stored["position"])
        dispense = array_of(stored["dispense"])
        if position.ndim != 2 or position.shape[1] != len(self.axes) or len(position) < 2:
            raise InputError(f"setpoints of shape {position.shape}: must be (n, {len(self.axes)}) with n at least 2")
        if dispense.shape != position.shape[:1]:
            raise InputError(f"dispenser command of shape {dispense.shape}: must be {position.shape[:1]}")
        for block in blocks(len(position)):
            rows = array_of(stored["position"])[block]
            # axis by axis it would take much longer
            if not np.isfinite(rows).all():
                row = int(np.argmin(np.isfinite(rows).all(axis=1)))
                raise InputError(f"setpoint {block.start + row} = {rows[row].tolist()}: must be finite")
        if "progress" in stored:
            self._check_progress(array_of(stored["progress"]), dispense.shape)
        for name in stored.keys() & set(MATERIAL):
            fed = array_of(stored[name])
            if fed.shape != dispense.shape or not np.isfinite(fed).all():
                raise InputError(f"{name} of shape {fed.shape}: must be {dispense.shape}, all finite")
        gates = np.array(self.gates, np.int64)
        if gates.ndim != 1 or (gates.size and np.any(np.diff(gates, prepend=-1, append=len(position)) <= 0)):
            raise InputError(f"gates {gates.tolist()}: must be ascending indices of the {len(position)} setpoints")
        gates.flags.writeable = False
        for name, value in (*stored.items(), ("gates", gates)):
            object.__setattr__(self, name, value)
        if self.torque is not None:
            torque = np.array(self.torque, float)
            if torque.shape != position.shape or not np.isfinite(torque).all():
                raise InputError(f"torques of shape {torque.shape}: must be {position.shape}, all finite")
            torque.flags.writeable = False
            object.__setattr__(self, "torque", torque)

    def _check_progress(self, progress: Floats, shape: tuple[int, ...]) -> None:
        """Check that a progress lies on the path and never falls."""
        if progress.shape != shape:
            raise InputError(f"progress of shape {progress.shape}: must be {shape}, or None if it is not known")
        fault = progress_fault(progress, self.requested.length)
        if fault:
            raise InputError(f"{fault}; None if it is not known")

    def facts(self) -> dict[str, str]:
        low, high = (extreme(self.position, axis=0).tolist() for extreme in (np.min, np.max))
        spans = (
            f"{name} {number_text(a, '.5g')} to {number_text(b, '.5g')}"
            for name, a, b in zip(self.axes, low, high, strict=True)
        )
        stretches = int(np.count_nonzero(np.diff(self.dispense, prepend=False) & self.dispense))
        count = f"{stretches} stretches" if stretches > 1 else "1 stretch"
        on = f"{np.count_nonzero(self.dispense) * self.period:.4g} s in {count}"
        return {
            "setpoints": f"{len(self.position)} of {1e3 * self.period:g} ms, {self.duration:.4g} s",
            "positions": ", ".join(spans),
            "path": f"{self.requested.length:.5g} mm",
            "dispenser on": on if stretches else "never",
            "waits to settle": str(self.gates.size),
        }

    def _repr_html_(self) -> str:
        return picture_html(plan_picture(self.requested, self.progress, self.dispense), super()._repr_html_())

    @property
    def time(self) -> Floats:
        """Times of the setpoints, without waits at gates, (n,) [s]."""
        return np.arange(len(self.position), dtype=np.float64) * self.period

    @property
    def duration(self) -> float:
        """Time of the last setpoint, without waits at gates [s]."""
        return (len(self.position) - 1) * self.period

    @property
    def run_ticks(self) -> int:
        """Number of servo ticks of a run with the shortest wait at each gate, which is the settling time."""
        return len(self.position) + self.gates.size * periods(self.supervision.settle_time, self.period)

    @property
    def most_ticks(self) -> int:
        """Number of servo ticks of a run with the longest wait at each gate, after which a fault occurs."""
        return len(self.position) + self.gates.size * (periods(self.supervision.settle_timeout, self.period) + 1)

    @property
    def time_before_glue(self) -> float:
        """Time before the first dispensing, inf where there is none [s]."""
        first = int(np.argmax(self.dispense))
        return first * self.period if self.dispense[first] else math.inf

    @property
    def material(self) -> dict[str, Floats]:
        """The columns of what the program asks of the dispenser, by name; empty where it does that by its command."""
        return {name: getattr(self, name) for name in MATERIAL if vars(self)[name] is not None}

    def hold(self, duration: float) -> Setpoints:
        """Return these setpoints with the last position held for `duration` [s], the dispenser off."""
        return self._padded_setpoints(0, ticks(at_least("hold", duration, 0, "s"), self.period))

    def wait(self, duration: float) -> Setpoints:
        """Return these setpoints after a hold of the first position for `duration` [s], the dispenser off."""
        return self._padded_setpoints(ticks(at_least("wait", duration, 0, "s"), self.period), 0)

    def until(self, count: int) -> Setpoints:
        """Return the first `count` setpoints, without waits at gates."""
        return self.part(slice(0, count))

    def part(self, rows: slice) -> Setpoints:
        """Return consecutive setpoints, without waits at gates and torques."""
        given = {name: getattr(self, name)[rows] for name in ("progress", *MATERIAL) if self._has(name)}
        return Setpoints(
            period=self.period,
            axes=self.axes,
            position=self.position[rows],
            dispense=self.dispense[rows],
            requested=self.requested,
            supervision=self.supervision,
            **given,
        )

    def _padded_setpoints(self, before: int, after: int) -> Setpoints:
        if not before and not after:
            return self
        total = len(self.position) + before + after
        duration = (before + after) * self.period
        check_ticks(total, f"hold of {duration:g} s in periods of {self.period:g} s", "hold for a shorter time")
        table = table_by_blocks(self._padded_blocks(before, after), total)
        torque = None if self.torque is None else np.pad(self.torque, ((before, after), (0, 0)), "edge")
        columns = vars(table) if self.progress is not None else {**vars(table), "progress": None}
        return replace(self, **columns, gates=self.gates + before, torque=torque)

    def _padded_blocks(self, before: int, after: int) -> Iterator[SetpointTable]:
        """Yield the blocks of these setpoints after and before so many of the first and last position."""
        count = len(self.position)
        for block in blocks(before + count + after):
            k = np.arange(block.start, block.stop) - before
            first, last = k.clip(0, count - 1)[[0, -1]]
            position = self.position[first : last + 1]
            dispense = self.dispense[first : last + 1]
            progress = np.zeros(len(position)) if self.progress is None else self.progress[first : last + 1]
            # as take copies rows in a third of the time of an index
            inside = k.clip(0, count - 1) - first
            fed = {name: getattr(self, name)[first : last + 1].take(inside) for name in MATERIAL if self._has(name)}
            on = dispense.take(inside) & (k >= 0) & (k < count)
            yield SetpointTable(position.take(inside, axis=0), on, progress.take(inside), **fed)

    def _has(self, name: str) -> bool:
        return vars(self)[name] is not None

    @classmethod
    def of_blocks(
        cls, period: float, axes: tuple[str, ...], parts: Iterator[SetpointTable], count: int, requested: Path
    ) -> Setpoints:
        """Return setpoints from blocks with `count` rows in total; a large table is kept in a temporary file."""
        return cls(period, axes, **vars(table_by_blocks(parts, count)), requested=requested)

    @classmethod
    def unwritten(cls, like: Setpoints, count: int) -> Setpoints:
        """Return setpoints to be written while their run goes on: all zero, unchecked, and writable.

        They take no time and no memory before they are written.

        Args:
            like: setpoints with the same period, axes and requested path.
            count: number of them.
        """
        setpoints = object.__new__(cls)
        columns = {
            "position": np.zeros((count, len(like.axes))),
            "dispense": np.zeros(count, bool),
            "progress": np.zeros(count),
        }
        missing = {"torque": None, **dict.fromkeys(MATERIAL)}
        values = {
            "period": like.period,
            "axes": like.axes,
            "requested": like.requested,
            "supervision": Supervision(),
            "gates": np.zeros(0, np.int64),
        }
        vars(setpoints).update(values | columns | missing)
        return setpoints

    @classmethod
    def along(
        cls,
        path: Path,
        speed: Profile | float,
        period: float,
        *,
        requested: Path | None = None,
        axes: tuple[str, ...] = ("x", "y"),
        coordinates: Callable[[Floats], Floats] | None = None,
    ) -> Setpoints:
        """Return setpoints along the whole `path`, with the dispenser on; the progress along another one is not known.

        The last setpoint is the end of the path, so the last step may be shorter than a period's.

        Args:
            path: the commanded path.
            speed: profile along the path, or a constant path speed [mm/s].
            period: servo period [s].
            requested: the requested path, by default `path` itself.
            axes: names of the axes, the first of x, y, z.
            coordinates: function from arc lengths, (n,), to axis positions, (n, axes); by default points of the path.
        """
        check_type("path", path, Path, "a Path", "gantrysim.paths has lines, arcs and chains of them")
        if isinstance(axes, str) or not isinstance(axes, Sequence):
            raise wrong_type("axes", axes, "names of axes", 'write axes=("x", "y")')
        positive("period", period, "s")
        # the first by its type: whether an object has what the protocol asks for takes longer to find out
        profile = speed if isinstance(speed, (PointToPoint, Profile)) else Constant(path.length, speed)
        if abs(profile.length - path.length) > _ROUNDING * (1 + path.length):
            raise InputError(f"profile of {profile.length:.6g} mm: must be as long as the path, {path.length:.6g} mm")
        n = ticks(profile.duration, period)

        def places(block: slice) -> Floats:
            s = profile.position(np.arange(block.start, block.stop) * period)
            if block.stop > n:
                s[-1] = path.length
            return s

        progress = by_blocks(places, n + 1)

        def positions(block: slice) -> Floats:
            s = progress[block]
            if coordinates is not None:
                return coordinates(s)
            # stacked, as NumPy copies short rows of a longer array much slower than columns
            return np.stack([*path.position(s).T[: len(axes)]], axis=1)

        return cls(
            period=period,
            axes=axes,
            position=by_blocks(positions, n + 1),
            dispense=np.ones(n + 1, bool),
            requested=path if requested is None else requested,
            progress=progress if requested is None else None,
        )


def progress_fault(progress: Floats, length: float) -> str:
    """Return what is wrong with a progress along a path of some length [mm]; empty for a right one."""
    falls = 0
    for block in blocks(progress.size):
        falls += int(np.count_nonzero(~(np.diff(progress[block.start : block.stop + 1]) >= 0)))
    rounding = _ROUNDING * (1 + length)
    low = progress[0]
    high = progress[-1]
    if not falls and -rounding <= low and high <= length + rounding:
        return ""
    return (
        f"progress from {low:g} to {high:g} mm, falling {falls} times: must be from 0 to {length:g} mm, the length of "
        "the requested path, and never fall"
    )


def _own(values: NDArray[Any] | Stored, dtype: type[np.generic]) -> NDArray[Any] | Stored:
    """Return values as an array that nobody writes to: read-only or stored ones themselves, or a copy."""
    if isinstance(values, Stored) and values.dtype == dtype:
        return values
    if isinstance(values, np.ndarray) and values.dtype == dtype:
        memory = values.base if isinstance(values.base, np.ndarray) else values
        if not values.flags.writeable and not memory.flags.writeable:
            return values
    return read_only(np.array(values, dtype))


def ticks(duration: float, period: float) -> int:
    """Return the number of setpoints after the first that cover `duration` [s], see `periods`.

    Raises:
        InputError: more than MAX_TICKS, or than there is memory for.
    """
    count = periods(duration, period)
    check_ticks(count, f"{duration:g} s in periods of {period:g} s", "use a shorter program or a longer period")
    return count


def periods(duration: float, period: float) -> int:
    """Return the number of whole periods that cover `duration` [s], with a tolerance for rounding.

    Raises:
        InputError: more than MAX_TICKS.
    """
    # rounding of the quotient must not add a period
    count = duration / period - 1e-9
    if not count <= MAX_TICKS:
        raise InputError(f"{duration:g} s in periods of {period:g} s: makes {count:.3g} ticks, at most {MAX_TICKS:g}")
    return math.ceil(count)


def plan_picture(path: Path, progress: Floats | None, dispense: NDArray[np.bool_]) -> str:
    """Return a requested path, and over it where the dispenser is on, as an SVG element.

    Positions of axes are no plan view where the work turns: the progress along the path says where glue is laid.

    Args:
        path: the requested path.
        progress: arc length along it of each setpoint, (n,) [mm]; None where it is not known.
        dispense: dispenser command, (n,).
    """
    line = _points(path, 0.0, path.length, _MOST_POINTS)
    low = line.min(axis=0)
    wide, high = np.maximum(np.ptp(line, axis=0), 1e-3).tolist()
    pixel = max(wide, high) / 320
    content = _line(line, pixel, _FAINT_OPACITY)
    if progress is not None:
        content += "".join(_line(points, 3 * pixel) for points in _glued_stretches(path, progress, dispense))
    return svg_picture(content, (*low.tolist(), wide, high), "plan view of the setpoints")


def _glued_stretches(path: Path, progress: Floats, dispense: NDArray[np.bool_]) -> Iterator[Floats]:
    """Yield the points of each stretch of the path that is passed with the dispenser on, (k, 2) [mm]."""
    edges = np.flatnonzero(np.diff(dispense, prepend=False, append=False)).reshape(-1, 2)
    for begin, end in edges[:_MOST_POINTS].tolist():
        first = float(progress[begin])
        last = float(progress[end - 1])
        count = 2 + round(_MOST_POINTS * (last - first) / path.length)
        yield _points(path, first, last, count)


def _points(path: Path, first: float, last: float, count: int) -> Floats:
    return path.position(np.linspace(first, last, count))[:, :2]


def _line(points: Floats, width: float, opacity: float = 1.0) -> str:
    drawn = " ".join(f"{x:.5g},{y:.5g}" for x, y in points.tolist())
    stroke = f'stroke="currentColor" stroke-opacity="{opacity:g}" stroke-width="{width:.3g}" stroke-linecap="round"'
    return f'<polyline points="{drawn}" fill="none" {stroke}/>'
