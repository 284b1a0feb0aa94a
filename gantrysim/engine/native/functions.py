"""Functions of laws and deliberate faults, written in plain Python, as stages of the servo tick.

They are compiled as parts of a stage, with what they call; tests can call the plain functions, and other rooms read
them. Torques that are sent with the setpoints are a stage too, and a user's own law is called by its address, compiled
or in plain Python.
"""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from inspect import getclosurevars
from types import FunctionType
from typing import Any, NamedTuple

import numba
import numpy as np
from numba import NumbaError, types

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.base.jit import jit
from gantrysim.engine.native.pointers import floats_at, gains_of, log_of, pointer, row_at
from gantrysim.engine.native.stages import compiled_stage
from gantrysim.machine.row import FAULT, LAW, ROW, Log
from gantrysim.servo import notch
from gantrysim.servo.laws.law import BaseLaw
from gantrysim.servo.laws.user import STATE, UserLaw, UserTick

_LAW = numba.from_dtype(LAW)
_FLOAT = types.float64
_FAULT = numba.from_dtype(FAULT)
_OBSERVER = ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_int64)
_GIVEN_FIELDS = UserTick._fields[3:]


@cache
def part(function: Callable[..., Any]) -> Any:
    """Return a plain function compiled, with the plain functions that it calls, for calls from compiled functions."""
    called = getclosurevars(function).globals
    return jit(with_parts(function, **{name: call for name, call in called.items() if isinstance(call, FunctionType)}))


def with_parts(function: Any, **parts: Any) -> Any:
    """Return a copy of a function that calls others, compiled, in place of some of its globals.

    Copies of one function that call different others have different names, by which numba's cache keeps them apart: a
    closure would have another key there in every process.

    Args:
        function: with names for them among its globals.
        parts: plain functions, by the names of the globals.
    """
    if not parts:
        return function
    names = {**function.__globals__, **{name: part(called) for name, called in parts.items()}}
    copy = FunctionType(function.__code__, names, function.__name__, function.__defaults__, function.__closure__)
    copy.__qualname__ = ".".join([function.__qualname__, *map(_full_name, parts.values())])
    if any("<" in _full_name(called) for called in parts.values()):
        raise ValueError(f"{copy.__qualname__}: functions compiled in place of others must have a name of their own")
    return copy


def _full_name(function: Any) -> str:
    return f"{function.__module__}.{function.__qualname__}"


_filtered = part(notch.filtered_output)


@jit
def take(row, axis, torque, integral):
    """Take the torque of a base law and its integral after this tick, the torque through the axis' notch."""
    row.torque[axis], row.notch_first[axis], row.notch_second[axis] = _filtered(
        torque, row.notch[axis], row.notch_first[axis], row.notch_second[axis]
    )
    row.next_integral[axis] = integral


@cache
def base_stage(law: BaseLaw) -> int:
    """Return the address of a base law as a stage."""
    return compiled_stage(with_parts(_tick_all_axes, tick=law.tick))


def tick(row, axis, gains):
    """Stand for the function of a base law."""
    raise NotImplementedError


def _tick_all_axes(address, argument):
    row = row_at(address)
    for axis in range(row.axes):
        torque, integral = tick(row, axis, gains_of(row, axis))
        take(row, axis, torque, integral)


@cache
def law_stage(function: Any) -> int:
    """Return the address of a law's function of row and laws as a stage; its argument is the address of the laws."""
    return compiled_stage(with_parts(_act_on_laws, act=function))


def act(row, entry):
    """Stand for the function of a law or of a fault."""
    raise NotImplementedError


def _act_on_laws(address, argument):
    row = row_at(address)
    act(row, numba.carray(pointer(argument, _LAW), (row.axes,)))


@cache
def feed_stage() -> int:
    """Return the address of the stage that adds torques sent with the setpoints; its argument is their address."""

    def stage(address, argument):
        row = row_at(address)
        torque = numba.carray(pointer(argument, _FLOAT), (row.ticks, row.axes))
        add_fed_torque(row, FedTape(log_of(row), torque))

    return compiled_stage(stage)


class FedTape(NamedTuple):
    """The log, and torques sent with the setpoints, (n, axes) [N·m]."""

    log: Log
    torque: Floats


@jit
def add_fed_torque(row, tape):
    """Add the torques that are sent with the setpoint of this tick."""
    setpoint = tape.log.tick[row.tick - row.first].setpoint
    for axis in range(row.axes):
        row.feedforward[axis] += tape.torque[setpoint, axis]


@cache
def fault_stage(function: Any) -> int:
    """Return the address of a fault's function of row and entry as a stage; its argument is the entry's address."""
    return compiled_stage(with_parts(_act_on_fault, act=function))


def _act_on_fault(row, argument):
    act(row_at(row), numba.carray(pointer(argument, _FAULT), (1,))[0])


class CalledLaw:
    """A user's law for one run.

    Args:
        law: the function; one that numba has compiled runs without Python.
        state: the law's own, (STATE,).

    Attributes:
        address: of a C function (row, state), a stage of the tick.
        raised: what the law has raised, in plain Python.
        state: the law's own.

    Raises:
        InputError: a law for numba that does not compile.
    """

    def __init__(self, law: UserLaw, state: Floats) -> None:
        self.raised: list[BaseException] = []
        self._law = law
        self.state = state
        self._kept: Any = _compiled_law(law).ctypes if hasattr(law, "py_func") else _OBSERVER(self.call)
        self.address = ctypes.cast(self._kept, ctypes.c_void_p).value or 0

    def call(self, address: int, _state: int) -> None:
        """Call a law in plain Python.

        Args:
            address: of the servo's row; in a batch another one at every step.
        """
        if self.raised:
            return
        try:
            row = np.ndarray(1, ROW, memoryview((ctypes.c_char * ROW.itemsize).from_address(address)))[0]
            n = int(row["axes"])
            period = float(row["period"])
            given = [row[name][:n] for name in _GIVEN_FIELDS]
            self._law(UserTick(n, float(row["tick"]) * period, period, *given), self.state, row["torque"][:n])
        except BaseException as error:  # must not unwind through C frames
            # the torque remains no number, which ends the run
            self.raised.append(error)


@cache
def _compiled_law(law: Any) -> Any:
    def call(address, state):
        row = row_at(address)
        n = row.axes
        tick = UserTick(
            n,
            row.tick * row.period,
            row.period,
            row.commanded[:n],
            row.measured[:n],
            row.error[:n],
            row.demand_velocity[:n],
            row.demand_acceleration[:n],
            row.measured_velocity[:n],
            row.gains[:n],
        )
        law(tick, floats_at(state)[:STATE], row.torque[:n])

    try:
        return numba.cfunc(types.void(types.int64, types.int64), error_model="numpy")(call)
    except NumbaError as error:
        words = " ".join(str(error).split())
        raise InputError(f"law {law.__name__} does not compile with numba: {words:.300}") from None
