"""Checks of the log: samples fast enough, an encoder that counts, enough motion, a torque in reach."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.identify.checks.finding import Doubt, Finding, NotIdentifiedError
from gantrysim.identify.checks.units import position_slips, torque_slips
from gantrysim.identify.model import AxisModel
from gantrysim.identify.pieces import WHOLE_LOG, Starts, by_piece
from gantrysim.identify.result import MODE, AxisFit
from gantrysim.identify.sizes import times_beside, times_words
from gantrysim.machine.axis import Axis

# Check of the log: its torque must be one that the drive can deliver.

# largest torque, of the drive's peak torque: room for noise and a motor constant of another temperature
LARGEST_TORQUE = 1.2


def check_torque(axis: Axis, torque: Floats, ratio: float) -> None:
    """Refuse a torque beyond the drive's peak.

    Args:
        axis: of the machine.
        torque: (n,) [N·m].
        ratio: of the log's inertia to that of the table; nan where it is not known.

    Raises:
        NotIdentifiedError: with the torque, the peak and the unit that the inertia suggests.
    """
    largest = float(np.abs(torque).max())
    if not (math.isfinite(axis.peak_torque) and axis.peak_torque > 0 and largest > LARGEST_TORQUE * axis.peak_torque):
        return
    excess = largest / axis.peak_torque
    slips = torque_slips(axis, ratio) if ratio > 0 else []
    hint = "check its unit, and that it is the torque at the motor shaft"
    if slips:
        hint = (
            f"the log's inertia is {times_words(ratio)} that of the table: torque in {' or '.join(slips)} read as N·m?"
        )
    raise NotIdentifiedError(
        f"axis {axis.name}: its largest torque is {largest:.4g} N·m, {times_beside(excess, LARGEST_TORQUE)} the "
        f"drive's peak of {axis.peak_torque:.4g} N·m: must be at most {LARGEST_TORQUE:g} times; {hint}"
    )


# Check of the log: the encoder must count throughout.
#
# A frozen encoder, a log that repeats its last sample, or a lost count is a motion that no torque makes: the position
# stands while the torque swings by more than friction can hold, or jumps by more than the torque can accelerate.

HOLDING_SWING = 6.0  # swing of the torque at rest, times the static friction: friction thrice the table's holds ± 3
FRICTIONLESS_TORQUE = 0.1  # the same of a machine without friction, of the peak torque
# change of the speed in a sample, times what the drive's peak torque gives the table's inertia: the motor
SPEED_JUMP = 8.0
# without its load, a lighter machine and a loop that swings between its limits reach five times
_COUNTS = 5.0  # of the encoder that a change of speed may show beside
_STANDSTILL_TIME = 0.005  # shortest standstill that counts [s]
_STANDSTILL_SAMPLES = 5  # samples of it
_SETTLING = 2  # first samples of it, whose torque answers to the last count
_MEAN = 3  # samples of the moving mean of the torque, against its noise
_BANDS = 9  # places of what friction holds that are tried


def check_encoder(
    axis: Axis, table: AxisModel, position: Floats, torque: Floats, period: float, starts: Starts = WHOLE_LOG
) -> None:
    """Refuse a position that stands still under torque, or jumps.

    Args:
        axis: of the machine.
        table: its model by the MJCF.
        position: (n,) [u].
        torque: (n,) [N·m].
        period: of the samples [s].
        starts: of the pieces.

    Raises:
        NotIdentifiedError: with the time and the bound.
    """
    bound = max(
        HOLDING_SWING * table.static, FRICTIONLESS_TORQUE * axis.peak_torque if np.isfinite(axis.peak_torque) else 0.0
    )
    calm = np.convolve(torque, np.ones(_MEAN) / _MEAN, "same")
    steps = np.abs(np.diff(position))
    changes = np.flatnonzero(steps) + 1
    # a log may be rounded further than the table's encoder
    count = max(axis.resolution, float(steps[steps > 0].min(initial=np.inf)) if changes.size else 0.0)
    edges = np.unique([0, *changes, *starts, position.size])
    fewest = max(_STANDSTILL_SAMPLES, round(_STANDSTILL_TIME / period))
    for start, end in pairwise(edges.tolist()):
        if end - start < fewest:
            continue
        held = calm[start + _SETTLING : end - 1]
        swing = float(np.ptp(held))
        if swing > bound and _moved_by(held, bound, table.inertia, period) > count:
            raise NotIdentifiedError(
                f"axis {axis.name}: its position stands still from {start * period:.4g} to {end * period:.4g} s of the "
                f"log while the torque swings by {swing:.3g} N·m, friction holds at most {bound:.3g} N·m: the encoder "
                "is frozen, or the log repeats samples"
            )
    turns = np.abs(by_piece(lambda piece: np.pad(np.diff(piece, 2), 1), position, starts))
    strongest = axis.peak_torque if np.isfinite(axis.peak_torque) else 2 * float(np.abs(torque).max())
    most = SPEED_JUMP * strongest / table.inertia * period**2 + _COUNTS * axis.resolution
    worst = int(np.argmax(turns))
    if turns[worst] > most:
        time = worst * period
        raise NotIdentifiedError(
            f"axis {axis.name}: its position jumps by {turns[worst]:.3g} {axis.unit} at {time:.4g} s of the log: "
            f"must be at most {most:.3g} {axis.unit}, {SPEED_JUMP:g} times what the drive's peak torque moves it in a "
            f"sample and {_COUNTS:g} counts; the encoder skips, or samples are missing"
        )


def _moved_by(torque: Floats, swing: float, inertia: float, period: float) -> float:
    """Return how far the torque beyond friction turns an inertia from rest at least [u].

    An axis that reverses is turned for a moment by more than friction holds, and moves within a count of its encoder.

    Args:
        torque: (n,) [N·m].
        swing: width of the band of torques that friction holds, wherever a constant torque puts it [N·m].
        inertia: of the axis [N·m/(u/s²)].
        period: of the samples [s].
    """
    low = np.linspace(torque.min(), torque.max() - swing, _BANDS)[:, None]
    excess = torque - np.clip(torque, low, low + swing)
    velocity = period * np.cumsum(excess, axis=1) / inertia
    return float(np.abs(period * np.cumsum(velocity, axis=1)).max(axis=1).min())


# Check of the log: encoder and torque must move enough to separate inertia, friction and delay.

COUNTS = 200.0  # least travel, in encoder counts: 0.5 % of it is one
REVERSALS = 6  # least number: a constant torque and friction differ by direction alone
SPEEDS = 3.0  # least ratio of fast to slow speed: viscous and Coulomb friction differ by speed alone
_ENOUGH_SAMPLES = 500  # samples; a shorter log is refused by the regression


def check_excitation(axis: Axis, position: Floats, torque: Floats, ratio: float = math.nan) -> None:
    """Refuse a log of an axis that hardly moves.

    Args:
        axis: of the machine.
        position: (n,) [u].
        torque: (n,) [N·m].
        ratio: of the log's inertia to that of the table; nan where it is not known.

    Raises:
        NotIdentifiedError: with what is missing.
    """
    if position.size < _ENOUGH_SAMPLES:
        return
    cure = "gantrysim identify --plan writes moves that do"
    travel = float(np.ptp(position))
    if travel < COUNTS * axis.resolution or travel == 0:
        slips = position_slips(axis, 1 / ratio) if ratio > 0 else []
        if slips:
            cure = f"position in {' or '.join(slips)} read as {axis.unit}?"
        raise NotIdentifiedError(
            f"axis {axis.name}: the axis hardly moves, by {travel:.3g} {axis.unit}: must be at least "
            f"{COUNTS * axis.resolution:.3g} {axis.unit}, {COUNTS:.0f} encoder counts; {cure}"
        )
    if float(np.ptp(torque)) == 0:
        raise NotIdentifiedError(f"axis {axis.name}: its torque is {torque[0]:.3g} N·m throughout; {cure}")
    lengths = strokes(position, axis.resolution)
    if lengths.size <= REVERSALS:
        raise NotIdentifiedError(
            f"axis {axis.name}: reversals = {max(lengths.size - 1, 0)}: must be at least {REVERSALS}; {cure}"
        )
    steps = np.abs(np.diff(position))
    moving = steps[steps > axis.resolution]
    slow, fast = np.quantile(moving, (0.1, 0.95)) if moving.size else (1, 1)
    if fast < SPEEDS * slow:
        raise NotIdentifiedError(
            f"axis {axis.name}: its fast moves are {fast / slow:.2g} times as fast as its slow ones: must be at least "
            f"{SPEEDS:g} times; {cure}"
        )


def strokes(position: Floats, resolution: float) -> Floats:
    """Return the numbers of moving samples between reversals, (k,); steps of up to two counts are none."""
    steps = np.diff(position)
    ways = np.sign(steps[np.abs(steps) > max(2 * resolution, 1e-12)])
    if not ways.size:
        return np.empty(0)
    turns = np.flatnonzero(np.diff(ways) != 0) + 1
    return np.diff(np.concatenate([[0], turns, [ways.size]])).astype(np.float64)


# Check of the log: samples must be fast enough for the reversals they hold, and for the mode.
#
# Between two samples the torque of the model is held, and friction has one direction. Where an axis reverses every
# other sample, both are wrong, and inertia and delay take up the difference: a log of every tenth tick gave an inertia
# of +45 % and a delay of -3.7 ms.

CHECK = "sampling"
STROKE_SAMPLES = 3.0  # samples of a stroke
# largest share of the moving samples in shorter strokes: a loop that swings at rest has 0.16, and is fitted
SHORT_STROKES = 0.25


def check_sampling(axis: Axis, position: Floats, period: float) -> None:
    """Refuse a log too slow for its strokes.

    Raises:
        NotIdentifiedError: with the share of short strokes and what does.
    """
    lengths = strokes(position, axis.resolution)
    if not lengths.size:
        return
    share = float(lengths[lengths < STROKE_SAMPLES].sum() / lengths.sum())
    if share > SHORT_STROKES:
        raise NotIdentifiedError(
            f"axis {axis.name}: in {100 * share:.0f} % of its motion it reverses within {STROKE_SAMPLES - 1:.0f} "
            f"samples of {1e3 * period:g} ms: must be at most {100 * SHORT_STROKES:.0f} %; log every servo tick, with "
            "a loop that does not oscillate"
        )


def check_rate(fit: AxisFit, period: float) -> Doubt:
    """Return whether the mode of the machine's table is beyond the log's rate: likely cause of a doubtful fit."""
    if fit.shows_mode or not fit.nominal.share or fit.nominal.resonance < fit.highest:
        return Doubt({}, [])
    reason = (
        f"samples of {1e3 * period:g} ms show {fit.highest:.0f} Hz at most, the mode of the machine's table is at "
        f"{fit.nominal.resonance:.0f} Hz: log faster, at every servo tick"
    )
    return Doubt({}, [Finding(CHECK, (*MODE, "gap"), reason)])
