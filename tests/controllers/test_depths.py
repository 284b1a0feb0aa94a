"""Programs whose heights are depths: the mirror image of a program with the opposite heights and arcs."""

import numpy as np
import pytest

from gantrysim.controllers.fanuc import Program as Fanuc
from gantrysim.controllers.gcode.linuxcnc import Program as LinuxCNC
from gantrysim.controllers.placement import Placement
from gantrysim.controllers.trio import Basic, InterpreterTime

ARCS = {  # down, and up: with z turned round, arcs that leave the XY plane change their sense
    "G17": ("G17 G2 X50 Y10 Z2 I10 J0", "G17 G2 X50 Y10 Z-2 I10 J0"),
    "G18": ("G18 G2 X50 Z3 I10 K0 Y4", "G18 G3 X50 Z-3 I10 K0 Y4"),
    "G19": ("G19 G2 Y30 Z3 J10 K0 X4", "G19 G3 Y30 Z-3 J10 K0 X4"),
}
PLACE = {"x": 3.0, "y": -2.0, "z": 7.0, "rotate": 33.0, "scale": 1.5}


def positions(program):
    return program.setpoints(0.01).position


@pytest.mark.parametrize("controller", [LinuxCNC, Fanuc])
@pytest.mark.parametrize("plane", ARCS)
def test_depths_mirror_every_plane(plane, controller):
    down, up = (
        f"G90 G0 X30 Y10 Z{5 * sign}\nG1 Z{-3 * sign} F600\n{arc}\nG1 X20 Z{-4 * sign}\nG0 Z{5 * sign}\n"
        for arc, sign in zip(ARCS[plane], (-1, 1), strict=True)
    )
    program = {controller.text_argument: down}
    depths = controller(**program, placement=Placement(**PLACE, z_down=True))
    heights = controller(**{controller.text_argument: up}, placement=Placement(**PLACE))
    np.testing.assert_allclose(positions(depths), positions(heights), atol=1e-9)
    length = heights.requested.length
    assert depths.requested.length == pytest.approx(length, abs=1e-9)
    places = np.linspace(0, length, 50)
    np.testing.assert_allclose(depths.requested.position(places), heights.requested.position(places), atol=1e-9)


def test_a_helix_of_trio_basic_descends_along_its_stated_path():
    text = "BASE(0,1,2): SPEED=50: MHELICAL(20,0,10,0,1,6): WAIT IDLE"
    program = Basic(
        text=text,
        interpreter_time=InterpreterTime(0, 0, 0, 0),
        axis_numbers=(0, 1, 2),
        placement=Placement(z_down=True),
    )
    setpoints = program.setpoints(0.001)
    np.testing.assert_allclose(setpoints.position[-1], (20, 0, -6), atol=1e-3)
    assert setpoints.requested.project(setpoints.position).distance.max() < 1e-6
