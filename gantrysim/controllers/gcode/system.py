"""The parameters that the controller provides: what a program reads of its own state."""

from __future__ import annotations

from collections.abc import Callable

from gantrysim.base.errors import InputError
from gantrysim.controllers.gcode.program_state import UNSTATED_FEED, ProgramState

_VERSION = 2.9  # of LinuxCNC, whose words these are

_NAMED: dict[str, Callable[[ProgramState], float]] = {
    "_line": lambda state: float(state.line),
    "_feed": lambda state: state.modes.feed,
    "_rpm": lambda state: state.modes.spindle,
    "_plane": lambda state: 170.0 + 10 * state.modes.plane,  # G17 to G19, times ten
    "_motion_mode": lambda state: float(round(10 * float(state.motion[1:]))),  # the code, times ten
    "_vmajor": lambda state: _VERSION,
    # as of a program that runs, outside any call
    "_vminor": lambda state: 0.0,
    "_task": lambda state: 0.0,
    "_call_level": lambda state: 0.0,
    "_remap_level": lambda state: 0.0,
    "_value": lambda state: 0.0,
    "_value_returned": lambda state: 0.0,
}


_OF_TOOLS: dict[float | str, Callable[[ProgramState], float]] = {
    5400: lambda state: float(state.tools.in_spindle),
    5410: lambda state: state.tools.diameters.get(state.tools.in_spindle, 0.0) / state.frames.unit,
    "_current_tool": lambda state: float(state.tools.in_spindle),
    "_selected_tool": lambda state: float(state.tools.selected),
}
_MACHINE = ("_hal[", "_ini[")  # a pin of the machine's hardware layer, a value of its configuration


def provided(state: ProgramState, key: float | str) -> float | None:
    """Return a parameter of the controller; None for others.

    Raises:
        InputError: a value of the machine that the program is not given, but for a feed.
    """
    if isinstance(key, str):
        if key in state.setup.parameters:
            return state.setup.parameters[key]
        if key in _NAMED:
            return _NAMED[key](state)
        if key.startswith(_MACHINE):
            if "feed" not in key:
                raise InputError(f"#<{key}> is a value of the machine: must be given in parameters, by that name")
            state.assumed_feeds.add(key)
            return UNSTATED_FEED / state.frames.unit
    if key in _OF_TOOLS:
        return _OF_TOOLS[key](state)
    return state.frames.shown(key)
