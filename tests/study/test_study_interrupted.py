"""Studies that are interrupted or killed, and resume."""

import contextlib
import json
import os
import signal
import threading
import time
from pathlib import Path

import pytest
import typer
from matplotlib.figure import Figure

from gantrysim import Job
from gantrysim.base.errors import GantryError
from gantrysim.base.signals import ENDING
from gantrysim.cli import study as study_commands
from gantrysim.cli.study import carry_out
from gantrysim.study import Ledger, StudyInterrupted, run_cases, run_study
from gantrysim.study import run as study_run
from gantrysim.study.ledger import LEDGER

from support.soaked import suite_runs
from support.studies import PATIENCE, SHORT, Counted, Toy, begun, content, members, spoken

DATA = ("study.csv", "curves.csv", "study.toml", "job.toml")


@pytest.fixture(scope="module")
def job():
    return Job.load("an225", SHORT)


@pytest.mark.parametrize("at", [1, 3])
def test_a_resumed_study_ends_like_an_uninterrupted_one(tmp_path, job, at):
    whole = tmp_path / "whole"
    broken = tmp_path / "broken"
    expected = run_study(Toy(job), whole, workers=1)
    with pytest.raises(StudyInterrupted) as interrupted:
        run_study(Toy(job, Counted(interrupted_at=at)), broken, workers=1)
    assert interrupted.value.done == at
    assert list(content(broken)) == [LEDGER]
    rest = Toy(job)
    outcome = run_study(rest, broken, workers=1)
    assert len(rest.measure.seen) == 4 - at
    assert (outcome.resumed, outcome.rows, outcome.findings) == (at, expected.rows, expected.findings)
    assert content(broken) == content(whole)


def test_a_study_that_is_interrupted_before_its_first_row_leaves_nothing(tmp_path, job, capsys):
    with pytest.raises(typer.Exit):
        carry_out(Toy(job, Counted(interrupted_at=0)), tmp_path / "a" / "b", 1)
    assert capsys.readouterr().err == "interrupted: no case was finished, nothing is written\n"
    assert not list(tmp_path.iterdir())


@pytest.mark.soak
def test_ctrl_c_in_a_terminal_ends_the_command_and_says_how_to_resume(tmp_path):
    folder = tmp_path / "loop"
    process = begun(folder)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the workers too
    output, said = (text.decode() for text in process.communicate(timeout=PATIENCE))
    assert process.returncode == 130
    done = spoken(folder)
    assert done >= 1
    assert f"interrupted: the rows of {done} finished cases are kept in {folder}/; run the same command again" in said
    assert "Traceback" not in said
    assert output == ""
    assert list(content(folder)) == [LEDGER]


def test_an_interrupt_that_is_lost_in_a_finaliser_ends_the_study_at_the_next_row(tmp_path, job, capsys):
    class Lost(Counted):
        def __call__(self, case):
            if len(self.seen) == 1:
                with contextlib.suppress(KeyboardInterrupt):
                    signal.raise_signal(signal.SIGINT)
            return super().__call__(case)

    with pytest.raises(typer.Exit) as stopped:
        carry_out(Toy(job, Lost()), tmp_path, 1)
    assert stopped.value.exit_code == 130
    assert "the rows of 2 finished cases are kept" in capsys.readouterr().err


def test_sigterm_interrupts_and_the_next_run_reports_what_it_resumes(tmp_path, job, capsys):
    class Killed(Counted):
        def __call__(self, case):
            if len(self.seen) == 2:
                os.kill(os.getpid(), signal.SIGTERM)
            return super().__call__(case)

    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(typer.Exit) as stopped:
        carry_out(Toy(job, Killed()), tmp_path, 1)
    assert stopped.value.exit_code == 143
    assert "the rows of 2 finished cases are kept" in capsys.readouterr().err
    assert signal.getsignal(signal.SIGTERM) is before
    carry_out(Toy(job), tmp_path, 1)
    output, said = capsys.readouterr()
    assert said == "note: resumed with the rows of 2 cases from an interrupted run\n"
    assert output.startswith("How large is a third?\n\n5 rows\n\n")
    assert output.endswith(f"page: {tmp_path}/report.html\n")
    with pytest.raises(typer.Exit):
        carry_out(Toy(job, Counted(interrupted_at=1)), tmp_path, 1)
    carry_out(Toy(job, values=(0.3,)), tmp_path, 1)
    assert "are discarded: they differ in settings" in capsys.readouterr().err


def test_further_files_are_written_before_anything_is_printed(tmp_path, job, monkeypatch):
    def refuse(*_, **__):
        raise GantryError("standard output: cannot be written: No space left on device")

    monkeypatch.setattr(study_commands, "say", refuse)
    with pytest.raises(GantryError, match="standard output"):
        carry_out(Toy(job), tmp_path / "x", 1, None, lambda folder: (folder / "more.txt").write_text("gains"))
    assert (tmp_path / "x" / "more.txt").read_text() == "gains"


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="asks the system for processes by their group")
@pytest.mark.parametrize("rows", suite_runs([0, 1], 0))
def test_workers_end_with_a_study_that_is_killed(tmp_path, rows):
    process = begun(tmp_path / "loop", rows)
    until = time.monotonic() + PATIENCE
    while len(members(process.pid)) < 3:  # itself, its helper and a worker, which without a row has only just begun
        assert time.monotonic() < until
        time.sleep(0.05)
    process.kill()  # it alone
    process.wait()
    until = time.monotonic() + PATIENCE
    while left := members(process.pid):
        assert time.monotonic() < until, left
        time.sleep(0.1)
    process.communicate()


