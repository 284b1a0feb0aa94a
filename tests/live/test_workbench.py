"""The workbench's state: history, saving, comparison, texts and refusals, and the answers of its worker."""

import json
from pathlib import Path

import imageio.v3
import numpy as np
import pytest

from gantrysim import InputError, Job
from gantrysim.live.controls import controls_of
from gantrysim.live.draft import Draft, Refusal, Request
from gantrysim.live.store import Store
from gantrysim.live.studio import StaleError, Studio
from gantrysim.live.workbench import Workbench, version_of
from gantrysim.live.worker import Message
from gantrysim.report.viewer_data import ViewerData
from gantrysim.report.writing import results_of

from support.live_jobs import JOB, TEXT


class Answers:
    """A studio in this thread, its messages by kind."""

    def __init__(self, folder):
        self.studio = Studio(folder)
        self.number = 0

    def ask(self, task, draft, **named):
        self.number += 1
        self.studio.newest = self.number
        messages = []
        self.studio.answer(
            Request(self.number, task, draft, **named), lambda kind, content: messages.append((kind, content))
        )
        return messages


@pytest.fixture(scope="module")
def answers(tmp_path_factory):
    return Answers(tmp_path_factory.mktemp("scratch"))


@pytest.fixture
def bench(tmp_path):
    (tmp_path / "short.toml").write_text(JOB)
    (tmp_path / "part.ngc").write_text(TEXT)
    asked = []
    told = []
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    made = Workbench(
        Store(tmp_path, scratch), str(tmp_path / "short.toml"), asked.append, lambda *entry: told.append(entry)
    )
    made.start()
    return made, asked, told


def content_of(messages, kind):
    return [content for name, content in messages if name == kind]


def receive_controls(bench, asked, folder):
    job = Job.load(folder / "short.toml")
    controls = [control._asdict() for control in controls_of(job, job, 100.0)]
    bench.receive(Message(asked[-1].number, "controls", {"controls": controls}))


def test_the_quick_and_the_whole_answer_are_the_commands_values(answers, tmp_path):
    file = tmp_path / "short.toml"
    file.write_text(JOB)
    draft = Draft(str(file), values={"program.speed": 80.0})
    messages = answers.ask("show", draft)
    quick, whole = content_of(messages, "result")
    job = Job.load(file, {"program.speed": 80.0})
    results = results_of(job, job.run(), causes=False)
    for result in (quick, whole):
        assert result["head"]["headline"] == results.verdict.headline
        rows = {row["name"]: row["texts"] for row in result["head"]["rows"]}
        assert rows == {row.name: list(row.texts) for row in results.verdict.rows}
    assert [quick["head"]["engine"], whole["head"]["engine"]] == ["loop", "mujoco"]
    assert set(whole["parts"].columns) == set(ViewerData(results, flat_in_space=True).content()["columns"])
    (margins,) = content_of(messages, "margins")
    assert margins["row"]["texts"] == rows["stability"]


def test_an_edited_program_is_simulated_and_a_wrong_line_is_named(answers, tmp_path):
    file = tmp_path / "part.ngc"
    file.write_text(TEXT)
    (texts,) = content_of(answers.ask("show", Draft(str(file))), "text")
    assert texts["program"] == TEXT
    assert texts["job"] is None
    wrong = TEXT.replace("G1 X30", "G1 X30 QQ")
    (refusal,) = content_of(answers.ask("show", Draft(str(file), program=wrong)), "refused")
    assert refusal["line"] == 5
    (tmp_path / "wrong.ngc").write_text(wrong)
    with pytest.raises(InputError) as error:
        Job.load(tmp_path / "wrong.ngc").plan()
    assert refusal["text"] == str(error.value).replace("wrong.ngc", "part.ngc")
    right = TEXT.replace("X30", "X60")
    (result, _) = content_of(answers.ask("show", Draft(str(file), program=right)), "result")
    assert "X60" in result["toml"]


def test_a_wrong_job_file_is_refused_with_its_line(answers, tmp_path):
    file = tmp_path / "short.toml"
    file.write_text(JOB)
    (refusal,) = content_of(answers.ask("show", Draft(str(file), JOB.replace('"short"', '"short'))), "refused")
    assert refusal["line"] == 1
    (refusal,) = content_of(answers.ask("show", Draft(str(file), JOB.replace("turns = 1", "turns = -1"))), "refused")
    assert "turns" in refusal["text"]
    assert "short.toml" in refusal["text"]
    assert str(answers.studio._scratch) not in refusal["text"]


