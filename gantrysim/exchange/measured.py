"""A measured trace as a record beside that of the simulation, aligned with it in time and place.

The measured samples are never interpolated: the simulation, which is smooth, is taken at their instants. With m(t) a
measured position, s(t) the simulated one of the same link and R a turn about z, the least sum of squares of

    m(t) - R s(t - shift) - offset

gives shift, offset and turn; it starts from the highest cross-correlation of the velocities.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import correlate, correlation_lags

from gantrysim.arrays import Floats
from gantrysim.errors import InputError, unknown
from gantrysim.exchange.traces import Assignment, Log, Source
from gantrysim.machine.machine import Machine
from gantrysim.run import Run

ALIGNED = ("time", "offset", "rotation")
_LEAST = 8  # samples of a trace
_STEPS = 50
_SETTLED = 1e-9  # change of the shift that ends the search, in servo periods
_SMOOTH = 15  # samples of a mean over which velocities are correlated
_UNEVEN = 0.01  # of a period, between samples of one rate


@dataclass(frozen=True)
class Trace:
    """Measured positions, in the controller's or instrument's own frame.

    Attributes:
        time: instants of the samples, rising, (n,) [s].
        axes: positions by "commanded" and "encoder", those that are measured, (n, axes) [mm or deg].
        nozzle: (n, 3) [mm], nan in z where only x and y are measured; or None.
        notes: what had to be filled in.
    """

    time: Floats
    axes: Mapping[str, Floats]
    nozzle: Floats | None
    notes: tuple[str, ...] = ()

    @property
    def links(self) -> tuple[str, ...]:
        """Names of what is measured."""
        return (*self.axes, *(() if self.nozzle is None else ("nozzle",)))

    @classmethod
    def of(cls, log: Log, given: Assignment, run: Run) -> Trace:
        """Return the trace that a log holds, by an assignment or, where it is empty, by the names of its columns.

        Raises:
            InputError: quantities or columns that are unknown, nothing measured, or times that do not rise.
        """
        sources = dict(given.columns) or _recognised(log, run)
        period = given.period if given.period is not None else log.period
        quantities = {"time", *"xyz", *(f"{link}.{axis}" for link in ("commanded", "encoder") for axis in run.axes)}
        for key in sources:
            if key not in quantities:
                raise unknown("quantity", key, quantities)
        units = dict(zip(run.axes, run.units, strict=True))
        axes, notes = {}, []
        for link in ("commanded", "encoder"):
            found = {axis: sources[f"{link}.{axis}"] for axis in run.axes if f"{link}.{axis}" in sources}
            if found:
                columns = {axis: log.values(source, units[axis], period) for axis, source in found.items()}
                size = len(next(iter(columns.values())))
                axes[link] = np.column_stack([columns.get(axis, np.full(size, np.nan)) for axis in run.axes])
                if missing := [axis for axis in run.axes if axis not in found]:
                    notes.append(f"{link} of {', '.join(missing)} is not measured: that of the simulated command")
        nozzle = None
        if found := {axis: sources[axis] for axis in "xyz" if axis in sources}:
            if not {"x", "y"} <= found.keys():
                raise InputError(f"{log.label}: nozzle in {', '.join(found)}: must be in x and y, and may be in z")
            columns = {axis: log.values(source, "mm", period) for axis, source in found.items()}
            nozzle = np.column_stack([columns.get(axis, np.full(len(columns["x"]), np.nan)) for axis in "xyz"])
            if "z" not in found:
                notes.append("nozzle in z is not measured: that of the command")
        if not axes and nozzle is None:
            raise InputError(
                f"{log.label}: no position is measured: --columns must name some of {', '.join(sorted(quantities))}; "
                f"columns are {', '.join(log.columns)}"
            )
        size = len(next(iter(axes.values()))) if axes else len(nozzle if nozzle is not None else ())
        return cls(_times(log, sources.get("time"), period, size), axes, nozzle, tuple(notes))


def _times(log: Log, source: Source | None, period: float | None, size: int) -> Floats:
    if source is not None:
        time = log.values(source, "s", period)
    elif log.lost:
        raise InputError(f"{log.label}: samples were lost (overrun), so it must have a column of time")
    elif period is None:
        raise InputError(f"{log.label}: has no time: name its column, as time=t, or the period of its samples")
    else:
        time = period * np.arange(size)
    if time.size < _LEAST:
        raise InputError(f"{log.label}: has {time.size} samples, must have at least {_LEAST}")
    back = np.flatnonzero(np.diff(time) <= 0)
    if back.size:
        raise InputError(f"{log.label}: time goes from {time[back[0]]:g} s to {time[back[0] + 1]:g} s: must rise")
    return time


def _recognised(log: Log, run: Run) -> dict[str, Source]:
    """Return the quantities of tables of `gantrysim export` and of softMC's RECORD."""
    found = {"time": "time_s" if "time_s" in log.columns else "time", **{axis: f"nozzle_{axis}_mm" for axis in "xyz"}}
    for axis, unit in zip(run.axes, run.units, strict=True):
        for link, word in (("commanded", "PCMD"), ("encoder", "PFB")):
            plain = f"{link}_{axis}_{unit}"
            found[f"{link}.{axis}"] = plain if plain in log.columns else f"{word} {axis}"
    return {key: Source(name) for key, name in found.items() if name in log.columns}