@pytest.mark.parametrize("number", ENDING)
def test_no_signal_is_lost_while_workers_start(tmp_path, job, monkeypatch, capsys, number):
    from joblib.externals.loky import get_reusable_executor
    from joblib.externals.loky.process_executor import ProcessPoolExecutor

    get_reusable_executor().shutdown(kill_workers=True)  # that of another study, which starts no workers
    from gantrysim.study.loop import LoopStudy

    start = ProcessPoolExecutor._adjust_process_count

    def interrupted(pool):
        os.kill(os.getpid(), number)
        start(pool)

    monkeypatch.setattr(ProcessPoolExecutor, "_adjust_process_count", interrupted)
    began = time.monotonic()
    with pytest.raises(typer.Exit) as stopped:
        carry_out(LoopStudy(job), tmp_path / "loop", 2)
    assert stopped.value.exit_code == 128 + number
    assert capsys.readouterr().err == "interrupted: no case was finished, nothing is written\n"
    assert time.monotonic() - began < PATIENCE / 4  # where it is lost, all cases are run
    assert not list(tmp_path.iterdir())


def test_cases_withdrawn_before_a_worker_takes_them_leave_no_traceback(tmp_path, job, monkeypatch, capsys):
    from joblib.externals.loky import get_reusable_executor
    from joblib.externals.loky.process_executor import _ExecutorManagerThread

    get_reusable_executor().shutdown(kill_workers=True)
    from gantrysim.study.loop import LoopStudy

    take = _ExecutorManagerThread.add_call_item_to_queue
    failed = []

    def late(manager):
        if manager.executor_flags.shutdown:
            try:
                take(manager)
            except KeyError as error:
                failed.append(error)
                raise
        elif not failed:
            os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(_ExecutorManagerThread, "add_call_item_to_queue", late)
    seen = []
    monkeypatch.setattr(threading, "excepthook", seen.append)
    before = threading.excepthook
    with pytest.raises(typer.Exit) as stopped:
        carry_out(LoopStudy(job), tmp_path / "loop", 2)
    assert failed  # as loky is; where it no longer fails, the hook can go
    assert not seen
    assert stopped.value.exit_code == 130
    assert capsys.readouterr().err == "interrupted: no case was finished, nothing is written\n"
    assert threading.excepthook is before


@pytest.mark.soak
def test_a_folder_in_use_is_refused_and_a_killed_study_resumes_with_the_same_rows(tmp_path, gantrysim_command):
    folder = tmp_path / "loop"
    process = begun(folder)
    try:
        before = (folder / LEDGER).read_bytes()
        status, _, said = gantrysim_command("study", "repeat", "an225", "--set", "turns=1", "--out", folder)
        assert status == 2
        assert said == f"error: --out {folder}: in use by another command\n"
        assert (folder / LEDGER).read_bytes().startswith(before)
        assert process.poll() is None
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
    done = spoken(folder)
    assert list(content(folder)) == [LEDGER]
    from gantrysim.study.loop import LoopStudy

    study = LoopStudy(Job.load("an225", SHORT))
    lines = [json.loads(line) for line in (folder / LEDGER).read_bytes().splitlines()[1 : done + 1]]
    first = [case for case in study.cases if case.key in {key for key, *_ in lines}]
    with Ledger(None, {}) as ledger:
        alone = run_cases(first, ledger, workers=1)
        assert {case.key: ledger[case.key] for case in first} == {key: row for key, row, _ in lines}
    identity = json.loads((folder / LEDGER).read_bytes().splitlines()[0])
    # the lock has gone with its process
    with Ledger(folder, identity) as ledger:
        assert ledger.resumed == done
        assert run_cases(first, ledger, measure=None) == alone  # none is measured again


@pytest.mark.parametrize("broken", ["report", "plot", "page"])
def test_a_report_that_fails_costs_no_row_and_is_made_by_the_same_command(tmp_path, job, capsys, monkeypatch, broken):
    whole, folder = tmp_path / "whole", tmp_path / "a"
    run_study(Toy(job), whole, workers=1)

    def fails(*_, **__):
        raise ZeroDivisionError("of a\nreport")

    with monkeypatch.context() as patched:
        target = {"report": (Toy, "report"), "plot": (Figure, "savefig"), "page": (study_run, "write_page")}[broken]
        patched.setattr(*target, fails)
        with pytest.raises(typer.Exit) as ended:
            carry_out(Toy(job), folder, 1)
    said = capsys.readouterr()
    assert ended.value.exit_code == 1
    assert said.err == (
        "error: no report: ZeroDivisionError: of a report; repeat the command to make it, without running cases again\n"
    )
    assert "study.csv" in said.out
    assert "report.html" not in said.out
    assert sorted(content(folder)) == sorted([LEDGER, *(name for name in content(whole) if name in DATA)])
    assert (folder / "study.csv").read_bytes() == (whole / "study.csv").read_bytes()
    again = Toy(job)
    assert run_study(again, folder, workers=1).failed is None
    assert not again.measure.seen
    assert content(folder) == content(whole)
