"""Where the cases of a study are run: a backend of joblib by its name."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from gantrysim.errors import InputError, unknown

_DASK = "dask"


@contextmanager
def on_backend(name: str | None) -> Iterator[None]:
    """Have the studies inside the block run their cases on a backend of joblib.

    Args:
        name: "loky" for processes, "threading" for threads, "dask=ADDRESS" for the workers of the Dask cluster whose
            scheduler is at the address, or any other that is registered with joblib; None for what holds anyway.

    Raises:
        InputError: no such backend, a package that it needs is not installed, or no scheduler answers.
        WorkerError: a cluster without a worker.
    """
    if name is None:
        yield
        return
    kind, _, address = name.partition("=")
    if kind == _DASK:
        if not address:
            raise InputError(f"--backend {name}: must be dask=ADDRESS, as in dask=tcp://10.0.0.1:8786")
        try:
            from gantrysim.study.cluster import on_cluster
        except ModuleNotFoundError as error:
            raise InputError(f"--backend {name}: needs {error.name}: pip install 'gantrysim[dask]'") from None
        with on_cluster(address):
            yield
        return
    from joblib import parallel_config
    from joblib.parallel import BACKENDS

    if name not in BACKENDS:
        raise unknown("backend", name, [*BACKENDS, f"{_DASK}=ADDRESS"])
    with parallel_config(backend=name):
        yield
