"""Terms of friction that a log may need beside viscous and Coulomb friction.

With w the motor's speed, s its direction, x the position and T the torque at the motor:

    direction              |w|
    square of the speed    w |w|
    load                   |T| s
    Stribeck               exp(-|w| / ws) s
    position               sin(2 pi x / L) s, cos(2 pi x / L) s
    cogging                sin(2 pi x / L), cos(2 pi x / L)

Viscous friction that differs by direction, and cogging, are torques of their own; all others scale the level of the
friction.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gantrysim.base.arrays import Floats

CONFIDENCE = 1.96  # standard deviations of a 95 % interval

DIRECTION = "direction"
SQUARE = "square"
LOAD = "load"
STRIBECK = "Stribeck"
POSITION = "position"
COGGING = "cogging"
OWN = (DIRECTION, COGGING)  # whose torque does not turn with the motion
PERIODIC = (POSITION, COGGING)
POSITIVE_TERMS = (SQUARE, LOAD, STRIBECK)  # negative, they would drive the axis, or be another term


class Motion(NamedTuple):
    """Motion and torque of an axis at each sample, (n,) each.

    Attributes:
        position: [u].
        speed: by central differences [u/s].
        calm: the same, smoothed over a millisecond: counts of the encoder are coarse on slow moves [u/s].
        direction: mean sign of the speed from the sample before to the one behind, from -1 to 1.
        torque: of the motor [N·m].
        braking: mean over the same time of the torque's size times the sign of the speed [N·m].
    """

    position: Floats
    speed: Floats
    calm: Floats
    direction: Floats
    torque: Floats
    braking: Floats


class Term(NamedTuple):
    """A term of the friction.

    Attributes:
        kind: its name.
        size: Stribeck speed [u/s] or period over the travel [u]; 0 of the others.
    """

    kind: str
    size: float = 0.0

    def levels(self, motion: Motion) -> list[Floats]:
        """Return what the term's coefficients multiply: levels of friction without their direction, or torques."""
        if self.kind == DIRECTION:
            return [np.abs(motion.speed)]
        if self.kind == SQUARE:
            return [motion.speed**2]
        if self.kind == LOAD:
            return [np.abs(motion.torque)]
        if self.kind == STRIBECK:
            return [np.exp(-np.abs(motion.calm) / self.size)]
        phase = 2 * np.pi * motion.position / self.size
        return [np.sin(phase), np.cos(phase)]

    def torques(self, motion: Motion) -> list[Floats]:
        """Return the torques against the motion that the term's coefficients multiply."""
        if self.kind in OWN:
            return self.levels(motion)
        if self.kind == LOAD:
            # where a swinging loop turns the torque from sample to sample, its mean has not the mean size
            return [motion.braking]
        return [motion.direction * level for level in self.levels(motion)]

    def words(self, coefficients: Floats, covariance: Floats, coulomb: float, fastest: float, unit: str) -> str:
        """Return the term in words.

        Args:
            coefficients: of the term, (k,).
            covariance: of these, (k, k).
            coulomb: Coulomb friction beside it [N·m].
            fastest: speed of the log's fast moves [u/s].
            unit: of the position, u.
        """
        first = float(coefficients[0])
        if self.kind == DIRECTION:
            way = "forwards" if first > 0 else "back"
            share = 2 * abs(first) * fastest
            return f"viscous friction by direction, {share:.2g} N·m more {way} at {fastest:.3g} {unit}/s"
        if self.kind == SQUARE:
            return f"drag by the square of the speed, {first * fastest**2:.2g} N·m at {fastest:.3g} {unit}/s"
        if self.kind == LOAD:
            return f"friction by load, {100 * first:.2g} % of the motor's torque"
        if self.kind == STRIBECK:
            return f"Stribeck friction, {first:.2g} N·m more at rest, gone beyond {self.size:.2g} {unit}/s"
        size = float(np.hypot(*coefficients))
        half = CONFIDENCE * math.sqrt(float(coefficients @ covariance @ coefficients)) / max(size, 1e-300)
        if self.kind == COGGING:
            return f"cogging of {size:.2g} (± {half:.1g}) N·m over every {self.size:.3g} {unit}"
        share = 100 / max(coulomb, 1e-300)
        return f"friction over the travel, {share * size:.2g} (± {share * half:.1g}) % every {self.size:.3g} {unit}"