def test_cells_that_do_not_suit_the_bead_are_refused_behind_the_quick_answer(answers, tmp_path):
    file = tmp_path / "short.toml"
    file.write_text(JOB)
    messages = answers.ask("show", Draft(str(file), values={"bead.cell": 5.0}))
    assert [kind for kind, _ in messages if kind in ("result", "refused")] == ["result", "refused"]
    (refusal,) = content_of(messages, "refused")
    with pytest.raises(InputError) as error:
        Job.load(file, {"bead.cell": 5.0}).check_fit()
    assert refusal["text"] == str(error.value)


def test_an_edited_job_file_finds_the_files_beside_the_original(answers, tmp_path):
    (tmp_path / "part.ngc").write_text(TEXT)
    file = tmp_path / "job.toml"
    text = 'name = "job"\n[program]\nfile = "part.ngc"\n'
    file.write_text(text)
    messages = answers.ask("show", Draft(str(file), text + "[servo]\nperiod = 0.002\n"))
    (result, _) = content_of(messages, "result")
    assert "period = 0.002" in result["toml"]


def test_the_override_is_of_the_programmed_speed(answers, tmp_path):
    file = tmp_path / "short.toml"
    file.write_text(JOB)
    (result, _) = content_of(answers.ask("show", Draft(str(file), override=50.0)), "result")
    assert "speed = 50.0" in result["toml"]


def test_a_kept_run_is_laid_under_the_present_one(answers, tmp_path):
    file = tmp_path / "short.toml"
    file.write_text(JOB)
    messages = answers.ask("show", Draft(str(file), values={"dispenser.flow": 150.0}), reference=Draft(str(file)))
    (result, _) = content_of(messages, "result")
    assert {"contour.0", "contour.1", "width.0", "width.1"} <= set(result["parts"].columns)
    job = Job.load(file)
    assert result["head"]["kept"]["headline"] == results_of(job, job.run(), causes=False).verdict.headline


def test_what_to_change_is_tried_as_it_was_promised(answers, tmp_path):
    file = tmp_path / "short.toml"
    file.write_text(JOB)
    draft = Draft(str(file))
    (proposals,) = content_of(answers.ask("improve", draft), "proposals")
    assert proposals["proposals"]
    best = proposals["proposals"][0]
    assert best["is_whole"]
    (result, _) = content_of(answers.ask("show", Draft(str(file), values=best["values"])), "result")
    assert proposals["sentence"].startswith("passes") == (result["head"]["state"] == "pass")


@pytest.mark.soak
def test_the_report_is_written_as_the_command_does(answers, tmp_path):
    file = tmp_path / "short.toml"
    file.write_text(JOB)
    (written,) = content_of(answers.ask("report", Draft(str(file)), folder=str(tmp_path / "out")), "written")
    assert written["page"] == str(tmp_path / "out" / "short" / "report.html")
    names = {path.name for path in (tmp_path / "out" / "short").iterdir()}
    assert {"job.toml", "run.npz", "summary.json", "report.html", "plots"} <= names
    job = Job.load(file)
    summary = json.loads((tmp_path / "out" / "short" / "summary.json").read_text())
    assert summary["verdict"]["headline"] == results_of(job, job.run(), causes=False).verdict.headline


@pytest.mark.soak
def test_a_film_shows_the_run_and_a_newer_request_leaves_none(answers, tmp_path):
    file = tmp_path / "short.toml"
    file.write_text(JOB)
    draft = Draft(str(file), values={"program.speed": 400.0})
    (film,) = content_of(answers.ask("film", draft, folder=str(tmp_path / "films")), "film")
    frames = imageio.v3.imread(film["file"])
    end = Job.load(file, {"program.speed": 400.0}).run().time[-1]
    assert len(frames) == pytest.approx(25 * (end + 1), abs=2)  # with the end card
    request = Request(answers.number + 1, "film", draft, folder=str(tmp_path / "others"))
    answers.number += 1
    answers.studio.newest = request.number

    def send(kind, content):
        if content.get("task") == "film: draw":
            answers.studio.newest = request.number + 1

    with pytest.raises(StaleError):
        answers.studio.answer(request, send)
    assert list((tmp_path / "others").iterdir()) == []
    answers.number += 1


def test_a_film_of_a_former_draft_is_said(bench):
    made, asked, _ = bench
    made.do({"do": "film"})
    assert asked[-1].task == "film"
    number = asked[-1].number
    made.receive(Message(number, "film", {"name": "short", "file": "film.mp4"}))
    assert made.state()["filmed"]
    made.do({"do": "program", "text": "x"})
    assert not made.state()["filmed"]
    assert made.film(str(number)) == (Path("film.mp4"), "short")
    assert made.film(str(number + 1)) is None


def test_a_newer_request_ends_an_older_one(answers):
    answers.number += 1
    request = Request(answers.number, "show", Draft("an225"))
    answers.studio.newest = request.number + 1
    with pytest.raises(StaleError):
        answers.studio.answer(request, lambda *_: None)


