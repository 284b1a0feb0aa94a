"""Attack every reader of input and every writer of files, and write their table in docs/validation.md; takes two hours.

python scripts/soak.py [ARGUMENT OF PYTEST ...]

It runs the tests marked soak, and all examples of those with hypothesis. Arguments of pytest can select some of them;
rows of attacks that did not run, or that an interrupt cut short, stay unchanged, and so do the hand-written sections
below the table.
"""

import os
import re
import signal
import sys
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "validation.md"
PLACE = re.compile(r"(<!-- written by scripts/soak.py -->\n).*?(<!-- end -->)", re.DOTALL)
HEADS = """| attack | tries | of these, refused in one line | failed tests |
|---|---:|---:|---:|
"""


class Tally:
    """Plugin of pytest that counts tries, refusals and failures of each attack.

    Attributes:
        tries: number of tries by attack.
        refused: number of inputs refused, by attack, for tests that report it.
        failed: number of failed tests by attack.
    """

    def __init__(self) -> None:
        self.tries, self.refused, self.failed = Counter[str](), Counter[str](), Counter[str]()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        properties = dict(report.user_properties)
        attack = str(properties.get("attack", ""))
        if report.when == "call" and attack:
            self.tries[attack] += int(str(properties.get("tries", 0)))
            if "refused" in properties:
                self.refused[attack] += int(str(properties["refused"]))
            self.failed[attack] += report.failed

    def page(self, before: str) -> str:
        """Return the page with its table written anew; attacks that were not tried keep their rows."""
        return PLACE.sub(lambda place: f"{place[1]}\n{self._table(place[0])}\n{place[2]}", before)

    def _table(self, before: str) -> str:
        rows = {line.split(" | ")[0].removeprefix("| "): line for line in before.splitlines() if line.startswith("| ")}
        rows.pop("attack", None)
        for attack, tries in self.tries.items():
            refused = f"{self.refused[attack]:,}" if attack in self.refused else ""
            rows[attack] = f"| {attack} | {tries:,} | {refused} | {self.failed[attack]} |"
        return HEADS + "".join(f"{rows[attack]}\n" for attack in sorted(rows))


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it
    tally = Tally()
    # the test suite tries a part of them
    os.environ["GANTRYSIM_EXAMPLES"] = "whole"
    status = pytest.main(["-m", "soak or hypothesis", "--rootdir", str(ROOT), *sys.argv[1:]], plugins=[tally])
    PAGE.write_text(tally.page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    sys.exit(status)
