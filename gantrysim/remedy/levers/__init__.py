"""The levers, in the order in which they are tried; a new one is a file here and its line in `LEVERS`."""

from __future__ import annotations

from gantrysim.remedy.lever import Lever
from gantrysim.remedy.levers.flow import PROPORTIONAL_FLOW
from gantrysim.remedy.levers.hardware import ACCURACY_CLASS, ENCODER, SERVO_PERIOD
from gantrysim.remedy.levers.laws import DISTURBANCE_OBSERVER, FRICTION_COMPENSATION, LEARNING_TORQUE
from gantrysim.remedy.levers.lift import LIFT
from gantrysim.remedy.levers.loops import INTEGRAL, LOOP_GAINS
from gantrysim.remedy.levers.needle import NEEDLE_HEIGHT
from gantrysim.remedy.levers.pressure_advance import PRESSURE_ADVANCE
from gantrysim.remedy.levers.program import ACCELERATION, CORNERS
from gantrysim.remedy.levers.program_loop import EXACT_WAITS, LOOP_PERIOD
from gantrysim.remedy.levers.speed import FASTER, SLOWER
from gantrysim.remedy.levers.valve import FASTER_VALVE, LAG_COMPENSATION, LEADS

LEVERS: tuple[Lever, ...] = (
    PROPORTIONAL_FLOW,
    LAG_COMPENSATION,
    PRESSURE_ADVANCE,
    LEADS,
    FRICTION_COMPENSATION,
    DISTURBANCE_OBSERVER,
    LEARNING_TORQUE,
    INTEGRAL,
    LOOP_GAINS,
    ACCELERATION,
    LOOP_PERIOD,
    FASTER,
    EXACT_WAITS,
    LIFT,
    CORNERS,
    NEEDLE_HEIGHT,
    SLOWER,
    FASTER_VALVE,
    SERVO_PERIOD,
    ENCODER,
    ACCURACY_CLASS,
)
