"""The compiled model of a machine's physics, and the copies of it that are stepped."""

from __future__ import annotations

import copy
from collections.abc import Callable

import mujoco

from gantrysim.base.arrays import Floats
from gantrysim.machine.motors import set_for_steps


class PhysicsModels:
    """The model of a machine's physics, and copies of it for steps of some length.

    A copy takes a tenth of the time in which an agent's episode is drawn, and an episode needs the stepped model alone.
    The physics of a perturbed machine is therefore made when it is first asked for.

    Args:
        physics: the model.
    """

    def __init__(self, physics: mujoco.MjModel) -> None:
        self._physics: mujoco.MjModel | None = physics
        self._unperturbed = physics
        self._reference: Floats = physics.qpos0
        self._make = physics.__copy__
        self._unused: list[mujoco.MjModel] = []
        self._stepped: dict[tuple[float, bool, bool], mujoco.MjModel] = {}

    def perturbed(self, make: Callable[[], mujoco.MjModel], model: mujoco.MjModel) -> PhysicsModels:
        """Return the models of a perturbed machine.

        Args:
            make: returns a copy of `physics` with the perturbation in its arrays.
            model: such a copy, which nobody else has; it goes to the first who needs one.
        """
        models = PhysicsModels(self.layout)
        models._physics = None
        models._reference = model.qpos0.copy()
        models._make = make
        models._unused = [model]
        return models

    @property
    def physics(self) -> mujoco.MjModel:
        """The model; always the same object."""
        if self._physics is None:
            self._physics = self._copied()
        return self._physics

    @property
    def layout(self) -> mujoco.MjModel:
        """A model with the joints, stops and options of `physics`, which perturbations do not change."""
        return self._unperturbed if self._physics is None else self._physics

    @property
    def reference(self) -> Floats:
        """Reference of the joints, qpos0 of `physics`, (nq,)."""
        return self._reference if self._physics is None else self._physics.qpos0

    def stepping(self, timestep: float, voltage: bool, stops: bool) -> mujoco.MjModel:
        """Return a copy of `physics` for steps of a length; see `Machine.stepping`."""
        key = timestep, voltage, stops
        if key not in self._stepped:
            model = self._copied()
            set_for_steps(model, *key)
            self._stepped[key] = model
        return self._stepped[key]

    def _copied(self) -> mujoco.MjModel:
        """Return a copy of `physics` that nobody else has."""
        if self._physics is not None:
            return copy.copy(self._physics)
        try:
            return self._unused.pop()
        except IndexError:
            return self._make()
