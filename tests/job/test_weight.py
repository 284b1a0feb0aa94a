"""A weight that nothing balances: how far an axis of a machine of one's own sinks, against its simulation."""

import re

import pytest

from gantrysim import Job, Machine
from gantrysim.machine.checks import notes, weights

GRAVITY = 9.81
MASS = 1.7  # that z carries [kg]
LEAD = 5.0  # of z's screw [mm]
MACHINE = f"""
<mujoco model="own">
  <compiler angle="radian"/>
  <option timestep="0.00025" integrator="Euler" gravity="0 0 -{GRAVITY}"/>
  <worldbody>
    <body name="work"><geom name="plate" type="box" size="0.2 0.2 0.01" pos="0 0 -0.0105" mass="1"/></body>
    <body name="bridge" pos="0 0 0.2">
      <joint name="y" type="slide" axis="0 1 0" range="-0.1 0.1"/>
      <geom type="box" size="0.1 0.01 0.01" mass="2" contype="0" conaffinity="0"/>
      <body name="carriage">
        <joint name="x" type="slide" axis="1 0 0" range="-0.1 0.1"/>
        <geom type="box" size="0.01 0.01 0.01" mass="1" contype="0" conaffinity="0"/>
        <body name="ram">
          <joint name="z" type="slide" axis="0 0 1" range="-0.05 0.05"{{friction}}/>
          <geom type="box" size="0.01 0.01 0.01" mass="{MASS}" contype="0" conaffinity="0"/>
          <site name="nozzle" pos="0 0 -0.2"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="x" joint="x" gear="1256.637" ctrlrange="-2 2" ctrllimited="true"/>
    <motor name="y" joint="y" gear="1256.637" ctrlrange="-2 2" ctrllimited="true"/>
    <motor name="z" joint="z" gear="1256.637" ctrlrange="-2 2" ctrllimited="true"/>
  </actuator>
</mujoco>
"""
JOB = """
name = "sunk"
machine = "own.xml"
[program]
controller = "linuxcnc.Program"
text = '''
F600
G1 X5 Y0 Z0
G4 P1
X10 Z0.1
G4 P1
'''
[servo]
law = "pd"
frequency = 8.0
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "own.xml").write_text(MACHINE.format(friction=""))
    (tmp_path / "job.toml").write_text(JOB)
    return tmp_path


def test_the_torque_of_a_weight_is_m_g_times_the_lead(folder):
    """1256.637 = 2 pi / 5 mm: m g lead / 2 pi at the motor."""
    torque = MASS * GRAVITY / 1256.637
    assert weights(Machine(folder / "own.xml")) == {"z": pytest.approx(torque, rel=1e-9)}
    balanced = MACHINE.replace('<body name="ram">', '<body name="ram" gravcomp="1">').format(friction="")
    (folder / "balanced.xml").write_text(balanced)
    assert weights(Machine(folder / "balanced.xml")) == {}


@pytest.mark.parametrize("law", ["pd", "pid"])
def test_an_axis_without_an_integral_term_sinks_by_its_weight_per_kp(law, folder):
    job = Job.load(folder / "job.toml", [f"servo.law={law!r}", *([] if law == "pd" else ["servo.integral_time=0.05"])])
    run = job.run()
    assert run.fault is None
    left = 1e3 * float((run.commanded - run.encoder)[-1, 2])
    (note,) = [text for text in job.notes if "holds a weight" in text]
    assert note.startswith("machine own: z holds a weight, 0.0133 N·m at its motor: ")
    if law == "pd":
        sunk = 1e3 * MASS * GRAVITY / 1256.637 / job.built_servo.gains[2].kp
        assert left == pytest.approx(sunk, rel=0.01)
        (stated,) = re.findall(r"stays ([\d.]+) µm off its command", note)
        assert float(stated) == pytest.approx(sunk, rel=1e-3)
    else:
        assert abs(left) < 0.01 * 1e3 * MASS * GRAVITY / 1256.637 / job.built_servo.gains[2].kp
        assert "the integral term takes it" in note


def test_axes_without_dry_friction_are_named(folder):
    (note,) = [text for text in notes(Machine(folder / "own.xml")) if "friction" in text]
    assert note.startswith("machine own: no dry friction on x, y, z: errors at reversals")
    (folder / "own.xml").write_text(MACHINE.format(friction=' frictionloss="3"'))
    (note,) = [text for text in notes(Machine(folder / "own.xml")) if "friction" in text]
    assert note.startswith("machine own: no dry friction on x, y: ")
    assert not [text for text in notes(Machine("xyz")) if "friction" in text]


def test_a_weight_that_pulls_up_is_told_by_its_size(folder):
    """As a counterweight that is too heavy does."""
    down = Job.load(folder / "job.toml").notes
    (folder / "own.xml").write_text(MACHINE.format(friction="").replace(f"0 0 -{GRAVITY}", f"0 0 {GRAVITY}"))
    job = Job.load(folder / "job.toml")
    assert weights(job.built_machine)["z"] < 0
    assert job.notes == down
    assert any(
        "holds a weight, 0.0133 N·m at its motor: without an integral term the axis stays " in note for note in down
    )


def test_under_a_velocity_drive_without_an_integral_term_both_gains_hold_the_weight(folder):
    """The position loop asks for kp times the error as a speed, the drive for its gain times that as a torque."""
    velocity = ["servo.law='pid'", "servo.mode='velocity'", "servo.kp=20", "servo.ki=0"]
    job = Job.load(folder / "job.toml", [*velocity, "servo.velocity_time=0"])
    # as with one that takes an hour
    slow = Job.load(folder / "job.toml", [*velocity, "servo.velocity_time=3600"])
    for margins, expected in zip(job.margins, slow.margins, strict=True):
        assert margins.stable
        assert margins.gain == pytest.approx(expected.gain, rel=1e-3)
        assert margins.phase == pytest.approx(expected.phase, abs=0.1)
    run = job.run()
    assert run.fault is None
    gains = job.built_servo
    sunk = 1e3 * MASS * GRAVITY / 1256.637 / (gains.gains[2].kp * gains.drives[2].velocity_gain)
    assert 1e3 * float((run.commanded - run.encoder)[-1, 2]) == pytest.approx(sunk, rel=0.01)
    (note,) = [text for text in job.notes if "holds a weight" in text]
    (stated,) = re.findall(r"stays ([\d.]+) µm off its command", note)
    assert float(stated) == pytest.approx(sunk, rel=1e-3)
