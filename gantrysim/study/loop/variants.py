"""The variants in which a loop study runs a job, and its sweeps."""

from __future__ import annotations

import math
from typing import Any

# variants of a job
AS_IT_IS = "as it is"
LOOP_ALONE = "loop alone"  # without the controller's other limits
PERFECT = "loop alone, perfect follower"
NO_LOOP = "no loop"  # the limit of a loop that takes no time
NO_FRICTION = "no friction"  # nor loop, nor encoder counts, nor integral term: what the theory of the servo is of

# sweeps, in the order of the report, and what is changed
SWEEPS = {
    "loop_period": "Program loop period",
    "interpreter_time": "Interpreter time per pass",
    "servo_period": "Servo period",
    "encoder_resolution": "Encoder resolution",
    "physics_step": "Physics step",
}

# what takes a Move Spiral's controller all limits but its loop
FREE: dict[str, Any] = {
    "program.acceleration": math.inf,
    "program.deceleration": None,
    "program.wait_resolution": 0.0,
    "program.ratio_bits": None,
    "program.interpreter_time": 0.0,
    "program.servo_period": 0.0,
    "program.as_published": False,
    "program.mhelical_mode": 1,
}
