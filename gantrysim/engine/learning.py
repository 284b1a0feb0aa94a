"""Learning over repeats: a simulation is run again and again, with torques learnt from its own error."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.engine.simulation import Simulation
from gantrysim.engine.started import Started
from gantrysim.servo.inverse import Inverse
from gantrysim.servo.laws import LEARNING


def following_error(run: Started) -> Floats:
    """Return the following error at every setpoint, where the stream waits at the first tick, (n, axes) [mm or deg].

    Raises:
        InputError: a run so long that its log is not in memory.
    """
    simulation = run.simulation
    log = run.simulation.log
    if len(log.tick) < run.ticks:
        raise InputError(f"law 'learning' over {run.ticks} servo ticks: must be a run whose log fits into memory")
    count = len(simulation.position)
    first = np.searchsorted(log.tick["setpoint"][: run.ticks], np.arange(count))
    return np.asarray(simulation.position - log.axis["encoder"][np.minimum(first, run.ticks - 1)])


@dataclass
class _Pupil:
    """What a simulation has learnt.

    Attributes:
        next: the simulation to run next.
        inverse: of its nominal machine.
        best: the run of the least error.
        error: that error, its rms; inf before the first run.
        change: of the torques from the best run to the next, (n, axes) [N·m].
        step: share of the change that is made; 1 as long as every repeat is better than all before.
    """

    next: Simulation
    inverse: Inverse
    best: Started | None = None
    error: float = math.inf
    change: Floats | None = None
    step: float = 1.0

    @property
    def repeats(self) -> int:
        """Number of runs to learn from."""
        return self.next.servo.laws.learning_repeats

    def learn(self, run: Started) -> Floats:
        """Learn from a run of `next`; return its following error, (n, axes)."""
        error = following_error(run)
        rms = math.inf if run.fault is not None else float(np.sqrt(np.mean(error**2)))
        if rms < self.error:
            self.best = run
            self.error = rms
            self.change = self.inverse.learnt(error)
        else:
            self.step *= 0.5
            self.best = self.best or run
        if self.change is not None:
            best = self.best.simulation
            torque = self.step * self.change if best.torque is None else best.torque + self.step * self.change
            self.next = best.with_torque(np.ascontiguousarray(torque))
        return error


def run_and_learn(
    simulations: Sequence[Simulation],
    run: Callable[[list[Simulation]], Sequence[Started]],
    trace: Callable[[int, int, Floats], None] | None = None,
) -> list[Started]:
    """Return the runs of simulations, those of the law learning after their repeats.

    A simulation that learns is run once more than it has repeats to learn from, and the best of these runs is its own.
    After a run that is worse than the best so far, or ends in a fault, the next makes half the step from the best. A
    first run that ends in a fault leaves nothing to learn.

    Args:
        simulations: to be run.
        run: runs simulations to their ends.
        trace: called with the number of a simulation, of a repeat, and the following error in it, (n, axes).

    Raises:
        InputError: a run too long to be learnt from.
    """
    pupils = {
        k: _Pupil(simulation, Inverse(simulation.servo))
        for k, simulation in enumerate(simulations)
        if LEARNING.name in simulation.servo.laws.names
    }
    others = [k for k in range(len(simulations)) if k not in pupils]
    done = dict(zip(others, run([simulations[k] for k in others]), strict=True)) if others else {}
    repeat = 0
    learning = list(pupils)
    while learning:
        for k, started in zip(learning, run([pupils[k].next for k in learning]), strict=True):
            error = pupils[k].learn(started)
            if trace is not None:
                trace(k, repeat, error)
        repeat += 1
        learning = [k for k, pupil in pupils.items() if pupil.repeats >= repeat and pupil.change is not None]
    best = {k: pupil.best for k, pupil in pupils.items() if pupil.best is not None}
    return [(done | best)[k] for k in range(len(simulations))]
