"""Studies on the workers of a Dask cluster: a scheduler and two processes on this machine, one of them killed."""

import logging
import os
import threading
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version

import pytest
from conftest import RIGID, RIGID_DEFAULTS

from gantrysim import InputError, Job
from gantrysim.study import (
    Case,
    Ledger,
    Report,
    StudyInterrupted,
    WorkerError,
    measure,
    on_backend,
    run_cases,
    run_study,
)
from gantrysim.study.cases import forget_jobs
from gantrysim.study.worker import Origin

from support.clusters import Cluster, all_of, broken, company, deadly, held, waited_for, where, without_gantrysim
from support.studies import PATIENCE, SHORT, Toy, cases_of, content, spoken

PERIODS = [0.02, 0.03, 0.04, 0.06, 0.07, 0.08, 0.09, 0.1]
FREE = 2  # cases, the first, that are not held


@pytest.fixture(scope="module")
def job():
    return Job.load("an225", SHORT)


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """A scheduler, for which a case may end two workers, and two workers."""
    with Cluster(tmp_path_factory.mktemp("dask"), DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES="1") as started:
        yield started


def on(cluster):
    return on_backend(f"dask={cluster.address}")


def rows_of(cases, **options):
    with Ledger(None, {}) as ledger:
        return run_cases(cases, ledger, **options)


@dataclass(frozen=True)
class Sweep(Toy):
    """Sweeps the loop's period, then looks on beside the best."""

    values: tuple = tuple(PERIODS)

    def rounds(self):
        rows = yield cases_of(self.job, self.values)
        best = min(rows, key=lambda row: row["contour_rms_um"])["value"]
        yield cases_of(self.job, (0.9 * best, 1.1 * best))

    def report(self, rows):
        return Report("Which period is best?", f"{len(rows)} rows")


class Kill:
    """A study's progress; once the free cases are done and both workers have another under way, it kills one."""

    def __init__(self, cluster, folder):
        self.cluster, self.folder, self.told = cluster, folder, []

    def __call__(self, done, every):
        self.told.append(done)
        if (done, every) == (FREE, len(PERIODS)):
            self.killed, self.other = self.cluster.filled(2)
            waited_for(lambda: {self.killed.pid, self.other.pid} <= set(self.under_way().values()))
            self.cluster.kill(self.killed)
            self.left = [case for case, process in self.under_way().items() if process == self.killed.pid]
            (self.folder / "gate").touch()

    def under_way(self):
        """Number of the process by case."""
        return {case: int(process) for case, process in (file.name.split("-") for file in self.folder.glob("*-*"))}


def test_a_cluster_without_workers_is_an_error(cluster, monkeypatch):
    """First of all: later there are workers, of which each takes a second or two to start."""
    monkeypatch.setattr("gantrysim.study.cluster._PATIENCE", 1.0)
    cluster.filled(0)
    with pytest.raises(WorkerError, match=f"^no worker at {cluster.address}: must have at least one$"), on(cluster):
        pass


@pytest.mark.soak
def test_a_killed_worker_does_not_change_the_study(cluster, job, tmp_path):
    held_at = tmp_path / "held"
    held_at.mkdir()
    expected = run_study(Sweep(job, measure), tmp_path / "here", workers=1)
    cluster.filled(2)
    kill = Kill(cluster, held_at)
    with on(cluster):
        there = Sweep(job, partial(held, folder=str(held_at), free=PERIODS[FREE - 1]))
        outcome = run_study(there, tmp_path / "there", progress=kill)
    assert len(kill.left) == 1  # a case was under way in the worker that was killed,
    assert (held_at / f"{kill.left[0]}-{kill.other.pid}").exists()  # and the other has done it
    assert outcome.rows == expected.rows
    assert content(tmp_path / "there") == content(tmp_path / "here")
    assert kill.told[: len(PERIODS) + 1] == list(range(len(PERIODS) + 1))


