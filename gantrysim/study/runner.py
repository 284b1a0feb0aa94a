"""Runs the cases of a study on this machine's cores, or on whatever joblib's `parallel_config` names."""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache

from gantrysim.errors import whole
from gantrysim.study.cases import Case, Row, measure
from gantrysim.study.ledger import Ledger

__all__ = ["Measure", "Progress", "run_cases"]

Measure = Callable[[Case], Row]  # a function of a module, or a partial of one: it is sent to the workers by its name
Progress = Callable[[int, int], None]  # called with the number of cases done, and of all that are known by now

_GLANCE = 1.0  # from one look whether the study still lives to the next [s]


def run_cases(
    cases: Sequence[Case],
    ledger: Ledger,
    *,
    workers: int | None = None,
    measure: Measure = measure,
    progress: Progress | None = None,
) -> list[Row]:
    """Run cases and return their rows, in the order of the cases: the tags, then what `measure` returns.

    Cases that differ in their tags alone are run once, those in the ledger not at all. Rows do not depend on the number
    of workers, nor on which of them were taken from the ledger. The cases are begun in their order: those that take
    longest should come first.

    Args:
        cases: to run.
        ledger: open; every row is written to it as soon as it is finished.
        workers: number of processes, at most; by default all cores, or those of the backend that `parallel_config`
            names. There are never more of them than cores or cases.
        measure: from a case to its row, of JSON's plain values.
        progress: called at the begin and after each case.

    Raises:
        InputError: a number of workers below one.
    """
    if workers is not None:
        whole("workers", workers, 1)
    missing = {case.key: case for case in cases if case.key not in ledger}
    every = len({case.key for case in cases})

    def tell() -> None:
        if progress is not None:
            progress(every - len(missing), every)

    tell()
    for key, row in _finished(list(missing.values()), workers, measure):
        ledger.add(key, row)
        del missing[key]
        tell()
    return [{**dict(case.tags), **ledger[case.key]} for case in cases]


def _finished(cases: list[Case], workers: int | None, measure: Measure) -> Iterable[tuple[str, Row]]:
    """Run cases and yield their keys and rows as they are finished."""
    if not cases:
        return
    from joblib import Parallel, delayed, effective_n_jobs, parallel_config  # slow to import; studies alone need it

    # -1 is every core of the backend; the backend itself is that of a surrounding parallel_config, processes by default
    cores = effective_n_jobs(-1)
    with parallel_config(n_jobs=min(cores if workers is None else workers, cores, len(cases))):
        # one case at a time: it takes long against its way to the worker, and is kept as soon as it is done
        parallel = Parallel(return_as="generator_unordered", batch_size=1)
        with _interrupts_ignored():  # by the workers, which are started here and inherit it: this process stops them
            results = parallel(delayed(_keyed)(measure, case, os.getpid()) for case in cases)
        yield from results


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


def _keyed(measure: Measure, case: Case, study: int) -> tuple[str, Row]:
    """Return a case's key and row; in a process that the study's, of this number, has begun, end with that."""
    if os.getppid() == study:
        _end_with(study)
    # as it is read again from the ledger: tuples become lists, keys strings
    row: Row = json.loads(json.dumps(measure(case), allow_nan=False))
    return case.key, row


@cache
def _end_with(parent: int) -> None:
    """Have this process end soon after its parent: a worker whose study was killed would wait for work for minutes."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_GLANCE)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
