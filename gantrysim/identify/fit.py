"""Fits the model of an axis to a log of its torque and position, by prediction error.

The fit starts from a linear regression of the torque. The parameters that a log shows best come first: inertia,
friction and delay of a rigid axis; then the mode, from a grid around that of the MJCF, as the cost has several valleys;
last a backlash, where the residual is not white.
"""

# ruff: noqa: N806 - matrices bear the letters of the equations

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.identify.friction_law import FrictionLaw, friction_law
from gantrysim.identify.minimum import Minimum, PredictionError, refined_minimum
from gantrysim.identify.model import AxisModel
from gantrysim.identify.pieces import WHOLE_LOG, Starts, bounds, by_piece, gradient, inside, smoothed
from gantrysim.identify.prediction import Course, first_speed
from gantrysim.identify.result import MODE, PARAMETERS, WHITE, AxisFit, Estimate
from gantrysim.identify.torque_regression import TorqueRegression
from gantrysim.identify.whiteness import LAGS

_WIDTH = 0.004  # standard deviation of the filter for differentiation [s]
_MOVING_SPEED = 0.02  # share of the highest speed from which an axis slides
_TIME_AROUND_MOTION = 0.02  # time around a motion that counts as its own [s]
_SLIDING_SHARE = 0.9  # share of the samples around one that must be in motion
_LEAST_SAMPLES = 500
_START_STIFFNESSES = np.geomspace(0.4, 2.5, 13)  # grid of the start, of the nominal
_GRID_SHARES = (0.7, 1.0, 1.4)
# Reach of a log, of its sampling rate. A held demand is known between its samples; the torque of a motor is not: linear
# in between, it is right to 3 % at a tenth of the rate, and to 40 % at four tenths.
_HELD_REACH = 0.5
_SAMPLED_REACH = 0.1
_DELAYS = 2  # samples
_GAPS = np.geomspace(5, 2000, 48)  # grid of the start, in standard deviations of the counts
_HIDDEN_STIFFNESSES = (0.7, 0.85, 1.0, 1.2)  # stiffness of that start, of the nominal
_START_NOISE = 0.03  # torque noise of that start, of the torque's deviation
_NOISE = 0.02  # torque noise of the first start, of the torque's deviation
_GAIN = 25.0  # fall of n log(sum of squares) from which a gap counts
_COARSE_STEP = 3e-3  # difference of the variables with a gap: contact makes the cost non-smooth
_DEFLECTIONS = (0.03, 0.1, 0.3, 1.0, 3.0)  # of the bristles, of the table's: from no presliding to much
_LOWEST_FREQUENCY = 15.0  # frequency of a mode that the table does not have [Hz]
_HIGHEST_SHARE = 0.9  # the highest, of the log's reach
_FREQUENCIES = 16
_ANY_SHARE = (0.1, 0.3, 0.6, 0.85)
_DAMPING_RATIO = 0.03
_FIRST_EVALUATIONS = 6  # evaluations of a first fit
_UNSEEN_INTERVAL = 0.5  # half interval from which a mode or a gap is not seen, of its value

_RIGID_PARAMETERS = ("inertia", "viscous", "coulomb", "excess", "offset", "delay")


def regression(
    position: Floats, torque: Floats, period: float, starts: Starts = WHOLE_LOG
) -> tuple[float, float, float, float]:
    """Return J, b, Fc and offset of torque = J a + b v + Fc sign v + offset, by least squares [N·m and u].

    Position, sign and torque pass the same zero-phase filter, a Gaussian; v and a are central differences. Samples near
    rest are left out.

    Args:
        position: (n,) [u].
        torque: (n,) [N·m].
        period: of the samples [s].
        starts: of the pieces.

    Raises:
        InputError: a log without motion.
    """
    width = _WIDTH / period
    if position.size < max(8 * width, _LEAST_SAMPLES):
        raise InputError(f"log of {position.size} samples: must have at least {max(8 * width, _LEAST_SAMPLES):.0f}")
    # the same zero-phase filter for all three, so that none is late against the others
    sign = smoothed(np.sign(gradient(position, 1.0, starts)), width, starts)
    smooth = smoothed(torque, width, starts)
    speed = gradient(smoothed(position, width, starts), period, starts)
    acceleration = gradient(speed, period, starts)
    least = _MOVING_SPEED * float(np.quantile(np.abs(speed), 0.99))
    slides = np.abs(speed) > least
    chosen = smoothed(slides.astype(np.float64), width, starts) > _SLIDING_SHARE
    # the filter reaches beyond the log
    chosen &= inside(position.size, starts, round(4 * width))
    if not least > 0 or chosen.sum() < 8 * width:
        raise InputError("the axis hardly moves: the log must hold moves to and fro at several speeds")
    A = np.stack([acceleration, speed, sign, np.ones_like(speed)], axis=1)[chosen]
    inertia, viscous, coulomb, offset = np.linalg.lstsq(A, smooth[chosen], rcond=None)[0].tolist()
    return inertia, viscous, coulomb, offset


