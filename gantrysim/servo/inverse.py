"""Torques that are sent with the setpoints: zero-phase preview, and learning over repeats."""

# ruff: noqa: N803, N806 - functions of z bear the letters of the law

from __future__ import annotations

import numpy as np

from gantrysim.base.arrays import Complexes, Floats
from gantrysim.servo.laws.pid import terms
from gantrysim.servo.laws.selection import base_response
from gantrysim.servo.servo import Servo
from gantrysim.servo.stability.linear_system import Compensator

_TAPS = 2**13  # of a zero-phase filter, on either side
_LIMIT = 1e-2  # angle at which the limit of a filter at rest is taken, relative to the grid's first


def zero_phase(theta: Floats, bandwidth: float, period: float) -> Floats:
    """Return Q, a low-pass without phase: a Butterworth filter of second order, run forwards and backwards.

        Q = 1 / (1 + (tan(theta / 2) / tan(pi f T))^4)

    Args:
        theta: angles 2 pi f T, (n,).
        bandwidth: f, at which Q = 1/2 [Hz].
        period: T [s].
    """
    return np.asarray(1 / (1 + (np.tan(theta / 2) / np.tan(np.pi * bandwidth * period)) ** 4))


class Inverse:
    """The linear machine under a servo, inverted without regard to causes coming before effects.

    Where P(z) has zeros outside the unit circle, as sampled machines have, its stable inverse acts before its input.
    The setpoints are known in advance, so this can be had: it is what zero-phase error tracking approximates
    (Tomizuka, Journal of Dynamic Systems, Measurement, and Control 109, 1987). The inverse is taken on a grid of
    frequencies and truncated to 2^13 periods on either side.

    Args:
        servo: the servo, with the motions of its nominal machine.
    """

    def __init__(self, servo: Servo) -> None:
        self._servo = servo
        n = servo.axes
        self._theta = np.linspace(0, np.pi, _TAPS + 1)
        self._theta[0] = _LIMIT * self._theta[1]
        z = np.exp(1j * self._theta)
        self._z = z
        self._inverse: Complexes = np.zeros((len(z), n, n), complex)
        for first, motion in enumerate(servo.laws.motions):
            drives = servo.loop_drives.of_axes([first]) if len(servo.laws.motions) > 1 else servo.loop_drives
            for system in motion.driven(drives).sampled(servo.period, servo.delay):
                P = system.response(z) * z[:, None, None] ** -servo.feedback_delay
                axes = [first + axis for axis in system.axes]
                self._inverse[np.ix_(range(len(z)), axes, axes)] = np.linalg.inv(P)

    def preview(self, position: Floats) -> Floats:
        """Return the torques with which the encoders of the linear machine read Q of their setpoints, (n, axes) [N·m].

            u = P^-1 Q r - F r - C (1 - Q) r

        F is the law's own feed-forward and C its answer to an error, so that the sum of all is P^-1 Q r. A disturbance
        observer is not in it: it sees none where the machine is as its model.

        Args:
            position: r, at rest at both ends, (n, axes) [u].
        """
        servo = self._servo
        step = 1 - 1 / self._z
        moved = np.diff(position, axis=0, prepend=position[:1])
        H = np.zeros_like(self._inverse)
        for a, bandwidth in enumerate(servo.laws.per_axis("preview_bandwidth")):
            Q = zero_phase(self._theta, bandwidth, servo.period)
            b0, b1, b2, a1, a2 = servo.filters[a]
            notch = (b0 + b1 / self._z + b2 / self._z**2) / (1 + a1 / self._z + a2 / self._z**2)
            per_unit = terms(servo.gains[a])
            speed = (per_unit.demand_velocity + per_unit.measured_velocity) / servo.period
            feed_forward = notch * (speed + per_unit.demand_acceleration * step / servo.period**2)
            H[:, :, a] = self._inverse[:, :, a] * (Q / step)[:, None]
            H[:, a, a] -= feed_forward + self._law(a).response(self._z) * (1 - Q) / step
        return _filtered_sequences(moved, H, "constant")

    def learnt(self, error: Floats) -> Floats:
        """Return by how much the torques must change to take an error away, (n, axes) [N·m].

            du = Q (P^-1 + C) e

        Args:
            error: e, what the encoders lag their setpoints by, (n, axes) [u].
        """
        from scipy.signal import lfilter, ss2tf  # slow to import

        servo = self._servo
        answer = np.empty_like(error)
        H = self._inverse.copy()
        Qs = np.zeros_like(self._inverse)
        for a, bandwidth in enumerate(servo.laws.per_axis("learning_bandwidth")):
            Qs[:, a, a] = zero_phase(self._theta, bandwidth, servo.period)
            law = self._law(a)
            over, under = ss2tf(law.A, law.B[:, None], law.C[None], [[law.D]])
            answer[:, a] = lfilter(over[0], under, error[:, a])
        return _filtered_sequences(error, Qs @ H, "edge") + _filtered_sequences(answer, Qs, "edge")

    def _law(self, axis: int) -> Compensator:
        """Return the law's answer to an error, without feedback delay and observer."""
        servo = self._servo
        return base_response(servo.laws.names, servo.gains[axis], servo.filters[axis], servo.period)


def _filtered_sequences(values: Floats, H: Complexes, mode: str) -> Floats:
    """Return sequences through a filter that acts before and after its input, (n, axes).

    Args:
        values: (n, axes).
        H: response on the grid, from the second axis to the first, (2^13 + 1, axes, axes).
        mode: of the sequences beyond their ends, as of `numpy.pad`.
    """
    from scipy.signal import oaconvolve  # slow to import

    H[0] = H[0].real
    kernels = np.fft.fftshift(np.fft.irfft(H, axis=0), axes=0)  # time 0 at _TAPS
    padded = np.pad(values, ((_TAPS, _TAPS), (0, 0)), mode)  # type: ignore[call-overload]
    out = np.zeros_like(values)
    for to in range(values.shape[1]):
        for by in range(values.shape[1]):
            if np.any(kernels[:, to, by]):
                full = oaconvolve(padded[:, by], kernels[:, to, by])
                out[:, to] += full[2 * _TAPS : 2 * _TAPS + len(values)]
    return out
