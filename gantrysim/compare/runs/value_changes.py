"""Every value of several runs beside one another."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from gantrysim.base.quantity import NOTHING, Quantity, number_text, numbers_of
from gantrysim.results.quantities import GROUPS, Group
from gantrysim.results.run_results import RunResults

_LEAST_PERCENT = 0.05
LARGE = 0.01  # share of a value from which a change of it is shown in a terminal


@dataclass(frozen=True)
class ValueChange:
    """A value in every run.

    Attributes:
        group: title of its group.
        quantity: the value.
        values: of each run in the quantity's unit; None where a run has none.
    """

    group: str
    quantity: Quantity[Any]
    values: tuple[float | None, ...]

    @property
    def is_large(self) -> bool:
        """Whether a run's value differs from the first one's by `LARGE`, as shown, or only one of them is known."""
        return any(map(self._differs, range(1, len(self.values))))

    def _differs(self, run: int) -> bool:
        change = self.change(run)
        if change is None:
            return self.texts[0] != self.texts[run]
        is_shown = number_text(change, self.quantity.form) != "0"
        return is_shown and abs(change) >= LARGE * abs(self.values[0] or 0.0)

    @property
    def texts(self) -> tuple[str, ...]:
        """The value of each run, without its unit."""
        return tuple(number_text(value, self.quantity.form) for value in self.values)

    def change(self, run: int) -> float | None:
        """Return the value of a run less that of the first one; None where either is unknown."""
        new = self.values[run]
        old = self.values[0]
        return None if new is None or old is None else new - old

    def change_text(self, run: int) -> str:
        """Return the change against the first run, and its share of that one's value."""
        change = self.change(run)
        old = self.values[0]
        if change is None or old is None:
            return NOTHING
        form = self.quantity.form if self.quantity.form.startswith("+") else f"+{self.quantity.form}"
        text = number_text(change, form)
        return with_share(text, change, old)


def with_share(text: str, change: float, value: float) -> str:
    """Return the text of a change with its share of a value, in percent with its sign, where that is not nothing."""
    percent = 100 * change / abs(value) if value else math.nan
    if text == "0" or not abs(percent) >= _LEAST_PERCENT:
        return text
    return f"{text} ({percent:+.1f} %)" if abs(percent) < 10 else f"{text} ({percent:+.0f} %)"


def value_changes(results: Sequence[RunResults]) -> Iterator[ValueChange]:
    """Yield the values of runs, group by group; those that no run has are left out."""
    for group in GROUPS:
        tables = [_numbers(group, of_run) for of_run in results]
        quantities = {key: quantity for table in tables for key, (quantity, _) in table.items()}
        for key, quantity in quantities.items():
            values = tuple(table[key][1] if key in table else None for table in tables)
            if any(value is not None for value in values):
                yield ValueChange(group.title, quantity, values)


def _numbers(group: Group, results: RunResults) -> dict[str, tuple[Quantity[Any], float | None]]:
    subject = group.subject(results)
    if subject is None:
        return {}
    return {
        quantity.key: (quantity, quantity.content(quantity.get(subject))) for quantity in numbers_of(group.of(results))
    }
