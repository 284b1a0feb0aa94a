"""What a job runs, and the errors of several such runs, made beside one another in threads."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from gantrysim.base import memory
from gantrysim.base.columns import blocks
from gantrysim.base.errors import InputError
from gantrysim.engine.simulate import stepped
from gantrysim.engine.simulation import Simulation
from gantrysim.machine.machine import Machine
from gantrysim.machine.timing import substeps_of
from gantrysim.metrics.analysis import Analysis, ErrorSize
from gantrysim.metrics.budget import Budget
from gantrysim.paths.path import Projection
from gantrysim.record.run import Run
from gantrysim.record.setpoints import Setpoints
from gantrysim.servo.servo import Servo

Errors = dict[str, ErrorSize]  # by link, and of the whole as "contour" [mm]


@dataclass(frozen=True)
class Setup:
    """What a job runs.

    Attributes:
        machine: the machine.
        servo: the servo.
        setpoints: the setpoints, at the servo's period.
        physics_step: as in `simulate` [s].
        ticks: servo ticks per setpoint of the program.
    """

    machine: Machine
    servo: Servo
    setpoints: Setpoints
    physics_step: float | None = None
    ticks: int = 1

    @property
    def step(self) -> float:
        """The physics step [s]."""
        return self.servo.period / substeps_of(
            self.machine, self.servo.period, self.physics_step, self.servo.inner_period
        )

    def run(self, progress: Callable[[float], None] | None = None) -> Run:
        """Run it without glue and return the record at the ticks of the program."""
        simulation = Simulation.of(self.machine, self.servo, self.setpoints, physics_step=self.physics_step)
        return stepped(simulation, progress=progress).record(every=self.ticks)


class RunOutcome(NamedTuple):
    """What a run shows.

    Attributes:
        errors: of the run; empty where it failed.
        failure: why it failed: a refusal, or a fault that ended it.
    """

    errors: Errors
    failure: str = ""


class _SameCommand(Analysis):
    """The analysis of a run that may have the command of another, whose projection it then is.

    Args:
        run: the run.
        other: analysis of the other run.
    """

    def __init__(self, run: Run, other: Analysis) -> None:
        super().__init__(run)
        self._other = other

    @cached_property
    def commanded(self) -> Projection:
        """Projection of the commanded positions."""
        other = self._other.run
        if self.run.requested is not other.requested or not np.array_equal(self.run.dispense, other.dispense):
            return super().commanded
        tip = self.run.commanded_tip
        same = all(np.array_equal(tip[block], other.commanded_tip[block]) for block in blocks(len(tip)))
        return self._other.commanded if same else super().commanded


def outcomes_of(
    setups: Sequence[Setup], progress: Callable[[float], None] | None = None, known: Analysis | None = None
) -> list[RunOutcome]:
    """Return what the runs of setups show, in their order.

    MuJoCo steps without Python's lock, so that threads share the work. Of long runs, one is made at a time.

    Args:
        setups: what is run.
        progress: called now and then with the completed share, 0 to 1, from one thread at a time.
        known: analysis of a run that has the command of most of these.
    """
    shares = [0.0] * len(setups)
    alone = threading.Lock()

    def run(number: int) -> RunOutcome:
        def advance(share: float) -> None:
            with alone:
                shares[number] = share
                if progress is not None:
                    progress(sum(shares) / len(shares))

        try:
            record = setups[number].run(advance)
        except InputError as error:
            return RunOutcome({}, str(error))
        if record.fault is not None:
            return RunOutcome({}, str(record.fault))
        return RunOutcome(errors_of(Budget(record if known is None else _SameCommand(record, known))))

    if not setups:
        return []
    is_long = any(len(setup.setpoints.position) > memory.LONG for setup in setups)
    with ThreadPoolExecutor(1 if is_long else os.cpu_count()) as pool:
        return list(pool.map(run, range(len(setups))))


def errors_of(budget: Budget) -> Errors:
    """Return the errors of a run by link, and as a whole."""
    return {name: ErrorSize.of(part.size) for name, part in {**budget.parts, "contour": budget.contour}.items()}
