"""Plots of an identification: residual, friction, frequency response."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import csd, welch

from gantrysim.base.arrays import Floats
from gantrysim.identify.identification import spectrum
from gantrysim.identify.result import AxisFit
from gantrysim.identify.whiteness import correlation
from gantrysim.report.plots.style import AXIS_COLOURS, COLOURS, INK, UM, sheet, thinned_line

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SEGMENT = 1024  # samples of a spectrum's segment
_COHERENT = 0.5  # least coherence of a frequency that is drawn
_DIFFERENCED = 0.42  # of the sampling rate, below which two central differences, of gain sinc(2 f T)², are undone
_SPEEDS = 400
_HEIGHT = 2.9  # of a row [inch]


def _rows(fits: tuple[AxisFit, ...], columns: int) -> tuple[Figure, list[list[Axes]]]:
    with sheet(10.0, 0.6 + _HEIGHT * len(fits)) as drawing:
        return drawing, drawing.subplots(len(fits), columns, squeeze=False).tolist()


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


def draw_friction(fits: tuple[AxisFit, ...]) -> Figure:
    """Draw the friction of each axis over speed: of the MJCF and fitted."""
    drawing, rows = _rows(fits, 1)
    for (axes,), fit, colour in zip(rows, fits, _colours(len(fits)), strict=True):
        speed = np.geomspace(0.02 * fit.model.stribeck * fit.model.scale, 300 * fit.model.stribeck * fit.model.scale)
        for model, label, style in ((fit.nominal, "nominal", "--"), (fit.model, "fitted", "-")):
            stick = model.excess * np.exp(-((speed / (model.stribeck * model.scale)) ** 2))
            axes.semilogx(
                speed, model.coulomb + stick + model.viscous * speed, style, label=label,
                color=colour if style == "-" else COLOURS["requested"],
            )  # fmt: skip
        axes.set(xlabel=f"speed [{fit.unit}/s]", ylabel=f"{fit.axis}: friction [N·m]", ylim=(0, None))
        axes.legend()
    return drawing


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
        good = (np.abs(cross) ** 2 > _COHERENT * power * other) & (frequency > 0)
        good &= frequency < _DIFFERENCED / period
        measured = np.abs(cross[good]) / power[good] / np.sinc(2 * frequency[good] * period) ** 2
        axes.loglog(frequency[good], measured, ".", ms=3, color=INK, label="measured")
        smooth = np.geomspace(5, 0.5 / period, _SPEEDS)
        axes.loglog(smooth, fit.nominal.response(smooth), "--", color=COLOURS["requested"], label="nominal")
        axes.loglog(smooth, fit.model.response(smooth), color=colour, label="fitted")
        axes.set(xlabel="frequency [Hz]", ylabel=f"{fit.axis}: acceleration per torque\n[{fit.unit}/s² per N·m]")
        axes.legend()
    return drawing


def _colours(count: int) -> list[str]:
    return [AXIS_COLOURS[k % len(AXIS_COLOURS)] for k in range(count)]


def _small(unit: str) -> tuple[str, float]:
    return ("µm", UM) if unit == "mm" else ("mdeg", UM)
