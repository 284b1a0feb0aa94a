"""Input shapers for the first mode of each axis: impulses that leave a swinging mode at rest.

ZV and MZV by Singer and Seering (1990) in the forms of Klipper, EI by Singhose, Seering and Singer (1994) with 5 % of
vibration permitted. With the natural frequency f and damping ratio z, the damped period is t = 1 / (f sqrt(1 - z^2)).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigvals

from gantrysim.base.arrays import Complexes, Floats
from gantrysim.base.errors import InputError, between, positive, unknown
from gantrysim.machine.axis import Axis
from gantrysim.servo.stability.motion import Motion

SHAPERS = ("zv", "mzv", "ei")
_SHAPED = ("x", "y", "z")
_VIBRATION = 0.05  # that EI leaves at the frequency itself
_LARGEST_DAMPING = 0.99
_REAL_ZERO = 1e-6  # imaginary part of a zero that is rounding, of its size
_FASTEST_ZERO = 2 * math.pi * 1e5  # of a zero that is not infinite but for rounding [1/s]


@dataclass(frozen=True)
class Mode:
    """The mode of an axis behind its motor.

    Attributes:
        axis: name of the axis.
        frequency: undamped natural frequency with the motor held [Hz].
        damping: damping ratio.
    """

    axis: str
    frequency: float
    damping: float


def first_mode(axis: Axis) -> Mode | None:
    """Return the lowest mode that swings while the motors of all axes are held; None for a rigid axis.

    The modes of an axis with its motor held are the zeros of its motion from torque to motor position.

    Raises:
        InputError: an axis that cannot be linearised.
    """
    if axis.motion is None:
        raise InputError(f"axis {axis.name}: its actuator has a delay in the MJCF, so its modes are not known")
    zeros = _zeros(axis.motion)
    swinging = zeros[zeros.imag > _REAL_ZERO * np.abs(zeros)]
    if not swinging.size:
        return None
    zero = swinging[np.abs(swinging).argmin()]
    size = float(np.abs(zero))
    return Mode(axis.name, size / (2 * math.pi), float(-zero.real) / size)


def _zeros(motion: Motion) -> Complexes:
    """Return the finite z at which [[A - z, B], [C, 0]] is singular, in rows and columns of one size."""
    n = len(motion.A)
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n] = motion.A
    whole[:n, n] = motion.B[:, 0] / np.abs(motion.B).max() * np.abs(motion.A).max()
    whole[n, :n] = motion.C[0] / np.abs(motion.C).max()
    shift = np.diag([*np.ones(n), 0.0])
    zeros = eigvals(whole, shift)
    return zeros[np.isfinite(zeros) & (np.abs(zeros) < _FASTEST_ZERO)]


def pulses(kind: str, frequency: float, damping: float) -> tuple[Floats, Floats]:
    """Return the amplitudes of a shaper, which add up to 1, and their times, (n,) [s].

    With K = exp(-z pi / sqrt(1 - z^2)):

        zv   1, K                                         at 0, t/2
        mzv  1 - 1/sqrt 2, (sqrt 2 - 1) K', (1 - 1/sqrt 2) K'^2, K' = K^(3/4)   at 0, 3t/8, 3t/4
        ei   (1 + v)/4, (1 - v)/2 K, (1 + v)/4 K^2, v = 5 %                     at 0, t/2, t

    Args:
        kind: "zv", "mzv" or "ei".
        frequency: [Hz].
        damping: ratio, below 0.99.

    Raises:
        InputError: another kind, or a value out of its bounds.
    """
    between("damping", damping, 0, _LARGEST_DAMPING)
    root = math.sqrt(1 - damping**2)
    t = 1 / (positive("frequency", frequency, "Hz") * root)
    decay = math.exp(-damping * math.pi / root)
    if kind == "zv":
        sizes = [1.0, decay]
        times = [0, t / 2]
    elif kind == "mzv":
        less = decay**0.75
        outer = 1 - 1 / math.sqrt(2)
        sizes = [outer, (math.sqrt(2) - 1) * less, outer * less**2]
        times = [0, 3 * t / 8, 3 * t / 4]
    elif kind == "ei":
        edge = (1 + _VIBRATION) / 4
        middle = (1 - _VIBRATION) / 2
        sizes = [edge, middle * decay, edge * decay**2]
        times = [0, t / 2, t]
    else:
        raise unknown("shaper", kind, SHAPERS)
    amplitudes = np.array(sizes)
    return amplitudes / amplitudes.sum(), np.array(times, float)


def klipper(axes: Iterable[Axis], kind: str = "mzv") -> tuple[str, list[str]]:
    """Return the section [input_shaper] of a Klipper configuration, and notes on axes without a mode.

    Raises:
        InputError: no axis of the machine swings.
    """
    lines = ["[input_shaper]"]
    notes = []
    for axis in axes:
        mode = first_mode(axis) if axis.name in _SHAPED else None
        if axis.name not in _SHAPED:
            notes.append(f"axis {axis.name}: Klipper shapes the axes {', '.join(_SHAPED)} alone: left out")
        elif mode is None:
            notes.append(f"axis {axis.name}: no mode swings behind its motor, it needs no shaper")
        if mode is None:
            continue
        for shaper in SHAPERS:
            sizes, times = pulses(shaper, mode.frequency, mode.damping)
            impulses = ", ".join(f"{size:.4f} at {1e3 * time:.3f} ms" for size, time in zip(sizes, times, strict=True))
            lines.append(f"# {axis.name}: {shaper} {impulses}")
        lines += [
            f"shaper_type_{axis.name}: {kind}",
            f"shaper_freq_{axis.name}: {mode.frequency:.4f}",
            f"damping_ratio_{axis.name}: {mode.damping:.6f}",
        ]
    if len(lines) == 1:
        raise InputError(f"input shaper: there is nothing to shape: {'; '.join(notes)}")
    return "\n".join(lines) + "\n", notes
