"""The cases of a study run on several workers."""

import os
import signal
import time
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise

import pytest

from gantrysim import InputError, Job
from gantrysim.study import Case, Ledger, StudyInterrupted, WorkerError, measure, run_cases, run_study, runner

from support.studies import PATIENCE, SHORT, Counted, Toy, cases_of, content


@pytest.fixture(scope="module")
def job():
    return Job.load("an225", SHORT)


def test_rows_do_not_depend_on_the_number_of_workers(job):
    cases = [*cases_of(job), Case.of(job, {"program.turns": 9}, value=0.0)]
    cases.insert(2, Case.of(job, {"program.loop_period": 0.04}, "perfect follower", value=0.04))
    rows = {}
    for workers in (1, 2):
        with Ledger(None, {}) as ledger:
            rows[workers] = run_cases(cases, ledger, workers=workers)
    assert rows[1] == rows[2]
    assert [row["value"] for row in rows[1]] == [0.02, 0.03, 0.04, 0.05, 0.08, 0.0]
    assert [row["status"] == "ok" for row in rows[1]] == [True] * 5 + [False]


def test_another_backend_of_joblib_gives_the_same_rows(job):
    from joblib import parallel_config

    cases = cases_of(job, (0.02, 0.05))
    with Ledger(None, {}) as alone:
        expected = run_cases(cases, alone, workers=1)
    with parallel_config(backend="threading", n_jobs=2), Ledger(None, {}) as ledger:
        assert run_cases(cases, ledger) == expected
    counted = Counted()  # in a process of its own it would not count here
    with parallel_config(backend="threading"), Ledger(None, {}) as ledger:
        run_cases(cases, ledger, measure=counted)
    assert sorted(counted.seen) == [0.02, 0.05]


def test_zero_workers_are_refused(job):
    with Ledger(None, {}) as ledger, pytest.raises(InputError, match="workers = 0: must be at least 1"):
        run_cases(cases_of(job), ledger, workers=0)


def leaves_interrupts(case):
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, [])
    return {"status": "ok", "ignored": {signal.SIGINT, signal.SIGHUP} <= blocked, "process": os.getpid()}


def processes(job, monkeypatch, cores, workers, cases=8):
    """How many processes measure the cases, where there are so many cores."""
    monkeypatch.setattr("joblib.parallel.cpu_count", lambda only_physical_cores=False: cores)
    monkeypatch.setattr("joblib._parallel_backends.cpu_count", lambda only_physical_cores=False: cores)
    asked = []
    monkeypatch.setattr("joblib.Parallel", lambda **options: asked.append(parallel_n_jobs()) or Once())
    with Ledger(None, {}) as ledger:
        run_cases(cases_of(job, [0.01 * (k + 1) for k in range(cases)]), ledger, workers=workers, measure=Counted())
    return asked[0]


def parallel_n_jobs():
    from joblib.parallel import get_active_backend

    return get_active_backend()[1]


class Once:
    """Does its jobs one after the other."""

    def __call__(self, jobs):
        return [function(*values, **named) for function, values, named in jobs]


def test_there_are_never_more_processes_than_cores_or_cases(job, monkeypatch):
    assert processes(job, monkeypatch, cores=4, workers=100_000) == 4
    assert processes(job, monkeypatch, cores=4, workers=3) == 3
    assert processes(job, monkeypatch, cores=4, workers=None) == 4
    assert processes(job, monkeypatch, cores=4, workers=100_000, cases=2) == 2
    assert processes(job, monkeypatch, cores=4, workers=None, cases=2) == 2


def test_workers_ignore_ctrl_c(job, monkeypatch):
    monkeypatch.setattr("joblib._parallel_backends.cpu_count", lambda only_physical_cores=False: 2)
    before = signal.getsignal(signal.SIGINT)
    with Ledger(None, {}) as ledger:
        rows = run_cases(cases_of(job), ledger, workers=2, measure=leaves_interrupts)
    assert all(row["ignored"] and row["process"] != os.getpid() for row in rows)
    assert signal.getsignal(signal.SIGINT) is before


def test_cases_that_differ_only_in_tags_run_once(job):
    counted, told = Counted(), []
    cases = [Case.of(job, {"program.loop_period": 0.1}, sweep=s) for s in "ab"] + cases_of(job, (0.2,))
    with Ledger(None, {}) as ledger:
        rows = run_cases(cases, ledger, workers=1, measure=counted, progress=lambda *a: told.append(a))
    assert counted.seen == [0.1, 0.2]
    assert told == [(0, 2), (1, 2), (2, 2)]
    assert [row.get("sweep") for row in rows] == ["a", "b", None]
    assert rows[0]["third"] == rows[1]["third"] == 0.1 / 3


def deadly(case, recorded):
    if case.settings["program.loop_period"] == 0.08:
        until = time.monotonic() + PATIENCE
        while not recorded.exists() and time.monotonic() < until:
            time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGKILL)
    return {"status": "ok"}


def test_a_killed_worker_ends_the_study_and_finished_rows_are_kept(job, monkeypatch, tmp_path):
    monkeypatch.setattr("joblib._parallel_backends.cpu_count", lambda: 2)
    recorded = tmp_path / "recorded"  # the worker is killed after this, however slow the machine is

    def progress(done, every):
        if done:
            recorded.touch()

    cases, measure = cases_of(job, (0.02, 0.03, 0.04, 0.06, 0.07, 0.08)), partial(deadly, recorded=recorded)
    with Ledger(None, {}) as ledger:
        with pytest.raises(WorkerError, match=r"^a worker ended unexpectedly"):
            run_cases(cases, ledger, workers=2, measure=measure, progress=progress)
        assert len(ledger) >= 1


