"""Places for simulations that are stepped together: by MuJoCo on threads, or by the compiled loop."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from typing import Any, ClassVar, NamedTuple

import mujoco
import mujoco.batch
import numpy as np
from numpy.typing import NDArray

from gantrysim.base import signals
from gantrysim.base.arrays import Floats
from gantrysim.base.errors import GantryError, whole_number
from gantrysim.engine.advance import MOST_STEPS, Numbers, States, advance, step_or_take_back
from gantrysim.engine.drives import DRIVE
from gantrysim.engine.linear import Engine, Linear, linear_machine
from gantrysim.engine.native.callback import Interrupted, installed_tick
from gantrysim.engine.native.plant import PLACE, STATE, loop
from gantrysim.engine.simulation import Simulation
from gantrysim.engine.started import Started
from gantrysim.machine.machine import Machine
from gantrysim.machine.row import IN_MODEL, LAW, NEVER, ROW, ROW_NUMBERS, Log
from gantrysim.machine.travel import has_no_constraints_but_stops

# of a servo's row: they belong to the process and to a simulation's own arrays, not to the state of a run
_OBSERVER = ("observer", "observer_argument", "observer_step")
_OF_PROCESS = ("magic", "setpoints", "log", "axis_log", "first", "gates", "stages", *_OBSERVER)


class Moment(NamedTuple):
    """A simulation in the middle of its run, without what it is a simulation of.

    Attributes:
        physics: state of MuJoCo and of the servo.
        log: entries so far.
        drives: state of the drives; None where all are plain ones.
        laws: state of the laws; None where PID does alone.
        user_state: state of a user's own law; None without one.
    """

    physics: Floats
    log: Log
    drives: NDArray[np.void] | None
    laws: NDArray[np.void] | None
    user_state: Floats | None


class Places(ABC):
    """Places for simulations of one machine, perturbed or not, that are stepped together.

    Args:
        machine: machine whose MJCF file all simulations share.
        userdata: a row of numbers for each place, of which the first are the servo's.

    Attributes:
        runs: the simulations by place, once they are loaded.
        beside: called when Python is about to wait for the simulations, to start what other threads do meanwhile.
        most_steps: number of physics steps of each simulation, after which Ctrl-C takes effect.
    """

    most_steps: ClassVar[int]

    def __init__(self, machine: Machine, userdata: Floats) -> None:
        places = len(userdata)
        self._userdata = userdata
        self._sent, self._ticks, self._faults = map(self.field, ("index", "ticks", "fault"))
        self._stops = self.field("stops")
        self._steps = self.field("steps")
        self._plain = np.zeros(places, bool)
        # physics step at which the model changes next
        self._next_change = np.full(places, NEVER, np.int64)
        axes = len(machine.plain_axes)
        # states of drives and laws, used at places that have any
        self._drives = np.zeros((places, axes), DRIVE)
        self._laws = np.zeros((places, axes), LAW)
        self._has_drives = np.zeros(places, bool)
        self._has_laws = np.zeros(places, bool)
        self._source = machine.source
        self._loaded: dict[int, Simulation] = {}
        self.runs: dict[int, Started] = {}
        self.beside: Callable[[], None] | None = None

    def load(self, simulations: Mapping[int, Simulation]) -> None:
        """Put simulations, at their start, into places.

        Args:
            simulations: by place; the batch writes to their logs.

        Raises:
            GantryError: a machine of another MJCF file.
        """
        for simulation in simulations.values():
            if simulation.machine.source != self._source:
                raise GantryError(f"a batch of {self._source} cannot take a simulation of {simulation.machine.source}")
        self._clear(simulations)
        for place, simulation in simulations.items():
            # kept alive before its row is armed with addresses of its arrays
            self._loaded[place] = simulation
            self.runs[place] = Started.of(
                simulation, self._qpos(place), self._userdata[place], self._drives[place], self._laws[place]
            )
            self._plain[place] = self.runs[place].plain
            self._next_change[place] = self.runs[place].next_change
            self._has_drives[place] = self.runs[place].drives is not None
            self._has_laws[place] = self.runs[place].laws is not None

    @abstractmethod
    def _clear(self, simulations: Mapping[int, Simulation]) -> None:
        """Take the machines of simulations, at rest, to their places."""

    @abstractmethod
    def _qpos(self, place: int) -> Floats:
        """Return MuJoCo's qpos at a place, a view."""

    @abstractmethod
    def hook(self) -> AbstractContextManager[Interrupted]:
        """Return a context in which the places can be stepped, see `gantrysim.engine.native.callback`."""

    @abstractmethod
    def step(self, steps: int, numbers: Numbers) -> None:
        """Make physics steps of the simulations at some places."""

    def states(self, numbers: Numbers) -> States:
        """Return copies of the states at some places."""
        return States(
            self._physics(numbers),
            self._drives[numbers] if self._has_drives[numbers].any() else None,
            self._laws[numbers] if self._has_laws[numbers].any() else None,
        )

    def set_states(self, states: States, numbers: Numbers) -> None:
        """Set the states at some places, and forget MuJoCo's warnings."""
        self._set_physics(states.physics, numbers)
        if states.drives is not None:
            self._drives[numbers] = states.drives
        if states.laws is not None:
            self._laws[numbers] = states.laws

    @abstractmethod
    def _physics(self, numbers: Numbers) -> Floats:
        """Return copies of the states of MuJoCo and of the servo at some places, (places, size)."""

    @abstractmethod
    def _set_physics(self, states: Floats, numbers: Numbers) -> None:
        """Set these states, and forget MuJoCo's warnings."""

    def moment(self, place: int) -> Moment:
        """Return a copy of the present moment of the simulation at a place.

        Raises:
            GantryError: a run so long that its log is in a file.
        """
        run = self.runs[place]
        if run.simulation.book.first or len(run.simulation.log.tick) < run.ticks:
            raise GantryError("a run whose log is in a file cannot be copied")
        log = run.simulation.log.until(run.ticks)
        return Moment(
            physics=self._physics(np.array([place]))[0],
            log=Log(log.tick.copy(), log.axis.copy()),
            drives=None if run.drives is None else run.drives.copy(),
            laws=None if run.laws is None else run.laws.copy(),
            user_state=None if run.user_law is None else run.user_law.state.copy(),
        )

    def resume(self, place: int, simulation: Simulation, moment: Moment) -> None:
        """Put a simulation into a place at a moment of another simulation of the same."""
        self.load({place: simulation})
        run = self.runs[place]
        of_process = {name: run.row[name] for name in _OF_PROCESS}
        self._set_physics(moment.physics[None], np.array([place]))
        for name, value in of_process.items():
            run.row[name] = value
        if run.drives is not None:
            run.drives[:] = moment.drives
        if run.laws is not None and moment.laws is not None:
            run.laws[:] = moment.laws
        if run.user_law is not None:
            run.user_law.state[:] = moment.user_state
        ticks = len(moment.log.tick)
        simulation.book.make_room(run.row, 0)
        simulation.log.tick[:ticks], simulation.log.axis[:ticks] = moment.log

    def advance(
        self,
        places: Sequence[int] | Numbers | None = None,
        steps: int | None = None,
        progress: Callable[[int], None] | None = None,
    ) -> None:
        """Step simulations until all are done or have made a number of steps, see `gantrysim.engine.advance`.

        Args:
            places: of the simulations, by default all.
            steps: number of physics steps of each.
            progress: called from time to time with the number of setpoints that all of them have sent.
        """
        stepped = np.array(list(self.runs), np.intp) if places is None else np.asarray(places, np.intp)
        if steps is not None and steps <= MOST_STEPS and progress is None and self._plain[stepped].all():
            # one call, without a look at each run, which would take longer than all else that an agent's decision takes
            done = (self._sent >= self._ticks) | (self._faults != 0)
            running = stepped[~done[stepped]]
            self._pass_changes(running)
            if (self._next_change[running] - self._steps[running] >= steps).all():
                if running.size:
                    with self.hook():
                        step_or_take_back(self, self.runs, steps, running)
                return
        advance(self, {place: self.runs[place] for place in stepped.tolist()}, steps, progress=progress)

    def _pass_changes(self, numbers: Numbers) -> None:
        """Go on with the later models that have begun at some places."""
        for place in numbers[self._next_change[numbers] <= self._steps[numbers]].tolist():
            run = self.runs[place]
            self._next_change[place] = run.next_change
            self._use_model(place, run.number_of_model)

    def _use_model(self, place: int, number: int) -> None:  # noqa: B027  MuJoCo takes it at each step
        """Step another model at a place, the one of a number in `Simulation.later`, counted from 1."""

    def observe(self, place: int, observer: int, argument: int) -> None:
        """Have a C function called within the simulation at a place, at its step "observer_step", see `field`.

        Args:
            place: of a simulation that is loaded; the next one there is not observed.
            observer: address of the function, of the servo's row and the argument.
            argument: for the function.
        """
        row = self.runs[place].row
        row["observer"] = observer
        row["observer_argument"] = argument

    def address(self, place: int) -> int:
        """Return the address of the servo's row of the simulation at a place."""
        return int(self._userdata.ctypes.data) + place * self._userdata.strides[0]

    def stops(self, numbers: Numbers) -> NDArray[np.int64]:
        """Return where the stops of the axes are at some places, see `gantrysim.machine.row`, (places,)."""
        return np.array(self._stops[numbers])

    def field(self, name: str) -> NDArray[Any]:
        """Return a field of all servos' rows, a live view of the state, (places,) and the field's own shape.

        Args:
            name: as in `gantrysim.machine.row`.
        """
        return self._userdata[:, :ROW_NUMBERS].view(ROW)[name][:, 0]


