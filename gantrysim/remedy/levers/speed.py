"""The program's speed, with the flow that keeps the bead's section."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from gantrysim.base.errors import InputError
from gantrysim.job.job import Job
from gantrysim.remedy.lever import Effort, Lever, Setting, State
from gantrysim.remedy.levers.numbers import factor_text, rounded
from gantrysim.results.verdict import GLUE, MACHINE, PATH

_SLOWER = (0.84, 0.71, 0.5)
_FASTER = (1.41,)


def speed_changes(job: Job, speed: float) -> dict[str, Any]:
    """Return the values of a job at another speed of its fastest motion [mm/s], with the same section of the bead.

    Raises:
        InputError: the program states no speed.
    """
    controller = job.controller
    factor = speed / controller.programmed_speed
    changes: dict[str, Any] = {}
    for key, value in controller.arguments_at(speed).items():
        # a number is printed for pasting, so that it must not end in digits of floating point
        changes[f"program.{key}"] = rounded(value) if isinstance(value, float) else value
    dispenser = job.dispenser
    if dispenser.flow:
        changes["dispenser.flow"] = rounded(factor * dispenser.flow)
    if dispenser.pressure and dispenser.needle is not None:
        flow = factor * float(dispenser.needle.flow(dispenser.pressure))
        changes["dispenser.pressure"] = rounded(float(dispenser.needle.pressure(flow)))
    return changes


def _at_factors(factors: tuple[float, ...]) -> Callable[[State], list[Setting] | str]:
    def settings(state: State) -> list[Setting] | str:
        try:
            speed = state.job.controller.programmed_speed
        except InputError:
            return "the program states no path speed"
        changes = {factor: speed_changes(state.job, rounded(factor * speed)) for factor in factors}
        return [Setting(factor_text(factor), values) for factor, values in changes.items()]

    return settings


SLOWER = Lever(
    name="slower",
    meaning="speed of the program, with the flow that keeps the bead's section",
    cost="cycle time",
    rows=(PATH, GLUE, MACHINE),
    settings=_at_factors(_SLOWER),
    effort=Effort.PROCESS,
)
FASTER = Lever(
    name="faster",
    meaning="speed of the program, with the flow that keeps the bead's section",
    cost="following error",
    rows=(GLUE,),
    settings=_at_factors(_FASTER),
)


def at_factor(factor: float) -> Lever:
    """Return the lever of the speed with one setting, a factor of the speed."""
    return replace(FASTER if factor > 1 else SLOWER, settings=_at_factors((factor,)))
