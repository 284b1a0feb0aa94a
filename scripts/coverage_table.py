"""Write how much of each room the tests run into docs/validation.md: python scripts/coverage_table.py COVERAGE.json.

Functions that numba compiles are left out, as nothing counts their lines; what they compute is compared by the tables
above. A room whose statements and branches the tests run by less than the bound ends the command with status 1.
"""

import json
import re
import sys
from collections import defaultdict
from pathlib import Path

PAGE = Path(__file__).parent.parent / "docs" / "validation.md"
PLACE = re.compile(r"(<!-- written by scripts/coverage_table.py -->\n).*?(<!-- end of coverage -->)", re.DOTALL)
BOUND = 0.9  # of the statements and branches of every room
COUNTS = ("num_statements", "covered_lines", "num_branches", "covered_branches")


def rooms(content: dict) -> dict[str, dict[str, int]]:
    """Return the counts of coverage's JSON by room of the package; files outside a room count as "gantrysim"."""
    found: dict[str, dict[str, int]] = defaultdict(lambda: dict.fromkeys(COUNTS, 0))
    for file, measured in content["files"].items():
        parts = Path(file).parts
        inside = parts[parts.index("gantrysim") + 1 :]
        room = inside[0] if len(inside) > 1 else "gantrysim"
        for count in COUNTS:
            found[room][count] += measured["summary"][count]
    return dict(sorted(found.items()))


def share(counts: dict[str, int]) -> float:
    """Return the share of statements and branches that the tests have run."""
    whole = counts["num_statements"] + counts["num_branches"]
    return (counts["covered_lines"] + counts["covered_branches"]) / whole if whole else 1.0


def table(found: dict[str, dict[str, int]]) -> str:
    """Return the rows of the page."""
    rows = "".join(
        f"| `{room}` | {counts['num_statements']:,} | {counts['num_branches']:,} | {100 * share(counts):.1f} % |\n"
        for room, counts in found.items()
        if counts["num_statements"]
    )
    return f"\n| room | statements | branches | run by the tests |\n|---|---:|---:|---:|\n{rows}\n"


def main() -> int:
    """Write the table; return the exit status."""
    found = rooms(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")))
    page = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(PLACE.sub(lambda place: place[1] + table(found) + place[2], page), encoding="utf-8")
    low = {room: share(counts) for room, counts in found.items() if share(counts) < BOUND}
    for room, measured in low.items():
        print(
            f"{room}: {100 * measured:.1f} % of statements and branches are run: must be at least {100 * BOUND:.0f} %"
        )
    return 1 if low else 0


if __name__ == "__main__":
    sys.exit(main())
