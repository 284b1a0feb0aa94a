"""Ctrl-C at any point of installing and removing MuJoCo's callbacks: nothing stays installed, no thread is blocked."""

import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import nullcontext

import mujoco
import numpy as np
import pytest

from gantrysim import simulate
from gantrysim.base import signals
from gantrysim.engine.native import callback
from gantrysim.engine.native.callback import installed_law, installed_tick
from gantrysim.engine.simulation import Simulation
from gantrysim.engine.started import Started
from gantrysim.machine.row import ROW_NUMBERS

from support.runs import plain, ramp
from support.soaked import suite_runs

OURS = (callback.__file__, signals.__file__)
MOST = 4000  # points of one enter and exit, by far
PATIENCE = 300.0  # until a test that hangs is given up [s]


class Interrupted:
    """Has Ctrl-C come at one bytecode of the modules that install the callback, by number from the start of tracing.

    It calls the handler with the frame, as Python does there. Real signals come in the last test.
    """

    def __init__(self, point):
        self.point = point
        self.seen = 0

    def __call__(self, frame, event, argument):
        if frame.f_code.co_filename not in OURS:
            return None
        frame.f_trace_opcodes, frame.f_trace_lines = True, False
        self.seen += 1
        if self.seen - 1 == self.point:
            sys.settrace(None)
            signal.getsignal(signal.SIGINT)(signal.SIGINT, frame)
        return self

    def __enter__(self):
        sys.settrace(self)

    def __exit__(self, *error):
        sys.settrace(None)


def shared(machine):
    return lambda: installed_tick()


def alone(machine):
    simulation = Simulation.of(machine, plain(machine), ramp(50.0, 1.0))
    data = mujoco.MjData(simulation.model)
    Started.of(simulation, data.qpos, data.userdata)
    return lambda: installed_law(data, lambda tick: 0.0 * tick.error)


def state():
    return (
        mujoco.get_mjcb_control(),
        mujoco.get_mjcb_time(),
        mujoco.get_mju_user_warning(),
        *map(signal.getsignal, signals.ENDING),
        callback._users,
        callback._changed.acquire(blocking=False) and callback._changed.release(),
        getattr(callback._thread, "depth", 0),
        getattr(callback._thread, "law", False),
    )


def within(seconds, work):
    """What work returns in a thread of its own, that must end."""
    found = []
    thread = threading.Thread(target=lambda: found.append(work()), daemon=True)
    thread.start()
    thread.join(seconds)
    assert found, "it waits for ever"
    return found[0]


@pytest.fixture
def machine(rigid):
    return rigid()


@pytest.fixture
def before():
    """What is there before a run, a user's own warning handler included."""
    own = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda text: None)
    signal_before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield state()
    sys.settrace(None)
    mujoco.set_mju_user_warning(own)
    signal.signal(signal.SIGINT, signal_before)


@pytest.mark.parametrize(("kind", "nested"), [(shared, False), (shared, True), (alone, False)])
def test_an_interrupt_at_any_bytecode_of_enter_and_exit_leaves_all_as_it_was(machine, before, kind, nested):
    make = kind(machine)

    def once(point):
        interrupt = Interrupted(point)
        with interrupt, make():
            pass
        return interrupt

    def points():
        """Number of points, each tried; at every one the interrupt must come and nothing be left."""
        inside = state()
        for point in range(MOST):
            try:
                interrupt = once(point)
            except KeyboardInterrupt:
                assert state() == inside, point
            else:
                assert state() == inside, point
                assert interrupt.seen <= point, f"the interrupt at {point} was lost"
                return point
        raise AssertionError("never came to the end")

    if nested:
        entered, leave = threading.Event(), threading.Event()

        def hold():
            with installed_tick():
                entered.set()
                leave.wait(PATIENCE)

        thread = threading.Thread(target=hold)
        thread.start()
        entered.wait(PATIENCE)
        try:
            count = points()
        finally:
            leave.set()
            thread.join()
    else:
        count = points()
    assert count > 100
    assert state() == before
    assert within(PATIENCE, lambda: simulate(machine, plain(machine), ramp(50.0, 1.0))).fault is None


