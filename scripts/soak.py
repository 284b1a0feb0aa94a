"""Attacks what reads a user's input and what writes a user's files, and writes docs/robustness.md; takes an hour.

python scripts/soak.py [ARGUMENT OF PYTEST ...]

It runs the tests marked soak. With arguments, which may leave some out, the rows of the others stay as they are; so do
those of attacks that an interrupt cuts short. The sections below the table, which people write, stay too.
"""

import signal
import sys
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "robustness.md"
INTRODUCTION = """# Robustness

What was tried to break gantrysim, by `scripts/soak.sh`, which writes this page. Every try must end well: in a result,
or in one line that names the quantity and its bound; no traceback, no file half-written, no number that is not finite,
memory bounded. A short form of each runs with the tests.

| attack | tries | of these refused in one line | tests that failed |
|---|---:|---:|---:|
"""


class Tally:
    """What the tests say of their attacks, a plugin of pytest.

    Attributes:
        tries: number of tries by attack.
        refused: of these, the inputs that were refused, where the test tells.
        failed: failed tests by attack.
    """

    def __init__(self) -> None:
        self.tries, self.refused, self.failed = Counter[str](), Counter[str](), Counter[str]()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        told = dict(report.user_properties)
        attack = str(told.get("attack", ""))
        if report.when == "call" and attack:
            self.tries[attack] += int(str(told.get("tries", 0)))
            if "refused" in told:
                self.refused[attack] += int(str(told["refused"]))
            self.failed[attack] += report.failed

    def page(self, before: str) -> str:
        """Return the page with the table, given the page as it was."""
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
