"""MuJoCo's timers: off while gantrysim steps, and as before afterwards."""

import ctypes
import itertools
import threading
from contextlib import contextmanager

import mujoco
import pytest

from gantrysim.native import timers
from gantrysim.native.hook import installed
from gantrysim.native.timers import restart_timers, stop_timers

STEPS = 100
MODEL = """
<mujoco>
  <worldbody><body><joint name="j" axis="0 1 0"/><geom size="0.1" pos="0.3 0 0"/></body></worldbody>
</mujoco>
"""


@pytest.fixture(params=["variable", "callback"])
def reached(request, monkeypatch):
    """How the clock is reached: in MuJoCo's variable, or as a callback where that variable is not found."""
    if request.param == "callback":
        monkeypatch.setattr(timers, "_clock_slot", lambda: None)
    elif timers._clock_slot() is None:
        pytest.skip("this MuJoCo does not show the variable of its clock")


@pytest.fixture(params=["mujoco", "user"])
def owner(request):
    """Whose clock the timers have: MuJoCo's, or one that a user has set."""
    now = itertools.count()
    own = None if request.param == "mujoco" else lambda: float(next(now))
    mujoco.set_mjcb_time(own)
    yield request.param
    assert mujoco.get_mjcb_time() is own
    mujoco.set_mjcb_time(None)


def run():
    """Whether MuJoCo's timer of all steps has run in some steps, all of which it counts."""
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, STEPS)
    timer = data.timer[mujoco.mjtTimer.mjTIMER_STEP]
    assert timer.number == STEPS
    return timer.duration > 0.0


@contextmanager
def stopped():
    clock = stop_timers()
    try:
        yield
    finally:
        restart_timers(clock)


def test_timers_are_restored_after_blocks_in_one_another(reached, owner):
    assert run()
    with stopped():
        assert not run()
        with stopped():
            assert not run()
        assert not run()
    assert run()


def test_timers_are_restored_after_an_exception(reached, owner):
    with pytest.raises(ZeroDivisionError), stopped():
        raise ZeroDivisionError
    assert run()


def test_a_run_within_stopped_timers_leaves_them_stopped(reached):
    with stopped():
        with installed():
            assert not run()
        assert not run()
    assert run()


def test_a_run_that_raises_restores_timers(reached):
    def interrupted():
        with installed():
            assert not run()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        interrupted()
    assert run()


@pytest.mark.parametrize("first_leaves", [True, False])
def test_timers_stay_stopped_until_the_last_of_two_threads_has_left(reached, first_leaves):
    entered = [threading.Event(), threading.Event()]
    leave = [threading.Event(), threading.Event()]

    def work(k):
        with installed():
            entered[k].set()
            leave[k].wait(60)

    threads = [threading.Thread(target=work, args=(k,)) for k in range(2)]
    early = 0 if first_leaves else 1
    try:
        for k, thread in enumerate(threads):
            thread.start()
            assert entered[k].wait(60)
        assert not run()
        leave[early].set()
        threads[early].join()
        assert not run()
    finally:
        for event in leave:
            event.set()
        for thread in threads:
            thread.join()
    assert run()


def test_the_variable_of_the_clock_is_found_and_holds_it():
    slot = timers._clock_slot()
    if slot is None:
        pytest.skip("this MuJoCo does not show the variable of its clock")
    address = slot.value
    assert address
    with stopped():
        assert slot.value is None
    assert slot.value == address


def test_a_variable_that_does_not_follow_the_clock_is_not_taken_for_it():
    assert not timers._is_the_clock(ctypes.c_void_p(12345))
    assert run()
