"""A user's own law: a function in plain Python, or compiled by numba, that the servo calls at every tick."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.base.user_code import named_object
from gantrysim.servo.stability.linear_system import Compensator
from gantrysim.servo.stability.motion import UnknownLoopError

# A law in plain Python, which the engine calls at every servo tick instead of the servo's laws.


@dataclass(frozen=True)
class Tick:
    """Inputs of a user-defined law at one servo tick.

    Attributes:
        time: time of the tick [s].
        period: servo period T [s].
        commanded: DPOS, (axes,) [mm].
        measured: MPOS, quantised by the encoder, (axes,) [mm].
        error: following error DPOS - MPOS, (axes,) [mm].
        demand_velocity: dDPOS/T, (axes,) [mm/s].
        demand_acceleration: ddDPOS/T^2, (axes,) [mm/s²].
        measured_velocity: dMPOS/T, (axes,) [mm/s].
    """

    time: float
    period: float
    commanded: Floats
    measured: Floats
    error: Floats
    demand_velocity: Floats
    demand_acceleration: Floats
    measured_velocity: Floats


class PlainLaw(Protocol):
    """A law in plain Python: returns the torque demands of all axes at one tick, (axes,) [N·m]."""

    def __call__(self, tick: Tick, /) -> ArrayLike: ...


STATE = 64  # numbers that a law keeps from tick to tick, 0 at the start of a run
_ORDER = 24  # largest of a linear law
_KICK = 1e-3  # error by which a law is linearised [u]
_LINEAR_RESPONSE = 1e-6  # of a response, relative to its largest value
_RANK = 1e-9
_REST_TICKS = 5  # ticks before a kick


class UserTick(NamedTuple):
    """What a law is given at one servo tick. The arrays are those of the servo: a law must not change them.

    Attributes:
        axes: number of axes.
        time: of the tick [s].
        period: servo period T [s].
        commanded: DPOS, (axes,) [u].
        measured: MPOS, (axes,) [u].
        error: DPOS - MPOS, (axes,) [u].
        demand_velocity: dDPOS/T, (axes,) [u/s].
        demand_acceleration: ddDPOS/T^2, (axes,) [u/s²].
        measured_velocity: dMPOS/T, (axes,) [u/s].
        gains: of the servo, in the order of the fields of `Gains`, (axes, gains).
    """

    axes: int
    time: float
    period: float
    commanded: Floats
    measured: Floats
    error: Floats
    demand_velocity: Floats
    demand_acceleration: Floats
    measured_velocity: Floats
    gains: Floats


# law(tick, state, torque): sets the torque demands of all axes, (axes,) [N·m]; state is (64,)
UserLaw = Callable[[UserTick, Floats, Floats], None]
LawName = str | UserLaw  # of a law of the ladder, or a law itself


def resolved_law(law: LawName) -> UserLaw:
    """Return the function that "module:function" or "path/to/file.py:function" names, or the function itself.

    Raises:
        InputError: there is none, or its module cannot be imported.
    """
    if not isinstance(law, str):
        return law
    function, place = named_object("law", law)
    if not callable(function):
        raise InputError(f"law {law!r}: {place} has no function {law.rpartition(':')[2]!r}")
    return function


def without_warnings(law: UserLaw) -> UserLaw:
    """Return a law without NumPy's warnings of overflow: torques that are not finite end the run with a fault.

    A law that numba has compiled, which gives none, is returned itself.
    """
    return law if hasattr(law, "py_func") else np.errstate(all="ignore")(law)


def linearised_law(law: UserLaw, gains: Floats, axis: int, period: float) -> Compensator:
    """Return a linear law as it answers to the position of one axis, from its response to a kick.

    A realisation of the least order that has the law's impulse response (Ho and Kalman, Regelungstechnik 14, 1966).

    Args:
        law: the law.
        gains: of all axes, (axes, gains).
        axis: number of the axis.
        period: servo period [s].

    Raises:
        UnknownLoopError: a law that is not linear, not finite, depends on time, couples axes, or is of an order above
            24.
    """
    once, twice, late = (
        _kicked_torques(without_warnings(law), gains, axis, period, size, before)
        for size, before in ((_KICK, _REST_TICKS), (2 * _KICK, _REST_TICKS), (_KICK, 2 * _REST_TICKS))
    )
    if not all(np.isfinite(response).all() for response in (once, twice, late)):
        raise UnknownLoopError("a law of the user's whose torques are not finite has no margins")
    size = np.abs(once).max()
    steady = np.allclose(twice, 2 * once, rtol=0, atol=_LINEAR_RESPONSE * size) and np.allclose(
        late[_REST_TICKS:], once[:-_REST_TICKS], rtol=0, atol=_LINEAR_RESPONSE * size
    )
    if not steady:
        raise UnknownLoopError("a law of the user's that is not linear, or not the same at all times, has no margins")
    if np.abs(np.delete(once, axis, axis=1)).max(initial=0.0) > _LINEAR_RESPONSE * size:
        raise UnknownLoopError("a law of the user's that couples axes has no margins")
    response = once[_REST_TICKS:, axis] / _KICK
    sums = np.add.outer(np.arange(_ORDER), np.arange(_ORDER))
    H = response[1 + sums]  # noqa: N806
    shifted = response[2 + sums]
    outputs, values, inputs = np.linalg.svd(H)
    rank = max(int(np.count_nonzero(values > _RANK * max(values[0], abs(response[0])))), 1)
    if rank > _ORDER - 2:
        raise UnknownLoopError(f"a law of the user's of an order above {_ORDER - 2} has no margins")
    root = np.sqrt(np.maximum(values[:rank], np.finfo(float).tiny))
    observe = outputs[:, :rank] * root
    reach = root[:, None] * inputs[:rank]
    A = (outputs[:, :rank] / root).T @ shifted @ (inputs[:rank].T / root)  # noqa: N806
    return Compensator(A, reach[:, 0], observe[0], float(response[0]))


def _kicked_torques(law: UserLaw, gains: Floats, axis: int, period: float, size: float, before: int) -> Floats:
    """Return the torques of a law at rest to an axis that is off at one tick, (ticks, axes)."""
    ticks = 2 * _ORDER + 16
    n = len(gains)
    state = np.zeros(STATE)
    out = np.zeros((ticks, n))
    zero = np.zeros(n)
    last = zero
    for k in range(ticks):
        measured = np.zeros(n)
        measured[axis] = -size if k == before else 0.0
        velocity = (measured - last) / period
        last = measured
        law(UserTick(n, k * period, period, zero, measured, -measured, zero, zero, velocity, gains), state, out[k])
    return out
