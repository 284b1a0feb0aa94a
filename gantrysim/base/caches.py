"""Numba's caches on disk, keyed by what is compiled: they survive an edit of anything else, and no edit of that."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from functools import cache, cached_property
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from typing import Any

from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, NullCache, _Cache
from numba.core.runtime import rtsys

from gantrysim.base import contexts, libraries, pipeline
from gantrysim.base.fingerprint import code_hash, fingerprint


class _Place(CompileResultCacheImpl):  # type: ignore[misc]
    """Folder and names of a function's files: numba's, without the line at which the function begins."""

    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        name = fullname.replace("<", "").replace(">", "")  # which Windows forbids
        return f"{name}.py{sys.version_info[0]}{sys.version_info[1]}{abiflags}"


class _Files(IndexDataCacheFile):  # type: ignore[misc]
    """Files of a function, of which each names the key of its content.

    Two processes that save at the same time may leave an index with a key of the one beside the code of the other.
    """

    def save(self, key: Any, data: Any) -> None:
        super().save(key, (key, data))

    def load(self, key: Any) -> Any:
        stored_key, data = super().load(key) or (None, None)
        return data if stored_key == key else None


class _KeyedCache(FunctionCache):  # type: ignore[misc]
    """Numba's cache of a function, keyed by `fingerprint`.

    What was compiled of an earlier text of the function is overwritten. Functions made by one that is called several
    times share files; the values in their closures are a part of the key.

    Raises:
        RuntimeError: there is no folder in which a cache can be written.
        TypeError: the function uses a value that has no fingerprint.
    """

    _impl_class = _Place

    def __init__(self, function: Callable[..., Any], options: Mapping[str, Any]) -> None:
        self._fingerprint = (fingerprint(function), repr(sorted(options.items())), _compiler_hash())
        super().__init__(function)
        stamp = code_hash(function) if function.__code__.co_freevars else self._fingerprint
        self._cache_file = _Files(self._cache_path, self._impl.filename_base, stamp)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load machine code without numba's declarations, a quarter of a second: only its compiler needs them."""
        import_module("numba.cpython.hashing")  # adds symbols to which machine code may refer
        if not pipeline.is_tested():
            return super().load_overload(sig, target_context)
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return sig, codegen.magic_tuple(), self._fingerprint


class Cached(_Cache):  # type: ignore[misc]
    """The cache of a function, looked up where the function is first needed: most are not, in most processes.

    Without a folder in which it can be written, or for a function without a fingerprint, it is empty.

    Args:
        function: as written.
        options: of numba's compiler.
    """

    def __init__(self, function: Callable[..., Any], options: Mapping[str, Any]) -> None:
        self._function = function
        self._options = options

    @cached_property
    def _cache(self) -> Any:
        try:
            return _KeyedCache(self._function, self._options)
        except (RuntimeError, TypeError):
            return NullCache()

    @property
    def cache_path(self) -> Any:
        return self._cache.cache_path

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        return self._cache.load_overload(sig, target_context)

    def save_overload(self, sig: Any, data: Any) -> None:
        self._cache.save_overload(sig, data)

    def enable(self) -> None:
        self._cache.enable()

    def disable(self) -> None:
        self._cache.disable()

    def flush(self) -> None:
        self._cache.flush()


@cache
def _compiler_hash() -> str:
    """Return a hash of what this package changes in numba's compiler."""
    digest = sha256()
    for module in (pipeline, contexts, libraries):
        digest.update(Path(str(module.__file__)).read_bytes())
    return digest.hexdigest()
