"""Names of an MJCF's own, and notes on a machine at rest."""

import numpy as np
import pytest

from gantrysim import InputError, Job, Machine, simulate
from gantrysim.machine.checks import notes

from support.mechanisms import COREXY
from support.runs import plain, ramp

MACHINE = """
<mujoco>
  <size nuser_jnt="1" nuser_sensor="1"/>
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.00025" integrator="Euler" gravity="0 0 0"/>
  <worldbody>
    <body name="bed">
      <geom name="plate" type="box" size="0.3 0.3 0.01" pos="0 0 -0.0105"/>
      <camera name="aimed" mode="targetbody" target="bed" pos="1 1 1"/>
    </body>
    <body name="beam">
      <joint name="slide_y" type="slide" axis="0 1 0" range="-0.2 0.2" damping="5"/>
      <geom name="block" type="box" size="0.02 0.02 0.02" pos="0 0.1 0.2" mass="2"/>
      <body name="head">
        <joint name="slide_x" type="slide" axis="1 0 0" range="-0.2 0.2" damping="5"/>
        <geom size="0.01" pos="0 0 0.1" mass="1"/>
        <geom name="tube" type="cylinder" fromto="0 0 0 0 0 0.03" size="0.0004" mass="0" contype="0" conaffinity="0"/>
        <site name="tip"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="motor_x" joint="slide_x" gear="628" ctrlrange="-1 1"/>
    <motor name="motor_y" joint="slide_y" gear="628" ctrlrange="-1 1"/>
  </actuator>
  <sensor>
    <actuatorpos name="encoder_x" actuator="motor_x" user="10000"/>
    <jointvel name="rate" joint="slide_x"/>
    <framepos name="where" objtype="site" objname="tip" reftype="body" refname="bed"/>
  </sensor>
</mujoco>
"""
NAMES = {"nozzle": "tip", "work": "bed", "needle": "tube", "x": "motor_x", "y": "motor_y"}


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "own.xml"
    path.write_text(MACHINE)
    return path


def test_a_machine_with_names_of_its_own_runs(file):
    machine = Machine(file, NAMES)
    assert machine.axis_names == ("x", "y")
    assert machine.axes[0].resolution == pytest.approx(2e3 * np.pi / 628 / 10000)  # its encoder took the name too
    assert machine.needle == pytest.approx((0.8, 30.0))
    run = simulate(machine, plain(machine), ramp(100.0))
    assert run.fault is None
    assert np.abs(run.nozzle - run.commanded_tip)[700:].max() < 0.02  # the ramp starts with a jerk
    with pytest.raises(InputError, match=r"""has no joint named 'motor_x'; .*: names = \{ x = "motor_x" \}$"""):
        Machine(file, {"nozzle": "tip", "work": "bed"})
    with pytest.raises(InputError, match=r'has no site .* map its name in the job: names = \{ nozzle = "..." \}$'):
        Machine(file)


def test_a_job_gives_the_names(file, tmp_path):
    names = ", ".join(f'{new} = "{old}"' for new, old in NAMES.items())
    (tmp_path / "job.toml").write_text(
        f'name = "own"\nmachine = "own.xml"\nnames = {{ {names} }}\n[program]\ncontroller = "trio.MoveSpiral"\n'
        "diameter = 60.0\nthickness = 10.0\nturns = 1\nspeed = 100.0\n"
    )
    job = Job.load(tmp_path / "job.toml")
    assert job.built_machine.axis_names == ("x", "y")
    (tmp_path / "again.toml").write_text(job.toml())
    assert Job.load(tmp_path / "again.toml").names == NAMES
    assert "names" not in Job.load("an225").toml()


@pytest.mark.parametrize(
    ("names", "text"),
    [
        ({"nozzle": "tp"}, "names.nozzle: unknown site 'tp': did you mean tip"),
        ({"x": "slide_x"}, "names.x: unknown actuator 'slide_x'"),
        ({"work": "bed", "nozzle": "tip", "motor_y": "motor_x"}, "names.motor_y: .*another actuator 'motor_y'"),
    ],
)
def test_names_that_the_mjcf_lacks_or_has_twice(file, names, text):
    with pytest.raises(InputError, match=text):
        Machine(file, names)


def test_an_element_without_any_name_cannot_be_named(file):
    text = MACHINE.replace('<framepos name="where" objtype="site" objname="tip" reftype="body" refname="bed"/>', "")
    file.write_text(text.replace(' name="tip"', ""))
    with pytest.raises(
        InputError, match=r'names.nozzle: the MJCF names no site: add <site name="tip"/>, or a name to one'
    ):
        Machine(file, NAMES)


