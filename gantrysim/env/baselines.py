"""Classical adaptive policies, against which a learnt one is to be compared. They act on observations alone."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gantrysim.env.bead_width import BeadWidthEnv
from gantrysim.env.episodes import TUNED_GAINS
from gantrysim.env.inertia import MOST_PAYLOAD
from gantrysim.env.sensitivity import SensitivityTable
from gantrysim.env.servo_torque import ServoTorqueEnv
from gantrysim.env.speed_override import SpeedOverrideEnv
from gantrysim.env.spiral_tuning import SpiralTuningEnv
from gantrysim.machine.perturbation import Perturbation

Policy = Callable[[NDArray[np.float32]], NDArray[np.float32]]


def width_feedback(env: BeadWidthEnv, gain: float) -> Policy:
    """Return integral control of the width that the camera measures.

    The width goes with the pressure to the power 1 / (2 n), so that the logarithm of the override is to change by -2 n
    times the relative error; a share of it, the gain, is corrected at each decision.

    Args:
        env: its environment.
        gain: share of the error, above 0.
    """
    error = env.observation_names.index("width_error")
    settings = env.settings
    factor = -gain * 2 * settings.index * settings.tolerance / settings.step

    def policy(observation: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.clip([factor * observation[error]], -1.0, 1.0).astype(np.float32)

    return policy


def slow_at_reversals(env: SpeedOverrideEnv, speed: float) -> Policy:
    """Return a speed schedule: slow where an axis reverses, where friction throws the nozzle off the path.

    From `_AHEAD_OF_REVERSAL` ahead of a reversal until `_BEHIND_REVERSAL` behind it the speed wanted is the slow one,
    ahead of that sqrt(speed² + 2 a d) with a share a of the acceleration and the distance d, elsewhere `_TOP_OVERRIDE`
    times the program's.

    Args:
        env: its environment.
        speed: slow speed [mm/s].
    """
    settings = env.settings
    names = env.observation_names
    low = math.log(settings.slowest)
    high = math.log(settings.fastest)
    braking = 2 * _BRAKING_SHARE * settings.acceleration

    def policy(observation: NDArray[np.float32]) -> NDArray[np.float32]:
        seen = dict(zip(names, observation.tolist(), strict=True))
        near = seen["to_reversal_near"]
        far = 10 * seen["to_reversal"]
        ahead = near if near < 1 else far
        moves_on = 100 * seen["speed"] * settings.decision_interval  # until the next decision
        ahead = math.inf if far >= 10 else max(ahead - _AHEAD_OF_REVERSAL - moves_on, 0.0)
        # from which it can brake to the slow speed until the reversal
        fastest = math.sqrt(speed**2 + braking * ahead)
        wanted = speed if 10 * seen["since_reversal"] <= _BEHIND_REVERSAL else fastest
        override = np.clip(math.log(min(wanted / (100 * seen["program_speed"]), _TOP_OVERRIDE)), low, high)
        present = low + 0.5 * (seen["override"] + 1) * (high - low)
        return np.clip([(override - present) / settings.step], -1.0, 1.0).astype(np.float32)

    return policy


def friction_compensation(env: ServoTorqueEnv, share: float) -> Policy:
    """Return friction compensation at the level of friction that is estimated while the nozzle moves.

    Args:
        env: its environment.
        share: of the missing level, added at each decision.
    """
    missing = [k for k, name in enumerate(env.observation_names) if name.startswith("missing_")]

    def policy(observation: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.clip(share * observation[missing], -1.0, 1.0)

    return policy


def gain_schedule(env: SpiralTuningEnv, caution: float) -> Policy:
    """Return a gain schedule over the payload, estimated from the fitted inertia.

    kp, with ki, and kd are those of the largest kp that keeps |S| <= 2 on the nominal machine with this payload;
    acceleration_ff is the nominal one times the fitted ratio of inertia.

    Args:
        env: its environment.
        caution: payload added to the fitted one for kp and kd [kg].
    """
    source = env._episodes.source
    names = env.observation_names
    fitted = names.index("inertia")
    present = slice(names.index("gain_kp"), names.index("gain_kp") + len(TUNED_GAINS))
    reach = math.log(env.settings.gain_range)
    steps = np.array(env.settings.step)
    machine = source.machine
    loaded = machine.perturbed(Perturbation(payload=1.0))
    inertia = [axis.inertia for axis in machine.axes]
    square = sum(nominal * nominal for nominal in inertia)
    product = sum(axis.inertia * nominal for axis, nominal in zip(loaded.axes, inertia, strict=True))
    # what 1 kg adds to the ratio fitted to all axes
    per_kg = product / square - 1
    payloads = np.arange(0.0, MOST_PAYLOAD + 1.0, 0.5)
    gains = _stiffest(SensitivityTable(machine, source.servo, env.settings.gain_range), payloads)

    def policy(observation: NDArray[np.float32]) -> NDArray[np.float32]:
        ratio = max(float(observation[fitted]), 1.0 / env.settings.gain_range)
        payload = (ratio - 1) / per_kg + caution
        kp, kd = (np.interp(payload, payloads, gain) for gain in gains.T)
        wanted = np.array([kp, kd, 0.0, math.log(ratio) / reach])
        change = (wanted - observation[present]) * reach / steps
        return np.clip(change, -1.0, 1.0).astype(np.float32)

    return policy


def _stiffest(sensitivity: SensitivityTable, payloads: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the actions of kp and kd for ascending payloads, (payloads, 2).

    Their kp is the largest that keeps the limit, but no larger than for a smaller payload; kd is the least with it.
    """
    steps = np.linspace(-1.0, 1.0, 2 * _GAIN_STEPS + 1).tolist()
    stiffest = []
    pairs = itertools.product(steps[::-1], steps)
    kp, kd = next(pairs)
    for payload in payloads:
        while sensitivity.cost([[[kp], [kd], [0.0], [0.0]]], payload) > 0:
            kp, kd = next(pairs, (kp, kd))
            if kp == -1.0 and kd == 1.0:  # none does
                break
        stiffest.append((kp, kd))
    return np.array(stiffest)


_GAIN_STEPS = 16  # of gains tried, per range
_AHEAD_OF_REVERSAL = 0.3  # where it moves slowly, ahead of a reversal [mm]
_BEHIND_REVERSAL = 1.0  # the same behind it: friction has reversed by then [mm]
_BRAKING_SHARE = 0.7  # share of the acceleration
_TOP_OVERRIDE = 1.5  # override between reversals

CLASSICAL: dict[str, Callable[[Any, float], Policy]] = {
    "BeadWidth": width_feedback,
    "SpeedOverride": slow_at_reversals,
    "ServoTorque": friction_compensation,
    "SpiralTuning": gain_schedule,
}
