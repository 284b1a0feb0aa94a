"""Closed forms of the errors of a sampled servo and encoder; they share no code with the simulation."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats
from gantrysim.servo.axis_dynamics import AxisDynamics
from gantrysim.servo.laws.pid import terms
from gantrysim.servo.servo import Servo


def circle_response(servo: Servo, index: int, axis: AxisDynamics, rate: float) -> complex:
    """Return the following error E over the command R of a linear, rigid axis that runs R exp(i w t).

    Motor torque J M'' + b M' moves the position M = R - E. Holding a sampled output for a period T
    delays it by T/2, besides the winding's lag tau and the servo's delay delta; a backward difference is late by T/2,
    a second one by T. With s = i w, H = exp(-s (T/2 + tau + delta)) and B = (1 - exp(-s T)) / T,

        E / R = (J s^2 + b s - H (kvff B + kaff B^2 + kov B)) / (J s^2 + b s + H (kp + ki / s + kd B - kov B)).

    A current loop of bandwidth f has the lag 1 / (2 pi f) in place of the winding's. Feedback that is n periods late
    shows the law M D, D = exp(-s n T), in place of M.

    To leading order the acceleration feed-forward, late by 3/2 T + tau + delta, remains:
    E = (3/2 T + tau + delta) J R''' / kp, see `sample_and_hold`.

    Args:
        servo: with gains.
        index: of the axis in the servo.
        axis: inertia J, viscous friction b and lag tau.
        rate: w [rad/s].
    """
    s = 1j * rate
    lag = servo.lags.of_axes([index]).winding(axis)
    hold = cmath.exp(-s * (0.5 * servo.period + lag + servo.delay))
    late = cmath.exp(-s * servo.feedback_delay * servo.period)
    back = (1 - cmath.exp(-s * servo.period)) / servo.period
    plant = axis.inertia * s**2 + axis.viscous * s
    per_unit = terms(servo.gains[index])
    output = per_unit.measured_velocity * back
    forward = per_unit.demand_velocity * back + per_unit.demand_acceleration * back**2
    law = per_unit.error + per_unit.error_sum / s + per_unit.error_change * back
    closed = plant + hold * late * (law - output)
    return (closed - hold * (forward + law)) / closed


class FollowingError(NamedTuple):
    """Root mean squares of a following error in the plane, along the path and normal to it [mm]."""

    along: float
    normal: float


def sample_and_hold(
    servo: Servo, axes: Sequence[AxisDynamics], plane: tuple[int, int], speed: float, radius: ArrayLike
) -> FollowingError:
    """Return the following error of two axes on a path whose radius of curvature changes slowly.

    At each radius it is that of a circle at the rate w = V / rho, by `circle_response`. With h the mean of the two
    axes' responses and d half their difference, the mean squares are rho^2 (Im(h)^2 + |d|^2 / 2) along the path and
    rho^2 (Re(h)^2 + |d|^2 / 2) normal to it.

    Args:
        servo: with the gains of the machine's axes.
        axes: of the machine.
        plane: indices of the two axes that span the plane.
        speed: V [mm/s].
        radius: of curvature at times evenly apart, rho, (m,) [mm].
    """
    along = 0.0
    normal = 0.0
    radii = np.atleast_1d(np.asarray(radius, float)).tolist()
    for rho in radii:
        first = circle_response(servo, plane[0], axes[plane[0]], speed / rho)
        second = circle_response(servo, plane[1], axes[plane[1]], speed / rho)
        mean = 0.5 * (first + second)
        half = 0.5 * (first - second)
        along += rho**2 * (mean.imag**2 + 0.5 * abs(half) ** 2) / len(radii)
        normal += rho**2 * (mean.real**2 + 0.5 * abs(half) ** 2) / len(radii)
    return FollowingError(math.sqrt(along), math.sqrt(normal))


def quantisation(resolution: ArrayLike) -> Floats:
    """Return the rms error q / sqrt(12) of counts of a resolution q, (m,) [mm], in any direction of equal axes."""
    return np.asarray(resolution, float) / math.sqrt(12)
