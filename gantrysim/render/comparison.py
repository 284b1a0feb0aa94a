"""What runs side by side are called: by what their jobs differ in."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any, get_args, get_type_hints

from gantrysim.bead import BeadSettings
from gantrysim.controllers.programs import PROGRAMS, described
from gantrysim.job.job import Job, ServoSettings
from gantrysim.machine.dispenser import Dispenser
from gantrysim.report.saved import SavedRun

_MOST_KEYS = 3
_LONGEST_VALUE = 24  # [letters]
_UNIT = re.compile(r"\[([^\[\]]+)\]")


def labels_of(runs: Sequence[SavedRun]) -> list[str]:
    """Return what tells saved runs apart.

    Of one run that is its job's name; of several the values in which their jobs differ, as "loop_period = 1 s". Where
    these are none, more than three, or too long to be read, it is the folders' names.
    """
    if len(runs) == 1:
        return [runs[0].job.name]
    flat = [_flat(run.job.model_dump(exclude={"name"})) for run in runs]
    differing = [key for key in dict.fromkeys(key for one in flat for key in one) if _differs(key, flat)]
    values = [[_text(run.job, key, one.get(key)) for key in differing] for run, one in zip(runs, flat, strict=True)]
    if not 1 <= len(differing) <= _MOST_KEYS or any(len(text) > _LONGEST_VALUE for row in values for text in row):
        return _folders(runs)
    last = [key.rpartition(".")[2] for key in differing]
    names = [short if last.count(short) == 1 else key for short, key in zip(last, differing, strict=True)]
    return [", ".join(f"{name} = {text}" for name, text in zip(names, row, strict=True)) for row in values]


def _folders(runs: Sequence[SavedRun]) -> list[str]:
    names = [run.folder.expanduser().resolve().name for run in runs]
    return names if len(set(names)) == len(names) else [str(run.folder) for run in runs]


def _differs(key: str, flat: Sequence[Mapping[str, Any]]) -> bool:
    return any(one.get(key) != flat[0].get(key) for one in flat)


def _flat(content: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """A job's values by their dotted keys."""
    flat: dict[str, Any] = {}
    for key, value in content.items():
        flat.update(_flat(value, f"{prefix}{key}.") if isinstance(value, Mapping) else {f"{prefix}{key}": value})
    return flat


def _text(job: Job, key: str, value: Any) -> str:
    if value is None:
        return "default"
    if key == "machine":
        return Path(str(value)).stem
    if isinstance(value, bool):
        return str(value).lower()
    if not isinstance(value, int | float):
        return " ".join(str(value).split())
    return f"{value:g} {_unit(job, key)}".rstrip()


def _unit(job: Job, key: str) -> str:
    """The unit of a number, as what describes it says: the one in brackets; none where it says several, or none."""
    section, *names = key.split(".")
    if section == "simulation":
        return "s"
    if section == "servo":
        said = ServoSettings.model_fields[names[0]].description or ""
    else:
        kinds = {"program": PROGRAMS[job.program["controller"]], "dispenser": Dispenser, "bead": BeadSettings}
        said = _said(kinds[section], names) if section in kinds else ""
    units = _UNIT.findall(said)
    return units[-1] if units and not re.search(r",| or ", units[-1]) else ""


def _said(kind: type[Any], names: Sequence[str]) -> str:
    """What a dataclass, or that which is part of it, says of a field."""
    name, *rest = names
    if not rest:
        return described(kind).get(name, "")
    hint = get_type_hints(kind).get(name)
    for part in (hint, *get_args(hint)):
        if isinstance(part, type) and is_dataclass(part):
            return _said(part, rest)
    return ""
