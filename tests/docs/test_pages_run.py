"""Pages of start, and sections with a task: their commands and code run in one folder and print what is shown."""

import re
import shlex
import shutil

import pytest

from support.doc_pages import ROOT, TASKS, assert_printed, blocks_of, read_pages, run_in_turn

NOTEBOOK = "start/notebook.md"  # which another test runs as a whole
START = {name: page for name, page in read_pages().items() if name.startswith("start/") and name != NOTEBOOK}
TEXTS = START | TASKS
# those whose commands search, train or build for minutes, and what takes more than five seconds
LONG = (
    "Compensate friction",
    "Find the fastest speed",
    "Find what to change",
    "Read the verdict",
    "Run a sweep on a cluster",
    "Shape the flow",
    "Train an agent",
    "Tune the servo",
    "Write a law",
    "start/own-trace.md",
)
SHORTER = ("--no-video", "--no-report")  # film and report take most of the time of a run
ADDRESS = "tcp://"  # of computers that the test has not


def commands(text):
    """The commands of a block that a test can run: their words, without the remark behind them."""
    lines = [shlex.split(line, comments=True) for line in text.replace("\\\n", " ").splitlines()]
    runnable = [
        words for words in lines if words[:1] == ["gantrysim"] or (words[1:] and words[1].startswith("examples/"))
    ]
    return [words for words in runnable if not any(ADDRESS in word for word in words)]


def step_of(words):
    """The step that runs a command, or an example, see `support.doc_pages`."""
    program, *arguments = words
    if arguments[0] == "run":
        arguments = [*arguments, *(option for option in SHORTER if option not in arguments)]
    return ("command" if program == "gantrysim" else "script", *arguments)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.soak) if name in LONG else name for name in TEXTS]
)
def test_a_page_s_code_prints_what_it_shows(name, fresh, tmp_path):
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    page = TEXTS[name]
    # what a page shows, and its steps
    shown = []
    for block in blocks_of(page):
        if block.title:
            shown.append((block, [("file", block.title, block.text)]))
        elif block.language == "python":
            shown.append((block, [("python", block.text)]))
        else:
            shown.append((block, [step_of(words) for words in commands(block.text)]))
    printed = iter(run_in_turn(fresh, tmp_path, [step for _, steps in shown for step in steps]))
    for block, steps in shown:
        done = [next(printed) for _ in steps]
        if block.language == "python" and not block.title:
            assert done[0].error == "", block.text
        if not block.title:
            assert_printed(block.output, "".join(part.output + part.error for part in done))


@pytest.mark.parametrize("name", TASKS)
def test_a_task_has_a_picture_and_is_short(name):
    assert len(re.findall(r"^!\[", TASKS[name], flags=re.MULTILINE)) == 1
    assert len(TASKS[name].splitlines()) <= 100, "a task is shown on two screens"
