"""Laws as a user writes them: PD in plain Python and for numba, and one that is wrong in several ways."""

import numba
import numpy as np


def pd(tick, state, torque):
    for a in range(tick.axes):
        change = (tick.error[a] - state[a]) / tick.period if tick.time > 0 else 0.0
        state[a] = tick.error[a]
        torque[a] = tick.gains[a, 0] * tick.error[a] + tick.gains[a, 2] * change


compiled_pd = numba.njit(pd)


@numba.njit
def lagged_pid(tick, state, torque):
    """PID with a first-order lag on the torque, and the error of the last tick in the state."""
    for a in range(tick.axes):
        own = state[4 * a : 4 * a + 4]
        own[0] += tick.error[a] * tick.period
        raw = tick.gains[a, 0] * tick.error[a] + 20.0 * tick.gains[a, 0] * own[0]
        raw += tick.gains[a, 2] * (tick.error[a] - own[1]) / tick.period
        own[1] = tick.error[a]
        own[2] += 0.7 * (raw - own[2])
        torque[a] = own[2]


def cubic(tick, state, torque):
    torque[:] = tick.gains[:, 0] * np.tanh(100 * tick.error)


def coupled(tick, state, torque):
    torque[:] = tick.gains[:, 0] * tick.error.sum()


def late(tick, state, torque):
    """Answers to the error of the last tick through a first-order lag, so not at all within a tick."""
    for a in range(tick.axes):
        torque[a] = 0.7 * state[2 * a + 1] + 0.3 * tick.gains[a, 0] * state[2 * a]
        state[2 * a], state[2 * a + 1] = tick.error[a], torque[a]


def fading(tick, state, torque):
    """Linear at every moment, but another law later."""
    torque[:] = tick.gains[:, 0] * tick.error * (1 + tick.time)


def broken(tick, state, torque):
    if tick.time > 0.02:
        raise ZeroDivisionError("gain of nothing")
    torque[:] = 0


def nothing(tick, state, torque):
    torque[:] = np.nan


@numba.njit
def uncompilable(tick, state, torque):
    torque[:] = tick.no_such_field


number = 3


def bursting(tick, state, torque):
    """Has a pole at 1e30."""
    for a in range(tick.axes):
        state[a] = 1e30 * state[a] + tick.error[a]
        torque[a] = state[a]


def boundless(tick, state, torque):
    for a in range(tick.axes):
        torque[a] = np.inf * tick.error[a]
