"""Which axes carry which, for the levers of yaws."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import mujoco

from gantrysim.machine.axis_reading import fact

GUIDE_ARM = "guide_arm"  # custom numeric, see `Geometry` [mm]


class Levers(NamedTuple):
    """The chain of a machine whose axes x, y and z place the nozzle, for the levers of yaws.

    Attributes:
        carried: names of the axes that each axis carries.
        movers_of_work: names of the axes that move the work; the others move the nozzle.
        guide_arm: along each axis, from the middle of its guide blocks to the nozzle with the axes at zero, (axes,)
            [mm].
    """

    carried: Mapping[str, Sequence[str]]
    movers_of_work: Collection[str]
    guide_arm: Sequence[float]

    @classmethod
    def of(cls, model: mujoco.MjModel, axes: Sequence[str], work: int) -> Levers:
        """Return the levers of a compiled model.

        Args:
            model: the compiled model.
            axes: names of the axes, in the order of the actuators.
            work: index of the body.
        """
        bodies = model.jnt_bodyid[model.actuator_trnid[:, 0]].tolist()
        carried: dict[str, list[str]] = {name: [] for name in axes}
        for name, body in zip(axes, bodies, strict=True):
            for ancestor in _ancestors(model, body):
                if ancestor in bodies:
                    carried[axes[bodies.index(ancestor)]].append(name)
        # an axis moves the work where its body is the work's or carries it
        chain_of_work = [work, *_ancestors(model, work)]
        movers_of_work = [name for name, body in zip(axes, bodies, strict=True) if body in chain_of_work]
        guide_arm = [fact(model, GUIDE_ARM, actuator, 0.0) for actuator in range(len(axes))]
        return cls(carried, movers_of_work, guide_arm)

    def moves_nozzle_from(self, axis: str, body: str) -> bool:
        """Whether an axis moves the nozzle against the body of another, or of itself."""
        if body in self.movers_of_work:
            return axis not in self.carried[body]
        return axis in self.carried[body]


def _ancestors(model: mujoco.MjModel, body: int) -> list[int]:
    """Return the bodies above a body in the tree, from its parent up, without the world."""
    ancestors = []
    parent = int(model.body_parentid[body])
    while parent:
        ancestors.append(parent)
        parent = int(model.body_parentid[parent])
    return ancestors
