"""The laws beyond PID in the servo tick: P-PI, friction, disturbance observer, cross-coupling, torques sent along."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

import numba
import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple

from gantrysim.base.jit import inner_jit
from gantrysim.native.pointers import call, floats, gains_of, laws_of, tick_log
from gantrysim.native.row import TOLD
from gantrysim.servo import law, notch
from gantrysim.servo.laws import cascade, contour, friction, observer

LAWS = (law, notch, cascade, contour, friction, observer)  # modules whose functions become part of the tick

_law, _cascaded = inner_jit(law.law), inner_jit(cascade.cascaded)
_filtered = inner_jit(notch.filtered)
_friction_torque = inner_jit(friction.friction_torque)
_observed = inner_jit(observer.observed)
_tangents, _error_across = inner_jit(contour.tangents), inner_jit(contour.error_across)
_COEFFICIENTS = len(notch.Coefficients._fields)
_FRICTION, _TAPS = len(friction.Friction._fields), observer.TAPS


@inner_jit
def apply_laws(row, userdata):
    """Set the torque demands of all axes at a tick."""
    laws, n = laws_of(row), row.axes
    own_law = laws[0].user != 0
    if own_law:
        row.torque[:n] = np.nan
        call(laws[0].user, userdata, laws[0].state_at)
    if laws[0].contour > 0.0:
        _tangents(row.demand_velocity, row.linear, laws.tangent, n)
    for a in range(n):
        own = laws[a]
        error = row.error[a]
        error_sum, speed_sum = row.error_sum[a], own.speed_sum
        if own_law:
            torque = row.torque[a]
        else:
            torque, error, error_sum, speed_sum = _base(row, laws, a)
        resisted = _friction(row, own, a)
        torque += resisted + _sent_along(row, own, a) - _disturbance(row, own, a)
        row.torque[a] = torque
        limit = row.torque_limit[a]
        own.told[row.tick % TOLD] = min(max(torque, -limit), limit) - resisted
        # anti-windup: the sums are frozen while the output is clamped on the side to which the error drives it
        if abs(torque) <= limit or torque * error < 0.0:
            row.error_sum[a] = error_sum
            own.speed_sum = speed_sum


@inner_jit
def _base(row, laws, a):
    """Return the torque of PID or P-PI through the notch, the error it answers to, and the sums after it."""
    own, gains = laws[a], gains_of(row, a)
    error, change = row.error[a], row.error_change[a]
    if own.contour > 0.0 and row.linear[a] > 0.0:
        across = own.contour * _error_across(row.error, laws.tangent, row.linear, a, row.axes)
        change += (across - own.across) / row.period
        own.across = across
        error += across
    error_sum, speed_sum = row.error_sum[a] + error * row.period, 0.0
    velocity, acceleration, measured = row.demand_velocity[a], row.demand_acceleration[a], row.measured_velocity[a]
    if own.cascade != 0:
        torque, speed_sum = _cascaded(error, own.speed_sum, velocity, acceleration, measured, gains, row.period)
    else:
        torque = _law(error, error_sum, change, velocity, acceleration, measured, gains)
    torque, row.notch_first[a], row.notch_second[a] = _filtered(
        torque, to_fixed_tuple(row.notch[a], _COEFFICIENTS), row.notch_first[a], row.notch_second[a]
    )
    return torque, error, error_sum, speed_sum


@inner_jit
def _friction(row, own, a):
    """Return the torque of the friction that is compensated."""
    if own.friction[0] > 0.0:
        velocity = row.demand_velocity[a]
        own.friction_torque = _friction_torque(
            own.friction_torque, velocity, velocity * row.period, to_fixed_tuple(own.friction, _FRICTION)
        )
    return own.friction_torque


@inner_jit
def _sent_along(row, own, a):
    """Return the torque that is sent with the setpoint."""
    if own.feed == 0:
        return 0.0
    setpoint = tick_log(row, row.tick).setpoint
    return numba.carray(floats(own.feed + 8 * row.axes * setpoint), (row.axes,))[a]


@inner_jit
def _disturbance(row, own, a):
    """Return the disturbance observed, filtered, 0 without an observer."""
    velocity = row.measured_velocity[a]
    acceleration = (velocity - own.velocity) / row.period
    own.velocity = velocity
    if own.inertia == 0.0:
        return 0.0
    told = 0.0
    for j in range(_TAPS):
        before = row.tick - 1 - own.shift - j
        if before >= 0:
            told += own.taps[j] * own.told[before % TOLD]
    raw = _observed(acceleration, velocity, told, own.inertia, own.viscous)
    torque, own.first, own.second = _filtered(raw, to_fixed_tuple(own.filter, _COEFFICIENTS), own.first, own.second)
    return torque
