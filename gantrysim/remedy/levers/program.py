"""The program: acceleration and corners, its speed, and its own loop.

Acceleration and corners are changed by the arguments that the controller names. The flow follows the speed, so that
the bead keeps its section. A loop commands its path in passes: its period, and the rounding of its waits.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from gantrysim.base.errors import InputError
from gantrysim.controllers.loop_theory import LoopTheory
from gantrysim.remedy.lever import (
    Effort,
    Lever,
    Setting,
    State,
    factor_text,
    milliseconds,
    rounded_number,
    scaled_numbers,
    value_of,
)
from gantrysim.results.verdict import GLUE, MACHINE, PATH
from gantrysim.study.speed.study import speed_changes

_RAMPS = (0.25, 0.5, 2.0, 4.0)
_CORNERS = (0.25, 0.5, 2.0)
# tolerances of corners that have none, relative to the largest contour error accepted
_CORNER_TOLERANCES = (0.8, 0.5, 0.25)


def _is_limited(value: object) -> bool:
    """Whether a number, or all of a list, is finite and greater than 0."""
    items = value if isinstance(value, list | tuple) else [value]
    return all(isinstance(item, int | float) and math.isfinite(item) and item > 0 for item in items)


def _ramps(state: State) -> list[Setting] | str:
    controller = state.job.controller
    if not controller.ramp_arguments:
        return "the program's text sets the accelerations"
    arguments = controller.arguments()
    values = {name: value_of(arguments, name) for name in controller.ramp_arguments}
    limits = {name: value for name, value in values.items() if _is_limited(value)}
    if not limits:
        return "the program has no limit of the acceleration"
    return [
        Setting(
            factor_text(factor), {f"program.{name}": scaled_numbers(value, factor) for name, value in limits.items()}
        )
        for factor in _RAMPS
    ]


def _corners(state: State) -> list[Setting] | str:
    controller = state.job.controller
    name = controller.corner_argument
    if name is None:
        return "no key of the controller rounds corners"
    value = value_of(controller.arguments(), name)
    verdict = state.outcome.verdict
    if value == math.inf and controller.corner_cut > 0 and verdict is not None:
        limits = [1e-3 * check.limit for check in verdict[PATH].checks if check.name == "path_max"]
        distances = [float(f"{share * limit:.2g}") for limit in limits for share in _CORNER_TOLERANCES]
        return [Setting(f"within {distance:g} mm by G64 P", {f"program.{name}": distance}) for distance in distances]
    if value == math.inf:
        return "no corner of the program is rounded without a tolerance"
    if not _is_limited(value):
        return "the program does not round corners"
    return [Setting(factor_text(factor), {f"program.{name}": scaled_numbers(value, factor)}) for factor in _CORNERS]


ACCELERATION = Lever(
    name="acceleration",
    meaning="limits of acceleration and jerk along the program",
    cost="time",
    cost_above="torque",
    rows=(PATH, GLUE, MACHINE),
    settings=_ramps,
)
CORNERS = Lever(
    name="corner rounding",
    meaning="distance or time over which the controller rounds corners",
    cost="time",
    cost_above="shape of the corners",
    rows=(PATH, GLUE, MACHINE),
    settings=_corners,
    effort=Effort.PROCESS,
)


_SLOWER_FACTORS = (0.84, 0.71, 0.5)
_FASTER_FACTORS = (1.41,)


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
    settings=_at_factors(_SLOWER_FACTORS),
    effort=Effort.PROCESS,
)
FASTER = Lever(
    name="faster",
    meaning="speed of the program, with the flow that keeps the bead's section",
    cost="following error",
    rows=(GLUE,),
    settings=_at_factors(_FASTER_FACTORS),
)


def at_factor(factor: float) -> Lever:
    """Return the lever of the speed with one setting, a factor of the speed."""
    return replace(FASTER if factor > 1 else SLOWER, settings=_at_factors((factor,)))


_LOOP_PERIODS = (2.0, 0.5, 0.2, 0.1, 0.05)  # of the present one


def _loop_theory(state: State) -> LoopTheory | None:
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
    if _loop_theory(state) is None:
        return _no_loop(state)
    period = float(state.job.program["loop_period"])
    if not period:
        return "the program is the continuous limit of its loop"
    values = [rounded_number(factor * period) for factor in _LOOP_PERIODS]
    return [Setting(milliseconds(value), {"program.loop_period": value}) for value in values]


def _waits(state: State) -> list[Setting] | str:
    theory = _loop_theory(state)
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
