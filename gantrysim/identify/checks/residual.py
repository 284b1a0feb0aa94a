"""Check: the residual must be of the size of encoder counts and torque noise, and white.

What the fitted model does not predict of the next position is noise where its structure is that of the axis. A residual
many times the encoder's counts, a torque noise that is a large share of the torque, or a residual that its own past
predicts, is motion which this torque has not made: another axis, another clock, a frozen encoder, a missing mode.

Inertia and friction stand on the torque of the sliding axis too, which a wrong mode, a backlash or coarse counts do not
touch. Where that torque is balanced, a large or correlated residual forbids only the values that rest on predictions.

What encoder counts and noise of the torque explain is found from the log: where the encoder stands still the torque of
a servo is smooth, so that its scatter there is noise of the log. With that noise and the counts, the predictor's own
variance is that of its errors where the model is right.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import welch

from gantrysim.base.arrays import Floats, spans
from gantrysim.base.quantity import text_beside
from gantrysim.identify.checks.finding import Doubt, Finding, NotIdentifiedError
from gantrysim.identify.pieces import longest_piece
from gantrysim.identify.prediction import error_variance
from gantrysim.identify.result import MODE, WHITE, AxisFit
from gantrysim.identify.sizes import share_words, times_words
from gantrysim.identify.whiteness import LAGS, correlation

# Check: no prediction of the position may be wrong at once by many times its usual error.
#
# An encoder that loses counts moves the position between two samples, and nothing of the torque. Errors of a healthy
# fit, other friction included, stay below 6 standard deviations (10 where the torque is clipped); counts lost in
# motion, 50 at a time, stand out by 24 to 150.

COUNTS = "encoder counts"
LARGEST_JUMP = 12.0  # error of a prediction, in standard deviations of the errors in motion
_COUNTS = 10.0  # the same, in counts of the encoder
_MEDIAN = 0.6745  # of a normal distribution's magnitude, in standard deviations
_LOSS_INTERVAL = 0.02  # time between two losses: the predictor needs some samples to follow the first [s]


def check_counts(fit: AxisFit, period: float) -> Doubt:
    """Return where the position jumps by more than its prediction is ever wrong."""
    error = np.abs(fit.innovations)
    for start in fit.starts:
        # the predictor finds the state of a piece that begins in motion
        error[start : start + LAGS] = 0.0
    usual = float(np.median(error[fit.used])) / _MEDIAN
    count = math.sqrt(12) * fit.expected
    bound = max(LARGEST_JUMP * usual, _COUNTS * count)
    jumps = np.flatnonzero(error > bound)
    if not jumps.size:
        return Doubt({}, [])
    losses = 1 + int((np.diff(jumps) > _LOSS_INTERVAL / period).sum())
    largest = int(np.argmax(error))
    times = "once" if losses == 1 else f"{losses} times"
    reason = (
        f"the position leaves its prediction at once by up to {error[largest]:.2g} {fit.unit}, "
        f"{error[largest] / count:.0f} counts, {times}, first {jumps[0] * period:.4g} s into the moves: must be at "
        f"most {bound:.2g} {fit.unit}; the encoder loses counts, or rows are missing"
    )
    return Doubt({}, [Finding(COUNTS, (), reason)])


# Likely cause of a doubtful fit: a torque that the recorder has clipped.
#
# A drive at its limit gives a flat torque too, and the fit of its motion is good. So this is said only of a fit that
# another check doubts.

CLIPPED_TORQUE = "clipped torque"
MOST_AT_PEAK = 0.01  # share of the samples at the largest torque; a torque that is not clipped is there once or twice
_EQUAL_TORQUES = 1e-6  # difference of equal torques, of the largest: logs are rounded


def check_clipping(fit: AxisFit) -> Doubt:
    """Return whether the torque stays at its largest value."""
    size = np.abs(fit.torque)
    largest = float(size.max())
    share = float(np.mean(size >= largest * (1 - _EQUAL_TORQUES)))
    if share <= MOST_AT_PEAK:
        return Doubt({}, [])
    reason = (
        f"the torque is at its largest, ± {largest:.3g} N·m, in {100 * share:.0f} % of the samples: must be in at most "
        f"{100 * MOST_AT_PEAK:.0f} %; it is clipped: widen the range of the recorder, or excite less"
    )
    return Doubt({}, [Finding(CLIPPED_TORQUE, (), reason)])


# Likely cause of a doubtful fit: a position that has passed a filter.
#
# Between a quarter and almost half of the sampling rate an axis moves at least as its whole mass would by the torque,
# more where the motor moves alone, and counts of the encoder come on top. A mean over nine samples leaves 20 to 57 % of
# that, a low-pass of 5 ms 25 to 84 %. Noise that the log's torque has and the motor's has not lowers it too, so that
# this is said only of a fit that another check doubts.

SMOOTHED = "smooth position"
# of the acceleration that the torque gives the whole mass; doubtful fits of unfiltered logs have 0.79
LEAST_ACCELERATION = 0.6
_BAND = (0.25, 0.45)  # of the sampling rate
_SEGMENT = 256  # samples of a spectrum's segment


def check_smoothing(fit: AxisFit, period: float) -> Doubt:
    """Return whether the position lacks the fast motion that the torque makes."""
    # within the longest piece, as a spectrum knows no gaps
    piece = longest_piece(fit.position.size, fit.starts)
    acceleration = np.diff(fit.position[piece], 2) / period**2
    segment = min(_SEGMENT, acceleration.size)
    frequency, power = welch(acceleration, 1 / period, nperseg=segment)
    torque_power = welch(fit.torque[piece], 1 / period, nperseg=segment)[1]
    band = (frequency > _BAND[0] / period) & (frequency < _BAND[1] / period)
    expected = float(torque_power[band].sum()) / fit.start[0] ** 2
    if not expected > 0:
        return Doubt({}, [])
    ratio = math.sqrt(float(power[band].sum()) / expected)
    if ratio >= LEAST_ACCELERATION:
        return Doubt({}, [])
    reason = (
        f"from {_BAND[0] / period:.0f} to {_BAND[1] / period:.0f} Hz the position has {100 * ratio:.0f} % of the "
        f"motion that the torque gives the whole mass: must have at least {100 * LEAST_ACCELERATION:.0f} %; it is "
        "filtered or interpolated: log the counts of the encoder"
    )
    return Doubt({}, [Finding(SMOOTHED, (), reason)])


RESIDUAL = "residual"
# of the residual, times the encoder's counts; ten times the counts' noise is coarse but harmless
LARGEST_RESIDUAL = 15.0
UNUSABLE_RESIDUAL = 100.0  # the same, from which the log is refused
NOISE = 0.15  # largest fitted torque noise, of the torque's own deviation
# size of the residual from which predictions are doubtful, of that which counts and noise explain
EXPLAINED_RESIDUAL = 2.0
# largest rms of the low-passed torque that the friction's law and the acceleration leave, of the torque
BALANCED_TORQUE = 0.03
PREDICTED = ("static", "delay", *MODE, "gap")  # values that rest on predictions alone


def check_residual(fit: AxisFit, period: float) -> Doubt:
    """Return whether the residual looks like noise, by size and correlation.

    Args:
        fit: of an axis.
        period: of the log [s].

    Raises:
        NotIdentifiedError: the log's torque has not made the log's motion.
    """
    findings = []
    count = np.sqrt(12) * fit.expected
    times = float(np.std(fit.residual)) / fit.expected
    size = times / np.sqrt(12)
    if times > UNUSABLE_RESIDUAL:
        raise NotIdentifiedError(
            f"axis {fit.axis}: the prediction of the position is wrong by {times_words(times, 2)} the encoder's "
            f"counts, must be at most {UNUSABLE_RESIDUAL:.0f}: the torque did not cause this motion; check for a "
            "frozen or skipping encoder, columns of two axes, and a log of fewer samples than the servo's"
        )
    if times > LARGEST_RESIDUAL:
        reason = f"the residual is {times_words(times, 2)} the encoder's counts: must be at most {LARGEST_RESIDUAL:.0f}"
        findings.append(Finding(RESIDUAL, (), reason))
    balanced = fit.law.remainder < BALANCED_TORQUE * fit.law.size
    share = fit.noise / float(np.std(fit.torque))
    if share > NOISE:
        reason = (
            f"torque noise of {share_words(share)} the torque would explain it: must be at most {100 * NOISE:.0f} %"
        )
        findings.append(Finding(RESIDUAL, PREDICTED if balanced else (), reason))
    explained = explained_residual(fit, period) / count
    if size > EXPLAINED_RESIDUAL * explained:
        reason = (
            f"the residual is {size:.2g} counts rms, counts and the torque's noise at rest explain {explained:.2g}: "
            f"must be at most {EXPLAINED_RESIDUAL:g} times as much"
        )
        findings.append(Finding(RESIDUAL, PREDICTED, reason))
    colour = float(np.abs(correlation(fit.residual)).max())
    if colour > WHITE:
        reason = f"the residual is correlated by {text_beside(colour, WHITE, 2)}: must be at most {WHITE}"
        findings.append(Finding(RESIDUAL, PREDICTED if balanced else (), reason))
    return Doubt({}, findings)


# What counts and torque noise explain of the residual.

_SHORTEST_REST = 5  # shortest standstill that counts [samples]
_SETTLING_SAMPLES = 1  # first samples of it, whose torque may answer to the last count
_FEWEST_AT_REST = 40  # second differences at rest
_SECOND_DIFFERENCE = math.sqrt(6)  # standard deviation of a second difference of white noise of 1


def explained_residual(fit: AxisFit, period: float) -> float:
    """Return the standard deviation of the residual that counts and torque noise explain, nan where none is known [u].

    Args:
        fit: of an axis.
        period: of the log [s].
    """
    noise = _noise_at_rest(fit.position, fit.torque)
    if math.isnan(noise):
        return math.nan
    steps = np.abs(np.diff(fit.position))
    # of the log, which may differ from the table's
    count = float(steps[steps > 1e-9].min(initial=math.inf))
    size = count / math.sqrt(12) if math.isfinite(count) else fit.expected
    return size * math.sqrt(error_variance(fit.predicted, noise / size, period))


def _noise_at_rest(position: Floats, torque: Floats) -> float:
    """Return the standard deviation of the torque's noise where the position stands still, nan without rest [N·m]."""
    still = np.concatenate([[False], np.diff(position) == 0])
    differences = []
    for first, after in spans(still):
        if after - first >= _SHORTEST_REST:
            differences.append(np.diff(torque[first + _SETTLING_SAMPLES : after], 2))
    scatter = np.concatenate(differences) if differences else np.zeros(0)
    if scatter.size < _FEWEST_AT_REST:
        return math.nan
    return float(np.sqrt(np.mean(scatter**2))) / _SECOND_DIFFERENCE
