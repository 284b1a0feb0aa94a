"""Perturbed machines for the compiled loop, from a few readings of the machine that they are perturbations of.

With the response G of the speeds to forces, and N = G^-1, a physics step v' = A v + B q + c + G f is

    N v' = N A v + N B q + N c + f

N is mass and, where MuJoCo integrates it implicitly, damping over the step's length; N - N A is damping, N B stiffness,
N c weight and where the springs rest. These, and the forces of the springs and dampers, are linear in the payload and
in the factors of viscous friction and of stiffness. MuJoCo is read without a perturbation and once with each of these;
other factors are of motors, which are read from their parameters. That the sums hold is checked against `mj_step`.
"""

# mypy: allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import mujoco
import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit
from gantrysim.engine.linear import (
    Linear,
    Responses,
    agrees,
    could_be_linear,
    linear_machine,
    linear_with,
    read_responses,
)
from gantrysim.machine.compiling import scratch_data
from gantrysim.machine.machine import Machine
from gantrysim.machine.motors import springs_have_axes
from gantrysim.machine.perturbation import VARIED_FACTORS, Perturbation

_REMEMBERED_MACHINES = 16  # machines of which the readings are remembered
# by which effects are read: a difference of 1, so that an effect is the difference of two readings
_PAYLOAD = 1.0  # [kg]
_READ_FACTOR = 2.0


def linear_of(machine: Machine, timestep: float, voltage: bool) -> Linear | None:
    """Return a machine for the compiled loop; None where MuJoCo's step differs from it by more than rounding.

    Args:
        machine: the machine, perturbed or not.
        timestep: see `Machine.stepping`.
        voltage: see there.
    """
    # it moves where the springs rest, by which their stiffness is multiplied
    moves_home = any(perturbation.home_offset != 0.0 for perturbation in machine.perturbations)
    if machine.perturbations and not moves_home:
        family = family_of(machine.nominal, timestep, voltage)
        if family is not None:
            return family.member(machine.perturbations)
    return linear_machine(machine, machine.stepping(timestep, voltage, stops=False))


# numbers of a motor by the factor that multiplies them
_MULTIPLIED = {
    "friction": ("coulomb", "static", "stiffness", "damping"),
    "motor_constant": ("constant_of_motor", "lowest", "highest", "weakest", "strongest"),
}


@dataclass(frozen=True, eq=False)
class Family:
    """A machine's perturbations for the compiled loop.

    Attributes:
        machine: the machine without a perturbation.
        linear: it for the compiled loop.
        sums: N, N A, N B and N c beside one another, without a perturbation, then the effect on them of a kilogram of
            payload, and of the factors of viscous friction and of stiffness, each less 1, (1 + effects, n, 3 n + 1).
        passive: forces of springs and dampers per speed, per place and at rest, likewise,
            (1 + effects, 2 axes, 2 n + 1).
    """

    machine: Machine
    linear: Linear
    sums: Floats
    passive: Floats

    def member(self, perturbations: Sequence[Perturbation]) -> Linear:
        """Return the machine with perturbations, none of which moves its home."""
        names = self.machine.axis_names
        payload = sum(perturbation.payload for perturbation in perturbations)
        factors = {name: np.ones(len(names)) for name in VARIED_FACTORS}
        for perturbation in perturbations:
            for name in VARIED_FACTORS:
                factors[name] *= perturbation.per_axis(name, names)
        of_springs = len(self.sums) - 2 - len(names)
        stiffness = factors["stiffness"][:of_springs]
        sizes = np.concatenate([[1.0, payload], factors["viscous"] - 1.0, stiffness - 1.0])
        plants = self.linear.plant.copy()
        _fill(plants[0], sizes, self.sums, self.passive)
        for factor, numbers in _MULTIPLIED.items():
            for number in numbers:
                plants[number][0, : len(names)] *= factors[factor]
        return replace(self.linear, plant=plants)


