"""Regression of the motor's torque on the motion of a sliding axis, low-passed, with chosen terms of friction.

    T = J a + j1 a' + j2 a'' + j3 a''' + j4 a'''' + b v + Fc s + constant + terms

The derivatives of a take up a delay of the torque and the load's spring, so that friction is found before either is
known: they begin a series in the delay and one in the frequency over that of the spring, and the low-pass is wide
enough for their rest. Without the last two, half a sample of delay at 2 ms, or a mode of 336 Hz, bent Coulomb
friction of four in a hundred simulated axes by 11 to 32 %; with them by 5 % at most. Torque and all terms pass one
zero-phase low-pass. Slow errors of the torque weigh here as much as fast ones, where the fit of one-step predictions
sees the fast ones alone.
"""

# ruff: noqa: N806 - matrices bear the letters of the equations

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.identify.friction_terms import Motion, Term
from gantrysim.identify.model import AxisModel
from gantrysim.identify.pieces import WHOLE_LOG, Starts, around, by_piece, gradient, inside, smoothed
from gantrysim.identify.prediction import effective_torque

WIDTH = 0.006  # standard deviation of the low-pass [s]
_DERIVATIVES = ("inertia", "jerk", "snap", "crackle", "pop")  # a and its derivatives
NAMES = (*_DERIVATIVES, "viscous", "coulomb", "offset")  # of the columns before those of the terms
_SPEED_FILTER = 0.001  # standard deviation of the low-pass of the speed that a Stribeck term sees [s]
_MEMORY = 0.1  # length of a block of samples whose errors may be correlated [s]
_SAMPLE_STEPS = 8  # of the torque's course in a sample
_MOVING_SPEED = 0.02  # share of the highest speed from which an axis slides
_SLIDING_SHARE = 0.9  # share of the samples around one that must be in motion


class Solution(NamedTuple):
    """Coefficients of a regression.

    Attributes:
        values: of `NAMES`, then of the terms, (p,).
        covariance: with the correlation of the remaining torque within blocks, (p, p).
        remainder: torque that remains, (k,) [N·m].
        basis: orthonormal columns of the regression, (k, p).
        matrix: columns scaled to a largest value of 1, (k, p).
        sizes: by which they were divided, (p,).
    """

    values: Floats
    covariance: Floats
    remainder: Floats
    basis: Floats
    matrix: Floats
    sizes: Floats


@dataclass(frozen=True, eq=False)
class TorqueRegression:
    """Torque and motion of an axis where it slides.

    Attributes:
        period: of the samples [s].
        motion: at each sample, (n,).
        slides: whether a sample counts, (n,) bool.
        after: mean torque from each sample to the next, (n,) [N·m].
        starts: of the log's pieces.
    """

    period: float
    motion: Motion
    slides: NDArray[np.bool_]
    after: Floats
    starts: Starts = WHOLE_LOG

    @classmethod
    def of(
        cls,
        model: AxisModel,
        period: float,
        position: Floats,
        torque: Floats,
        held: bool,
        starts: Starts = WHOLE_LOG,
    ) -> TorqueRegression:
        """Return the regression of a log.

        Args:
            model: whose lag and delay the torque has.
            period: of the samples [s].
            position: (n,) [u].
            torque: (n,) [N·m].
            held: whether the torque is a demand, held from sample to sample.
            starts: of the pieces.
        """
        width = WIDTH / period
        # a constant torque is found by the regression
        late = replace(model, offset=0.0)
        after = by_piece(
            lambda piece: effective_torque(late, period, piece, _SAMPLE_STEPS, held).mean(axis=1), torque, starts
        )
        directions = by_piece(_direction, position, starts)
        speed = gradient(position, period, starts)
        motion = Motion(
            position=position,
            speed=speed,
            calm=smoothed(speed, max(_SPEED_FILTER / period, 0.5), starts),
            direction=around(directions, starts),
            torque=around(after, starts),
            braking=around(np.abs(after) * directions, starts),
        )
        slow = np.abs(smoothed(speed, width, starts))
        slides = (
            smoothed((slow > _MOVING_SPEED * float(np.quantile(slow, 0.99))).astype(np.float64), width, starts)
            > _SLIDING_SHARE
        )
        # where the filter reaches beyond the log
        slides &= inside(position.size, starts, round(4 * width))
        return cls(period, motion, slides, after, starts)

    def with_directions(self, directions: Floats) -> TorqueRegression:
        """Return the regression with other directions of the motion.

        Args:
            directions: mean sign of the speed from each sample to the next, (n,).
        """
        braking = np.abs(self.after) * directions
        motion = self.motion._replace(direction=around(directions, self.starts), braking=around(braking, self.starts))
        return replace(self, motion=motion)

    def low_passed(self, values: Floats) -> Floats:
        """Return values at all samples low-passed, where the axis slides, (k,)."""
        return np.asarray(smoothed(values, WIDTH / self.period, self.starts)[self.slides])

    @cached_property
    def torque(self) -> Floats:
        """Low-passed torque, (k,) [N·m]."""
        return self.low_passed(self.motion.torque)

    @cached_property
    def columns(self) -> Floats:
        """Low-passed columns of `NAMES`, (k, 8)."""
        speed = smoothed(self.motion.speed, WIDTH / self.period, self.starts)
        direction = self.low_passed(self.motion.direction)
        columns = []
        derivative = speed
        for _ in _DERIVATIVES:
            derivative = gradient(derivative, self.period, self.starts)
            columns.append(derivative[self.slides])
        return np.stack([*columns, speed[self.slides], direction, np.ones_like(direction)], axis=1)

    def columns_of(self, term: Term) -> Floats:
        """Return the low-passed columns of a term, (k, 1 or 2)."""
        return np.stack([self.low_passed(torque) for torque in term.torques(self.motion)], axis=1)

    def solved(self, terms: tuple[Term, ...]) -> Solution:
        """Return the coefficients with some terms."""
        A = np.concatenate([self.columns, *(self.columns_of(term) for term in terms)], axis=1)
        sizes = np.maximum(np.abs(A).max(axis=0), 1e-300)
        A = A / sizes
        Q, R = np.linalg.qr(A)
        values = np.linalg.lstsq(R, Q.T @ self.torque, rcond=None)[0]
        remainder = self.torque - A @ values
        inverse = np.linalg.pinv(A.T @ A)
        covariance = inverse @ self._scores(A * remainder[:, None]) @ inverse
        return Solution(values / sizes, covariance / np.outer(sizes, sizes), remainder, Q, A, sizes)

    def variance_of_sum(self, values: Floats) -> float:
        """Return the variance of the sum of values, (k,), whose mean is zero and which are correlated within blocks."""
        return float(self._scores(values[:, None])[0, 0])

    def _scores(self, scores: Floats) -> Floats:
        """Return the sum of squares of sums of scores, (k, p), over blocks, which holds a correlation within one."""
        blocks = np.arange(0, len(scores), max(round(_MEMORY / self.period), 1))
        sums = np.add.reduceat(scores, blocks, axis=0)
        return np.asarray(sums.T @ sums)


def _direction(position: Floats) -> Floats:
    """Return the sign of the step from each sample to the next, (n,), or of the last one that is not zero.

    Counts of the encoder stand still on slow moves.
    """
    steps = np.diff(position, append=position[-1])
    last = np.maximum.accumulate(np.where(steps != 0, np.arange(steps.size), 0))
    return np.asarray(np.sign(steps[last]))