def in_motion(position: Floats, period: float, resolution: float, starts: Starts = WHOLE_LOG) -> NDArray[np.bool_]:
    """Return whether each sample is near a motion of more than a count per few samples, (n,) bool."""
    reach = max(round(_TIME_AROUND_MOTION / period), 1)

    def farthest(piece: Floats) -> Floats:
        after = np.concatenate([piece[reach:], np.full(min(reach, piece.size), piece[-1])])
        before = np.concatenate([np.full(min(reach, piece.size), piece[0]), piece[:-reach]])
        return np.maximum(np.abs(after - piece), np.abs(piece - before))

    return np.asarray(by_piece(farthest, position, starts) > max(4 * resolution, 1e-12))


@dataclass(frozen=True, eq=False)
class AxisLog:
    """The log of one axis; u is mm or deg.

    Attributes:
        axis: its name.
        unit: u.
        resolution: of the encoder [u].
        period: of the samples [s].
        position: (n,) [u].
        torque: (n,) [N·m].
        held: whether the torque is a demand, held from sample to sample.
        starts: of the pieces.
    """

    axis: str
    unit: str
    resolution: float
    period: float
    position: Floats
    torque: Floats
    held: bool
    starts: Starts = WHOLE_LOG


def fit_axis(nominal: AxisModel, log: AxisLog, progress: Callable[[], None] = lambda: None) -> AxisFit:
    """Fit the model of an axis by prediction error.

    Args:
        nominal: the model of the MJCF: start of the mode, and the friction's parameters at rest.
        log: of the axis.
        progress: called now and then.

    Raises:
        InputError: a log without motion, or one whose inertia is not positive or far from the machine's.
    """
    inertia, viscous, coulomb, _ = regression(log.position, log.torque, log.period, log.starts)
    if not inertia > 0:
        raise InputError(
            f"axis {log.axis}: inertia = {inertia:.3g} N·m·s²/{log.unit} by the log: must be greater than 0; check "
            "the columns of torque and position and their signs"
        )
    error = _error(log, progress)
    sliding = TorqueRegression.of(nominal, log.period, error.position, error.torque, log.held, error.starts)
    law = friction_law(sliding, error.used, nominal.scale * nominal.stribeck, log.unit)
    error = replace(error, course=Course(law.level, law.ripple))
    scale = inertia / nominal.inertia
    friction = max(law.estimates["coulomb"].value, 1e-3 * float(np.std(error.torque)))
    start = replace(
        nominal,
        inertia=inertia,
        viscous=max(law.estimates["viscous"].value, 0.0),
        coulomb=friction,
        excess=friction * (nominal.excess / nominal.coulomb if nominal.coulomb > 0 else 0.0),
        offset=law.estimates["offset"].value,
        difference=0.0,
        stiffness=nominal.stiffness * scale,
        damping=nominal.damping * scale,
    )
    best, without_mode = _fitted_model(error, start)
    if error.correlation(best) > WHITE:
        best = _with_another_mode(error, best, without_mode, (_HELD_REACH if log.held else _SAMPLED_REACH) / log.period)
    if nominal.share and error.correlation(best) > WHITE:
        best = _with_gap(error, best, replace(without_mode, deflection=nominal.deflection))
    prediction = error.prediction(best.model, best.noise)
    revised = _revised_law(nominal, log, error, best, prediction.directions)
    if _kinds(revised) != _kinds(law):
        error = replace(error, course=Course(revised.level, revised.ripple))
        best = refined_minimum(error, best.model, best.noise, best.names)
        prediction = error.prediction(best.model, best.noise)
    law = revised
    model, estimates = _with_law(best, law)
    return AxisFit(
        axis=log.axis,
        unit=log.unit,
        nominal=nominal,
        model=model,
        estimates=estimates,
        noise=best.noise,
        expected=error.size,
        used=error.used,
        innovations=prediction.innovations,
        directions=prediction.directions,
        start=(inertia, viscous, coulomb),
        highest=(_HELD_REACH if log.held else _SAMPLED_REACH) / log.period,
        position=error.position,
        torque=error.torque,
        held=log.held,
        starts=error.starts,
        first=error.first,
        sensitivity=best.sensitivity,
        predicted=best.model,
        law=law,
    )


