"""Every proposal, used as a stranger does: its lines, pasted, give the verdict that was printed, row by row."""

import json
import shlex
from functools import cache
from pathlib import Path

import pytest

from gantrysim import InputError, Job
from gantrysim.job.loading import builtin_jobs
from gantrysim.remedy.improve import improve

from support.pasting import checked_values, in_job_file, verdict_of, with_options
from support.soaked import suite_runs

ROOT = Path(__file__).parent.parent.parent
QUICK = ("softmc-arc", "svg-gasket")
PARTS = sorted([*(ROOT / "examples").glob("*.ngc"), *(ROOT / "tests" / "job" / "parts").iterdir()])
PROGRAMS = {**{name: name for name in builtin_jobs()}, **{part.name: part for part in PARTS}}
EVERY = [name if name in QUICK else pytest.param(name, marks=pytest.mark.soak) for name in PROGRAMS]


@cache
def proposal(name, *options):
    return improve(Job.load(PROGRAMS[name], options))


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


FANUC = "O1\nG21 G17 G90 G94\nG0 X0 Y0\nG1 X40 F3000\nG1 Y30\nG3 X30 Y40 R10\nG1 X0\nM30\n"
JUMPING = "program.acceleration=inf"  # which no drive can follow
SLOW_VALVE = "dispenser.opening=0.08"  # with which the glue of the parts fails
# file name and text, or a name alone; options of the command; and the levers to try
GIVEN = {
    "a value": ("softmc-arc", None, {"options": ["dispenser.opening=0.03"]}, None),
    "a speed": ("seal.ngc", None, {"options": [SLOW_VALVE], "speed": 40.0}, ["acceleration", "slower"]),
    "a place": (
        "seal.ngc",
        None,
        {"options": [SLOW_VALVE], "placement": {"x": -100.0, "y": -50.0, "z": -0.4}},
        ["acceleration", "needle height"],
    ),
    "a needle's height": ("seal.ngc", None, {"options": [SLOW_VALVE, "bead.gap=0.7"]}, ["needle height", "slower"]),
    "a controller": ("part.txt", FANUC, {"options": [JUMPING], "controller": "fanuc"}, ["acceleration", "slower"]),
    "a text with speeds": ("part.nc", FANUC, {"options": ["machine=xyz", JUMPING]}, ["slower"]),
    "glue": ("zigzag.ngc", None, {"options": [SLOW_VALVE, "dispenser.flow=20"]}, ["flow by speed", "slower"]),
}


# a value, and a text in the line
@pytest.mark.parametrize("name", suite_runs(list(GIVEN), 0))
def test_lines_beside_options_keep_the_promise(name, tmp_path):
    file, text, given, levers = GIVEN[name]
    program = PROGRAMS.get(file, tmp_path / file)
    if text is not None:
        program.write_text(text)
    arguments = {key: value for key, value in given.items() if key != "options"}
    result = improve(Job.load(program, given.get("options", ()), **arguments), levers=levers, fastest=False)
    assert result.changes_anything
    pasted = with_options(program, result.lines["command line"], given.get("options", ()), **arguments)
    same_values(verdict_of(pasted), result.improved)
    same_values(verdict_of(in_job_file(program, result.lines["job file"], tmp_path)), result.improved)


def test_a_file_beside_a_text_is_refused(tmp_path):
    """Lines with a text take the place of the table that names the file."""
    (tmp_path / "part.nc").write_text(FANUC)
    job = tmp_path / "mine.toml"
    job.write_text(f'name = "mine"\n[program]\nfile = "part.nc"\nprogram = """\n{FANUC}"""\n')
    with pytest.raises(InputError, match=r"program.file = 'part.nc' and program.program: must be one of the two"):
        Job.load(job)


def test_a_job_file_that_names_a_program_keeps_the_promise(tmp_path):
    (tmp_path / "part.nc").write_text(FANUC)
    job = tmp_path / "mine.toml"
    job.write_text(
        'name = "mine"\nmachine = "xyz"\n[program]\nfile = "part.nc"\nacceleration = inf\n'
        "[dispenser]\narea = 1.0\nopening = 0.02\n"
    )
    result = improve(Job.load(job), levers=["slower", "lag compensation"], fastest=False)
    assert result.changes_anything
    same_values(verdict_of(in_job_file(job, result.lines["job file"], tmp_path)), result.improved)
    same_values(verdict_of(with_options(job, result.lines["command line"])), result.improved)


@pytest.mark.parametrize(("name", "options"), suite_runs([("softmc-arc", ()), ("seal.ngc", ("--set", SLOW_VALVE))], 0))
def test_the_printed_options_are_run_by_the_command(name, options, gantrysim_command, tmp_path):
    """As they are printed by one command, so they are typed behind the next one."""
    status, printed, _ = gantrysim_command("improve", PROGRAMS[name], *options)
    assert status == 0
    _, _, lines = printed.partition("# command line\n")
    words = shlex.split(lines.partition("verdict")[0])
    assert words
    quiet = ("--no-video", "--no-report", "--no-causes", "--no-improve")
    status, _, said = gantrysim_command("run", PROGRAMS[name], *options, *words, *quiet, "--out", tmp_path / "out")
    assert (status, said) == (0, "")
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    promised = proposal(name, *options[1:]).improved.content()
    assert summary["verdict"] == json.loads(json.dumps(promised))
