"""The loop that steps simulations: one run, a batch, or the one that the viewer shows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from typing import NamedTuple, Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import GantryError
from gantrysim.engine.native.callback import Interrupted, installed_law, installed_tick
from gantrysim.engine.simulation import Simulation
from gantrysim.engine.started import Started
from gantrysim.machine.row import MISSED, NOT_IN_MODEL
from gantrysim.servo.laws.user import PlainLaw

Numbers = NDArray[np.intp]  # of simulations

CALLS = 50  # of the stepping function for a run that shows its progress, or more
_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
MOST_STEPS = 20_000  # per call: some 0.1 s, for Ctrl-C not to wait longer
_MOST_IN_PYTHON = 1000  # the same with a law in plain Python


class States(NamedTuple):
    """States of several simulations: all that steps change besides the log.

    Attributes:
        physics: of MuJoCo and of the servo, (n, size).
        drives: (n, axes) of `DRIVE`; None where none has a state.
        laws: (n, axes) of `LAW`; None where none has a state.
    """

    physics: Floats
    drives: NDArray[np.void] | None
    laws: NDArray[np.void] | None

    def where(self, chosen: NDArray[np.bool_]) -> States:
        """Return the states of those simulations that a mask chooses, (n,)."""
        drives = None if self.drives is None else self.drives[chosen]
        laws = None if self.laws is None else self.laws[chosen]
        return States(self.physics[chosen], drives, laws)


class Steps(Protocol):
    """What steps simulations, by number.

    Attributes:
        most_steps: number of physics steps of each simulation, after which Ctrl-C takes effect.
    """

    @property
    def most_steps(self) -> int: ...

    def hook(self) -> AbstractContextManager[Interrupted]:
        """Return a context in which they can be stepped, see `gantrysim.engine.native.callback`."""

    def step(self, steps: int, numbers: Numbers) -> None:
        """Make a number of physics steps of some of them."""

    def stops(self, numbers: Numbers) -> NDArray[np.int64]:
        """Return where the stops of their axes are, see `gantrysim.machine.row`, (numbers,)."""

    def states(self, numbers: Numbers) -> States:
        """Return copies of the states of some of them."""

    def set_states(self, states: States, numbers: Numbers) -> None:
        """Set the states of some of them, and forget MuJoCo's warnings."""


def step_or_take_back(simulated: Steps, runs: Mapping[int, Started], steps: int, numbers: Numbers) -> None:
    """Make physics steps of some simulations; where an axis reaches a stop that a model lacks, again with the stops.

    Args:
        simulated: what steps the simulations.
        runs: the simulations by number.
        steps: number of physics steps.
        numbers: of the simulations that are stepped, ascending.
    """
    stops = simulated.stops(numbers)
    if (stops == MISSED).any():
        raise GantryError("the simulation was interrupted while it was rewound from a stop: start it again")
    without = numbers[stops == NOT_IN_MODEL]
    states = simulated.states(without)
    missed = without[:0]
    try:
        simulated.step(steps, numbers)
    finally:
        is_missed = simulated.stops(without) == MISSED
        if is_missed.any():
            missed = without[is_missed]
            simulated.set_states(states.where(is_missed), missed)
            for number in missed.tolist():
                runs[number].stop_at_stops()
    if missed.size:
        simulated.step(steps, missed)


def advance(
    simulated: Steps,
    runs: Mapping[int, Started],
    steps: int | None = None,
    *,
    progress: Callable[[int], None] | None = None,
) -> None:
    """Step simulations until all have sent their last setpoint or had a fault, or have made a number of steps.

    Before every call each simulation's log gets room for its ticks.
    It returns early where MuJoCo does not call the servo, which `Started.record` reports.

    Args:
        simulated: what steps the simulations; Ctrl-C takes effect between its calls.
        runs: the simulations by number.
        steps: number of physics steps; by default as many as it takes.
        progress: called after every call with the number of setpoints that all simulations have sent.
    """
    in_python = any(run.user_law is not None for run in runs.values())
    most = min(simulated.most_steps, _MOST_IN_PYTHON) if in_python else simulated.most_steps
    if steps is None and progress is not None:
        most = min(most, max(run.steps_left for run in runs.values()) // CALLS + 1)
    stepped = 0
    while True:
        with simulated.hook() as interrupted:
            # a signal is handled at the end of this block; where its handler returns, the run goes on
            while not interrupted():
                running = [number for number, run in runs.items() if not run.done]
                if not running or stepped == steps:
                    return
                witness = runs[running[0]]
                before = witness.steps
                needed = max(runs[number].steps_left for number in running) if steps is None else steps - stepped
                count = min(needed, most, *(runs[number].steps_of_model for number in running))
                for number in running:
                    runs[number].make_room(count)
                step_or_take_back(simulated, runs, count, np.array(running))
                if witness.steps == before:
                    return
                stepped += count
                if progress is not None:
                    progress(sum(run.sent for run in runs.values()))


class Stepper:
    """One simulation with a state of its own, at its start.

    Attributes:
        data: the state.
        run: the simulation in it.
    """

    def __init__(self, simulation: Simulation) -> None:
        self._law: PlainLaw | None = None
        self.data = mujoco.MjData(simulation.model)
        self.run = Started.of(simulation, self.data.qpos, self.data.userdata)
        if simulation.begin is not None:
            simulation.begin.write(simulation.machine, self.data)

    def advance(
        self, steps: int | None = None, law: PlainLaw | None = None, progress: Callable[[int], None] | None = None
    ) -> None:
        """Step until the run is done or has made a number of steps, with its servo's law or one in plain Python."""
        self._law = law
        if law is not None:
            # no step of it can be taken back
            self.run.stop_at_stops()
        advance(self, {0: self.run}, steps, progress=progress)

    @property
    def most_steps(self) -> int:
        """Number of physics steps after which Ctrl-C takes effect."""
        return MOST_STEPS if self._law is None else _MOST_IN_PYTHON

    def hook(self) -> AbstractContextManager[Interrupted]:
        """Return a context in which the servo is MuJoCo's control callback."""
        return installed_tick() if self._law is None else installed_law(self.data, self._law)

    def step(self, steps: int, _: Numbers) -> None:
        """Make physics steps."""
        mujoco.mj_step(self.run.model, self.data, steps)

    def stops(self, numbers: Numbers) -> NDArray[np.int64]:
        """Return where the stops of the axes are, or nothing where no number is given."""
        return np.full(len(numbers), self.run.row["stops"], np.int64)

    def states(self, numbers: Numbers) -> States:
        """Return a copy of the state, or nothing where no number is given."""
        size = mujoco.mj_stateSize(self.run.model, _STATE)
        physics = np.empty((len(numbers), size))
        for state in physics:
            mujoco.mj_getState(self.run.model, self.data, state, _STATE)
        drives, laws = (
            None if part is None else part[None, :].repeat(len(numbers), 0) for part in (self.run.drives, self.run.laws)
        )
        return States(physics, drives, laws)

    def set_states(self, states: States, _: Numbers) -> None:
        """Set the state, and forget MuJoCo's warnings."""
        mujoco.mj_resetData(self.run.model, self.data)
        for state in states.physics:
            mujoco.mj_setState(self.run.model, self.data, state, _STATE)
        for part, before in ((self.run.drives, states.drives), (self.run.laws, states.laws)):
            if part is not None and before is not None:
                part[:] = before[0]
