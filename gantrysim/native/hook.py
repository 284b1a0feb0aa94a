"""Puts the servo tick into MuJoCo's control callback for the time of a run, and what was there back."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np

from gantrysim.controllers.servo import PlainLaw, Tick
from gantrysim.errors import GantryError, InputError
from gantrysim.native.row import ROW, ROW_NUMBERS
from gantrysim.native.tick import compiled

__all__ = ["installed", "installed_law"]

_CALLBACK = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)

_SILENCE = ctypes.CFUNCTYPE(None, ctypes.c_char_p)(lambda _text: None)

_turn = threading.Lock()  # held while any callback of ours is installed
_count_lock = threading.Lock()
_count = 0
_previous: Any = None
_thread = threading.local()  # .depth: runs that this thread is in


@contextmanager
def installed() -> Iterator[None]:
    """Have the compiled tick installed; several threads may at once, and what was there before comes back.

    Raises:
        GantryError: called from within a law in plain Python.
    """
    global _count, _previous
    if getattr(_thread, "law", False):
        raise GantryError("a law in plain Python cannot run a simulation: it is inside one")
    with _count_lock:
        if _count == 0:
            callback = compiled().callback
            _turn.acquire()
            _previous = _take_over(callback)
        _count += 1
    _thread.depth = getattr(_thread, "depth", 0) + 1
    try:
        yield
    finally:
        _thread.depth -= 1
        with _count_lock:
            _count -= 1
            if _count == 0:
                _give_back(_previous)
                _turn.release()


@contextmanager
def installed_law(data: mujoco.MjData, law: PlainLaw) -> Iterator[None]:
    """Have a law in plain Python installed for one simulation, alone; it raises here what the law raised.

    Raises:
        GantryError: called from within another run of this thread.
    """
    if getattr(_thread, "law", False) or getattr(_thread, "depth", 0):
        raise GantryError("a simulation with a law in plain Python cannot run inside another simulation")
    tick = compiled()
    own, userdata, row = data._address, data.userdata.ctypes.data, data.userdata[:ROW_NUMBERS].view(ROW)[0]
    n = int(row["axes"])
    raised: list[BaseException] = []

    def on_control(_model: int, address: int) -> None:
        if address != own or raised:
            return
        try:
            if tick.sample(own, userdata):
                torque = np.asarray(law(_tick(row, n)), float)
                if torque.shape != (n,) or not np.isfinite(torque).all():
                    raise InputError(f"law returned {torque.tolist()}: must be {n} finite torques, one per axis [N·m]")
                row["torque"][:n] = torque
                tick.command(own, userdata)
            tick.output(own, userdata)
        except BaseException as error:  # must not unwind through MuJoCo's C frames
            raised.append(error)
            data.ctrl[:] = 0

    callback = _CALLBACK(on_control)
    with _turn:
        previous = _take_over(callback)
        _thread.law = True
        try:
            yield
        finally:
            _thread.law = False
            _give_back(previous)
    if raised:
        raise raised[0]


def _take_over(callback: Any) -> tuple[Any, Any]:
    """Install a control callback, and have MuJoCo's warnings go nowhere: the tick makes faults of them."""
    previous = mujoco.get_mjcb_control(), mujoco.get_mju_user_warning()
    mujoco.set_mjcb_control(callback)
    mujoco.set_mju_user_warning(_SILENCE)
    return previous


def _give_back(previous: tuple[Any, Any]) -> None:
    control, warning = previous
    mujoco.set_mjcb_control(control)
    mujoco.set_mju_user_warning(warning)


def _tick(row: Any, n: int) -> Tick:
    names = ("commanded", "measured", "error", "demand_velocity", "demand_acceleration", "measured_velocity")
    period = float(row["period"])
    return Tick(float(row["tick"]) * period, period, *(row[name][:n].copy() for name in names))
