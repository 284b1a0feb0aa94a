"""The loop that steps simulations: one run, a batch, or the one that the viewer shows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager

import mujoco

from gantrysim.engine.simulation import Simulation
from gantrysim.engine.started import Started
from gantrysim.native.hook import installed, installed_law
from gantrysim.servo.laws.plain import PlainLaw

CALLS = 50  # of the stepping function for a run that shows its progress, or more
MOST_STEPS = 20_000  # per call: some 0.1 s, for Ctrl-C not to wait longer


def advance(
    step: Callable[[int, list[int]], None],
    runs: Mapping[int, Started],
    steps: int | None = None,
    *,
    hook: AbstractContextManager[None] | None = None,
    progress: Callable[[int], None] | None = None,
) -> None:
    """Step simulations until all have sent their last setpoint or had a fault, or have made a number of steps.

    Before every call each simulation's log gets room for its ticks.
    It returns early where MuJoCo does not call the servo, which `Started.record` reports.

    Args:
        step: makes a number of physics steps of some of the simulations; Ctrl-C takes effect between its calls.
        runs: the simulations by number.
        steps: number of physics steps; by default as many as it takes.
        hook: context in which the servo is MuJoCo's control callback, by default that of the compiled law.
        progress: called after every call of `step` with the number of setpoints that all simulations have sent.
    """
    most = MOST_STEPS
    if steps is None and progress is not None:
        most = min(most, max(run.steps_left for run in runs.values()) // CALLS + 1)
    stepped = 0
    with installed() if hook is None else hook:
        while steps is None or stepped < steps:
            running = [number for number, run in runs.items() if not run.done]
            if not running:
                return
            witness = runs[running[0]]
            before = witness.steps
            needed = max(runs[number].steps_left for number in running) if steps is None else steps - stepped
            count = min(needed, most, *(runs[number].steps_of_model for number in running))
            for number in running:
                runs[number].make_room(count)
            step(count, running)
            if witness.steps == before:
                return
            stepped += count
            if progress is not None:
                progress(sum(run.sent for run in runs.values()))


class Stepper:
    """One simulation with a state of its own, at rest at its first setpoint.

    Attributes:
        data: the state.
        run: the simulation in it.
    """

    def __init__(self, simulation: Simulation) -> None:
        self.data = mujoco.MjData(simulation.model)
        self.run = Started.of(simulation, self.data.qpos, self.data.userdata)

    def advance(
        self, steps: int | None = None, law: PlainLaw | None = None, progress: Callable[[int], None] | None = None
    ) -> None:
        """Step until the run is done or has made a number of steps, with its servo's law or one in plain Python."""
        hook = None if law is None else installed_law(self.data, law)
        advance(self._step, {0: self.run}, steps, hook=hook, progress=progress)

    def _step(self, steps: int, _: list[int]) -> None:
        mujoco.mj_step(self.run.model, self.data, steps)
