"""Many simulations at once, on threads: `mujoco.batch.Batch` steps them without Python in between."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import mujoco.batch
import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import GantryError, InputError, whole
from gantrysim.base.progress import Progress, shown_progress
from gantrysim.controllers.controller import Controller
from gantrysim.engine.advance import MOST_STEPS, Numbers, advance, step_or_take_back
from gantrysim.engine.arguments import check_argument
from gantrysim.engine.learning import run_and_learn
from gantrysim.engine.native.hook import installed_tick
from gantrysim.engine.simulation import Simulation
from gantrysim.engine.started import Started
from gantrysim.faults import InjectedFault
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.machine.machine import Machine
from gantrysim.machine.row import IN_MODEL, OFFSETS, ROW, ROW_NUMBERS, Log
from gantrysim.record.runs import Runs
from gantrysim.record.setpoints import Setpoints
from gantrysim.servo.servo import Servo

# The arguments of a batch: one value for all simulations, or one for each.


def per_simulation(faults: Sequence[Any]) -> Any:
    """Return the faults of all simulations as one value, those of each as a list."""
    check_argument("faults", faults)
    if not any(isinstance(item, list | tuple) for item in faults):
        return _Faults(faults)
    return [_Faults(item) if isinstance(item, list | tuple) else item for item in faults]


class _Faults:
    """The faults of a simulation, which as a sequence would be one value per simulation."""

    def __init__(self, faults: Sequence[InjectedFault]) -> None:
        self.faults = tuple(faults)


def simulations_of(**arguments: Any) -> list[Simulation]:
    """Return the simulations of a batch; arguments as of `gantrysim.simulate_batch`, faults by `per_simulation`."""
    several: dict[str, list[Any]] = {}
    for name, value in arguments.items():
        if isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim):
            several[name] = list(value)
        for number, item in enumerate(several.get(name, [value])):
            given = item.faults if isinstance(item, _Faults) else item
            if name in several:
                check_argument(name, given, place=f"[{number}]")
            else:
                check_argument(name, given, alternative=", or a list, a tuple or an array of them")
    lengths = {name: len(values) for name, values in several.items()}
    if len(set(lengths.values())) > 1:
        counts = ", ".join(f"{length} of {name}" for name, length in lengths.items())
        raise InputError(f"a batch of {counts}: must be one for all, or as many of each")
    count = min(lengths.values(), default=1)
    if not count:
        raise InputError("a batch of no simulation: must have at least one")
    simulations = []
    for k in range(count):
        chosen = {name: several[name][k] if name in several else value for name, value in arguments.items()}
        try:
            simulations.append(Simulation.of(**{**chosen, "faults": chosen["faults"].faults}))
        except InputError as error:
            raise InputError(f"simulation {k} of the batch: {error}") from None
    return simulations


def simulate_batch(
    machine: Machine | Sequence[Machine],
    servo: Servo | Sequence[Servo],
    setpoints: Setpoints | Controller | Sequence[Setpoints | Controller],
    *,
    physics_step: float | Sequence[float | None] | NDArray[Any] | None = None,
    dispenser: Dispenser | Sequence[Dispenser | None] | None = None,
    faults: Sequence[InjectedFault] | Sequence[Sequence[InjectedFault]] = (),
    threads: int | None = None,
    progress: Progress = None,
) -> Runs:
    """Run many simulations on threads and return their records, identical to those of `simulate` to the last bit.

    Each argument is either one value for all simulations, or a list, tuple or array with one per simulation. MJCF
    files, servo periods and lengths may differ; machines from the same file, perturbed or not, share a MuJoCo batch.

    Args:
        machine: the machines.
        servo: the servos.
        setpoints: the commanded positions, or controllers, see `simulate`.
        physics_step: longest physics step, see `simulate` [s].
        dispenser: dispenser of the glue, see `simulate`.
        faults: deliberate faults common to all simulations, or a sequence of them for each.
        threads: number of threads; by default all cores.
        progress: as in `simulate`.

    Returns:
        The records, in order; `to_frame` of this list has a row of figures for each. A fault ends only its own
        simulation, see `Run.fault`.

    Raises:
        InputError: an argument of the wrong type, lists of different lengths, no simulation at all, or an error of
            `simulate`, with the number of the simulation.
    """
    simulations = simulations_of(
        machine=machine,
        servo=servo,
        setpoints=setpoints,
        physics_step=physics_step,
        dispenser=dispenser,
        faults=per_simulation(faults),
    )
    total = sum(simulation.servo.laws.runs * len(simulation.position) for simulation in simulations)
    before = 0

    def run(several: Sequence[Simulation]) -> list[Started]:
        nonlocal before

        def report(sent: int) -> None:
            if share_done is not None:
                share_done((before + sent) / total)

        done: dict[int, Started] = {}
        # numbers of the simulations by MJCF file
        groups: dict[Path, list[int]] = {}
        for number, simulation in enumerate(several):
            groups.setdefault(simulation.machine.source, []).append(number)
        for numbers in groups.values():
            batch = Batch(several[numbers[0]].machine, len(numbers), threads)
            batch.load({place: several[number] for place, number in enumerate(numbers)})
            batch.advance(progress=report)
            before += sum(len(several[number].position) for number in numbers)
            done |= {number: batch.runs[place] for place, number in enumerate(numbers)}
        return [done[number] for number in range(len(several))]

    with shown_progress("simulate", progress) as share_done:
        every = run_and_learn(simulations, run)
    return Runs(started.record() for started in every)


# of a servo's row: they belong to the process and to a simulation's own arrays, not to the state of a run
_OBSERVER = ("observer", "observer_argument", "observer_step")
_OF_PROCESS = ("magic", "setpoints", "log", "axis_log", "gates", "stages", *_OBSERVER, *OFFSETS)


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


class Batch:
    """Places for simulations of one machine, perturbed or not, that are stepped together.

    Args:
        machine: machine whose MJCF file all simulations share.
        places: number of simulations.
        threads: number of threads; by default all cores.

    Attributes:
        runs: the simulations by place, once they are loaded.
        beside: called when Python is about to wait for the simulations, to start what other threads do meanwhile.

    Raises:
        InputError: a number of places or threads below one.
    """

    def __init__(self, machine: Machine, places: int, threads: int | None = None) -> None:
        whole("places", places, 1)
        threads = 0 if threads is None else whole("threads", threads, 1)
        self._batch = mujoco.batch.Batch(machine.physics, places, nthread=threads)
        self._qpos = self._batch.bind("qpos")
        self._userdata = self._batch.bind("userdata")
        self._sent, self._ticks, self._faults = map(self.field, ("index", "ticks", "fault"))
        self._stops = self.field("stops")
        self._plain = np.zeros(places, bool)
        # whether the model changes
        self._later = np.zeros(places, bool)
        # whether drives or laws have a state
        self._stateful = np.zeros(places, bool)
        # of the simulation, before it reaches one
        self._stops_in_model = np.zeros(places, bool)
        self._models = [machine.physics] * places
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
        for place, simulation in simulations.items():
            if simulation.machine.source != self._source:
                raise GantryError(f"a batch of {self._source} cannot take a simulation of {simulation.machine.source}")
            self._models[place] = simulation.model
        self._batch.set_models(self._models)
        self._batch.reset(list(simulations), stage=mujoco.mjtStage.mjSTAGE_NONE)
        for place, simulation in simulations.items():
            # kept alive before its row is armed with addresses of its arrays
            self._loaded[place] = simulation
            self.runs[place] = Started.of(simulation, self._qpos[place], self._userdata[place])
            self._plain[place] = self.runs[place].plain
            self._later[place] = bool(simulation.later)
            self._stateful[place] = self.runs[place].has_state
            self._stops_in_model[place] = simulation.stops

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
            physics=self._batch.state[place].copy(),
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
        self._batch.state[place] = moment.physics
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
            progress: called after every call of MuJoCo with the number of setpoints that all of them have sent.
        """
        stepped = np.array(list(self.runs), np.intp) if places is None else np.asarray(places, np.intp)
        if steps is not None and steps <= MOST_STEPS and progress is None and self._plain[stepped].all():
            # one call, without a look at each run, which would take longer than all else that an agent's decision takes
            done = (self._sent >= self._ticks) | (self._faults != 0)
            running = stepped[~done[stepped]]
            if running.size:
                with installed_tick():
                    step_or_take_back(self, self.runs, steps, running)
            return
        advance(self, {place: self.runs[place] for place in stepped.tolist()}, steps, progress=progress)

    def step(self, steps: int, numbers: Numbers) -> None:
        """Make physics steps of the simulations at some places."""
        changing = self._later[numbers] | ((self._stops[numbers] == IN_MODEL) != self._stops_in_model[numbers])
        changed = {place: self.runs[place].model for place in numbers[changing].tolist()}
        if any(self._models[place] is not model for place, model in changed.items()):
            for place, model in changed.items():
                self._models[place] = model
            self._batch.set_models(self._models)
        if self.beside is not None:
            self.beside()
        self._batch.step(None if len(numbers) == len(self._models) else numbers, nstep=steps)

    def observe(self, place: int, observer: int, argument: int) -> None:
        """Have a C function called within the simulation at a place, at its step "observer_step", see `field`.

        Args:
            place: of a simulation that is loaded; the next one there is not observed.
            observer: address of the function, of mjData, the servo's row and the argument.
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

    def with_state(self, numbers: Numbers) -> list[int]:
        """Return those of some places whose drives or laws have a state."""
        return numbers[self._stateful[numbers]].tolist()

    def states(self, numbers: Numbers) -> Floats:
        """Return copies of MuJoCo's states at some places, (places, size)."""
        states: Floats = self._batch.state[numbers]  # a copy
        return states

    def set_states(self, states: Floats, numbers: Numbers) -> None:
        """Set MuJoCo's states at some places, and forget its warnings."""
        self._batch.reset(numbers, stage=mujoco.mjtStage.mjSTAGE_NONE)
        self._batch.state[numbers] = states

    def field(self, name: str) -> NDArray[Any]:
        """Return a field of all servos' rows, a live view of the state, (places,) and the field's own shape.

        Args:
            name: as in `gantrysim.machine.row`.
        """
        return self._userdata[:, :ROW_NUMBERS].view(ROW)[name][:, 0]
