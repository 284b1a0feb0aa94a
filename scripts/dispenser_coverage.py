#!/usr/bin/env python3
"""How often identified intervals hold the truth, on dispensers of every kind with three glues.

    python scripts/dispenser_coverage.py 5

Makes that many sets of measurements for each of four kinds of dispenser and three glues, with noise and without
gantrysim's models, and identifies each.
"""

import argparse
import sys
import tempfile
from collections import Counter
from itertools import product
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))  # the independent generator lies there

from gantrysim import InputError
from gantrysim.identify.dispenser.identification import identify_dispenser
from gantrysim.identify.dispenser.measurements import read_measurements

from support.dispensers import FLUIDS, KINDS, dispenser_data


def judged(kind: str, fluid: str, seed: int, folder: Path) -> tuple[list[str], list[str], list[str]]:
    """Return the names of the fitted values that have a truth, of those identified, and of those that miss it."""
    data = dispenser_data(kind, fluid, seed)
    file = folder / "data.csv"
    file.write_text(data.text, encoding="utf-8")
    try:
        values = identify_dispenser(read_measurements([file])).values
    except InputError as error:
        print(f"{kind}, {fluid}, {seed}: {error}", file=sys.stderr)
        return list(data.truth), [], []
    known = [value for value in values if value.name in data.truth]
    identified = [value for value in known if value.identified]
    wrong = [value for value in identified if not value.low <= data.truth[value.name] <= value.high]
    for value in wrong:
        words = f"{value.name} = {value.value:.5g}, {value.low:.5g} to {value.high:.5g}"
        print(f"{kind}, {fluid}, {seed}: {words}, true {data.truth[value.name]:.5g}", file=sys.stderr, flush=True)
    return [[value.name for value in group] for group in (known, identified, wrong)]


def main() -> None:
    """Identify the sets one by one and print the counts by value."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sets", type=int, nargs="?", default=5, help="sets for each kind and glue (default: 5)")
    parser.add_argument("--first", type=int, default=0, help="number of the first set (default: 0)")
    arguments = parser.parse_args()
    counts = Counter(), Counter(), Counter()
    with tempfile.TemporaryDirectory() as folder:
        numbers = range(arguments.first, arguments.first + arguments.sets)
        for kind, fluid, seed in product(KINDS, FLUIDS, numbers):
            for counter, names in zip(counts, judged(kind, fluid, seed, Path(folder)), strict=True):
                counter.update(names)
    fitted, identified, wrong = counts
    print("| value | fitted | identified | interval contains the true value |\n|---|---|---|---|")
    for name in fitted:
        print(f"| {name} | {fitted[name]} | {identified[name]} | {identified[name] - wrong[name]} |")
    total = identified.total()
    print(f"| all | {fitted.total()} | {total} | {total - wrong.total()}, {100 - 100 * wrong.total() / total:.1f} % |")


if __name__ == "__main__":
    main()
