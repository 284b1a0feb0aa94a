"""What is to be done when a module is imported, without importing it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from types import ModuleType
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:  # slow to import, and an interrupt before the command's first line is a traceback
    from importlib.abc import Loader


def when_imported(name: str, action: Callable[[ModuleType], object]) -> None:
    """Call a function with a module: now if it has been imported, else after its first import.

    Args:
        name: of a module, such as "gymnasium".
        action: called once.
    """
    module = sys.modules.get(name)  # None where the import of the module is blocked
    if module is not None:
        action(module)
    else:
        sys.meta_path.insert(0, _Finder(name, action))


class _Finder:
    """Lets the other finders find a module, and calls a function after their loader has run it."""

    def __init__(self, name: str, action: Callable[[ModuleType], object]) -> None:
        self._name = name
        self._action = action
        self._is_looking = False

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != self._name or self._is_looking:
            return None
        self._is_looking = True  # below it is asked again
        try:
            spec = find_spec(fullname)
        finally:
            self._is_looking = False
        if spec is not None and spec.loader is not None:
            spec.loader = cast(Any, _Loader(spec.loader, self._done))
        return spec

    def _done(self, module: ModuleType) -> None:
        if self in sys.meta_path:  # a module may be imported anew
            sys.meta_path.remove(self)
            self._action(module)


class _Loader:
    """Loads a module as another loader does, and calls a function with it."""

    def __init__(self, loader: Loader, action: Callable[[ModuleType], object]) -> None:
        self._loader = loader
        self._action = action

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        return self._loader.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        # the module keeps the loader that knows its source and its resources
        module.__loader__ = self._loader
        if module.__spec__ is not None:
            module.__spec__.loader = self._loader
        self._loader.exec_module(module)
        self._action(module)
