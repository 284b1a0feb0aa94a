"""Ratios of times, taken in turns in one process, and what they should be.

Bare MuJoCo has its timers off, as gantrysim turns them off while it steps: what is compared is gantrysim's own share.

python scripts/benchmark.py [--json] [--rounds 15] [KEY ...]
"""

import argparse
import itertools
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import gymnasium
import mujoco
import numpy as np
from mujoco.batch import Batch
from rich.console import Console
from rich.table import Table

import gantrysim.env  # noqa: F401 - registers the environments
from gantrysim import Job, Machine, Servo, simulate, simulate_batch
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.engine.advance import Stepper
from gantrysim.engine.native.callback import clock
from gantrysim.engine.places import LoopPlaces
from gantrysim.engine.simulation import Simulation
from gantrysim.glue.bead import Bead
from gantrysim.job.loading import builtin_jobs
from gantrysim.job.programs import build
from gantrysim.machine.perturbation import Perturbation
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.paths.kinds import kind_of, path_of
from gantrysim.record.setpoints import Setpoints
from gantrysim.remedy.improve import improve
from gantrysim.render import Film, Take
from gantrysim.study.cases import Case, measure
from gantrysim.study.run import run_study
from gantrysim.study.tuning.study import TuningStudy

SIDE_BY_SIDE = 64  # simulations or environments at once
DECISIONS = 20  # in every environment, at a time
FILM = (960, 540)  # as gantrysim run writes it
RATE = 25  # of its pictures [1/s]
FRAMES = 4  # at a time
SWING = 400  # steps with one direction of the torque
ENV = "gantrysim/GainBandit-v0"
INTERVAL = 0.1  # between its decisions [s]
ALONE = ("--no-causes", "--no-improve")  # options of the command for no run but the job's
COMMAND = "from gantrysim.cli.start import main; main()"  # as the installed command begins
# ends the command at the moment its verdict is printed
TO_VERDICT = """
import os, sys
os.environ["OPENBLAS_NUM_THREADS"] = "1"  # as the command sets it, before it imports NumPy
from gantrysim.cli import evaluation
from gantrysim.cli.start import main

show = evaluation.show_verdict

def show_and_end(verdict):
    show(verdict)
    sys.stdout.flush()
    os._exit(0)

evaluation.show_verdict = show_and_end
main()
"""
NEAR = 0.2  # of the action space: near enough to the derived gains for no episode to end in a fault


def speed(work: Callable[[], object]) -> float:
    """Return the physics steps per second of a work that returns how many it makes, or its calls per second."""
    start = time.perf_counter()
    done = work()
    return (done if isinstance(done, int) else 1) / (time.perf_counter() - start)


def ratio(reference: Callable[[], object], ours: Callable[[], object], rounds: int) -> float:
    """Return the median of our speed over the reference's; the two take turns, each going first every other time."""
    reference(), ours()
    ratios = []
    for k in range(rounds):
        if k % 2:
            bare, own = speed(reference), speed(ours)
        else:
            own, bare = speed(ours), speed(reference)
        ratios.append(own / bare)
    return statistics.median(ratios)


def spiral(diameter: float, turns: int) -> tuple[Machine, Servo, Setpoints, int]:
    """Return a machine, its servo, setpoints of a spiral, and the number of physics steps they take."""
    machine = Machine("xy")
    servo = Servo.derive(machine.axes)
    setpoints = MoveSpiral(diameter, turns, 10, 100).setpoints(servo.period)
    steps = (len(setpoints.position) - 1) * round(servo.period / machine.model.opt.timestep) + 1
    return machine, servo, setpoints, steps


def to_and_fro(machine: Machine, steps: int) -> None:
    """Bare mj_step of the model that simulate steps; it moves, as friction costs more in motion than at rest."""
    model = machine.stepping(machine.physics.opt.timestep)
    data = mujoco.MjData(model)
    torque = np.array([2 * axis.coulomb for axis in machine.axes])
    for k in range(0, steps, SWING):
        data.ctrl[:] = torque if k // SWING % 2 else -torque
        mujoco.mj_step(model, data, min(SWING, steps - k))


