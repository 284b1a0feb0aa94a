"""Compilation by numba, with numbers that behave as NumPy's (a division by zero gives inf), and its cache on disk.

Numba keeps machine code in a folder and runs what it finds there, so the folder must belong to this user alone. It is
named by a hash of all that decides what is compiled: numba's own key is the text of a function's file, which misses an
edit of what the function calls.

A process works in a copy of the cache, of hard links to the entries that agree with their checksums, and what it
compiles is kept when it ends. So a damaged entry is compiled anew, and no process meets half of what another writes.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import platform
import shutil
import stat
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar

from gantrysim.base import progress
from gantrysim.base.errors import InputError

_SETTINGS = Path(".numba_config.yaml")

if os.path.lexists(_SETTINGS):
    raise InputError(
        f"file {_SETTINGS} in the current folder: would set up numba, and where it looks for machine code: "
        "set environment variables (NUMBA_...) instead, or work in another folder"
    )

import numba  # noqa: E402 - which reads that file

_Function = TypeVar("_Function", bound=Callable[..., Any])

# rooms in which nothing is compiled, and of which compiled functions use nothing
UNCOMPILED = frozenset(("cli", "compare", "exchange", "job", "live", "remedy", "study", "tables"))
# what a disk must have left for a cache [bytes]
_FREE_SPACE = 2**26
# versions of the package, of numba and of its settings whose caches are kept
_VERSIONS = 8
# age at which a process' copy of the cache is taken for that of a killed process [s]
_ABANDONED_AGE = 86400.0
_MANIFEST = "checksums"
# settings of numba that do not decide what it compiles; joblib gives each worker its number of threads
_INDIFFERENT_SETTINGS = ("NUMBA_CACHE_DIR", "NUMBA_NUM_THREADS")
_PACKAGE = Path(__file__).parents[1]

_compiled: list[Any] = []
_c_functions = 0
_settings_lock = threading.RLock()


def jit(function: _Function) -> _Function:
    """Compile a function, for calls from Python and from other compiled functions, and keep the result on disk.

    It is compiled where it is first called with arguments of a type, and runs without Python's lock.

    Raises:
        InputError: NUMBA_DISABLE_JIT is set.
    """
    compiled: Any = _cached_function(partial(numba.njit, nogil=True), function)
    _compiled.append(compiled)
    return compiled


def c_function(function: Callable[..., Any], signature: Any) -> Any:
    """Return a function compiled as a C function, kept on disk as those of `jit` are.

    Args:
        function: no closure of compiled functions: numba's cache has another key for these in every process.
        signature: numba's types of its result and its arguments.

    Raises:
        InputError: NUMBA_DISABLE_JIT is set.
    """
    global _c_functions
    compiled = _cached_function(numba.cfunc, function, signature)
    _c_functions += not compiled.cache_hits
    return compiled


def count_compiled() -> int:
    """Return how many functions this process has compiled so far, as no cache held them."""
    return _c_functions + sum(sum(function.stats.cache_misses.values()) for function in _compiled)


def cache_folder() -> Path:
    """Return the folder of the cache, which is there and this user's alone.

    Raises:
        InputError: it cannot be, and why.
    """
    root = _root()
    if not root.is_absolute():
        raise InputError(f"folder of compiled functions {root}: must be an absolute path")
    folder = Path(os.path.realpath(root), _version())
    home = Path(os.path.realpath(_home()))
    try:
        here = Path.cwd()
        if here in folder.parents and here not in (home, *home.parents):
            raise InputError(f"folder of compiled functions {root}: must not lie in the current folder")
        folder.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
        for part in (folder, *folder.parents):
            _check_owner(part, is_own=part == folder)
        free = shutil.disk_usage(folder).free
    except OSError as error:
        raise InputError(f"folder of compiled functions {root}: {error.strerror}") from None
    if free < _FREE_SPACE:
        raise InputError(f"folder of compiled functions {root}: {free} bytes free on its disk, must be {_FREE_SPACE}")
    return folder


@cache
def source_hash() -> str:
    """Return a hash of the package's text, as far as functions are compiled of it."""
    digest = hashlib.sha256()
    for folder, rooms, files in os.walk(_PACKAGE):
        rooms[:] = sorted(room for room in rooms if Path(folder) != _PACKAGE or room not in UNCOMPILED)
        for file in sorted(file for file in files if file.endswith(".py")):
            digest.update(file.encode())
            digest.update(Path(folder, file).read_bytes())
    return digest.hexdigest()


def _version() -> str:
    """Return a hash of all that decides what is compiled, and where numba keeps it."""
    # numba's own keys tell processors of one kind apart
    settings = sorted(
        (name, value)
        for name, value in os.environ.items()
        if name.startswith("NUMBA_") and name not in _INDIFFERENT_SETTINGS
    )
    deciding = (source_hash(), str(_PACKAGE), numba.__version__, platform.machine(), settings)
    return hashlib.sha256(repr(deciding).encode()).hexdigest()[:16]