def test_a_newer_request_ends_a_report_at_its_next_step(answers, monkeypatch, tmp_path):
    """Its progress is the only place at which it is asked: none of its files is written."""
    monkeypatch.setattr("gantrysim.live.studio._PACE", 0.0)
    answers.number += 1
    request = Request(answers.number, "report", Draft("an225"), folder=str(tmp_path / "reports"))
    answers.studio.newest = request.number
    shares = []

    def send(kind, content):
        assert (kind, content["task"]) == ("progress", "report")
        shares.append(content["share"])
        answers.studio.newest = request.number + 1

    with pytest.raises(StaleError):
        answers.studio.answer(request, send)
    assert len(shares) == 1
    assert not (tmp_path / "reports").exists()
    answers.number += 1


def test_a_newer_request_ends_an_older_one_within_its_run(answers):
    answers.number += 1
    request = Request(answers.number, "show", Draft("an225", values={"program.turns": 5}))
    answers.studio.newest = request.number
    kinds = []

    def send(kind, _):
        kinds.append(kind)
        if kind == "margins":
            answers.studio.newest = request.number + 1

    with pytest.raises(StaleError):
        answers.studio.answer(request, send)
    assert "result" not in kinds
    answers.number += 1


def test_undo_and_redo_go_through_what_was_done(bench, tmp_path):
    made, asked, _ = bench
    receive_controls(made, asked, tmp_path)
    first = made.draft
    made.do({"do": "set", "values": {"servo.damping": 0.7}})
    made.do({"do": "set", "values": {"dispenser.flow": 210.0}})
    assert made.draft.values == {"servo.damping": 0.7, "dispenser.flow": 210.0}
    made.do({"do": "undo"})
    assert made.draft.values == {"servo.damping": 0.7}
    made.do({"do": "undo"})
    assert made.draft == first
    with pytest.raises(InputError, match="nothing to undo"):
        made.do({"do": "undo"})
    made.do({"do": "redo"})
    assert made.draft.values == {"servo.damping": 0.7}
    made.do({"do": "set", "values": {"servo.damping": None}})
    assert made.draft == first
    assert [request.draft for request in asked][-1] == first


def test_what_was_undone_is_gone_once_something_else_is_changed(bench, tmp_path):
    made, asked, _ = bench
    receive_controls(made, asked, tmp_path)
    made.do({"do": "set", "values": {"servo.damping": 0.7}})
    made.do({"do": "undo"})
    assert made.state()["can_redo"]
    made.do({"do": "set", "values": {"dispenser.flow": 210.0}})
    assert not made.state()["can_redo"]
    with pytest.raises(InputError, match="nothing to redo"):
        made.do({"do": "redo"})


def test_a_drag_of_a_slider_is_one_step(bench, tmp_path):
    made, asked, _ = bench
    receive_controls(made, asked, tmp_path)
    for value in (0.9, 0.8, 0.7):
        made.do({"do": "set", "values": {"servo.damping": value}, "dragging": True})
    made.do({"do": "set", "values": {"servo.damping": 0.65}, "dragging": False})
    made.do({"do": "undo"})
    assert made.draft.values == {}


def test_answers_to_older_requests_are_dropped(bench):
    made, asked, told = bench
    made.do({"do": "program", "text": "x"})
    count = len(told)
    made.receive(Message(asked[0].number, "result", {"head": {"headline": "old"}, "parts": None, "toml": ""}))
    assert made.head == {}
    assert len(told) == count
    assert made.is_stale


def test_a_job_is_saved_as_it_was_simulated_and_put_back(bench, tmp_path):
    made, asked, _ = bench
    with pytest.raises(InputError, match="not simulated yet"):
        made.do({"do": "save", "name": "new"})
    made.receive(Message(asked[-1].number, "result", {"head": {}, "parts": None, "toml": JOB + "# now\n"}))
    made.do({"do": "save", "name": "new"})
    assert (tmp_path / "new.toml").read_text() == JOB + "# now\n"
    made.do({"do": "unsave"})
    assert not (tmp_path / "new.toml").exists()
    made.do({"do": "save", "name": "short.toml"})
    assert (tmp_path / "short.toml").read_text() == JOB + "# now\n"
    made.do({"do": "unsave"})
    assert (tmp_path / "short.toml").read_text() == JOB


def test_a_job_that_is_changed_or_refused_is_not_saved_as_the_one_before_it(bench, tmp_path):
    made, asked, _ = bench
    made.receive(Message(asked[-1].number, "result", {"head": {}, "parts": None, "toml": JOB}))
    made.do({"do": "program", "text": "x"})
    for _ in range(2):
        with pytest.raises(InputError, match="not simulated yet, or is refused"):
            made.do({"do": "save", "name": "new"})
        refusal = {"text": "no", "line": 1, "word": "", "task": "show"}
        made.receive(Message(asked[-1].number, "refused", refusal))
    assert not (tmp_path / "new.toml").exists()


