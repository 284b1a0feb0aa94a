"""Results of the fit of an axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.identify.friction_terms import CONFIDENCE, Term
from gantrysim.identify.model import AxisModel
from gantrysim.identify.pieces import WHOLE_LOG, Starts
from gantrysim.identify.whiteness import correlation

KNOWN_INTERVAL = 0.15  # largest half interval of an identified parameter, of its value
# the same of the damping, which answers to a hundredth of the period between spring and damper: the engine's own step
# of 0.25 ms takes a quarter of it from a mode at 324 Hz
KNOWN_DAMPING = 0.4
WHITE = 0.25  # correlation of a residual from which the model's structure counts as wrong
# standard deviation that counts of the encoder and steps of the predictor leave, of the value: round trips show it
SYSTEMATIC = {
    "inertia": 0.005,
    "viscous": 0.015,
    "coulomb": 0.005,
    "static": 0.01,
    "delay": 0.003,
    "share": 0.015,
    "stiffness": 0.012,
    "damping": 0.19,
    "gap": 0.07,
}
EDGE = 0.85  # of the log's reach, up to which it shows a mode
MODE = ("share", "stiffness", "damping")

# name, unit with u for mm or deg, of the fitted parameters in their order
PARAMETERS = {
    "inertia": "N·m·s²/u",
    "viscous": "N·m·s/u",
    "viscous_forward": "N·m·s/u",
    "viscous_back": "N·m·s/u",
    "coulomb": "N·m",
    "excess": "N·m",
    "static": "N·m",
    "offset": "N·m",
    "delay": "s",
    "share": "",
    "stiffness": "N·m/u",
    "damping": "N·m·s/u",
    "gap": "u",
}


# the same in words, where the name alone is none
LABELS = {
    "inertia": "inertia, whole",
    "viscous": "viscous friction",
    "viscous_forward": "viscous friction forwards",
    "viscous_back": "viscous friction back",
    "coulomb": "Coulomb friction",
    "static": "static friction",
    "offset": "constant torque",
    "share": "load's share of the inertia",
    "gap": "backlash",
}


@dataclass(frozen=True)
class Estimate:
    """A fitted parameter.

    Attributes:
        value: in the unit of `PARAMETERS`.
        deviation: standard deviation, of the Gauss-Newton covariance with the residual's own correlation, and
            `SYSTEMATIC`.
    """

    value: float
    deviation: float

    @property
    def interval(self) -> tuple[float, float]:
        """Ends of the 95 % confidence interval."""
        half = CONFIDENCE * self.deviation
        return self.value - half, self.value + half


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Answer of the residual to the parameters at the minimum.

    Attributes:
        names: of the fitted parameters, (p,).
        jacobian: derivatives of the scaled residual by the fit's variables, the torque noise's the last, (k, p + 1).
        slopes: change of a parameter per change of its variable, (p,).
        residual: scaled, (k,).
    """

    names: tuple[str, ...]
    jacobian: Floats
    slopes: Floats
    residual: Floats


@dataclass(frozen=True, eq=False)
class FrictionLaw:
    """Friction by the torque of a sliding axis.

    Attributes:
        estimates: viscous and Coulomb friction and constant torque.
        terms: chosen beside these.
        words: a description of each term.
        level: friction of the terms beside Coulomb friction, whatever the direction, (n,) [N·m].
        ripple: torque of the terms against the motor, (n,) [N·m].
        remainder: rms of the low-passed torque that remains [N·m].
        size: rms of the low-passed torque [N·m].
        unevenness: by partition of the log, the largest mean friction that remains in a part, less two standard
            deviations [N·m].
    """

    estimates: dict[str, Estimate]
    terms: tuple[Term, ...]
    words: tuple[str, ...]
    level: Floats
    ripple: Floats
    remainder: float
    size: float
    unevenness: dict[str, float]


@dataclass(frozen=True, eq=False)
class AxisFit:
    """The identification of an axis.

    Attributes:
        axis: its name.
        unit: "mm" or "deg".
        nominal: the model of the machine's MJCF.
        model: the fitted one.
        estimates: of the parameters by name, in the order of `PARAMETERS`.
        noise: fitted standard deviation of the torque noise [N·m].
        expected: standard deviation of the position noise that the encoder's counts explain [u].
        used: whether a sample is in motion, (n,) bool.
        innovations: of all samples, (n,) [u].
        directions: mean sign of the predicted speed from each sample to the next, (n,).
        start: inertia, viscous and Coulomb friction of the linear regression.
        highest: frequency up to which the log shows a mode [Hz].
        position: fitted part of the log, its moves, (n,) [u].
        torque: likewise, (n,) [N·m].
        held: whether the torque is a demand, held until the next sample.
        starts: of the pieces.
        first: row of the log at which the fitted part begins.
        sensitivity: of the residual of the samples in motion to the parameters.
        predicted: the model whose predictions the innovations are of; its friction is that of the predictions alone.
        law: friction by the torque of the sliding axis.
    """

    axis: str
    unit: str
    nominal: AxisModel
    model: AxisModel
    estimates: dict[str, Estimate]
    noise: float
    expected: float
    used: NDArray[np.bool_]
    innovations: Floats
    directions: Floats
    start: tuple[float, float, float]
    highest: float
    position: Floats
    torque: Floats
    held: bool
    sensitivity: Sensitivity
    predicted: AxisModel
    law: FrictionLaw
    starts: Starts = WHOLE_LOG
    first: int = 0

    @property
    def residual(self) -> Floats:
        """Innovations of the samples in motion, (k,) [u]."""
        return self.innovations[self.used]

    @property
    def shows_mode(self) -> bool:
        """Whether the mode is fitted, and in the reach of the log; at its edge samples fold a faster one to there."""
        return "stiffness" in self.estimates and self.model.resonance < EDGE * self.highest

    @property
    def holds(self) -> bool:
        """Whether the residual is practically white: the structure of the model, maybe with a backlash, is right."""
        return float(np.abs(correlation(self.residual)).max()) <= WHITE
