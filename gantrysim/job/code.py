"""Code that a job brings along, such as a law of its own, and whether it may run: decided here for every such key."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gantrysim.servo.laws.parameters import is_own


def named_code(content: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the functions that the content of a job names in place of built-in ones, each after its key.

    As in "servo.law = mine.py:pd", a file, or "servo.law = package.module:pd".
    """
    servo = content.get("servo")
    law = servo.get("law") if isinstance(servo, Mapping) else None
    laws = law if isinstance(law, list | tuple) else [law]
    return tuple(f"servo.law = {name}" for name in laws if isinstance(name, str) and is_own(name))


def refusal(code: tuple[str, ...], file: Path) -> str:
    """Return why the code that a file names may not run unasked, and how to allow it; empty where it may.

    It may where the file, after links are resolved, lies in the present working folder: who works there trusts it, as
    Python does.
    """
    folder = file.resolve().parent
    try:
        here = Path.cwd().resolve()
    except FileNotFoundError:  # deleted since
        here = None
    if not code or folder == here:
        return ""
    return (
        f"would run code of its own, {', '.join(code)}: if you trust it, allow it with --allow-code, in Python with "
        f"allow_code=True, or go to its folder, {folder}"
    )
