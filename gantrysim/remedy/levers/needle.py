"""The needle: its height above the work, and its lift in dry moves, so that it does not plough the bead."""

from __future__ import annotations

from gantrysim.remedy.lever import Effort, Lever, Setting, State, factor_text, rounded_number
from gantrysim.results.verdict import GLUE

_GAPS = (0.8, 1.25, 1.5)


def _needle_heights(state: State) -> list[Setting] | str:
    if not state.outcome.nominal:
        return "the job lays no bead"
    gap = state.job.bead.gap
    present = state.job.built_machine.gap if gap is None else gap
    return [Setting(factor_text(factor), {"bead.gap": rounded_number(factor * present)}) for factor in _GAPS]


NEEDLE_HEIGHT = Lever(
    name="needle height",
    meaning="height of the needle above the work: the bead is narrower and higher under a higher one",
    cost="shape of the bead",
    rows=(GLUE,),
    settings=_needle_heights,
    effort=Effort.PROCESS,
)


_LIFT = 3.0  # [mm], above every bead of the built-in needles
_PLOUGHING = "bead_ploughed"


def _lift_height(state: State) -> list[Setting] | str:
    verdict = state.outcome.verdict
    checks = () if verdict is None else verdict[GLUE].checks
    if not any(check.name == _PLOUGHING and check.value > 0 for check in checks):
        return "the needle does not touch its bead"
    if "z" not in state.job.built_machine.axis_names:
        return "the machine has no axis z"
    arguments = state.job.controller.with_lift(_LIFT)
    if arguments is None:
        return "the program itself sets the height of the needle"
    return [Setting(f"{_LIFT:g} mm", {f"program.{key}": value for key, value in arguments.items()})]


LIFT = Lever(
    name="lift",
    meaning="height by which the needle is lifted in dry moves",
    cost="time to lift and lower",
    rows=(GLUE,),
    settings=_lift_height,
    effort=Effort.PROCESS,
)
