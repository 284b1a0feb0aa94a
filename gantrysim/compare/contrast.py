"""A wrong machine beside the right one: the same without friction, which a trace should tell from it."""

from __future__ import annotations

import numpy as np

from gantrysim.base.errors import InputError
from gantrysim.engine.simulate import simulate
from gantrysim.machine.ideal import frictionless_machine
from gantrysim.machine.machine import Machine
from gantrysim.record.run import Run
from gantrysim.record.setpoints import Setpoints
from gantrysim.servo.servo import Servo


def frictionless_run(run: Run, machine: Machine, servo: Servo) -> Run:
    """Return the record of a run's command on its machine without friction, under the same servo.

    Args:
        run: whose command is sent, tick by tick.
        machine: of the run.
        servo: of the run.

    Raises:
        InputError: a run with deliberate faults, or one that the machine without friction cannot follow to its end.
    """
    if run.injected:
        raise InputError("it has deliberate faults")
    setpoints = Setpoints(
        run.period,
        run.axes,
        np.asarray(run.commanded),
        np.asarray(run.dispense),
        run.requested,
        progress=None if run.progress is None else np.asarray(run.progress),
    )
    wrong = simulate(frictionless_machine(machine), servo, setpoints, engine="loop")
    if wrong.fault is not None:
        raise InputError(f"it ends in a fault: {wrong.fault}")
    return wrong
