"""Write docs/job-file.md: every key of a job with its default and meaning, from the docstrings of the code."""

from collections.abc import Iterable, Iterator
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any, get_args, get_type_hints

from gantrysim.bead import BeadSettings
from gantrysim.dispenser.dispenser import Dispenser
from gantrysim.faults import KINDS
from gantrysim.job.job import Job
from gantrysim.job.programs import PROGRAMS, described
from gantrysim.job.settings import ServoSettings, SimulationSettings
from gantrysim.machine.geometry import Geometry

PAGE = Path(__file__).parent.parent / "docs" / "job-file.md"

HEAD = """# Job file

A job describes a run completely, in TOML. `gantrysim run JOB` takes a built-in job or a file; `--set KEY=VALUE` changes
a value, by its full key (`--set servo.damping=0.7`) or by its last part where that is unique (`--set damping=0.7`).
`job.toml` in every output folder holds all keys with the values that were used. Lengths are in mm, angles in deg, times
in s. The [tutorial](tutorial.md) has an example; `python scripts/job_file_page.py` writes this page from the code.
"""


def text(value: Any) -> str:
    """Return a default as a job file states it."""
    if value is MISSING:
        return "required"
    if value is None or value in ((), {}):
        return "none"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    return f"[{', '.join(map(text, value))}]" if isinstance(value, tuple) else f"{value:g}"


def parts(kind: type[Any]) -> Iterator[tuple[str, Any, str, type[Any] | None]]:
    """Yield the fields of a dataclass: name, default, meaning, and the dataclass that it is a table of, if any."""
    hints, meaning = get_type_hints(kind), described(kind)
    for field in fields(kind):
        options = (hints[field.name], *get_args(hints[field.name]))
        table = next((each for each in options if is_dataclass(each) and isinstance(each, type)), None)
        default = field.default if field.default_factory is MISSING else field.default_factory()
        yield field.name, default, meaning.get(field.name, ""), table


def rows(kind: type[Any], prefix: str) -> Iterator[tuple[str, str, str]]:
    """Yield key, default and meaning of a dataclass' fields, those of its tables included."""
    for name, default, meaning, table in parts(kind):
        yield prefix + name, "table" if table else text(default), meaning
        if table:
            yield from rows(table, f"{prefix}{name}.")


def settings(model: type[Any], prefix: str) -> Iterator[tuple[str, str, str]]:
    """Yield the same of a pydantic model; a gain without a default is derived."""
    for name, field in model.model_fields.items():
        derived = "derived" if field.default is None else text(field.default)
        yield prefix + name, derived, field.description or ""


def faults() -> Iterator[tuple[str, str, str]]:
    """Yield the same of the faults on purpose: what all have, and the values of each kind."""
    yield "kind", "required", "one of the kinds below"
    yield "time", "required", "time at which it begins [s]"
    for kind, own in KINDS.items():
        for name, default, meaning, _ in parts(own):
            if name not in ("kind", "time"):
                yield f"{kind}: {name}", text(default), meaning


def section(title: str, lines: Iterable[tuple[str, str, str]]) -> str:
    """Return a heading and a table."""
    cells = [(f"`{key}`", default, " ".join(meaning.split()).replace("|", r"\|")) for key, default, meaning in lines]
    table = [("key", "default", "meaning"), ("---", "---", "---"), *cells]
    return f"\n## {title}\n\n" + "".join(f"| {' | '.join(row)} |\n" for row in table)


def page() -> str:
    """Return the page."""
    defaults = {"name": "required", "machine": "by the program", "program": "required"}
    defaults |= dict.fromkeys(("faults", "geometry", "names"), "none")
    job = [(name, defaults.get(name, "table"), described(Job)[name]) for name in Job.model_fields]
    sections = [
        section("The job", job),
        section("`[servo]`", settings(ServoSettings, "servo.")),
        section("`[dispenser]`", rows(Dispenser, "dispenser.")),
        section("`[bead]`", rows(BeadSettings, "bead.")),
        section("`[simulation]`", settings(SimulationSettings, "simulation.")),
        section("`[geometry]`", rows(Geometry, "geometry.")),
        section("`[[faults]]`", faults()),
    ]
    sections += [
        section(f'`[program]`, `controller = "{name}"`', rows(kind, "program.")) for name, kind in PROGRAMS.items()
    ]
    return HEAD + "".join(sections)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
