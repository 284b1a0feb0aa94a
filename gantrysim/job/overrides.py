"""Values of a job changed by their keys: dotted ones, and on the command line their last parts alone."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gantrysim.errors import InputError, unknown
from gantrysim.machine.machine import builtin_models

Content = dict[str, Any]  # of a job's file


def change(content: Content, key: str, value: Any, known: Sequence[str]) -> None:
    """Set a value in a job's content; None takes it away.

    Args:
        content: to be changed.
        key: dotted, in full.
        value: plain value, as TOML has it.
        known: keys that there are.

    Raises:
        InputError: an unknown key.
    """
    if key not in known:
        raise unknown("key", key, known)
    table, leaf = _place(content, key, key)
    if value is None:
        table.pop(leaf, None)
    else:
        table[leaf] = value


def override(content: Content, text: str, known: Sequence[str]) -> None:
    """Set a value in a job's content as --set says it; that of `machine` is taken from the working folder.

    Args:
        content: to be changed.
        text: "key=value" with a TOML value, or a text without quotes; the key is dotted, or its last parts alone where
            they are unique.
        known: keys that there are, in full.

    Raises:
        InputError: a text of another form, an unknown key, or one that several end in.
    """
    said = f"--set {text}"
    key, equals, right = text.partition("=")
    key = key.strip()
    if not equals:
        raise InputError(f"{said}: must be key=value")
    if key not in known:
        matches = [name for name in known if name.endswith(f".{key}")]
        if len(matches) > 1:
            raise InputError(f"{said}: {key!r} is ambiguous: {', '.join(matches)}")
        if not matches:
            raise unknown("key", key, known)
        key = matches[0]
    try:
        value = tomllib.loads(f"value = {right}")["value"]
    except tomllib.TOMLDecodeError:
        value = right.strip()
    if key == "machine" and isinstance(value, str):
        value = machine_in_full(value, Path())
    table, leaf = _place(content, key, said)
    table[leaf] = value


def machine_in_full(machine: str, folder: Path) -> str:
    """Return the name of a built-in machine as it is, and a file's path from `folder` in full."""
    if machine in builtin_models() or not (set(machine) & set("./\\~")):
        return machine
    return str((folder / Path(machine).expanduser()).absolute())


def _place(content: Content, key: str, said: str) -> tuple[Content, str]:
    """The table that a key is in, made where it is not there yet, and the key's last part."""
    *sections, leaf = key.split(".")
    table = content
    for section in sections:
        table = table.setdefault(section, {})
        if not isinstance(table, dict):
            raise InputError(f"{said}: {section} is no table in this job")
    return table, leaf
