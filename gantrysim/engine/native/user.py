"""A user's own law as a function that the servo tick can call, by its address."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

import numba
import numpy as np
from numba import NumbaError, types

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.engine.native.pointers import floats_at, row_at
from gantrysim.machine.row import ROW
from gantrysim.servo.laws.user import STATE, UserLaw, UserTick

_CALLED = ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_int64)
_GIVEN = UserTick._fields[3:]


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
        self._kept: Any = _compiled_law(law).ctypes if hasattr(law, "py_func") else _CALLED(self.call)
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
            given = [row[name][:n] for name in _GIVEN]
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
