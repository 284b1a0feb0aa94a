"""Stages of the servo tick: forces of several beside one another."""

import math

import numpy as np
import pytest

from gantrysim import Machine, Servo
from gantrysim.engine.advance import Stepper
from gantrysim.engine.drives import drive_stages
from gantrysim.engine.native.pointers import row_at
from gantrysim.engine.native.stages import Stage, arm, compiled_stage
from gantrysim.engine.simulation import Simulation
from gantrysim.record.setpoints import Setpoints

from support.runs import ramp
from support.tables import SCREW, ideal

LEAD = 0.020  # of the screw [m]
LOAD = 1.0  # [kg]
NUT = 0.25  # [kg]
ROTOR_AND_SCREW = 2e-5 + math.pi * 7850 * 0.6 * 0.016**4 / 32  # [kg·m²]
PERIOD = 2.5e-4
PUSH = 3.0  # [N]


def push(address, argument):
    row_at(address).applied[0] += PUSH


@pytest.mark.parametrize("efficiency", [1.0, 0.8])
def test_forces_of_stages_add_up_and_last_for_one_step(tmp_path, efficiency):
    """Two forces P on the nut, the drives off: 2 P = (J gear² + m_nut + m / e) a; the transmission's is a third."""
    table = tmp_path / "machine.toml"
    table.write_text(ideal(SCREW.replace("damping_ratio = 0", f"damping_ratio = 0.5\nefficiency = {efficiency}")))
    machine = Machine(table)
    off = dict.fromkeys(("kp", "ki", "kd", "velocity_ff", "acceleration_ff"), 0.0)
    servo = Servo.derive(machine.axes, PERIOD, **off, resolution=0.0)
    rest = Setpoints(PERIOD, machine.axis_names, np.zeros((400, 2)), np.zeros(400, bool), ramp(50.0).requested)
    stepper = Stepper(Simulation.of(machine, servo, rest))
    pushing = Stage("drive", compiled_stage(push))
    table = arm(stepper.run.row, [pushing, *drive_stages(servo, stepper.run.drives), pushing])
    stepper.advance()
    run = stepper.run.record()
    assert table.size == 2 + (efficiency < 1)
    moving = ROTOR_AND_SCREW * (2 * math.pi / LEAD) ** 2 + NUT + LOAD / efficiency
    expected = 1e3 * 0.5 * 2 * PUSH / moving * run.time[-1] ** 2
    assert run.motor[-1, 0] == pytest.approx(expected, rel=0.01)
