"""From a program's setpoints to positions of the machine's axes, checked before a run."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats, read_only
from gantrysim.base.errors import InputError, TimedError
from gantrysim.base.jit import jit
from gantrysim.machine.kinematics import UnreachableError
from gantrysim.machine.machine import Machine
from gantrysim.record.setpoints import Setpoints, Supervision

# of positions [mm]
_ROUNDING = 1e-9
_NEAR_TRAVEL = 1e-3


def check_supervision(machine: Machine, supervision: Supervision) -> None:
    """Raise InputError for a limit on the linear axes of a machine whose axes are no coordinates of the nozzle."""
    for name, unit in (("position_error", "mm"), ("velocity_limit", "mm/s")):
        value = getattr(supervision, name)
        if value < np.inf:
            axes = ", ".join(f"{axis.name} [{axis.unit}]" for axis in machine.plain_axes)
            raise InputError(
                f"{name} = {value:g} {unit}: must be inf on machine {machine.name}, whose axes {axes} are not those "
                "of its nozzle; limit the servo's following error instead"
            )


def program_positions(machine: Machine, setpoints: Setpoints) -> Floats:
    """Return the setpoints in all coordinates of the machine's kinematics, (n, coordinates) [mm or deg]; not to change.

    A coordinate that the program does not move is where it is with all axes at zero.

    Raises:
        InputError: an unknown coordinate, or one that the program does not move but that its path has elsewhere.
    """
    names = machine.kinematics.names
    for name in setpoints.axes:
        if name not in names:
            raise InputError(
                f"the program moves axis {name!r}: machine {machine.name} has {', '.join(names)}; run it on a machine "
                f"with {name}, or leave {name} out of the program"
            )
    if setpoints.axes == names:
        return setpoints.position
    begin = dict(zip("xyz", setpoints.requested.position(0.0)[0].tolist(), strict=True))
    for name, home in zip(names, machine.home.tolist(), strict=True):
        still = name in begin and name not in setpoints.axes and abs(home) > _ROUNDING
        if still and abs(begin[name] - home) > _NEAR_TRAVEL:
            raise InputError(
                f"the program does not move {name} and its path begins at {name} = {begin[name]:g} mm: on machine "
                f"{machine.name} it must move {name}, which is {home:g} mm with all axes at zero"
            )
    position = np.tile(machine.home, (len(setpoints.position), 1))
    position[:, [names.index(name) for name in setpoints.axes]] = setpoints.position
    return position


def axis_positions(machine: Machine, setpoints: Setpoints, *, is_checked: bool = True) -> Floats:
    """Return contiguous positions of all the machine's axes, (n, axes); read-only.

    Setpoints that name axes which are no coordinates give the positions of the axes themselves.

    Args:
        machine: of the axes.
        setpoints: of the program.
        is_checked: whether they are checked against travel and speed.

    Raises:
        InputError: an unknown axis, a position out of reach; if checked, also one out of travel, or a speed above the
            limit.
    """
    kinematics = machine.kinematics
    if set(setpoints.axes) <= set(machine.axis_names) and not set(setpoints.axes) <= set(kinematics.names):
        position = np.zeros((len(setpoints.position), len(machine.plain_axes)))
        position[:, [machine.axis_names.index(name) for name in setpoints.axes]] = setpoints.position
    else:
        program = program_positions(machine, setpoints)
        try:
            position = np.ascontiguousarray(kinematics.inverse(program))
        except UnreachableError as error:
            time = error.row * setpoints.period
            raise TimedError(f"{error}, at t = {time:.4g} s, on machine {machine.name}", time) from None
    position = read_only(position)
    if is_checked:
        _check_bounds(machine, setpoints, position)
    return position


def _check_bounds(machine: Machine, setpoints: Setpoints, position: Floats) -> None:
    """Raise TimedError for a position out of the travel, at the time when it leaves it, or a speed above the limit."""
    kinematics = machine.kinematics
    lowest = np.zeros(position.shape[1], np.intp)
    highest = np.zeros_like(lowest)
    fastest = np.zeros_like(lowest)
    _find_extremes(position, lowest, highest, fastest)

    def where(k: int) -> str:
        time = f"at t = {k * setpoints.period:.4g} s"
        if kinematics.axes_are_coordinates:
            return time
        return f"{time} ({kinematics.position_text(kinematics.forward(position[k : k + 1])[0])})"

    for a, axis in enumerate(machine.plain_axes):
        low, high = axis.travel
        for k in (int(lowest[a]), int(highest[a])):
            if not low <= position[k, a] <= high:
                first_outside = int(np.argmax((position[:, a] < low) | (position[:, a] > high)))
                leaves = first_outside * setpoints.period
                # the line that an error names is that in which the axis leaves its travel
                since = f"; it leaves it at t = {leaves:.4g} s" if first_outside != k else ""
                raise TimedError(
                    f"{axis.name} = {position[k, a]:.4g} {axis.unit} {where(k)}: "
                    f"must lie in the travel {low:g} to {high:g} {axis.unit} of machine {machine.name}{since}",
                    leaves,
                )
        k = int(fastest[a])
        speed = float(abs(position[min(k + 1, len(position) - 1), a] - position[k, a]) / setpoints.period)
        if speed > axis.speed_limit * (1 + 1e-9):
            raise TimedError(
                f"speed of {axis.name} = {speed:.6g} {axis.unit}/s {where(k)}: "
                f"must be at most {axis.speed_limit:.6g} {axis.unit}/s, the limit of machine {machine.name}",
                k * setpoints.period,
            )


def axis_torques(machine: Machine, setpoints: Setpoints) -> Floats | None:
    """Return the torques sent with the setpoints, for all the machine's axes, (n, axes) [N·m]; None for none.

    Raises:
        InputError: setpoints in coordinates that are not the machine's axes.
    """
    if setpoints.torque is None:
        return None
    if not set(setpoints.axes) <= set(machine.axis_names):
        raise InputError(
            f"setpoints of {', '.join(setpoints.axes)} with torques: must be of the axes of machine {machine.name}, "
            f"{', '.join(machine.axis_names)}"
        )
    torque = np.zeros((len(setpoints.position), len(machine.plain_axes)))
    torque[:, [machine.axis_names.index(name) for name in setpoints.axes]] = setpoints.torque
    return torque


@jit
def _find_extremes(
    position: Floats, lowest: NDArray[np.intp], highest: NDArray[np.intp], fastest: NDArray[np.intp]
) -> None:
    """Write the rows of each axis' lowest and highest position, and of its fastest step to the next row, (axes,)."""
    for a in range(position.shape[1]):
        low = position[0, a]
        high = low
        most = 0.0
        for k in range(1, position.shape[0]):
            here = position[k, a]
            step = abs(here - position[k - 1, a])
            if here < low:
                low = here
                lowest[a] = k
            if here > high:
                high = here
                highest[a] = k
            if step > most:
                most = step
                fastest[a] = k - 1
