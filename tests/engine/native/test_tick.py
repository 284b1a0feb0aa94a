"""The callback inside MuJoCo's step: struct layout, other models, other callbacks, threads."""

import itertools
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import mujoco
import numpy as np
import pytest

import gantrysim
from gantrysim import Servo, simulate
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.engine.native.callback import installed_tick, magic
from gantrysim.machine import layout
from gantrysim.machine.row import ROW

PENDULUM = """
<mujoco>
  <size nuserdata="{nuserdata}"/>
  <worldbody><body><joint name="j" axis="0 1 0"/><geom size="0.1" pos="0.3 0 0"/></body></worldbody>
  <actuator><motor joint="j"/></actuator>
</mujoco>
"""


def test_every_offset_agrees_with_the_bindings():
    layout._verify(layout.offsets())


@pytest.mark.parametrize("field", layout.offsets())
def test_a_wrong_offset_is_found_before_it_is_used(field):
    offsets = layout.offsets()
    with pytest.raises(layout.LayoutError, match=rf"\.{field}\b"):
        layout._verify({**offsets, field: offsets[field] + 8})


def pendulum(nuserdata):
    return mujoco.MjModel.from_xml_string(PENDULUM.format(nuserdata=nuserdata))


def swing(model, steps=500):
    data = mujoco.MjData(model)
    data.userdata[:] = 1.0
    data.ctrl[:] = 0.7
    mujoco.mj_step(model, data, steps)
    return data.qpos.copy(), data.ctrl.copy(), data.userdata.copy()


@pytest.mark.parametrize("nuserdata", [0, 1, 10_000])
def test_other_models_are_unaffected_while_the_callback_is_installed(nuserdata):
    model = pendulum(nuserdata)
    alone = swing(model)
    with installed_tick():
        beside = swing(model)
    for expected, found in zip(alone, beside, strict=True):
        np.testing.assert_array_equal(found, expected)


def test_a_users_own_control_callback_is_restored(xy):
    calls, other = [], pendulum(0)  # MuJoCo compiles nothing while a Python callback is installed
    servo, setpoints = Servo.derive(xy.axes), MoveSpiral(60, 1, 10, 100).setpoints(1e-3)
    simulate(xy, servo, setpoints)  # so that what the machine works out once is there

    def own(model, data):
        calls.append(1)

    mujoco.set_mjcb_control(own)
    try:
        simulate(xy, servo, setpoints)
        assert not calls
        swing(other, 3)
        assert len(calls) == 3
    finally:
        mujoco.set_mjcb_control(None)


def spent(model, steps=100):
    """What MuJoCo's timer of all steps says, and the number of calls that it counts."""
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, steps)
    timer = data.timer[mujoco.mjtTimer.mjTIMER_STEP]
    return timer.duration, timer.number


def test_mujocos_timers_stand_still_during_a_run_alone():
    model = pendulum(0)
    with installed_tick():
        with installed_tick():
            pass
        assert spent(model) == (0.0, 100)
    duration, number = spent(model)
    assert (duration > 0, number) == (True, 100)


def test_a_users_own_clock_of_mujocos_timers_goes_on_in_a_run():
    now = itertools.count()
    mujoco.set_mjcb_time(lambda: float(next(now)))
    try:
        own = mujoco.get_mjcb_time()
        with installed_tick():
            assert spent(pendulum(0))[0] >= 100
        assert mujoco.get_mjcb_time() is own
    finally:
        mujoco.set_mjcb_time(None)


def test_the_callback_is_removed_after_a_run_and_after_an_error(xy):
    servo, setpoints = Servo.derive(xy.axes), MoveSpiral(60, 1, 10, 100).setpoints(1e-3)

    def broken(state):
        raise RuntimeError

    simulate(xy, servo, setpoints)
    assert mujoco.get_mjcb_control() is None
    with pytest.raises(RuntimeError):
        simulate(xy, servo, setpoints, law=broken)
    assert mujoco.get_mjcb_control() is None


def test_threads_run_side_by_side_with_the_same_result(xy):
    servo = Servo.derive(xy.axes)
    setpoints = [MoveSpiral(40 + 10 * k, 1, 10, 100).setpoints(1e-3) for k in range(6)]
    laws = [
        None if k % 3 else (lambda state: 0.1 * state.error) for k in range(len(setpoints))
    ]  # a few of plain Python
    expected = [simulate(xy, servo, points, law=law).nozzle for points, law in zip(setpoints, laws, strict=True)]
    found = [None] * len(setpoints)

    def work(k):
        found[k] = simulate(xy, servo, setpoints[k], law=laws[k]).nozzle

    threads = [threading.Thread(target=work, args=(k,)) for k in range(len(setpoints))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for a, b in zip(expected, found, strict=True):
        np.testing.assert_array_equal(a, b)
    assert mujoco.get_mjcb_control() is None


def test_the_magic_number_is_set():
    assert magic() > 0
    assert ROW.itemsize % 8 == 0


ASK = """
from gantrysim import Machine, Servo, simulate
from gantrysim.controllers.trio import MoveSpiral
machine = Machine("xy")
setpoints = MoveSpiral(40, 1, 10, 100).setpoints(1e-3)
servo = Servo.derive(machine.axes)
for law in (None, lambda tick: 0.5 * tick.error + 0.01 * (tick.demand_velocity - tick.measured_velocity)):
    print(simulate(machine, servo, setpoints, law=law).fault)
"""


@pytest.mark.soak
def test_no_compiled_code_outlives_a_change_of_what_it_was_compiled_from(tmp_path):
    """In the whole package; tests/base/test_jit.py shows it in a small one."""
    package = tmp_path / "gantrysim"  # with what numba has compiled so far; other tests may be writing there
    shutil.copytree(Path(gantrysim.__file__).parent, package, ignore=shutil.ignore_patterns("*.tmp*", "*.pyc*"))

    def ask():
        done = subprocess.run([sys.executable, "-c", ASK], cwd=tmp_path, capture_output=True, text=True, check=True)
        return done.stdout.splitlines()

    assert ask() == ["None", "None"]
    row = package / "machine" / "row.py"
    row.write_text(row.read_text().replace("OVERSPEED = 1.2", "OVERSPEED = 0.01"))
    compiled, plain = ask()
    assert compiled.startswith("overspeed on axis")
    assert plain.startswith("overspeed on axis")