def test_a_file_that_was_changed_is_read_again_and_another_reference_is_run(tmp_path):
    """Neither the job that was opened last nor the run that was kept last stands for another."""
    studio = Studio(tmp_path)
    file = tmp_path / "part.ngc"
    speeds = []
    for feed in ("F6000", "F3000"):
        file.write_text(TEXT.replace("F6000", feed))
        speeds.append(studio._open(Draft(str(file), version=version_of(str(file)))).controller.programmed_speed)
    assert speeds == [100.0, 50.0]
    text = file.read_text().replace("X30", "X20")
    assert studio._open(Draft(str(file), text=JOB)).name == "short"
    drafts = [Draft(str(file), version=2), Draft(str(file), program=text, version=2)]
    times = [studio._reference_results(draft, lambda *_: None).budget.analysis.run.time[-1] for draft in drafts]
    # 10 mm less at 50 mm/s
    assert times[0] - times[1] == pytest.approx(0.2, abs=1e-3)


@pytest.mark.parametrize("is_whole", [True, False])
def test_a_proposal_for_the_whole_job_replaces_the_override_and_one_lever_keeps_it(bench, tmp_path, is_whole):
    """The values of the best combination are those at the program's own speed, which they may set."""
    made, asked, _ = bench
    receive_controls(made, asked, tmp_path)
    made.do({"do": "set", "values": {"override": 50.0}})
    proposal = {"values": {"dispenser.flow": 100.0}, "program": None, "is_whole": is_whole}
    made.receive(Message(asked[-1].number, "proposals", {"proposals": [proposal]}))
    made.do({"do": "try", "number": 0})
    assert asked[-1].draft.values == {"dispenser.flow": 100.0}
    assert asked[-1].draft.override == (100.0 if is_whole else 50.0)


def test_a_file_that_changes_on_disk_is_taken_over_with_the_controls(bench, tmp_path):
    made, asked, _ = bench
    receive_controls(made, asked, tmp_path)
    made.do({"do": "set", "values": {"servo.damping": 0.7}})
    made.do({"do": "job", "text": JOB + "# edited\n"})
    (tmp_path / "short.toml").write_text(JOB + "# saved by an editor\n")
    made.reload()
    assert made.draft.text is None
    assert made.draft.version == version_of(made.draft.path)
    assert asked[-1].draft == made.draft
    made.do({"do": "undo"})
    assert made.draft.text == JOB + "# edited\n"


def test_the_program_file_of_a_job_is_followed_too(tmp_path):
    job = tmp_path / "job.toml"
    job.write_text('name = "job"\n[program]\nfile = "part.ngc"\n')
    assert version_of(str(job)) == 0  # it is not there yet
    (tmp_path / "part.ngc").write_text(TEXT)
    before = version_of(str(job))
    (tmp_path / "part.ngc").write_text(TEXT + "(changed)\n")
    assert 0 != before != version_of(str(job))
    job.write_text("[program")
    assert version_of(str(job)) not in (0, before)


def test_a_new_tab_gets_what_the_others_show(bench):
    made, asked, _ = bench
    made.receive(Message(asked[-1].number, "text", {"program": None, "job": JOB}))
    made.receive(Message(asked[-1].number, "refused", {"text": "no", "line": 1, "word": "", "task": "show"}))
    assert [kind for kind, _ in made.messages()] == ["state", "text", "refused"]
    made.do({"do": "program", "text": "x"})
    assert [kind for kind, _ in made.messages()] == ["state", "text"]


def test_controls_have_the_jobs_values_and_admit_them(tmp_path):
    for name in ("an225", "linuxcnc-flanges", "softmc-helical", "fanuc-conical", "stage-outline"):
        job = Job.load(name)
        controls = controls_of(job, job, 100.0)
        assert len({control.key for control in controls}) == len(controls) > 8
        for control in controls:
            assert control.value == control.initial
            if not control.options:
                assert control.low <= control.value <= control.high, control
                assert np.isfinite([control.low, control.high]).all()
            if control.is_ratio:
                assert control.low > 0


def test_a_refusal_names_the_line_and_the_quoted_word():
    assert Refusal.of(InputError("part.ngc: line 12: unknown word 'QQ'")) == (
        "part.ngc: line 12: unknown word 'QQ'",
        12,
        "QQ",
    )
    assert Refusal.of(InputError("servo on machine xy: unstable"))[1:] == (0, "")
