#!/usr/bin/env python3
"""What `gantrysim identify` answers to logs with every error of `tests/support/spoiled_logs.py`, and to healthy ones.

    python scripts/spoiled_logs.py 7

Draws that many axes, the laws of friction in turn, integrates their logs without gantrysim's models, spoils each by
every error, and identifies. Prints per error how many end in "not identified", how many in a value whose interval does
not hold the truth, and the sentence of the first axis.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))  # the independent simulator lies there

from gantrysim.identify.checks.finding import NotIdentifiedError
from gantrysim.identify.identification import identify

from support.friction_plants import LAWS
from support.identification_logs import MACHINE, confidently_wrong, random_log
from support.spoiled_logs import SPOILS

PERIOD = 1e-3
NOISE = 2e-3  # of the torque [N·m]


def answer(log, truth):
    """Return the sentence that ends a log in "not identified", "" for none, and the names of wrong values."""
    try:
        identification = identify(MACHINE, log)
    except NotIdentifiedError as error:
        return str(error), []
    sentences = identification.unidentified
    return (sentences[0] if sentences else ""), list(confidently_wrong(identification, truth))


def row(name, logs):
    """Return the line of the table for logs, pairs of log and truth."""
    answers = [answer(log, truth) for log, truth in logs]
    refused = sum(bool(sentence) for sentence, _ in answers)
    wrong = sum(bool(values) for _, values in answers)
    return f"| {name} | {refused} of {len(answers)} | {wrong} | {answers[0][0].replace('|', '/')} |"


def main() -> None:
    """Spoil the logs error by error and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("axes", type=int, nargs="?", default=7, help="number of axes (default: 7)")
    parser.add_argument("--first", type=int, default=0, help="number of the first axis (default: 0)")
    arguments = parser.parse_args()
    if arguments.axes < 1 or arguments.first < 0:
        parser.error(f"{arguments.axes} axes from {arguments.first}: at least 1 axis, from 0 or a later one")
    seeds = range(arguments.first, arguments.first + arguments.axes)
    healthy = [random_log(seed, LAWS[seed % len(LAWS)], slip="", period=PERIOD, noise=NOISE) for seed in seeds]
    print("| error | not identified | wrong values | sentence |\n|---|---|---|---|")
    print(row("none", [(made.log, made.truth) for made in healthy]), flush=True)
    for name, spoil in SPOILS.items():
        logs = [
            (spoil(made.log, np.random.default_rng(seed), seed), made.truth)
            for seed, made in zip(seeds, healthy, strict=True)
        ]
        print(row(name, logs), flush=True)


if __name__ == "__main__":
    main()
