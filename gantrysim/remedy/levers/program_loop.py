"""The program's own loop, where a path is commanded in passes: its period, and the rounding of its waits."""

from __future__ import annotations

from gantrysim.controllers.loop_theory import LoopTheory
from gantrysim.remedy.lever import Effort, Lever, Setting, State
from gantrysim.remedy.levers.numbers import milliseconds, rounded_number
from gantrysim.results.verdict import GLUE, PATH

_PERIODS = (2.0, 0.5, 0.2, 0.1, 0.05)  # of the present one


def _theory(state: State) -> LoopTheory | None:
    controller = state.job.controller
    return type(controller).loop_theory(controller.arguments())


def _no_loop(state: State) -> str:
    """Return why a program has no loop that can be varied."""
    loop = state.job.controller.loop_line()
    if loop is None:
        return "the program commands its path without a loop"
    number, line = loop
    return f"the program's own loop, line {number}, {line}, stands in its text"


def _periods(state: State) -> list[Setting] | str:
    if _theory(state) is None:
        return _no_loop(state)
    period = float(state.job.program["loop_period"])
    if not period:
        return "the program is the continuous limit of its loop"
    values = [rounded_number(factor * period) for factor in _PERIODS]
    return [Setting(milliseconds(value), {"program.loop_period": value}) for value in values]


def _waits(state: State) -> list[Setting] | str:
    theory = _theory(state)
    if theory is None:
        return _no_loop(state)
    if not theory.wait_resolution:
        return "the loop's waits are exact"
    return [
        Setting(f"instead of {theory.wait}", {f"program.{key}": value for key, value in theory.exact_waits.items()})
    ]


LOOP_PERIOD = Lever(
    name="loop period",
    meaning="nominal time of a pass of the program's loop",
    cost="computing time",
    rows=(PATH, GLUE),
    settings=_periods,
    causes=("program",),
)
EXACT_WAITS = Lever(
    name="exact waits",
    meaning="passes that end at a time or position of the servo, not after a wait that is rounded down",
    cost="another loop in the program",
    rows=(PATH, GLUE),
    settings=_waits,
    causes=("program",),
    effort=Effort.PROCESS,
)
