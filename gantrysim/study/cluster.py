"""A Dask cluster as a backend of joblib.

joblib's own Dask backend waits forever for a case that kills its workers or that no worker can read, and ignores a
cluster of a single thread.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any
from uuid import uuid4

import cloudpickle
from distributed import Client, Future, KilledWorker
from distributed.core import rpc
from distributed.security import Security
from joblib import parallel_config
from joblib.parallel import ParallelBackendBase

from gantrysim.base.errors import InputError
from gantrysim.study.worker import WorkerError

_PATIENCE = 5.0  # timeout for the scheduler, and for a first worker [s]
_SCHEDULER = "Scheduler"
_LOGGERS = ("distributed", "distributed.client")


class Cluster(ParallelBackendBase):  # type: ignore[misc]  # joblib has no types
    """The workers of a Dask cluster. A case whose worker ends is run by another, as soon as there is one.

    Args:
        client: of the scheduler.
        options: of joblib.
    """

    supports_retrieve_callback = True
    default_n_jobs = -1

    def __init__(self, client: Client, **options: Any) -> None:
        super().__init__(**options)
        self._client = client
        self._futures: set[Future] = set()

    def effective_n_jobs(self, n_jobs: int | None) -> int:
        """Return the number of threads of all workers, at least two: joblib ignores a backend of one.

        Raises:
            WorkerError: there is no worker within the timeout.
        """
        try:
            self._client.wait_for_workers(1, timeout=_PATIENCE)
        except TimeoutError:
            raise WorkerError(f"no worker at {_address(self._client)}: must have at least one") from None
        threads: dict[str, int] = self._client.nthreads()
        return max(2, sum(threads.values()))

    def submit(self, func: Callable[[], Any], callback: Callable[[Future], None] | None = None) -> Future:
        """Send a batch of calls to a worker."""
        key = f"gantrysim-{uuid4().hex}"
        future = self._client.submit(_reader(), cloudpickle.dumps(func), key=key, pure=False)
        self._futures.add(future)
        future.add_done_callback(callback)
        return future

    def retrieve_result_callback(self, out: Future) -> Any:
        """Return the results of a batch of calls, or raise its exception."""
        self._futures.discard(out)
        try:
            unreadable, results = out.result()
        except KilledWorker as error:
            times = error.allowed_failures + 1
            last = error.last_worker.address
            raise WorkerError(f"{times} workers ended at the same case, the last at {last}") from None
        except CancelledError:
            raise WorkerError(f"lost the scheduler at {_address(self._client)}") from None
        if unreadable:
            raise WorkerError(f"a worker cannot read its cases: {unreadable}: must have all that the study has")
        return results

    def abort_everything(self, ensure_ready: bool = True) -> None:
        """Release all batches."""
        # not cancelled: Dask notifies every client, and one that is just connecting fails on that
        for future in list(self._futures):
            future.release()
        self._futures.clear()


def _reader() -> Callable[[bytes], tuple[str | None, Any]]:
    """Return a function from a pickled batch of calls to the reason why it cannot be read, or None, and the results.

    The function is sent by its code, the batch as bytes: Dask unpickles anything else in the scheduler and in the
    worker's event loop, and a failure there ends the worker.
    """

    def read(batch: bytes) -> tuple[str | None, Any]:
        import pickle

        try:
            call = pickle.loads(batch)
        except Exception as error:
            return f"{type(error).__name__}: {error}", None
        return None, call()

    return read


@contextmanager
def on_cluster(address: str) -> Iterator[None]:
    """Make a Dask cluster the backend of joblib inside the block.

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
        with ThreadPoolExecutor(1) as pool:  # this thread may already run an event loop
            kind = pool.submit(lambda: asyncio.run(_kind(address))).result()
        if kind == _SCHEDULER:
            return Client(address, timeout=_PATIENCE, set_as_default=False)
        reason = f"a {kind} does"
    except TimeoutError:
        reason = f"none within {_PATIENCE:g} s"
    except Exception as error:  # anything may answer there
        reason = " ".join(str(error).split()) or type(error).__name__
    raise InputError(f"--backend dask={address}: no scheduler answers: {reason}")


async def _kind(address: str) -> str:
    """Return the kind of Dask server at an address; a client would wait forever for another kind of server."""
    security = Security().get_connection_args("client")
    async with asyncio.timeout(_PATIENCE), rpc(address, timeout=_PATIENCE, connection_args=security) as server:
        return str((await server.identity())["type"])


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence Dask's log with its tracebacks inside the block; errors are reported without it."""
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
