"""The screen on which `gantrysim run` ends, of every built-in job at 80 and 120 columns, from saved answers."""

import json
import re
from itertools import pairwise
from pathlib import Path

import pytest

from gantrysim import Job
from gantrysim.cli import tables, terminal
from gantrysim.job.loading import builtin_jobs
from gantrysim.report.answer import Answer, AnswerRow

# what runs of the built-in jobs have found; the test marked soak makes one anew
ANSWERS = json.loads((Path(__file__).parent / "answers.json").read_text(encoding="utf-8"))
WIDTHS = (80, 120)
UNITS = ("µm", "mm", "mm/s", "mm²", "s", "ms", "%")
AFTER = 3  # lines on the files, on `gantrysim show` and on the page


def shown(name, width, monkeypatch, capsys):
    """What a run prints at the end, without the lines on its files."""
    saved = ANSWERS[name]
    monkeypatch.setenv("COLUMNS", str(width))
    rows = tuple(AnswerRow(*row) for row in saved["rows"])
    answer = Answer(saved["state"], saved["headline"], rows, spoilt=saved["spoilt"], also_spoilt=saved["also_spoilt"])
    tables.show_verdict(answer)
    tables.show_cause(answer, "")
    if saved["changes"] is not None:
        tables.show_change(saved["changes"], f"out/{name}")
    return capsys.readouterr().out


def texts(saved):
    """The texts of an answer, which the screen shows with other line breaks."""
    changes = saved["changes"] or {"change": "", "outcome": ""}
    rows = [text for row in saved["rows"] for text in row[3:4]]
    return [*rows, saved["spoilt"], saved["also_spoilt"], changes["change"], changes["outcome"]]


def words_of(text):
    """Words without punctuation."""
    return {word.rstrip(".,;:").lower() for word in text.split()}


def test_every_built_in_job_has_a_saved_answer():
    assert set(ANSWERS) == set(builtin_jobs())


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", ANSWERS)
def test_a_run_ends_on_one_screen_whose_words_and_units_are_whole(name, width, monkeypatch, capsys):
    text = shown(name, width, monkeypatch, capsys)
    lines = text.splitlines()
    assert len(lines) + AFTER <= tables.TABLE_LINES
    assert max(map(len, lines)) <= width
    assert all(line and line == line.rstrip() for line in lines)
    for part in texts(ANSWERS[name]):
        assert words_of(part) <= words_of(text)
    for line, following in pairwise(lines):
        first = following.split()[0] if following.strip() else ""
        assert not (re.search(r"\d$", line) and first.rstrip(".,;:)") in UNITS), (line, following)
        assert not line.endswith((" =", " ×"))


@pytest.mark.parametrize("name", ANSWERS)
def test_the_options_of_a_screen_are_those_of_the_change(name, monkeypatch, capsys):
    saved = ANSWERS[name]["changes"]
    if saved is None or not saved["options"]:
        return
    text = shown(name, 80, monkeypatch, capsys)
    if "paste into the command line" not in text:
        assert f"gantrysim show out/{name} levers" in text
        return
    pasted = text.partition("command line:\n")[2].partition("\nthen")[0]
    assert " ".join(pasted.replace("\\\n", " ").split()) == " ".join(saved["options"])


@pytest.mark.soak
@pytest.mark.parametrize("width", WIDTHS)
def test_the_command_prints_one_screen(width, gantrysim_command, tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(width))
    monkeypatch.chdir(tmp_path)
    for name in builtin_jobs():
        _, printed, _ = gantrysim_command("run", name, "--no-video")
        assert len(printed.splitlines()) <= tables.TABLE_LINES, name
        assert "change " in printed or Job.load(name).run().verdict.state == "pass"


@pytest.mark.parametrize(
    ("text", "pieces"),
    [
        ("t = 10.000 s, x = 40.7, y = -3.8", ["t = 10.000 s,", "x = 40.7,", "y = -3.8"]),
        ("at most 82.0 µm (default)", ["at", "most", "82.0 µm", "(default)"]),
        ("acceleration (× 4), 5 words", ["acceleration", "(× 4),", "5", "words"]),
        ("30 to 100 mm/s and 3 minutes", ["30", "to", "100 mm/s", "and", "3", "minutes"]),
        ("2 sides, 4 %, ± 5 Hz", ["2", "sides,", "4 %,", "± 5 Hz"]),
    ],
)
def test_no_line_ends_between_a_number_and_its_unit(text, pieces, monkeypatch, capsys):
    assert [piece.replace("\ue000", " ") for piece in terminal.unbreakable_text(text).split(" ")] == pieces
    monkeypatch.setenv("COLUMNS", "14")
    terminal.say(text, wrap=True)
    printed = capsys.readouterr().out
    assert " ".join(printed.split()) == text
    assert all(any(piece in line for line in printed.splitlines()) for piece in pieces)


def test_a_progress_bar_never_runs_backwards(monkeypatch):
    """More runs become known while they are made: the share that is done would fall."""
    shares = []

    class Bars:
        total = None

        def add_task(self, *_, total, **__):
            self.total = total
            return 0

        def update(self, bar, *, completed, total=None, **_):
            self.total = total or self.total
            shares.append(completed / self.total)

        def __enter__(self):
            return self

        def __exit__(self, *_):
            return None

    monkeypatch.setattr(terminal, "_bars", lambda *_: Bars())
    with terminal.count_bar("improve") as advance:
        for done, known in ((1, 2), (2, 10), (5, 10), (6, 40), (40, 40)):
            advance(done, known, "levers")
    with terminal.share_bar("simulate") as progress:
        for share in (0.2, 0.1, 0.6):
            progress(share)
    assert shares == [0.5, 0.5, 0.5, 0.5, 1.0, 0.2, 0.2, 0.6]


def test_help_is_wrapped_once(gantrysim_command, monkeypatch):
    """A line of a paragraph is broken where the next word has no room, not where the text in the code is."""
    monkeypatch.setenv("COLUMNS", "80")
    _, printed, _ = gantrysim_command("run", "--help")
    prose = [line.strip() for line in printed.partition("╭")[0].splitlines()][2:]
    for line, following in pairwise(prose):
        if line and following:
            assert len(line) + 1 + len(following.split()[0]) > 76, (line, following)


def test_what_was_chosen_for_a_program_alone_is_told_in_a_few_words(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "120")
    (tmp_path / "part.ngc").write_text("G21 G90\nF600\nG1 X20\nG1 Y20\nM2\n")
    job = Job.load(tmp_path / "part.ngc")
    tables.show_choice(job.notes, "out/part")
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith("chosen     machine xy; ")
    assert f"; glue {job.dispenser.area:g} mm² times path speed; " in line
    assert line.endswith(": gantrysim show out/part notes")
    tables.show_choice(Job.load("an225").notes, "out/an225")  # which gives all that it needs
    assert capsys.readouterr().out == ""
