"""What a machine study has found, in words."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING

import numpy as np

from gantrysim.arrays import Floats
from gantrysim.machine.tolerances import in_words
from gantrysim.study.cases import OK, Row
from gantrysim.study.machine.yields import influences, yield_of

if TYPE_CHECKING:
    from gantrysim.study.machine.study import MachineStudy

_NAMED = 2  # factors that are spoken of after the first


def findings(study: MachineStudy, rows: list[Row]) -> list[str]:
    """Return the yield, what matters most, and what was varied."""
    nominal, others, figure = study.drawn(rows)
    good = [row for row in rows if row["status"] == OK]
    if not good:
        return [f"None of the {len(rows)} machines gives a run with figures: {rows[0]['status']}", _varied(study)]
    criterion, unit = study.criterion, study.criterion.unit(good[0])
    found = yield_of(int(np.sum(figure <= criterion.tolerance)), figure.size)
    faults = int(np.sum(~np.isfinite(figure)))
    nominal_text = (
        f"{criterion.value(nominal):.4g} {unit}" if nominal["status"] == OK else f"no figures ({nominal['status']})"
    )
    low, median, high = np.percentile(figure, [5, 50, 95], method="inverted_cdf")
    worst = int(figure.argmax())
    text = (
        f"{found.within} of {found.count} machines keep to a {criterion.label} of {criterion.tolerance:g} {unit}: "
        f"a yield of {100 * found.share:.1f} %, with 95 % confidence {100 * found.low:.1f} to "
        f"{100 * found.high:.1f} %. The nominal machine has {nominal_text}, the median machine "
        f"{_told(median, unit)}, nine of ten lie between {_told(low, unit)} and {_told(high, unit)}, and the "
        f"worst, machine {worst + 1}, has {_told(figure[worst], unit)}."
    )
    if faults:
        reason = next(row["status"] for row in others if row["status"] != OK)
        text += f" {faults} of them did not finish, as machine {_number(others, reason)}: {reason}."
    return [text, _what_matters(study, figure), _varied(study)]


def _what_matters(study: MachineStudy, figure: Floats) -> str:
    found, explained = influences(study.machines, figure)
    clear = [influence for influence in found if influence.clear]
    if not clear:
        return "No factor by itself goes together with the figure more closely than chance would have it."
    first = clear[0]
    values = study.machines[first.factor]
    more = values > np.median(values)
    within = figure <= study.tolerance
    text = f"What matters most is {in_words(first.factor)} (rank coefficient {first.coefficient:+.2f})"
    if within.any() and not within.all():  # else there are not two kinds of machines to be told apart
        text += (
            f": of the machines with more of it {100 * within[more].mean():.0f} % are within the tolerance, of those "
            f"with less {100 * within[~more].mean():.0f} %"
        )
    text += "."
    if others := clear[1 : 1 + _NAMED]:
        several = _listed([f"{in_words(other.factor)} ({other.coefficient:+.2f})" for other in others])
        text += f" Then {'come' if len(others) > 1 else 'comes'} {several}."
    if unclear := [in_words(influence.factor) for influence in found if not influence.clear]:
        text += f" No influence can be told from chance of {_listed(unclear)}."
    return f"{text} Together the factors explain {100 * explained:.0f} % of the variance of the ranks."


def _varied(study: MachineStudy) -> str:
    parts = []
    for name, spread in asdict(study.spread).items():
        if not spread:
            continue
        if name == "payload":
            parts.append(f"the payload by 0 to {spread:g} kg")
        else:
            parts.append(f"{in_words(name)} by factors of {1 / (1 + spread):.3g} to {1 + spread:.3g}")
    return (
        f"Varied are {_listed(parts)}, of each axis by itself, drawn from a Latin hypercube with the seed "
        f"{study.seed}. The servo keeps the gains that fit the nominal machine."
    )


def _number(others: list[Row], status: object) -> object:
    return next(row["sample"] for row in others if row["status"] == status)


def _told(value: float, unit: str) -> str:
    return f"{value:.4g} {unit}".rstrip() if math.isfinite(value) else "no figures at all"


def _listed(parts: list[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
