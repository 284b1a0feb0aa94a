"""The levers, in the order in which they are tried; a new one stands in the file of what it changes, and below."""

from __future__ import annotations

from gantrysim.remedy.lever import Lever
from gantrysim.remedy.levers.dispenser import FASTER_VALVE, LAG_COMPENSATION, LEADS, PRESSURE_ADVANCE, PROPORTIONAL_FLOW
from gantrysim.remedy.levers.hardware import ACCURACY_CLASS, ENCODER, SERVO_PERIOD
from gantrysim.remedy.levers.needle import LIFT, NEEDLE_HEIGHT
from gantrysim.remedy.levers.program import ACCELERATION, CORNERS, EXACT_WAITS, FASTER, LOOP_PERIOD, SLOWER
from gantrysim.remedy.levers.servo import (
    DISTURBANCE_OBSERVER,
    FRICTION_COMPENSATION,
    INTEGRAL,
    LEARNING_TORQUE,
    LOOP_GAINS,
)

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
