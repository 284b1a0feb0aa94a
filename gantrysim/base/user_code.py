"""The user's own code, such as a servo law or a controller, named "module:name" or "path/to/file.py:name"."""

from __future__ import annotations

import hashlib
import importlib
import sys
from pathlib import Path
from threading import RLock
from types import ModuleType
from typing import Any

from gantrysim.base.errors import InputError, expanded_path, text_of
from gantrysim.base.input_files import opened_file

_lock = RLock()  # an import may itself resolve names


def is_code(name: object) -> bool:
    """Return whether a name stands for the user's code, not for something built in."""
    return isinstance(name, str) and ":" in name


def absolute_code(name: Any, folder: Path) -> Any:
    """Return the name of code with a file's path made absolute.

    Args:
        name: any value of a job file; one that names no file is returned unchanged.
        folder: where a relative path starts.
    """
    if not is_code(name):
        return name
    place, _, attribute = name.rpartition(":")
    return f"{(folder / expanded_path(place)).absolute()}:{attribute}" if place.endswith(".py") else name


def named_object(kind: str, name: str) -> tuple[Any, str]:
    """Import what a name stands for; return the object, None where there is none, and its module or file.

    Args:
        kind: of the code, for messages, such as "law".
        name: "module:name" or "path/to/file.py:name".

    Raises:
        InputError: its module cannot be imported.
    """
    place, _, attribute = name.rpartition(":")
    try:
        module = _module_in(Path(place)) if place.endswith(".py") else importlib.import_module(place)
    # whatever the module raises, and sys.exit(), which would end the command in silence
    except (Exception, SystemExit) as error:
        raise InputError(f"{kind} {name!r}: {place} cannot be imported: {text_of(error)}") from None
    return getattr(module, attribute, None), place


def _module_in(file: Path) -> ModuleType:
    """Return the module in a file, imported once as long as the file does not change.

    The source is compiled here: Python's own loader takes bytecode for current whose source has changed within the same
    second without changing its size, and would write it beside the user's file.
    """
    with opened_file(file) as stream:
        source = stream.read()
    name = f"gantrysim_code_{file.resolve()}_{hashlib.sha256(source).hexdigest()[:16]}"
    with _lock:
        if name not in sys.modules:
            module = ModuleType(name)
            module.__file__ = str(file.absolute())
            # before its code runs: a dataclass looks its module up there
            sys.modules[name] = module
            try:
                exec(compile(source, module.__file__, "exec"), module.__dict__)
            except BaseException:
                del sys.modules[name]
                raise
        return sys.modules[name]