# cases that are measured together


class Together:
    """Measures several cases at once, and counts how many they were; it ends at one of the calls."""

    def __init__(self, short_of=0, interrupted_at=None):
        self.sizes, self.short_of, self.interrupted_at = [], short_of, interrupted_at

    def __call__(self, cases):
        if len(self.sizes) == self.interrupted_at:
            raise KeyboardInterrupt
        self.sizes.append(len(cases))
        rows = [{"status": "ok", "third": case.settings["program.loop_period"] / 3} for case in cases]
        return rows[self.short_of :]


def many(job, count):
    case = Case.of(job, {"program.loop_period": 1.0})
    return [replace(case, overrides=(("program.loop_period", str(1.0 + k)),)) for k in range(count)]


@pytest.mark.parametrize(
    ("count", "workers", "sizes"),
    [
        (16, 2, [8, 8]),  # a program of a search: one lot each
        (16, 3, [5, 5, 6]),
        (3, 4, [1, 1, 1]),
        (64, 2, [32, 32]),
        (65, 2, [16, 16, 16, 17]),  # as many for every worker, none larger than 32
        (1000, 2, [31] * 24 + [32] * 8),
        (16, 1, [16]),
        (33, 1, [16, 17]),
    ],
)
def test_every_worker_takes_as_many_cases_at_a_time(job, monkeypatch, count, workers, sizes):
    from joblib import parallel_config

    monkeypatch.setattr("joblib._parallel_backends.cpu_count", lambda: 4)
    together, told = Together(), []
    with parallel_config(backend="threading"), Ledger(None, {}) as ledger:
        rows = run_cases(
            many(job, count), ledger, workers=workers, measure=None, measure_together=together,
            progress=lambda *a: told.append(a),
        )  # fmt: skip
    assert sorted(together.sizes) == sizes
    assert [row["third"] for row in rows] == [(1.0 + k) / 3 for k in range(count)]
    assert [told[0], told[-1]] == [(0, count), (count, count)]
    assert sorted(after - before for (before, _), (after, _) in pairwise(told)) == sizes


def measured_together(cases):
    return [measure(case) for case in cases]


@pytest.mark.soak
def test_rows_do_not_depend_on_which_cases_are_measured_together(job):
    cases = [*cases_of(job), Case.of(job, {"program.turns": 9}, value=0.0)]
    cases.insert(2, cases[0].tagged(value="again"))
    with Ledger(None, {}) as ledger:
        expected = run_cases(cases, ledger, workers=1)
    for workers in (1, 2):
        with Ledger(None, {}) as ledger:
            assert run_cases(cases, ledger, workers=workers, measure_together=measured_together) == expected


def test_only_what_is_missing_is_measured_together(job):
    together, cases = Together(), many(job, 8)
    with Ledger(None, {}) as ledger:
        run_cases(cases[2:4], ledger, workers=1, measure_together=together)
        rows = run_cases([*cases, cases[0].tagged(again=True)], ledger, workers=1, measure_together=together)
    assert together.sizes == [2, 6]
    assert rows[-1] == {"again": True, **rows[0]}


@pytest.mark.parametrize("short_of", [1, 5])
def test_cases_that_are_measured_together_have_a_row_each(job, short_of):
    with Ledger(None, {}) as ledger, pytest.raises(ValueError, match="shorter"):
        run_cases(many(job, 5), ledger, workers=1, measure_together=Together(short_of))


@dataclass(frozen=True)
class Crowd(Toy):
    """A toy whose cases are measured together."""

    together: Together = field(default_factory=Together)
    values: tuple = tuple(0.1 + 0.01 * k for k in range(40))

    @property
    def measure_together(self):
        return self.together


def test_a_study_s_cases_are_measured_together_where_it_can(job, tmp_path):
    study = Crowd(job)
    outcome = run_study(study, tmp_path / "whole", workers=1)
    assert study.measure.seen == []
    assert study.measure_together.sizes == [20, 20, 1]
    with pytest.raises(StudyInterrupted) as interrupted:
        run_study(Crowd(job, together=Together(interrupted_at=1)), tmp_path / "broken", workers=1)
    assert interrupted.value.done == 20
    rest = Crowd(job)
    again = run_study(rest, tmp_path / "broken", workers=1)
    assert rest.measure_together.sizes == [20, 1]
    assert (again.resumed, again.rows) == (20, outcome.rows)
    assert content(tmp_path / "broken") == content(tmp_path / "whole")


def lots_of(cases, seconds):
    """The lots that two workers take of cases of a length [s], one after the other."""
    pace = runner._Pace()
    for lot in runner._timed_lots(list(range(cases)), 2, pace):
        yield lot
        pace.add(len(lot), seconds * len(lot))


def test_many_short_cases_are_taken_several_at_once_in_their_order():
    lots = list(lots_of(1000, 0.05))
    assert [case for lot in lots for case in lot] == list(range(1000))
    sizes = [len(lot) for lot in lots]
    assert sizes[0] == 1  # nobody knows yet how long they take
    assert max(sizes) == int(runner._LOT_TIME / 0.05)
    assert sizes == sizes[:1] + sorted(sizes[1:], reverse=True)  # fewer towards the end, for none to wait for the other
    assert sizes[-8:] == [1] * 8
    assert len(lots) < 1000 / 10


@pytest.mark.parametrize(("cases", "seconds"), [(1000, 3.0), (15, 0.001)], ids=["long", "few"])
def test_long_cases_and_few_are_taken_one_by_one(cases, seconds):
    assert all(len(lot) == 1 for lot in lots_of(cases, seconds))
