"""The workers of a Dask cluster, which run the cases of a study.

joblib's Dask backend waits forever for a case that kills its workers or that no worker can read, and ignores a cluster
of a single thread.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import contextmanager
from itertools import islice
from typing import Any

import cloudpickle
from distributed import Client, Future, KilledWorker, as_completed
from distributed.core import rpc
from distributed.security import Security

from gantrysim.base.errors import InputError
from gantrysim.study.worker import WorkerError

_PATIENCE = 5.0  # timeout for the scheduler, and for a first worker [s]
_SCHEDULER = "Scheduler"
_LOGGERS = ("distributed", "distributed.client")


class Cluster:
    """The workers of a Dask cluster. A case whose worker ends is run by another, as soon as there is one.

    Args:
        client: of the scheduler.
    """

    def __init__(self, client: Client) -> None:
        self._client = client

    @property
    def address(self) -> str:
        """Address of the scheduler."""
        return str(self._client.scheduler.address)

    def threads(self) -> int:
        """Return the number of threads of all workers.

        Raises:
            WorkerError: there is no worker within the timeout.
        """
        try:
            self._client.wait_for_workers(1, timeout=_PATIENCE)
        except TimeoutError:
            raise WorkerError(f"no worker at {self.address}: must have at least one") from None
        threads: dict[str, int] = self._client.nthreads()
        return sum(threads.values())

    def results(self, calls: Iterator[Callable[[], Any]], at_once: int) -> Generator[Any, None, None]:
        """Yield the results of calls as they come, with so many calls sent at once; raise the exception of a call.

        Raises:
            WorkerError: a call ends its workers, no worker can read it, or the scheduler is lost.
        """
        under_way: set[Future] = set()

        def send(count: int) -> list[Future]:
            pickled = map(cloudpickle.dumps, islice(calls, count))
            futures = [self._client.submit(_reader(), call, pure=False) for call in pickled]
            under_way.update(futures)
            return futures

        finished = as_completed(send(at_once), loop=self._client.loop)
        try:
            for future in finished:
                yield self._result(future)
                under_way.remove(future)
                finished.update(send(1))
        finally:
            # not cancelled: Dask notifies every client, and one that is just connecting fails on that
            for future in under_way:
                future.release()

    def _result(self, future: Future) -> Any:
        try:
            unreadable, result = future.result()
        except KilledWorker as error:
            times = error.allowed_failures + 1
            last = error.last_worker.address
            raise WorkerError(f"{times} workers ended at the same case, the last at {last}") from None
        except CancelledError:
            raise WorkerError(f"lost the scheduler at {self.address}") from None
        if unreadable:
            raise WorkerError(f"a worker cannot read its cases: {unreadable}: must have all that the study has")
        return result


def _reader() -> Callable[[bytes], tuple[str | None, Any]]:
    """Return a function from a pickled call to the reason why it cannot be read, or None, and the result.

    The function is sent by its code, the call as bytes: Dask unpickles anything else in the scheduler and in the
    worker's event loop, and a failure there ends the worker.
    """

    def read(pickled: bytes) -> tuple[str | None, Any]:
        import pickle

        try:
            call = pickle.loads(pickled)
        except Exception as error:
            return f"{type(error).__name__}: {error}", None
        return None, call()

    return read


@contextmanager
def connected_cluster(address: str) -> Iterator[Cluster]:
    """Give the cluster of a scheduler inside the block; at its end all that was sent is taken back.

    Args:
        address: of the scheduler, as in "tcp://10.0.0.1:8786".

    Raises:
        InputError: no scheduler answers there.
        WorkerError: it has no worker.
    """
    with _quiet(), _client(address) as client:
        cluster = Cluster(client)
        cluster.threads()
        yield cluster


def _client(address: str) -> Client:
    try:
        # this thread may already run an event loop
        with ThreadPoolExecutor(1) as pool:
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
