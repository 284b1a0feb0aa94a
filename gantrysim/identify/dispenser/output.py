"""Table and file of a dispenser's identification, as `gantrysim identify dispenser` shows and writes them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import tomli_w
from rich.table import Table

from gantrysim.base.errors import InputError, expanded_path
from gantrysim.base.files import replaced_file
from gantrysim.identify.dispenser.advice import Advice
from gantrysim.identify.dispenser.identification import DispenserIdentification, DispenserValue

_HEAD = "# Identified by gantrysim identify dispenser: paste these tables into a job.\n"
_DIGITS = 5  # of a value that is written


def values_table(identification: DispenserIdentification) -> Table:
    """Return the values with their intervals."""
    caption = (
        "95 % confidence; not identified (interval): half of it exceeds 15 % of the value, 25 % of a yield stress, "
        "40 % of a slip; (includes zero): the interval does, the value is left as fitted or at zero; correlated values "
        "are written together if one of them is identified"
    )
    table = Table(title="identified", title_justify="left", caption=caption, caption_justify="left")
    table.add_column("quantity")
    for column in ("value", "from", "to"):
        table.add_column(column, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    table.add_column("")
    for value in identification.values:
        numbers = (f"{number:.4g}" for number in (value.value, value.low, value.high))
        table.add_row(value.label, *numbers, value.unit, _state(value))
    return table


def _state(value: DispenserValue) -> str:
    return "identified" if value.identified else f"not identified ({value.reason})"


def advice_words(advice: Advice, identification: DispenserIdentification) -> str:
    """Return what to measure next, in a sentence."""
    first, second = advice.words
    what = f"{first}, twice" if first == second else f"{first}; and {second}"
    label = identification[advice.name].label
    return (
        f"measure next: {what}. Of all pairs tried these narrow the intervals most: that of {label} to "
        f"{100 * max(advice.share, 0.01):.0f} % of its width"
    )


def tables_text(identification: DispenserIdentification) -> str:
    """Return the tables [dispenser] and [bead] of a job in TOML, with every value's interval in a comment."""
    lines = []
    for value in identification.values:
        unit = f" {value.unit}" if value.unit else ""
        state = "" if value.identified else f"; {_state(value)}"
        lines.append(f"# {value.name} = {value.value:.5g}{unit}, 95 %: {value.low:.4g} to {value.high:.4g}{state}\n")
    return _HEAD + "".join(lines) + "\n" + tomli_w.dumps(_rounded_numbers(identification.tables))


def _rounded_numbers(content: Any) -> Any:
    if isinstance(content, dict):
        return {name: _rounded_numbers(value) for name, value in content.items()}
    return float(f"{content:.{_DIGITS}g}") if isinstance(content, float) else content


def write_tables(identification: DispenserIdentification, file: Path) -> None:
    """Write the tables to a file that the command has written before, or that is new.

    Raises:
        InputError: the file holds something else, or cannot be written.
    """
    target = expanded_path(file)
    if target.exists() and not _is_own(target):
        raise InputError(f"--out {file}: holds something else than an identified dispenser: name another file")
    with replaced_file(target) as partial:
        partial.write_text(tables_text(identification), encoding="utf-8")


def _is_own(file: Path) -> bool:
    return file.is_file() and file.read_bytes().startswith(_HEAD.encode("utf-8"))
