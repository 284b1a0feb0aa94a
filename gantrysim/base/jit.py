"""Compilation by numba, with numbers that behave as NumPy's (a division by zero gives inf)."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any, TypeVar, cast

import numba
from numba.core.event import Listener, install_recorder, register

from gantrysim.base import pipeline
from gantrysim.base.caches import Cached
from gantrysim.base.progress import begins_compiling

_Function = TypeVar("_Function", bound=Callable[..., Any])


def jit(function: _Function) -> _Function:
    """Compile a function and cache the result on disk, or in memory alone where no folder can be written."""
    return _cached(function, no_cfunc_wrapper=True, pipeline_class=pipeline.WHOLE)


def plain_jit(function: _Function) -> _Function:
    """Compile a function as `jit` does, one that neither makes nor returns arrays: it counts no references to them.

    Numba counts atomically, at every element of a named tuple and every row of an array that is looked at: in a loop
    over points that takes longer than a step of Newton's method. The caller keeps the arguments meanwhile.
    """
    return _cached(function, no_cfunc_wrapper=True, pipeline_class=pipeline.WHOLE, _nrt=False)


def unlocked_jit(function: _Function) -> _Function:
    """Compile a function as `jit` does, one that runs without Python's lock."""
    return _cached(function, nogil=True)


def _cached(function: _Function, **options: Any) -> _Function:
    if pipeline.is_tested():
        compiled: Any = numba.njit(error_model="numpy", **options)(function)
        compiled._cache = Cached(function, compiled.targetoptions)
        return cast(_Function, compiled)
    try:
        return cast(_Function, numba.njit(error_model="numpy", cache=True, **options)(function))
    except RuntimeError:  # numba finds no place for the cache
        return cast(_Function, numba.njit(error_model="numpy", **options)(function))


def cache_folder() -> str | None:
    """Return the folder in which compiled functions of this room are kept, None where no folder can be written."""
    folder: str | None = Cached(lambda: None, {}).cache_path
    return folder


@contextmanager
def compilations() -> Iterator[Callable[[], int]]:
    """Yield a function that returns how many functions numba has compiled in the block so far."""
    with install_recorder("numba:compile") as recorder:
        yield lambda: sum(event.is_start for _, event in recorder.buffer)


# what the compiled functions of a room compute
_SUBJECTS = {
    "bead": "the bead",
    "controllers": "the program",
    "dispenser": "the dispenser",
    "engine": "the record",
    "env": "the environment",
    "identify": "the fit",
    "machine": "the machine",
    "metrics": "the errors",
    "native": "the servo",
    "paths": "the path",
    "plots": "the plots",
    "render": "the film",
    "report": "the plots",
    "servo": "the servo",
}


class _Told(Listener):  # type: ignore[misc]
    """Tells what is compiled, when numba compiles what its cache lacks."""

    def __init__(self) -> None:
        self._depth = 0

    def on_start(self, event: Any) -> None:
        if self._depth == 0:
            begins_compiling(_subject(event.data["dispatcher"].py_func.__module__))
        self._depth += 1

    def on_end(self, event: Any) -> None:
        self._depth -= 1


def _subject(module: str) -> str:
    names = module.split(".")
    if names[0] != "gantrysim":
        return "your functions"
    return _SUBJECTS.get(names[1], "functions")


@cache
def _freezes() -> bool:
    """Return whether this process exempts objects from collection, as the command does; counting them is slow."""
    return gc.get_freeze_count() > 0


class _WithoutCollection(Listener):  # type: ignore[misc]
    """Pauses Python's garbage collection while numba compiles.

    The compiler makes many objects and hardly any cycles; a seventh of its time went into the collection.
    """

    def __init__(self) -> None:
        self._depth = 0
        self._paused = False

    def on_start(self, event: Any) -> None:
        if self._depth == 0 and gc.isenabled():
            gc.disable()
            self._paused = True
        self._depth += 1

    def on_end(self, event: Any) -> None:
        self._depth -= 1
        if self._depth == 0 and self._paused:
            # New objects count as old: otherwise the next collection would traverse them all, after every function.
            frozen = _freezes()
            gc.freeze()
            if not frozen:
                gc.unfreeze()
            gc.enable()
            self._paused = False


register("numba:compile", _Told())
register("numba:compile", _WithoutCollection())


def inner_jit(function: _Function) -> _Function:
    """Compile a helper inlined into, and cached with, its callers.

    It has no wrapper to be called from Python, whose compilation takes an eighth of the time: a call from Python ends
    the process.
    """
    return _inner(function)


def plain_inner_jit(function: _Function) -> _Function:
    """Compile a helper as `inner_jit` does, one that neither makes nor returns arrays, see `plain_jit`."""
    return _inner(function, _nrt=False)


def _inner(function: _Function, **options: Any) -> _Function:
    compiled = numba.njit(
        error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True, pipeline_class=pipeline.PART, **options
    )(function)
    return cast(_Function, compiled)
