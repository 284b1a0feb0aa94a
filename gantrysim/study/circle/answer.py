"""The answer of a circular test: whether both directions keep the limits, and where their deviation arises."""

from __future__ import annotations

from collections.abc import Sequence

from gantrysim.metrics import CircularTest, Trace
from gantrysim.report.plots.style import UM
from gantrysim.study.acceptance import MOTION_LIMITS, Acceptance, Scope, improve_command
from gantrysim.study.cases import Row
from gantrysim.study.circle.study import CircleStudy

QUESTION = "Does this machine run a circle within the tolerance?"
_SCOPE = Scope(MOTION_LIMITS)  # it lays no glue
_HALF = 0.5


def circle_answer(study: CircleStudy, rows: Sequence[Row], test: CircularTest, motors: dict[str, Trace]) -> str:
    """Return the answer.

    Args:
        study: the study.
        rows: of both directions, with values.
        test: the paths of the nozzle.
        motors: paths of the motors by direction.
    """
    result = (
        f"circular deviation G = {UM * test.clockwise.circular_deviation:.1f} µm clockwise and "
        f"{UM * test.counter_clockwise.circular_deviation:.1f} µm counter-clockwise, bidirectional G(b) = "
        f"{UM * test.bidirectional_circular_deviation:.1f} µm, for a radius of {study.radius:g} mm at {study.speed:g} "
        f"mm/s on {study.job.built_machine.name}"
    )
    judged = {str(row["direction"]): acceptance for row in rows if (acceptance := Acceptance.of(row)) is not None}
    if len(judged) < len(rows):
        return f"Not judged by a tolerance: {result}."
    direction = max(judged, key=lambda name: judged[name].use(_SCOPE.aspects))
    worst = judged[direction]
    if worst.keeps(_SCOPE.aspects):
        return (
            f"Yes, both directions keep {_SCOPE.words}, with {_SCOPE.usage(worst)}, and nothing needs to change: "
            f"{result}."
        )
    return (
        f"No, run {direction} it is at {_SCOPE.excess(worst)}: {result}; {_source(test, motors)}, and "
        f"{improve_command(study.job)} tries the levers."
    )


def _source(test: CircularTest, motors: dict[str, Trace]) -> str:
    """Return on which side of the motors the larger circular deviation arises."""
    nozzle = {"clockwise": test.clockwise, "counter-clockwise": test.counter_clockwise}
    name = max(nozzle, key=lambda direction: nozzle[direction].circular_deviation)
    of_motors = motors[name].circular_deviation
    side = "before" if of_motors > _HALF * nozzle[name].circular_deviation else "behind"
    return f"the motors' G is {UM * of_motors:.1f} µm {name}, so most of it arises {side} the motors"
