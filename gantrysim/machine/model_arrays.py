"""The arrays of a compiled model that perturbations change, without a copy of all of it."""

from __future__ import annotations

from typing import Any

import mujoco

# arrays of MuJoCo's model that a perturbation changes
_CHANGED_ARRAYS = (
    "body_mass",
    "body_gravcomp",
    "qpos0",
    "jnt_stiffness",
    "jnt_stiffnesspoly",
    "dof_frictionloss",
    "dof_damping",
    "dof_dampingpoly",
    "tendon_stiffness",
    "tendon_stiffnesspoly",
    "tendon_lengthspring",
    "tendon_length0",
    "actuator_gainprm",
    "actuator_biasprm",
    "actuator_dynprm",
    "actuator_forcerange",
    "actuator_ctrlrange",
    "actuator_damping",
    "actuator_dampingpoly",
    "numeric_data",
)


class ModelArrays:
    """The arrays of a compiled model: copies of those that a perturbation changes, its own of all others.

    A copy of the whole model takes ten times as long, and most perturbed machines are stepped by the compiled loop.

    Args:
        model: the compiled model, or such arrays of one.

    Attributes:
        compiled: the compiled model.
    """

    def __init__(self, model: mujoco.MjModel | ModelArrays) -> None:
        self.compiled: mujoco.MjModel = compiled_of(model)
        for name in _CHANGED_ARRAYS:
            setattr(self, name, getattr(model, name).copy())

    def __getattr__(self, name: str) -> Any:
        if name == "compiled":
            # not set yet, in a copy that is being made
            raise AttributeError(name)
        return getattr(self.compiled, name)


def compiled_of(model: mujoco.MjModel | ModelArrays) -> mujoco.MjModel:
    """Return a compiled model, or the one of its arrays, which has the same elements and names."""
    return model.compiled if isinstance(model, ModelArrays) else model
