"""Tolerances: the variation between machines of one design."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, at_least, unknown, whole_number
from gantrysim.machine.geometry import ERRORS
from gantrysim.machine.machine import Machine
from gantrysim.machine.motors import springs_have_axes
from gantrysim.machine.perturbation import VARIED_FACTORS, Perturbation


@dataclass(frozen=True)
class Tolerances:
    """Variation between machines of one design; a tolerance of 0 means none.

    The payload is uniform from 0 to its tolerance. A factor with the tolerance t is log-uniform from 1 / (1 + t) to
    1 + t, so its median is the nominal 1; every axis has its own. The defaults are assumptions: friction varies most,
    with preload, seals and grease; the motor constants have a catalogue's tolerance. Errors of the machine's geometry,
    if it has any, vary too: each uniformly from minus to plus its size on the nominal machine, which is at the limit of
    its class; play and racking from 0.

    Attributes:
        payload: added mass [kg].
        friction: Coulomb and static friction, relative.
        viscous: viscous friction, relative.
        stiffness: stiffness of the drive trains, relative.
        motor_constant: motor constants, relative.

    Raises:
        InputError: a tolerance below 0.
    """

    payload: float = 0.3
    friction: float = 0.5
    viscous: float = 0.5
    stiffness: float = 0.3
    motor_constant: float = 0.1

    def __post_init__(self) -> None:
        for field in fields(self):
            unit = "kg" if field.name == "payload" else ""
            at_least(f"tolerance of {field.name}", getattr(self, field.name), 0, unit)

    @classmethod
    def parse(cls, text: str) -> Tolerances:
        """Return the tolerances in a text such as "payload=0.5,friction=0.3"; the others keep their defaults.

        Raises:
            InputError: an unknown name, or a value that is not a number.
        """
        values: dict[str, float] = {}
        known = [field.name for field in fields(cls)]
        for item in filter(None, (part.strip() for part in text.split(","))):
            name, _, value = (part.strip() for part in item.partition("="))
            if name not in known:
                raise unknown("tolerance", name, known)
            try:
                values[name] = float(value)
            except ValueError:
                raise InputError(f"tolerance {item}: must be {name}= and a number") from None
        return cls(**values)

    def draw(self, random: np.random.Generator, machine: Machine) -> Perturbation:
        """Return a random machine's perturbation; arguments as of `sample`."""
        return self.perturbation(self.sample(random, machine), machine)

    def sample(self, random: np.random.Generator, machine: Machine) -> dict[str, float]:
        """Return a random machine's values by column name, see `columns`.

        The generator always yields 1 + 4 axes numbers, so a seed gives a factor the same value whichever other
        tolerances are 0; the numbers for the geometry follow.

        Args:
            random: random number generator.
            machine: the nominal machine, which gives the axes.
        """
        axes = machine.axis_names
        names = ["payload_kg", *(f"{name}_{axis}" for name in VARIED_FACTORS for axis in axes)]
        unit = dict(zip(names, random.random(len(names)), strict=True))
        # a factor common to all axes, as of springs that no single axis carries, is the first axis'
        unit |= {name: unit[f"{name}_{axes[0]}"] for name in VARIED_FACTORS}
        columns = self.columns(machine)
        geometry = [name for name in columns if name not in unit]
        unit |= dict(zip(geometry, random.random(len(geometry)), strict=True))
        return {name: float(_scaled_tolerance(name, tolerance, unit[name])) for name, tolerance in columns.items()}

    def machines(self, machine: Machine, count: int, seed: int) -> list[Perturbation]:
        """Return the perturbations of a Latin hypercube of n machines: one in each n-th of every factor's range.

        Args:
            machine: the nominal machine, which gives the axes.
            count: number n of machines.
            seed: seed of the random numbers.

        Raises:
            InputError: a count or seed that is not a whole number, a count below 1 or a seed below 0.
        """
        values = self.hypercube(machine, count, seed)
        return [
            self.perturbation({name: float(column[k]) for name, column in values.items()}, machine)
            for k in range(int(count))
        ]

    def hypercube(self, machine: Machine, count: int, seed: int) -> dict[str, Floats]:
        """Return the machines of `machines` as one column per varying factor, (count,) each."""
        # slow to import, and not needed by draw
        from scipy.stats.qmc import LatinHypercube

        count = whole_number("number of machines", count, 1)
        seed = whole_number("seed", seed, 0)
        columns = self.columns(machine)
        unit = LatinHypercube(len(columns), rng=seed).random(count)
        return {
            name: _scaled_tolerance(name, tolerance, unit[:, k]) for k, (name, tolerance) in enumerate(columns.items())
        }

    def columns(self, machine: Machine) -> dict[str, float]:
        """Return the tolerance of every varying factor by its column name, such as friction_x."""
        columns = {"payload_kg": self.payload} if self.payload else {}
        for name in VARIED_FACTORS:
            tolerance = getattr(self, name)
            if not tolerance:
                continue
            per_axis = name != "stiffness" or springs_have_axes(machine.layout)
            names = [f"{name}_{axis}" for axis in machine.axis_names] if per_axis else [name]
            columns |= dict.fromkeys(names, tolerance)
        errors = machine.kinematic_errors
        return columns if errors is None else columns | dict.fromkeys(errors.columns, 1.0)

    @staticmethod
    def perturbation(values: Mapping[str, float], machine: Machine) -> Perturbation:
        """Return the perturbation with one machine's values by column name."""
        axes = machine.axis_names
        given: dict[str, Any] = {}
        for name in VARIED_FACTORS:
            if name in values:
                given[name] = values[name]
            elif f"{name}_{axes[0]}" in values:
                given[name] = tuple(values[f"{name}_{axis}"] for axis in axes)
        errors = tuple((name, factor) for name, factor in values.items() if name.startswith(ERRORS))
        return Perturbation(payload=values.get("payload_kg", 0.0), geometry=errors, **given)


def _scaled_tolerance(name: str, tolerance: float, unit: Floats) -> Floats:
    """Map numbers from 0 to 1 to payloads or factors."""
    if name.startswith(ERRORS):
        return unit if name.startswith(("play", "racking")) else 2 * unit - 1
    return tolerance * unit if name == "payload_kg" else (1 + tolerance) ** (2 * unit - 1)


def in_words(factor: str) -> str:
    """Return the label of a tolerance or of a column, such as "friction of x"."""
    for name in ("payload", *VARIED_FACTORS, *sorted(ERRORS, key=len, reverse=True)):
        label = "viscous friction" if name == "viscous" else name.replace("_", " ")
        if factor in (name, f"{name}_kg"):
            return label
        if factor.startswith(f"{name}_"):
            return f"{label} of {factor.removeprefix(f'{name}_')}"
    return factor