def _root() -> Path:
    """Return the folder of the caches of all versions."""
    named = os.environ.get("NUMBA_CACHE_DIR")
    if named:
        return Path(named, "gantrysim")
    by_system = os.environ.get("LOCALAPPDATA" if os.name == "nt" else "XDG_CACHE_HOME", "")
    # a relative one is to be ignored, by the XDG Base Directory Specification
    folder = Path(by_system) if Path(by_system).is_absolute() else _home() / ".cache"
    return folder / "gantrysim"


def _home() -> Path:
    """Return the home folder of this user, relative where it is not known."""
    try:
        return Path.home()
    except RuntimeError:
        return Path("~")


def _check_owner(folder: Path, is_own: bool) -> None:
    """Check that no other user can change what lies in a folder, or put another one in its place.

    Raises:
        InputError: one can.
    """
    if not hasattr(os, "geteuid"):
        return
    status = folder.lstat()
    owners = [os.geteuid()] if is_own else [os.geteuid(), 0]
    # on the way to it, a folder as /tmp is safe, in which each may remove only what is theirs
    by_others = stat.S_IWGRP | stat.S_IWOTH if is_own else stat.S_IWOTH
    if status.st_uid not in owners or (status.st_mode & by_others and (is_own or not status.st_mode & stat.S_ISVTX)):
        raise InputError(f"folder {folder}: must be yours, and not writable by others, to hold compiled functions")


@contextmanager
def _set(**settings: str) -> Iterator[None]:
    """Set numba's configuration in the block."""
    with _settings_lock:
        before = {name: getattr(numba.config, name, "") for name in settings}
        for name, value in settings.items():
            setattr(numba.config, name, value)
        try:
            yield
        finally:
            for name, value in before.items():
                setattr(numba.config, name, value)


def _cached_function(decorator: Any, function: Callable[..., Any], *arguments: Any) -> Any:
    """Return a function as one of numba's decorators compiles it, with the cache on disk where there is one."""
    if numba.config.DISABLE_JIT:
        raise InputError("NUMBA_DISABLE_JIT is set: gantrysim runs compiled only, unset it")
    folder = _opened_cache()[0]
    if folder is not None:
        with suppress(RuntimeError), _set(CACHE_DIR=str(folder), CACHE_LOCATOR_CLASSES="UserProvidedCacheLocator"):
            return decorator(*arguments, error_model="numpy", cache=True)(function)
    return decorator(*arguments, error_model="numpy")(function)


@cache
def _opened_cache() -> tuple[Path | None, dict[str, str]]:
    """Return this process' copy of the cache, None without one, and the checksums of its entries by name."""
    entries: dict[str, str] = {}
    try:
        store = cache_folder()
        _sweep(store)
        folder = Path(tempfile.mkdtemp(prefix="process-", dir=store))
        for name, checksum in _manifest(store).items():
            with suppress(OSError):
                if _checksum(store / name) == checksum:
                    (folder / name).parent.mkdir(exist_ok=True)
                    _link(store / name, folder / name)
                    entries[name] = checksum
    except (InputError, OSError) as error:
        progress.tell_compiling(f"compiling, and again in every process: {error}")
        return None, entries
    atexit.register(_keep, store, folder, os.getpid())
    if not entries:
        progress.tell_compiling(progress.COMPILING)
    return folder, entries


def _link(file: Path, link: Path) -> None:
    try:
        os.link(file, link)
    except OSError:
        # a file system without hard links
        shutil.copyfile(file, link)


def _keep(store: Path, folder: Path, process: int) -> None:
    """Move what this process has compiled to the others' entries, and remove its copy of the cache."""
    # a forked process must leave what its parent uses
    if os.getpid() != process:
        return
    with suppress(OSError):
        entries = {}
        for file in folder.glob("*/*.nb[ic]"):
            name = file.relative_to(folder).as_posix()
            if file.stat().st_nlink == 1 and _checksum(file) != _opened_cache()[1].get(name):
                entries[name] = _checksum(file)
                (store / name).parent.mkdir(exist_ok=True)
                file.replace(store / name)
        if entries:
            lines = [f"{checksum} {name}\n" for name, checksum in (_manifest(store) | entries).items()]
            partial = folder / _MANIFEST
            partial.write_text("".join(lines))
            partial.replace(store / _MANIFEST)
    shutil.rmtree(folder, ignore_errors=True)


def _manifest(store: Path) -> dict[str, str]:
    """Return the checksums of a cache's entries by name; another process may have kept others since."""
    with suppress(FileNotFoundError, ValueError):
        lines = (store / _MANIFEST).read_text().splitlines()
        return {name: checksum for checksum, name in (line.split(maxsplit=1) for line in lines)}
    return {}


def _checksum(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _sweep(store: Path) -> None:
    """Remove caches of other versions but the last few, and what killed processes have left."""
    os.utime(store)
    versions = sorted(store.parent.iterdir(), key=lambda version: version.stat().st_mtime, reverse=True)
    killed = [folder for folder in store.glob("process-*") if time.time() - folder.stat().st_mtime > _ABANDONED_AGE]
    for folder in [*versions[_VERSIONS:], *killed]:
        shutil.rmtree(folder, ignore_errors=True)