def test_a_joint_in_a_tendon_keeps_its_name(tmp_path):
    (tmp_path / "corexy.xml").write_text(COREXY)
    with pytest.raises(InputError, match=r"names.left: joint 'a' is part of tendon 'belt_a': rename joint"):
        Machine(tmp_path / "corexy.xml", {"left": "a"})


def test_contacts_at_rest_and_a_nozzle_without_work_are_noted(file):
    (friction,) = notes(Machine(file, NAMES))
    assert friction.startswith("machine own: no dry friction on x, y:")
    file.write_text(MACHINE.replace('pos="0 0.1 0.2" mass', 'pos="0 0.1 0.015" mass'))
    (touch,) = {text.partition(", by")[0] for text in notes(Machine(file, NAMES))[:-1]}
    assert touch == "machine own: geom 'plate' and geom 'block' touch with all axes at zero"
    balls = "".join(f'<body pos="{0.021 * k} 9 9"><freejoint/><geom size="0.05"/></body>' for k in range(20))
    file.write_text(MACHINE.replace("<worldbody>", f"<worldbody>{balls}", 1))
    *pairs, many, _ = notes(Machine(file, NAMES))
    assert len(pairs) == 3
    assert many.startswith("machine own: 70 pairs of geoms touch with all axes at zero, of which the 3 deepest")
    file.write_text(MACHINE.replace('pos="0 0 -0.0105"', 'pos="0 0 -0.03"'))
    far, _ = notes(Machine(file, NAMES))
    assert "the nozzle is 20 mm above its work with all axes at zero: lower" in far
    file.write_text(MACHINE.replace('pos="0 0 -0.0105"', 'pos="1 0 -0.0105"'))
    none, _ = notes(Machine(file, NAMES))
    assert "no geom of body 'work' lies below the nozzle" in none
    for name in ("xy", "xyzr", "stage", "delta"):
        assert notes(Machine(name)) == ()


@pytest.mark.parametrize(
    ("middle", "where"), [(-0.01, "on the surface of"), (-0.005, "5 mm inside"), (0.002, "12 mm inside")]
)
def test_a_nozzle_on_or_in_its_work_is_not_as_far_above_it_as_the_work_is_thick(file, middle, where):
    """A plate 20 mm thick: from its surface, or from inside, the next face below is its lower one."""
    file.write_text(MACHINE.replace('pos="0 0 -0.0105"', f'pos="0 0 {middle}"'))
    machine = Machine(file, NAMES)
    assert machine.gap == 0.5
    text, _ = notes(machine)
    assert f"the nozzle is {where} its work with all axes at zero: a gap of 0.5 mm is assumed" in text


def test_a_nozzle_a_hundredth_above_its_work_keeps_that_gap(file):
    file.write_text(MACHINE.replace('pos="0 0 -0.0105"', 'pos="0 0 -0.01001"'))
    machine = Machine(file, NAMES)
    assert machine.gap == pytest.approx(0.01)
    assert len(notes(machine)) == 1


@pytest.mark.parametrize(("rotor", "is_noted"), [("", True), (' armature="2e-5"', False)])
def test_a_dc_motor_without_a_rotor_is_noted(tmp_path, rotor, is_noted):
    """With a rotor of J the load of m on a screw of gear g is accelerated by a = g T / (m + g² J)."""
    motor = f'input="ff" controller="0 0 0 0 0 48" motorconst="0.1" resistance="1" gear="1000"{rotor}'
    work = '<body name="work"><geom type="box" pos="0 0 -0.0105" size="0.1 0.1 0.01" contype="0"/></body>'
    (tmp_path / "slide.xml").write_text(
        f"""<mujoco><worldbody>{work}
        <body><joint name="x" type="slide" axis="1 0 0" range="-0.1 0.1" frictionloss="2"/><site name="nozzle"/>
        <geom type="box" pos="0 0 0.1" size="0.02 0.02 0.02" mass="3" contype="0"/></body></worldbody>
        <actuator><dcmotor name="x" joint="x" {motor}/></actuator></mujoco>"""
    )
    machine = Machine(tmp_path / "slide.xml")
    assert ["no rotor inertia on x" in text for text in notes(machine)] == [True] * is_noted
    inertia = 3 / 1000**2 + (0.0 if is_noted else 2e-5)
    assert machine.axes[0].inertia == pytest.approx(inertia, rel=1e-6)
