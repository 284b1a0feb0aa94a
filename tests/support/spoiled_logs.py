"""Errors that people make with a log, or that a drive makes: each spoils a healthy one of the independent simulator."""

from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from support.identification_logs import AXIS, MACHINE, random_log

_CONSTANT = MACHINE.axes[AXIS].motor_constant  # [N·m/A]
_RATED = MACHINE.axes[AXIS].peak_torque / 3  # [N·m]


def healthy(seed, law=None, period=1e-3, noise=2e-3):
    """Return a log without an error."""
    return random_log(seed, law, slip="", period=period, noise=noise).log


def _torque(log, torque):
    return replace(log, torque=np.asarray(torque, float).reshape(-1, 1))


def _position(log, position):
    return replace(log, position=np.asarray(position, float).reshape(-1, 1))


def _other(seed):
    """Return the torque of another axis, which moves at other times."""
    return np.roll(healthy(seed + 5000).torque[::-1, 0], 137)


def _frozen(log, random):
    position = log.position[:, 0].copy()
    first = len(position) // 5
    position[first : first + len(position) // 10] = position[first]
    return _position(log, position)


def _lost_counts(log, random):
    position = log.position[:, 0].copy()
    speed = np.abs(np.gradient(position))
    fast = np.flatnonzero(speed > 0.5 * speed.max())
    for first in random.choice(fast, 12, replace=False):
        position[first:] -= 0.05 * np.sign(position[first] - position[first - 1])
    return _position(log, position)


def _repeated_rows(log, random):
    """Every row whose transfer was late is the one before again, and the stamps are even."""
    rows = np.arange(len(log.position))
    late = random.random(len(rows)) < 0.02
    rows[late] -= 1
    rows = np.maximum(rows, 0)
    return replace(log, position=log.position[rows], torque=log.torque[rows])


def _missing_rows(log, random):
    """Rows that the logger has dropped, under stamps that it has made itself."""
    rows = random.random(len(log.position)) > 0.005
    return replace(log, position=log.position[rows], torque=log.torque[rows])


def _clock_jump(log, random):
    """The position's recorder loses half a second of its own that the torque's recorder has."""
    n = len(log.position)
    lost = int(0.02 / log.period)
    position = np.concatenate([log.position[: n // 2], log.position[n // 2 + lost :]])
    return replace(log, position=position, torque=log.torque[: len(position)])


def _every(log, count):
    return replace(log, position=log.position[::count], torque=log.torque[::count], period=count * log.period)


def _low_pass(values, period, time):
    """Return a causal first-order low-pass."""
    state = values[0]
    out = np.empty_like(values)
    share = 1 - np.exp(-period / time)
    for k, value in enumerate(values):
        state += share * (value - state)
        out[k] = state
    return out


SPOILS = {
    "torque late by two samples (delay below zero)": lambda log, random, seed: _torque(log, np.roll(log.torque, 2)),
    "torque late by 15 samples": lambda log, random, seed: _torque(log, np.roll(log.torque, 15)),
    "torque early by 15 samples": lambda log, random, seed: _torque(log, np.roll(log.torque, -15)),
    "machine of 2.6 times the inertia": lambda log, random, seed: _torque(log, 2.6 * log.torque),
    "machine of a third of the inertia": lambda log, random, seed: _torque(log, log.torque / 3),
    "every third row": lambda log, random, seed: _every(log, 3),
    "every tenth row": lambda log, random, seed: _every(log, 10),
    "frozen encoder": lambda log, random, seed: _frozen(log, random),
    "position constant throughout": lambda log, random, seed: _position(log, np.full(len(log.position), 12.345)),
    "torque in A": lambda log, random, seed: _torque(log, log.torque / _CONSTANT),
    "torque in per mille of rated": lambda log, random, seed: _torque(log, 1e3 * log.torque / _RATED),
    "torque in percent of rated": lambda log, random, seed: _torque(log, 1e2 * log.torque / _RATED),
    "torque in mN·m": lambda log, random, seed: _torque(log, 1e3 * log.torque),
    "torque in kN·m": lambda log, random, seed: _torque(log, 1e-3 * log.torque),
    "torque in kgf·m": lambda log, random, seed: _torque(log, log.torque / 9.81),
    "position in inches": lambda log, random, seed: _position(log, log.position / 25.4),
    "position in m": lambda log, random, seed: _position(log, log.position / 1e3),
    "position in µm": lambda log, random, seed: _position(log, log.position * 1e3),
    "position in motor turns": lambda log, random, seed: _position(log, log.position / 10),
    "clock jump of 20 ms between the columns": lambda log, random, seed: _clock_jump(log, random),
    "2 % of rows repeated": lambda log, random, seed: _repeated_rows(log, random),
    "0.5 % of rows lost": lambda log, random, seed: _missing_rows(log, random),
    "columns swapped": lambda log, random, seed: replace(log, position=log.torque, torque=log.position),
    "torque of the wrong sign": lambda log, random, seed: _torque(log, -log.torque),
    "torque of another axis": lambda log, random, seed: _torque(log, np.resize(_other(seed), len(log.torque))),
    "torque of an axis at rest": lambda log, random, seed: _torque(
        log, 0.01 + 2e-3 * random.standard_normal(len(log.torque))
    ),
    "torque clipped at a third": lambda log, random, seed: _torque(
        log, np.clip(log.torque, -0.33 * np.abs(log.torque).max(), 0.33 * np.abs(log.torque).max())
    ),
    "axis at rest": lambda log, random, seed: replace(
        log,
        position=12.345 + 1e-3 * np.rint(0.6 * random.standard_normal(log.position.shape)),
        torque=2e-3 * random.standard_normal(log.torque.shape),
    ),
    "position smoothed over 9 samples": lambda log, random, seed: _position(
        log, uniform_filter1d(log.position[:, 0], 9)
    ),
    "position low-passed at 5 ms": lambda log, random, seed: _position(
        log, _low_pass(log.position[:, 0], log.period, 5e-3)
    ),
    "torque low-passed at 5 ms": lambda log, random, seed: _torque(log, _low_pass(log.torque[:, 0], log.period, 5e-3)),
    "counts lost": lambda log, random, seed: _lost_counts(log, random),
}


def spoiled(name, seed, law=None):
    """Return a log with an error of `SPOILS`."""
    return SPOILS[name](healthy(seed, law), np.random.default_rng(seed), seed)
