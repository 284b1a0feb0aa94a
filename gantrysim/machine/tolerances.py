"""How far machines that are built to one drawing differ."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from gantrysim.arrays import Floats
from gantrysim.errors import InputError, at_least, unknown, whole
from gantrysim.machine.machine import Machine
from gantrysim.machine.perturbation import FACTORS, Perturbation


@dataclass(frozen=True)
class Tolerances:
    """How far machines differ; what is 0 does not.

    A payload lies evenly between 0 and its spread. A factor lies between 1 / (1 + spread) and 1 + spread, evenly on a
    logarithmic scale, so that half of the machines have more than the nominal one and half have less; each axis has
    its own. The default values are assumptions: friction and its viscous part vary most from machine to machine,
    with preload, seals and grease; motor constants are of a catalogue's tolerance.

    Attributes:
        payload: [kg].
        friction: of the Coulomb and static friction, relative.
        viscous: of the viscous friction, relative.
        stiffness: of the drive trains' springs, relative.
        motor_constant: of the motors, relative.
    """

    payload: float = 0.3
    friction: float = 0.5
    viscous: float = 0.5
    stiffness: float = 0.3
    motor_constant: float = 0.1

    def __post_init__(self) -> None:
        for f in fields(self):
            at_least(f"spread of {f.name}", getattr(self, f.name), 0, "kg" if f.name == "payload" else "")

    @classmethod
    def parse(cls, text: str) -> Tolerances:
        """Return a spread from words, as in "payload=0.5,friction=0.3"; what is left out keeps its default.

        Raises:
            InputError: words that are none of this.
        """
        values: dict[str, float] = {}
        known = [f.name for f in fields(cls)]
        for item in filter(None, (part.strip() for part in text.split(","))):
            name, _, value = (part.strip() for part in item.partition("="))
            if name not in known:
                raise unknown("spread", name, known)
            try:
                values[name] = float(value)
            except ValueError:
                raise InputError(f"spread {item}: must be {name}= and a number") from None
        return cls(**values)

    def draw(self, random: np.random.Generator, machine: Machine) -> Perturbation:
        """Return one machine at random.

        It takes 1 + 4 axes numbers from the generator, whatever is 0, so that of one seed a factor is the same
        whichever others differ.

        Args:
            random: where the numbers come from.
            machine: the nominal machine, for its axes.
        """
        axes = machine.axis_names
        unit = random.random(1 + len(FACTORS) * len(axes))
        numbers = dict(zip(("payload_kg", *(f"{name}_{axis}" for name in FACTORS for axis in axes)), unit, strict=True))
        numbers |= {name: numbers[f"{name}_{axes[0]}"] for name in FACTORS}  # those of all axes
        columns = self.columns(machine)
        values = {name: float(_scaled(name, spread, numbers[name])) for name, spread in columns.items()}
        return self.perturbation(values, machine)

    def machines(self, machine: Machine, count: int, seed: int) -> list[Perturbation]:
        """Return machines from a Latin hypercube: of n machines each factor has one in each n-th of its range.

        Args:
            machine: the nominal machine, for its axes.
            count: number n of machines.
            seed: of the random numbers; the same seed draws the same machines.

        Raises:
            InputError: a count or a seed that is no whole number, or is below 1 or 0.
        """
        values = self.hypercube(machine, count, seed)
        return [
            self.perturbation({name: float(column[k]) for name, column in values.items()}, machine)
            for k in range(int(count))
        ]

    def hypercube(self, machine: Machine, count: int, seed: int) -> dict[str, Floats]:
        """Return the same machines as values of every factor that differs, by the name of its column, (count,)."""
        from scipy.stats.qmc import LatinHypercube  # slow to import, and not needed to draw one machine

        count, seed = whole("number of machines", count, 1), whole("seed", seed, 0)
        columns = self.columns(machine)
        unit = LatinHypercube(len(columns), rng=seed).random(count)
        return {name: _scaled(name, spread, unit[:, k]) for k, (name, spread) in enumerate(columns.items())}

    def columns(self, machine: Machine) -> dict[str, float]:
        """Return the spread of every factor that differs, by the name of its column, as friction_x."""
        spreads = {"payload_kg": self.payload} if self.payload else {}
        for name in FACTORS:
            if spread := getattr(self, name):
                each = name != "stiffness" or machine.springs_have_axes
                spreads |= {f"{name}_{axis}": spread for axis in machine.axis_names} if each else {name: spread}
        return spreads

    @staticmethod
    def perturbation(values: Mapping[str, float], machine: Machine) -> Perturbation:
        """Return the perturbation of the values of one machine by the names of their columns."""
        axes = machine.axis_names
        given: dict[str, Any] = {}
        for name in FACTORS:
            if name in values:
                given[name] = values[name]
            elif f"{name}_{axes[0]}" in values:
                given[name] = tuple(values[f"{name}_{axis}"] for axis in axes)
        return Perturbation(payload=values.get("payload_kg", 0.0), **given)


def _scaled(name: str, spread: float, unit: Floats) -> Floats:
    """Turn numbers from 0 to 1 into payloads or factors of a spread."""
    return spread * unit if name == "payload_kg" else (1 + spread) ** (2 * unit - 1)


def in_words(factor: str) -> str:
    """Return what a factor of `Tolerances` or of a study's columns is called, as in "friction of x"."""
    words = {
        "payload_kg": "payload",
        "payload": "payload",
        "friction": "friction",
        "viscous": "viscous friction",
        "stiffness": "stiffness",
        "motor_constant": "motor constant",
    }
    for name, said in words.items():
        if factor == name:
            return said
        if factor.startswith(f"{name}_"):
            return f"{said} of {factor.removeprefix(f'{name}_')}"
    return factor
