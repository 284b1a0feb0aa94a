"""The servo: integral time and natural frequency of its loops, and additions to its law.

The search of `gantrysim tune` takes hundreds of runs on perturbed machines; here the loop is only designed stiffer or
softer, and its margins are those of the verdict. The additions are friction compensation, disturbance observer and
learning.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from gantrysim.job.settings import INTEGRAL_TIME, has_loop_gains
from gantrysim.remedy.lever import Lever, Setting, State, factor_text, milliseconds, rounded_number
from gantrysim.results.verdict import PATH, STABILITY
from gantrysim.servo.laws import FRICTION, LEARNING, OBSERVER, PD
from gantrysim.servo.laws.law import Law
from gantrysim.servo.laws.selection import is_own
from gantrysim.servo.stability.motion import MODES

_SHORTER_TIMES = (0.5, 0.3)  # integral times, of the present one
_FREQUENCIES = (0.8, 1.2, 1.4)  # of the present one
_GIVEN_GAINS = "the gains of the loop are given in the job"


def _integral(state: State) -> list[Setting] | str:
    servo = state.job.servo
    if has_loop_gains(dict(servo)):
        return _GIVEN_GAINS
    if PD.name in state.job.built_servo.laws.names:
        return "the law pd has no integral term"
    time = float(servo.integral_time)
    times = [INTEGRAL_TIME] if math.isinf(time) else [rounded_number(share * time) for share in _SHORTER_TIMES]
    return [Setting(milliseconds(value), {"servo.integral_time": value}) for value in times]


def _frequency(state: State) -> list[Setting] | str:
    servo = state.job.servo
    if has_loop_gains(dict(servo)):
        return _GIVEN_GAINS
    built = state.job.built_servo
    if set(built.modes) != {MODES[0]}:
        return "the drives close the loops themselves"
    if built.laws.user is not None:
        return "the gains of a law of your own are its own"
    # kp = J w^2, with one frequency for all axes
    axis = state.job.built_machine.axes[0]
    present = math.sqrt(built.gains[0].kp / axis.inertia) / math.tau
    return [
        Setting(factor_text(factor), {"servo.frequency": rounded_number(factor * present)}) for factor in _FREQUENCIES
    ]


INTEGRAL = Lever(
    name="integral time",
    meaning="kp / ki of the servo",
    cost="margin",
    rows=(PATH,),
    settings=_integral,
    causes=("friction", "winding"),
)
LOOP_GAINS = Lever(
    name="loop gains",
    meaning="natural frequency of the loops, from which all gains follow",
    cost="margin, or following error",
    rows=(PATH, STABILITY),
    settings=_frequency,
)


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
