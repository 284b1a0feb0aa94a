"""Runs the cases of a study on this machine's cores, or on whatever joblib's `parallel_config` names."""

from __future__ import annotations

import math
import signal
import threading
import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import pairwise

from gantrysim.errors import whole
from gantrysim.study.cases import Case, Row, measure
from gantrysim.study.ledger import Ledger
from gantrysim.study.worker import MeasureTogether, Origin, WorkerError, measured

Measure = Callable[[Case], Row]  # a function of a module, or a partial of one: it is sent to the workers by its name
Progress = Callable[[int, int], None]  # called with the number of cases done, and of all that are known by now

_TOGETHER = 32  # most cases that are measured together: no row is kept before all of theirs are finished


def run_cases(
    cases: Sequence[Case],
    ledger: Ledger,
    *,
    workers: int | None = None,
    measure: Measure = measure,
    measure_together: MeasureTogether | None = None,
    progress: Progress | None = None,
) -> list[Row]:
    """Run cases and return their rows, in the order of the cases: the tags, then what `measure` returns.

    Cases that differ in their tags alone are run once, those in the ledger not at all. Rows do not depend on the number
    of workers, nor on which of them were taken from the ledger. The cases are begun in their order: those that take
    longest should come first.

    Args:
        cases: to run.
        ledger: open; every row is written to it as soon as it is finished.
        workers: number of processes, at most; by default all cores, or those of the backend that joblib's
            `parallel_config` names, as `on_backend` has it do. There are never more of them than cores
            or cases.
        measure: from a case to its row, of JSON's plain values.
        measure_together: from several cases to their rows, instead of `measure` where that is faster; every worker
            takes the same number of cases at a time, up to 32.
        progress: called at the begin and whenever a worker has finished what it had taken.

    Raises:
        InputError: a number of workers below one.
        WorkerError: a worker that would come to other numbers than this process, or that ended at its work.
    """
    if workers is not None:
        whole("workers", workers, 1)
    missing = {case.key: case for case in cases if case.key not in ledger}
    every = len({case.key for case in cases})

    def tell() -> None:
        if progress is not None:
            progress(every - len(missing), every)

    tell()
    most = _TOGETHER if measure_together else 1  # a case by itself takes long against its way to the worker
    together = measure_together or partial(_one_by_one, measure)
    finished = _finished(list(missing.values()), workers, together, most)
    try:
        for rows in finished:
            for key, row in rows:
                ledger.add(key, row)
                del missing[key]
            tell()
    finally:
        with warnings.catch_warnings(action="ignore"):  # joblib's, that cases under way are given up: here on purpose
            finished.close()
    return [{**dict(case.tags), **ledger[case.key]} for case in cases]


def _one_by_one(measure: Measure, cases: Sequence[Case]) -> list[Row]:
    return [measure(case) for case in cases]


def _finished(
    cases: list[Case], workers: int | None, measure: MeasureTogether, most: int
) -> Generator[list[tuple[str, Row]], None, None]:
    """Run cases, at most so many together, and yield the keys and rows of each lot as it is finished."""
    if not cases:
        return
    # slow to import; studies alone need it
    from joblib import Parallel, delayed, parallel_config
    from joblib.externals.loky.process_executor import BrokenProcessPool
    from joblib.parallel import get_active_backend

    backend = get_active_backend()[0]  # of a surrounding parallel_config, processes by default
    cores = backend.effective_n_jobs(-1)
    workers = min(cores if workers is None else workers, cores, len(cases))
    # one that does not keep to a number of workers, as a cluster's, is held to it by what it is given to do at once
    given = workers if backend.effective_n_jobs(workers) > workers else "2 * n_jobs"
    origin = Origin.here(cases)
    lots = _lots(cases, workers, most)
    with parallel_config(n_jobs=workers):
        # a lot is kept as soon as it is finished
        parallel = Parallel(return_as="generator_unordered", batch_size=1, pre_dispatch=given)
        try:
            with _interrupts_ignored():  # by the workers, which are started here and inherit it: they are stopped here
                results = parallel(delayed(measured)(measure, lot, origin) for lot in lots)
            yield from results
        except BrokenProcessPool:
            raise WorkerError(
                "a worker has ended at its work, as one that the system stops for want of memory: "
                "finished cases are kept, and another start goes on from there"
            ) from None


def _lots(cases: list[Case], workers: int, most: int) -> list[list[Case]]:
    """Cut cases into lots of equal size, give or take one, as many for every worker, none larger than `most`."""
    lots = min(workers * math.ceil(len(cases) / (workers * most)), len(cases))
    ends = [len(cases) * k // lots for k in range(lots + 1)]
    return [cases[begin:end] for begin, end in pairwise(ends)]


@contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """Ignore Ctrl-C inside the block; only the main thread may, elsewhere all stays as it is."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
