"""Another travel for the axes of a machine."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import mujoco
import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, finite, unknown
from gantrysim.machine.axis import PER_SI, Axis
from gantrysim.machine.motors import driven_joints

# The stops at the ends of the axes' travel, and models that leave them out for as long as no axis is at one.
#
# While no axis is at a stop, MuJoCo looks for constraints and finds none, which is a tenth of a gantry's step. A model
# that does not look moves as the other does, to the last bit.


def has_no_constraints_but_stops(model: mujoco.MjModel) -> bool:
    """Return whether the stops of the axes are the only constraints that MuJoCo can find in a compiled model."""
    contacts = not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT and (model.ngeom or model.npair)
    others = (
        model.neq,
        contacts,
        model.nflex,
        model.dof_frictionloss.any(),
        model.tendon_frictionloss.any(),
        model.tendon_limited.any(),
        model.nplugin,
    )
    return not any(others) and set(np.flatnonzero(model.jnt_limited)) <= set(driven_joints(model))


def stops_of(model: mujoco.MjModel) -> Floats:
    """Return index in qpos of each axis' joint, and its least and largest position without a stop, (3, axes) [SI].

    An axis without stops has infinite ones.
    """
    joints = driven_joints(model)
    limited = model.jnt_limited[joints].astype(bool)
    low, high = model.jnt_range[joints].T
    # rounded to the safe side
    margin = 1.000001 * model.jnt_margin[joints]
    return np.stack(
        [
            model.jnt_qposadr[joints],
            np.where(limited, low + margin, -np.inf),
            np.where(limited, high - margin, np.inf),
        ]
    )


Travel = Mapping[str, tuple[float, float]]


def travel_edit(axes: tuple[Axis, ...], travel: Travel) -> Callable[[mujoco.MjSpec], None]:
    """Return what changes the travel of axes in an MJCF; masses, stiffness and drawing stay.

    Args:
        axes: of the machine.
        travel: least and largest position by the axis' name [mm or deg].

    Raises:
        InputError: an unknown axis, or bounds that are no numbers or not ascending.
    """
    units = {axis.name: axis.unit for axis in axes}
    for name, (low, high) in travel.items():
        if name not in units:
            raise unknown("axis of travel", name, units)
        finite(f"travel.{name}", low, units[name])
        finite(f"travel.{name}", high, units[name])
        if not low < high:
            raise InputError(f"travel.{name} = {low:g} to {high:g} {units[name]}: must be ascending")

    def edit(spec: mujoco.MjSpec) -> None:
        for name, bounds in travel.items():
            # MuJoCo's specification has angles in degrees where its compiler reads them so
            in_degrees = units[name] == "deg" and spec.compiler.degree
            factor = 1.0 if in_degrees else math.radians(1.0) if units[name] == "deg" else 1 / PER_SI["mm"]
            spec.joint(name).range = [bound * factor for bound in bounds]

    return edit
