"""A simulation of another program on another machine is the one that is made of them from the beginning."""

import numpy as np
import pytest

from gantrysim import Dispenser, Machine, Servo
from gantrysim.base.errors import InputError
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.engine.places import LoopPlaces
from gantrysim.engine.simulation import Simulation
from gantrysim.machine.perturbation import Perturbation
from gantrysim.machine.row import ROW

OTHER = Perturbation(payload=0.4, friction=(1.3, 0.8), viscous=0.7, motor_constant=(1.2, 0.7))
GLUE = Dispenser(flow=80.0)


def spiral(servo, diameter):
    return MoveSpiral(diameter, 1, 10, 80).setpoints(servo.period)


def compared(xy, servo):
    machine = xy.perturbed(OTHER)
    setpoints = spiral(servo, 40)
    again = Simulation.of(xy, servo, spiral(servo, 50)).with_program(machine, setpoints, GLUE)
    return again, Simulation.of(machine, servo, setpoints, dispenser=GLUE)


@pytest.mark.parametrize("law", [["pid"], ["pid", "friction"]])
def test_it_starts_and_runs_as_one_that_is_made_from_the_beginning(xy, law):
    again, anew = compared(xy, Servo.derive(xy.axes, law=law))
    rows = [simulation.start[1].view(ROW)[0] for simulation in (again, anew)]
    for name in ROW.names:
        if name not in ("setpoints", "gates"):
            np.testing.assert_array_equal(rows[0][name], rows[1][name], err_msg=name)
    places = LoopPlaces(xy, 2, 1)
    places.load({0: again, 1: anew})
    places.advance()
    first, second = (places.runs[k].record() for k in range(2))
    for name in ("nozzle", "demand", "torque", "flow", "commanded"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name), err_msg=name)


def test_drives_that_are_no_plain_ones_are_those_of_the_machine(xy):
    again, anew = compared(xy, Servo.derive(xy.axes, current_bandwidth=800.0))
    assert again.drives is not None
    assert again.drives.tobytes() == anew.drives.tobytes()


def test_it_is_checked_as_another_is(xy):
    servo = Servo.derive(xy.axes)
    simulation = Simulation.of(xy, servo, spiral(servo, 50))
    with pytest.raises(InputError, match="must lie in the travel"):
        simulation.with_program(xy, spiral(servo, 5000), GLUE)
    # a lower constant lets the motor turn faster, a higher one slower
    slow = xy.perturbed(Perturbation(motor_constant=100.0))
    with pytest.raises(InputError, match="must be at most"):
        simulation.with_program(slow, spiral(servo, 50), GLUE)


def test_a_machine_that_cannot_have_a_perturbation_says_so_at_once(xy):
    with pytest.raises(InputError, match="payload"):
        xy.perturbed(Perturbation(payload=1.0)).perturbed(Perturbation(payload=-100.0))
    with pytest.raises(InputError, match="friction has 3 values"):
        xy.perturbed(Perturbation(friction=(1.0, 1.0, 1.1)))
    assert Machine("xy").perturbed(Perturbation(payload=-0.1)).arrays is not None
