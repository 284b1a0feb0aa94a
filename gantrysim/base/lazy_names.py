"""Public names of a package, each imported at its first use; a wrong one gets the nearest."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import lazy_loader


def lazy_names(package: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return `__getattr__`, `__dir__` and `__all__` of a package whose names its `__init__.pyi` lists.

    Args:
        package: its `__name__`.
        file: its `__file__`.
    """
    load, names, public = lazy_loader.attach_stub(package, file)

    def name_of(name: str) -> Any:
        # an error that a module raises at its import is the module's; IPython and others ask for names with underscores
        if name in public or name.startswith("_"):
            return load(name)
        from gantrysim.base.errors import meant_names, nearest  # imports NumPy

        question = meant_names(nearest(name, public)[:1])
        hint = question or f"dir({package}) lists its names"
        raise AttributeError(f"module {package!r} has no attribute {name!r}: {hint}")

    return name_of, names, public
