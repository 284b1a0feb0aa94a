"""Labels of runs side by side: the values in which their jobs differ."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any, get_args, get_type_hints

from gantrysim.base.errors import expanded
from gantrysim.glue.bead import BeadSettings
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.job.job import Job
from gantrysim.job.programs import PROGRAMS, described
from gantrysim.job.settings import ServoSettings
from gantrysim.report.saved import SavedRun

_MOST_KEYS = 3
_LONGEST_VALUE = 24  # [letters]
_UNIT = re.compile(r"\[([^\[\]]+)\]")


def labels_of(runs: Sequence[SavedRun]) -> list[str]:
    """Return the labels of saved runs.

    A single run is labelled by its job's name, several by the values in which their jobs differ ("loop_period = 1 s")
    or by their folders where no value differs, more than three do, or one is too long.
    """
    if len(runs) == 1:
        return [runs[0].job.name]
    jobs = [_flat(run.job.model_dump(exclude={"name"})) for run in runs]
    keys = dict.fromkeys(key for job in jobs for key in job)
    differing = [key for key in keys if any(job.get(key) != jobs[0].get(key) for job in jobs)]
    values = [[_text(run.job, key, job.get(key)) for key in differing] for run, job in zip(runs, jobs, strict=True)]
    longest = max((len(text) for row in values for text in row), default=0)
    if not 1 <= len(differing) <= _MOST_KEYS or longest > _LONGEST_VALUE:
        names = [expanded(run.folder).resolve().name for run in runs]
        return names if len(set(names)) == len(names) else [str(run.folder) for run in runs]
    short_keys = [key.rpartition(".")[2] for key in differing]
    names = [short if short_keys.count(short) == 1 else key for short, key in zip(short_keys, differing, strict=True)]
    return [", ".join(f"{name} = {text}" for name, text in zip(names, row, strict=True)) for row in values]


def _flat(content: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return a job's values by their dotted keys."""
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
    """Return the unit of a number, which its description has in brackets; empty without one or with several."""
    section, *names = key.split(".")
    if section == "simulation":
        return "s"
    if section == "servo":
        description = ServoSettings.model_fields[names[0]].description or ""
    else:
        kinds: dict[str, type[Any]] = {"dispenser": Dispenser, "bead": BeadSettings}
        # a user's own controller is not described: the code of a saved run must not run
        if job.program["controller"] in PROGRAMS:
            kinds["program"] = PROGRAMS[job.program["controller"]]
        description = _description(kinds[section], names) if section in kinds else ""
    units = _UNIT.findall(description)
    return units[-1] if units and not re.search(r",| or ", units[-1]) else ""


def _description(kind: type[Any], names: Sequence[str]) -> str:
    """Return the description of a field of a dataclass, or of a dataclass within it."""
    name, *inner_names = names
    if not inner_names:
        return described(kind).get(name, "")
    hint = get_type_hints(kind).get(name)
    for part in (hint, *get_args(hint)):  # a field may be optional
        if isinstance(part, type) and is_dataclass(part):
            return _description(part, inner_names)
    return ""
