"""Defaults of jobs and program files: one table for the values that nobody gave."""

from __future__ import annotations

INTEGRAL_TIME = 0.03  # kp / ki of the servo, as in the built-in jobs [s]
MACHINE = "xy"

# built-in machines of Cartesian axes, the smallest first: a program file runs on the first that has what it moves
MACHINES = {
    "xy": ("x", "y"),
    "xyz": ("x", "y", "z"),
    "xyzr": ("x", "y", "z", "r"),
}
TURNING_MACHINE = "stage"  # for programs that give positions of the axes of a machine that turns its work

# keys of [dispenser] that state the amount of glue; without one, it follows from needle and path speed
GLUE = ("flow", "area", "pressure")


def smallest_machine(axes: tuple[str, ...]) -> str:
    """Return the smallest built-in machine with these axes; `MACHINE` where none has them, which then names them."""
    for name, machine_axes in MACHINES.items():
        if set(axes) <= set(machine_axes):
            return name
    return MACHINE