class MuJoCoPlaces(Places):
    """Places that `mujoco.batch` steps on threads, without Python in between.

    Args:
        machine: machine whose MJCF file all simulations share.
        places: number of simulations.
        threads: number of threads; by default all cores.

    Raises:
        InputError: a number of places or threads below one.
    """

    most_steps = MOST_STEPS

    def __init__(self, machine: Machine, places: int, threads: int | None = None) -> None:
        whole_number("places", places, 1)
        threads = 0 if threads is None else whole_number("threads", threads, 1)
        self._batch = mujoco.batch.Batch(machine.physics, places, nthread=threads)
        super().__init__(machine, self._batch.bind("userdata"))
        self._all_qpos = self._batch.bind("qpos")
        # whether the model changes
        self._later = np.zeros(places, bool)
        # of the simulation, before it reaches one
        self._stops_in_model = np.zeros(places, bool)
        self._models = [machine.physics] * places

    def _clear(self, simulations: Mapping[int, Simulation]) -> None:
        for place, simulation in simulations.items():
            self._models[place] = simulation.model
            self._later[place] = bool(simulation.later)
            self._stops_in_model[place] = simulation.stops
        self._batch.set_models(self._models)
        self._batch.reset(list(simulations), stage=mujoco.mjtStage.mjSTAGE_NONE)

    def _qpos(self, place: int) -> Floats:
        qpos: Floats = self._all_qpos[place]
        return qpos

    def hook(self) -> AbstractContextManager[Interrupted]:
        return installed_tick()

    def step(self, steps: int, numbers: Numbers) -> None:
        changing = self._later[numbers] | ((self._stops[numbers] == IN_MODEL) != self._stops_in_model[numbers])
        changed = {place: self.runs[place].model for place in numbers[changing].tolist()}
        if any(self._models[place] is not model for place, model in changed.items()):
            for place, model in changed.items():
                self._models[place] = model
            self._batch.set_models(self._models)
        if self.beside is not None:
            self.beside()
        self._batch.step(None if len(numbers) == len(self._models) else numbers, nstep=steps)

    def _physics(self, numbers: Numbers) -> Floats:
        states: Floats = self._batch.state[numbers]  # a copy
        return states

    def _set_physics(self, states: Floats, numbers: Numbers) -> None:
        self._batch.reset(numbers, stage=mujoco.mjtStage.mjSTAGE_NONE)
        self._batch.state[numbers] = states


