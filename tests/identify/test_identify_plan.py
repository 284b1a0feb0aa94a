"""The excitation program, run by the interpreters of the controllers."""

import numpy as np
import pytest

from gantrysim import InputError, Machine
from gantrysim.controllers.gcode import linuxcnc
from gantrysim.controllers.softmc import Basic as McBasic
from gantrysim.controllers.trio import Basic as TrioBasic
from gantrysim.identify.plan import excitation, strokes
from gantrysim.machine.travel import travel_edit

from support.soaked import suite_runs

PERIOD = 1e-3
READERS = {"trio": TrioBasic, "softmc": McBasic, "linuxcnc": linuxcnc.Program}


@pytest.mark.parametrize("controller", READERS)
@pytest.mark.parametrize("name", suite_runs(["xy", "xyz"], 0))
def test_the_program_runs_on_its_controller(controller, name):
    machine = Machine(name)
    text, suffix = excitation(machine, controller)
    reader = READERS[controller]
    assert suffix in reader.suffixes
    setpoints = reader(text=text).setpoints(PERIOD)
    assert setpoints.axes == machine.axis_names
    position = setpoints.position
    speed = np.abs(np.diff(position, axis=0)) / PERIOD
    assert np.abs(position[[0, -1]]).max() < 1e-3
    assert (np.count_nonzero(speed > 1e-6, axis=1) <= 1).all()  # an axis at a time
    for a, axis in enumerate(machine.axes):
        assert axis.travel[0] <= position[:, a].min() < position[:, a].max() <= axis.travel[1]
        assert speed[:, a].max() <= axis.speed_limit
        if controller == "linuxcnc":  # its configuration limits speed and acceleration
            continue
        own = [stroke for stroke in strokes(machine) if stroke.axis == axis.name]
        assert speed[:, a].max() == pytest.approx(max(stroke.speed for stroke in own), rel=0.01)
        # each stroke reaches its distance, to and fro; a tick may miss the end by what it takes to stop
        turns = np.flatnonzero((np.diff(np.sign(np.diff(position[:, a])), prepend=0) != 0)[1:]) + 1
        reached = np.unique(position[turns, a].round(2))
        for stroke in own:
            step = stroke.acceleration * PERIOD**2
            assert np.abs(reached - stroke.distance).min() < 0.02 + step, stroke


def test_the_moves_excite_what_is_to_be_found():
    machine = Machine("xyz")
    for axis in machine.axes:
        own = [stroke for stroke in strokes(machine) if stroke.axis == axis.name]
        speeds = {stroke.speed for stroke in own}
        assert max(speeds) / min(speeds) > 10
        assert len({stroke.acceleration for stroke in own}) >= 3
        for stroke in own:
            torque = axis.inertia * stroke.acceleration + axis.coulomb + axis.viscous * stroke.speed
            assert torque < 0.6 * axis.peak_torque
            assert abs(stroke.distance) <= max(abs(end) for end in axis.travel)
        quickest = min(4 * np.sqrt(abs(stroke.distance) / stroke.acceleration) for stroke in own)  # there and back
        assert quickest < 0.025


def test_what_is_refused():
    with pytest.raises(InputError, match=r"unknown controller 'fanuc': .*known: linuxcnc, softmc, trio"):
        excitation(Machine("xy"), "fanuc")
    with pytest.raises(InputError, match="machine stage: its axes th, x, y are not those of a program, x, y, z, r"):
        excitation(Machine("stage"), "trio")
    with pytest.raises(InputError, match="machine delta"):
        excitation(Machine("delta"), "trio")


def test_an_axis_whose_travel_begins_beyond_zero_is_refused():
    machine = Machine("xy")
    for travel in ((10.0, 100.0), (-100.0, -10.0), (0.0, 1e-4)):
        moved = machine.edited(travel_edit(machine.axes, {"x": travel}))
        with pytest.raises(InputError, match=r"axis x: its travel is .* mm, must extend to both sides of zero"):
            strokes(moved)


@pytest.mark.parametrize(
    ("travel", "longest"), [((-20.0, 100.0), 42.0), ((-100.0, 20.0), -42.0), ((-900.0, 10.0), -80.0)]
)
def test_strokes_go_towards_the_further_end_of_the_travel(travel, longest):
    """35 % of the travel, or 80 mm."""
    machine = Machine("xy")
    machine = machine.edited(travel_edit(machine.axes, {"x": travel}))
    distances = [stroke.distance for stroke in strokes(machine) if stroke.axis == "x"]
    assert max(distances, key=abs) == pytest.approx(longest)
    assert all(distance * longest > 0 for distance in distances)
