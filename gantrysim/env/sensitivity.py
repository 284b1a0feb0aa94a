"""Distance of an agent's gains from instability: a table of the peaks of |S| for a machine and its payload."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats
from gantrysim.env.episodes import SCALED, TUNED_GAINS, gain_factors
from gantrysim.machine.machine import Machine
from gantrysim.machine.perturbation import Perturbation
from gantrysim.servo.derivation import LARGEST_PEAK
from gantrysim.servo.servo import Servo
from gantrysim.servo.stability.margins import Plant, sensitivities
from gantrysim.servo.stability.motion import UnknownLoopError

_TABLE_STEPS = 16  # of the table per unit of the action
_PAYLOADS = 8  # of the table per kilogram
_REMEMBERED_COSTS = 2**16  # costs, of which there are more than memory where every axis has gains of its own
_LOOP = [TUNED_GAINS.index(name) for name in ("kp", "kd")]  # the feed-forward is outside of the loop


class SensitivityTable:
    """Peaks of |S| by action, each computed when it is first asked for.

    Actions are rounded to 1/16, that is gains to `gain_range`^(1/32), 7 % for a range of 10, and payloads to 1/8 kg.

    Args:
        machine: the nominal machine.
        servo: servo with the gains of the action 0.
        gain_range: largest factor by which an action raises or lowers a gain.
        varies: whether it is asked for many payloads. It then computes the peaks with all payloads of the same kilogram
            together, which takes three times as long as one of them does.
    """

    def __init__(self, machine: Machine, servo: Servo, gain_range: float, varies: bool = False) -> None:
        self._machine = machine
        self._together = _PAYLOADS if varies else 1
        self._servo = servo
        self._range = gain_range
        self._peaks: dict[tuple[int, ...], Floats] = {}
        self._cost = lru_cache(_REMEMBERED_COSTS)(self._computed_cost)
        self._plants: dict[int, Plant | None] = {}
        # costs of gains common to all axes, by payload
        self._common: dict[int, Floats] = {}

    def _plant(self, payload: int) -> Plant | None:
        """Return the plant with a payload, in steps of the table."""
        if payload not in self._plants:
            servo = self._servo
            machine = self._machine
            if payload:
                machine = machine.perturbed(Perturbation(payload=payload / _PAYLOADS))
            try:
                servo.compensators()
                self._plants[payload] = Plant.of(machine, servo.period, servo.delay, drives=servo.loop_drives)
            except UnknownLoopError:
                self._plants[payload] = None
        return self._plants[payload]

    def cost(self, actions: ArrayLike, payloads: ArrayLike = 0.0) -> Floats:
        """Return how far the worst axis is beyond a peak of 2: 0 up to 2, 1 from 4 on and where it is unstable, (n,).

            cost = min(max(max |S| / 2 - 1, 0), 1)

        It is 0 of a loop that cannot be linearised: a user's own law that is not linear, or a delay in the MJCF.

        Args:
            actions: (n, gains of `TUNED_GAINS`, 1 or axes), from -1 to 1.
            payloads: of the machines, beyond the nominal one's, one or (n,) [kg].
        """
        steps = np.rint(np.asarray(actions, float)[:, _LOOP] * _TABLE_STEPS).astype(int)
        loads = np.rint(np.multiply(payloads, _PAYLOADS)).astype(int)
        if loads.ndim == 0 and steps.shape[2] == 1 and np.abs(steps).max(initial=0) <= _TABLE_STEPS:
            return self._of_common(steps[:, 0, 0], steps[:, 1, 0], int(loads))
        keys = np.column_stack([np.broadcast_to(loads, len(steps)), steps.reshape(len(steps), -1)]).tolist()
        return np.array([self._cost(*key) for key in keys])

    def _of_common(self, kp: NDArray[np.int_], kd: NDArray[np.int_], payload: int) -> Floats:
        """Return the costs of gains that all axes have in common, in steps of the table, from an array of them, (n,).

        A look into a dictionary for each would take longer than all else that follows from an action.
        """
        if payload not in self._common:
            self._common[payload] = np.full((2 * _TABLE_STEPS + 1, 2 * _TABLE_STEPS + 1), np.nan)
        table = self._common[payload]
        costs = table[kp + _TABLE_STEPS, kd + _TABLE_STEPS]
        unknown = np.isnan(costs)
        if unknown.any():
            for k in np.flatnonzero(unknown).tolist():
                costs[k] = self._cost(payload, int(kp[k]), int(kd[k]))
            table[kp + _TABLE_STEPS, kd + _TABLE_STEPS] = costs
        return costs

    def _computed_cost(self, payload: int, *gains: int) -> float:
        """Return the cost with a payload and with gains in steps of the table, the axes of kp, then those of kd."""
        plant = self._plant(payload)
        if plant is None:
            return 0.0
        steps = np.broadcast_to(np.reshape(gains, (len(_LOOP), -1)), (len(_LOOP), plant.axes))
        # an axis depends on its own gains alone
        if all(len(group) == 1 for group in plant.groups):
            worst = max(self._peak(payload, np.repeat(steps[:, [a]], plant.axes, axis=1))[a] for a in range(plant.axes))
        else:
            worst = self._peak(payload, steps).max()
        return min(max(float(worst) / LARGEST_PEAK - 1.0, 0.0), 1.0) if math.isfinite(worst) else 1.0

    def _peak(self, payload: int, steps: NDArray[np.int_]) -> Floats:
        """Return the peak of |S| of each axis with gains in steps of the table, (axes,)."""
        gains = tuple(steps.ravel().tolist())
        if (payload, *gains) not in self._peaks:
            first = payload - payload % self._together
            plants = {load: self._plant(load) for load in range(first, first + self._together)}
            known = {load: plant for load, plant in plants.items() if plant is not None}
            action = np.zeros((len(TUNED_GAINS), steps.shape[1]))
            action[_LOOP] = steps / _TABLE_STEPS
            servo = scaled_gains(self._servo, gain_factors(action, self._range))
            for load, peaks in zip(known, sensitivities(list(known.values()), servo), strict=True):
                self._peaks[load, *gains] = peaks
        return self._peaks[payload, *gains]


def scaled_gains(servo: Servo, factors: Mapping[str, Floats]) -> Servo:
    """Return a servo whose gains of `SCALED` are multiplied, each by one factor per axis."""
    gains: dict[str, Any] = {name: tuple((factors[name] * np.array(servo.per_axis(name))).tolist()) for name in SCALED}
    return servo.with_values(**gains)
