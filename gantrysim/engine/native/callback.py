"""The servo tick as MuJoCo's control callback: compiled, and installed for the time of a run.

The previous callback is restored at the end. A law in plain Python calls the parts of the tick instead. Meanwhile the
clock of MuJoCo's timers stands still: reading the one that its Python package installs is a third of a gantry's step.
"""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

import ctypes
import threading
from collections import namedtuple
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import mujoco
import numba
import numpy as np
from numba import types

from gantrysim.base import signals
from gantrysim.base.errors import GantryError, InputError
from gantrysim.base.jit import c_function, jit, source_hash
from gantrysim.engine.native.pointers import floats_at, integer_at, pointer, row_at, tape_of
from gantrysim.engine.native.stages import has_stages
from gantrysim.engine.native.tick import DRIVE, command, output, sample, step
from gantrysim.machine.layout import WARNING_NUMBER, WARNING_SIZE, offsets
from gantrysim.machine.quiet import silence
from gantrysim.machine.row import ROW, ROW_NUMBERS, WARNINGS
from gantrysim.servo.laws.user import PlainLaw, Tick

_INTEGER = types.int32

_FIELDS = tuple(offsets())
Offsets: Any = namedtuple("Offsets", _FIELDS)  # type: ignore[misc]
_CALLBACK = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)

Interrupted = Callable[[], bool]

_POLL = 0.05  # how often a waiting thread checks for Ctrl-C [s]

_changed = threading.Condition(threading.Lock())  # guards the three below
_users = 0  # number of installations of the compiled tick; -1: a law in plain Python, which is alone
_previous: Any = None  # callback before the first of them
_clock: Any = None  # the caller's own clock of MuJoCo's timers, which stays; None for MuJoCo's, which is replaced
_thread = threading.local()  # .depth: number of installations by this thread; .law: whether by a law in plain Python


@cache
def magic() -> int:
    """Return a number of the package's text, the row's layout included, by which the callback knows a servo's row."""
    return int(source_hash()[:15], 16)


def _offsets() -> Any:
    # of NumPy's type, as numba compiles functions anew for literals of Python's
    return Offsets(**{name: np.int64(offset) for name, offset in offsets().items()})


@cache
def callback() -> Any:
    """Return the tick as a C function (mjModel, mjData), compiled or from numba's cache."""
    fields = _offsets()
    row_size = np.int64(ROW_NUMBERS)
    key = np.int64(magic())

    def tick(model, data):
        if integer_at(model + fields.nuserdata) < row_size:
            return
        row = row_at(integer_at(data + fields.userdata))
        if row.magic != key:
            return
        read(data, row, fields)
        step(row)
        write(data, row, fields)

    return c_function(tick, types.void(types.int64, types.int64)).ctypes


@jit
def read(data, row, fields):
    """Read the machine's state out of MuJoCo's data into a servo's row.

    Args:
        data: address of the mjData.
        row: the row, in the data's userdata.
        fields: offsets of the data's fields.
    """
    row.address = integer_at(data + fields.userdata)
    length = _array(data, fields.actuator_length)
    velocity = _array(data, fields.actuator_velocity)
    position = _array(data, fields.qpos)
    currents = _array(data, fields.act)
    for a in range(row.axes):
        row.angle[a] = length[row.output_at[a]]
        row.motor_speed[a] = velocity[row.output_at[a]]
        row.winding_current[a] = currents[row.current_at[a]] if row.current_at[a] >= 0 else np.nan
        row.joint_place[a] = position[row.joint_at[a]]
    if row.phase == 0:
        row.lost = _has_warned(data + fields.warning)
        _read_nozzle(data, row, fields)
    if row.stages != 0:
        speed = _array(data, fields.qvel)
        passive = _array(data, fields.qfrc_passive)
        for a in range(row.axes):
            row.joint_speed[a] = speed[row.dof_at[a]]
            row.passive[a] = passive[row.dof_at[a]]
            if row.load_at[a] >= 0:
                row.load_place[a] = position[row.load_at[a]]
                row.load_passive[a] = passive[row.load_dof_at[a]]


@jit
def write(data, row, fields):
    """Write what acts on the machine in the next step from a servo's row into MuJoCo's data; arguments as of `read`."""
    ctrl = _array(data, fields.ctrl)
    for a in range(row.axes):
        ctrl[row.control_at[a]] = row.control_torque[a]
    if row.stages != 0:
        currents = _array(data, fields.act)
        for a in range(row.axes):
            if row.current_at[a] >= 0:
                currents[row.current_at[a]] = row.winding_current[a]
        if has_stages(row, DRIVE):
            applied = _array(data, fields.qfrc_applied)
            for a in range(row.axes):
                applied[row.dof_at[a]] = row.applied[a]


@jit
def _array(data, offset):
    """Return the doubles to which the pointer at an offset of MuJoCo's data points, however many they are."""
    return floats_at(integer_at(data + offset))


@jit
def _has_warned(address):
    """Return whether MuJoCo has warned of anything."""
    statistics = numba.carray(pointer(address, _INTEGER), (2 * WARNINGS,))
    # loops, here and below, as numba takes seconds to compile NumPy's reductions and assignments to slices
    for warning in range(WARNINGS):  # noqa: SIM110 - numba knows no generators
        if statistics[(warning * WARNING_SIZE + WARNING_NUMBER) // 4] > 0:
            return True
    return False


@jit
def _read_nozzle(data, row, fields):
    """Read the nozzle's position in the work frame [mm]."""
    tip = _array(data, fields.site_xpos)
    origin = _array(data, fields.xpos)
    frame = _array(data, fields.xmat)
    t = 3 * row.nozzle_site
    o = 3 * row.work_body
    f = 9 * row.work_body
    x = tip[t] - origin[o]
    y = tip[t + 1] - origin[o + 1]
    z = tip[t + 2] - origin[o + 2]
    for i in range(3):
        row.nozzle[i] = 1e3 * (frame[f + i] * x + frame[f + 3 + i] * y + frame[f + 6 + i] * z)


@cache
def clock() -> Any:
    """Return a C function for MuJoCo's timers that takes no time to tell: it is always 0."""

    def always_zero():
        return 0.0

    return c_function(always_zero, types.float64()).ctypes


@cache
def parts() -> tuple[Any, Any, Any]:
    """Return the tick before, after and without its law for one in plain Python, functions of mjData and of the row.

    The first returns whether a tick begins with this physics step, the second takes the law's torques, and the third
    sets the controls of every step.
    """
    fields = _offsets()
    key = np.int64(magic())

    def before_law(data, address):
        row = row_at(address)
        if row.magic != key:
            return False
        read(data, row, fields)
        return sample(row, tape_of(row))

    def after_law(data, address):
        row = row_at(address)
        if row.magic == key:
            command(row, tape_of(row))

    def every_step(data, address):
        row = row_at(address)
        if row.magic == key:
            output(row, None)
            write(data, row, fields)

    ends = types.void(types.int64, types.int64)
    return (
        c_function(before_law, types.boolean(types.int64, types.int64)).ctypes,
        c_function(after_law, ends).ctypes,
        c_function(every_step, ends).ctypes,
    )


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
