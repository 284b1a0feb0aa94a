"""What to change in small jobs: each lever where it must help and where it must not, and the result as a whole."""

import tomllib
from functools import cache

import gantrysim
from gantrysim import Job, Verdict
from gantrysim.remedy.improve import LEVERS, improve
from gantrysim.remedy.lever import State
from gantrysim.remedy.outcome import measured
from gantrysim.remedy.score import usage_of

# three sides of a rectangle: two corners, where the speed falls
SIDES = """G21 G17 G90 G94 G64 P0.02
G0 X0 Y0
M62 P0
G1 X40 F6000
G1 X40 Y30
G1 X0 Y30
M63 P0
M2
"""
LAG = {"dead_time": 0.005, "opening": 0.02, "closing": 0.02}
BY_NAME = {lever.name: lever for lever in LEVERS}


def job_of(text=SIDES, machine="xy", **tables):
    content = {
        "name": "sides",
        "machine": machine,
        "program": {
            "controller": "linuxcnc.Program",
            "text": text,
            "dispense": {"by": "codes", "on": ["M62"], "off": ["M63"]},
        },
        "dispenser": {"flow": 200.0, **LAG},
        "simulation": {"settle": 0.1},
        **tables,
    }
    return Job.of_content(content, "job sides")


@cache
def lagging():
    return job_of()


@cache
def improved():
    return improve(lagging(), workers=1)


def settings_of(name, job):
    return BY_NAME[name].settings(State(job, measured))


def usages_with(name, job, row):
    """The usage of a row of the job as it is, and with each setting of a lever."""
    before = usage_of(measured(job).verdict[row])
    settings = settings_of(name, job)
    assert not isinstance(settings, str), settings
    outcomes = [measured(job.changed(setting.changes)) for setting in settings]
    return before, [usage_of(outcome.verdict[row]) for outcome in outcomes if not outcome.failure]


def test_improve_is_public():
    assert gantrysim.improve is improve


def test_the_improved_job_has_the_verdict_that_is_promised():
    result = improved()
    job = Job.of_content(tomllib.loads(result.job.toml()), "job improved")
    assert str(Verdict.of(job, job.run())) == str(result.improved)
    assert result.after.burden < result.before.burden
