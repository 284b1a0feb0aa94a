"""Ratios of times, taken in turns in one process, and what they should be.

python scripts/benchmark.py [--json] [--rounds 15]
"""

import argparse
import json
import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import mujoco
from rich.console import Console
from rich.table import Table

from gantrysim import Job, Machine, Servo, simulate
from gantrysim.bead import Bead
from gantrysim.budget import Budget
from gantrysim.controllers.path import Path
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.job import builtin_jobs
from gantrysim.metrics import Analysis
from gantrysim.programs import build

SERVO_PERIOD = 1e-3  # [s]
PHYSICS_STEP = 2.5e-4  # [s]


def seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def ratio(reference: Callable[[], object], ours: Callable[[], object], rounds: int) -> float:
    """Return the median of reference time over our time; the two take turns, each going first every other time."""
    reference(), ours()
    ratios = []
    for k in range(rounds):
        if k % 2:
            bare, own = seconds(reference), seconds(ours)
        else:
            own, bare = seconds(ours), seconds(reference)
        ratios.append(bare / own)
    return statistics.median(ratios)


def engine(rounds: int) -> float:
    """bare mj_step against simulate with a full log, of the same model and number of steps."""
    machine = Machine("xy")
    servo = Servo.derive(machine.axes, SERVO_PERIOD)
    setpoints = MoveSpiral(120, 4, 10, 100).setpoints(SERVO_PERIOD)
    steps = (len(setpoints.position) - 1) * round(SERVO_PERIOD / PHYSICS_STEP) + 1
    model = machine.stepping(PHYSICS_STEP)

    def bare() -> None:
        mujoco.mj_step(model, mujoco.MjData(model), steps)

    return ratio(bare, lambda: simulate(machine, servo, setpoints, physics_step=PHYSICS_STEP), rounds)


def setpoints(rounds: int) -> float:
    """generation of the setpoints, from the program's text on, against their simulation; the worst of the jobs."""

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
        kind, parameters = type(run.requested).__name__, run.requested.parameters()

        def analyse() -> None:
            fresh = replace(run, requested=Path.build(kind, parameters))  # without the tables of an earlier analysis
            found = Analysis(fresh)
            _ = found.figures, Budget(found).figures, Bead(fresh, job.bead, found).figures

        return 1 / ratio(job.run, analyse, max(rounds // 3, 1))

    return max(share(name) for name in builtin_jobs())


class Benchmark(NamedTuple):
    measure: Callable[[int], float]
    wanted: str


BENCHMARKS = {
    "engine": Benchmark(engine, "at least 0.90"),
    "setpoints": Benchmark(setpoints, "at most 0.10"),
    "analysis": Benchmark(analysis, "at most 1.00"),
}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print one object of name to ratio")
    parser.add_argument("--rounds", type=int, default=15, help="pairs of timings per benchmark")
    arguments = parser.parse_args()
    results = {name: benchmark.measure(arguments.rounds) for name, benchmark in BENCHMARKS.items()}
    if arguments.json:
        print(json.dumps(results))
    else:
        table = Table("benchmark", "ratio", "wanted", "what")
        for name, value in results.items():
            benchmark = BENCHMARKS[name]
            table.add_row(name, f"{value:.3f}", benchmark.wanted, (benchmark.measure.__doc__ or "").strip())
        Console().print(table)
