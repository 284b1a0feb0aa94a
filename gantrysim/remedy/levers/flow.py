"""Flow proportional to the path speed: the flow falls where the program slows down, so that the section stays.

A dispenser that lags is late with every change of the speed, where a fixed flow has nothing to be late with. Both alone
may therefore be worse than the job as it is, so that they are also tried together.
"""

from __future__ import annotations

from gantrysim.glue.dispenser.dispenser import DEMANDS
from gantrysim.remedy.lever import Lever, Setting, State
from gantrysim.remedy.levers.numbers import milliseconds
from gantrysim.remedy.levers.valve import compensations
from gantrysim.results.verdict import GLUE

_DIGITS = 3  # of the area


def _settings(state: State) -> list[Setting] | str:
    dispenser = state.job.dispenser
    if dispenser.area:
        return "the flow is proportional to the path speed"
    if dispenser.per_e:
        return "E states the flow, which is proportional to the path speed"
    outcome = state.outcome
    if not outcome.nominal:
        return "the job lays no bead"
    if outcome.dots:
        return "dots are laid while the nozzle rests, where a flow proportional to the speed is zero"
    area = float(f"{outcome.nominal:.{_DIGITS}g}")
    fixed = {f"dispenser.{name}": 0.0 for name in DEMANDS if getattr(dispenser, name)}
    changes = {**fixed, "dispenser.area": area}
    return [
        Setting(f"area {area:g} mm²", changes),
        *(
            Setting(f"area {area:g} mm², {milliseconds(value)} compensated", {**changes, "dispenser.advance": value})
            for value in compensations(dispenser)
        ),
    ]


PROPORTIONAL_FLOW = Lever(
    name="flow by speed",
    meaning="flow proportional to the path speed",
    cost="an analogue output for the pump",
    rows=(GLUE,),
    settings=_settings,
)
