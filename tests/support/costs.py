"""The cost of gains beyond the tuner's limit of |S|, from the loop's response on a dense grid."""

import numpy as np

from gantrysim.machine.perturbation import Perturbation
from gantrysim.servo.stability.margins import Plant

DENSE = np.linspace(1.0, 500.0, 20_000)  # Hz, up to half the servo's frequency


def expected_cost(machine, servo, kp, kd, payload=0.0):
    """The cost of a servo whose kp and ki, and whose kd, of all axes are multiplied, one or (axes,) each."""
    gains = {"kp": kp, "ki": kp, "kd": kd}
    servo = servo.with_values(**{name: tuple(np.array(servo.per_axis(name)) * own) for name, own in gains.items()})
    plant = Plant.of(machine.perturbed(Perturbation(payload=payload)), servo.period, servo.delay)
    if np.abs(plant.poles(servo)).max() >= 1:
        return 1.0
    peak = np.abs(1 / (1 + plant.loop(servo, DENSE))).max()
    return min(max(peak / 2 - 1, 0.0), 1.0)
