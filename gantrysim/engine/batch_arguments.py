"""The arguments of a batch: one value for all simulations, or one for each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gantrysim.base.errors import InputError
from gantrysim.engine.arguments import check_argument
from gantrysim.engine.simulation import Simulation
from gantrysim.faults import InjectedFault


def per_simulation(faults: Sequence[Any]) -> Any:
    """Return the faults of all simulations as one value, those of each as a list."""
    check_argument("faults", faults)
    if not any(isinstance(item, list | tuple) for item in faults):
        return _Faults(faults)
    return [_Faults(item) if isinstance(item, list | tuple) else item for item in faults]


class _Faults:
    """The faults of a simulation, which as a sequence would be one value per simulation."""

    def __init__(self, faults: Sequence[InjectedFault]) -> None:
        self.faults = tuple(faults)


def simulations_of(**arguments: Any) -> list[Simulation]:
    """Return the simulations of a batch; arguments as of `gantrysim.simulate_batch`, faults by `per_simulation`."""
    several: dict[str, list[Any]] = {}
    for name, value in arguments.items():
        if isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim):
            several[name] = list(value)
        for number, item in enumerate(several.get(name, [value])):
            given = item.faults if isinstance(item, _Faults) else item
            if name in several:
                check_argument(name, given, place=f"[{number}]")
            else:
                check_argument(name, given, alternative=", or a list, a tuple or an array of them")
    lengths = {name: len(values) for name, values in several.items()}
    if len(set(lengths.values())) > 1:
        counts = ", ".join(f"{length} of {name}" for name, length in lengths.items())
        raise InputError(f"a batch of {counts}: must be one for all, or as many of each")
    count = min(lengths.values(), default=1)
    if not count:
        raise InputError("a batch of no simulation: must have at least one")
    simulations = []
    for k in range(count):
        chosen = {name: several[name][k] if name in several else value for name, value in arguments.items()}
        try:
            simulations.append(Simulation.of(**{**chosen, "faults": chosen["faults"].faults}))
        except InputError as error:
            raise InputError(f"simulation {k} of the batch: {error}") from None
    return simulations