def test_an_interrupt_in_the_block_comes_at_its_end(machine, before):
    reached = []

    def body():
        with installed_tick() as interrupted:
            assert not interrupted()
            signal.raise_signal(signal.SIGINT)
            assert interrupted()
            reached.append("the next line")

    with pytest.raises(KeyboardInterrupt):
        body()
    assert reached
    assert state() == before


def test_a_run_ends_soon_after_an_interrupt(machine, before):
    sent = []

    def progress(share):
        sent.append(share)
        if len(sent) == 3:
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        simulate(machine, plain(machine), ramp(50.0, 20.0), progress=progress)
    assert len(sent) == 3
    assert state() == before


def test_a_run_with_a_law_in_python_ends_soon_after_an_interrupt(machine, before):
    calls = []

    def law(tick):
        calls.append(tick)
        if len(calls) == 3:
            signal.raise_signal(signal.SIGINT)
        return 0.0 * tick.error

    with pytest.raises(KeyboardInterrupt):
        simulate(machine, plain(machine), ramp(50.0, 200.0), law=law)
    assert len(calls) <= 1001  # the ticks of a call of MuJoCo at most, of 4,000
    assert state() == before


def test_a_run_goes_on_after_a_handler_that_returns(machine, before):
    seen = []
    signal.signal(signal.SIGINT, lambda number, frame: seen.append(number))
    plainly = simulate(machine, plain(machine), ramp(50.0, 20.0))
    shares = []

    def progress(share):
        shares.append(share)
        if len(shares) == 3:
            signal.raise_signal(signal.SIGINT)

    run = simulate(machine, plain(machine), ramp(50.0, 20.0), progress=progress)
    assert seen == [signal.SIGINT]
    assert (run.nozzle == plainly.nozzle).all()
    signal.signal(signal.SIGINT, signal.default_int_handler)
    assert state() == before


def test_a_users_own_handler_sees_the_interrupt_and_may_go_on(machine, before):
    seen = []
    signal.signal(signal.SIGINT, lambda number, frame: seen.append(number))
    with installed_tick():
        signal.raise_signal(signal.SIGINT)
    assert seen == [signal.SIGINT]
    points = 0
    while True:
        interrupt = Interrupted(points)
        with interrupt, installed_tick():
            assert mujoco.get_mjcb_control() is not None
        if interrupt.seen <= points:
            break
        points += 1
        assert seen == [signal.SIGINT] * (1 + points)
    assert points > 100
    signal.signal(signal.SIGINT, signal.default_int_handler)
    assert state() == before


def test_a_waiting_thread_can_be_interrupted(machine, before, monkeypatch):
    make, entered, leave, waiting = alone(machine), threading.Event(), threading.Event(), threading.Event()

    class Condition(threading.Condition):
        def wait(self, timeout=None):
            waiting.set()
            return super().wait(timeout)

    monkeypatch.setattr(callback, "_changed", Condition(threading.Lock()))

    def hold():
        with make():
            entered.set()
            leave.wait(PATIENCE)

    def interrupt():
        waiting.wait(PATIENCE)
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=hold)
    thread.start()
    entered.wait(PATIENCE)
    threading.Thread(target=interrupt).start()
    try:
        with pytest.raises(KeyboardInterrupt):
            simulate(machine, plain(machine), ramp(50.0, 1.0))
        assert thread.is_alive()
    finally:
        leave.set()
        thread.join()
    assert state() == before


def test_a_law_waits_for_those_that_are_there_and_they_for_it(machine, before):
    make, order = alone(machine), []
    first, second = threading.Event(), threading.Event()

    def law():
        with make():
            order.append("law")
            second.set()
            time.sleep(0.1)
            order.append("law ends")

    def tick():
        with installed_tick():
            first.set()
            thread = threading.Thread(target=law)
            thread.start()
            time.sleep(0.1)
            order.append("tick ends")
        second.wait(PATIENCE)
        with installed_tick():
            order.append("next")
        thread.join()
        return order

    assert within(PATIENCE, tick) == ["tick ends", "law", "law ends", "next"]
    assert state() == before


