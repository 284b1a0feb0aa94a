"""Run the cases of a study in parallel: on the cores of this computer, another backend of joblib, or a Dask cluster."""

from __future__ import annotations

import math
import os
import threading
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from contextvars import ContextVar
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from gantrysim.base.errors import InputError, unknown, whole_number
from gantrysim.base.extras import extra
from gantrysim.base.signals import blocked, deferred, end_with
from gantrysim.study.cases import Case, Row, measure
from gantrysim.study.ledger import Ledger, TaggedRows
from gantrysim.study.worker import Measured, MeasureTogether, Origin, WorkerError, measured_rows

if TYPE_CHECKING:
    from gantrysim.study.cluster import Cluster

Measure = Callable[[Case], Row]  # a function of a module, or a partial of one: sent to the workers by name
Progress = Callable[[int, int], None]  # called with the number of finished cases, and of all known by now

_CASES_TOGETHER = 32  # maximum number of cases measured together, whose rows are kept only when all are finished
# A lot costs some 10 ms of this process and of a cluster's scheduler. Of short cases that are many a worker takes as
# many at once as this time allows [s], but no more than a share of its part of those that are still to come.
_LOT_TIME = 2.0
_LOT_SHARE = 1 / 8
_LOKY_MANAGER = "ExecutorManagerThread"
_DASK = "dask"
_cluster_in_use: ContextVar[Cluster | None] = ContextVar("cluster_in_use", default=None)


@contextmanager
def on_backend(name: str | None) -> Iterator[None]:
    """Run the cases of studies inside the block on a backend of joblib, or on a Dask cluster.

    Args:
        name: "loky" for processes, "threading" for threads, "sequential" for one case after another in this process,
            "dask=ADDRESS" for the workers of the Dask cluster whose scheduler is at the address, or any other that is
            registered with joblib; None for the current one.

    Raises:
        InputError: unknown backend, missing package, or no scheduler answers.
        WorkerError: a cluster without a worker.
    """
    if name is None:
        yield
        return
    kind, _, address = name.partition("=")
    if kind == _DASK:
        if not address:
            raise InputError(f"--backend {name}: must be dask=ADDRESS, as in dask=tcp://10.0.0.1:8786")
        with extra("dask", f"--backend {name}"):
            from gantrysim.study.cluster import connected_cluster
        with connected_cluster(address) as cluster:
            before = _cluster_in_use.set(cluster)
            try:
                yield
            finally:
                _cluster_in_use.reset(before)
        return
    from joblib import parallel_config
    from joblib.parallel import BACKENDS, SequentialBackend, get_active_backend

    if name not in BACKENDS:
        raise unknown("backend", name, [*BACKENDS, f"{_DASK}=ADDRESS"])
    with parallel_config(backend=name):
        active = get_active_backend()[0]
        # sequential ones need no joblib, see `run_cases`
        if not (isinstance(active, SequentialBackend) or getattr(active, "supports_return_generator", False)):
            raise InputError(
                f"--backend {name}: gives no results before all are there; use loky, threading, sequential or dask"
            )
        yield


def run_cases(
    cases: Sequence[Case],
    ledger: Ledger,
    *,
    workers: int | None = None,
    measure: Measure = measure,
    measure_together: MeasureTogether | None = None,
    progress: Progress | None = None,
) -> TaggedRows:
    """Run cases and return their rows in the order of the cases: the tags, then the result of `measure`.

    A row is a dict only where it is asked for: until then it takes the memory of its values alone.

    Cases that differ only in their tags are run once, those in the ledger not at all. Rows do not depend on the number
    of workers, nor on the rows taken from the ledger. Cases start in their order: the longest should come first.

    Args:
        cases: to run.
        ledger: open; every row is written to it as soon as its worker has finished the cases it took: a single one, or
            of many short ones those of two seconds.
        workers: maximum number of processes, by default all cores or workers of the backend; never more than cores or
            cases.
        measure: from a case to its row of plain JSON values.
        measure_together: from several cases to their rows, instead of `measure` where that is faster; every worker
            takes the same number of cases at a time, up to 32.
        progress: called at the start and whenever a worker has finished its cases.

    Raises:
        InputError: fewer than one worker.
        WorkerError: a worker ended, or differs from this process in its versions or machines.
    """
    if workers is not None:
        whole_number("workers", workers, 1)
    keys = [case.key for case in cases]
    missing = {key: case for key, case in zip(keys, cases, strict=True) if key not in ledger}
    total = len(set(keys))

    def advance() -> None:
        if progress is not None:
            progress(total - len(missing), total)

    advance()
    lots = _equal_lots if measure_together else _timed_lots
    together = measure_together or partial(_one_by_one, measure)
    finished = _finished_lots(list(missing.values()), workers, together, lots)
    try:
        for rows in finished:
            for key, row in rows:
                ledger.add(key, row)
                del missing[key]
            advance()
    finally:
        _close(finished)
    return TaggedRows(ledger.rows, zip((case.tags for case in cases), map(ledger.place, keys), strict=True))


