"""What the key of the servo tick covers, and what a stage of it is compiled of."""

from __future__ import annotations

import types

import numba
import numpy as np
import pytest

from gantrysim.base import fingerprint
from gantrysim.base.jit import inner_jit
from gantrysim.native import tick
from gantrysim.native.compiling import part
from gantrysim.native.row import DIVERGED, FOLLOWING_ERROR, OSCILLATION, OVERSPEEDING, ROW, SETTLING, TRAVEL
from gantrysim.servo.laws.observer import observe

LIMIT = 2.0


def _inner(x):
    return min(x, LIMIT)


def _outer(x):
    return _inner(x) + 1.0


def test_the_key_of_the_tick_changes_with_its_layout_and_each_of_its_parts(monkeypatch):
    """A word more in the row moves all that come after it; a part is any function that the tick calls."""
    seen = set()
    ingredients = fingerprint._ingredients
    monkeypatch.setattr(fingerprint, "_ingredients", lambda f: seen.add(f.__name__) or ingredients(f))
    fingerprint.fingerprint.__wrapped__(tick.step)
    assert {"sample", "_apply_law", "torque_demand", "filtered", "trip", "row_at", "_rows", "typed_pointer"} <= seen
    assert repr(ROW.descr) in "".join(fingerprint._texts(tick.row_at.py_func, {}))


def test_a_part_is_compiled_with_the_plain_functions_that_it_calls():
    compiled = part(_outer)
    assert numba.njit(lambda value: compiled(value))(5.0) == _outer(5.0) == 3.0
    assert part(_outer) is part(_outer)


def _calling(helper, number):
    return numba.njit(lambda: helper(number))


def test_a_helper_is_compiled_once_for_all_constants_of_the_tick():
    """For a number of Python's it would be compiled once for each."""

    @inner_jit
    def same(number):
        return number

    for number in (FOLLOWING_ERROR, TRAVEL, OVERSPEEDING, DIVERGED, OSCILLATION, SETTLING, tick.CURRENT, tick.VOLTAGE):
        assert _calling(same, number)() == number
    assert len(same.overloads) == 1
    assert _calling(same, int(SETTLING))() == SETTLING
    assert len(same.overloads) == 2


def test_the_stages_of_a_law_run_as_plain_python_too():
    """With an inertia alone, and no torque, the observer sees J times the acceleration, once its filter lets it by."""
    row = types.SimpleNamespace(axes=1, tick=0, period=1e-3, measured_velocity=np.ones(1), feedforward=np.zeros(1))
    law = types.SimpleNamespace(
        observer_velocity=0.0,
        observer_inertia=0.5,
        observer_viscous=0.0,
        observer_shift=0,
        observer_taps=np.zeros(3),
        observer_demands=np.zeros(64),
        observer_filter=(1.0, 0.0, 0.0, 0.0, 0.0),
        observer_first=0.0,
        observer_second=0.0,
    )
    observe(row, [law])
    assert row.feedforward == pytest.approx(-0.5 * 1e3)
    assert law.observer_velocity == 1.0
