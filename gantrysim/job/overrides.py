"""Overrides of a job's values by their keys: dotted, or on the command line their last parts alone."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from textwrap import shorten
from typing import Any

from gantrysim.base.errors import InputError, check_type, expanded_path, meant_names, nearest, short_text, wrong_type
from gantrysim.base.input_files import toml_content
from gantrysim.faults import KINDS
from gantrysim.glue.bead import BeadSettings
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.job.code import CONTROLLER, absolute_value
from gantrysim.job.programs import dotted_names, keys
from gantrysim.job.settings import ServoSettings, SimulationSettings
from gantrysim.job.tolerance import ToleranceSettings
from gantrysim.machine.geometry import Geometry
from gantrysim.machine.machine import builtin_models

Content = dict[str, Any]  # of a job file
Override = str | tuple[str, Any]  # text "key=value", or key and value
_SHOWN = 200  # characters of an option

LIST_OF_KEYS = "all keys: gantrysim info keys"

# the tables of a job file besides the program's
TABLES: dict[str, Any] = {
    "servo": ServoSettings,
    "simulation": SimulationSettings,
    "dispenser": Dispenser,
    "bead": BeadSettings,
    "geometry": Geometry,
    "tolerance": ToleranceSettings,
}


def change(content: Content, key: str, value: Any, known: Sequence[str]) -> None:
    """Set the value of a full dotted key in the content of a job file; None removes it.

    Raises:
        InputError: the key is not among the known ones.
    """
    if key not in known:
        raise _unknown_key(key, known)
    table, leaf = _table_of(content, key, key)
    if value is None:
        table.pop(leaf, None)
    else:
        table[leaf] = value


def settings_of(overrides: Iterable[str] | Mapping[str, Any]) -> tuple[Override, ...]:
    """Return the overrides of a job, given as texts "key=value" or as values by their keys.

    Raises:
        InputError: a single text.
    """
    if isinstance(overrides, str):
        raise InputError(f"overrides = {overrides!r}: must be texts in a list, or a mapping of keys to values")
    check_type("overrides", overrides, Iterable, "texts in a list, or a mapping of keys to values")
    given = tuple(overrides.items()) if isinstance(overrides, Mapping) else tuple(overrides)
    for setting in given:
        is_pair = isinstance(setting, tuple) and len(setting) == 2 and isinstance(setting[0], str)
        if not isinstance(setting, str) and not is_pair:
            raise wrong_type("overrides[]", setting, 'a text "key=value", or a pair of key and value')
    return given


def override(content: Content, setting: Override, known: Sequence[str]) -> None:
    """Set a value in the content of a job file by "key=value", as --set does, or by a key and a value.

    In a text the value is TOML or unquoted text; the key is a known one in full, or its last parts where they are
    unique. A path in `machine`, and one of the user's code, is relative to the working folder.

    Raises:
        InputError: not "key=value", or an unknown or ambiguous key.
    """
    if isinstance(setting, str):
        option = f"--set {shorten(setting, _SHOWN)}"
        key, equals, right = setting.partition("=")
        if not equals:
            raise InputError(f"{option}: must be key=value")
        key = _full_key(key.strip(), option, known)
        value = _value_of(key, right)
    else:
        option, value = setting
        key = _full_key(option, option, known)
    if key == "machine" and isinstance(value, str):
        value = absolute_machine(value, Path())
    value = absolute_value(key, value, Path())
    table, leaf = _table_of(content, key, option)
    if value is None:
        table.pop(leaf, None)
    else:
        table[leaf] = value


def _full_key(key: str, option: str, known: Sequence[str]) -> str:
    if key not in known:
        matches = [name for name in known if name.endswith(f".{key}")]
        if len(matches) > 1:
            raise InputError(f"{option}: {key!r} is ambiguous: {', '.join(matches)}")
        if not matches:
            raise _unknown_key(key, known)
        return matches[0]
    return key


def _value_of(key: str, text: str) -> Any:
    try:
        return toml_content(f"value = {text}", f"--set {key}")["value"]
    except tomllib.TOMLDecodeError:
        return text.strip()


def _unknown_key(key: str, known: Sequence[str]) -> InputError:
    """Return the error for a key that a job does not have, with the three nearest and where all are listed."""
    question = meant_names(nearest(key, sorted(known)))
    return InputError(f"unknown key {short_text(key)}: {f'{question} ' if question else ''}{LIST_OF_KEYS}")


def set_placement(content: Content, placement: Mapping[str, float], known: Sequence[str]) -> None:
    """Set attributes of the program's `Placement` in the content of a job file.

    Raises:
        InputError: the program's controller takes none.
    """
    for name, value in placement.items():
        key = f"program.placement.{name}"
        if key not in known:
            controller = content.get("program", {}).get("controller")
            raise InputError(
                f"--at, --rotate, --scale, --z-down: a program of {controller} cannot be placed on the work"
            )
        change(content, key, value, known)


def absolute_machine(machine: str, folder: Path) -> str:
    """Return the name of a built-in machine unchanged, and the path of a file in `folder` as an absolute path."""
    if machine in builtin_models() or not (set(machine) & set("./\\~")):
        return machine
    try:
        machine.encode()
    except UnicodeEncodeError:  # it could not stand in a job file
        raise InputError(f"machine {machine!r:.60}: its name must be text in UTF-8") from None
    return str((folder / expanded_path(machine)).absolute())


def _table_of(content: Content, key: str, source: str) -> tuple[Content, str]:
    """Return the table that holds a key, created if missing, and the last part of the key."""
    *sections, leaf = key.split(".")
    table: Any = content
    for section in sections:
        table = table[int(section)] if isinstance(table, list | tuple) else table.setdefault(section, {})
        # of lists, the keys of faults alone hold a number
        is_faults = section == "faults" and isinstance(table, list | tuple)
        if not is_faults and not isinstance(table, dict):
            raise InputError(f"{source}: {section} is not a table in this job")
    return table, leaf


def known_keys(content: Content, *, allow_code: bool = False) -> list[str]:
    """Return the full dotted keys of a job with this content; a fault's keys hold its number, from 0.

    Args:
        content: of a job file.
        allow_code: whether a controller of the user's own may be imported; its keys are those given otherwise.

    Raises:
        InputError: the controller cannot be imported.
    """
    known = ["name", "machine", "travel", "names", CONTROLLER, "faults"]
    for section, kind in TABLES.items():
        known += [f"{section}.{name}" for name in getattr(kind, "model_fields", None) or dotted_names(kind)]
    faults = content.get("faults", [])
    for n, fault in enumerate(faults if isinstance(faults, list | tuple) else []):
        if isinstance(fault, dict) and fault.get("kind") in KINDS:
            known += [f"faults.{n}.{name}" for name in dotted_names(KINDS[fault["kind"]])]
    return known + [f"program.{key}" for key in keys(content.get("program", {}), allow_code=allow_code)]
