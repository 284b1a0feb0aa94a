"""Friction of transmissions, in proportion to the force that they transmit."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from typing import Any

import numpy as np

from gantrysim.engine.drives.part import DrivenAxis, DrivePart

_PRESLIDING = 5e-6  # of a slide [m]
_PRESLIDING_TURN = 3e-3  # of a rotary axis, at the motor [rad]


def _transmission(driven: DrivenAxis) -> dict[str, Any]:
    """Return a transmission with losses."""
    axis = driven.axis
    if axis.efficiency == 1:
        return {}
    model = driven.model
    turn = _PRESLIDING_TURN / float(model.actuator_gear[driven.number, 0])
    return {
        "loss": 1 / axis.efficiency - 1,
        "damping": model.dof_damping[model.jnt_dofadr[driven.joint]],
        "presliding": _PRESLIDING if axis.unit == "mm" else turn,
    }


def _lose(row, tape, axis, drive):
    """Add the friction of a transmission of efficiency e that carries the force F: (1/e - 1) |F| against the motion.

    A motor that drives its load does the work F / e per travel; one that brakes it gets F (2 - 1/e) back. The friction
    turns within a presliding x: s' = (v - |v| s) / x, its share s being the sign of v after it (Dahl).
    """
    transmission = drive.transmission
    if transmission.loss > 0.0:
        speed = row.joint_speed[axis]
        force = row.passive[axis] + transmission.damping * speed
        # tendons pull at the axis' joint
        if row.load_at[axis] >= 0:
            force = row.load_passive[axis]
        row.applied[axis] -= transmission.loss * abs(force) * transmission.slid
        side = np.sign(speed)
        memory = np.exp(-abs(speed) * row.period / row.substeps / transmission.presliding)
        transmission.slid = side + (transmission.slid - side) * memory


TRANSMISSION = DrivePart(
    "transmission",
    [
        ("loss", np.float64),  # friction per transmitted force, 0 for none
        ("damping", np.float64),  # of the axis' joint itself [N·s/m or N·m·s/rad]
        ("presliding", np.float64),  # motion within which the friction turns [SI]
        ("slid", np.float64),  # share and direction of the friction, -1 to 1
    ],
    _transmission,
    (("drive", _lose),),
    lambda servo, entries: bool(entries["loss"].any()),
)
