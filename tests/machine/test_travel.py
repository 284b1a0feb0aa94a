"""Another travel for the axes of a machine, in the units of the axes whatever those of the MJCF's angles."""

import math

import pytest

from gantrysim import InputError
from gantrysim.machine.machine import Machine
from gantrysim.machine.travel import travel_edit

ANGLED = """
<mujoco>
  <compiler angle="{angle}"/>
  <worldbody>
    <body name="work"/>
    <body>
      <joint name="x" type="slide" axis="1 0 0" range="-0.2 0.3" limited="true" user="1"/>
      <geom size="0.1"/>
      <body>
        <joint name="c" type="hinge" axis="0 0 1" range="{range}" limited="true" user="10"/>
        <geom size="0.1"/>
        <site name="nozzle"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="x" joint="x" gear="100" ctrllimited="true" ctrlrange="-1 1"/>
    <motor name="c" joint="c" gear="10" ctrllimited="true" ctrlrange="-1 1"/>
  </actuator>
  <sensor>
    <actuatorpos name="x" actuator="x" user="10000"/>
    <actuatorpos name="c" actuator="c" user="10000"/>
  </sensor>
</mujoco>
"""


@pytest.mark.parametrize(
    ("angle", "range_"), [("degree", "-90 180"), ("radian", "-1.5707963267948966 3.141592653589793")]
)
def test_travel_is_in_mm_and_degrees(tmp_path, angle, range_):
    file = tmp_path / "angled.xml"
    file.write_text(ANGLED.format(angle=angle, range=range_))
    machine = Machine(file)
    assert [axis.travel for axis in machine.axes] == [
        pytest.approx((-200, 300)),
        pytest.approx((-90, 180)),
    ]
    changed = machine.edited(travel_edit(machine.axes, {"x": (-45, 55), "c": (-10, 30)}))
    assert [axis.travel for axis in changed.axes] == [pytest.approx((-45, 55)), pytest.approx((-10, 30))]
    with pytest.raises(InputError, match=r"^travel.c = 30 to 30 deg: must be ascending$"):
        travel_edit(machine.axes, {"c": (30, 30)})
    with pytest.raises(InputError, match=r"^unknown axis of travel 'v'"):
        travel_edit(machine.axes, {"v": (0, 30)})
    for bounds in ((-math.inf, 1), (0, math.nan)):
        with pytest.raises(InputError, match=r"^travel.x = (-inf|nan) mm: must be finite"):
            travel_edit(machine.axes, {"x": bounds})
