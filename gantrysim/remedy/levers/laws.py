"""Additions to the servo's law: friction compensation, disturbance observer, learning."""

from __future__ import annotations

from collections.abc import Callable

from gantrysim.remedy.lever import Lever, Setting, State
from gantrysim.results.verdict import PATH
from gantrysim.servo.laws import FRICTION, LEARNING, OBSERVER
from gantrysim.servo.laws.law import Law
from gantrysim.servo.laws.selection import is_own
from gantrysim.servo.stability.motion import MODES


def _with_law(addition: Law) -> Callable[[State], list[Setting] | str]:
    def settings(state: State) -> list[Setting] | str:
        names = state.job.servo.law
        present = [names] if isinstance(names, str) else list(names)
        if addition.name in present:
            return "in the law already"
        if addition.needs_known_base and any(map(is_own, present)):
            return "needs a base law whose answer it knows, not one of your own"
        if set(state.job.built_servo.modes) != {MODES[0]}:
            return "the drives close the loops themselves and take no torque"
        return [Setting("", {"servo.law": [*present, addition.name]})]

    return settings


FRICTION_COMPENSATION = Lever(
    name="friction compensation",
    meaning="friction torque from a model driven by the commanded motion",
    cost="a friction model to identify",
    rows=(PATH,),
    settings=_with_law(FRICTION),
    causes=("friction",),
)
DISTURBANCE_OBSERVER = Lever(
    name="disturbance observer",
    meaning=OBSERVER.meaning,
    cost="margin, noise in the torque",
    rows=(PATH,),
    settings=_with_law(OBSERVER),
    causes=("friction",),
)
LEARNING_TORQUE = Lever(
    name="learning",
    meaning=LEARNING.meaning,
    cost="repeats before the first part",
    rows=(PATH,),
    settings=_with_law(LEARNING),
    causes=("friction", "winding", "sampling", "compliance"),
)
