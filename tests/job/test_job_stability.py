"""A job with a servo of small margin says so, and one with an unstable servo is refused unless it is allowed."""

import re

import numpy as np
import pytest

from gantrysim import InputError, Job
from gantrysim.cli.tables import outcome_table
from gantrysim.metrics.analysis import Analysis
from gantrysim.servo.stability.margins import margins_of

SHORT = ("diameter=40", "turns=1")


# the servo's PID without its notch, which the derived gains of xyz need
STIFF = """def pid(tick, state, torque):
    for a in range(tick.axes):
        kp, ki, kd = tick.gains[a, :3]
        integral, last = state[2 * a : 2 * a + 2]
        integral += tick.period * tick.error[a]
        torque[a] = kp * tick.error[a] + ki * integral + kd * (tick.error[a] - last) / tick.period
        state[2 * a : 2 * a + 2] = integral, tick.error[a]
"""
LAW = "def backwards(tick, state, torque):\n    for a in range(tick.axes):\n        torque[a] = -tick.error[a]\n"


def with_gains(factor, *more):
    """The spiral of one turn with kp and kd of y times a factor."""
    servo = Job.load("an225", SHORT).built_servo
    gains = [f"servo.{name}={np.multiply(servo.per_axis(name), (1, factor)).tolist()}" for name in ("kp", "kd")]
    return Job.load("an225", (*SHORT, *gains, *more))


def edge():
    job = Job.load("an225", SHORT)
    return margins_of(job.built_machine, job.built_servo)[1].gain


def text_of(table):
    return " ".join(cell for column in table.columns for cell in column.cells)


@pytest.mark.parametrize(("margin", "noted"), [(1.6, False), (1.4, True), (1.05, True)])
def test_a_margin_below_one_and_a_half_is_a_note_in_table_and_summary(margin, noted):
    job = with_gains(edge() / margin)
    run = job.run()
    notes = [note for note in job.notes if note.startswith("servo: y is gain 1.")]
    assert bool(notes) is noted
    shown = text_of(outcome_table(Analysis(run), None, job.margins))
    assert f"{margin:.2f}" in shown
    assert ("low, below 1.5" in shown) is noted


def test_an_unstable_servo_is_refused_unless_it_is_allowed():
    job = with_gains(1.1 * edge())
    line = "^servo on machine xy: y is unstable, stable with its gains times 0.91: change kp, kd, or leave out what is"
    with pytest.raises(InputError, match=line):
        job.run()
    assert with_gains(1.1 * edge(), "allow_unstable=true").run().time.size > 0


@pytest.mark.parametrize(
    ("change", "advice"),
    [
        (["frequency=200.0"], "change frequency, or leave out what is given to have it derived"),
        (["servo.law='{law}:backwards'"], "change the law, or give lower gains"),
    ],
)
def test_a_refusal_advises_to_leave_out_what_is_given_and_nothing_else(change, advice, tmp_path):
    (tmp_path / "turned.py").write_text(LAW)
    job = Job.load("an225", (*SHORT, *(one.format(law=tmp_path / "turned.py") for one in change)))
    with pytest.raises(InputError, match=f": {advice}, or set simulation.allow_unstable = true") as caught:
        job.run()
    assert ("derived" in str(caught.value)) is (change[0].startswith("frequency"))


@pytest.mark.parametrize("given", [(), ("servo.frequency=35.0",)], ids=["derived", "given"])
def test_a_refusal_of_ones_own_law_names_a_lower_frequency_that_keeps_a_margin(given, tmp_path):
    (tmp_path / "stiff.py").write_text(STIFF)
    settings = (*SHORT, "machine=xyz", f"servo.law='{tmp_path / 'stiff.py'}:pid'")
    with pytest.raises(
        InputError, match=r": set servo\.frequency = \d+, with which every gain margin is at l"
    ) as caught:
        Job.load("an225", (*settings, *given)).run()
    frequency = float(re.search(r"servo\.frequency = (\d+)", str(caught.value))[1])
    least = [
        min(margin.least_gain if margin.stable else 1.0 for margin in Job.load("an225", (*settings, setting)).margins)
        for setting in (f"servo.frequency={frequency}", f"servo.frequency={1.5 * frequency}")
    ]
    assert least[0] >= 1.5 > least[1]


@pytest.mark.soak
def test_a_job_without_a_loop_of_enough_margin_is_refused_with_what_has_one():
    """Nothing of its servo's gains is given, so none can be left out to have it derived."""
    with pytest.raises(InputError, match=r"use integral_time = .* each tried") as caught:
        Job.load("delta-arc", ["servo.feedback='load'"]).run()
    assert "derived" not in str(caught.value)


def test_the_command_refuses_an_unstable_servo_with_status_2(gantrysim_command, tmp_path):
    gains = ["--set", "kp=5.0", "--set", "kd=0.02"]
    status, _, errors = gantrysim_command("run", "an225", *gains, "--out", tmp_path / "out")
    assert status == 2
    assert "unstable" in errors
    assert not (tmp_path / "out").exists()


def test_gains_of_ones_own_are_said_to_be_given():
    assert with_gains(1.0).servo_reason == "kp, kd as given"
    assert Job.load("an225").servo_reason.startswith("natural frequency 26.9 Hz: the lags of sampling")
