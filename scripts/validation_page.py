"""Write the tables of docs/validation.md from the tests: what they are marked to compare, with what, and how closely.

A test says so by `@pytest.mark.validates(WHAT, AGAINST, TOLERANCE)`. Every number of the tolerance must stand in the
test's module, in the unit of the page or of the code, so that the page cannot promise what no test holds.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parent.parent
TESTS = ROOT / "tests"
PAGE = ROOT / "docs" / "validation.md"
PLACE = re.compile(r"(<!-- written by scripts/validation_page.py -->\n).*?(<!-- end -->)", re.DOTALL)
SUBJECTS = {
    "Programs and paths": ("controllers", "paths"),
    "Machine": ("machine",),
    "Servo, drives and stability": ("servo", "engine"),
    "Whole jobs": ("reference", "job"),
    "Error budget and tests of accuracy": ("metrics", "study"),
    "Glue and bead": ("glue", "render"),
    "Real machines": ("exchange", "compare", "identify"),
}
NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?:e-?\d+)?")
# between the units of a page and those of the code: %, µm and the like, and shares of 1
FACTORS = (1.0, 1e-2, 1e-3, 1e-6, 1e3)
SAME = 1e-9  # relative


class Comparison(NamedTuple):
    """What a test compares."""

    what: str
    against: str
    tolerance: str
    file: Path

    @property
    def row(self) -> str:
        cells = (self.what, self.against, self.tolerance, f"`{self.file.relative_to(ROOT).as_posix()}`")
        return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |\n"


def marked(file: Path) -> Iterator[Comparison]:
    """Yield the comparisons of a module in their order.

    Raises:
        ValueError: a number of a tolerance stands nowhere in the module.
    """
    text = file.read_text(encoding="utf-8")
    # to parse all tests takes seconds
    if ".validates(" not in text:
        return
    tree = ast.parse(text)
    calls = [
        decorator
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef)
        for decorator in node.decorator_list
        if isinstance(decorator, ast.Call) and ast.unparse(decorator.func) == "pytest.mark.validates"
    ]
    constants = [
        float(node.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool)
    ]
    for call in sorted(calls, key=lambda call: call.lineno):
        what, against, tolerance = (ast.literal_eval(argument) for argument in call.args)
        missing = [text for text in NUMBER.findall(tolerance) if not _stands(float(text), constants)]
        if missing:
            raise ValueError(f"{file.relative_to(ROOT)}: {what!r}: no {', '.join(missing)} in the module")
        yield Comparison(what, against, tolerance, file)


def _stands(number: float, constants: list[float]) -> bool:
    return any(abs(number * factor - value) <= SAME * abs(value) for factor in FACTORS for value in constants)


def tables() -> str:
    """Return the tables of all subjects."""
    text = ""
    for subject, rooms in SUBJECTS.items():
        files = [file for room in rooms for file in sorted((TESTS / room).rglob("test_*.py"))]
        rows = [comparison.row for file in files for comparison in marked(file)]
        text += (
            f'\n## {subject}\n\n<details markdown="1">\n<summary>{len(rows)} comparisons</summary>\n\n'
            f"| what | against | tolerance | test |\n|---|---|---|---|\n{''.join(rows)}\n</details>\n"
        )
    return text + "\n"


def page() -> str:
    """Return the page with its tables written anew."""
    return PLACE.sub(lambda place: place[1] + tables() + place[2], PAGE.read_text(encoding="utf-8"))


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
