"""Sources of the viewer: a record that is replayed, or a simulation that runs."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Protocol

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import whole_number
from gantrysim.engine.advance import Stepper
from gantrysim.engine.simulation import Simulation
from gantrysim.record.run import Run
from gantrysim.record.run_file import Fault

_CHUNK = 100  # servo ticks between two checks of the clock
_ROUNDING = 1e-6  # of a servo period


class Source(Protocol):
    """A record and the present tick of it.

    Attributes:
        live: whether it is being simulated; then it can only go forward, or restart.
        until: end of the record, or of a live run that waits at no gate [s].
    """

    live: bool
    until: float

    @property
    def run(self) -> Run:
        """The record, of a live run the record so far."""

    @property
    def tick(self) -> int:
        """Index of the last tick at or before the requested moment, as far as it is reached."""

    @property
    def over(self) -> bool:
        """Whether the end is reached."""

    @property
    def fault(self) -> Fault | None:
        """The fault, once it has occurred."""

    def go(self, moment: float) -> None:
        """Go to a moment [s], or as far towards it as a little time allows."""

    def restart(self) -> None:
        """Go back to the start."""

    def push(self, wrench: Floats) -> None:
        """Apply forces and torques to the bodies from now on, (bodies, 6) [N, N·m]."""


class Replay:
    """A record that is replayed.

    Args:
        run: the record.
    """

    live = False

    def __init__(self, run: Run) -> None:
        self._run = run
        self._tick = 0
        self.until = float(run.time[-1])

    @property
    def run(self) -> Run:
        return self._run

    @property
    def tick(self) -> int:
        return self._tick

    @property
    def over(self) -> bool:
        return self._tick == len(self._run.time) - 1

    @property
    def fault(self) -> Fault | None:
        return self._run.fault if self.over else None

    def go(self, moment: float) -> None:
        self._tick = min(max(math.floor(moment / self._run.period + _ROUNDING), 0), len(self._run.time) - 1)

    def restart(self) -> None:
        self._tick = 0

    def push(self, wrench: Floats) -> None:
        """Do nothing."""


class Live:
    """A simulation that runs while it is watched.

    Args:
        simulation: the simulation.
        chunk: servo ticks between two checks of the timer.
        patience: longest duration of `go`, checked after every chunk [s].
        timer: wall-clock time [s].

    Raises:
        InputError: a chunk below one tick.
    """

    live = True

    def __init__(
        self,
        simulation: Simulation,
        *,
        chunk: int = _CHUNK,
        patience: float = 0.03,
        timer: Callable[[], float] = time.perf_counter,
    ) -> None:
        self._simulation = simulation
        self._chunk = whole_number("chunk", chunk, 1)
        self._patience = patience
        self._timer = timer
        self.until = (len(simulation.position) - 1) * simulation.setpoints.period
        self.restart()

    def restart(self) -> None:
        self._stepper = Stepper(self._simulation)
        self._run: Run | None = None
        self._advance(1)

    @property
    def run(self) -> Run:
        if self._run is None:
            self._run = self._stepper.run.record(partial=True)
        return self._run

    @property
    def tick(self) -> int:
        return len(self.run.time) - 1

    @property
    def over(self) -> bool:
        return self._stepper.run.done

    @property
    def fault(self) -> Fault | None:
        return self._stepper.run.fault

    def go(self, moment: float) -> None:
        wanted = math.floor(moment / self._simulation.setpoints.period + _ROUNDING) + 1
        begun = self._timer()
        while self._stepper.run.ticks < wanted and not self.over:
            self._advance(min(self._stepper.run.ticks + self._chunk, wanted))
            if self._timer() - begun > self._patience:
                break

    def push(self, wrench: Floats) -> None:
        self._stepper.data.xfrc_applied[:] = wrench

    def _advance(self, ticks: int) -> None:
        """Step until so many ticks are begun, or the run is over."""
        self._stepper.advance((ticks - 1) * self._simulation.substeps + 1 - self._stepper.run.steps)
        self._run = None

    @property
    def forces(self) -> Floats:
        """Forces and torques applied to the bodies of the stepped model, (bodies, 6) [N, N·m]."""
        return np.array(self._stepper.data.xfrc_applied)
