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
from gantrysim.errors import InputError
from gantrysim.native.row import ROW, ROW_NUMBERS
from gantrysim.native.tick import command, compiled, output, sample

__all__ = ["installed", "installed_law"]

_CALLBACK = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)

_turn = threading.Lock()  # held while any callback of ours is installed
_count_lock = threading.Lock()
_count = 0
_previous: Any = None


@contextmanager
def installed() -> Iterator[None]:
    """Have the compiled tick installed; several threads may at once, and what was there before comes back."""
    global _count, _previous
    with _count_lock:
        if _count == 0:
            callback = compiled()
            _turn.acquire()
            _previous = mujoco.get_mjcb_control()
            mujoco.set_mjcb_control(callback)
        _count += 1
    try:
        yield
    finally:
        with _count_lock:
            _count -= 1
            if _count == 0:
                mujoco.set_mjcb_control(_previous)
                _turn.release()


@contextmanager
def installed_law(data: mujoco.MjData, law: PlainLaw) -> Iterator[None]:
    """Have a law in plain Python installed for one simulation, alone; it raises here what the law raised."""
    own, userdata, row = data._address, data.userdata.ctypes.data, data.userdata[:ROW_NUMBERS].view(ROW)[0]
    n = int(row["axes"])
    raised: list[BaseException] = []

    def tick(_model: int, address: int) -> None:
        if address != own or raised:
            return
        try:
            if sample(own, userdata):
                torque = np.asarray(law(_tick(row, n)), float)
                if torque.shape != (n,) or not np.isfinite(torque).all():
                    raise InputError(f"law returned {torque.tolist()}: must be {n} finite torques, one per axis [N·m]")
                row["torque"][:n] = torque
                command(own, userdata)
            output(own, userdata)
        except BaseException as error:  # must not unwind through MuJoCo's C frames
            raised.append(error)
            data.ctrl[:] = 0

    callback = _CALLBACK(tick)
    with _turn:
        previous = mujoco.get_mjcb_control()
        mujoco.set_mjcb_control(callback)
        try:
            yield
        finally:
            mujoco.set_mjcb_control(previous)
    if raised:
        raise raised[0]


def _tick(row: Any, n: int) -> Tick:
    names = ("commanded", "measured", "demand_velocity", "demand_acceleration", "measured_velocity")
    return Tick(float(row["tick"] * row["period"]), *(row[name][:n].copy() for name in names))