@dataclass(frozen=True)
class Alignment:
    """How a trace lies against the simulation.

    Attributes:
        by: link that gives it: commanded, encoder or nozzle.
        shift: the trace's time less that of the run [s].
        offsets: the trace's position less that of the run, by frame: "axes" (axes,) and "nozzle" (3,) [mm or deg].
        rotation: turn of the nozzle's frame about z, counter-clockwise positive [deg].
        residual: rms of what is left of the link [mm or deg].
    """

    by: str
    shift: float
    offsets: Mapping[str, Floats]
    rotation: float
    residual: float


def aligned(trace: Trace, run: Run, what: tuple[str, ...] = ("time", "offset")) -> Alignment:
    """Return the alignment of a trace with a simulated run.

    The first of command, encoder and nozzle that is measured gives the shift. Axes have one offset, of that link; the
    nozzle has its own.

    Args:
        trace: measured.
        run: simulated.
        what: is fitted, of `ALIGNED`; the rest is taken to be zero.
    """
    for one in what:
        if one not in ALIGNED:
            raise unknown("alignment", one, ALIGNED)
    by = trace.links[0]
    placed = "offset" in what
    turning = "rotation" in what and trace.nozzle is not None
    shift, offset, turn, residual = _fitted(trace, run, by, None if "time" in what else 0.0, placed, turning)
    offsets = {}
    if by != "nozzle":
        offsets["axes"] = offset
        if trace.nozzle is not None:
            _, offset, turn, _ = _fitted(trace, run, "nozzle", shift, placed, turning)
    if trace.nozzle is not None:
        offsets["nozzle"] = offset
    return Alignment(by, shift, offsets, float(np.degrees(turn)), residual)


def _fitted(
    trace: Trace, run: Run, link: str, shift: float | None, placed: bool, turning: bool
) -> tuple[float, Floats, float, float]:
    """Return shift [s], offset, turn [rad] and the residual's rms of one link; a given shift is kept."""
    measured = trace.nozzle if link == "nozzle" else trace.axes[link]
    if measured is None:
        raise InputError(f"{link} is not measured")
    simulated = getattr(run, link)
    known = ~np.isnan(measured).any(axis=0)
    turning = turning and link == "nozzle"
    spline = CubicSpline(run.time, simulated[:, known], axis=0)
    m, columns = measured[:, known], np.flatnonzero(known)
    free = shift is None
    tau, turn = _correlated(trace.time, m, run, simulated[:, known], turning) if free else (float(shift or 0.0), 0.0)
    offset = np.zeros(m.shape[1])
    for _ in range(_STEPS):
        at = trace.time - tau
        inside = (at >= run.time[0]) & (at <= run.time[-1])
        if np.count_nonzero(inside) < _LEAST:
            raise InputError(
                f"the trace covers {np.count_nonzero(inside)} of its samples with the run, from {run.time[0]:g} to "
                f"{run.time[-1]:g} s: must be at least {_LEAST}"
            )
        s, rate = spline(at[inside]), spline(at[inside], 1)
        turned, turned_rate = _turned(s, turn), _turned(rate, turn)
        rest = m[inside] - turned - offset
        slopes = []
        if free:
            slopes.append(-turned_rate)
        if turning:
            slopes.append(_turned(s, turn + np.pi / 2) * (columns < 2))
        if placed:
            slopes += [np.broadcast_to(unit, rest.shape) for unit in np.eye(rest.shape[1])]
        if not slopes:
            break
        step = np.linalg.lstsq(np.stack([slope.ravel() for slope in slopes], axis=1), rest.ravel(), rcond=None)[0]
        left = list(step)
        change = left.pop(0) if free else 0.0
        tau += change
        if turning:
            turn += left.pop(0)
        offset = offset + (np.array(left) if placed else 0.0)
        if abs(change) <= _SETTLED * run.period and np.abs(step).max() <= _SETTLED:
            break
    whole = np.zeros(measured.shape[1])
    whole[known] = offset
    return float(tau), whole, float(turn), float(np.sqrt(np.mean(rest**2)))