def _revised_law(
    nominal: AxisModel, log: AxisLog, error: PredictionError, best: Minimum, directions: Floats
) -> FrictionLaw:
    """Return the friction of a log with the delay of a fit and the directions that it predicts.

    A loop that swings turns the axis between two samples. Positions alone do not show when; taken for steps of one
    direction they bent Coulomb friction of one in eight simulated axes by 4 to 20 %, without noise.
    """
    late = replace(nominal, delay=best.model.delay)
    sliding = TorqueRegression.of(late, log.period, error.position, error.torque, log.held, error.starts)
    sliding = sliding.with_directions(directions)
    return friction_law(sliding, error.used, nominal.scale * nominal.stribeck, log.unit)


def _kinds(law: FrictionLaw) -> set[str]:
    return {term.kind for term in law.terms}


def _with_law(best: Minimum, law: FrictionLaw) -> tuple[AxisModel, dict[str, Estimate]]:
    """Return model and estimates of a fit with the friction by the torque of the sliding axis.

    The prediction of the next sample hardly sees a slow error of the torque, the regression does; static friction,
    which holds an axis at rest, is the prediction's.
    """
    estimates = {**best.estimates(), **law.estimates}
    coulomb = max(estimates["coulomb"].value, 0.0)
    excess = max(best.model.static - coulomb, 0.0)
    estimates["excess"] = replace(estimates["excess"], value=excess)
    difference = 0.0
    if "viscous_forward" in estimates:
        difference = 0.5 * (estimates["viscous_forward"].value - estimates["viscous_back"].value)
    model = replace(
        best.model,
        viscous=max(estimates["viscous"].value, 0.0),
        coulomb=coulomb,
        excess=excess,
        offset=estimates["offset"].value,
        difference=difference,
    )
    return model, {name: estimates[name] for name in PARAMETERS if name in estimates}


def _error(log: AxisLog, progress: Callable[[], None]) -> PredictionError:
    """Return the prediction error over the moves of a log, from some samples before the first to the last."""
    # counts are uniformly distributed, of variance resolution² / 12; a log may be rounded further
    size = max(log.resolution / math.sqrt(12), 1e-3 * float(np.std(np.diff(log.position))), 1e-12)
    used = in_motion(log.position, log.period, log.resolution, log.starts)
    first, last = np.flatnonzero(used)[[0, -1]]
    begin = max(int(first) - LAGS, 0)
    moves = slice(begin, int(last) + 1)
    starts = (0, *(start - begin for start in log.starts if begin < start <= last))
    used = used[moves]
    position = log.position[moves]
    speeds = []
    for piece in bounds(position.size, starts):
        in_motion_at_once = bool(used[piece.start])
        speeds.append(first_speed(position[piece], log.period) if in_motion_at_once else 0.0)
        # the predictor takes some samples to find the state of a piece that begins in motion
        used[piece.start : piece.start + LAGS] = False
    return PredictionError(
        period=log.period,
        position=position,
        torque=log.torque[moves],
        held=log.held,
        used=used,
        size=size,
        progress=progress,
        starts=starts,
        speeds=tuple(speeds),
        first=begin,
    )


def _fitted_model(error: PredictionError, start: AxisModel) -> tuple[Minimum, AxisModel]:
    """Return the fit, with the mode where the log shows it, and a model near it with the mode of the MJCF."""
    noise = _NOISE * float(np.std(error.torque))
    delayed = [replace(start, delay=k * 0.5 * error.period) for k in range(2 * _DELAYS + 1)]
    nearest = min(delayed, key=lambda model: error.cost(model, noise))
    bristles = [replace(nearest, deflection=factor * nearest.deflection) for factor in _DEFLECTIONS]
    nearest = min(bristles, key=lambda model: error.cost(model, noise))
    rigid = refined_minimum(error, nearest, noise, list(_RIGID_PARAMETERS), _FIRST_EVALUATIONS)
    # beyond half the rate, samples do not show the table's mode
    if not start.resonance < _HELD_REACH / error.period:
        fits = [refined_minimum(error, rigid.model, rigid.noise, list(_RIGID_PARAMETERS))]
        # nothing says that the table's mode is right either
        if start.share:
            fits.append(refined_minimum(error, replace(rigid.model, share=0.0), rigid.noise, list(_RIGID_PARAMETERS)))
        best = min(fits, key=lambda fit: fit.cost)
        return best, best.model
    grid = [
        replace(rigid.model, share=share * start.share, stiffness=factor * start.stiffness)
        for share in _GRID_SHARES
        for factor in _START_STIFFNESSES
        if share * start.share < 1
    ]
    nearest = min(grid, key=lambda model: error.cost(model, rigid.noise))
    swinging = refined_minimum(error, nearest, rigid.noise, [*_RIGID_PARAMETERS, *MODE])
    if any(swinging.relative(name) > _UNSEEN_INTERVAL for name in ("share", "stiffness")):
        # the log does not show the mode: that of the MJCF stays
        model = replace(swinging.model, share=start.share, stiffness=start.stiffness, damping=start.damping)
        return refined_minimum(error, model, swinging.noise, list(_RIGID_PARAMETERS)), model
    return swinging, rigid.model


