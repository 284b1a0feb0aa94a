#!/usr/bin/env python3
"""How often identified intervals hold the truth, on random axes with every law of `tests/support/friction_plants.py`.

    python scripts/identification_coverage.py 42

Draws that many axes, the laws in turn, integrates their logs without gantrysim's models, and fits them. All logs are
free of errors. What differs between them is inertia, mode, friction, delay, counts, noise and rate of the log. Viscous
friction is up to 30 % higher in one direction and as much lower in the other, and every other log begins in motion. An
axis of the same number is always the same, so that two versions of the estimator can be compared machine by machine.
"""

import argparse
import sys
from collections import Counter
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))  # the independent simulator lies there

from gantrysim import InputError
from gantrysim.identify.identification import identify

from support.friction_plants import ALL_LAWS
from support.identification_logs import MACHINE, random_log

MODELLED = (
    "coulomb",
    "stribeck",
    "lugre",
    "backlash",
)  # laws that the fitted model holds; another's structure is wrong
HOLDS = ": the structure of the model holds"


class Outcome(NamedTuple):
    """What the identification answered about one axis.

    Attributes:
        seed: of its log.
        law: of its friction.
        error: why its log was refused, "" if it was not.
        holds: whether a note asserts the structure of the model.
        fitted: names of the fitted values that have a truth.
        covered: names of the identified values whose interval holds the truth.
        wrong: descriptions by name of the identified values whose interval does not.
    """

    seed: int
    law: str
    error: str
    holds: bool
    fitted: tuple[str, ...]
    covered: tuple[str, ...]
    wrong: dict[str, str]


def outcome(seed: int) -> Outcome:
    """Return what the identification answers about the axis of this number."""
    law = ALL_LAWS[seed % len(ALL_LAWS)]
    log = random_log(seed, law, slip="", by_direction=True, in_motion=seed % 2 == 0)
    try:
        identification = identify(MACHINE, log.log)
    except InputError as error:
        return Outcome(seed, law, str(error), False, (), (), {})
    fitted = []
    covered = []
    wrong = {}
    for value in identification.values:
        if value.name not in log.truth:
            continue
        fitted.append(value.name)
        if not value.identified:
            continue
        truth = log.truth[value.name]
        if value.low <= truth <= value.high:
            covered.append(value.name)
        else:
            wrong[value.name] = f"{value.value:.4g} [{value.low:.4g}, {value.high:.4g}], true {truth:.4g} {value.unit}"
    holds = any(HOLDS in note for note in identification.notes)
    return Outcome(seed, law, "", holds, tuple(fitted), tuple(covered), wrong)


def tables(outcomes: list[Outcome]) -> str:
    """Return the counts by value and by law as Markdown."""
    fitted = Counter(name for axis in outcomes for name in axis.fitted)
    covered = Counter(name for axis in outcomes for name in axis.covered)
    wrong = Counter(name for axis in outcomes for name in axis.wrong)
    lines = ["| value | fitted | identified | covered | wrong |", "|---|---|---|---|---|"]
    for name in fitted:
        identified = covered[name] + wrong[name]
        lines.append(f"| {name} | {fitted[name]} | {identified} | {covered[name]} | {wrong[name]} |")
    identified = covered.total() + wrong.total()
    lines.append(f"| all | {fitted.total()} | {identified} | {covered.total()} | {wrong.total()} |")
    lines += [
        "",
        "| friction | axes | refused | inertia identified | with a wrong value | structure holds |",
        "|---|---|---|---|---|---|",
    ]
    for law in ALL_LAWS:
        axes = [axis for axis in outcomes if axis.law == law]
        refused = sum(bool(axis.error) for axis in axes)
        inertia = sum("inertia" in (*axis.covered, *axis.wrong) for axis in axes)
        with_wrong = sum(bool(axis.wrong) for axis in axes)
        holds = sum(axis.holds for axis in axes)
        text = f"{holds}" if law in MODELLED else f"{holds} (another law)"
        lines.append(f"| {law} | {len(axes)} | {refused} | {inertia} | {with_wrong} | {text} |")
    return "\n".join(lines)


def main() -> None:
    """Fit the axes one by one and print the counts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("axes", type=int, nargs="?", default=42, help="number of axes (default: 42)")
    parser.add_argument("--first", type=int, default=1000, help="number of the first axis (default: 1000)")
    arguments = parser.parse_args()
    if arguments.axes < 1 or arguments.first < 0:
        parser.error(f"{arguments.axes} axes from {arguments.first}: at least 1 axis, from 0 or a later one")
    outcomes = []
    for seed in range(arguments.first, arguments.first + arguments.axes):
        axis = outcome(seed)
        outcomes.append(axis)
        words = axis.error or f"{len(axis.covered)} covered, {len(axis.wrong)} wrong"
        print(f"{axis.seed} {axis.law}: {words}", file=sys.stderr, flush=True)
        for name, description in axis.wrong.items():
            print(f"    {name} {description}", file=sys.stderr, flush=True)
    print(tables(outcomes))


if __name__ == "__main__":
    main()
