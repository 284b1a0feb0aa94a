"""Height of the needle above the work."""

from __future__ import annotations

from gantrysim.remedy.lever import Effort, Lever, Setting, State
from gantrysim.remedy.levers.numbers import factor_text, rounded_number
from gantrysim.results.verdict import GLUE

_GAPS = (0.8, 1.25, 1.5)


def _settings(state: State) -> list[Setting] | str:
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
    settings=_settings,
    effort=Effort.PROCESS,
)
