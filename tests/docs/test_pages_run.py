"""Pages of start and how-to: all their commands and code run in one folder, and print what the pages show."""

import re
import shlex
import shutil

import pytest

from support.doc_pages import ROOT, assert_printed, blocks_of, examples, read_pages

NOTEBOOK = "start/notebook.md"  # which another test runs as a whole
PAGES = {
    name: page for name, page in read_pages().items() if name.startswith(("start/", "how-to/")) and name != NOTEBOOK
}
# pages whose commands search, train or build for minutes
LONG = ("how-to/run-a-sweep-on-a-cluster.md", "how-to/train-an-agent.md", "how-to/tune.md")
SHORTER = ("--no-video", "--no-report")  # film and report take most of the time of a run
WIDTH = "100"  # of the terminal whose lines are shown [columns]
COMMAND = f"import os; os.environ['COLUMNS'] = '{WIDTH}'; from gantrysim.cli.start import main; main()"
ADDRESS = "tcp://"  # of computers that the test has not
FAILED = 4  # exit status of --fail-on


def commands(text):
    """The commands of a block that a test can run: their words, without the remark behind them."""
    lines = [shlex.split(line, comments=True) for line in text.replace("\\\n", " ").splitlines()]
    runnable = [
        words for words in lines if words[:1] == ["gantrysim"] or (words[1:] and words[1].startswith("examples/"))
    ]
    return [words for words in runnable if not any(ADDRESS in word for word in words)]


def printed_by(command, fresh, folder):
    """What a command, or an example, prints in a fresh process."""
    program, *arguments = command
    if arguments[0] == "run":
        arguments = [*arguments, *(option for option in SHORTER if option not in arguments)]
    if program == "gantrysim":
        done = fresh.run(COMMAND, folder, *arguments)
    else:
        done = fresh.run((ROOT / arguments[0]).read_text(encoding="utf-8"), folder, *arguments[1:])
    assert done.status in (0, FAILED), done.error + done.output
    return done.output + done.error


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.soak) if name in LONG else name for name in PAGES]
)
def test_a_page_s_code_prints_what_it_shows(name, fresh, tmp_path):
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    page = PAGES[name]
    code = examples(page)
    for block in blocks_of(page):
        if block.title:
            (tmp_path / block.title).write_text(block.text, encoding="utf-8")
        elif block.language == "python":
            parts = next(parts for example, parts in code if example == block)
            done = fresh.run("\n".join(part.text for part in parts), tmp_path)
            assert (done.status, done.error) == (0, ""), block.text
            assert_printed(block.output, done.output)
        else:
            printed = "".join(printed_by(command, fresh, tmp_path) for command in commands(block.text))
            assert_printed(block.output, printed)


@pytest.mark.parametrize("name", [name for name in PAGES if name.startswith("how-to/")])
def test_a_how_to_page_has_a_task_a_picture_and_is_short(name):
    page = PAGES[name]
    title, _, body = page.partition("\n\n")
    assert title.startswith("# ")
    assert len(re.findall(r"^!\[", page, flags=re.MULTILINE)) == 1
    assert len(page.splitlines()) <= 100, "a how-to page shows one task on two screens"
    assert "Next steps" in body
