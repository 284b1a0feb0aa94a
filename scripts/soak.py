"""Attack every reader of input and every writer of files, and write docs/robustness.md; takes an hour.

python scripts/soak.py [ARGUMENT OF PYTEST ...]

It runs the tests marked soak. Arguments of pytest can select some of them; rows of attacks that did not run, or that an
interrupt cut short, stay unchanged, and so do the hand-written sections below the table.
"""

import signal
import sys
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "robustness.md"
INTRODUCTION = """# Robustness

`scripts/soak.sh` tries to break gantrysim, for about an hour, and writes this table. Every try must end either in a
result or in one line that names the quantity and its bound: without a traceback, a half-written file, a number that is
not finite, or unbounded use of memory. A short form of each attack runs with the tests.

| attack | tries | of these, refused in one line | failed tests |
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
        """Return the page with its new table, given the page before."""
        attacks, heading, sections = before.partition("\n## ")
        rows = {line.split(" | ")[0].removeprefix("| "): line for line in attacks.splitlines() if line.startswith("| ")}
        rows.pop("attack", None)
        for attack, tries in self.tries.items():
            refused = f"{self.refused[attack]:,}" if attack in self.refused else ""
            rows[attack] = f"| {attack} | {tries:,} | {refused} | {self.failed[attack]} |"
        return INTRODUCTION + "".join(f"{rows[attack]}\n" for attack in sorted(rows)) + heading + sections


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it
    tally = Tally()
    status = pytest.main(["-m", "soak", "--rootdir", str(ROOT), *sys.argv[1:]], plugins=[tally])
    before = PAGE.read_text(encoding="utf-8") if PAGE.exists() else ""
    PAGE.write_text(tally.page(before), encoding="utf-8")
    sys.exit(status)
