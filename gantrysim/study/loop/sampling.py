"""What the sampling of servo and encoder leaves, in closed forms: the following error, and that of the counts.

They share no code with the simulation. The following error is what sampling and winding leave, `circle_response`; of
the encoder it is `quantisation`.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.arrays import Floats
from gantrysim.controllers.servo import AxisDynamics, Servo


def circle_response(servo: Servo, index: int, axis: AxisDynamics, rate: float) -> complex:
    """Return the following error E over the command R of one axis that runs R exp(i w t), of the linear, rigid axis.

    Motor torque J M'' + b M' moves the position M = R - E. A sampled output is held for a period T, which delays it by
    T/2, and comes through the winding's lag tau and the delay delta of the servo; a backward difference is late by T/2,
    the second one by T. With s = i w, H = exp(-s (T/2 + tau + delta)) and B = (1 - exp(-s T)) / T,

        E / R = (J s^2 + b s - H (kvff B + kaff B^2 + kov B)) / (J s^2 + b s + H (kp + ki / s + kd B - kov B)).

    To leading order the feed-forward of the acceleration, late by 3/2 T + tau + delta, is what is left over:
    E = (3/2 T + tau + delta) J R''' / kp, see `sample_and_hold`.

    Args:
        servo: with its gains.
        index: of the axis in the servo.
        axis: inertia J, viscous friction b and lag tau of it.
        rate: w [rad/s].
    """
    s = 1j * rate
    hold = cmath.exp(-s * (0.5 * servo.period + axis.lag + servo.delay))
    back = (1 - cmath.exp(-s * servo.period)) / servo.period
    plant = axis.inertia * s**2 + axis.viscous * s
    output = servo.output_velocity[index] * back
    forward = servo.velocity_ff[index] * back + servo.acceleration_ff[index] * back**2
    law = servo.kp[index] + servo.ki[index] / s + servo.kd[index] * back
    return (plant - hold * (forward + output)) / (plant + hold * (law - output))


@dataclass(frozen=True)
class FollowingError:
    """Root mean squares of a following error in the plane [mm].

    Attributes:
        along: along the path.
        normal: square to it.
    """

    along: float
    normal: float


def sample_and_hold(
    servo: Servo, axes: Sequence[AxisDynamics], plane: tuple[int, int], speed: float, radius: ArrayLike
) -> FollowingError:
    """Return the following error of two axes on a path whose radius of curvature changes slowly.

    At each radius it is that of a circle at the rate w = V / rho, by `circle_response`. With h the mean of the two
    axes' responses and d half their difference, the error turns with the path by rho h and against it by rho d:
    mean squares rho^2 (Im(h)^2 + |d|^2 / 2) along the path and rho^2 (Re(h)^2 + |d|^2 / 2) square to it.

    Args:
        servo: with the gains of the machine's axes.
        axes: of the machine.
        plane: indices of the two axes that span the plane.
        speed: V [mm/s].
        radius: of curvature at times evenly apart, rho, (m,) [mm].
    """
    along = normal = 0.0
    radii = np.atleast_1d(np.asarray(radius, float)).tolist()
    for rho in radii:
        first, second = (circle_response(servo, k, axes[k], speed / rho) for k in plane)
        mean, half = 0.5 * (first + second), 0.5 * (first - second)
        along += rho**2 * (mean.imag**2 + 0.5 * abs(half) ** 2) / len(radii)
        normal += rho**2 * (mean.real**2 + 0.5 * abs(half) ** 2) / len(radii)
    return FollowingError(math.sqrt(along), math.sqrt(normal))


def quantisation(resolution: ArrayLike) -> Floats:
    """Return the rms of the error of counts of a resolution q, evenly distributed within one: q / sqrt(12).

    It is the same in any direction of a plane whose axes have equal counts.

    Args:
        resolution: q, (m,) [mm].
    """
    return np.asarray(resolution, float) / math.sqrt(12)
