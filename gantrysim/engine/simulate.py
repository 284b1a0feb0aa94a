"""Simulates one run: setpoints, servo and machine, at native speed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from gantrysim.base.errors import InputError, check_type
from gantrysim.base.progress import Progress, shown_progress
from gantrysim.controllers.controller import Controller
from gantrysim.engine.advance import Stepper
from gantrysim.engine.arguments import check_argument
from gantrysim.engine.learning import run_and_learn
from gantrysim.engine.linear import Engine, check_engine
from gantrysim.engine.places import LoopPlaces
from gantrysim.engine.positions import axis_positions
from gantrysim.engine.recording import perfect_record
from gantrysim.engine.rig import Rig
from gantrysim.engine.simulation import Simulation, Start, checked_dispenser
from gantrysim.engine.started import Started
from gantrysim.faults import InjectedFault
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.machine.machine import Machine
from gantrysim.record.run import Run
from gantrysim.record.setpoints import Setpoints
from gantrysim.servo.laws.user import PlainLaw
from gantrysim.servo.servo import Servo


def simulate(
    machine: Machine,
    servo: Servo,
    setpoints: Setpoints | Controller,
    *,
    physics_step: float | None = None,
    dispenser: Dispenser | None = None,
    law: PlainLaw | None = None,
    faults: Sequence[InjectedFault] = (),
    engine: Engine = "mujoco",
    progress: Progress = None,
    start: Start | None = None,
) -> Run:
    """Run setpoints on a machine and return the record.

    The machine starts at rest at the first setpoint, or in a given state. Once per servo period the encoders are
    sampled and the torque demands updated; the physics makes a whole number of steps per period.

    Args:
        machine: the machine.
        servo: the servo, with as many axes as the machine and the setpoints' period.
        setpoints: commanded positions; axes of the machine that they leave out are held at zero. A controller can be
            given instead, for its setpoints at the servo's period.
        physics_step: longest physics step, by default and at most the timestep of the machine's MJCF; it is reduced to
            divide the servo period evenly [s].
        dispenser: dispenser of the glue, by default none.
        law: law in plain Python in place of the servo's own; slower, and only one such run at a time in a process.
        faults: deliberate faults, see `gantrysim.faults`; by default none.
        engine: what makes the physics steps: "mujoco", or "loop", which is some ten times as fast. The compiled loop
            makes those of MuJoCo, but for rounding, where all joints slide and no fault, law in Python or stop of an
            axis asks for more; all other runs are MuJoCo's.
        progress: function called from time to time with the completed share, 0 to 1; True for a progress bar in a
            terminal or a notebook.
        start: state of the axes at the first setpoint, for a run that begins in motion or off it; MuJoCo makes its
            steps. What a servo or a motor remembers besides, such as an integral, is zero.

    Returns:
        The record, longer than the setpoints by the waits at their gates; a fault ends it early. Its verdict, report
        and film have default tolerances and a default bead; a `Job` gives others.

    Raises:
        InputError: an argument of the wrong type, setpoints with an unknown axis, a position beyond the travel, a speed
            above the limit, an unknown engine, a start lead longer than the time before the first dispensing, or a
            deliberate fault that the machine cannot have.
    """
    check_engine(engine)
    if start is not None:
        check_type("start", start, Start, "a Start or None")
    simulation = Simulation.of(machine, servo, setpoints, physics_step=physics_step, dispenser=dispenser, faults=faults)
    if start is not None:
        simulation = replace(simulation, begin=start)
    record = stepped_simulation(simulation, law, engine, progress).record()
    return record.replaced(rig=Rig(machine, servo, simulation.dispenser, has_own_law=law is not None))


def stepped_simulation(
    simulation: Simulation, law: PlainLaw | None = None, engine: Engine = "mujoco", progress: Progress = None
) -> Started:
    """Run a simulation and return it at its end; law, engine and progress as of `simulate`."""
    in_loop = engine == "loop" and law is None and simulation.hindrance is None
    runs = simulation.servo.laws.runs if law is None else 1
    done = 0
    count = runs * len(simulation.position)

    def run(simulations: Sequence[Simulation]) -> list[Started]:
        nonlocal done
        (repeat,) = simulations
        share_done = advance
        report = None if share_done is None else lambda sent: share_done((done + sent) / count)
        if in_loop:
            places = LoopPlaces(repeat.machine, 1, 1)
            places.load({0: repeat})
            places.advance(progress=report)
            started = places.runs[0]
        else:
            stepper = Stepper(repeat)
            stepper.advance(law=law, progress=report)
            started = stepper.run
        done += len(repeat.position)
        return [started]

    with shown_progress("simulate", progress) as advance:
        (started,) = run([simulation]) if law is not None else run_and_learn([simulation], run)
    return started


def records_in_parts(simulation: Simulation, shares: Iterable[float]) -> Iterator[Run]:
    """Yield the record of a run of the compiled loop after some shares of its setpoints, and the complete one.

    What is not asked for is not simulated.

    Args:
        simulation: that the compiled loop can step, and that learns nothing from a complete run.
        shares: of the setpoints, ascending, above 0 and below 1; the next one is asked for where a part is done.
    """
    places = LoopPlaces(simulation.machine, 1, 1)
    places.load({0: simulation})
    run = places.runs[0]
    for share in shares:
        steps = int(share * len(simulation.position)) * simulation.substeps - run.steps
        places.advance(steps=steps)
        if run.done:
            break
        yield run.record(partial=True)
    places.advance()
    yield run.record()


def perfect_follower(machine: Machine, setpoints: Setpoints, *, dispenser: Dispenser | None = None) -> Run:
    """Return the record of a machine that follows its setpoints exactly, without servo, torque, waits or faults.

    It shows the effect on the bead of the controller's program alone.

    Args:
        machine: the machine.
        setpoints: commanded positions; for a controller, `controller.setpoints(period)`.
        dispenser: dispenser of the glue, by default none.

    Raises:
        InputError: as by `simulate`.
    """
    check_argument("machine", machine)
    if isinstance(setpoints, Controller):
        raise InputError("setpoints is a controller: must be Setpoints; write .setpoints(period) behind it")
    check_argument("setpoints", setpoints)
    check_argument("dispenser", dispenser)
    return perfect_record(
        machine, setpoints, axis_positions(machine, setpoints), checked_dispenser(dispenser, setpoints)
    )
