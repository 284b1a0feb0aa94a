"""Lines to paste: what an improved job changes, as keys of a job file, options of a command, and controllers' words."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Set
from typing import Any

import tomli_w

from gantrysim.base.errors import InputError
from gantrysim.exchange.gains import DIALECTS, exported
from gantrysim.job.job import Job
from gantrysim.job.overrides import known_keys

_PROGRAM = "program."
_MOST = 60  # characters of a value on the command line
_ROUNDS = 5  # in which values that follow from others are set as well
_SPEED_DIGITS = 12  # of an option --speed
_WHOLE = "in place of the whole table, with its file"
_NONE: dict[str, Any] = {"travel": {}, "names": {}, "faults": []}  # what a job has without a table of them


def changed_values(base: Job, improved: Job) -> dict[str, Any]:
    """Return the values of an improved job that differ from those of the job, by the dotted keys of a job file."""
    before = _values(base)
    after = _values(improved)
    if "bead.gap" in before and "bead.gap" not in after:
        after["bead.gap"] = improved.built_machine.gap
    gone = {key: _NONE[key] for key in before if key not in after and key in _NONE}
    return {key: value for key, value in after.items() if key not in before or before[key] != value} | gone


def values_to_set(improved: Job, loaded: Callable[[dict[str, Any]], Job]) -> dict[str, Any] | None:
    """Return the values with which a job is loaded as the improved one; None where no values do that.

    What a job's file leaves open is chosen when it is loaded: the amount of glue for the needle, the place of the
    program, the travel of the machine. It may follow the values that are set, and what would then differ from the
    improved job is set as well.

    Args:
        improved: the improved job.
        loaded: loads the job with values by their dotted keys.
    """
    values: dict[str, Any] = {}
    for _ in range(_ROUNDS):
        differing = changed_values(loaded(values), improved)
        if not differing:
            return values
        values |= differing
    return None


def toml_lines(base: Job, improved: Job) -> str:
    """Return the values to set in the job's file, as its tables; empty without any.

    They include the options with which the job was loaded. For a program file they are a whole job file.
    """
    values = values_to_set(improved, lambda values: base.loaded_with(values, in_file=True))
    if not values:
        return ""
    given = base.given
    head: dict[str, Any] = {}
    if given is not None and given.text_key in values:
        head = {f"{_PROGRAM}controller": improved.program["controller"]}
    elif given is not None and given.program_file:
        head = {f"{_PROGRAM}file": given.program_file}
        if given.controller is not None:
            head[f"{_PROGRAM}controller"] = given.controller
    lines = _tables(head | values)
    if given is not None and given.program_file:
        return f'name = "{base.name}"\n{lines}'
    return lines.replace("[program]\n", f"[program]  # {_WHOLE}\n", 1) if f"{_PROGRAM}controller" in head else lines


def _tables(values: Mapping[str, Any]) -> str:
    tables: dict[str, list[str]] = {}
    for key, value in sorted(values.items(), key=lambda item: "." in item[0]):  # keys without a table come first
        table, _, leaf = key.rpartition(".")
        is_text = isinstance(value, str) and "\n" in value
        text = tomli_w.dumps({leaf: value}, multiline_strings=True) if is_text else f"{leaf} = {_inline(value)}\n"
        tables.setdefault(table, []).append(text)
    return "\n".join("".join([f"[{table}]\n" if table else "", *lines]) for table, lines in tables.items())


def options(base: Job, improved: Job) -> list[str]:
    """Return the values to set as options of a command of gantrysim, after those with which the job was loaded.

    Speeds inside a program's text are one option --speed. None where a text differs in more than speeds.
    """
    values = values_to_set(improved, lambda values: base.loaded_with(values))
    speed: float | None = None
    is_at_speed = base.given is not None and base.given.speed is not None  # which sets the speed after all values
    if values is None or is_at_speed or any(map(_is_long, values.values())):
        speed = float(f"{improved.controller.programmed_speed:.{_SPEED_DIGITS}g}")
        values = values_to_set(improved, lambda values: base.loaded_with(values, speed=speed))
        if values is None or any(map(_is_long, values.values())):
            return []
    words = [] if speed is None else [f"--speed {speed:.{_SPEED_DIGITS}g}"]
    return words + [f"--set {key}={_quoted(_inline(value))}" for key, value in values.items()]


def _is_long(value: Any) -> bool:
    """Return whether a value is a text of lines, or too long to be typed."""
    return len(_inline(value)) > _MOST or "\n" in str(value)


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


def _values(job: Job) -> dict[str, Any]:
    """Return the values of a job by the dotted keys of its file."""
    content = tomllib.loads(job.toml())
    content.pop("source", None)  # a name for messages
    return _flat(content, set(known_keys(content, allow_code=True)))


def _flat(content: Mapping[str, Any], keys: Set[str], prefix: str = "") -> dict[str, Any]:
    """Return the values of nested tables by their dotted keys; a table without keys of its own stays whole."""
    values: dict[str, Any] = {}
    for name, value in content.items():
        key = f"{prefix}{name}"
        is_value = key in keys and not any(other.startswith(f"{key}.") for other in keys)
        if isinstance(value, Mapping) and not is_value:
            values |= _flat(value, keys, f"{key}.")
        else:
            values[key] = value
    return values


def _inline(value: Any) -> str:
    """Return a value as TOML on one line."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{name} = {_inline(item)}" for name, item in value.items()) + "}"
    text = tomli_w.dumps({"v": value}).removeprefix("v = ").strip()
    return " ".join(text.split()).replace("[ ", "[").replace(", ]", "]").replace(" ]", "]")


def _quoted(text: str) -> str:
    """Return a word for a shell."""
    return f"'{text}'" if set(text) & set(" []\"'{}$") else text
