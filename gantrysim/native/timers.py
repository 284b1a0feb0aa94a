"""MuJoCo's timers, which read a clock some 25 times a step: without a clock they are not even asked.

Its Python package installs a clock of its own and can replace it, not remove it. C code finds it in a global variable.
"""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path
from typing import Any

import mujoco

from gantrysim.native.callback import clock

_LIBRARIES = ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll")
_CLOCK = ctypes.CFUNCTYPE(ctypes.c_double)


def stop_timers() -> Any:
    """Take the clock of MuJoCo's timers away and return it for `restart_timers`; within stopped timers it is none."""
    slot = _clock_slot()
    if slot is None:
        before = mujoco.get_mjcb_time()  # None for MuJoCo's own
        mujoco.set_mjcb_time(clock())  # which stands still
        return before
    address = slot.value
    slot.value = None
    return address


def restart_timers(before: Any) -> None:
    """Give MuJoCo's timers the clock back that `stop_timers` took."""
    slot = _clock_slot()
    if slot is None:
        mujoco.set_mjcb_time(before)
    else:
        slot.value = before


@cache
def _clock_slot() -> Any:
    """Return MuJoCo's variable that holds the address of the clock, None where it is not found."""
    folder = Path(mujoco.__file__).parent
    for file in (file for pattern in _LIBRARIES for file in folder.glob(pattern)):
        try:
            slot = ctypes.c_void_p.in_dll(ctypes.CDLL(str(file)), "mjcb_time")
        except (OSError, ValueError):  # no library, or one without the variable
            continue
        if _is_the_clock(slot):
            return slot
    return None


def _is_the_clock(slot: Any) -> bool:
    """Return whether a variable follows the clock that MuJoCo's package installs: not one of another library."""
    before = mujoco.get_mjcb_time()
    probe = _CLOCK(lambda: 0.0)
    mujoco.set_mjcb_time(probe)
    try:
        return bool(slot.value == ctypes.cast(probe, ctypes.c_void_p).value)
    finally:
        mujoco.set_mjcb_time(before)
