"""Write docs/job-file.md: every key of a job with its default and meaning, from the docstrings of the code."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from gantrysim.job.key_list import Key, controller_heading, sections
from gantrysim.job.programs import PROGRAMS

PAGE = Path(__file__).parent.parent / "docs" / "job-file.md"

HEAD = """# Job file

A job describes a run completely, in TOML: machine, program, servo, dispenser, tolerances. `gantrysim run JOB` takes a
built-in job or a file. Lengths are in mm, angles in deg, times in s.

## The ten keys you need

Every other key has a default that is right for a first run. This job uses the ten:
"""

EXAMPLE = """
```toml
name = "bracket"
machine = "xyz"

[program]
controller = "linuxcnc.Program"
file = "part.ngc"

[tolerance]
path_max = 0.1
bead_width = 15.0

[dispenser]
area = 1.0
dead_time = 0.005
opening = 0.02
closing = 0.02
advance = 0.02

[servo]
law = ["pid", "friction"]

[geometry]
accuracy = "C7"
```
"""

# each of the ten: what to think of
TEN = {
    "machine": "a built-in machine, your table of data-sheet values, or an MJCF file",
    "program": "`program.controller`; `program.file`, the program in its own language; others below",
    "tolerance.path_max": "largest distance from the path [mm]; by default a tenth of the needle's outer diameter",
    "tolerance.bead_width": "deviation of the width that the part admits, by default 10 [%]",
    "dispenser.area": "section of the bead [mm²], where the flow follows the speed; `dispenser.flow` where it does not",
    "dispenser.dead_time": "from the data sheet of the valve, or from a film of its start [s]",
    "dispenser.opening": "time constant of the rising flow; `dispenser.closing`: of the falling flow [s]",
    "dispenser.advance": "the time constant, if the controller compensates the lag [s]",
    "servo.law": 'a law, or a list as in `["pid", "friction"]`; your own as `["mine.py:pd", "friction"]`',
    "geometry.accuracy": "class of screws and guides; without one they are perfect",
}

AFTER_TEN = """
On the command line `--set KEY=VALUE` changes a key for one run, by its full name (`--set servo.damping=0.7`) or by its
last part where that is unique (`--set damping=0.7`). `job.toml` in every output folder holds all keys with the values
that were used. `gantrysim info servo.damping` prints one key, `gantrysim info keys` all.

All keys follow, by table; `python scripts/job_file_page.py` writes this page from the code.
"""

# rows of a table that is not folded
MOST_OPEN_ROWS = 3

SHARED = """
## `[program]`, keys that several controllers have alike

The tables of the controllers, below, hold their other keys.
"""


def ten_keys() -> str:
    """Return the table of the ten keys, with their defaults from the code."""
    keys = {key.name: key for section_keys in sections().values() for key in section_keys}
    rows = [f"| `{name}` | {keys[name].default} | {meaning} |\n" for name, meaning in TEN.items()]
    return "\n| key | default | meaning |\n| --- | --- | --- |\n" + "".join(rows)


def section(title: str, keys: Iterable[Key]) -> str:
    """Return a heading and a table."""
    return f"\n## {title}\n\n{table(keys)}"


def table(keys: Iterable[Key]) -> str:
    """Return a table of keys; a long one opens from a line with their names."""
    cells = [(f"`{key.name}`", key.default, " ".join(key.meaning.split()).replace("|", r"\|")) for key in keys]
    rows = [("key", "default", "meaning"), ("---", "---", "---"), *cells]
    text = "".join(f"| {' | '.join(row)} |\n" for row in rows)
    if len(cells) <= MOST_OPEN_ROWS:
        return text
    names = ", ".join(name.strip("`").rpartition(".")[2] for name, *_ in cells)
    return f'<details markdown="1">\n<summary>{len(cells)} keys: {names}</summary>\n\n{text}\n</details>\n'


def shared(controllers: Mapping[str, Iterable[Key]]) -> dict[tuple[str, ...], list[Key]]:
    """Return the keys that several controllers have alike, where there are several, by these controllers' names."""
    having: dict[Key, list[str]] = {}
    for name, keys in controllers.items():
        for key in keys:
            having.setdefault(key, []).append(name)
    by_names: dict[tuple[str, ...], list[Key]] = {}
    for key, names in having.items():
        if len(names) > 1:
            by_names.setdefault(tuple(names), []).append(key)
    return {names: alike for names, alike in by_names.items() if len(alike) > 1}


def page() -> str:
    """Return the page."""
    tables = sections()
    controllers = {name: tables.pop(controller_heading(name)) for name in PROGRAMS}
    common = shared(controllers)
    text = HEAD + EXAMPLE + ten_keys() + AFTER_TEN + "".join(section(title, keys) for title, keys in tables.items())
    text += SHARED
    for names, keys in common.items():
        text += f"\nOf {', '.join(f'`{name}`' for name in names)}:\n\n{table(keys)}"
    elsewhere = {key for keys in common.values() for key in keys}
    own = {name: [key for key in keys if key not in elsewhere] for name, keys in controllers.items()}
    return text + "".join(section(controller_heading(name), keys) for name, keys in own.items())


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
