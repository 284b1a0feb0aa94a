"""The set point of a pump's flow by an output of the program: M67, S of a spindle, M106."""

import numpy as np
import pytest

from gantrysim import InputError
from gantrysim.controllers.gcode import linuxcnc, slicer
from gantrysim.engine.simulate import perfect_follower
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.glue.dispenser.needle import Needle
from gantrysim.glue.dispenser.piston import Piston
from gantrysim.job.job import Job
from gantrysim.machine.machine import Machine
from gantrysim.study.speed.study import speed_changes

PERIOD = 1e-3
OUTPUT = "M67 E0 Q2\nM3 S100\nG1 X20 F1200\nM67 E0 Q5\nG1 X40\nM67 E1 Q9\nG1 X60\nM5\nG0 X0"
SPINDLE = "M3 S2\nG1 X20 F1200\nS5\nG1 X60\nM5\nG0 X0"
FAN = "M106 S2\nG1 X20 F1200\nM106 S5\nG1 X60\nM107\nG1 X80"


def steady(points):
    """Set points on the first move and the second, away from their ends."""
    x = points.position[:, 0]
    on = points.dispense
    return points.analogue[on & (x > 2) & (x < 18)], points.analogue[on & (x > 22) & (x < 58)]


@pytest.mark.parametrize(
    ("program", "word", "text"),
    [
        (linuxcnc.Program, "M67 E0", OUTPUT),
        (linuxcnc.Program, "M67 E0", OUTPUT.replace("M67", "M68")),
        (linuxcnc.Program, "S", SPINDLE),
        (slicer.Program, "M106", FAN),
        (slicer.Program, "S", SPINDLE.replace("S5", "M3 S5")),
    ],
)
def test_the_set_point_is_the_value_of_the_word(program, word, text):
    points = program(text=text, flow_output=word).setpoints(PERIOD)
    first, second = steady(points)
    assert first.size > 500
    assert set(first.tolist()) == {2.0}
    assert set(second.tolist()) == {5.0}
    assert program(text=text).setpoints(PERIOD).analogue is None


def test_m106_without_s_is_full():
    points = slicer.Program(text="M106\nG1 X20 F1200", flow_output="M106").setpoints(PERIOD)
    assert set(points.analogue.tolist()) == {255.0}


def test_the_flow_is_the_set_point_times_its_unit_while_the_dispenser_is_on():
    text = OUTPUT.replace("M67 E1 Q9", "G4 P0.5")
    points = linuxcnc.Program(text=text, flow_output="M67 E0").setpoints(PERIOD)
    run = perfect_follower(Machine("xy"), points, dispenser=Dispenser(per_output=3.0))
    np.testing.assert_allclose(run.flow, 3.0 * points.analogue * points.dispense, rtol=1e-12)
    # also in the dwell, where a flow by the path speed would be zero
    still = (np.abs(points.position[:, 0] - 40) < 1e-9) & points.dispense
    assert run.flow[still][5:-5] == pytest.approx(15.0)
    np.testing.assert_array_equal(run.flow, run.flow_demand)


def test_a_driven_dispenser_follows_the_set_point():
    points = linuxcnc.Program(text=OUTPUT, flow_output="M67 E0").setpoints(PERIOD).hold(3.0)
    needle = Needle(bore=0.84, length=12.0, consistency=8.0, index=1.0)
    driven = Dispenser(per_output=3.0, kind="piston", needle=needle, piston=Piston(compliance=0.01))
    run = perfect_follower(Machine("xy"), points, dispenser=driven)
    assert run.flow.sum() == pytest.approx(run.flow_demand.sum(), rel=1e-3)
    assert run.flow_demand.max() == pytest.approx(15.0)


def test_a_slower_program_needs_less_for_each_unit():
    program = {"controller": "linuxcnc.Program", "text": OUTPUT, "flow_output": "M67 E0"}
    job = Job.of_content({"name": "j", "machine": "xy", "program": program, "dispenser": {"per_output": 3.0}}, "job j")
    assert speed_changes(job, 0.5 * job.controller.programmed_speed)["dispenser.per_output"] == 1.5


def test_an_output_that_is_not_stated_is_asked_for():
    points = linuxcnc.Program(text=OUTPUT).setpoints(PERIOD)
    with pytest.raises(InputError, match="per_output multiplies the program's flow_output, which is not stated"):
        perfect_follower(Machine("xy"), points, dispenser=Dispenser(per_output=3.0))
    with pytest.raises(InputError, match='flow_output = "M3": must be "S", "M106", or with its number "M67 E0"'):
        linuxcnc.Program(text=OUTPUT, flow_output="M3")


def test_other_outputs_are_counted():
    program = linuxcnc.Program(text=OUTPUT, flow_output="M67 E0").program
    assert program.ignored["M67"] == 1
    assert linuxcnc.Program(text=OUTPUT).program.ignored["M67"] == 3