@pytest.mark.parametrize("function", suite_runs(["on_control", "_tick"], 0))
def test_an_interrupt_in_the_callback_of_a_law_is_not_lost(machine, before, function):
    """MuJoCo calls it from C, where an exception would be told and dropped."""
    calls = []

    def law(tick):
        calls.append(tick)
        return 0.0 * tick.error

    def run():
        calls.clear()
        simulate(machine, plain(machine), ramp(50.0, 2.0), law=law)

    run()
    assert len(calls) > 20

    class InCallback(Interrupted):
        def __call__(self, frame, event, argument):
            return super().__call__(frame, event, argument) if frame.f_code.co_name == function else None

    for points in range(MOST):
        interrupt = InCallback(points)
        try:
            with interrupt:
                run()
        except KeyboardInterrupt:
            assert state() == before, points
            if points > 150:
                break
        else:
            assert interrupt.seen <= points, f"the interrupt at {points} was lost"
            break
    assert points > 30
    assert state() == before


def test_a_tick_that_is_left_installed_does_not_act_on_other_models(machine):
    """Not even on one whose userdata is as long as the servo's row: the magic number is not in it."""
    xml = """
    <mujoco><size nuserdata="NUMBERS"/><worldbody>
    <body><joint name="x" type="slide"/><geom size="1"/></body></worldbody>
    <actuator><motor joint="x"/></actuator></mujoco>"""
    chance = np.random.default_rng(1)
    for numbers in (0, 1, ROW_NUMBERS - 1, ROW_NUMBERS, 2 * ROW_NUMBERS):
        model = mujoco.MjModel.from_xml_string(xml.replace("NUMBERS", str(numbers)))
        states = []
        given = chance.normal(size=numbers)
        for hook_of in (nullcontext, installed_tick):
            data = mujoco.MjData(model)
            data.userdata[:] = given
            data.ctrl[0] = 5.0
            with hook_of():
                mujoco.mj_step(model, data, 200)
            assert data.ctrl[0] == 5.0
            states.append((data.qpos[0], data.qvel[0], data.userdata.tobytes()))
        assert states[0] == states[1]
        assert states[0][0] != 0


STORM = """
import faulthandler, os, random, signal, threading, time
import mujoco
from gantrysim import Machine, Servo, simulate
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.engine.native.callback import installed_tick

ROUNDS, handled, came = 200, 0, 0

def handler(number, frame):
    global handled
    handled += 1
    raise KeyboardInterrupt

faulthandler.dump_traceback_later(PATIENCE, exit=True)
signal.signal(signal.SIGINT, handler)
machine = Machine("xy")
setpoints = MoveSpiral(40, 1, 10, 100).setpoints(1e-3)
servo = Servo.derive(machine.axes)
run = simulate(machine, servo, setpoints)
model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><body><joint name='x' type='slide'/><geom size='1'/></body>"
    "</worldbody><actuator><motor joint='x'/></actuator></mujoco>")

def control(model, data):
    data.ctrl[0] = 100 - data.qpos[0]

def stepped():
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 50)
    return data.qpos[0]

mujoco.set_mjcb_control(control)
before = stepped()
go = threading.Semaphore(0)

def send():
    chance = random.Random(1)
    for _ in range(ROUNDS):
        go.acquire()
        time.sleep(chance.uniform(0, 3e-4))
        os.kill(os.getpid(), signal.SIGINT)

threading.Thread(target=send, daemon=True).start()
for number in range(1, ROUNDS + 1):
    try:
        go.release()
        while handled < number:  # C code of others may swallow what the handler raises
            with installed_tick():
                pass
    except KeyboardInterrupt:
        came += 1
    left = mujoco.get_mjcb_control(), mujoco.get_mju_user_warning(), signal.getsignal(signal.SIGINT)
    assert left == (control, None, handler), left
    assert stepped() == before  # by a control of the caller's own, which is there again
mujoco.set_mjcb_control(None)
again = simulate(machine, servo, setpoints)
print(handled, came, (again.nozzle == run.nozzle).all())
"""


@pytest.mark.parametrize("rounds", suite_runs([60, 200], 0))
def test_a_process_survives_many_interrupts(rounds):
    code = STORM.replace("PATIENCE", str(PATIENCE)).replace(
        "ROUNDS, handled, came = 200", f"ROUNDS, handled, came = {rounds}"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=2 * PATIENCE)
    assert done.returncode == 0, done.stderr
    handled, came, equal = done.stdout.split()
    assert int(handled) == rounds
    assert int(came) > rounds / 5
    assert equal == "True"