def _with_another_mode(error: PredictionError, best: Minimum, without_mode: AxisModel, highest: float) -> Minimum:
    """Return the fit with a mode anywhere in the log's reach where that makes the residual white, else the best one.

    The machine may have a mode that its table has elsewhere, beyond the log's rate, or not at all.

    Args:
        error: of the log.
        best: the fit with the mode of the table, or near it.
        without_mode: a model with the mode of the table.
        highest: frequency up to which the log shows a mode [Hz].
    """
    grid = []
    for frequency in np.geomspace(_LOWEST_FREQUENCY, _HIGHEST_SHARE * highest, _FREQUENCIES):
        for share in _ANY_SHARE:
            reduced = without_mode.inertia * share * (1 - share)
            stiffness = reduced * (2 * math.pi * float(frequency)) ** 2
            damping = 2 * _DAMPING_RATIO * math.sqrt(stiffness * reduced)
            grid.append(replace(without_mode, share=share, stiffness=stiffness, damping=damping))
    # the fitted one has taken the missing mode for noise
    noise = _START_NOISE * float(np.std(error.torque))
    nearest = min(grid, key=lambda model: error.cost(model, noise))
    other = refined_minimum(error, nearest, noise, [*_RIGID_PARAMETERS, *MODE])
    seen = all(other.relative(name) < _UNSEEN_INTERVAL for name in ("share", "stiffness"))
    if not seen or not other.model.resonance < highest or error.correlation(other) > WHITE:
        return best
    # samples fold a mode beyond half their rate to below: the mode of the table must not explain the log as well
    cost = min(best.cost, _cost_near_table(error, without_mode, noise))
    return other if error.used.sum() * math.log(cost / other.cost) > _GAIN else best


def _cost_near_table(error: PredictionError, model: AxisModel, noise: float) -> float:
    """Return the cost of a fit with a mode near that of the table, even beyond the log's rate; inf without a mode."""
    if not model.share:
        return math.inf
    grid = [replace(model, stiffness=factor * model.stiffness) for factor in _START_STIFFNESSES]
    nearest = min(grid, key=lambda near: error.cost(near, noise))
    return refined_minimum(error, nearest, noise, [*_RIGID_PARAMETERS, *MODE]).cost


def _with_gap(error: PredictionError, best: Minimum, without_mode: AxisModel) -> Minimum:
    """Return the fit with a backlash where it explains the log much better, else the best one without.

    Args:
        error: of the log.
        best: the fit without a backlash.
        without_mode: a model with mode and bristles of the MJCF: a backlash hides the mode and looks like presliding,
            and the fit has bent both.
    """
    noise = _START_NOISE * float(np.std(error.torque))
    starts = [start for filled in (False, True) for start in _starts(error, best.model, without_mode, noise, filled)]
    likely = [start for start in dict.fromkeys(starts) if error.cost(start, noise) < best.cost]
    # another structure is missing
    if not likely:
        return best
    fits = [
        refined_minimum(error, start, noise, [*_RIGID_PARAMETERS, *MODE, "gap"], 2 * _FIRST_EVALUATIONS, _COARSE_STEP)
        for start in likely
    ]
    gapped = min(fits, key=lambda fit: fit.cost)
    gain = error.used.sum() * math.log(best.cost / gapped.cost)
    return gapped if gain > _GAIN and gapped.relative("gap") < _UNSEEN_INTERVAL else best


def _starts(
    error: PredictionError, fitted: AxisModel, without_mode: AxisModel, noise: float, filled: bool
) -> tuple[AxisModel, AxisModel]:
    """Return starts of a fit with a backlash, with the fitted presliding and with what is best beside a gap.

    Arguments are as of `_with_gap`, and whether grease fills the gap.
    """
    stiff = [replace(without_mode, stiffness=factor * without_mode.stiffness) for factor in _HIDDEN_STIFFNESSES]
    models = [replace(model, deflection=fitted.deflection, filled=filled) for model in (fitted, *stiff)]
    grid = [replace(model, gap=gap * error.size) for model in models for gap in _GAPS]
    nearest = min(grid, key=lambda model: error.cost(model, noise))
    bristles = [replace(nearest, deflection=factor * without_mode.deflection) for factor in _DEFLECTIONS]
    return nearest, min(bristles, key=lambda model: error.cost(model, noise))
