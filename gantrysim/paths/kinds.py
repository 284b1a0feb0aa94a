"""The kinds of path that a record can hold.

Every kind of the package stands in `KINDS`, so a record names its path without knowing which controller made it, and
is read wherever the package is. A path of a user's own module is found once that module has been imported.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from gantrysim.base.errors import InputError, unknown
from gantrysim.paths.arcs import ArcChain
from gantrysim.paths.chain import Chain
from gantrysim.paths.path import Path
from gantrysim.paths.spirals import Involute
from gantrysim.paths.track import Track

KINDS: dict[str, type[Path]] = {
    "ArcChain": ArcChain,
    "Chain": Chain,
    "Involute": Involute,
    "Track": Track,
}


def kind_of(path: Path) -> str:
    """Return the name of a path's kind in a record: a key of `KINDS`, or module:class of a user's own."""
    kind = type(path)
    return kind.__name__ if KINDS.get(kind.__name__) is kind else _full_name(kind)


def path_of(kind: str, parameters: Mapping[str, Any]) -> Path:
    """Return the path of a kind, as `kind_of` names it, with the constructor's arguments.

    Raises:
        InputError: an unknown kind, a user's own whose module has not been imported, or arguments that it refuses.
    """
    path_class: type[Any] | None = KINDS.get(kind)
    if path_class is None:
        path_class = {_full_name(imported): imported for imported in _imported_subclasses(Path)}.get(kind)
    if path_class is None and ":" in kind:
        raise InputError(f"path {kind}: import {kind.partition(':')[0]} before this record is read")
    if path_class is None:
        raise unknown("path", kind, KINDS)
    try:
        path: Path = path_class(**parameters)
    except TypeError as error:
        raise InputError(f"path {kind}: {error}") from None
    return path


def _imported_subclasses(base: type[Any]) -> Iterator[type[Any]]:
    """Yield the subclasses that have been imported, theirs included."""
    for subclass in base.__subclasses__():
        yield subclass
        yield from _imported_subclasses(subclass)


def _full_name(kind: type[Any]) -> str:
    return f"{kind.__module__}:{kind.__qualname__}"
