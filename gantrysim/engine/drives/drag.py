"""A constant torque, such as a weight, and viscous friction that differs by direction: MJCF has neither of a joint."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from typing import Any

import numpy as np

from gantrysim.engine.drives.part import DrivenAxis, DrivePart


def _drag(driven: DrivenAxis) -> dict[str, Any]:
    """Return what drags an axis at its joint."""
    # of the layout: asking a perturbed machine for its physics costs another copy of the model
    gear = float(driven.machine.layout.actuator_gear[driven.number, 0])
    axis = driven.axis
    # N·m·s/u at the motor to N·s/m or N·m·s/rad at the joint
    per_joint = gear * axis.scale * gear
    return {"constant": axis.constant_torque * gear, "difference": axis.viscous_difference * per_joint}


def _pull(row, tape, axis, drive):
    """Add the constant force, and -d |v|: viscous friction is b + d forwards, b - d back."""
    drag = drive.drag
    row.applied[axis] += drag.constant - drag.difference * abs(row.joint_speed[axis])


DRAG = DrivePart(
    "drag",
    [
        ("constant", np.float64),  # force or torque at the joint, positive forwards [N or N·m]
        ("difference", np.float64),  # half the difference of viscous friction, forwards less back [N·s/m or N·m·s/rad]
    ],
    _drag,
    (("drive", _pull),),
    lambda servo, entries: bool(entries["constant"].any() or entries["difference"].any()),
)