def _close(results: Generator[object, None, None]) -> None:
    """Withdraw the cases that are not finished, and end the workers."""
    report = threading.excepthook

    def without_withdrawn(args: threading.ExceptHookArgs) -> None:
        if not (args.exc_type is KeyError and args.thread is not None and args.thread.name == _LOKY_MANAGER):
            report(args)

    # loky's manager looks for a withdrawn case that no worker had yet taken, and ends by a KeyError, as it was to end
    threading.excepthook = without_withdrawn
    try:
        # joblib warns of abandoned cases, here on purpose
        with warnings.catch_warnings(action="ignore"):
            results.close()
    finally:
        threading.excepthook = report


def _one_by_one(measure: Measure, cases: Sequence[Case]) -> list[Row]:
    return [measure(case) for case in cases]


class _Pace:
    """Mean time that the finished cases took."""

    def __init__(self) -> None:
        self._cases = 0
        self._seconds = 0.0

    def add(self, cases: int, seconds: float) -> None:
        """Add finished cases and the time of a worker that they took [s]."""
        self._cases += cases
        self._seconds += seconds

    def cases_within(self, seconds: float) -> int:
        """Return the number of cases that take so long [s], at least one; one while none is finished."""
        return max(int(seconds * self._cases / self._seconds), 1) if self._seconds else 1


Lots = Callable[[list[Case], int, _Pace], Iterable[list[Case]]]


def _finished_lots(
    cases: list[Case], workers: int | None, measure: MeasureTogether, lots_of: Lots
) -> Generator[list[tuple[str, Row]], None, None]:
    """Run cases in lots, and yield the keys and rows of each finished lot."""
    if not cases:
        return
    from joblib import effective_n_jobs  # slow to import

    cluster = _cluster_in_use.get()
    cores = effective_n_jobs(-1) if cluster is None else cluster.threads()
    workers = min(cores if workers is None else workers, cores, len(cases))
    origin = Origin.here(cases)
    pace = _Pace()
    calls = (partial(measured_rows, measure, lot, origin) for lot in lots_of(cases, workers, pace))
    if cluster is None:
        results = _here(calls, workers)
    else:  # where all are to work, the next lot of each is already there
        results = cluster.results(calls, at_once=workers if workers < cores else 2 * workers)
    with closing(results):
        for rows, seconds in results:
            pace.add(len(rows), seconds)
            yield rows
            # joblib holds a finished lot in a cycle of objects, until Python looks for such
            rows.clear()


def _here(calls: Iterator[Callable[[], Measured]], workers: int) -> Generator[Measured, None, None]:
    """Yield the results of calls as they come from workers of joblib: processes, or what a parallel_config around says.

    Raises:
        WorkerError: a worker ended.
    """
    # slow to import
    from concurrent.futures.process import BrokenProcessPool
    from multiprocessing import resource_tracker

    from joblib import Parallel, delayed, parallel_config
    from joblib.parallel import BACKENDS, get_active_backend

    # one after another in this process, of which joblib would give no result before the last
    if isinstance(get_active_backend()[0], BACKENDS["sequential"]):
        yield from (call() for call in calls)
        return
    # a worker that has no case yet must end with this process too
    started: dict[str, Any] = {}
    if isinstance(get_active_backend()[0], BACKENDS["loky"]):
        started = {"initializer": end_with, "initargs": (os.getpid(),)}
        # its start would unblock the signals that are blocked below
        if os.name == "posix":
            resource_tracker.ensure_running()
    with parallel_config(n_jobs=workers):
        # a lot is kept as soon as it is finished
        parallel = Parallel(return_as="generator_unordered", batch_size=1, **started)
        results = None
        try:
            # for the workers started here; this process stops them
            with deferred(), blocked():
                results = parallel(delayed(call)() for call in calls)
            yield from results
        except KeyboardInterrupt:
            # deferred: before a result was asked for, which would have ended it
            if results is not None:
                _close(results)
            raise
        except BrokenProcessPool:
            raise WorkerError(
                "a worker ended unexpectedly, possibly out of memory: finished cases are kept, run again to resume"
            ) from None


def _timed_lots(cases: list[Case], workers: int, pace: _Pace) -> Iterator[list[Case]]:
    """Yield lots of cases in their order: single ones at the begin and the end, and where they take long."""
    begin = 0
    while begin < len(cases):
        most = int(_LOT_SHARE * (len(cases) - begin) / workers)
        end = begin + max(min(pace.cases_within(_LOT_TIME), most), 1)
        yield cases[begin:end]
        begin = end


def _equal_lots(cases: list[Case], workers: int, _pace: _Pace) -> list[list[Case]]:
    """Cut cases into lots of equal size within one, as many for every worker, none larger than `_CASES_TOGETHER`."""
    lots = min(workers * math.ceil(len(cases) / (workers * _CASES_TOGETHER)), len(cases))
    ends = [len(cases) * k // lots for k in range(lots + 1)]
    return [cases[begin:end] for begin, end in pairwise(ends)]
