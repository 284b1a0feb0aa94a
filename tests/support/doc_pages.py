"""The pages of README and docs: their blocks of code, and whether a program prints what a page shows."""

import json
import re
import textwrap
from pathlib import Path
from typing import NamedTuple

import pytest

from support.soaked import WHOLE

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
FENCED = re.compile(r'^ *```(\w*)(?: title="([^"]+)")?\n(.*?)^ *```$', flags=re.DOTALL | re.MULTILINE)
LEFT_OUT = "…"  # stands on a page for what it does not show
_HEADING = re.compile(r"^## ", flags=re.MULTILINE)
BOX = re.compile(r"[│┃─━┏┓┗┛┡┩└┘├┤┬┴┼╇┳╋╀┴┻╭╮╰╯]+")  # lines that tables are drawn with
NUMBER = re.compile(r"\d[\d,]*\.?\d*(?:e-?\d+)?")

# Encoder counts and friction make a micrometre of the last bit of a setpoint, so other processors' sines show.
SHOWN = 0.02  # relative
SHOWN_LEAST = 0.5  # [µm]


def read_pages():
    """Return the texts of README and docs by their path in docs."""
    pages = {page.relative_to(DOCS).as_posix(): page.read_text(encoding="utf-8") for page in sorted(DOCS.rglob("*.md"))}
    return {"README.md": (ROOT / "README.md").read_text(encoding="utf-8"), **pages}


def section_of(name, heading):
    """Return the text of a section of a page in docs, below its heading and up to the next of that level."""
    _, head, text = (DOCS / name).read_text(encoding="utf-8").partition(f"\n## {heading}\n")
    assert head, (name, heading)
    return _HEADING.split(text, maxsplit=1)[0]


# sections that show a task with commands to follow
TASKS = {
    heading: section_of(name, heading)
    for name, heading in (
        ("values.md", "Read the verdict"),
        ("improve.md", "Find what to change"),
        ("studies.md", "Find the fastest speed"),
        ("studies.md", "Run a sweep on a cluster"),
        ("tuning.md", "Tune the servo"),
        ("laws.md", "Compensate friction"),
        ("laws.md", "Write a law"),
        ("dispensers.md", "Shape the flow"),
        ("exchange.md", "Gains in your controller's units"),
        ("learning.md", "Train an agent"),
        ("controllers.md", "Write a controller"),
    )
}


class Block(NamedTuple):
    """A fenced block of a page."""

    language: str
    title: str  # name of the file that it is, or ""
    text: str
    output: str  # what it prints, as far as blocks of text below show it, with an ellipsis between them


def blocks_of(page):
    """Return the fenced blocks of a page in their order; blocks of text are the output of the block before them."""
    found = []
    for language, title, text in FENCED.findall(page):
        if language == "text" and found:
            output = "".join([found[-1].output, LEFT_OUT, "\n", text])
            found[-1] = found[-1]._replace(output=output)
        else:
            found.append(Block(language, title, textwrap.dedent(text), ""))
    return found


def blocks(page, language):
    """Return the texts of a page's blocks in a language."""
    return [textwrap.dedent(place[3]) for place in FENCED.finditer(page) if place[1] == language]


class Printed(NamedTuple):
    """What a step of a page printed on its standard output and its standard error."""

    output: str
    error: str


def run_in_turn(fresh, folder, steps):
    """Run a page's steps one after another in one fresh process, as whoever follows the page does in one session.

    Figures are blank but in the soak, see `support.blank_pictures`.

    Args:
        fresh: fresh processes, see `support.fresh`.
        folder: where they run.
        steps: each a tuple: "page" and the name of a page that begins, with names of its own; "python" and code, which
            sees the names of the code before it; "command" and the words of `gantrysim`; "script" and a file with its
            arguments; "file", a name and the text that it is given.

    Returns:
        What each step printed.
    """
    done = fresh.run(_IN_TURN, folder, json.dumps(steps))
    assert done.status == 0, done.error + done.output
    outputs, errors = (text.split(_MARK)[1:] for text in (done.output, done.error))
    assert len(outputs) == len(errors) == len(steps)
    return [Printed(*printed) for printed in zip(outputs, errors, strict=True)]


_MARK = "=== step of a page ===\n"
# width of the terminal whose lines are shown [columns]
_WIDTH = 100
# exit status of --fail-on
_FAILED = 4
_IN_TURN = f"""
import json
import os
import sys
from pathlib import Path

os.environ["COLUMNS"] = "{_WIDTH}"
if {not WHOLE}:
    import matplotlib.figure

    sys.path.append({str(ROOT / "tests")!r})
    from support.blank_pictures import save_blank
    sys.path.pop()

    matplotlib.figure.Figure.savefig = save_blank
names, page = {{"__name__": "__main__"}}, "example"
for kind, *what in json.loads(sys.argv[1]):
    for stream in (sys.stdout, sys.stderr):
        stream.write({_MARK!r})
        stream.flush()
    if kind == "page":
        names, page = {{"__name__": "__main__"}}, what[0]
    elif kind == "file":
        Path(what[0]).write_text(what[1], encoding="utf-8")
    elif kind == "python":
        exec(compile(what[0], page, "exec"), names)
        assert names["run"].fault is None if "run" in names else True
    else:
        sys.argv[1:] = what[kind == "script" :]
        try:
            if kind == "script":
                exec(compile(Path(what[0]).read_text(encoding="utf-8"), what[0], "exec"), {{"__name__": "__main__"}})
            else:
                from gantrysim.cli.start import main

                main()
        except SystemExit as stop:
            assert stop.code in (None, 0, {_FAILED}), (kind, what, stop.code)
"""


def assert_printed(shown, printed):
    """Assert that a program has printed what a page shows: stretches of words in their order, with equal numbers.

    Lines may be wrapped elsewhere; an ellipsis on the page stands for anything.
    """
    tokens = _words(printed)
    place = 0
    for stretch in shown.split(LEFT_OUT):
        expected = _words(stretch)
        starts = range(place, len(tokens) - len(expected) + 1)
        begin = next((start for start in starts if _agree(expected, tokens[start : start + len(expected)])), None)
        assert begin is not None, f"not printed: {' '.join(expected)}\n\nprinted: {printed}"
        place = begin + len(expected)


def _words(text):
    words = (word.rstrip(":") for word in BOX.sub(" ", text).split())  # a page may leave out what follows a colon
    return [word for word in words if word]


def _agree(expected, printed):
    return all(_same(word, other) for word, other in zip(expected, printed, strict=True))


def _same(shown, printed):
    if NUMBER.sub("\0", shown) != NUMBER.sub("\0", printed):
        return False
    numbers = zip(NUMBER.findall(shown), NUMBER.findall(printed), strict=True)
    return all(
        _value(other) == pytest.approx(_value(number), rel=SHOWN, abs=_step(number)) for number, other in numbers
    )


def _value(number):
    return float(number.replace(",", ""))


def _step(number):
    """Return what a number may differ by: half a micrometre, where tenths of one are shown, else its last digit."""
    digits, _, exponent = number.partition("e")
    places = len(digits.partition(".")[2])
    return SHOWN_LEAST if places == 1 and not exponent else 10.0 ** (int(exponent or 0) - places)
