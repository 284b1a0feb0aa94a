"""Write the tables of docs/values.md: every value of a run that people see, every column of a record, from the code."""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from gantrysim.base.quantity import AXIS, Quantity
from gantrysim.metrics.parts import PART_COLUMNS, PART_PLACE
from gantrysim.record.named_columns import SIGNALS
from gantrysim.results.quantities import GROUPS
from gantrysim.results.verdict_quantities import VERDICT_VALUES

PAGE = Path(__file__).parent.parent / "docs" / "values.md"

PLACE = re.compile(r"(<!-- written by scripts/values_page.py -->\n).*?(<!-- end -->)", re.DOTALL)

HEADS = ("value", "keys", "unit", "meaning", "Python")

TERMS = """## Terms

| term | meaning |
| --- | --- |
| requested | of the program's exact path, speed or glue |
| commanded | what the controller sends to the drives, a position per servo tick |
| contour error | distance of the nozzle from the requested path |
| program, servo, encoder, geometry, structure | links: parts of the contour error between two points of the chain |
| following error | commanded minus encoder position, of an axis or along the path |
| lag | distance of the nozzle behind its command along the path; not part of the contour error |
| nominal bead | bead with the requested cross-section |
| missing at start, excess at stop | glue missing or in excess there, as a length of nominal bead |
| clearance of turns | distance between the edges of neighbouring turns: a gap, or an overlap if negative |
| rms, 95 %, max | root mean square, 95th percentile and maximum of the magnitude while the dispenser is on |
| mean, std, min, max | over the ticks with the dispenser on, along the bead, or over its starts and stops |
| share | part of the mean square contour error; links add up to 100 %, a negative share offsets others |
"""


def table(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table in Markdown."""
    lines = [tuple(heads), *map(tuple, rows)]
    lines.insert(1, ("---",) * len(lines[0]))
    return "".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in line)} |\n" for line in lines)


def folded(listed: Iterable[str], text: str) -> str:
    """Return a table that opens from a line with the names in it."""
    return f'<details markdown="1">\n<summary>{", ".join(listed)}</summary>\n\n{text}\n</details>\n'


def of_x(quantity: Quantity[Any]) -> Quantity[Any]:
    """Return the quantity of the axis x where it is a template."""
    return quantity.of_axis("x") if AXIS in quantity.name else quantity


def keys(quantity: Quantity[Any]) -> str:
    """Return the keys of a quantity, one for each statistic."""
    return ", ".join(f"`{number.key}`" for number in quantity.numbers)


def units(quantity: Quantity[Any]) -> str:
    """Return the unit of a quantity, and that of its share where it has one."""
    return ", ".join(dict.fromkeys(number.unit or "1" for number in quantity.numbers))


def rows(quantities: Iterable[Quantity[Any]], subject: str) -> Iterator[tuple[str, ...]]:
    """Yield a row per quantity."""
    for quantity in map(of_x, quantities):
        yield quantity.label, keys(quantity), units(quantity), quantity.meaning, f"`{quantity.code(subject)}`"


def tables() -> str:
    """Return terms and tables."""
    text = TERMS
    for group in GROUPS:
        names = (quantity.label for quantity in map(of_x, group.quantities))
        listed = table(HEADS, rows(group.quantities, group.code))
        text += f"\n## {group.title}: `{group.name}`\n\n{folded(names, listed)}"
    text += (
        "\nThe cost of faults stands in `summary.json` under `injected`; `losses` is\n"
        "`gantrysim.job.losses.Losses.of(bead, healthy)` of the beads with and without the faults.\n"
    )
    columns = table(
        ("column", "key", "unit", "meaning"),
        ((of.label, f"`{of.key}`", of.unit, of.meaning) for of in (*PART_COLUMNS, *PART_PLACE)),
    )
    text += (
        "\n## Error budget: `error_budget`\n\n"
        "Rows are the links, `corner` where there is one, and `contour`; `run.budget.to_frame()` has the first four\n"
        f"columns. The places are those of the maximum, `at_max` in `summary.json`.\n\n{columns}"
    )
    further = table(
        ("value", "unit", "meaning"),
        ((of.label, of.unit or "1", of.meaning) for of in VERDICT_VALUES),
    )
    text += f"\n## Further values of the verdict: `verdict`\n\n{further}"
    signals = table(
        ("signal", "column", "unit", "meaning"),
        ((of.label, f"`{of.key}`", of.unit, of.meaning) for of in map(of_x, SIGNALS)),
    )
    return text + (
        "\n## Columns of a record: `run.to_frame()`, `gantrysim export`\n\n"
        "A row per servo tick. Positions of a rotary axis are in deg; points have the columns x, y and z.\n\n" + signals
    )


def page() -> str:
    """Return the page with its tables written anew."""
    return PLACE.sub(lambda place: place[1] + tables() + place[2], PAGE.read_text(encoding="utf-8"))


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
