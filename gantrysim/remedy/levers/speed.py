"""The program's speed, with the flow that keeps the bead's section."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from gantrysim.base.errors import InputError
from gantrysim.remedy.lever import Effort, Lever, Setting, State
from gantrysim.remedy.levers.numbers import factor_text, rounded_number
from gantrysim.results.verdict import GLUE, MACHINE, PATH
from gantrysim.study.speed.study import speed_changes

_SLOWER = (0.84, 0.71, 0.5)
_FASTER = (1.41,)


def _at_factors(factors: tuple[float, ...]) -> Callable[[State], list[Setting] | str]:
    def settings(state: State) -> list[Setting] | str:
        try:
            speed = state.job.controller.programmed_speed
        except InputError:
            return "the program states no path speed"
        changes = {factor: speed_changes(state.job, rounded_number(factor * speed)) for factor in factors}
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
