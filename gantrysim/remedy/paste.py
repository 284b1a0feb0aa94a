"""Lines to paste: what an improved job changes, as keys of a job file, options of a command, and controllers' words."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from typing import Any

import tomli_w

from gantrysim.base.errors import InputError
from gantrysim.exchange.gains import DIALECTS, exported
from gantrysim.job.job import Job

_PROGRAM = "program."
_MOST = 60  # characters of a value on the command line


def changed_values(base: Job, improved: Job) -> dict[str, Any]:
    """Return the values of an improved job that differ from those of the job, by their dotted keys."""
    before = _flat(tomllib.loads(base.toml()))
    after = _flat(tomllib.loads(improved.toml()))
    return {key: value for key, value in after.items() if key not in before or before[key] != value}


def toml_lines(base: Job, improved: Job) -> str:
    """Return the changed values as tables of a job file; empty without any."""
    tables: dict[str, list[str]] = {}
    for key, value in changed_values(base, improved).items():
        table, _, leaf = key.rpartition(".")
        is_text = isinstance(value, str) and "\n" in value
        text = tomli_w.dumps({leaf: value}, multiline_strings=True) if is_text else f"{leaf} = {_inline(value)}\n"
        tables.setdefault(table, []).append(text)
    return "\n".join("".join([f"[{table}]\n" if table else "", *lines]) for table, lines in tables.items())


def options(base: Job, improved: Job) -> list[str]:
    """Return the changed values as options of a command of gantrysim; none where a text differs in more than speeds.

    Speeds inside a program's text are one option --speed.
    """
    values = changed_values(base, improved)
    texts = [key for key, value in values.items() if len(_inline(value)) > _MOST or "\n" in str(value)]
    words = []
    scaled: set[str] = set()
    if texts:
        speed = improved.controller.programmed_speed
        at_speed = {f"{_PROGRAM}{key}": value for key, value in base.controller.arguments_at(speed).items()}
        if any(at_speed.get(key) != values[key] for key in texts):
            return []
        words.append(f"--speed {speed:.6g}")
        scaled = set(at_speed)
    words += [f"--set {key}={_quoted(_inline(value))}" for key, value in values.items() if key not in scaled]
    return words


def controller_words(base: Job, improved: Job) -> str:
    """Return the improved gains in the words of the job's controller, or a note on what it has no word for.

    Empty where the gains are those of the job, or the words cannot express those either.
    """
    name = str(improved.program["controller"]).split(".")[0]
    if name not in DIALECTS or base.built_servo == improved.built_servo:
        return ""
    try:
        exported(name, base.built_machine.axes, base.built_servo)
    except InputError:  # the words cannot express the job as it is, whatever changes
        return ""
    try:
        text, notes = exported(name, improved.built_machine.axes, improved.built_servo)
    except InputError as error:
        return f"{error}\n"
    return text + "".join(f"note: {note}\n" for note in notes)


def _flat(content: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return the values of nested tables by their dotted keys."""
    values: dict[str, Any] = {}
    for key, value in content.items():
        if isinstance(value, Mapping):
            values |= _flat(value, f"{prefix}{key}.")
        else:
            values[f"{prefix}{key}"] = value
    return values


def _inline(value: Any) -> str:
    """Return a value as TOML on one line."""
    text = tomli_w.dumps({"v": value}).removeprefix("v = ").strip()
    return " ".join(text.split()).replace("[ ", "[").replace(", ]", "]").replace(" ]", "]")


def _quoted(text: str) -> str:
    """Return a word for a shell."""
    return f"'{text}'" if set(text) & set(" []\"'{}$") else text
