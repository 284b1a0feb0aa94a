"""The built-in machines of jobs and environments, each compiled once in a process, which takes most of loading them."""

import copy
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from gantrysim import Machine
from gantrysim.machine.machine import builtin_models

# that compile a machine by its name
MODULES = ("gantrysim.cli.info", "gantrysim.env.episodes", "gantrysim.job.loaded")


@contextmanager
def built_once() -> Iterator[None]:
    """Give jobs and environments inside the block copies of one machine of each built-in model.

    A test that changes what they share is an error.
    """
    machines: dict[str, tuple[Machine, str]] = {}

    def machine_of(model, names=None):
        if names or model not in builtin:
            return Machine(model, names)
        if model not in machines:
            machine = Machine(model)
            machines[model] = (machine, machine.digest)
        return copy.copy(machines[model][0])

    builtin = builtin_models()
    with pytest.MonkeyPatch.context() as patch:
        for module in MODULES:
            patch.setattr(f"{module}.Machine", machine_of)
        yield
    changed = [name for name, (machine, digest) in machines.items() if machine.digest != digest]
    assert changed == [], f"tests have changed shared machines {changed}: must change a Machine(name) of their own"
