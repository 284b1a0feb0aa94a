"""The terminal at 40, 80 and 120 columns: nothing that is printed in a wide one is lost or cut."""

import re
from collections import Counter
from copy import deepcopy

import pytest
from rich.table import Table

from gantrysim import Job, causes_of
from gantrysim.cli import terminal
from gantrysim.cli.info import KINDS, overview_table
from gantrysim.cli.show import show_section
from gantrysim.job.loading import builtin_jobs
from gantrysim.job.programs import PROGRAMS
from gantrysim.machine.machine import builtin_models
from gantrysim.remedy.improve import improve
from gantrysim.remedy.report import change_section

from support.soaked import suite_runs

WIDTHS = (120, 80, 40)
WIDE = 1000
RULES = set("│┃─━┏┓┗┛┡┩└┘├┤┼╇┳┻┬┴┝┥╈╉╊╋")
SCREEN = 24  # lines
SMALL = ("diameter=40", "turns=2", "thickness=5")
RUN = (
    "run",
    "an225",
    *(word for setting in SMALL for word in ("--set", setting)),
    "--no-video",
    "--no-report",
    "--no-improve",
    "-v",
)


def letters(text):
    """How often each character is printed, in whatever order a narrow table has them."""
    return Counter(letter for letter in text if not letter.isspace() and letter not in RULES)


def words(text):
    """The words that are printed, in whatever order and with whatever stops a narrow table has them."""
    return {word.strip(".:;,\\") for word in text.split() if not set(word) <= RULES}


def widest(text):
    return max(len(line.rstrip()) for line in text.splitlines())


@pytest.fixture
def printed(monkeypatch, capsys):
    def show(table, width):
        monkeypatch.setenv("COLUMNS", str(width))
        terminal.show(deepcopy(table))
        return capsys.readouterr().out

    return show


@pytest.fixture(scope="module")
def small():
    """The record of a small spiral, and its causes."""
    job = Job.load("an225", SMALL)
    run = job.run()
    return run, causes_of(job, run)


@pytest.fixture
def command(gantrysim_command, monkeypatch, small, tmp_path):
    """What a command prints at a width; the run is simulated once."""
    record, causes = small
    monkeypatch.setattr(Job, "run", lambda job, progress=None: record.replaced(job=job))
    monkeypatch.setattr("gantrysim.cli.evaluation.causes_of", lambda *_, **__: causes)
    monkeypatch.chdir(tmp_path)

    def run(width, *arguments):
        monkeypatch.setenv("COLUMNS", str(width))
        return gantrysim_command(*arguments)[1]

    return run


@pytest.mark.parametrize("arguments", suite_runs([(RUN,), (("check", "an225"),)], 0), ids=["run", "check"])
def test_a_command_loses_nothing_in_a_narrow_terminal(command, arguments):
    everything = command(WIDE, *arguments)
    for width in WIDTHS:
        text = command(width, *arguments)
        assert "…" not in text
        assert words(everything) <= words(text)
        if width > min(WIDTHS):  # at the narrowest the budget and the causes run on
            files = [line for line in text.splitlines() if "/: " in line or "note: " in line]
            assert widest("\n".join(line for line in text.splitlines() if line not in files)) <= width


@pytest.fixture(scope="module")
def improvement():
    """What to change in a small spiral, with few of the levers."""
    names = ("flow by speed", "lag compensation", "acceleration", "friction compensation")
    return improve(Job.load("an225", SMALL), levers=names, fastest=False)


@pytest.mark.soak
def test_the_levers_of_improve_lose_nothing(improvement, monkeypatch, capsys):
    def show(width):
        monkeypatch.setenv("COLUMNS", str(width))
        show_section(change_section(improvement).content())
        return capsys.readouterr().out

    everything = show(WIDE)
    assert improvement.trials
    for width in WIDTHS:
        text = show(width)
        assert "…" not in text
        assert words(everything) <= words(text)
        if width > min(WIDTHS):
            prose = text.partition("# job file")[0]  # what follows is to be pasted
            assert widest(prose) <= width


@pytest.mark.parametrize("name", suite_runs(list(KINDS), 2))
def test_the_tables_of_info_lose_nothing(printed, name):
    for table in KINDS[name].tables():
        everything = printed(table, WIDE)
        for width in WIDTHS:
            text = printed(table, width)
            assert "…" not in text.replace("…", "", everything.count("…"))
            assert letters(text) == letters(everything)
            if width > min(WIDTHS):
                assert widest(text) <= width


def test_info_fits_on_one_screen(printed):
    text = printed(overview_table(), 80)
    assert len(text.splitlines()) < SCREEN  # and the prompt
    assert widest(text) <= 80
    # all that can be named
    for names in (builtin_models(), builtin_jobs(), PROGRAMS, KINDS):
        assert set(names) <= set(re.findall(r"[\w.-]+", text))
    for width in WIDTHS:
        assert letters(printed(overview_table(), width)) == letters(text)


def test_a_column_that_does_not_wrap_is_as_wide_as_its_longest_line(printed):
    """Without that, rich cuts it to its longest word: `Table.__rich_measure__` splits it there."""
    from rich.table import Table

    table = Table("name", "value")
    table.add_column("travel", no_wrap=True)
    table.add_row("x", "one two three", "-150 to 150 mm")
    for width in (20, 30, 80):
        assert "-150 to 150 mm" in printed(table, width)


@pytest.mark.parametrize(
    ("spare", "widths"),
    [(0, [1, 2, 3]), (6, [3, 4, 5]), (16, [5, 7, 10]), (17, [5, 7, 11]), (200, [None, None, None]), (-5, [1, 2, 3])],
)
def test_spare_characters_go_to_the_columns_that_need_least_and_the_rest_to_the_others(spare, widths):
    """Columns that lack 4, 5 and 97 characters: what the first two leave is the third's."""
    table = Table()
    for least in (1, 2, 3):
        table.add_column("", min_width=least)
    table.add_row("x" * 5, "x" * 7, "x" * 100)
    terminal._widen_columns(table, spare)
    assert [column.width for column in table.columns] == widths
