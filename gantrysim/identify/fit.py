"""Fits the model of an axis to a log of its torque and position."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares, minimize

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.identify.checks.plausible import check_inertia
from gantrysim.identify.model import AxisModel, innovations
from gantrysim.identify.regression import in_motion, regression
from gantrysim.identify.result import CONFIDENCE, MODE, PARAMETERS, SYSTEMATIC, WHITE, AxisFit, Estimate, Sensitivity
from gantrysim.identify.whiteness import LAGS, correlation, covariance_of

_STIFF = np.geomspace(0.4, 2.5, 13)  # grid of the start, of the nominal
_SHARES = (0.7, 1.0, 1.4)
# Reach of a log, of its sampling rate. A held demand is known between its samples; the torque of a motor is not: linear
# in between, it is right to 3 % at a tenth of the rate, and to 40 % at four tenths.
_HELD = 0.5
_SAMPLED = 0.1
_DELAYS = 2  # samples
_GAPS = np.geomspace(5, 2000, 48)  # grid of the start, in standard deviations of the counts
_HIDDEN = (0.7, 0.85, 1.0, 1.2)  # stiffness of that start, of the nominal
_CALM = 0.03  # torque noise of that start, of the torque's deviation
_GAIN = 25.0  # fall of n log(sum of squares) from which a gap counts
_DIFFERENCE = 3e-4  # of the variables, for the slopes
_COARSE = 3e-3  # the same with a gap, where contacts come and go
_FEW = 6  # iterations of the start
_UNSEEN = 0.5  # half interval from which a mode or a gap is not seen, of its value
_REACH = 1.2  # change of the logarithms of the mode's parameters in one fit

_RIGID = ("inertia", "viscous", "coulomb", "excess", "offset", "delay")
_BOUNDED = ("viscous", "coulomb", "excess", "gap")  # at least zero
_POSITIVE = ("inertia", "stiffness", "damping")  # fitted by their logarithms


def fit_axis(
    nominal: AxisModel,
    position: Floats,
    torque: Floats,
    period: float,
    *,
    axis: str,
    unit: str,
    resolution: float,
    held: bool,
    progress: Callable[[], None] = lambda: None,
) -> AxisFit:
    """Fit the model of an axis by prediction error.

    Args:
        nominal: the model of the MJCF: start of the mode, and the friction's parameters at rest.
        position: (n,) [u].
        torque: (n,) [N·m].
        period: of the samples [s].
        axis: its name.
        unit: its unit.
        resolution: of the encoder [u].
        held: whether the torque is a demand, held from sample to sample.
        progress: called now and then.

    Raises:
        InputError: a log without motion, or one whose inertia is not positive or far from the machine's.
    """
    start = regression(position, torque, period)
    if not start[0] > 0:
        raise InputError(
            f"axis {axis}: inertia = {start[0]:.3g} N·m·s²/{unit} by the log: must be greater than 0; check "
            "the columns of torque and position and their signs"
        )
    check_inertia(axis, start[0], nominal)
    size = max(resolution / math.sqrt(12), 1e-3 * float(np.std(np.diff(position))), 1e-12)
    used = in_motion(position, period, resolution)
    first, last = np.flatnonzero(used)[[0, -1]]
    around = slice(max(first - LAGS, 0), last + 1)
    position = position[around]
    torque = torque[around]
    used = used[around]
    scale = start[0] / nominal.inertia
    friction = max(start[2], 1e-3 * float(np.std(torque)))
    model = replace(
        nominal,
        inertia=start[0],
        viscous=max(start[1], 0.0),
        coulomb=friction,
        excess=friction * (nominal.excess / nominal.coulomb if nominal.coulomb > 0 else 0.0),
        offset=start[3],
        stiffness=nominal.stiffness * scale,
        damping=nominal.damping * scale,
    )

    def residual(candidate: AxisModel, noise: float) -> Floats:
        progress()
        found = innovations(candidate, noise / size, period, position, torque, held)[used] / size
        return np.clip(np.nan_to_num(found, nan=1e9), -1e9, 1e9)

    noise = 0.02 * float(np.std(torque))

    def cost(one: AxisModel) -> float:
        return float(np.sum(residual(one, noise) ** 2))

    mode = list(MODE) if model.resonance < _HELD / period else []  # beyond, samples do not show it
    model = min((replace(model, delay=k * 0.5 * period) for k in range(2 * _DELAYS + 1)), key=cost)
    best = _refined(model, noise, list(_RIGID), residual, period, size, _FEW)
    model = best.model
    noise = best.noise
    if mode:
        grid = [
            replace(model, share=share * model.share, stiffness=factor * model.stiffness, damping=model.damping)
            for share in _SHARES
            for factor in _STIFF
            if share * model.share < 1
        ]
        best = _refined(min(grid, key=cost), noise, [*_RIGID, *mode], residual, period, size)
    else:
        best = _refined(model, noise, list(_RIGID), residual, period, size)
    if mode and any(best.relative(name) > _UNSEEN for name in ("share", "stiffness")):
        mode = []  # the log does not show it: that of the MJCF stays
        model = replace(best.model, **{name: getattr(nominal, name) for name in MODE})
        model = replace(model, stiffness=nominal.stiffness * scale, damping=nominal.damping * scale)
        best = _refined(model, best.noise, list(_RIGID), residual, period, size)
    if nominal.share and _coloured(best, residual) > WHITE:
        # a gap hides the mode: start from that of the MJCF too
        hidden = replace(model, share=nominal.share)
        modes = [best.model, *(replace(hidden, stiffness=factor * hidden.stiffness) for factor in _HIDDEN)]
        tried = [replace(one, gap=gap * size) for one in modes for gap in _GAPS]
        quiet = _CALM * float(np.std(torque))
        gapped = min(tried, key=lambda one: float(np.sum(residual(one, quiet) ** 2)))
        if float(np.sum(residual(gapped, quiet) ** 2)) < best.cost:  # else another structure is missing
            other = _refined(gapped, quiet, [*_RIGID, *MODE, "gap"], residual, period, size, 2 * _FEW, _COARSE)
            if used.sum() * math.log(best.cost / other.cost) > _GAIN and other.relative("gap") < _UNSEEN:
                best = other
    return AxisFit(
        axis,
        unit,
        nominal,
        best.model,
        best.estimates(),
        best.noise,
        size,
        used,
        innovations(best.model, best.noise / size, period, position, torque, held),
        start[:3],
        (_HELD if held else _SAMPLED) / period,
        position,
        torque,
        held,
        best.sensitivity,
    )


@dataclass(frozen=True, eq=False)
class _Best:
    """A minimum: the model, its torque noise, the covariance of its parameters, and the sum of squares."""

    model: AxisModel
    noise: float
    names: list[str]
    covariance: Floats
    cost: float
    sensitivity: Sensitivity

    def estimates(self) -> dict[str, Estimate]:
        both = [self.names.index(name) for name in ("coulomb", "excess")]
        # what no sample depends on has no variance, but an interval without ends
        variance = {
            name: float(self.covariance[k, k]) if self.covariance[k, k] > 0 else math.inf
            for k, name in enumerate(self.names)
        }
        variance["static"] = max(float(self.covariance[np.ix_(both, both)].sum()), 0.0)
        found = {}
        for name, own in variance.items():
            value = float(getattr(self.model, name))
            found[name] = Estimate(value, math.hypot(math.sqrt(own), SYSTEMATIC.get(name, 0.0) * value))
        return {name: found[name] for name in PARAMETERS if name in found}

    def relative(self, name: str) -> float:
        """Return half the interval of a parameter, of its value."""
        one = self.estimates()[name]
        return CONFIDENCE * one.deviation / max(abs(one.value), 1e-300)


def _coloured(best: _Best, residual: Callable[[AxisModel, float], Floats]) -> float:
    """Return the largest correlation of the residual of a minimum."""
    return float(np.abs(correlation(residual(best.model, best.noise))).max())


def _refined(
    model: AxisModel,
    noise: float,
    names: list[str],
    residual: Callable[[AxisModel, float], Floats],
    period: float,
    size: float,
    evaluations: int = 30,
    difference: float = _DIFFERENCE,
) -> _Best:
    """Return the minimum near a model."""
    units = np.array([_step(model, name, period, size) for name in names])

    def unpacked(at: Floats) -> tuple[AxisModel, float]:
        values = {}
        at = at - 1.0
        for name, unit, x in zip(names, units, at, strict=False):
            own = getattr(model, name)
            if name in _POSITIVE:
                values[name] = own * math.exp(x)
            elif name == "share":
                values[name] = 1 / (1 + (1 / own - 1) * math.exp(-x))
            else:
                values[name] = max(own + unit * x, 0.0) if name in _BOUNDED else own + unit * x
        return replace(model, **values), noise * math.exp(at[-1])

    # the variables begin at 1: steps of the differences are relative to them
    low = np.full(len(names) + 1, -np.inf)
    high = np.full(len(names) + 1, np.inf)
    for k, name in enumerate(names):
        if name in _BOUNDED:
            low[k] = -getattr(model, name) / units[k] - 1e-9
        elif name in MODE:
            low[k], high[k] = -_REACH, _REACH
    low[-1], high[-1] = -12.0, 12.0
    begin = np.ones(len(names) + 1)
    if "gap" in names:  # contacts come and go: a search along lines finds the valley, slopes its floor
        along = minimize(
            lambda at: float(np.sum(residual(*unpacked(at)) ** 2)), begin, method="Powell",
            bounds=list(zip(1 + np.maximum(low, -5), 1 + np.minimum(high, 5), strict=True)),
            options={"maxfev": 1200, "xtol": 1e-3, "ftol": 1e-4},
        )  # fmt: skip
        begin = np.clip(along.x, 1 + low + 1e-9, 1 + high - 1e-9)
    done = least_squares(
        lambda at: residual(*unpacked(at)), begin, bounds=(1 + low, 1 + high), x_scale=0.05,
        diff_step=difference, xtol=1e-5, ftol=1e-8, max_nfev=evaluations,
    )  # fmt: skip
    best, found = unpacked(done.x)
    slopes = np.array([_slope(best, name, unit) for name, unit in zip(names, units, strict=True)])
    covariance = covariance_of(done.jac, done.fun)[: len(names), : len(names)] * np.outer(slopes, slopes)
    sensitivity = Sensitivity(tuple(names), np.asarray(done.jac), slopes, np.asarray(done.fun))
    return _Best(best, found, names, covariance, float(2 * done.cost), sensitivity)


def _step(model: AxisModel, name: str, period: float, size: float) -> float:
    """Return the unit in which a parameter varies."""
    if name in ("coulomb", "excess", "offset"):
        return model.coulomb
    if name == "viscous":
        return max(model.viscous, model.coulomb / 100.0)
    return {"delay": period, "gap": 10 * size}.get(name, 1.0)


def _slope(model: AxisModel, name: str, unit: float) -> float:
    """Return the change of a parameter per change of the variable that is fitted."""
    if name in _POSITIVE:
        return float(getattr(model, name))
    return model.share * (1 - model.share) if name == "share" else unit
