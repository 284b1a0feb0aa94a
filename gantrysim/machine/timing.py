"""Servo period and servo delay in physics steps."""

from __future__ import annotations

from gantrysim.base.errors import InputError, at_least
from gantrysim.machine.machine import Machine
from gantrysim.record.setpoints import periods

_SHORTEST_STEP = 1e-7  # [s]


def substeps_of(machine: Machine, period: float, physics_step: float | None = None, inner: float = 0.0) -> int:
    """Return the number of physics steps per servo period.

    Args:
        machine: the machine.
        period: servo period [s].
        physics_step: upper bound of the physics step; by default, and at most, the MJCF's timestep [s].
        inner: period of loops in the drives, of which the step is a whole fraction too; 0 for none [s].

    Raises:
        InputError: a step that is too short, or longer than the MJCF's.
    """
    longest = float(machine.layout.opt.timestep)
    if inner:
        return round(period / inner) * substeps_of(machine, inner, physics_step)
    if physics_step is None:
        return periods(period, longest)
    step = at_least("physics_step", physics_step, _SHORTEST_STEP, "s")
    if step > longest * (1 + 1e-9):
        raise InputError(
            f"physics_step = {step:g} s: must be at most {longest:g} s, the timestep of machine {machine.name}"
        )
    return periods(period, step)


def delay_steps(delay: float, period: float, substeps: int) -> int:
    """Return the servo delay in physics steps.

    Args:
        delay: time from sample to output [s].
        period: servo period [s].
        substeps: physics steps per period.

    Raises:
        InputError: the delay is not a multiple of the physics step.
    """
    steps = delay / period * substeps
    if abs(steps - round(steps)) > 1e-6:
        raise InputError(f"servo delay = {delay:g} s: must be a multiple of the physics step, {period / substeps:g} s")
    return round(steps)
