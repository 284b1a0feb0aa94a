"""The stops at the ends of the axes' travel, and models that leave them out for as long as no axis is at one.

While no axis is at a stop, MuJoCo looks for constraints and finds none, which is a tenth of a gantry's step. A model
that does not look moves as the other does, to the last bit.
"""

from __future__ import annotations

import mujoco
import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.machine.springs import driven_joints


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
    margin = 1.000001 * model.jnt_margin[joints]  # rounded to the safe side
    return np.stack(
        [
            model.jnt_qposadr[joints],
            np.where(limited, low + margin, -np.inf),
            np.where(limited, high - margin, np.inf),
        ]
    )
