"""The progress that controllers state: where on the requested path each command stands."""

import math
from importlib.resources import files

import numpy as np
import pytest

from gantrysim import Job
from gantrysim.base.errors import InputError
from gantrysim.controllers import fanuc
from gantrysim.controllers.drawings import Drawing
from gantrysim.controllers.gcode import linuxcnc
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.engine.positions import axis_positions
from gantrysim.paths.chain import Chain
from gantrysim.paths.pieces import Line
from gantrysim.record.setpoints import Setpoints
from gantrysim.servo.laws.zv import ZV

JOBS = sorted(
    file.name.removesuffix(".toml") for file in (files("gantrysim") / "jobs").iterdir() if file.name[0] != "_"
)
# jobs whose commands leave the requested path, by how much [mm]: AN-225's loop, rounded corners, chords
OFF = {
    "an225": 1.0,
    "an225-3d": 1.0,
    "trio-basic": 1.0,
    "linuxcnc-flanges": 0.1,
    "svg-gasket": 0.06,
    "fanuc-spiral": 1e-6,
    "fanuc-conical": 0.1,
    "slicer-square": 0.06,
}
CORNER = "G21 G90\n{}\nF3600\nG0 X0 Y0\nG1 X30 Y0\nG1 X30 Y20\nM2"


@pytest.mark.parametrize("name", JOBS)
def test_the_controllers_of_the_built_in_jobs_state_their_progress(name):
    job = Job.load(name)
    setpoints = job.setpoints
    progress = setpoints.progress
    path = setpoints.requested
    assert progress[0] == pytest.approx(0, abs=1e-6)
    assert progress[-1] == pytest.approx(path.length, abs=1e-6)
    assert (np.diff(progress) >= 0).all()
    machine = job.built_machine
    tip = machine.tip(axis_positions(machine, setpoints))
    assert np.linalg.norm(tip - path.position(progress), axis=1).max() < OFF.get(name, 1e-6)


def test_the_middle_of_a_rounded_corner_stands_for_the_corner():
    setpoints = linuxcnc.Program(text=CORNER.format("G64 P0.5")).setpoints(2.5e-4)
    x, y = setpoints.position.T
    middle = np.interp(0.0, y - (30 - x), setpoints.progress)  # on the bisector of the corner
    assert middle == pytest.approx(30, abs=0.02)
    # an arc 0.5 mm from a corner of 90 degrees begins 0.5 / tan(22.5 degrees) before it
    begin = 30 - 0.5 / math.tan(math.pi / 8)
    on_leg = (y == 0) & (x < begin)
    assert setpoints.progress[on_leg] == pytest.approx(x[on_leg], abs=1e-9)


def test_a_corner_averaged_over_time_stands_for_the_nearest_place_of_its_legs():
    setpoints = fanuc.Program(f"{CORNER.format('')}\nM30", blend_time=0.1).setpoints(1e-3)
    x, y = setpoints.position.T
    nearest = np.where(y < 30 - x, x, 30 + y)
    apart = np.abs(y - (30 - x)) > 1e-6
    assert setpoints.progress[apart] == pytest.approx(nearest[apart], abs=1e-9)


def test_a_blend_as_long_as_some_teeth_advances_from_tooth_to_tooth():
    """Teeth of 0.4 mm averaged over several of them: the command runs along their middle."""
    teeth = "\n".join(f"G1 X{0.4 * (k % 2):.1f} Y{0.2 * k:.1f}" for k in range(41))
    setpoints = fanuc.Program(f"G21 G90 F3000\nG1 X0.4 Y0\n{teeth}\nM30", blend_time=0.1).setpoints(1e-3)
    reached = np.interp(setpoints.position[:, 1], [0.0, 8.0], [0.4, setpoints.requested.length])
    inner = (setpoints.position[:, 1] > 2) & (setpoints.position[:, 1] < 6)
    leg = math.hypot(0.4, 0.2)
    assert np.abs(setpoints.progress - reached)[inner].max() < 1.5 * leg


def test_a_drawing_with_rounded_corners_advances_by_its_legs():
    text = "0,0\n40,0\n40,25\n5,25\n"
    setpoints = Drawing(text=text, format="csv", corner_tolerance=0.3).setpoints(5e-4)
    x, y = setpoints.position.T
    far = np.array([abs(setpoints.progress - corner) > 2 for corner in (40, 65)]).all(axis=0)
    along = np.where(y == 0, x, np.where(x == 40, 40 + y, 65 + 40 - x))
    assert setpoints.progress[far] == pytest.approx(along[far], abs=1e-9)
    for corner, distance in ((40, (40 - x) - y), (65, y - 25 + (40 - x))):
        near = np.flatnonzero(np.abs(setpoints.progress - corner) < 2)
        middle = near[np.abs(distance[near]).argmin()]  # on the bisector of the corner, to a tick
        assert setpoints.progress[middle] == pytest.approx(corner, abs=0.05)


@pytest.mark.parametrize("height", [0.0, 20.0])
@pytest.mark.parametrize("loop_period", [0.0, 0.1])
def test_the_spiral_of_an_225_turns_as_its_virtual_axes_do(loop_period, height):
    spiral = MoveSpiral(
        diameter=100, turns=3, thickness=8, speed=60, loop_period=loop_period, height=height, clockwise=False
    )
    setpoints = spiral.setpoints(1e-3)
    x, y = setpoints.position[:, :2].T
    heading = np.unwrap(np.arctan2(np.gradient(y), np.gradient(x)))
    requested = setpoints.requested.heading(setpoints.progress)
    # an arc of a pass and the involute have the same tangent; the last ticks are cut short
    assert heading[1:-3] == pytest.approx(requested[1:-3], abs=2e-3)


def test_input_shaping_filters_the_progress_as_the_positions():
    path = Chain([Line((0, 0, 0), (20, 0, 0)), Line((20, 0, 0), (20, 30, 0))])
    setpoints = Setpoints.along(path, 50.0, 1e-3)
    values = {"shaper_frequency": [20.0, 20.0], "shaper_damping": [0.02, 0.02]}
    shaped = ZV.sent(values, setpoints)
    assert shaped.progress == pytest.approx(shaped.position.sum(axis=1), abs=1e-9)


def test_progress_is_kept_by_waits_holds_and_parts():
    path = Chain([Line((0, 0, 0), (20, 0, 0))])
    setpoints = Setpoints.along(path, 50.0, 1e-3)
    longer = setpoints.wait(0.05).hold(0.02)
    assert longer.progress == pytest.approx(longer.position[:, 0])
    assert setpoints.part(slice(10, 50)).progress == pytest.approx(setpoints.position[10:50, 0])


@pytest.mark.parametrize(
    ("progress", "text"),
    [
        ([0.0, 2.0, 1.0], r"^progress from 0 to 1 mm, falling 1 times: must be from 0 to 10 mm"),
        ([0.0, 5.0, 11.0], r"^progress from 0 to 11 mm, falling 0 times: must be from 0 to 10 mm"),
        ([-1.0, 0.0, 1.0], r"^progress from -1 to 1 mm, falling 0 times"),
        ([0.0, 1.0], r"^progress of shape \(2,\): must be \(3,\), or None if it is not known$"),
    ],
)
def test_a_progress_that_falls_or_leaves_the_path_is_refused(progress, text):
    path = Chain([Line((0, 0, 0), (10, 0, 0))])
    with pytest.raises(InputError, match=text):
        Setpoints(1e-3, ("x",), np.zeros((3, 1)), np.ones(3, bool), path, progress=np.array(progress))
