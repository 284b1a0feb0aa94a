"""What a worker of a study does with its cases, in this process and in those that joblib begins."""

import os
import platform
import re
import threading
from dataclasses import replace

import pytest
from conftest import RIGID, RIGID_DEFAULTS

from gantrysim import Job
from gantrysim.machine.perturbation import Perturbation
from gantrysim.study import Case, Ledger, WorkerError, measure, run_cases
from gantrysim.study import worker as of_worker
from gantrysim.study.cases import forget_jobs
from gantrysim.study.worker import Origin, measured_rows

from support.studies import SHORT, cases_of

NAME = rf"^worker on {re.escape(platform.node())}, process {os.getpid()}: "


@pytest.fixture(scope="module")
def job():
    return Job.load("an225", SHORT)


@pytest.fixture
def model(tmp_path):
    """Writes a machine's file and returns it; keywords replace RIGID_DEFAULTS."""

    def write(**changes):
        file = tmp_path / "rigid.xml"
        file.write_text(RIGID.format(**{**RIGID_DEFAULTS, **changes}))
        return file

    return write


def each(cases):
    return [{"value": case.settings.get("program.loop_period")} for case in cases]


def all_of(cases):
    return [measure(case) for case in cases]


def elsewhere(cases, **changes):
    """The origin of a study on another host."""
    return replace(Origin.here(cases), host="elsewhere", **changes)


def test_cases_are_measured_for_a_study_elsewhere_with_the_same_versions_and_machine(job):
    cases = cases_of(job, (0.02, 0.03))
    keys = [case.key for case in cases]
    assert measured_rows(each, cases, elsewhere(cases)).rows == list(zip(keys, each(cases), strict=True))


@pytest.mark.parametrize(
    "name", ["gantrysim", "mujoco", "numpy", "numba", "scipy", "python", "system", "source files of gantrysim"]
)
def test_another_version_of_a_dependency_is_refused(job, name):
    cases = cases_of(job)
    installed = dict(Origin.here(cases).installed)
    own = installed[name]
    other = elsewhere(cases, installed=tuple({**installed, name: "another"}.items()))
    said = rf"has {name} {own} instead of another: must have the study's$"
    with pytest.raises(WorkerError, match=NAME + said):
        measured_rows(None, cases, other)
    # the study's own process, and one that it has begun as a copy, are as they are
    measured_rows(each, cases, replace(other, host=platform.node()))


def test_a_copy_of_the_study_s_process_needs_no_check(job, monkeypatch):
    cases = cases_of(job)
    other = replace(elsewhere(cases), host=platform.node(), process=os.getppid(), installed=(("scipy", "another"),))
    with pytest.raises(WorkerError):  # begun by it, but not as its copy, as workers of a cluster may be
        measured_rows(each, cases, other)
    monkeypatch.setattr("multiprocessing.current_process", lambda: threading.Thread(name="LokyProcess-1"))
    measured_rows(each, cases, other)
    with pytest.raises(WorkerError):
        measured_rows(each, cases, replace(other, host="elsewhere"))


def test_the_digest_of_the_sources_is_that_of_every_file_that_numbers_come_from(monkeypatch, tmp_path):
    def digest():
        of_worker._installed_versions.cache_clear()
        return dict(of_worker._installed_versions())["source files of gantrysim"]

    for name in ("a.py", "models/xy.xml", "native/tick.py"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(name)
    with monkeypatch.context() as patched:
        patched.setattr(of_worker, "files", lambda package: tmp_path)
        seen = [digest()]
        (tmp_path / "native" / "tick.nbi").write_text("compiled")
        assert digest() == seen[0]
        for name in ("a.py", "models/xy.xml", "native/tick.py"):
            (tmp_path / name).write_text("other")
            seen.append(digest())
        (tmp_path / "native" / "tick.py").rename(tmp_path / "native" / "tock.py")
        seen.append(digest())
    of_worker._installed_versions.cache_clear()
    assert len(set(seen)) == len(seen)


def test_another_machine_than_the_study_s_is_refused(model):
    file = model()
    cases = cases_of(Job.load("an225", SHORT, str(file)))
    origin = elsewhere(cases)
    said = rf"machine {file} differs from the study's: its files must be the same, at the same place, for every worker$"
    for change in (lambda: model(damping=20.0), file.unlink):
        change()
        forget_jobs()
        with pytest.raises(WorkerError, match=NAME + said):
            measured_rows(None, cases, origin)
    missing = elsewhere(cases)
    assert missing.machines == ((str(file), None),)
    model()
    with pytest.raises(WorkerError, match=NAME + said):
        measured_rows(None, cases, missing)


def test_a_machine_whose_file_has_changed_is_built_again(model):
    cases = cases_of(Job.load("an225", SHORT, str(model(damping=20.0))))[:1]
    expected = measured_rows(all_of, cases, elsewhere(cases)).rows
    origin = elsewhere(cases)
    model()
    forget_jobs()
    assert measured_rows(all_of, cases, elsewhere(cases)).rows != expected  # this process has the other one by now
    model(damping=20.0)
    assert measured_rows(all_of, cases, origin).rows == expected


def test_a_refused_machine_is_reported_by_its_cases(job):
    case = Case.of(job, {"machine": "xz"})
    assert Origin.here([case]).machines == (("xz", None),)
    ((_, row),) = measured_rows(all_of, [case], elsewhere([case])).rows
    assert row["status"].startswith("refused: unknown model 'xz'")


def test_every_machine_of_the_cases_is_listed_once_without_perturbations(job):
    cases = [*cases_of(job), Case.of(job, {"machine": "xyz"}), Case.of(job, perturbation=Perturbation(payload=0.2))]
    machines = dict(Origin.here(cases).machines)
    assert list(machines) == ["xy", "xyz"]
    assert machines["xy"] == job.built_machine.digest != machines["xyz"]


def test_loky_s_workers_take_a_machine_s_file_as_it_is_at_the_begin_of_a_study(model, monkeypatch):
    monkeypatch.setattr("joblib._parallel_backends.cpu_count", lambda: 2)
    found = []
    for damping in (12.0, 30.0):
        cases = cases_of(Job.load("an225", SHORT, str(model(damping=damping))))
        forget_jobs()  # as a study does
        with Ledger(None, {}) as ledger:
            found.append(run_cases(cases, ledger, workers=2))
        with Ledger(None, {}) as ledger:
            assert run_cases(cases, ledger, workers=1) == found[-1]
    assert found[0] != found[1]