@pytest.mark.soak
def test_tuning_on_a_cluster_with_a_killed_worker_writes_the_same_files(
    cluster, gantrysim_command, tmp_path, monkeypatch
):
    monkeypatch.setattr("gantrysim.study.tuning.report.plots", lambda study, rows: [])  # they take longest
    settings = [part for setting in SHORT for part in ("--set", setting)]
    command = ("tune", "an225", *settings, "--budget", 24, "--robust", 1, "--unseen", 2)
    here, there, killed = tmp_path / "here", tmp_path / "there", []
    expected = gantrysim_command(*command, "--workers", 1, "--out", here)
    assert expected[0] == 0

    def kill(worker):
        waited_for(lambda: spoken(there) >= 2)
        cluster.kill(worker)
        killed.append(spoken(there))

    killing = threading.Thread(target=kill, args=cluster.filled(2)[:1])
    killing.start()
    status, printed, said = gantrysim_command(*command, "--backend", f"dask={cluster.address}", "--out", there)
    killing.join()
    assert (status, said) == (0, expected[2].replace(str(here), str(there)))
    assert printed.endswith(f"page: {there / 'report.html'}\n")
    assert content(there) == content(here)
    cases = len((here / "study.csv").read_text().splitlines()) - 1
    assert 2 <= killed[0] < cases


def test_a_study_command_on_a_cluster_writes_the_same_files(cluster, gantrysim_command, tmp_path):
    command = ("study", "circle", "--radius", 10, "--speed", 80)
    cluster.filled(2)
    printed = []
    for place, where_to in {"here": ("--workers", 1), "there": ("--backend", f"dask={cluster.address}")}.items():
        status, output, said = gantrysim_command(*command, *where_to, "--out", tmp_path / place)
        assert (status, said) == (0, "")
        printed.append("".join(output.split()).replace(f"{tmp_path / place}", ""))
    # the folder's name sets where lines break
    assert printed[0] == printed[1]
    assert content(tmp_path / "there") == content(tmp_path / "here")


def test_cases_that_are_measured_together_on_a_cluster(cluster, job):
    cases = [*cases_of(job, PERIODS[:5]), Case.of(job, {"program.turns": 9}, value=0.0)]  # the last one is refused
    cluster.filled(2)
    with on(cluster):
        assert rows_of(cases, measure_together=all_of) == rows_of(cases, workers=1)


def test_a_cluster_runs_as_many_cases_at_once_as_it_has_threads_or_as_asked_for(cluster, job, tmp_path):
    cluster.filled(2)
    with on(cluster):
        rows = rows_of(cases_of(job, PERIODS[:2]), measure=partial(company, folder=tmp_path, patience=PATIENCE))
        assert [row["most"] for row in rows] == [2, 2]
        alone = partial(company, folder=tmp_path, patience=0.3)
        rows = rows_of(cases_of(job, PERIODS[:4]), measure=alone, workers=1)
        assert [row["most"] for row in rows] == [1] * 4
        assert all(row["process"] != os.getpid() for row in rows_of(cases_of(job), measure=where, workers=1))


@pytest.mark.soak
def test_the_one_thread_of_a_cluster_is_used(cluster, job):
    (worker,) = cluster.filled(1)
    with on(cluster):
        assert [row["process"] for row in rows_of(cases_of(job), measure=where)] == [worker.pid] * 4


def test_the_address_of_a_worker_is_refused_as_scheduler(cluster):
    from distributed import Client

    cluster.filled(2)
    with Client(cluster.address, timeout=PATIENCE, set_as_default=False) as client:
        worker, _ = client.scheduler_info(n_workers=-1)["workers"]
    text = f"^--backend dask={worker}: no scheduler answers: a Worker does$"
    with pytest.raises(InputError, match=text), on_backend(f"dask={worker}"):
        pass


@pytest.mark.soak
def test_an_interrupted_study_releases_the_cluster_and_resumes(cluster, job, tmp_path):
    held_at = tmp_path / "held"
    held_at.mkdir()
    study = Sweep(job, partial(held, folder=str(held_at), free=PERIODS[FREE - 1]))
    workers = cluster.filled(2)

    def interrupt(done, every):
        if done == FREE:
            waited_for(lambda: len(list(held_at.iterdir())) == 2)
            raise KeyboardInterrupt

    with pytest.raises(StudyInterrupted) as interrupted, on(cluster):
        run_study(study, tmp_path / "there", progress=interrupt)
    assert interrupted.value.done == FREE
    waited_for(lambda: cluster.count("tasks") == 0)
    (held_at / "gate").touch()
    with on(cluster):
        outcome = run_study(study, tmp_path / "there")
    assert outcome.resumed == FREE
    assert [worker.poll() for worker in workers] == [None, None]
    assert outcome.rows == run_study(Sweep(job, measure), tmp_path / "here", workers=1).rows
    assert content(tmp_path / "there") == content(tmp_path / "here")


