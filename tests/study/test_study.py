"""Studies: what they write, and what they refuse."""

import csv
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

import pytest
import typer
from conftest import RIGID, RIGID_DEFAULTS

from gantrysim import InputError, Job
from gantrysim.cli.study import carry_out
from gantrysim.study import Report, Study, StudyInterrupted, measure, run_study
from gantrysim.study.laws import LawsStudy
from gantrysim.study.ledger import LEDGER
from gantrysim.study.run import NoValuesError

from support.strangers import half_done
from support.studies import SHORT, Counted, Toy, cases_of, content

pytestmark = pytest.mark.usefixtures("blank_pictures")


@pytest.fixture(scope="module")
def job():
    return Job.load("an225", SHORT)


def test_a_study_writes_its_folder(tmp_path, job):
    outcome = run_study(Toy(job), tmp_path / "a" / "b", workers=1)
    folder = tmp_path / "a" / "b"
    files = ["curves.csv", "job.toml", "plots/curve.png", "report.html", "study.csv", "study.toml"]
    assert list(content(folder)) == files
    assert outcome.written == ["curves.csv", "job.toml", "plots", "report.html", "study.csv", "study.toml"]
    with (folder / "study.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["value"]) for row in rows] == [0.3, 0.5, 0.4, 0.5, 0.51]
    assert [float(row["third"]) for row in rows] == [row["third"] for row in outcome.rows]
    described = tomllib.loads((folder / "study.toml").read_text())
    assert described["study"] == "toy"
    assert described["cases"] == 5
    assert described["settings"] == {"values": [0.3, 0.5, 0.4]}
    assert described["findings"] == outcome.findings
    assert described["versions"]["machine_sha256"] == job.built_machine.digest
    assert Job.load(str(folder / "job.toml")).toml() == job.toml()
    report = (folder / "report.html").read_text()
    assert "<h1>How large is a third?</h1>" in report
    assert "A toy: 5 cases" in report
    # question, answer, chart and table in this order, then the details
    places = [report.index(text) for text in ("is a third?</h1>", ">5 rows<", "It rises.", "<td", "a note", "<pre")]
    assert places == sorted(places)
    assert report.count("<details>") == 2
    assert places[3] < report.index("<details>") < places[4]


def test_a_repeated_study_replaces_its_files_and_keeps_others(tmp_path, job):
    run_study(Toy(job), tmp_path, workers=1)
    (tmp_path / "notes.txt").write_text("mine")
    outcome = run_study(Toy(job, values=(0.3, 0.4)), tmp_path, workers=1)
    assert (len(outcome.rows), outcome.resumed, outcome.discarded) == (4, 0, None)
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_the_folder_of_a_run_is_refused(tmp_path, job):
    (tmp_path / "report.html").write_text("of a run")
    (tmp_path / "run.npz").write_bytes(b"")
    with pytest.raises(InputError, match=r"holds report.html, which no study has written: name another folder"):
        run_study(Toy(job), tmp_path, workers=1)
    assert (tmp_path / "report.html").read_text() == "of a run"
    assert not (tmp_path / LEDGER).exists()


def test_the_folder_of_a_run_that_was_killed_is_completed_and_refused_before_any_case(tmp_path, job):
    half_done(tmp_path, new={"job.toml": "of a run"})
    study = Toy(job)
    with pytest.raises(InputError, match=r"holds job\.toml, which no study has written"):
        run_study(study, tmp_path, workers=1)
    assert not study.counted.seen
    assert content(tmp_path) == {"job.toml": b"of a run"}


def test_a_refused_job_is_refused_before_any_case(tmp_path, job):
    refused = {
        "must lie in the travel": {"program.start": [1e3, 0.0]},
        "physics_step = 1 s: must be at most": {"simulation.physics_step": 1.0},
        "must be a multiple of the physics step": {"servo.delay": 0.0123e-3},
    }
    jobs = {text: job.changed(values) for text, values in refused.items()}
    rapid = {"controller": "fanuc.Program", "program": "N10 G00 X5 Y5\n"}
    jobs["the dispenser is never on"] = Job(name="rapid", program=rapid)
    for text, refused_job in jobs.items():
        study = Toy(refused_job)
        with pytest.raises(InputError, match=text):
            run_study(study, tmp_path / "new", workers=1)
        assert study.measure.seen == []
        assert not (tmp_path / "new").exists()


class Failing(Counted):
    """Fails at one of its cases."""

    def __init__(self, at):
        super().__init__()
        self.at = at

    def __call__(self, case):
        if len(self.seen) == self.at:
            raise ZeroDivisionError
        return super().__call__(case)


def test_an_error_in_the_first_case_leaves_nothing_and_a_later_one_the_rows(tmp_path, job):
    with pytest.raises(ZeroDivisionError):
        run_study(Toy(job, Failing(0)), tmp_path / "a" / "b", workers=1)
    assert not list(tmp_path.iterdir())
    with pytest.raises(ZeroDivisionError):
        run_study(Toy(job, Failing(1)), tmp_path / "a" / "b", workers=1)
    assert list(content(tmp_path)) == [f"a/b/{LEDGER}"]


def test_other_files_in_the_folder_stay_if_no_case_is_finished(tmp_path, job):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(ZeroDivisionError):
        run_study(Toy(job, Failing(0)), tmp_path, workers=1)
    assert list(content(tmp_path)) == ["notes.txt"]


class Ending(Counted):
    """Gives every case one of some statuses, in turn."""

    def __init__(self, *statuses):
        super().__init__()
        self.statuses = statuses

    def __call__(self, case):
        status = self.statuses[len(self.seen) % len(self.statuses)]
        return {**super().__call__(case), "status": status}


def test_a_study_without_values_reports_it_and_writes_nothing(tmp_path, job, capsys):
    with pytest.raises(NoValuesError, match=r"^none of the study's 5 cases has values: refused: no$"):
        carry_out(Toy(job, Ending("refused: no")), tmp_path / "new", 1)
    with pytest.raises(typer.Exit) as stopped:
        carry_out(Toy(job, Ending("refused: no", "fault: trip")), tmp_path / "new", 1)
    assert stopped.value.exit_code == 3
    assert capsys.readouterr() == ("", "fault: none of the study's 5 cases has values: fault: trip\n")
    assert not list(tmp_path.iterdir())
    carry_out(Toy(job, Ending("refused: no", "fault: trip", "ok")), tmp_path / "new", 1)
    assert (tmp_path / "new" / "report.html").exists()


def test_rows_of_another_study_are_discarded(tmp_path, job):
    with pytest.raises(StudyInterrupted):
        run_study(Toy(job, Counted(interrupted_at=2)), tmp_path, workers=1)
    other = Toy(job, values=(0.3, 0.6))
    outcome = run_study(other, tmp_path, workers=1)
    assert (outcome.resumed, outcome.discarded) == (0, "they differ in settings")
    assert len(other.measure.seen) == 3


def test_a_file_is_refused_as_folder(tmp_path, job):
    file = tmp_path / "file"
    file.write_text("")
    with pytest.raises(InputError, match=f"--out {file}: is a file, must be a folder"):
        run_study(Toy(job), Path(file), workers=1)


def test_the_file_of_a_machine_is_read_at_the_start_of_a_study(tmp_path):
    file, found = tmp_path / "rigid.xml", []
    for damping in (12.0, 30.0):
        file.write_text(RIGID.format(**{**RIGID_DEFAULTS, "damping": damping}))
        own = Job.load("an225", SHORT, str(file))
        found.append(run_study(Toy(own, measure_following, values=(0.3,)), tmp_path / "out", workers=1).rows)
        assert found[-1][0]["servo"] == measure(cases_of(own, (0.3,))[0])["servo_rms_um"]
    assert found[0] != found[1]


def measure_following(case):
    row = measure(case)
    return {
        "status": row["status"],
        "third": case.settings["program.loop_period"] / 3,
        "servo": row["servo_rms_um"],
    }


@dataclass(frozen=True)
class Least(Study):
    """A study that defines no more than it must."""

    values: tuple = (0.3,)

    name = "least"

    def rounds(self):
        yield cases_of(self.job, self.values)

    def report(self, rows):
        return Report("Is it done?", "Done.")


def test_a_study_needs_no_more_than_a_name_rounds_and_a_report(tmp_path, job):
    outcome = run_study(Least(job), tmp_path, workers=1)
    assert outcome.findings == ["Done."]
    assert outcome.rows[0]["contour_rms_um"] > 0
    described = tomllib.loads((tmp_path / "study.toml").read_text())
    assert described["command"] == "gantrysim study least job.toml"
    assert described["settings"] == {"values": [0.3]}
    assert "Least study of an225" in (tmp_path / "report.html").read_text()
    with pytest.raises(TypeError, match=r"abstract method.* rounds"):
        Study(job)


def test_plots_are_imported_for_a_report_alone():
    code = (
        "import sys; from gantrysim.study import CircleStudy, LoopStudy, MachineStudy, RepeatStudy, SpeedStudy, "
        "run_study; assert 'gantrysim.study.loop.study' in sys.modules; "
        "assert not {'matplotlib', 'gantrysim.study.loop.report'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_derived_study_has_the_report_of_its_base_wherever_it_stands(monkeypatch):
    monkeypatch.setattr("gantrysim.study.laws.report.report", lambda study, rows: (type(study).__name__, rows))
    for module in ("__main__", "gantrysim.base.files", "gantrysim.study.laws.study"):
        derived = type("Derived", (LawsStudy,), {"__module__": module})
        assert object.__new__(derived).report([3]) == ("Derived", [3])
