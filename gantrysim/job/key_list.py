"""Every key of a job with its default and meaning, from the docstrings of the code."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import MISSING, fields, is_dataclass
from typing import Any, NamedTuple, get_args, get_type_hints

from gantrysim.faults import KINDS
from gantrysim.glue.bead import BeadSettings
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.job.job import Job
from gantrysim.job.programs import PROGRAMS, described_fields
from gantrysim.job.settings import ServoSettings, SimulationSettings
from gantrysim.job.tolerance import ToleranceSettings
from gantrysim.machine.geometry import Geometry


class Key(NamedTuple):
    """A key of a job: its dotted name, its default and meaning in words."""

    name: str
    default: str
    meaning: str


def sections() -> dict[str, list[Key]]:
    """Return the keys by the headings of their tables: the job, those of every job, and those of each controller."""
    defaults = {"name": "required", "machine": "by the program", "program": "required"}
    defaults |= dict.fromkeys(("faults", "geometry", "names", "tolerance", "travel"), "none")
    meanings = described_fields(Job)
    by_heading = {
        "The job": [Key(name, defaults.get(name, "table"), meanings[name]) for name in Job.model_fields],
        "`[servo]`": list(_settings(ServoSettings, "servo.")),
        "`[dispenser]`": list(_rows(Dispenser, "dispenser.")),
        "`[bead]`": list(_rows(BeadSettings, "bead.")),
        "`[simulation]`": list(_settings(SimulationSettings, "simulation.")),
        "`[geometry]`": list(_rows(Geometry, "geometry.")),
        "`[tolerance]`": list(_settings(ToleranceSettings, "tolerance.")),
        "`[[faults]]`": list(_faults()),
    }
    return by_heading | {controller_heading(name): controller_keys(name) for name in PROGRAMS}


def controller_heading(name: str) -> str:
    """Return the heading of a controller's table."""
    return f'`[program]`, `controller = "{name}"`'


def controller_keys(name: str) -> list[Key]:
    """Return the keys of a program of a built-in controller."""
    return list(_rows(PROGRAMS[name], "program."))


def meanings_of(job: Job) -> dict[str, str]:
    """Return the meaning of every key of a job's tables, with its unit in brackets; a user's controller included."""
    rows = (
        *_settings(ServoSettings, "servo."),
        *_rows(Dispenser, "dispenser."),
        *_rows(BeadSettings, "bead."),
        *_rows(Geometry, "geometry."),
        *_rows(type(job.controller), "program."),
    )
    return {key.name: key.meaning for key in rows}


def _default_text(value: Any) -> str:
    """Return a default as a job file states it."""
    if value is MISSING:
        return "required"
    if value is None or value in ((), {}):
        return "none"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    return f"[{', '.join(map(_default_text, value))}]" if isinstance(value, tuple) else f"{value:g}"


def _dataclass_fields(kind: type[Any]) -> Iterator[tuple[str, Any, str, type[Any] | None]]:
    """Yield the fields of a dataclass: name, default, meaning, and the dataclass that it is a table of, if any."""
    hints = get_type_hints(kind)
    meaning = described_fields(kind)
    for field in fields(kind):
        options = (hints[field.name], *get_args(hints[field.name]))
        table = next((part for part in options if is_dataclass(part) and isinstance(part, type)), None)
        default = field.default if field.default_factory is MISSING else field.default_factory()
        yield field.name, default, meaning.get(field.name, ""), table


def _rows(kind: type[Any], prefix: str) -> Iterator[Key]:
    """Yield key, default and meaning of a dataclass' fields, those of its tables included."""
    for name, default, meaning, table in _dataclass_fields(kind):
        yield Key(prefix + name, "table" if table else _default_text(default), " ".join(meaning.split()))
        if table:
            yield from _rows(table, f"{prefix}{name}.")


def _settings(model: type[Any], prefix: str) -> Iterator[Key]:
    """Yield the same of a pydantic model; a gain without a default is derived."""
    for name, field in model.model_fields.items():
        derived = "derived" if field.default is None else _default_text(field.default)
        yield Key(prefix + name, derived, field.description or "")


def _faults() -> Iterator[Key]:
    """Yield the same of the deliberate faults: what all have, and the values of each kind."""
    yield Key("kind", "required", "one of the kinds below")
    yield Key("time", "required", "time at which the fault begins [s]")
    for kind, fault in KINDS.items():
        for name, default, meaning, _ in _dataclass_fields(fault):
            if name not in ("kind", "time"):
                yield Key(f"{kind}: {name}", _default_text(default), " ".join(meaning.split()))
