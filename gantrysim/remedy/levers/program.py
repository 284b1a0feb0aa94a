"""The program: acceleration and corners, by the arguments that its controller names."""

from __future__ import annotations

import math

from gantrysim.remedy.lever import Effort, Lever, Setting, State
from gantrysim.remedy.levers.numbers import factor_text, scaled_numbers, value_of
from gantrysim.results.verdict import GLUE, MACHINE, PATH

_RAMPS = (0.25, 0.5, 2.0, 4.0)
_CORNERS = (0.25, 0.5, 2.0)
_ROUNDED = (0.8, 0.5, 0.25)  # tolerances of corners that have none, relative to the largest contour error accepted


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
        distances = [float(f"{share * limit:.2g}") for limit in limits for share in _ROUNDED]
        return [Setting(f"within {distance:g} mm by G64 P", {f"program.{name}": distance}) for distance in distances]
    if value == math.inf:
        return "no corner of the program is rounded without a tolerance"
    if not _is_limited(value):
        return "the program does not round corners"
    return [Setting(factor_text(factor), {f"program.{name}": scaled_numbers(value, factor)}) for factor in _CORNERS]


ACCELERATION = Lever(
    name="acceleration",
    meaning="limits of acceleration and jerk along the program",
    cost="torque, or time",
    rows=(PATH, GLUE, MACHINE),
    settings=_ramps,
)
CORNERS = Lever(
    name="corner rounding",
    meaning="distance or time over which the controller rounds corners",
    cost="shape, or time",
    rows=(PATH, GLUE, MACHINE),
    settings=_corners,
    effort=Effort.PROCESS,
)
