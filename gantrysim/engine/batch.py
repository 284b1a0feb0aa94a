"""Many simulations at once, on threads: `mujoco.batch.Batch` steps them without Python in between."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.errors import InputError
from gantrysim.base.progress import Progress, shown_progress
from gantrysim.controllers.controller import Controller
from gantrysim.engine.arguments import check_argument
from gantrysim.engine.learning import run_and_learn
from gantrysim.engine.linear import Engine, check_engine
from gantrysim.engine.places import LoopPlaces, MuJoCoPlaces
from gantrysim.engine.rig import Rig
from gantrysim.engine.simulation import Simulation
from gantrysim.engine.started import Started
from gantrysim.faults import InjectedFault
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.machine.machine import Machine
from gantrysim.record.run import Runs
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
    engine: Engine = "mujoco",
    device: Literal["cpu", "cuda"] = "cpu",
    progress: Progress = None,
) -> Runs:
    """Run many simulations on threads; the records are those of `simulate` with the same engine, to the last bit.

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
        engine: as in `simulate`.
        device: "cuda" for a GPU that makes the steps of the compiled loop, one simulation in each of its threads; runs
            that the loop cannot make are MuJoCo's, on the processor.
        progress: as in `simulate`.

    Returns:
        The records, in order; `to_frame` of this list has a row of figures for each. A fault ends only its own
        simulation, see `Run.fault`.

    Raises:
        InputError: an argument of the wrong type, lists of different lengths, no simulation at all, a computer without
            the device, or an error of `simulate`, with the number of the simulation.
        MissingPackageError: device "cuda" without numba-cuda.
    """
    check_engine(engine)
    if device not in ("cpu", "cuda"):
        raise InputError(f"device {device!r}: must be cpu or cuda")
    looping: type[LoopPlaces] = LoopPlaces
    if device == "cuda":
        from gantrysim.engine.device import DevicePlaces, check_device

        check_device()
        looping = DevicePlaces
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
        groups: dict[tuple[Path, bool], list[int]] = {}
        for number, simulation in enumerate(several):
            in_loop = (engine == "loop" or device == "cuda") and simulation.hindrance is None
            groups.setdefault((simulation.machine.source, in_loop), []).append(number)
        for (_, in_loop), numbers in groups.items():
            batch = (looping if in_loop else MuJoCoPlaces)(several[numbers[0]].machine, len(numbers), threads)
            batch.load({place: several[number] for place, number in enumerate(numbers)})
            batch.advance(progress=report)
            before += sum(len(several[number].position) for number in numbers)
            done |= {number: batch.runs[place] for place, number in enumerate(numbers)}
        return [done[number] for number in range(len(several))]

    with shown_progress("simulate", progress) as share_done:
        every = run_and_learn(simulations, run)
    return Runs(
        started.record().replaced(rig=Rig(simulation.machine, simulation.servo, simulation.dispenser))
        for simulation, started in zip(simulations, every, strict=True)
    )