def engine(rounds: int) -> float:
    """simulate, from the setpoints to the record, over bare mj_step of the same model in motion, as many steps."""
    machine, servo, setpoints, steps = spiral(120, 4)
    return ratio(lambda: to_and_fro(machine, steps), lambda: simulate(machine, servo, setpoints), rounds)


def servo(rounds: int) -> float:
    """the steps of simulate alone, with the servo within, over the same bare mj_step."""
    machine, servo, setpoints, steps = spiral(120, 4)
    simulation = Simulation.of(machine, servo, setpoints)
    return ratio(lambda: to_and_fro(machine, steps), lambda: Stepper(simulation).advance(), rounds)


def converged_cost(rounds: int) -> float:
    """the an225 job against itself with the physics as MuJoCo compiles it: a motor's force one step early."""
    job = Job.load("an225")
    early = Machine(job.machine)
    early.physics.actuator_actearly[:] = True
    return 1 / ratio(lambda: job.run(machine=early), job.run, rounds)


def loop(rounds: int) -> float:
    """the steps of the compiled loop, with the servo within, over bare mj_step, both on one core."""
    machine, servo, setpoints, steps = spiral(120, 4)
    simulation = Simulation.of(machine, servo, setpoints)

    def ours() -> int:
        places = LoopPlaces(machine, 1, 1)
        places.load({0: simulation})
        places.advance()
        return steps

    def bare() -> int:
        to_and_fro(machine, steps)
        return steps

    return ratio(bare, ours, rounds)


def batch(rounds: int) -> float:
    """64 runs by simulate_batch, records and all, over bare mujoco.batch of the machine's MJCF, on as many threads."""
    machine, servo, setpoints, steps = spiral(60, 2)

    def bare() -> None:
        Batch(machine.model, SIDE_BY_SIDE).step(nstep=steps)

    return ratio(bare, lambda: simulate_batch(machine, [servo] * SIDE_BY_SIDE, setpoints, engine="loop"), rounds)


def import_time(rounds: int) -> float:
    """import of what a simulation needs against import of mujoco, numpy and numba alone, each in a fresh process."""
    # with bytecode, as installed packages have it: else a checkout's is compiled anew in every process
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": ""}

    def fresh(code: str) -> Callable[[], object]:
        return lambda: subprocess.run([sys.executable, "-c", code], check=True, env=environment)

    names = "Machine, Servo, simulate, Dispenser, Budget, Run"
    return 1 / ratio(fresh("import mujoco, numpy, numba"), fresh(f"from gantrysim import {names}"), rounds)


