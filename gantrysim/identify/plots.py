"""Plots of an identification: residual, friction, frequency response."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import csd, welch

from gantrysim.base.arrays import Floats
from gantrysim.base.quantity import UM
from gantrysim.identify.identification import IdentifiedValue, spectrum
from gantrysim.identify.log import Log
from gantrysim.identify.model import AxisModel
from gantrysim.identify.pieces import Starts, gradient, longest_piece, smoothed
from gantrysim.identify.result import KNOWN_INTERVAL, LABELS, AxisFit
from gantrysim.identify.torque_regression import WIDTH, TorqueRegression
from gantrysim.identify.whiteness import correlation
from gantrysim.report.plots.pictures import PAGE_COLUMNS
from gantrysim.report.plots.style import COLOURS, axes_on, sheet, thinned_line
from gantrysim.results.colours import AXES, GOOD, INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

_SEGMENT = 1024  # samples of a spectrum's segment
_DRAWN_COHERENCE = 0.5  # least coherence of a frequency that is drawn
_DIFFERENCED = 0.42  # of the sampling rate, below which two central differences, of gain sinc(2 f T)², are undone
_SPEEDS = 100
_ONE_WAY = 0.999  # low-passed direction of a motion that does not reverse nearby
_DRAWN_POINTS = 500  # of the log in a plot of the friction, by direction
_SHOWN_SHARES = (0, 300)  # of the machine's values; beyond them, a value is in the table [%]
_HEIGHT = 2.9  # of a row [inch]


def _rows(fits: tuple[AxisFit, ...], columns: int) -> tuple[Figure, list[list[Axes]]]:
    with sheet(10.0, 0.6 + _HEIGHT * len(fits)) as drawing:
        return drawing, drawing.subplots(len(fits), columns, squeeze=False).tolist()


def draw_values(on: Figure | SubFigure | Axes, values: Sequence[IdentifiedValue]) -> Axes:
    """Draw fitted values with their intervals over those of the machine as it is described; return the axes.

    A bar shows the interval that would be narrow enough; values that are not identified are hollow.
    """
    axes = axes_on(on)
    axes.axvline(100, color=INK, lw=1.2, ls=":", label="machine as described")
    for row, value in enumerate(values):
        if not value.nominal:
            continue
        place, low, high = (100 * number / value.nominal for number in (value.value, value.low, value.high))
        half = KNOWN_INTERVAL * abs(place)
        axes.barh(row, 2 * half, 0.7, place - half, color=GOOD, alpha=0.35, label="" if row else "narrow enough")
        axes.plot([low, high], [row, row], color=INK, lw=1.4)
        axes.plot(place, row, "o", color=INK, mfc=INK if value.identified else "white", ms=5)
    axes.set_yticks(range(len(values)), [f"{value.axis}: {LABELS.get(value.name, value.name)}" for value in values])
    axes.set(ylim=(len(values) - 0.4, -0.6), xlim=_SHOWN_SHARES)
    axes.set_xlabel("fitted value and its 95 % interval [% of the machine's]")
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    axes.grid(visible=False, axis="y")
    return axes


def draw_residuals(fits: tuple[AxisFit, ...], period: float) -> Figure:
    """Draw the one-step residual of each axis over time, its correlation and its spectrum."""
    drawing, rows = _rows(fits, 3)
    for (over_time, lags, power), fit, colour in zip(rows, fits, _colours(len(fits)), strict=True):
        unit, factor = _small(fit.unit)
        time = np.arange(fit.innovations.size, dtype=np.float64) * period
        shown: Floats = np.where(fit.used, factor * fit.innovations, np.nan)
        over_time.plot(*thinned_line(time, shown), color=colour, lw=0.6)
        over_time.set(xlabel="time in the log's moves [s]", ylabel=f"{fit.axis}: residual [{unit}]")
        correlations = correlation(fit.residual)
        lags.bar(np.arange(1, correlations.size + 1), correlations, color=colour)
        bound = 1.96 / np.sqrt(fit.residual.size)
        lags.axhspan(-bound, bound, color=COLOURS["requested"], alpha=0.4)
        lags.set(xlabel="lag [samples]", ylabel="correlation", ylim=(-1, 1))
        power.semilogy(*spectrum(fit, period), color=colour, lw=1)
        power.set(xlabel="frequency [Hz]", ylabel=f"power [{fit.unit}²/Hz]")
    return drawing


@dataclass(frozen=True, eq=False)
class Course:
    """A log and its fit at each sample of the moves, (n,) each; torques are low-passed.

    Attributes:
        time: [s].
        position: measured [u].
        predicted: from all samples before [u].
        speed: low-passed [u/s].
        torque: of the log [N·m].
        modelled: torque that the fitted model takes for this motion, nan where the axis does not slide [N·m].
        friction: of the log, against the motion, nan where the axis does not slide, or reverses within the low-pass
            [N·m].
        residual: what is not predicted, nan where the axis is at rest [u].
    """

    time: Floats
    position: Floats
    predicted: Floats
    speed: Floats
    torque: Floats
    modelled: Floats
    friction: Floats
    residual: Floats

    @classmethod
    def of(cls, fit: AxisFit, log: Log) -> Course:
        """Return the course of a log and its fit."""
        model = fit.model
        width = WIDTH / log.period
        sliding = TorqueRegression.of(model, log.period, fit.position, fit.torque, fit.held, fit.starts)
        sliding = sliding.with_directions(fit.directions)
        motion = sliding.motion
        speed = smoothed(motion.speed, width, fit.starts)
        inert = model.inertia * gradient(speed, log.period, fit.starts)
        level = model.viscous * np.abs(motion.speed) + model.coulomb + fit.law.level
        friction = smoothed(level * motion.direction + fit.law.ripple, width, fit.starts)
        torque = smoothed(motion.torque, width, fit.starts)
        slides = np.where(sliding.slides, 1.0, np.nan)
        direction = smoothed(motion.direction, width, fit.starts)
        direction = np.where(np.abs(direction) > _ONE_WAY, np.sign(direction), np.nan) * slides
        return cls(
            time=log.time[fit.first : fit.first + fit.position.size],
            position=fit.position,
            predicted=fit.position - fit.innovations,
            speed=speed,
            torque=torque,
            modelled=(inert + friction - model.offset) * slides,
            friction=(torque - inert + model.offset) * direction,
            residual=np.where(fit.used, fit.innovations, np.nan),
        )


def draw_course(figure: Figure | SubFigure, shown: tuple[AxisFit, Log]) -> tuple[Axes, ...]:
    """Draw position, speed, torque and residual of an axis over time, of the log and of the fit; return the axes."""
    fit, log = shown
    course = Course.of(fit, log)
    unit, factor = _small(fit.unit)
    colour = _colour(fit, log)
    panels = figure.subplots(4, sharex=True)
    rows: tuple[tuple[str, list[tuple[Floats, str, str, str]]], ...] = (
        (f"position [{fit.unit}]", [
            (course.position, "measured", INK, "-"), (course.predicted, "predicted one sample ahead", colour, "--"),
        ]),
        (f"speed [{fit.unit}/s]", [(course.speed, "measured, low-passed", INK, "-")]),
        ("torque [N·m]", [
            (course.torque, "log, low-passed", INK, "-"), (course.modelled, "fitted model, sliding", colour, "--"),
        ]),
        (f"residual [{unit}]", [(factor * course.residual, "measured less predicted, in motion", colour, "-")]),
    )  # fmt: skip
    for axes, (label, lines) in zip(panels, rows, strict=True):
        for values, name, line_colour, style in lines:
            gapped = _with_gaps(course.time, values, fit.starts)
            axes.plot(*thinned_line(*gapped, PAGE_COLUMNS), style, color=line_colour, lw=0.9, label=name)
        axes.set_ylabel(label)
        axes.margins(x=0.01)
        axes.legend(loc="lower left", bbox_to_anchor=(0, 0.97), ncols=2, borderpad=0.1)
    panels[0].set_title(f"axis {fit.axis}", loc="right")
    panels[-1].set_xlabel("time of the log [s]")
    return tuple(panels)


def draw_friction(on: Figure | SubFigure | Axes, shown: tuple[AxisFit, Log]) -> Axes:
    """Draw the friction of an axis over speed, by direction: of the log, of the MJCF and fitted; return the axes."""
    fit, log = shown
    course = Course.of(fit, log)
    axes = axes_on(on)
    known = np.flatnonzero(np.isfinite(course.friction))
    top = 0.0
    directions = (("forwards", 1.0, COLOURS["servo"], "-"), ("back", -1.0, COLOURS["program"], "--"))
    for name, way, colour, style in directions:
        chosen = known[way * course.speed[known] > 0]
        # the same number for both, evenly in time
        points = chosen[:: max(chosen.size // _DRAWN_POINTS, 1)]
        speeds = np.abs(course.speed[points])
        axes.plot(speeds, course.friction[points], ".", ms=2.5, color=colour, alpha=0.35, label=f"log, {name}")
        smooth = np.linspace(0.0, float(speeds.max(initial=0.0)), _SPEEDS)
        viscous = fit.model.viscous_forward if way > 0 else fit.model.viscous_back
        fitted = _friction(fit.model, viscous, smooth)
        axes.plot(smooth, fitted, style, color=colour, lw=1.8, label=f"fitted, {name}")
        top = max(top, float(fitted.max()), float(np.quantile(course.friction[points], 0.99)) if points.size else 0.0)
    smooth = np.linspace(0.0, float(np.abs(course.speed[known]).max(initial=0.0)), _SPEEDS)
    nominal = _friction(fit.nominal, fit.nominal.viscous, smooth)
    axes.plot(smooth, nominal, ":", color=COLOURS["requested"], lw=1.8, label="nominal")
    top = max(top, float(nominal.max()))
    axes.set(xlabel=f"speed [{fit.unit}/s]", ylabel="friction against the motion [N·m]", ylim=(0, 1.15 * top or 1.0))
    axes.set_xlim(0, None)
    axes.set_title(f"axis {fit.axis}", loc="left")
    axes.legend(ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0), markerscale=3)
    return axes


def _friction(model: AxisModel, viscous: float, speed: Floats) -> Floats:
    stick = model.excess * np.exp(-((speed / (model.stribeck * model.scale)) ** 2))
    return np.asarray(model.coulomb + stick + viscous * speed)


def draw_response(
    fits: tuple[AxisFit, ...], period: float, torque: Callable[[str], Floats], position: Callable[[str], Floats]
) -> Figure:
    """Draw acceleration per torque of each motor over frequency: measured, of the MJCF and fitted.

    The measured one is the cross spectrum over the torque's own. Of a closed loop it is a picture, not what is fitted.
    """
    drawing, rows = _rows(fits, 1)
    for (axes,), fit, colour in zip(rows, fits, _colours(len(fits)), strict=True):
        options = {"fs": 1 / period, "nperseg": min(_SEGMENT, position(fit.axis).size), "detrend": "linear"}
        acceleration = np.gradient(np.gradient(position(fit.axis), period), period)
        frequency, cross = csd(torque(fit.axis), acceleration, **options)
        power = welch(torque(fit.axis), **options)[1]
        other = welch(acceleration, **options)[1]
        good = (np.abs(cross) ** 2 > _DRAWN_COHERENCE * power * other) & (frequency > 0)
        good &= frequency < _DIFFERENCED / period
        measured = np.abs(cross[good]) / power[good] / np.sinc(2 * frequency[good] * period) ** 2
        axes.loglog(frequency[good], measured, ".", ms=3, color=INK, label="measured")
        smooth = np.geomspace(5, 0.5 / period, _SPEEDS)
        axes.loglog(smooth, fit.nominal.response(smooth), "--", color=COLOURS["requested"], label="nominal")
        axes.loglog(smooth, fit.model.response(smooth), color=colour, label="fitted")
        axes.set(xlabel="frequency [Hz]", ylabel=f"{fit.axis}: acceleration per torque\n[{fit.unit}/s² per N·m]")
        axes.legend()
    return drawing


def draw_moves_response(fits: tuple[AxisFit, ...], period: float) -> Figure:
    """Draw the response of each axis in its own moves, see `draw_response`."""
    # a spectrum knows no gaps
    moves = {fit.axis: (fit, longest_piece(fit.position.size, fit.starts)) for fit in fits}

    def torque(axis: str) -> Floats:
        fit, piece = moves[axis]
        return fit.torque[piece]

    def position(axis: str) -> Floats:
        fit, piece = moves[axis]
        return fit.position[piece]

    return draw_response(fits, period, torque, position)


def save_plots(fits: tuple[AxisFit, ...], log: Log, folder: Path) -> None:
    """Write residuals, friction and response as pictures into a folder."""
    draw_residuals(fits, log.period).savefig(folder / "residuals.png")
    with sheet(10.0, 0.6 + 1.4 * _HEIGHT * len(fits)) as drawing:
        for (part,), fit in zip(drawing.subfigures(len(fits), 1, squeeze=False), fits, strict=True):
            draw_friction(part, (fit, log))
        drawing.savefig(folder / "friction.png")
    draw_moves_response(fits, log.period).savefig(folder / "response.png")


def _with_gaps(time: Floats, values: Floats, starts: Starts) -> tuple[Floats, Floats]:
    """Return a line that is interrupted between the pieces of a log."""
    return np.insert(time, starts[1:], np.nan), np.insert(values, starts[1:], np.nan)


def _colour(fit: AxisFit, log: Log) -> str:
    return _colours(len(log.axes))[log.axes.index(fit.axis)]


def _colours(count: int) -> list[str]:
    return [AXES[k % len(AXES)] for k in range(count)]


def _small(unit: str) -> tuple[str, float]:
    return ("µm", UM) if unit == "mm" else ("mdeg", UM)
