"""Faults of an axis: a tight spot or a seized axis, and a coupling or belt that slips."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from gantrysim.base.errors import at_least, finite
from gantrysim.faults.fault import MOTOR, FaultAxis, Lasting, acts_at_tick

SEIZED_FRICTION = 1e9  # friction of a seized axis [N or N·m]
_RIGID_IMPEDANCE = (0.9999, 0.9999, 0.001, 0.5, 2)  # impedance of its friction; MuJoCo's own lets it creep


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
        model.dof_frictionloss[dof] += min(self.friction, SEIZED_FRICTION)
        model.dof_solref[dof] = 2 * model.opt.timestep, 1.0
        model.dof_solimp[dof] = _RIGID_IMPEDANCE


def turn_ahead(row: Any, fault: Any) -> None:
    """Put the motor ahead of the axis."""
    if acts_at_tick(row, fault):
        row.motor[fault.axis] += fault.value


@dataclass(frozen=True, kw_only=True)
class SlippingAxis(Lasting):
    """The coupling between motor and axis, or a belt on its pulley, slips by a distance, at once.

    The motor, whose encoder measures it, is ahead of the axis from then on. It is a slip of known size, not a limit of
    the transmitted torque: motor and axis share one joint of the machine, so the slip itself takes no torque.

    Attributes:
        time: time at which the fault begins [s].
        duration: how long the fault lasts, by default until the end [s].
        axis: name of the axis.
        offset: distance by which the axis lags its motor, as axis travel [mm or deg].
    """

    stages = ((MOTOR, turn_ahead),)

    axis: str
    offset: float
    kind: Literal["slipping axis"] = "slipping axis"

    def _check(self) -> None:
        finite("offset", self.offset, "mm or deg")

    @property
    def acts(self) -> bool:
        return self.offset != 0 and self.duration > 0

    @property
    def magnitude(self) -> str:
        return f"the axis lags its motor by {self.offset:g} mm or deg {self._span}"

    def tick_value(self, axis: FaultAxis, axes: Sequence[FaultAxis]) -> float:
        return self.offset
