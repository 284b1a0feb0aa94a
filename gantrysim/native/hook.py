"""Installs the servo tick as MuJoCo's control callback for the time of a run, and restores the previous one.

MuJoCo's timers are off meanwhile: its Python package installs a clock, and reading it is a third of a gantry's step.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Sequence
from contextlib import AbstractContextManager
from types import TracebackType
from typing import Any

import mujoco
import numpy as np

from gantrysim.base.errors import GantryError, InputError
from gantrysim.native.callback import callback, parts
from gantrysim.native.interrupts import Interrupts, called_by_c, careful
from gantrysim.native.quiet import silence
from gantrysim.native.row import ROW, ROW_NUMBERS
from gantrysim.native.timers import restart_timers, stop_timers
from gantrysim.servo.laws.plain import PlainLaw, Tick

_CALLBACK = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)

_POLL = 0.05  # how often a waiting thread checks for Ctrl-C [s]


_changed = threading.Condition(threading.Lock())  # guards the four below
_users = 0  # number of installations of the compiled tick; -1: a law in plain Python, which is alone
_previous: Any = None  # callback before the first of them
_timed = False  # whether MuJoCo's timers have a clock of the caller's own, which stays
_clock: Any = None  # MuJoCo's own clock, while it is away
_thread = threading.local()  # .depth: number of installations by this thread; .law: whether by a law in plain Python


def installed() -> AbstractContextManager[None]:
    """Return a context with the compiled tick installed, which several threads may share; safe against Ctrl-C.

    Raises:
        GantryError: called from within a law in plain Python.
    """
    if getattr(_thread, "law", False):
        raise GantryError("a law in plain Python cannot run a simulation: it is inside one")
    return _Installation(callback(), Interrupts())


def installed_law(data: mujoco.MjData, law: PlainLaw) -> AbstractContextManager[None]:
    """Return a context with a law in plain Python installed for one simulation; other threads wait.

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

    @called_by_c
    def on_control(_model: int, address: int) -> None:
        if address != simulated or raised:
            return
        try:
            interrupts.deliver()
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

    interrupts = Interrupts()
    return _Installation(_CALLBACK(on_control), interrupts, raised)


class _Installation(AbstractContextManager[None]):
    """A context with a control callback installed.

    It is no generator, as an interrupt between a generator's start and the block would leave it open.

    Args:
        callback: the control callback.
        interrupts: held back while it is installed and removed.
        raised: exceptions of the callback; None of one that raises nothing, which may be shared.
    """

    def __init__(self, callback: Any, interrupts: Interrupts, raised: Sequence[BaseException] | None = None) -> None:
        self._callback = callback
        self._interrupts = interrupts
        self._raised = raised
        self._taken = False

    @careful
    def __enter__(self) -> None:
        self._interrupts.hold(self)
        try:
            while not self._taken:
                self._take()
                self._interrupts.deliver()
        except BaseException:
            self._end()
            raise

    @careful
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._end()
        if self._raised and kind is None:
            raise self._raised[0]

    def _take(self) -> None:
        """Install the callback, or wait a little for others to finish."""
        global _users, _previous, _timed, _clock
        alone = self._raised is not None
        with _changed:
            if _users < 0 or (alone and _users):
                _changed.wait(_POLL)
                return
            if not _users:
                _previous = mujoco.get_mjcb_control()
                mujoco.set_mjcb_control(self._callback)
                _timed = mujoco.get_mjcb_time() is not None
                if not _timed:
                    _clock = stop_timers()
                silence(1)  # the tick turns MuJoCo's warnings into faults
            _users = -1 if alone else _users + 1
            self._taken = True
        if alone:
            _thread.law = True
        else:
            _thread.depth = getattr(_thread, "depth", 0) + 1

    def _end(self) -> None:
        global _users
        if self._taken:
            self._taken = False
            if self._raised is None:
                _thread.depth -= 1
            else:
                _thread.law = False
            with _changed:
                _users = max(_users - 1, 0)
                if not _users:
                    mujoco.set_mjcb_control(_previous)
                    if not _timed:
                        restart_timers(_clock)
                    silence(-1)
                    _changed.notify_all()
        self._interrupts.release()


def _tick(row: Any, n: int) -> Tick:
    names = ("commanded", "measured", "error", "demand_velocity", "demand_acceleration", "measured_velocity")
    period = float(row["period"])
    return Tick(float(row["tick"]) * period, period, *(row[name][:n].copy() for name in names))
