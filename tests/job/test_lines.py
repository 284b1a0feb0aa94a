"""When the line of the program that is active at a time of the run is known, and by how much a start lead delays it."""

from types import SimpleNamespace

import numpy as np
import pytest

from gantrysim import Job
from gantrysim.base import memory
from gantrysim.job.basis import program_lines, program_lines_at

TICKS = 1000


def job(period=1e-3, gates=0, start_lead=0.0, settle=0.2):
    """A program of 500 ticks, in which every tenth of a second has a line, after the ticks of a start lead."""
    lead = round(start_lead / period)
    settled = round(settle / period)
    return SimpleNamespace(
        built_servo=SimpleNamespace(period=period),
        setpoints=SimpleNamespace(period=period, gates=np.zeros(gates), position=np.zeros((500 + lead + settled, 2))),
        start_wait=start_lead,
        controller=SimpleNamespace(
            line_at=lambda time: 1 + int(10 * time + 1e-9),
            lines_at=lambda times: 1 + (10 * times + 1e-9).astype(int),
        ),
    )


@pytest.mark.parametrize(
    ("given", "ticks", "known"),
    [
        ({}, TICKS, True),
        ({}, memory.LONG_RUN, True),
        ({}, memory.LONG_RUN + 1, False),
        ({"period": 5e-4}, TICKS, False),
        ({"gates": 1}, TICKS, False),
    ],
)
def test_lines_are_known_of_short_runs_without_waits_at_the_controller_s_period(given, ticks, known):
    times = np.array([0.0, 0.05, 0.25])
    assert program_lines_at(job(**given), ticks, times).tolist() == ([1, 1, 3] if known else [0, 0, 0])
    line_at = program_lines(job(**given), ticks)
    assert [line_at(time) for time in times] == ([1, 1, 3] if known else [None] * 3)


def test_a_start_lead_delays_the_lines():
    times = np.array([0.0, 0.039, 0.041, 0.3])
    early = job(start_lead=0.04)
    assert program_lines_at(early, TICKS, times).tolist() == [0, 0, 1, 3]
    line_at = program_lines(early, TICKS)
    assert [line_at(time) for time in times] == [None, None, 1, 3]


@pytest.mark.parametrize(("lead", "wait"), [(0.0, 0.0), (0.03, 0.0), (0.09, 0.04)])
def test_a_program_waits_for_what_the_start_lead_is_longer_than_the_time_before_its_glue(lead, wait):
    """A FANUC program that rests for 50 ms before its glue."""
    text = "G21 G90\nF3000\nG4 P0.05\nM3\nG1 X20\nM5\nM2"
    program = {"controller": "linuxcnc.Program", "text": text}
    rest = Job(name="rest", program=program, dispenser={"area": 0.5, "start_lead": lead})
    assert rest.start_wait == pytest.approx(wait, abs=1e-9)
    # the rest is in line 3, the motion in line 5
    line_at = program_lines(rest, 100)
    assert (line_at(wait + 0.045), line_at(wait + 0.055)) == (3, 5)
