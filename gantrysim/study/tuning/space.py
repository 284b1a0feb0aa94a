"""The search space: the coordinates that a search moves, and the gains that follow from them.

With J the inertia of an axis at its motor and b its viscous torque per speed, a servo has the numbers

    w     natural frequency           kp = J w^2
    zeta  damping ratio               kd = 2 zeta J w
    n     integral time times w       ki = kp w / n
    v     share of b                  velocity_ff = v b
    a     share of J                  acceleration_ff = a J

The coordinates of w, zeta and n are logarithmic, u = log10(number / natural number). kp, kd and ki are powers and
products of them: w alone scales the bandwidth, zeta alone the damping. The natural numbers are those of
`Servo.derive`. A feed-forward may be zero, so v and a = sinh(2 u) / sinh(2): linear near 0, logarithmic far beyond 1.
Where an axis has no viscous torque, a hundredth of the derived kd replaces b.

A servo may damp by its measured velocity instead of the change of the error. With dE = dDPOS - dMPOS

    kd dE/T + velocity_ff dDPOS/T + output_velocity dMPOS/T

is the same with kd - output_velocity, velocity_ff + output_velocity and 0; the start of the search is converted so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.servo.axis_dynamics import AxisDynamics
from gantrysim.servo.servo import Servo

SEARCHED_GAINS = ("kp", "ki", "kd", "velocity_ff", "acceleration_ff")  # the gains that a search space sets
_COORDINATES = {"ki": "n", "velocity_ff": "v", "acceleration_ff": "a"}  # of the gains that may be held at zero
SPACES = {"pd": ("w", "zeta", "v", "a"), "pid": ("w", "zeta", "n", "v", "a")}

_INTEGRAL = 5.0  # natural n: the integral term then takes atan(1 / n), 11 degrees, of the phase at w
_VISCOUS_SHARE = 0.01  # of kd, in place of b where an axis has none
_DIGITS = 4  # of a gain, as a drive's parameters have them

# Bounds of a shape: a decade beyond start and natural number; feed-forwards from 0 to 100 times the natural one.
_DECADES_BEYOND = 1.0
_FEEDFORWARD_BOUNDS = (0.0, 100.0)
_LINEAR_UP_TO = 2.0  # where the scale of v and a turns from linear to logarithmic


@dataclass(frozen=True)
class SearchSpace:
    """Coordinates of the gains: one set for all axes, or one for each.

    A point has two parts: the frequencies, log10(w / natural w), (groups,), and the shape, the coordinates of the
    other numbers one after the other, (shapes,). Axes that share their numbers are one group.

    Attributes:
        name: "pd" or "pid".
        axes: of the machine.
        derived: servo of the same period and delay with the gains of `Servo.derive`.
        start: servo at which the search starts.
        per_axis: whether every axis has numbers of its own.
        held: gains held at zero, such as those that a controller has no word for: ki, velocity_ff or acceleration_ff.
    """

    name: str
    axes: Sequence[AxisDynamics]
    derived: Servo
    start: Servo
    per_axis: bool = False
    held: tuple[str, ...] = ()

    @property
    def gains(self) -> tuple[str, ...]:
        """Names of the gains that are searched."""
        return tuple(gain for gain in SEARCHED_GAINS if _COORDINATES.get(gain, "w") in self.coordinates)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Letters of the coordinates, see the module."""
        held = [_COORDINATES.get(gain) for gain in self.held]
        return tuple(letter for letter in SPACES[self.name] if letter not in held)

    @property
    def groups(self) -> int:
        """Number of groups of axes."""
        return len(self.axes) if self.per_axis else 1

    @cached_property
    def begin(self) -> tuple[Floats, Floats]:
        """Frequencies and shape of the start, within the bounds.

        A gain that is not above zero begins at its natural number, a feed-forward at zero; axes that share a
        coordinate begin at its mean.
        """
        numbers = self._numbers(self.start)
        natural = self._natural
        coordinates = {}
        for name in self.coordinates:
            share = numbers[name] / natural[name]
            if name in "va":
                coordinates[name] = np.arcsinh(np.maximum(share, 0) * math.sinh(_LINEAR_UP_TO)) / _LINEAR_UP_TO
            else:
                usable = np.isfinite(share) & (share > 0)
                coordinates[name] = np.log10(np.where(usable, share, 1.0))
        grouped = np.stack(list(coordinates.values())).reshape(len(coordinates), self.groups, -1).mean(axis=2)
        shape = grouped[1:].ravel()
        return grouped[0], np.clip(shape, *self._bounds_of(shape).T)

    @property
    def natural(self) -> Floats:
        """The shape of the natural numbers, within the bounds, (shapes,)."""
        return np.repeat([1.0 if name in "va" else 0.0 for name in self.coordinates[1:]], self.groups)

    @cached_property
    def bounds(self) -> Floats:
        """Lower and upper bounds of a shape, (shapes, 2)."""
        return self._bounds_of(self.begin[1])

    def servo(self, frequencies: Floats, shape: Floats) -> Servo:
        """Return the servo at a point, its gains rounded to four digits.

        Args:
            frequencies: (groups,).
            shape: (shapes,).
        """
        names = self.coordinates[1:]
        number = {"w": self._natural["w"] * 10.0**frequencies}
        for name, u in zip(names, shape.reshape(len(names), self.groups), strict=True):
            share = np.sinh(_LINEAR_UP_TO * u) / math.sinh(_LINEAR_UP_TO) if name in "va" else 10.0**u
            number[name] = self._natural[name] * share
        w = number["w"]
        kp = self._inertia * number["w"] ** 2
        gains = {
            "kp": kp,
            "ki": kp * w / number["n"] if "n" in number else 0.0 * kp,
            "kd": 2 * number["zeta"] * self._inertia * w,
            "velocity_ff": number.get("v", 0.0) * self._viscous,
            "acceleration_ff": number.get("a", 0.0) * self._inertia,
            "output_velocity": 0.0 * kp,
        }
        rounded: dict[str, Any] = {
            name: tuple(float(f"{gain:.{_DIGITS}g}") for gain in values.tolist()) for name, values in gains.items()
        }
        return self.start.with_values(**rounded)

    def _bounds_of(self, shape: Floats) -> Floats:
        names = np.repeat(self.coordinates[1:], self.groups)
        low = math.asinh(_FEEDFORWARD_BOUNDS[0] * math.sinh(_LINEAR_UP_TO)) / _LINEAR_UP_TO
        high = math.asinh(_FEEDFORWARD_BOUNDS[1] * math.sinh(_LINEAR_UP_TO)) / _LINEAR_UP_TO
        linear = np.isin(names, ("v", "a"))
        return np.stack(
            [
                np.where(linear, low, np.minimum(shape, 0) - _DECADES_BEYOND),
                np.where(linear, high, np.maximum(shape, 0) + _DECADES_BEYOND),
            ],
            axis=1,
        )

    @cached_property
    def _inertia(self) -> Floats:
        """J, (axes,)."""
        return np.array([axis.inertia for axis in self.axes])

    @cached_property
    def _viscous(self) -> Floats:
        """b, (axes,)."""
        viscous = np.array([axis.viscous for axis in self.axes])
        return np.where(viscous > 0, viscous, _VISCOUS_SHARE * np.array(self.derived.per_axis("kd")))

    @cached_property
    def _natural(self) -> dict[str, Floats]:
        ones = np.ones(len(self.axes))
        derived = self._numbers(self.derived)
        return {"w": derived["w"], "zeta": derived["zeta"], "n": _INTEGRAL * ones, "v": ones, "a": ones}

    def _numbers(self, servo: Servo) -> dict[str, Floats]:
        """Return the numbers of a servo, (axes,); not finite or not above zero where it has none."""
        kp = np.array(servo.per_axis("kp"))
        output_velocity = np.array(servo.per_axis("output_velocity"))
        # damping by the measured velocity is damping by the error and a velocity feed-forward, see the module
        kd = np.array(servo.per_axis("kd")) - output_velocity
        velocity_ff = np.array(servo.per_axis("velocity_ff")) + output_velocity
        with np.errstate(divide="ignore", invalid="ignore"):
            w = np.sqrt(kp / self._inertia)
            return {
                "w": w,
                "zeta": kd / (2 * self._inertia * w),
                "n": kp * w / np.array(servo.per_axis("ki")),
                "v": velocity_ff / self._viscous,
                "a": np.array(servo.per_axis("acceleration_ff")) / self._inertia,
            }
