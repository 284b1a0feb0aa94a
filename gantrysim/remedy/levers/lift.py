"""The needle lifted in dry moves, so that it does not plough the bead."""

from __future__ import annotations

from gantrysim.remedy.lever import Effort, Lever, Setting, State
from gantrysim.results.verdict import GLUE

_HEIGHT = 3.0  # [mm], above every bead of the built-in needles
_CHECK = "bead_ploughed"


def _settings(state: State) -> list[Setting] | str:
    verdict = state.outcome.verdict
    checks = () if verdict is None else verdict[GLUE].checks
    if not any(check.name == _CHECK and check.value > 0 for check in checks):
        return "the needle does not touch its bead"
    if "z" not in state.job.built_machine.axis_names:
        return "the machine has no axis z"
    arguments = state.job.controller.with_lift(_HEIGHT)
    if arguments is None:
        return "the program itself sets the height of the needle"
    return [Setting(f"{_HEIGHT:g} mm", {f"program.{key}": value for key, value in arguments.items()})]


LIFT = Lever(
    name="lift",
    meaning="height by which the needle is lifted in dry moves",
    cost="time to lift and lower",
    rows=(GLUE,),
    settings=_settings,
    effort=Effort.PROCESS,
)
