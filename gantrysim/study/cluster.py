"""A Dask cluster as a backend of joblib.

joblib has one of its own, which waits for ever for a case whose workers have died at it, or which no worker can read,
and which leaves the cluster aside where that has but one thread.
"""

from __future__ import annotations

import gc
import logging
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from typing import Any
from uuid import uuid4

from distributed import Client, Future, KilledWorker
from joblib import parallel_config
from joblib.parallel import ParallelBackendBase

from gantrysim.errors import InputError
from gantrysim.study.worker import WorkerError

__all__ = ["Cluster", "on_cluster"]

_PATIENCE = 5.0  # with the scheduler, and with a first worker [s]
_LOGGERS = ("distributed", "distributed.client")


class Cluster(ParallelBackendBase):  # type: ignore[misc]  # joblib has no types
    """The workers of a Dask cluster.

    A worker that ends at its work has it done by another; where none is left, it waits until one comes.

    Args:
        client: of the scheduler.
        options: of joblib's own.
    """

    supports_retrieve_callback = True
    default_n_jobs = -1

    def __init__(self, client: Client, **options: Any) -> None:
        super().__init__(**options)
        self._client = client
        self._futures: set[Future] = set()

    def effective_n_jobs(self, n_jobs: int | None) -> int:
        """Return the number of threads of all workers, and two for one: joblib leaves a backend of one aside.

        Raises:
            WorkerError: there is no worker, nor does one come.
        """
        try:
            self._client.wait_for_workers(1, timeout=_PATIENCE)
        except TimeoutError:
            raise WorkerError(f"no worker at {_address(self._client)}: must have at least one") from None
        threads: dict[str, int] = self._client.nthreads()
        return max(2, sum(threads.values()))

    def submit(self, func: Callable[[], Any], callback: Callable[[Future], None] | None = None) -> Future:
        """Hand out a batch of calls."""
        future = self._client.submit(func, key=f"gantrysim-{uuid4().hex}", pure=False)
        self._futures.add(future)
        future.add_done_callback(callback)
        return future

    def retrieve_result_callback(self, out: Future) -> Any:
        """Return what a batch of calls has returned, or raise what it has raised."""
        self._futures.discard(out)
        try:
            return out.result()
        except KilledWorker as error:
            times, last = error.allowed_failures + 1, error.last_worker.address
            raise WorkerError(f"{times} workers have ended at the same case, the last at {last}") from None
        except CancelledError:
            raise WorkerError(f"the scheduler at {_address(self._client)} has gone") from None
        except (ImportError, RuntimeError) as error:
            reason = error.__cause__ or error
            if not isinstance(reason, ImportError):
                raise
            raise WorkerError(f"a worker lacks what the study has: {reason}") from None

    def abort_everything(self, ensure_ready: bool = True) -> None:
        """Take back what has been handed out."""
        self._client.cancel(list(self._futures))
        self._futures.clear()


@contextmanager
def on_cluster(address: str) -> Iterator[None]:
    """Have joblib use a Dask cluster inside the block.

    Args:
        address: of its scheduler, as in "tcp://10.0.0.1:8786".

    Raises:
        InputError: no scheduler answers there.
        WorkerError: it has no worker.
    """
    with _quiet(), _connected(address) as client:
        cluster = Cluster(client)
        cluster.effective_n_jobs(-1)
        with parallel_config(backend=cluster):
            yield


def _connected(address: str) -> Client:
    try:
        return Client(address, timeout=_PATIENCE, set_as_default=False)
    except Exception as error:  # what answers there may be anything
        reason = " ".join(str(error).split())
    gc.collect()  # the client that failed closes itself now: in the middle of the start of another, that would hang
    raise InputError(f"--backend dask={address}: no scheduler answers: {reason}")


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep Dask's log, with its tracebacks, from the terminal inside the block: errors say what goes wrong."""
    levels = {name: logging.getLogger(name).level for name in _LOGGERS}
    for name in levels:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)


def _address(client: Client) -> str:
    return str(client.scheduler.address)
