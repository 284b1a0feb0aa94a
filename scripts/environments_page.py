"""Write docs/environments.md: actions, observations and random values of every environment, from the code."""

from collections.abc import Iterable
from pathlib import Path

import gymnasium

from gantrysim.env.decision import Entry
from gantrysim.env.episodes import SPIRAL
from gantrysim.env.ranges import PRESETS, RandomValue
from gantrysim.env.registry import TASKS

PAGE = Path(__file__).parent.parent / "docs" / "environments.md"

HEAD = """# Tables of the environments

Actions, observations and random values of the [environments](learning.md), with the default settings on the machine
`xy`; `python scripts/environments_page.py` writes this page from the code. A machine with other axes has entries of its
own axes. `env.unwrapped.action_names` and `env.unwrapped.observation_names` list the entries of any environment;
[settings and rewards](api/studies.md#environments) are those of its class.

Values measured are those of the interval since the last decision, and 0 before the first.

On a spiral that is drawn, contour errors are within 2e-5 mm; distances to reversals are those between points along it,
which are at most 0.1 mm apart on the spirals of all tasks.

## Presets of the random values

`preset` names the ranges from which the values of an episode are drawn, `ranges` replaces some of them, by the names
that `info` of a reset has:

```python
import gymnasium as gym
import gantrysim.env  # registers the environments

test = gym.make("gantrysim/BeadWidth-v1", preset="shifted", ranges={"clog": 1.0, "friction_x": (0.5, 2.0)})
```

"""
FOOT = """
The machine is drawn from tolerances, the setting `spread`: the added mass is uniform from 0 to that of `payload`; a
factor with the tolerance t is log-uniform from 1 / (1 + t) to 1 + t, for each axis by itself. The spiral is drawn
uniformly from `diameter`, `thickness`, `speed` and `turns`.
"""


def table(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table in Markdown."""
    lines = [tuple(heads), *map(tuple, rows)]
    lines.insert(1, ("---",) * len(lines[0]))
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def entries(listed: Iterable[Entry]) -> str:
    """Return a table of entries of an action or an observation."""
    rows = (
        (str(k), f"`{entry.name}`", entry.meaning, entry.unit, f"{entry.low:g}", f"{entry.high:g}")
        for k, entry in enumerate(listed)
    )
    return table(("index", "name", "meaning", "unit", "low", "high"), rows)


def in_range(value: RandomValue, preset: str) -> str:
    """Return the range of a random value in a preset."""
    low, high = value.range_of(preset)
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"


def random_values(values: dict[str, RandomValue]) -> str:
    """Return the table of what a task draws."""
    rows = (
        (f"`{name}`", value.meaning, value.unit, *(in_range(value, preset) for preset in PRESETS))
        for name, value in values.items()
    )
    return table(("name", "meaning", "unit", *PRESETS), rows)


def folded(listed: Iterable[Entry]) -> str:
    """Return a table of entries that opens from a line with their names."""
    shown = list(listed)
    names = ", ".join(entry.name for entry in shown)
    return f'<details markdown="1">\n<summary>{len(shown)} entries: {names}</summary>\n\n{entries(shown)}\n</details>\n'


def section(name: str) -> str:
    """Return the section of an environment."""
    env = gymnasium.make(f"gantrysim/{name}").unwrapped
    episodes = env._episodes
    source = episodes.source
    settings = env.settings
    text = f"\n## {name}\n\n### Action\n\n{entries(episodes.actions)}\n### Observation\n\n{folded(episodes.entries)}"
    spiral = ((f"`{key}`", *(f"{bound:g}" for bound in settings.between(key))) for key in SPIRAL)
    text += f"\n### Random values\n\n{table(('spiral', 'lowest', 'highest'), spiral)}"
    tolerances = ", ".join(f"{key} {value:g}" for key, value in vars(settings.spread).items())
    text += f"\nTolerances of the machine in training: {tolerances}.\n"
    return f"{text}\n{random_values(source.values)}" if source.values else text


def page() -> str:
    """Return the page."""
    presets = table(("preset", "what varies"), ((f"`{name}`", meaning) for name, meaning in PRESETS.items()))
    return HEAD + presets + FOOT + "".join(section(name) for name in TASKS)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
