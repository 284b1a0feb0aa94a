"""Installs the servo tick as MuJoCo's control callback for the time of a run, and restores the previous one.

MuJoCo's timers have a clock meanwhile that stands still: reading the one that its Python package installs is a third of
a gantry's step.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np

from gantrysim.base import signals
from gantrysim.base.errors import GantryError, InputError
from gantrysim.engine.native.callback import callback, clock, parts
from gantrysim.machine.quiet import silence
from gantrysim.machine.row import ROW, ROW_NUMBERS
from gantrysim.servo.laws.user import PlainLaw, Tick

_CALLBACK = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)

Interrupted = Callable[[], bool]

_POLL = 0.05  # how often a waiting thread checks for Ctrl-C [s]


_changed = threading.Condition(threading.Lock())  # guards the three below
_users = 0  # number of installations of the compiled tick; -1: a law in plain Python, which is alone
_previous: Any = None  # callback before the first of them
_clock: Any = None  # the caller's own clock of MuJoCo's timers, which stays; None for MuJoCo's, which is replaced
_thread = threading.local()  # .depth: number of installations by this thread; .law: whether by a law in plain Python


@contextmanager
def installed_tick() -> Iterator[Interrupted]:
    """Install the compiled tick in the block, which several threads may share.

    Signals that end a command are deferred to the end of the block; what is yielded tells whether one has come.

    Raises:
        GantryError: called from within a law in plain Python.
    """
    if getattr(_thread, "law", False):
        raise GantryError("a law in plain Python cannot run a simulation: it is inside one")
    with _installed_callback(callback(), alone=False) as interrupted:
        _thread.depth = getattr(_thread, "depth", 0) + 1
        try:
            yield interrupted
        finally:
            _thread.depth -= 1


@contextmanager
def installed_law(data: mujoco.MjData, law: PlainLaw) -> Iterator[Interrupted]:
    """Install a law in plain Python for one simulation in the block; other threads wait. Signals as of `installed`.

    At its end it raises what the law has raised.

    Raises:
        GantryError: called from within another run of this thread.
    """
    if getattr(_thread, "law", False) or getattr(_thread, "depth", 0):
        raise GantryError("a simulation with a law in plain Python cannot run inside another simulation")
    sample, command, output = parts()
    simulated = data._address
    userdata = data.userdata.ctypes.data
    row = data.userdata[:ROW_NUMBERS].view(ROW)[0]
    n = int(row["axes"])
    raised: list[BaseException] = []

    def on_control(_model: int, address: int) -> None:
        if address != simulated or raised:
            return
        try:
            if sample(simulated, userdata):
                torque = np.asarray(law(_tick(row, n)), float)
                if torque.shape != (n,) or not np.isfinite(torque).all():
                    raise InputError(f"law returned {torque.tolist()}: must be {n} finite torques, one per axis [N·m]")
                row["torque"][:n] = torque
                command(simulated, userdata)
            output(simulated, userdata)
        except BaseException as error:  # must not unwind through MuJoCo's C frames
            raised.append(error)
            data.ctrl[:] = 0

    with _installed_callback(_CALLBACK(on_control), alone=True) as interrupted:
        _thread.law = True
        try:
            yield interrupted
        finally:
            _thread.law = False
    if raised:
        raise raised[0]


@contextmanager
def _installed_callback(function: Any, *, alone: bool) -> Iterator[Interrupted]:
    """Install a control callback in the block, as soon as others have finished.

    An interrupt that came while the callback is installed or removed would leave MuJoCo without the callback, the clock
    or the warnings of the caller, and other threads waiting for ever. So it is deferred over all of it.

    Args:
        function: the control callback.
        alone: whether no other may be installed meanwhile.
    """
    while True:
        with signals.deferred() as interrupted:
            if _take(function, alone=alone):
                try:
                    yield interrupted
                finally:
                    _give_back()
                return
        with _changed:
            _changed.wait(_POLL)


def _take(function: Any, *, alone: bool) -> bool:
    """Install a callback unless others must finish before, and return whether it is."""
    global _users, _previous, _clock
    with _changed:
        if _users < 0 or (alone and _users):
            return False
        if not _users:
            _previous = mujoco.get_mjcb_control()
            mujoco.set_mjcb_control(function)
            _clock = mujoco.get_mjcb_time()
            if _clock is None:  # MuJoCo's own
                mujoco.set_mjcb_time(clock())
            # the tick turns MuJoCo's warnings into faults
            silence(1)
        _users = -1 if alone else _users + 1
        return True


def _give_back() -> None:
    global _users
    with _changed:
        _users = max(_users - 1, 0)
        if not _users:
            mujoco.set_mjcb_control(_previous)
            if _clock is None:
                mujoco.set_mjcb_time(None)
            silence(-1)
            _changed.notify_all()


def _tick(row: Any, n: int) -> Tick:
    names = ("commanded", "measured", "error", "demand_velocity", "demand_acceleration", "measured_velocity")
    period = float(row["period"])
    return Tick(float(row["tick"]) * period, period, *(row[name][:n].copy() for name in names))
