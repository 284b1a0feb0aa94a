"""A tight spot, or a seized axis."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

from gantrysim.base.errors import at_least
from gantrysim.faults.fault import Lasting

SEIZED = 1e9  # friction of a seized axis [N or N·m]
_RIGID = (0.9999, 0.9999, 0.001, 0.5, 2)  # impedance of its friction; MuJoCo's own lets it creep


@dataclass(frozen=True, kw_only=True)
class StuckAxis(Lasting):
    """Coulomb friction in the axis' joint, of motor, screw and nut together: a tight spot or a seized axis.

    Attributes:
        time: time at which the fault begins [s].
        duration: how long the fault lasts, by default until the end [s].
        axis: name of the axis.
        friction: friction force of a linear axis, torque about a rotary one; inf for a seized axis [N or N·m].
    """

    in_model = True

    axis: str
    friction: float = math.inf
    kind: Literal["stuck axis"] = "stuck axis"

    def _check(self) -> None:
        if self.friction != math.inf:
            at_least("friction", self.friction, 0, "N or N·m")

    @property
    def acts(self) -> bool:
        return self.friction > 0 and self.duration > 0

    @property
    def magnitude(self) -> str:
        size = "seized" if math.isinf(self.friction) else f"friction {self.friction:g} N or N·m"
        return f"{size} {self._span}"

    def change_model(self, model: Any, axis: int) -> None:
        """Add MuJoCo's dry friction (`frictionloss`), solved with all other forces, to the joint of the axis."""
        joint = model.actuator_trnid[axis, 0]
        dof = model.jnt_dofadr[joint]
        model.dof_frictionloss[dof] += min(self.friction, SEIZED)
        model.dof_solref[dof] = 2 * model.opt.timestep, 1.0
        model.dof_solimp[dof] = _RIGID