@jit
def _fill(plant: Any, sizes: Floats, sums: Floats, passive: Floats) -> None:
    """Write the mechanics of a perturbed machine.

    Args:
        plant: to be written, a record of `PLANT`.
        sizes: of the effects, the first 1, (1 + effects,).
        sums: as in `Family`.
        passive: as in `Family`.
    """
    n = sums.shape[1]
    m = plant.axes
    # impulses: columns that follow from the sums, and one for the force of each axis
    inertia = np.zeros((n, n))
    impulses = np.zeros((n, 2 * n + 1 + m))
    for k in range(len(sizes)):
        for i in range(n):
            for j in range(n):
                inertia[i, j] += sizes[k] * sums[k, i, j]
            for j in range(2 * n + 1):
                impulses[i, j] += sizes[k] * sums[k, i, n + j]
    for a in range(m):
        impulses[plant.dof[a], 2 * n + 1 + a] = 1.0
    solved = np.linalg.solve(inertia, impulses)
    for i in range(n):
        for j in range(n):
            plant.of_speed[i, j] = solved[i, j]
            plant.of_place[i, j] = solved[i, n + j]
        plant.constant[i] = solved[i, 2 * n]
        for a in range(m):
            plant.push[i, a] = solved[i, 2 * n + 1 + a]
    for line in range(2 * m):
        for j in range(n):
            speed = 0.0
            place = 0.0
            for k in range(len(sizes)):
                speed += sizes[k] * passive[k, line, j]
                place += sizes[k] * passive[k, line, n + j]
            plant.passive_of_speed[line, j] = speed
            plant.passive_of_place[line, j] = place
        still = 0.0
        for k in range(len(sizes)):
            still += sizes[k] * passive[k, line, 2 * n]
        plant.passive_at_rest[line] = still


@lru_cache(_REMEMBERED_MACHINES)
def family_of(machine: Machine, timestep: float, voltage: bool) -> Family | None:
    """Return a machine's perturbations for the compiled loop; None where they are not linear, or MuJoCo's step is not.

    Args:
        machine: the machine without a perturbation.
        timestep: see `Machine.stepping`.
        voltage: see there.
    """

    def model_of(perturbed: Machine) -> mujoco.MjModel:
        return perturbed.stepping(timestep, voltage, stops=False)

    model = model_of(machine)
    if not could_be_linear(model):
        return None
    data = scratch_data(model)
    nominal = read_responses(machine, model, data)
    alone = _parts(nominal)
    effects = []
    for perturbation in _read_perturbations(machine):
        changed = machine.perturbed(perturbation)
        parts = _parts(read_responses(changed, model_of(changed), data))
        effects.append([part - part_alone for part, part_alone in zip(parts, alone, strict=True)])
    sums, passive = (np.stack(terms) for terms in zip(alone, *effects, strict=True))
    family = Family(machine, linear_with(nominal, model), sums, passive)
    axes = len(machine.plain_axes)
    # no value is one that was read
    factors = tuple(np.resize([0.6, 1.7], axes).tolist())
    stiffness = factors[::-1] if springs_have_axes(model) else factors[0]
    checked = machine.perturbed(
        Perturbation(payload=0.37, friction=1.3, motor_constant=0.9, viscous=factors, stiffness=stiffness)
    )
    linear = family.member(checked.perturbations)
    return family if agrees(checked, model_of(checked), data, linear) else None


def _read_perturbations(machine: Machine) -> list[Perturbation]:
    """Return the perturbations of whose effects the sums consist."""
    axes = len(machine.plain_axes)
    of_axes = [tuple(np.where(np.arange(axes) == a, _READ_FACTOR, 1.0).tolist()) for a in range(axes)]
    springs = of_axes if springs_have_axes(machine.layout) else [_READ_FACTOR]
    return [
        Perturbation(payload=_PAYLOAD),
        *(Perturbation(viscous=factors) for factors in of_axes),
        *(Perturbation(stiffness=factors) for factors in springs),
    ]


def _parts(responses: Responses) -> tuple[Floats, Floats]:
    """Return what is linear in a perturbation, as `Family` has it."""
    of_place, of_speed, of_force, at_zero = responses
    n = of_force.shape[1]
    inverse = np.linalg.inv(of_force[:n])
    sums = inverse @ np.concatenate([of_speed[:n], of_place[:n], at_zero[:n, None]], axis=1)
    # springs and dampers, without the nozzle
    rows = slice(n, -3)
    passive = np.concatenate([of_speed[rows], of_place[rows], at_zero[rows, None]], axis=1)
    return np.concatenate([inverse, sums], axis=1), passive
