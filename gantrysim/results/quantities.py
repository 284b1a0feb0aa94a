"""Every value of a run that people see, in groups; summary.json, docs/values.md and their tests derive from this list.

A value of a group stands in summary.json under the group's name and its own key, as in `summary["errors"]
["contour_rms_um"]`; columns of studies have the same keys.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from gantrysim.base.quantity import AXIS, Item, Quantity, contents
from gantrysim.glue.bead.values import BEAD
from gantrysim.job.losses import LOSSES
from gantrysim.metrics.error_quantities import ERRORS, MOTION, TORQUE_RIPPLE, of_axes
from gantrysim.results.run_results import AxisLoop, RunResults
from gantrysim.servo.stability.margins import MARGINS

TORQUE_RIPPLE_PERCENT = Quantity[AxisLoop](
    "torque_ripple",
    label="relative torque ripple",
    unit="%",
    form=".2f",
    meaning="Torque ripple over the peak torque of the motor",
    path=("torque_ripple_share",),
    factor=100.0,
)


@dataclass(frozen=True)
class Group:
    """Values of a run that have one subject.

    Attributes:
        name: key of the group in summary.json.
        title: in words.
        quantities: the values, with templates for all axes.
        subject: returns the subject of the quantities; None where a run has none, as a bead without glue.
        code: Python code of the subject.
    """

    name: str
    title: str
    quantities: tuple[Quantity[Any], ...]
    subject: Callable[[RunResults], Any]
    code: str

    def of(self, results: RunResults) -> tuple[Quantity[Any], ...]:
        """Return the quantities with those of the axes of a run in the place of templates."""
        run = results.budget.analysis.run
        return of_axes(self.quantities, run.axes, run.units)

    def contents(self, results: RunResults) -> dict[str, float | None] | None:
        """Return the numbers by their keys for JSON; None where the run has no subject of this group."""
        subject = self.subject(results)
        return None if subject is None else contents(self.of(results), subject)


ERROR_GROUP = Group("errors", "Errors", ERRORS, lambda results: results.budget, "budget")
MOTION_GROUP = Group("motion", "Motion", MOTION, lambda results: results.budget, "budget")
SERVO_GROUP = Group(
    "servo",
    "Servo, by axis",
    (
        *(margin.by_axis(("loops", Item(AXIS), "margins")) for margin in MARGINS),
        *(ripple.by_axis(("loops", Item(AXIS))) for ripple in (TORQUE_RIPPLE, TORQUE_RIPPLE_PERCENT)),
    ),
    lambda results: results,
    "results",
)
BEAD_GROUP = Group("bead", "Bead", BEAD, lambda results: results.bead_values, "bead.values")
LOSSES_GROUP = Group("losses", "Cost of deliberate faults", LOSSES, lambda results: results.losses, "losses")

GROUPS = (ERROR_GROUP, MOTION_GROUP, SERVO_GROUP, BEAD_GROUP, LOSSES_GROUP)
