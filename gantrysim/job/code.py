"""Code that a job brings along, a law or a controller of the user's, and whether it may run: decided here for both."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gantrysim.base.user_code import absolute_code, is_code

CONTROLLER = "program.controller"
_LAW = "servo.law"


def named_code(content: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the code that the content of a job names in place of something built in, each entry after its key.

    As in "servo.law = mine.py:pd", a function in a file, or "program.controller = package.module:Zigzag", a class.
    """
    servo = content.get("servo")
    program = content.get("program")
    law = servo.get("law") if isinstance(servo, Mapping) else None
    controller = program.get("controller") if isinstance(program, Mapping) else None
    laws = law if isinstance(law, list | tuple) else [law]
    named = [(CONTROLLER, controller), *((_LAW, name) for name in laws)]
    return tuple(f"{key} = {name}" for key, name in named if is_code(name))


def absolute_value(key: str, value: Any, folder: Path) -> Any:
    """Return the value of a job's key; where it names code, a file of it has its absolute path.

    Args:
        key: full and dotted.
        value: of any key.
        folder: where a relative path starts.
    """
    if key not in (CONTROLLER, _LAW):
        return value
    if isinstance(value, list):
        return [absolute_code(name, folder) for name in value]
    return absolute_code(value, folder)


def is_trusted(file: Path) -> bool:
    """Return whether code that a file names may run unasked: where it lies, links resolved, in the working folder.

    Who works there trusts it, as Python does.
    """
    try:
        working_folder = Path.cwd().resolve()
    except FileNotFoundError:  # deleted since
        return False
    return file.resolve().parent == working_folder


def refusal(code: tuple[str, ...], file: Path) -> str:
    """Return why the code that a file names may not run unasked, and how to allow it; empty where it may."""
    if not code or is_trusted(file):
        return ""
    return (
        f"would run code of its own, {', '.join(code)}: if you trust it, allow it with --allow-code, in Python with "
        f"allow_code=True, or go to its folder, {file.resolve().parent}"
    )
