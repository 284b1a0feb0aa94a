"""Where what is shown comes from: a record that plays, or a simulation that runs."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Protocol

import numpy as np

from gantrysim.arrays import Floats
from gantrysim.engine.advance import Stepper
from gantrysim.engine.simulation import Simulation
from gantrysim.errors import whole
from gantrysim.run import Fault, Run

_CHUNK = 100  # servo ticks between two looks at the wall's clock
_ROUNDING = 1e-6  # of a servo period


class Source(Protocol):
    """Gives a record and a tick of it for the moment that is wanted.

    Attributes:
        live: whether it is simulated only now; then there is no way back but to the start.
        until: the last moment that there is, or that there will be if the run waits for nothing [s].
    """

    live: bool
    until: float

    @property
    def run(self) -> Run:
        """The record, of a live run so far."""

    @property
    def tick(self) -> int:
        """Of the record, at the moment that was last asked for, or before it where that is not reached."""

    @property
    def over(self) -> bool:
        """Whether there is no more to come."""

    @property
    def fault(self) -> Fault | None:
        """Why the run ended early, from when it did."""

    def go(self, moment: float) -> None:
        """Go to a moment [s], or as near to it as can be done in little time."""

    def restart(self) -> None:
        """Go back to the start."""

    def push(self, wrench: Floats) -> None:
        """Have forces and torques act on the bodies from now on, (bodies, 6) [N, N·m]."""


class Replay:
    """A record that plays.

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
        """The record."""
        return self._run

    @property
    def tick(self) -> int:
        """The last tick before the moment, or at it."""
        return self._tick

    @property
    def over(self) -> bool:
        """Whether it is at its last tick."""
        return self._tick == len(self._run.time) - 1

    @property
    def fault(self) -> Fault | None:
        """Why the run ended early, at its end."""
        return self._run.fault if self.over else None

    def go(self, moment: float) -> None:
        """Go to a moment [s]; there is none before the first tick or after the last."""
        self._tick = min(max(math.floor(moment / self._run.period + _ROUNDING), 0), len(self._run.time) - 1)

    def restart(self) -> None:
        """Go back to the first tick."""
        self._tick = 0

    def push(self, wrench: Floats) -> None:
        """Leave the record as it is: what is past cannot be pushed."""


class Live:
    """A simulation that runs as it is looked at.

    Args:
        simulation: to be run.
        chunk: servo ticks stepped on end.
        patience: after so long `go` comes back, there or not [s].
        timer: the wall's clock [s].

    Raises:
        InputError: a chunk of no tick.
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
        self._chunk, self._patience, self._timer = whole("chunk", chunk, 1), patience, timer
        self.until = (len(simulation.position) - 1) * simulation.setpoints.period
        self.restart()

    def restart(self) -> None:
        """Begin anew, at rest at the first setpoint, with nobody pushing."""
        self._stepper = Stepper(self._simulation)
        self._run: Run | None = None
        self._advance(1)

    @property
    def run(self) -> Run:
        """The record so far."""
        if self._run is None:
            self._run = self._stepper.run.record(partial=True)
        return self._run

    @property
    def tick(self) -> int:
        """The last one."""
        return len(self.run.time) - 1

    @property
    def over(self) -> bool:
        """Whether the last setpoint is sent, or a fault has ended the run."""
        return self._stepper.run.done

    @property
    def fault(self) -> Fault | None:
        """Why the run ended early."""
        return self._stepper.run.fault

    def go(self, moment: float) -> None:
        """Step until the last tick before a moment [s], or until patience is at its end."""
        wanted = math.floor(moment / self._simulation.setpoints.period + _ROUNDING) + 1
        begun = self._timer()
        while (done := self._stepper.run.ticks) < wanted and not self.over:
            self._advance(min(done + self._chunk, wanted))
            if self._stepper.run.ticks == done or self._timer() - begun > self._patience:
                break

    def push(self, wrench: Floats) -> None:
        """Have forces and torques act on the bodies of the stepped model from now on, (bodies, 6) [N, N·m]."""
        self._stepper.data.xfrc_applied[:] = wrench

    def _advance(self, ticks: int) -> None:
        """Step until so many ticks are begun, or the run is over."""
        self._stepper.advance((ticks - 1) * self._simulation.substeps + 1 - self._stepper.run.steps)
        self._run = None

    @property
    def forces(self) -> Floats:
        """Forces and torques that act on the bodies of the stepped model, (bodies, 6) [N, N·m]."""
        return np.array(self._stepper.data.xfrc_applied)
