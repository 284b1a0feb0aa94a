"""Every common error of a log is named, and ends in "not identified"; healthy logs are not hit.

The logs are those of the independent simulator, each spoiled by one error. `scripts/spoiled_logs.py` tries all errors
on many axes.
"""

import re

import pytest

from gantrysim.identify.checks.finding import NotIdentifiedError
from gantrysim.identify.checks.units import relation_of
from gantrysim.identify.identification import identify

from support.identification_logs import LAWS, MACHINE, random_log
from support.soaked import suite_runs
from support.spoiled_logs import spoiled

# refused before the fit: what the line says beside the axis
REFUSED = {
    "torque late by 15 samples": r"explains 29 % of its torque, must explain at least 50 %: the torque is 15 ms late",
    "torque early by 15 samples": r"the torque is 15 ms early against the position, shifted by which 99 % are explain",
    "machine of 2.6 times the inertia": r"2\.12 times the drive's peak of 0\.906 N·m: must be at most 1\.2 times;",
    "every tenth row": r"in 3\d % of its motion it reverses within 2 samples of 10 ms: must be at most 25 %",
    "frozen encoder": r"stands still from 2\.012 to 3\.018 s of the log while the torque swings by .* is frozen",
    "position constant throughout": r"the axis hardly moves, by 0 mm: must be at least 0\.2 mm, 200 encoder counts",
    "torque in A": r"must be at most 1\.2 times; .* torque in A \(0\.0302 N·m/A\) read as N·m\?",
    "torque in per mille of rated": r"must be at most 1\.2 times; .* torque in per mille of the rated torque read",
    "torque in mN·m": r"must be at most 1\.2 times; .* torque in mN·m read as N·m\?",
    "torque in kgf·m": r"gives 0\.14 times the inertia .*, must be 0\.2 to 5 times; torque in kgf·m read as N·m\?",
    "position in inches": r"gives 35 times the inertia .*, must be 0\.2 to 5 times; .*position in inches read as mm\?",
    "position in m": r"the axis hardly moves, by 0\.0803 mm: .* position in m read as mm\?",
    "position in µm": r"goes over 80,272 mm, the axis over 300 mm: must be at most 2 times as far; position in µm",
    "position in motor turns": r"position in turns of the motor read as mm\?",
    "clock jump of 20 ms between the columns": r"the torque is 20 ms late against the position",
    "2 % of rows repeated": r"its position jumps by .* samples are missing",
    "0.5 % of rows lost": r"its position jumps by .* samples are missing",
    "columns swapped": r"its columns of torque and position are swapped: read the other way round, .* explain 99 %",
    "torque of the wrong sign": r"accelerates it backwards, with an inertia of -\S+ N·m·s²: must be greater than 0",
    "torque of another axis": r"explain 2 % of its torque, must explain at least 50 %: the torque belongs to ano",
    "torque of an axis at rest": r"explain 1 % of its torque, must explain at least 50 %: the torque belongs to ano",
    "axis at rest": r"the axis hardly moves, by 0\.004 mm",
}

# not identified after the fit: the first reason
DOUBTED = {
    "torque late by two samples (delay below zero)": r"delay = -2(\.\d+)? ms: must be at least 0; the motion is ahead",
    "torque clipped at a third": r"the torque is at its largest, ± 0\.265 N·m, in 35 % of the samples: must be in",
    "position smoothed over 9 samples": r"from 250 to 450 Hz the position has 16 % of the motion .* it is filtered or",
    "counts lost": r"leaves its prediction at once by up to 0\.053 mm, 53 counts, 12 times, .* encoder loses counts",
}
SEED = 1
DOUBTED_SEED = 0  # of an axis that is fitted fast


@pytest.mark.parametrize("name", REFUSED)
def test_a_spoiled_log_is_refused_by_its_error(name):
    with pytest.raises(NotIdentifiedError, match=f"^axis y: .*{REFUSED[name]}"):
        identify(MACHINE, spoiled(name, SEED, LAWS[SEED]))


@pytest.mark.parametrize("name", suite_runs(list(DOUBTED), 0))
def test_a_fit_to_a_spoiled_log_is_not_identified_by_its_error(name):
    identification = identify(MACHINE, spoiled(name, DOUBTED_SEED, LAWS[DOUBTED_SEED]))
    assert not any(value.identified for value in identification.values)
    (line,) = identification.unidentified
    assert line.startswith("axis y: ")
    assert not identification.notes[-1].endswith("holds")
    assert re.search(DOUBTED[name], line), line


@pytest.mark.parametrize("law", LAWS)
def test_acceleration_and_friction_explain_the_torque_of_healthy_logs(law):
    log = random_log(12, law, slip="").log
    relation = relation_of(log.position[:, 0], log.torque[:, 0], log.period)
    assert relation.explained > 0.8