_WORTH_A_THREAD = 20_000  # physics steps of the loop


class LoopPlaces(Places):
    """Places that the compiled loop steps, of machines for which `gantrysim.engine.linear` has one.

    It steps models without stops. A simulation that has reached one goes on in MuJoCo. Arguments and errors are those
    of `MuJoCoPlaces`.
    """

    most_steps = 10 * MOST_STEPS

    def __init__(self, machine: Machine, places: int, threads: int | None = None) -> None:
        whole_number("places", places, 1)
        self._threads = (os.cpu_count() or 1) if threads is None else whole_number("threads", threads, 1)
        self._state = np.zeros(places, np.dtype([("physics", STATE), ("row", np.float64, (ROW_NUMBERS,))]))
        self._numbers = self._state.view(np.float64).reshape(places, -1)
        self._dofs = int(machine.layout.nv)
        super().__init__(machine, self._state["row"])
        self._table = np.zeros(places, PLACE)
        for name in ("physics", "row"):
            array = self._state[name]
            self._table[name] = array.ctypes.data + array.strides[0] * np.arange(places)
        self._linear: dict[int, Linear] = {}
        # of simulations that have reached a stop
        self._at_stops: dict[int, mujoco.MjData] = {}
        self._workers: ThreadPoolExecutor | None = None

    def _clear(self, simulations: Mapping[int, Simulation]) -> None:
        for place, simulation in simulations.items():
            if simulation.hindrance is not None:
                raise GantryError(f"the compiled loop cannot step this simulation: {simulation.hindrance}")
            self._at_stops.pop(place, None)
            self._take_machine(place, simulation.linear[0])
        self._state[list(simulations)] = np.zeros((), self._state.dtype)

    def _take_machine(self, place: int, linear: Linear | None) -> None:
        assert linear is not None  # or else the simulation has a hindrance
        self._linear[place] = linear
        self._table["plant"][place] = linear.plant.ctypes.data

    def _use_model(self, place: int, number: int) -> None:
        self._take_machine(place, self.runs[place].simulation.linear[number])

    def _qpos(self, place: int) -> Floats:
        qpos: Floats = self._state["physics"]["place"][place, : self._dofs]
        return qpos

    def hook(self) -> AbstractContextManager[Interrupted]:
        return signals.deferred()

    def step(self, steps: int, numbers: Numbers) -> None:
        self._pass_changes(numbers)
        at_stops = self._stops[numbers] == IN_MODEL
        if self.beside is not None:
            self.beside()
        self._loop(steps, numbers[~at_stops] if at_stops.any() else numbers)
        for place in numbers[at_stops].tolist():
            self._step_in_mujoco(place, steps)

    def _loop(self, steps: int, numbers: Numbers) -> None:
        parts = min(self._threads, len(numbers), 1 + len(numbers) * steps // _WORTH_A_THREAD)
        chosen = np.ascontiguousarray(numbers, np.int64)
        turn = np.zeros(1, np.int64)
        if parts <= 1:
            self._loop_part(steps, chosen, turn)
            return
        if self._workers is None:
            self._workers = ThreadPoolExecutor(self._threads - 1, "loop")
        others = [self._workers.submit(self._loop_part, steps, chosen, turn) for _ in range(1, parts)]
        # this thread would only wait for them
        self._loop_part(steps, chosen, turn)
        for part in others:
            part.result()

    def _loop_part(self, steps: int, numbers: NDArray[np.int64], turn: NDArray[np.int64]) -> None:
        """Step those of some places that no other thread has taken."""
        loop()(self._table.ctypes.data, numbers.ctypes.data, len(numbers), steps, turn.ctypes.data)

    def _step_in_mujoco(self, place: int, steps: int) -> None:
        linear = self._linear[place]
        state = self._state["physics"][place]
        model = self.runs[place].model
        if place not in self._at_stops:
            self._at_stops[place] = mujoco.MjData(model)
            linear.write(state, self._at_stops[place])
        data = self._at_stops[place]
        data.userdata[:ROW_NUMBERS] = self._userdata[place]
        with installed_tick():
            mujoco.mj_step(model, data, steps)
        linear.read(state, data)
        self._userdata[place] = data.userdata[:ROW_NUMBERS]

    def _physics(self, numbers: Numbers) -> Floats:
        return self._numbers[numbers]

    def _set_physics(self, states: Floats, numbers: Numbers) -> None:
        self._numbers[numbers] = states
        for place in numbers.tolist():
            self._at_stops.pop(place, None)


def places_of(machine: Machine, places: int, threads: int | None, engine: Engine) -> Places:
    """Return places that an engine steps; MuJoCo's where the compiled loop cannot step the machine."""
    if engine == "loop" and has_no_constraints_but_stops(machine.layout):
        model = machine.stepping(machine.layout.opt.timestep, stops=False)
        if linear_machine(machine, model) is not None:
            return LoopPlaces(machine, places, threads)
    return MuJoCoPlaces(machine, places, threads)
