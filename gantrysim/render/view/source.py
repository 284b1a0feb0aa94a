"""What the viewer plays: a record that is replayed, or a simulation that runs, with all that a window needs of it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import NamedTuple, Protocol

import mujoco
import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, whole_number
from gantrysim.engine.advance import Stepper
from gantrysim.engine.simulation import Simulation
from gantrysim.record.run import Run
from gantrysim.record.run_file import Fault
from gantrysim.render.scene import Scene

STIFFNESS = 300.0  # of the mouse's spring per mass; MuJoCo's 100 is too weak against a servo [N/(m·kg)]

_CHUNK = 100  # servo ticks between two checks of the clock
_ROUNDING = 1e-6  # of a servo period


class Bodies:
    """Map from bodies of the displayed model to bodies of the simulated one, by name.

    A body that exists only in the displayed model passes its force to its nearest ancestor that is simulated:

        tau' = tau + (c - c') x f

    with c and c' the centres of mass, for a force f and a torque tau about the centre of mass.

    Args:
        shown: the displayed model.
        simulated: the simulated model.

    Raises:
        InputError: no displayed body is simulated.
    """

    def __init__(self, shown: mujoco.MjModel, simulated: mujoco.MjModel) -> None:
        self._count = simulated.nbody
        # displayed body that takes the force of each displayed one
        self._source = np.zeros(shown.nbody, np.intp)
        # the same body in the simulated model
        self._target = np.zeros(shown.nbody, np.intp)
        # unnamed bodies are matched by number as long as all before them agree
        same = True
        for body in range(1, shown.nbody):
            name = shown.body(body).name
            parent = int(shown.body_parentid[body])
            same = same and body < simulated.nbody and name == simulated.body(body).name
            simulated_body = body if same else -1
            if name:
                simulated_body = mujoco.mj_name2id(simulated, mujoco.mjtObj.mjOBJ_BODY, name)
            # a body that is displayed alone passes its force on to the nearest one above it that is simulated
            self._source[body] = body if simulated_body > 0 else self._source[parent]
            self._target[body] = simulated_body if simulated_body > 0 else self._target[parent]
        if shown.nbody > 1 and simulated.nbody > 1 and not self._target.any():
            raise InputError("the displayed model has no body of the simulated one")

    def transferred(self, wrench: Floats, centre: Floats) -> Floats:
        """Return forces and torques on the simulated bodies, as `xfrc_applied` has them, (bodies, 6) [N, N·m].

        Args:
            wrench: force and torque on the displayed bodies, (displayed bodies, 6) [N, N·m].
            centre: their centres of mass, `xipos`, (displayed bodies, 3) [m].
        """
        result = np.zeros((self._count, 6))
        for body in np.flatnonzero(wrench.any(axis=1)):
            target = int(self._target[body])
            source = int(self._source[body])
            if target == 0:
                continue  # the world is fixed
            force = wrench[body, :3]
            torque = wrench[body, 3:]
            result[target, :3] += force
            result[target, 3:] += torque + np.cross(centre[body] - centre[source], force)
        return result


class Playback(NamedTuple):
    """A run to be played.

    Attributes:
        name: of the job.
        scene: of the source's machine.
        source: of the run.
        bodies: that the mouse may push; None for a replay.
    """

    name: str
    scene: Scene
    source: Source
    bodies: Bodies | None = None


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
