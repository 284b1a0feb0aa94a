"""A gain is one field of `Gains` and one term of the law."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import gantrysim
from gantrysim.machine.machine import Machine
from gantrysim.servo.gains import GAIN_NAMES, GAINS, Gains
from gantrysim.servo.laws.p_pi import without_term
from gantrysim.servo.request import DERIVED_VALUES
from gantrysim.servo.servo import Servo

FIELD = '    kx: Annotated[float, "N·m/u", "torque per following error, once more"] = 0.0\n'

# What is asked of the package with the gain: half of kp as kx is the whole of kp.
ASKED = """
import numpy as np
from gantrysim import Job
from gantrysim.base.errors import InputError
from gantrysim.exchange.gains import DIALECTS, export_gains, import_gains
from gantrysim.servo.servo import Servo

plain = ["servo.notch_frequency=0", "servo.ki=0", "servo.feedforward=0"]
job = Job.load("softmc-arc", ["servo.kp=[0.5, 0.25]", "servo.kd=0.005", *plain])
split = job.changed({"servo.kp": [0.25, 0.125], "servo.kx": [0.25, 0.125]})
assert np.array_equal(split.run().torque, job.run().torque)
assert split.margins == job.margins
axes = split.built_machine.axes
for name in DIALECTS:
    try:
        export_gains(name, axes, split.built_servo)
    except InputError as refusal:
        assert f"{name} has no parameter for kx (x 0.25, y 0.125)" in str(refusal), refusal
        assert "--set servo.kx=0" in str(refusal), refusal
    else:
        raise AssertionError(name)
    text, _ = export_gains(name, axes, job.built_servo)
    assert import_gains(name, text, axes, job.built_servo).per_axis("kx") == (0.0, 0.0)
try:
    Servo.derive(axes, law="p-pi", kx=0.5)
except InputError as refusal:
    assert str(refusal) == "kx = 0.5: has no effect in law 'p-pi'; use 'pid'", refusal
else:
    raise AssertionError("p-pi")
"""


@pytest.mark.soak
def test_a_gain_is_added_by_its_field_and_its_term(tmp_path):
    """In a copy of the package, compiled anew: the job file, the tick, the margins and the exports know the gain."""
    package = tmp_path / "gantrysim"
    shutil.copytree(Path(gantrysim.__file__).parent, package, ignore=shutil.ignore_patterns("*.tmp*", "*.pyc*"))
    gains, law = package / "servo" / "gains.py", package / "servo" / "laws" / "pid.py"
    _insert(gains, "    output_velocity: Annotated", FIELD, after=True)
    _insert(law, "        + gains.ki * error_sum", "        + gains.kx * error\n", after=False)
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    asked = subprocess.run(
        [sys.executable, "-c", ASKED], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert asked.returncode == 0, asked.stderr


def _insert(file: Path, line: str, text: str, *, after: bool) -> None:
    lines = file.read_text().splitlines(keepends=True)
    (place,) = (number for number, content in enumerate(lines) if content.startswith(line))
    lines.insert(place + after, text)
    file.write_text("".join(lines))


def test_every_list_of_gains_follows_from_the_fields():
    assert [gain.name for gain in GAINS] == list(Gains._fields) == list(GAIN_NAMES)
    assert all(gain.unit and gain.meaning for gain in GAINS)
    assert DERIVED_VALUES[: len(GAINS)] == GAINS
    assert GAINS[0] == ("kp", "N·m/u", "torque per following error")


def test_a_servo_gives_the_gains_of_each_axis():
    servo = Servo.derive(Machine("xy").axes, kp=[1.0, 2.0], kd=0.25, frequency=10.0)
    assert [gains.kp for gains in servo.gains] == [1.0, 2.0]
    assert [gains.kd for gains in servo.gains] == [0.25, 0.25]
    assert [gains.acceleration_ff for gains in servo.gains] == list(servo.per_axis("acceleration_ff"))


def test_p_pi_has_a_term_for_every_gain():
    assert without_term(Gains(*(1.0 for _ in GAIN_NAMES))) == ()
