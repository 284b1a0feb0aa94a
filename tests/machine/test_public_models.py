"""Models that were made for other programs: refused in one line whose remedy, when followed, makes a machine.

The MJCFs have the structure of public ones: a point mass on two slides with motors on tendons, a 3D printer whose bed
moves, a crane with a hanging load, a mobile base that turns beside its site.
"""

import re

import numpy as np
import pytest

from gantrysim import InputError, Machine, simulate
from gantrysim.machine.checks import notes

from support.runs import plain, ramp

STAGE = """
<mujoco>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body name="mass" pos="0 0 0.01">
      <joint name="root_x" type="slide" axis="1 0 0" range="-0.3 0.3" damping="1"/>
      <joint name="root_y" type="slide" axis="0 1 0" range="-0.3 0.3" damping="1"/>
      <geom type="sphere" size="0.01" mass="0.3" contype="0"/>
    </body>
  </worldbody>
  <tendon>
    <fixed name="t1"><joint joint="root_x" coef="1"/></fixed>
    <fixed name="t2"><joint joint="root_y" coef="1"/></fixed>
  </tendon>
  <actuator>
    <motor name="t1" tendon="t1"/>
    <motor name="t2" tendon="t2"/>
  </actuator>
</mujoco>
"""
PRINTER = """
<mujoco>
  <option integrator="RK4"/>
  <worldbody>
    <body>
      <geom type="box" size="0.3 0.3 0.01"/>
      <body name="beam" pos="0 -0.02 0.2">
        <joint name="jx" type="slide" axis="1 0 0" range="-0.1 0.1" damping="5"/>
        <geom type="box" size="0.02 0.02 0.03" mass="0.3"/>
        <site name="hot_end" pos="0 0.01 -0.05"/>
      </body>
      <body name="bed" pos="0.03 0 0.05">
        <joint name="jy" type="slide" axis="0 1 0" range="-0.1 0.1" damping="5"/>
        <geom type="box" size="0.1 0.1 0.005" mass="0.5" pos="0 0 0.05"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="px" joint="jx" kp="500" dampratio="1"/>
    <velocity name="py" joint="jy" kv="500"/>
  </actuator>
</mujoco>
"""


def refused(file, text, names):
    """The one line with which a model is refused."""
    file.write_text(text)
    with pytest.raises(InputError) as error:
        Machine(file, names)
    said = str(error.value)
    assert "\n" not in said
    return said


def test_a_stage_with_motors_on_tendons(tmp_path):
    file, text, names = tmp_path / "stage.xml", STAGE, {"work": "world", "x": "t1", "y": "t2"}
    assert "actuator 't1' drives no joint, but 't1': give it joint=" in refused(file, text, names)
    text = text.replace('tendon="t1"', 'joint="root_x"').replace('tendon="t2"', 'joint="root_y"')
    assert "names.x: joint 'root_x' is part of tendon 't1': rename joint and actuator" in refused(file, text, names)
    text = re.sub(r"<tendon>.*</tendon>", "", text, flags=re.S)
    said = refused(file, text, names)
    assert "has no site named 'nozzle', nor any other" in said
    text = text.replace(
        'name="mass" pos="0 0 0.01">', f'name="mass" pos="0 0 0.01">{re.search("<site[^>]*>", said)[0]}'
    )
    said = refused(file, text, names)
    frame = re.search("<body[^>]*>", said)[0]
    assert frame == '<body name="work" pos="0 0 0.01"/>'
    file.write_text(text.replace("<worldbody>", f"<worldbody>{frame}"))
    machine = Machine(file, {"x": "t1", "y": "t2"})
    assert machine.axes[0].travel == pytest.approx((-300, 300))
    assert [axis.inertia for axis in machine.axes] == pytest.approx([0.3e-3] * 2)  # 0.3 kg, torque per mm/s²
    run = simulate(machine, plain(machine), ramp(50.0))
    assert run.fault is None


def test_a_printer_whose_bed_moves(tmp_path):
    file, text, names = tmp_path / "printer.xml", PRINTER, {"nozzle": "hot_end", "work": "bed", "x": "px", "y": "py"}
    said = refused(file, text, names)
    text = text.replace('<option integrator="RK4"/>', re.search("<option[^>]*>", said)[0])
    for axis, gain in (("x", ' kp="500" dampratio="1"'), ("y", ' kv="500"')):
        said = refused(file, text, names)
        assert f"actuator '{axis}' must be a dcmotor" in said
        assert "becomes <motor> without kp, kv and ctrlrange" in said
        text = re.sub(rf'<\w+ name="p{axis}"(.*?){gain}/>', rf'<motor name="p{axis}"\1/>', text)
    said = refused(file, text, {**names, "nozzle": "tip"})
    assert "names.nozzle: unknown site 'tip': known: hot_end" in said
    said = refused(file, text, names)
    text = text.replace('<geom type="box" size="0.1', re.search("<body[^>]*>", said)[0] + '<geom type="box" size="0.1')
    del names["work"]
    said = refused(file, text, names)
    # the bed moves along +y, so the nozzle in its frame along -y
    assert (
        "axis 'y' moves the nozzle along (0, -1, 0) of body 'work': must be along its y; turn the joint's axis" in said
    )
    file.write_text(text.replace('axis="0 1 0"', 'axis="0 -1 0"'))
    machine = Machine(file, names)
    assert np.allclose(machine.tip(np.array([[7.0, -4.0]])), [[7.0, -4.0, 0.0]])
    # the nozzle is at 150 mm, the bed's plate at 50 + 50 mm and 5 mm above that; `work` itself has no geom
    assert machine.gap == pytest.approx(150 - 105)
    assert "the nozzle is 45 mm above its work" in " ".join(notes(machine))


def test_a_work_that_the_axis_carries_and_a_yaw_beside_the_tip(tmp_path):
    file = tmp_path / "base.xml"
    text = STAGE.replace("<tendon>", "<!--").replace("</tendon>", "-->")
    text = text.replace('tendon="t1"', 'joint="root_x"').replace('tendon="t2"', 'joint="root_y"')
    text = text.replace("</body>", '<site name="nozzle"/></body>')
    said = refused(file, text, {"work": "mass", "x": "t1", "y": "t2"})
    assert said.endswith("must be along its x; as 'work', name a body that this axis does not carry")
    text = text.replace("<worldbody>", '<worldbody><body name="work" pos="0 0 0.01"/>')
    text = text.replace("</actuator>", '<motor name="r" joint="yaw"/></actuator>')
    text = text.replace("<site", '<joint name="yaw" pos="-0.21 0 0" axis="0 0 1"/><site')
    said = refused(file, text, {"x": "t1", "y": "t2", "r": "r"})
    assert re.search(r"rotary axis 'r' moves the nozzle by 297 mm in 90 deg: must .*; move the joint's pos there", said)
    file.write_text(text.replace(' pos="-0.21 0 0"', ""))
    assert Machine(file, {"x": "t1", "y": "t2", "r": "r"}).axis_names == ("x", "y", "r")
