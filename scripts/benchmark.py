"""Ratios of what gantrysim costs to what it must cost, in one process, interleaved; above 1 is faster.

python scripts/benchmark.py [--json] [--rounds 15]
"""

import argparse
import json
import statistics
import time
from collections.abc import Callable

import mujoco
from rich.console import Console
from rich.table import Table

from gantrysim import Machine, Servo, simulate
from gantrysim.controllers.trio import MoveSpiral

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
    """simulate with a full log against bare mj_step of the same model and number of steps."""
    machine = Machine("xy")
    servo = Servo.derive(machine.axes, SERVO_PERIOD)
    setpoints = MoveSpiral(120, 4, 10, 100).setpoints(SERVO_PERIOD)
    steps = (len(setpoints.position) - 1) * round(SERVO_PERIOD / PHYSICS_STEP) + 1
    model = machine.stepping(PHYSICS_STEP)

    def bare() -> None:
        mujoco.mj_step(model, mujoco.MjData(model), steps)

    return ratio(bare, lambda: simulate(machine, servo, setpoints, physics_step=PHYSICS_STEP), rounds)


BENCHMARKS = {"engine": engine}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print one object of name to ratio")
    parser.add_argument("--rounds", type=int, default=15, help="pairs of timings per benchmark")
    arguments = parser.parse_args()
    results = {name: benchmark(arguments.rounds) for name, benchmark in BENCHMARKS.items()}
    if arguments.json:
        print(json.dumps(results))
    else:
        table = Table("benchmark", "ratio", "what", title="reference time / gantrysim's time")
        for name, value in results.items():
            table.add_row(name, f"{value:.3f}", (BENCHMARKS[name].__doc__ or "").strip())
        Console().print(table)
