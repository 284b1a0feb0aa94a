"""Learning over repeats: a simulation is run again and again, with torques learnt from its own error."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from gantrysim.arrays import Floats
from gantrysim.controllers.feeding import Inverse
from gantrysim.controllers.laws.parameters import LEARNING
from gantrysim.engine.simulation import Simulation, Started
from gantrysim.errors import InputError


def following_error(run: Started) -> Floats:
    """Return the following error at every setpoint, where the stream waits at the first tick, (n, axes) [mm or deg].

    Raises:
        InputError: a run so long that its log is not in memory.
    """
    simulation, log = run.simulation, run.simulation.log
    if len(log.tick) < run.ticks:
        raise InputError(f"law 'learning' over {run.ticks} servo ticks: must be a run whose log fits into memory")
    count = len(simulation.position)
    first = np.searchsorted(log.tick["setpoint"][: run.ticks], np.arange(count))
    return np.asarray(simulation.position - log.axis["encoder"][np.minimum(first, run.ticks - 1)])


def learnt(
    simulations: Sequence[Simulation],
    run: Callable[[list[Simulation]], Sequence[Started]],
    trace: Callable[[int, int, Floats], None] | None = None,
) -> list[Simulation]:
    """Return simulations with the torques that those of the law learning have learnt, others unchanged.

    A simulation that ends in a fault learns no more.

    Args:
        simulations: to be run.
        run: runs simulations to their ends.
        trace: called with the number of a simulation, of a repeat, and the following error in it, (n, axes).

    Raises:
        InputError: a run too long to be learnt from.
    """
    kept = list(simulations)
    inverses = {k: Inverse(one.servo) for k, one in enumerate(kept) if LEARNING in one.servo.law}
    for repeat in range(max((kept[k].servo.learning_repeats for k in inverses), default=0)):
        learning = [k for k in inverses if repeat < kept[k].servo.learning_repeats]
        for k, done in zip(learning, run([kept[k] for k in learning]), strict=True):
            if done.fault is not None:
                del inverses[k]
                continue
            error, one = following_error(done), kept[k]
            if trace is not None:
                trace(k, repeat, error)
            before = np.zeros_like(error) if one.torque is None else one.torque
            kept[k] = one.with_torque(np.ascontiguousarray(before + inverses[k].learnt(error)))
    return kept
