"""Every proposal, used as a stranger does: its lines, pasted, give the verdict that was printed, row by row."""

from functools import cache
from pathlib import Path

import pytest

from gantrysim import Job
from gantrysim.job.loading import builtin_jobs
from gantrysim.remedy.improve import improve

from support.pasting import checked_values, in_job_file, verdict_of, with_options

ROOT = Path(__file__).parent.parent.parent
QUICK = ("fanuc-conical", "softmc-arc", "svg-gasket", "seal.ngc", "zigzag.ngc")
PARTS = sorted([*(ROOT / "examples").glob("*.ngc"), *(ROOT / "tests" / "job" / "parts").iterdir()])
PROGRAMS = {**{name: name for name in builtin_jobs()}, **{part.name: part for part in PARTS}}
EVERY = [name if name in QUICK else pytest.param(name, marks=pytest.mark.soak) for name in PROGRAMS]


@cache
def proposal(name):
    return improve(Job.load(PROGRAMS[name]))


def same_values(verdict, promised):
    rows = checked_values(verdict)
    wanted = checked_values(promised)
    assert [row[:2] for row in rows] == [row[:2] for row in wanted]
    for (_, _, checks), (_, _, others) in zip(rows, wanted, strict=True):
        assert [check[:2] for check in checks] == [check[:2] for check in others]
        for check, other in zip(checks, others, strict=True):
            assert check[2:] == pytest.approx(other[2:], rel=1e-6, abs=1e-9, nan_ok=True)


@pytest.mark.parametrize("name", EVERY)
def test_pasted_options_keep_the_promise(name):
    result = proposal(name)
    lines = result.lines.get("command line")
    if lines is None:
        # a text that differs in more than speeds is no option
        assert not result.changes_anything or "program" in result.lines["job file"]
        return
    job = with_options(PROGRAMS[name], lines)
    assert (job.dispenser, job.bead, job.travel) == (result.job.dispenser, result.job.bead, result.job.travel)
    same_values(verdict_of(job), result.improved)


@pytest.mark.parametrize("name", EVERY)
def test_lines_in_the_job_file_keep_the_promise(name, tmp_path):
    result = proposal(name)
    if not result.changes_anything:
        return
    job = in_job_file(PROGRAMS[name], result.lines["job file"], tmp_path)
    same_values(verdict_of(job), result.improved)


@pytest.mark.parametrize("name", EVERY)
def test_the_applied_job_keeps_the_promise(name, tmp_path):
    result = proposal(name)
    file = tmp_path / "better.toml"
    file.write_text(result.job.toml())
    same_values(verdict_of(Job.load(file)), result.improved)
