"""How a servo period and a servo delay divide into physics steps."""

from __future__ import annotations

from gantrysim.controllers.setpoints import ticks
from gantrysim.errors import InputError, at_least
from gantrysim.machine.machine import Machine

_SHORTEST_STEP = 1e-7  # [s]


def substeps_of(machine: Machine, period: float, physics_step: float | None = None) -> int:
    """Return the number of physics steps in a servo period.

    Args:
        machine: whose MJCF has the longest step in it.
        period: servo period [s].
        physics_step: longest physics step, at most and by default the machine's own [s].

    Raises:
        InputError: a step that is too short, or longer than the machine's own.
    """
    longest = float(machine.physics.opt.timestep)
    if physics_step is None:
        return ticks(period, longest)
    step = at_least("physics_step", physics_step, _SHORTEST_STEP, "s")
    if step > longest * (1 + 1e-9):
        raise InputError(
            f"physics_step = {step:g} s: must be at most {longest:g} s, "
            f"the timestep that machine {machine.name} is made for"
        )
    return ticks(period, step)


def delay_steps(delay: float, period: float, substeps: int) -> int:
    """Return the servo's delay in physics steps.

    Args:
        delay: from the sample to the output [s].
        period: servo period [s].
        substeps: physics steps in it.

    Raises:
        InputError: it is no whole number of them.
    """
    steps = delay / period * substeps
    if abs(steps - round(steps)) > 1e-6:
        raise InputError(f"servo delay = {delay:g} s: must be a multiple of the physics step, {period / substeps:g} s")
    return round(steps)