def children() -> float:
    """Return the CPU time of the processes that this one has begun and that have ended [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def command(*options: str, code: str = COMMAND, compiled: bool = True) -> float:
    """Return the CPU time of `gantrysim run an225` in a process of its own [s].

    Args:
        options: of the command.
        code: that runs it.
        compiled: whether numba's cache holds what is compiled; otherwise it is empty.
    """
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": ""}
    before = children()
    with tempfile.TemporaryDirectory() as folder:
        if not compiled:
            environment["NUMBA_CACHE_DIR"] = f"{folder}/cache"
        words = [sys.executable, "-c", code, "run", "an225", "--out", f"{folder}/out", *options]
        subprocess.run(words, check=True, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return children() - before


def over_simulation(rounds: int, spent: Callable[[], float]) -> float:
    """Return the median of a CPU time over that of the simulation of an225 alone, measured in turns."""
    job = Job.load("an225")

    def simulation() -> float:
        before = time.process_time()
        job.run()
        return time.process_time() - before

    simulation()  # which fills the caches; a first command with empty ones does not change the median
    return statistics.median(spent() / simulation() for _ in range(rounds))


def verdict(rounds: int) -> float:
    """CPU time of `gantrysim run an225`, from the start of its process to the verdict, over the simulation's alone."""
    return over_simulation(max(rounds // 3, 1), lambda: command(code=TO_VERDICT))


def first_run(rounds: int) -> float:
    """the same with nothing compiled before: CPU time until the verdict, over the simulation's alone."""
    return over_simulation(max(rounds // 15, 1), lambda: command(code=TO_VERDICT, compiled=False))


def page(rounds: int) -> float:
    """CPU time of the plots and the page of an225, over its simulation's: of the command with them less without."""

    def spent() -> float:
        return command(*ALONE, "--no-video") - command(*ALONE, "--no-video", "--no-report")

    return over_simulation(max(rounds // 3, 1), spent)


def film(rounds: int) -> float:
    """CPU time of the film of an225, encoded, over its simulation's: of the command with it less without."""

    def spent() -> float:
        return command(*ALONE, "--no-report") - command(*ALONE, "--no-report", "--no-video")

    return over_simulation(max(rounds // 15, 1), spent)


def setpoints(rounds: int) -> float:
    """program of the setpoints, from the program's text on, against their simulation; the worst of the jobs."""

    def share(name: str) -> float:
        job = Job.load(name)
        _ = job.setpoints, job.built_machine
        values = {key: value for key, value in job.program.items() if key != "controller"}
        program = partial(build, job.program["controller"], values)
        return 1 / ratio(job.run, lambda: program().setpoints(job.servo.period), max(rounds // 3, 1))

    return max(share(name) for name in builtin_jobs())


def analysis(rounds: int) -> float:
    """all figures of a run, its error budget and its bead on the map, against its simulation; the worst of the jobs."""

    def share(name: str) -> float:
        job = Job.load(name)
        run = job.run()
        kind, parameters = kind_of(run.requested), run.requested.parameters()

        def analyse() -> None:
            fresh = replace(run, requested=path_of(kind, parameters))  # without the tables of an earlier analysis
            found = Analysis(fresh)
            _ = found.values, Budget(found).values, Bead(fresh, job.bead, found).values

        return 1 / ratio(job.run, analyse, max(rounds // 3, 1))

    return max(share(name) for name in builtin_jobs())


def vector_env(rounds: int, task: str = ENV) -> float:
    """64 environments of GainBandit, resets and all, over bare mujoco.batch of the same model, on all threads."""
    envs = gymnasium.make_vec(task, num_envs=SIDE_BY_SIDE, decision_interval=INTERVAL)
    envs.reset(seed=0)
    envs.action_space.seed(0)
    machine = Machine("xy")
    model = machine.stepping(machine.physics.opt.timestep)
    steps = round(envs.unwrapped.settings.decision_interval / model.opt.timestep)
    simulations = Batch(model, SIDE_BY_SIDE)
    torque = np.array([2 * axis.coulomb for axis in machine.axes])
    over = np.zeros(SIDE_BY_SIDE, bool)

    def bare() -> int:
        for k in range(DECISIONS):
            simulations.ctrl = torque if k % 2 else -torque
            simulations.step(nstep=steps)
        return DECISIONS * SIDE_BY_SIDE * steps

    def ours() -> int:
        made = 0
        for _ in range(DECISIONS):
            made += steps * np.count_nonzero(~over)  # one whose episode is over is reset instead
            _, _, terminated, truncated, _ = envs.step(NEAR * envs.action_space.sample())
            over[:] = terminated | truncated
        return int(made)

    for _ in range(200 // DECISIONS):  # until the episodes have come out of step
        ours()
    return ratio(bare, ours, rounds)


def bead_env(rounds: int) -> float:
    """the same with environments of BeadWidth."""
    return vector_env(rounds, "gantrysim/BeadWidth-v1")


def speed_env(rounds: int) -> float:
    """the same with environments of SpeedOverride."""
    return vector_env(rounds, "gantrysim/SpeedOverride-v1")


def torque_env(rounds: int) -> float:
    """the same with environments of ServoTorque."""
    return vector_env(rounds, "gantrysim/ServoTorque-v1")


def tuning_env(rounds: int) -> float:
    """the same with environments of SpiralTuning."""
    return vector_env(rounds, "gantrysim/SpiralTuning-v0")


def over_steps(rounds: int, name: str, work: Callable[[Job], object]) -> float:
    """Return the processor time of a work on a job over that of as many bare mj_steps as its run makes."""
    job = Job.load(name)
    steps = len(job.setpoints.position) * round(job.built_servo.period / job.built_machine.physics.opt.timestep)
    work(job)

    def spent(measured: Callable[[], object]) -> float:
        begin = time.process_time()
        measured()
        return time.process_time() - begin

    pairs = [
        (spent(lambda: to_and_fro(job.built_machine, steps)), spent(lambda: work(job)))
        for _ in range(max(rounds // 5, 1))
    ]
    return statistics.median(own / bare for bare, own in pairs)


def study_case(rounds: int) -> float:
    """a case of `study machine` on an225, from its machine to its row, over the bare mj_steps of its run."""
    drawn = iter(np.random.default_rng(0).uniform(0.9, 1.1, 1000))

    def case(job: Job) -> None:
        measure(Case.of(job, perturbation=Perturbation(friction=float(next(drawn)))))

    return over_steps(rounds, "an225", case)


def improving(rounds: int) -> float:
    """`improve an225` over the bare mj_steps of the job's run."""
    return over_steps(rounds, "an225", lambda job: improve(job, workers=1))


def tuning(rounds: int) -> float:
    """`tune softmc-arc --budget 100`, report and all, over the bare mj_steps of the job's run."""

    def tune(job: Job) -> None:
        with tempfile.TemporaryDirectory() as folder:
            run_study(TuningStudy(job, budget=100), Path(folder), workers=1)

    return over_steps(min(rounds, 5), "softmc-arc", tune)


def scalar_env(rounds: int) -> float:
    """scalar environment over Gymnasium's InvertedPendulum-v5, physics steps per second of random episodes."""

    def episodes(env: gymnasium.Env, frame_skip: int, scale: float, decisions: int) -> Callable[[], int]:
        env.reset(seed=0)
        env.action_space.seed(0)

        def run() -> int:
            for _ in range(decisions):
                _, _, terminated, truncated, _ = env.step(scale * env.action_space.sample())
                if terminated or truncated:
                    env.reset()
            return decisions * frame_skip

        return run

    frame_skip = round(INTERVAL / Machine("xy").model.opt.timestep)
    pendulum = episodes(gymnasium.make("InvertedPendulum-v5"), 2, 1.0, 5000)
    ours = episodes(gymnasium.make(ENV, decision_interval=INTERVAL), frame_skip, NEAR, 200)
    return ratio(pendulum, ours, rounds)


def filmed(begin: float, end: float, camera: str | None = "overview") -> tuple[Film, Callable[[], None]]:
    """A film of Trio's spiral, and what draws its frames at times between two shares of the run, panel and all."""
    job = Job.load("an225")
    run = job.run()
    film = Film([Take(job.built_machine, run, job.name, job.bead, run.known_verdict)], camera=camera, size=FILM)
    times = itertools.cycle(np.linspace(begin, end, FRAMES) * film.end)
    return film, lambda: frames(lambda: film.frame(next(times)))


def frames(draw: Callable[[], object]) -> None:
    for _ in range(FRAMES):
        draw()


def standing_still(film: Film, model: mujoco.MjModel) -> tuple[mujoco.Renderer, Callable[[], None]]:
    """MuJoCo's own renderer with pictures of the film's size, and what draws a scene in which nothing moves."""
    (cell,) = film.cells
    renderer = mujoco.Renderer(model, cell.height, cell.width)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    renderer.update_scene(data, "overview")
    return renderer, lambda: frames(renderer.render)


def frame_growth(rounds: int) -> float:
    """a film's frame in the last second of Trio's spiral against one in the first second."""
    (first, begin), (last, end) = filmed(0.0, 0.1), filmed(0.9, 1.0)
    with first, last:
        return 1 / ratio(begin, end, rounds)


def frame_cost(rounds: int) -> float:
    """a second of a film, encoded, against MuJoCo's own render() of so many pictures of the scene standing still."""
    film, _ = filmed(0.0, 1.0, camera=None)
    with film, tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "film.mp4"
        film.frame(film.end)
        bare, still = standing_still(film, film.models[0])
        with bare:

            def whole() -> int:
                return film.save(file, speed=film.end)  # a second, with the whole machine and the flight

            def pictures() -> int:
                for _ in range(RATE // FRAMES):
                    still()
                return RATE // FRAMES * FRAMES

            return 1 / ratio(pictures, whole, max(rounds // 3, 1))


def bead_cost(rounds: int) -> float:
    """a film's frame with the whole bead of Trio's spiral against MuJoCo's own render() of the machine without one."""
    film, draw = filmed(0.99, 1.0)
    bare, still = standing_still(film, Machine("xy").model)
    with film, bare:
        return 1 / ratio(still, draw, rounds)


class Benchmark(NamedTuple):
    """A ratio and what it should be."""

    measure: Callable[[int], float]
    wanted: str


BENCHMARKS = {
    "engine": Benchmark(engine, "at least 0.95"),
    "servo": Benchmark(servo, "at least 0.96"),
    "loop": Benchmark(loop, "at least 10.0"),
    "converged_cost": Benchmark(converged_cost, "at most 1.50"),
    "batch": Benchmark(batch, "at least 1.55"),
    "vector_env": Benchmark(vector_env, "at least 2.00"),
    "bead_env": Benchmark(bead_env, "at least 4.00"),
    "speed_env": Benchmark(speed_env, "at least 2.00"),
    "torque_env": Benchmark(torque_env, "at least 2.00"),
    "tuning_env": Benchmark(tuning_env, "at least 2.00"),
    "scalar_env": Benchmark(scalar_env, "at least 5.00"),
    "study_case": Benchmark(study_case, "at most 1.00"),
    "improve": Benchmark(improving, "at most 40.0"),
    "tune": Benchmark(tuning, "at most 100"),
    "import_time": Benchmark(import_time, "at most 1.40"),
    "frame_growth": Benchmark(frame_growth, "at most 1.30"),
    "frame_cost": Benchmark(frame_cost, "at most 1.50"),
    "bead_cost": Benchmark(bead_cost, "at most 8.00"),
    "first_run": Benchmark(first_run, "at most 210"),
    "verdict": Benchmark(verdict, "at most 20.0"),
    "page": Benchmark(page, "at most 45.0"),
    "film": Benchmark(film, "at most 175"),
    "setpoints": Benchmark(setpoints, "at most 0.10"),
    "analysis": Benchmark(analysis, "at most 1.00"),
}


def measured(names: Iterable[str], rounds: int) -> dict[str, float]:
    """Return ratios by their names, without MuJoCo's timers in bare MuJoCo."""
    before = mujoco.get_mjcb_time()
    mujoco.set_mjcb_time(clock())
    try:
        return {name: BENCHMARKS[name].measure(rounds) for name in names}
    finally:
        mujoco.set_mjcb_time(before)


if __name__ == "__main__":
    warnings.filterwarnings("ignore", module="glfw")  # MuJoCo tries it before what needs no display
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "keys", metavar="KEY", nargs="*", choices=[*BENCHMARKS, []], help="benchmarks to run, by default all"
    )
    parser.add_argument("--json", action="store_true", help="print one object of name to ratio")
    parser.add_argument("--rounds", type=int, default=15, help="pairs of timings per benchmark")
    arguments = parser.parse_args()
    ratios = measured(arguments.keys or list(BENCHMARKS), arguments.rounds)
    if arguments.json:
        print(json.dumps(ratios))
    else:
        table = Table("benchmark", "ratio", "wanted", "what")
        for name, value in ratios.items():
            benchmark = BENCHMARKS[name]
            what = (benchmark.measure.__doc__ or "").strip()
            table.add_row(name, f"{value:.3f}", benchmark.wanted, what)
        Console().print(table)
