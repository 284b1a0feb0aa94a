"""How busy a study of many short runs keeps two worker processes of a Dask cluster on this machine.

python scripts/scale_out.py [--runs 10000] [--json]

Each run is a short spiral on a machine drawn from its tolerances. Printed are the share of their time that the workers
spend in runs, what the study adds to a run, rows in the ledger when half the runs are done, and the memory of study,
scheduler, which is a thread of the study here, and workers after a tenth of the runs and at the end; by how much a row
makes the study grow in between, and how long its line in the ledger is.
"""

import argparse
import gc
import json
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import dask
import numpy as np
import psutil
from distributed import LocalCluster

from gantrysim import Job
from gantrysim.machine.perturbation import Perturbation
from gantrysim.study import Case, Ledger, measure, on_backend, run_cases
from gantrysim.study.cases import Row
from gantrysim.study.ledger import LEDGER

WORKERS = 2
# Dask's workers keep an hour of profiles and events, and its scheduler the tasks of the last transitions in its log,
# which is not the study's memory
DASK = {"distributed.worker.profile.enabled": False, "distributed.admin.low-level-log-length": 100}
SETTINGS = ["turns=1", "diameter=30", "thickness=5", "speed=150", "loop_period=0.05", "simulation.settle=0.05"]
FIRST = 0.1  # share of the runs after which everything is imported, compiled and cached


def timed(case: Case) -> Row:
    """Measure a case, and when that begins and ends [s]."""
    begin = time.time()
    row = measure(case)
    return {**row, "begin": begin, "end": time.time()}


def drawn_cases(runs: int) -> list[Case]:
    """Return one job on as many machines."""
    job = Job.load("an225", SETTINGS)
    random = np.random.default_rng(0)
    return [
        Case.of(job, perturbation=Perturbation(friction=factor), number=number)
        for number, factor in enumerate(random.uniform(0.7, 1.3, runs).tolist())
    ]


def memory() -> dict[str, float | list[float]]:
    """Return the resident memory of this process and of its children, largest first [MB]."""
    gc.collect()  # Dask's messages leave cycles of objects behind
    here = psutil.Process()
    others = sorted((child.memory_info().rss for child in here.children(recursive=True)), reverse=True)
    return {"study": here.memory_info().rss / 1e6, "others": [round(rss / 1e6) for rss in others]}


def watch(runs: int, first: float, folder: Path, seen: dict[str, Any]) -> Callable[[int, int], None]:
    """Return a progress that notes the memory at the first share of the runs, and the rows on disk at half."""

    def progress(done: int, every: int) -> None:
        if done >= first * runs and "memory_first" not in seen:  # lots of cases may step over it
            seen["done_at_first"] = done
            seen["memory_first"] = memory()
        if done >= runs / 2 and "rows_on_disk" not in seen:
            seen["done_at_half"] = done
            seen["rows_on_disk"] = (folder / LEDGER).read_bytes().count(b"\n") - 1

    return progress


def scaled_out(runs: int, first: float = FIRST) -> dict[str, Any]:
    """Run so many cases on the workers and return what was measured, after the first share of them."""
    cases = drawn_cases(runs)
    seen: dict[str, Any] = {}
    with (
        dask.config.set(DASK),
        tempfile.TemporaryDirectory() as name,
        LocalCluster(WORKERS, threads_per_worker=1, host="127.0.0.1", dashboard_address=None) as cluster,
        on_backend(f"dask={cluster.scheduler_address}"),
        Ledger(Path(name), {}) as ledger,
    ):
        begin = time.process_time()
        rows = run_cases(cases, ledger, measure=timed, progress=watch(runs, first, Path(name), seen))
        seen["study_cpu_ms_per_run"] = 1e3 * (time.process_time() - begin) / runs
        seen["memory_last"] = memory()
        seen["ledger_bytes_per_row"] = (Path(name) / LEDGER).stat().st_size / runs
    growth = seen["memory_last"]["study"] - seen["memory_first"]["study"]
    seen["study_bytes_per_row"] = 1e6 * growth / (runs - seen["done_at_first"])
    late = list(rows[round(first * runs) :])
    wall = max(row["end"] for row in late) - min(row["begin"] for row in late)
    spent = sum(row["end"] - row["begin"] for row in late)
    seen["busy"] = spent / (WORKERS * wall)
    seen["run_ms"] = 1e3 * spent / len(late)
    seen["added_ms_per_run"] = 1e3 * (WORKERS * wall - spent) / len(late)
    return seen


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=10_000)
    parser.add_argument("--json", action="store_true", help="print one object")
    arguments = parser.parse_args()
    result = scaled_out(arguments.runs)
    print(json.dumps(result) if arguments.json else "\n".join(f"{name}: {value}" for name, value in result.items()))
