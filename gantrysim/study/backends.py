"""Where the cases of a study run: on a backend of joblib, or on the workers of a Dask cluster."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING

from gantrysim.base.errors import InputError, unknown
from gantrysim.base.extras import extra

if TYPE_CHECKING:
    from gantrysim.study.cluster import Cluster

_DASK = "dask"
cluster_in_use: ContextVar[Cluster | None] = ContextVar("cluster_in_use", default=None)


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
            before = cluster_in_use.set(cluster)
            try:
                yield
            finally:
                cluster_in_use.reset(before)
        return
    from joblib import parallel_config
    from joblib.parallel import BACKENDS, SequentialBackend, get_active_backend

    if name not in BACKENDS:
        raise unknown("backend", name, [*BACKENDS, f"{_DASK}=ADDRESS"])
    with parallel_config(backend=name):
        active = get_active_backend()[0]
        # sequential ones need no joblib, see `gantrysim.study.runner`
        if not (isinstance(active, SequentialBackend) or getattr(active, "supports_return_generator", False)):
            raise InputError(
                f"--backend {name}: gives no results before all are there; use loky, threading, sequential or dask"
            )
        yield