def _turned(points: Floats, turn: float) -> Floats:
    """Return points turned about z, (n, 2 or more)."""
    if turn == 0.0:
        return points
    x, y, *more = points.T
    cos, sin = np.cos(turn), np.sin(turn)
    return np.column_stack([cos * x - sin * y, sin * x + cos * y, *more])


def _correlated(time: Floats, measured: Floats, run: Run, simulated: Floats, turning: bool) -> tuple[float, float]:
    """Return shift [s] and turn [rad] at the highest cross-correlation of the velocities."""
    even = np.arange(time[0], time[-1], run.period)
    smooth = partial(np.convolve, np.full(_SMOOTH, 1 / _SMOOTH), mode="same")
    one, other = (
        np.array([smooth(np.diff(column)) for column in columns])
        for columns in (
            [np.interp(even, time, column) for column in measured.T],
            simulated.T,
        )
    )
    lags = correlation_lags(one.shape[1], other.shape[1])
    if turning:  # in the plane as complex numbers, whose magnitude does not depend on a turn
        product = correlate(one[0] + 1j * one[1], other[0] + 1j * other[1], method="fft")
        best = int(np.abs(product).argmax())
        turn = float(np.angle(product[best]))
    else:
        total = sum(correlate(a, b, method="fft") for a, b in zip(one, other, strict=True))
        best, turn = int(np.argmax(total)), 0.0
    return float(even[0] - run.time[0] + lags[best] * run.period), turn


def beside(trace: Trace, found: Alignment, run: Run, machine: Machine) -> tuple[Run, Run]:
    """Return the records of the measured and of the simulated run, at the trace's instants that both cover.

    A link of the chain that is not measured is that of the link before it, in both, so that its share is zero: without
    the encoder, the nozzle's whole deviation from the command is structure; without the nozzle, the rigid machine's at
    the encoder is the nozzle. Command, dispenser and flow are the simulation's unless the command is measured. What no
    link needs is nan.

    Raises:
        InputError: the trace begins after the dispenser is on.
    """
    at = trace.time - found.shift
    rows = np.flatnonzero((at >= run.time[0]) & (at <= run.time[-1]))
    at = at[rows]
    starts = run.time[np.flatnonzero(run.dispense)[0]]
    period = float(np.median(np.diff(trace.time)))
    if at[0] > starts + period:
        raise InputError(
            f"the trace begins at {at[0]:.4g} s of the run, {at[0] - starts:.4g} s after the dispenser is on: must "
            "cover the start of the bead"
        )
    tick = np.clip(np.floor(at / run.period + 1e-6).astype(int), 0, len(run.time) - 1)
    simulated = {name: CubicSpline(run.time, getattr(run, name), axis=0)(at) for name in ("commanded", "encoder")}
    measured: dict[str, Floats] = {"commanded": simulated["commanded"]}
    for link, values in trace.axes.items():
        own = values[rows] - found.offsets["axes"]
        measured[link] = np.where(np.isnan(own), simulated["commanded"], own)
    if "encoder" not in trace.axes:
        measured["encoder"], simulated["encoder"] = measured["commanded"], simulated["commanded"]
    records = []
    for chain, actual in ((measured, True), (simulated, False)):
        tips = {link: machine.tip(chain[link]) for link in ("commanded", "encoder")}
        if trace.nozzle is None:
            nozzle = tips["encoder"]
        elif actual:
            nozzle = _turned(trace.nozzle[rows] - found.offsets["nozzle"], -np.radians(found.rotation))
            nozzle = np.where(np.isnan(nozzle), tips["commanded"], nozzle)
        else:
            nozzle = CubicSpline(run.time, run.nozzle, axis=0)(at)
            nozzle = np.where(np.isnan(trace.nozzle[rows]), tips["commanded"], nozzle)
        unknown_values = np.full_like(chain["encoder"], np.nan)
        records.append(
            replace(
                run,
                period=period,
                time=at,
                **chain,
                motor=chain["encoder"],
                commanded_tip=tips["commanded"],
                encoder_tip=tips["encoder"],
                motor_tip=tips["encoder"],
                nozzle=nozzle,
                **dict.fromkeys(("demand", "torque", "current", "voltage"), unknown_values),
                flow=run.flow[tick],
                flow_demand=run.flow_demand[tick],
                dispense=run.dispense[tick],
            )
        )
    return records[0], records[1]


def evenly(time: Floats) -> bool:
    """Return whether samples have one rate."""
    steps = np.diff(time)
    return bool(np.ptp(steps) <= _UNEVEN * np.median(steps))
