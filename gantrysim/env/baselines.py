"""Classical adaptive policies, against which a learnt one is to be compared. They act on observations alone."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gantrysim.env.bead_width import BeadWidthEnv
from gantrysim.env.servo_torque import ServoTorqueEnv
from gantrysim.env.speed_override import SpeedOverrideEnv

Policy = Callable[[NDArray[np.float32]], NDArray[np.float32]]


def width_feedback(env: BeadWidthEnv, gain: float) -> Policy:
    """Return integral control of the width that the camera measures.

    The width goes with the pressure to the power 1 / (2 n), so that the logarithm of the override is to change by -2 n
    times the relative error; a share of it, the gain, is corrected at each decision.

    Args:
        env: its environment.
        gain: share of the error, above 0.
    """
    at, settings = env.observation_names.index("width_error"), env.settings
    factor = -gain * 2 * settings.index * settings.tolerance / settings.step

    def policy(observation: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.clip([factor * observation[at]], -1.0, 1.0).astype(np.float32)

    return policy


def slow_at_reversals(env: SpeedOverrideEnv, speed: float) -> Policy:
    """Return a speed schedule: slow where an axis reverses, where friction throws the nozzle off the path.

    From `_BEFORE` ahead of a reversal until `_AFTER` behind it the speed wanted is the slow one, ahead of that
    sqrt(speed² + 2 a d) with a share a of the acceleration and the distance d, elsewhere `_TOP` times the program's.

    Args:
        env: its environment.
        speed: slow speed [mm/s].
    """
    settings, names = env.settings, env.observation_names
    low, high = math.log(settings.slowest), math.log(settings.fastest)
    braking = 2 * _BRAKING * settings.acceleration

    def policy(observation: NDArray[np.float32]) -> NDArray[np.float32]:
        seen = dict(zip(names, observation.tolist(), strict=True))
        near, far = seen["to_reversal_near"], 10 * seen["to_reversal"]
        ahead = near if near < 1 else far
        moves_on = 100 * seen["speed"] * settings.decision_interval  # until the next decision
        ahead = math.inf if far >= 10 else max(ahead - _BEFORE - moves_on, 0.0)
        wanted = speed if 10 * seen["since_reversal"] <= _AFTER else math.sqrt(speed**2 + braking * ahead)
        override = np.clip(math.log(min(wanted / (100 * seen["program_speed"]), _TOP)), low, high)
        present = low + 0.5 * (seen["override"] + 1) * (high - low)
        return np.clip([(override - present) / settings.step], -1.0, 1.0).astype(np.float32)

    return policy


def friction_compensation(env: ServoTorqueEnv, share: float) -> Policy:
    """Return the change of the level to that of the friction, as it is fitted while the nozzle moves.

    Args:
        env: its environment.
        share: of the level that is missing, which is made up for at each decision.
    """
    missing = [k for k, name in enumerate(env.observation_names) if name.startswith("missing_")]

    def policy(observation: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.clip(share * observation[missing], -1.0, 1.0)

    return policy


_BEFORE, _AFTER = 0.3, 1.0  # where it moves slowly, ahead of a reversal and behind it [mm]
_BRAKING = 0.7  # share of the acceleration
_TOP = 1.5  # override between reversals

CLASSICAL: dict[str, Callable[[Any, float], Policy]] = {
    "BeadWidth": width_feedback,
    "SpeedOverride": slow_at_reversals,
    "ServoTorque": friction_compensation,
}