def test_an_error_in_a_case_is_raised_by_the_study(cluster, job):
    cluster.filled(2)
    with on(cluster):
        with pytest.raises(ZeroDivisionError, match="in the case"):
            rows_of(cases_of(job, PERIODS), measure=broken)
        waited_for(lambda: cluster.count("tasks") == 0)  # the rest is taken back


def test_a_worker_with_another_machine_is_refused(cluster, tmp_path, monkeypatch):
    cluster.filled(2)
    file = tmp_path / "rigid.xml"

    def rows(**changes):
        file.write_text(RIGID.format(**{**RIGID_DEFAULTS, **changes}))
        forget_jobs()  # as at the begin of a study
        cases = cases_of(Job.load("an225", SHORT, str(file)), PERIODS[:4])
        with on(cluster):
            there = rows_of(cases)
        assert there == rows_of(cases, workers=1)
        assert [row["status"] for row in there] == ["ok"] * 4
        return there

    assert rows() != rows(damping=30.0)  # the workers still have the first
    asked = Origin.here

    def changed(cases):
        origin = asked(cases)
        file.unlink()  # as on a host that has no such file
        return origin

    monkeypatch.setattr(Origin, "here", changed)
    with pytest.raises(WorkerError, match=rf"^worker on .*, process \d+: machine {file} differs from the study's: "):
        rows(damping=50.0)


@pytest.mark.soak
def test_a_worker_with_another_version_is_refused(cluster, gantrysim_command, tmp_path):
    (tmp_path / "scipy-0.0.9.dist-info").mkdir()
    (tmp_path / "scipy-0.0.9.dist-info" / "METADATA").write_text("Name: scipy\nVersion: 0.0.9\n")
    with cluster.odd_one(tmp_path):
        command = ("study", "circle", "--radius", 10, "--speed", 80, "--out", tmp_path / "out")
        status, printed, said = gantrysim_command(*command, "--backend", f"dask={cluster.address}")
    assert (status, printed) == (2, "")
    assert f": has scipy 0.0.9 instead of {version('scipy')}: must have the study's\n" in said
    assert said.startswith("error: worker on ")
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.soak
def test_a_worker_that_lacks_gantrysim_is_refused(cluster, job, tmp_path):
    with cluster.odd_one(without_gantrysim(tmp_path)), on(cluster), pytest.raises(WorkerError) as refused:
        rows_of(cases_of(job))
    reason = "ModuleNotFoundError: No module named 'gantrysim.study'"
    assert str(refused.value) == f"a worker cannot read its cases: {reason}: must have all that the study has"


@pytest.mark.soak
def test_a_case_that_ends_its_workers_ends_the_study(cluster, job):
    workers = cluster.filled(2)
    with on(cluster), pytest.raises(WorkerError, match=r"^2 workers ended at the same case, the last at tcp://"):
        rows_of(cases_of(job)[:1], measure=deadly)
    assert [worker.wait(PATIENCE) for worker in workers] == [-9, -9]


def test_a_lost_scheduler_is_an_error(cluster, job, monkeypatch):
    pytest.importorskip("distributed")
    # until it is seen that the scheduler has ended
    monkeypatch.setattr("gantrysim.study.cluster._PATIENCE", 1.0)
    cluster.filled(2)

    def end(done, every):
        if done == 1:
            cluster.kill(cluster.scheduler)

    logged = []
    log = logging.Handler()
    log.emit = logged.append
    monkeypatch.setattr(logging.getLogger("distributed.client"), "handlers", [log])
    with on(cluster), pytest.raises(WorkerError, match=f"^lost the scheduler at {cluster.address}$"):
        rows_of(cases_of(job), measure=where, progress=end)
    assert logged == []  # the error says it
