"""The built-in machines of jobs, each compiled once in a process: to compile one takes most of a job's loading."""

import copy
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from gantrysim import Machine
from gantrysim.machine.machine import builtin_models


@contextmanager
def built_once() -> Iterator[None]:
    """Give jobs inside the block copies of one machine of each built-in model; a test that changes one is an error."""
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
        patch.setattr("gantrysim.job.loaded.Machine", machine_of)
        yield
    changed = [name for name, (machine, digest) in machines.items() if machine.digest != digest]
    assert changed == [], f"tests have changed the machines {changed} of jobs: must change a Machine(name) of their own"
