"""Learning over repeats: a simulation is run again and again, with torques learnt from its own error."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

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


@dataclass
class _Pupil:
    """What a simulation has learnt.

    Attributes:
        best: the simulation with the torques of the least error.
        inverse: of its nominal machine.
        error: the least error, its rms; inf before the first run.
        change: of the torques, from the best to the next, (n, axes) [N·m].
        step: share of the change that is made; 1 as long as every repeat is better than all before.
    """

    best: Simulation
    inverse: Inverse
    error: float = math.inf
    change: Floats | None = None
    step: float = 1.0

    @property
    def next(self) -> Simulation:
        """The simulation of the next repeat."""
        if self.change is None:
            return self.best
        change = self.step * self.change
        torque = change if self.best.torque is None else self.best.torque + change
        return self.best.with_torque(np.ascontiguousarray(torque))

    def learn(self, run: Started) -> Floats:
        """Learn from a run of `next`; return its following error, (n, axes)."""
        error = following_error(run)
        rms = math.inf if run.fault is not None else float(np.sqrt(np.mean(error**2)))
        if rms < self.error:
            self.best, self.error, self.change = run.simulation, rms, self.inverse.learnt(error)
        else:
            self.step *= 0.5
        return error


def learnt(
    simulations: Sequence[Simulation],
    run: Callable[[list[Simulation]], Sequence[Started]],
    trace: Callable[[int, int, Floats], None] | None = None,
) -> list[Simulation]:
    """Return simulations with the torques that those of the law learning have learnt, others unchanged.

    A repeat that is worse than the best so far, or ends in a fault, is not learnt from: the next one makes half the
    step from the best, and the best is what is returned. A first run that ends in a fault leaves nothing to learn.

    Args:
        simulations: to be run.
        run: runs simulations to their ends.
        trace: called with the number of a simulation, of a repeat, and the following error in it, (n, axes).

    Raises:
        InputError: a run too long to be learnt from.
    """
    pupils = {k: _Pupil(one, Inverse(one.servo)) for k, one in enumerate(simulations) if LEARNING in one.servo.law}
    for repeat in range(max((one.best.servo.learning_repeats for one in pupils.values()), default=0)):
        learning = [
            k
            for k, one in pupils.items()
            if repeat < one.best.servo.learning_repeats and (one.change is not None or not repeat)
        ]
        if not learning:
            break
        for k, done in zip(learning, run([pupils[k].next for k in learning]), strict=True):
            error = pupils[k].learn(done)
            if trace is not None:
                trace(k, repeat, error)
    ends = {k: one.best if one.step < 1 else one.next for k, one in pupils.items()}
    return [ends.get(k, one) for k, one in enumerate(simulations)]
