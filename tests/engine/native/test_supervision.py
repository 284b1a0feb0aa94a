"""Supervision by the controller: position error with a delay, settling at gates, velocity limit."""

import dataclasses
import math
import re

import numpy as np
import pytest

from gantrysim import Dispenser, Run, Servo, simulate
from gantrysim.base import memory
from gantrysim.base.errors import InputError
from gantrysim.controllers.softmc import Group, Program
from gantrysim.engine.simulation import Simulation
from gantrysim.record.setpoints import Setpoints, Supervision

from support.runs import PERIOD, plain, ramp, turned, turntable

GROUP = Group(velocity=150, acceleration=3000)
TEXT = "Move {30, 10}\nMove {0, 40} Dispense=0\nMove {0, 0}"


def lazy(machine, **changed):
    """A servo that damps the measured speed: at a constant speed every axis lags by 2 / w, here 20 ms."""
    servo = plain(machine, feedforward=0.0, frequency=100 / (2 * math.pi), **changed)
    return servo.with_values(kd=(0.0, 0.0), output_velocity=tuple(-kd for kd in servo.per_axis("kd")))


def supervised(setpoints, **limits):
    return dataclasses.replace(setpoints, supervision=Supervision(**limits))


def in_python(servo):
    """The same law in plain Python."""
    return lambda tick: (
        np.array(servo.per_axis("kp")) * tick.error
        + np.array(servo.per_axis("output_velocity")) * tick.measured_velocity
    )


def diagonal(speed, ticks=600, start=100):
    """Rest, a constant speed along both axes, and rest again."""
    distance = np.clip(np.arange(ticks) - start, 0, ticks - 2 * start) * PERIOD * speed
    path = ramp(50.0).requested
    return Setpoints(PERIOD, ("x", "y"), np.column_stack([distance, 0.5 * distance]), np.ones(ticks, bool), path)


def delayed_error(run, delay):
    """The group's error, from the record alone."""
    sent = run.commanded[np.maximum(np.arange(len(run.time)) - delay, 0)]
    return np.sqrt(np.sum((sent - run.encoder) ** 2, axis=1))


def settled_rows(run, target, first, error, ticks):
    """The row, from `first` on, at which all axes have been within the error for so many periods, from the record."""
    within = (np.abs(run.encoder - target) <= error).all(axis=1)
    row = first
    while not within[row - min(ticks, row - first) : row + 1].all() or row - first < ticks:
        row += 1
    return row


def test_limits_that_are_not_reached_change_nothing(rigid):
    machine = rigid()
    bare = simulate(machine, lazy(machine), diagonal(100.0))
    limits = {"position_error": 50.0, "position_error_delay": 3, "velocity_limit": 900.0, "settle_error": 50.0}
    watched = dataclasses.replace(supervised(diagonal(100.0), **limits), gates=[100, 599])
    run = simulate(machine, lazy(machine), watched)
    for name in ("time", "commanded", "encoder", "nozzle", "demand", "current", "flow", "dispense"):
        np.testing.assert_array_equal(getattr(run, name), getattr(bare, name))
    assert run.fault is None


@pytest.mark.parametrize("law", [None, "plain"])
@pytest.mark.parametrize("limit", [0.3, 0.7, 1.5])
def test_the_group_error_trips_at_the_first_sample_over_its_limit(rigid, limit, law):
    machine = rigid()
    servo = lazy(machine)
    law = None if law is None else in_python(servo)
    bare = simulate(machine, servo, diagonal(100.0), law=law)
    error = delayed_error(bare, 0)
    over = int(np.argmax(error > limit))
    assert over > 100
    run = simulate(machine, servo, supervised(diagonal(100.0), position_error=limit), law=law)
    assert run.fault is not None
    assert (run.fault.kind, run.fault.axis, run.fault.unit) == ("position error", "x", "mm")
    assert run.fault.time == pytest.approx(over * PERIOD)
    assert run.fault.value == pytest.approx(error[over], rel=1e-9)
    assert len(run.time) == over + 1
    # the root of the sum of the squares: no axis alone is over it
    assert np.abs(bare.commanded - bare.encoder)[over].max() < limit
    assert str(run.fault) == (
        f"position error on axis x at t = {over * PERIOD:.4f} s: {error[over]:.4g} mm, limit {limit:.4g} mm; "
        "the motion stops"
    )


def test_the_right_delay_takes_the_lag_out_of_the_error(rigid):
    machine = rigid()
    setpoints, servo = diagonal(100.0), lazy(machine)
    bare = simulate(machine, servo, setpoints)
    lag = delayed_error(bare, 0)[450]  # at constant speed
    delay = round(lag / (100.0 * math.hypot(1, 0.5) * PERIOD))
    assert delay > 10
    limit = 0.6 * lag
    wrong = simulate(machine, servo, supervised(setpoints, position_error=limit))
    assert wrong.fault is not None
    assert wrong.fault.kind == "position error"
    right = simulate(machine, servo, supervised(setpoints, position_error=limit, position_error_delay=delay))
    assert right.fault is None
    assert delayed_error(right, delay)[450] < 0.05 * lag
    assert delayed_error(right, delay).max() < limit
    # and the delay is that of the record: a limit just below what the record says does trip there
    error = delayed_error(bare, delay)
    over = int(np.argmax(error > 0.9 * error.max()))
    tight = supervised(setpoints, position_error=0.9 * error.max(), position_error_delay=delay)
    assert simulate(machine, servo, tight).fault.time == pytest.approx(over * PERIOD)


def test_at_rest_the_drives_are_disabled(rigid):
    machine = rigid()
    rest = supervised(dataclasses.replace(diagonal(0.0)), position_error=0.2)
    run = simulate(machine, plain(machine), rest, law=lambda tick: [0.0, 0.02])
    assert run.fault is not None
    assert (run.fault.kind, run.fault.axis) == ("position error", "y")
    assert re.match(r"^position error on axis y .*, limit 0.2 mm; the drives are disabled$", str(run.fault))
    free = simulate(machine, plain(machine), diagonal(0.0), law=lambda tick: [0.0, 0.02])
    assert free.fault is None or free.fault.time > run.fault.time


def test_the_delay_counts_the_commands_that_were_sent_waits_included(rigid):
    """Just after a gate the command of some ticks ago is still the gate's."""
    machine, delay = rigid(), 40
    program = Program(TEXT, dataclasses.replace(GROUP, settle_error=0.05, settle_time=0.03))
    bare = simulate(machine, lazy(machine), program.setpoints(PERIOD))
    error = delayed_error(bare, delay)
    assert len(bare.time) > len(program.setpoints(PERIOD).position) + 100
    for limit in (0.5 * error.max(), 0.8 * error.max(), 1.001 * error.max()):
        watched = dataclasses.replace(program.group, position_error=limit, position_error_delay=delay)
        run = simulate(machine, lazy(machine), Program(TEXT, watched).setpoints(PERIOD))
        over = np.flatnonzero(error > limit)
        if over.size:
            assert run.fault.time == pytest.approx(over[0] * PERIOD)
        else:
            assert run.fault is None


def test_the_orientation_does_not_count_for_the_position_error_but_for_settling(tmp_path):
    machine = turntable(tmp_path)
    servo = Servo.derive(machine.axes, PERIOD, frequency=5.0, feedforward=0.0, following_error_limit=1e3)
    setpoints = turned(50.0, 400)
    run = simulate(machine, servo, supervised(setpoints, position_error=0.5, velocity_limit=20.0))
    assert run.fault is None  # though the axis is off by degrees, at 50 deg/s
    assert np.abs(run.commanded - run.encoder)[:, 0].max() > 1.0
    gated = dataclasses.replace(setpoints, supervision=Supervision(settle_error=0.1), gates=[399])
    waited = simulate(machine, servo, gated)
    assert len(waited.time) - 1 == settled_rows(waited, np.array([setpoints.position[-1, 0], 0]), 399, 0.1, 0) > 420


def test_the_velocity_limit_disables_the_drive(rigid):
    machine = rigid()
    run = simulate(machine, plain(machine), supervised(ramp(200.0), velocity_limit=150.0))
    assert run.fault is not None
    assert (run.fault.kind, run.fault.axis, run.fault.unit) == ("overspeed", "x", "mm/s")
    assert run.fault.limit == pytest.approx(150.0)
    assert 150 < run.fault.value < 200
    assert str(run.fault).endswith(" mm/s, limit 150 mm/s")
    assert simulate(machine, plain(machine), supervised(ramp(200.0), velocity_limit=400.0)).fault is None
    assert simulate(machine, plain(machine), ramp(200.0)).fault is None
    # no laxer than the machine's own
    wide = simulate(machine, plain(machine), supervised(ramp(50.0), velocity_limit=1e6), law=lambda tick: [0.9, 0.0])
    assert wide.fault.limit == pytest.approx(1.2 * machine.axes[0].speed_limit)


@pytest.mark.parametrize("law", [None, "plain"])
@pytest.mark.parametrize(("error", "time"), [(0.5, 0.0), (0.02, 0.0), (0.02, 0.0415), (5.0, 0.1)])
def test_the_next_command_starts_when_the_axes_have_settled(rigid, error, time, law):
    machine = rigid()
    servo = lazy(machine)
    law = None if law is None else in_python(servo)
    # each wait is shorter than the timeout, all of them together may be longer
    program = Program(TEXT, dataclasses.replace(GROUP, settle_error=error, settle_time=time, settle_timeout=0.16))
    setpoints = program.setpoints(PERIOD)
    run = simulate(machine, servo, setpoints.hold(0.05), dispenser=Dispenser(flow=2.0), law=law)
    assert run.fault is None
    ticks = math.ceil(time / PERIOD - 1e-9)
    sent, first = np.arange(0), 0
    for gate in [*setpoints.gates, len(setpoints.position) + 49]:
        row = sent.size + gate - first  # of the gate's first sample
        sent = np.concatenate([sent, np.arange(first, gate)])
        last = settled_rows(run, setpoints.position[gate], row, error, ticks) if gate in setpoints.gates else row
        sent = np.concatenate([sent, np.full(last - row + 1, gate)])
        first = gate + 1
    held = setpoints.hold(0.05)
    assert sent.size == len(run.time)
    waited = sent.size - len(held.position)
    assert waited == 3 * 100 if error == 5.0 else waited > (150 if error == 0.02 else 0)
    np.testing.assert_array_equal(run.commanded, held.position[sent])
    np.testing.assert_array_equal(run.dispense, held.dispense[sent])
    np.testing.assert_array_equal(run.flow, 2.0 * held.dispense[sent])
    np.testing.assert_array_equal(run.time, np.arange(sent.size) * PERIOD)
    assert run.commanded_tip[:, :2] == pytest.approx(run.commanded)


def test_without_a_settle_error_nothing_waits(rigid):
    machine = rigid()
    setpoints = Program(TEXT, GROUP).setpoints(PERIOD)
    assert setpoints.gates.size == 0
    assert len(simulate(machine, lazy(machine), setpoints).time) == len(setpoints.position)


def test_glue_is_on_or_off_while_a_command_settles_as_before():
    setpoints = Program(TEXT, dataclasses.replace(GROUP, settle_error=0.1)).setpoints(PERIOD)
    first, second, last = setpoints.gates
    assert setpoints.dispense[: first + 1].all()
    assert not setpoints.dispense[first + 1 : second + 1].any()
    assert setpoints.dispense[second + 1 :].all()
    assert last == len(setpoints.position) - 1
    np.testing.assert_array_equal(setpoints.position[setpoints.gates], [[30, 10], [0, 40], [0, 0]])


def test_a_command_that_moves_nothing_is_no_gate_at_the_start():
    program = Program("Move {0, 0}\nMove {5, 0} Dispense=0", dataclasses.replace(GROUP, settle_error=0.1))
    setpoints = program.setpoints(PERIOD)
    assert setpoints.gates.tolist() == [len(setpoints.position) - 1]
    assert not setpoints.dispense.any()
    on = Program("Move {0, 0} Dispense=0\nMove {5, 0}\nMove {6, 0} Dispense=0", program.group).setpoints(PERIOD)
    assert on.dispense[0]


@pytest.mark.parametrize("law", [None, "plain"])
def test_a_settling_timeout_is_a_fault(rigid, law):
    machine = rigid()
    servo = lazy(machine)
    law = None if law is None else in_python(servo)
    group = dataclasses.replace(GROUP, settle_error=0.01, settle_timeout=0.05)
    setpoints = Program(TEXT, group).setpoints(PERIOD)
    run = simulate(machine, servo, setpoints, law=law)
    assert run.fault is not None
    assert run.fault.time == pytest.approx((setpoints.gates[0] + 50) * PERIOD)
    assert len(run.time) == setpoints.gates[0] + 51
    error = (run.commanded - run.encoder)[-1]
    assert run.fault.axis == "xy"[np.abs(error).argmax()]
    assert str(run.fault) == (
        f"settling on axis {run.fault.axis} at t = {run.fault.time:.4f} s: "
        f"{error[np.abs(error).argmax()]:.4g} mm, limit 0.01 mm; not settled after 0.05 s"
    )
    longer = dataclasses.replace(group, settle_timeout=2.0)
    assert simulate(machine, servo, Program(TEXT, longer).setpoints(PERIOD), law=law).fault is None


def test_a_record_with_waits_and_a_reaction_is_saved_and_loaded(rigid, tmp_path):
    machine = rigid()
    group = dataclasses.replace(GROUP, settle_error=0.01, settle_timeout=0.05)
    run = simulate(machine, lazy(machine), Program(TEXT, group).setpoints(PERIOD))
    run.save(tmp_path / "run.npz")
    loaded = Run.load(tmp_path / "run.npz")
    assert loaded.fault == run.fault
    np.testing.assert_array_equal(loaded.commanded, run.commanded)


def test_progress_ends_at_one_though_the_stream_waits(rigid):
    machine, seen = rigid(), []
    setpoints = Program(TEXT, dataclasses.replace(GROUP, settle_error=0.02)).setpoints(PERIOD)
    simulate(machine, lazy(machine), setpoints, progress=seen.append)
    assert seen[-1] == 1.0
    assert seen == sorted(seen)


def test_the_two_centre_spiral_settles_after_every_half_circle(xyz):
    """The spiral of softMC's half circles on a machine with friction and quantised encoders."""
    text = "\n".join(f"Circle Angle=180 CircleCenter={{{0 if k % 2 else 12.5}, 0, {5 * k}}}" for k in range(1, 9))
    group = Group(velocity=500, acceleration=30000, settle_error=0.05, settle_time=0.005)
    program = Program(text, group, start=(25, 0, 0))
    setpoints = program.setpoints(PERIOD)
    run = simulate(xyz, Servo.derive(xyz.axes, PERIOD), setpoints)
    assert run.fault is None
    assert program.duration == pytest.approx(3.590, abs=5e-4)
    assert len(setpoints.position) + 8 * 5 < len(run.time) < len(setpoints.position) + 8 * 100
    for gate in setpoints.gates:
        last = np.flatnonzero((run.commanded == setpoints.position[gate]).all(axis=1))[-1]
        assert np.all(np.abs(run.encoder - setpoints.position[gate])[last - 5 : last + 1] <= 0.05)


def test_held_setpoints_keep_supervision_and_gates():
    setpoints = Program(TEXT, dataclasses.replace(GROUP, settle_error=0.1, position_error=3)).setpoints(PERIOD)
    held = setpoints.hold(0.1)
    assert held.supervision == setpoints.supervision == Supervision(3, 0, 0.1)
    np.testing.assert_array_equal(held.gates, setpoints.gates)
    assert ramp(50.0).supervision == Supervision()
    assert ramp(50.0).gates.size == 0


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        ({"position_error": 0}, "position_error = 0 mm: must be greater than 0 mm"),
        ({"position_error": math.nan}, "position_error = nan mm: must be finite"),
        ({"position_error_delay": 0.5}, "position_error_delay = 0.5: must be a whole number"),
        ({"settle_error": -1}, "settle_error = -1 mm: must be greater than 0 mm"),
        ({"settle_time": 0.2, "settle_timeout": 0.1}, "settle_timeout = 0.1 s: must be at least 0.2 s"),
        ({"settle_timeout": math.inf}, "settle_timeout = inf s: must be finite"),
        ({"velocity_limit": 0}, "velocity_limit = 0 mm/s: must be greater than 0 mm/s"),
    ],
)
def test_a_value_out_of_its_bound_is_named(limits, said):
    with pytest.raises(InputError, match=f"^{re.escape(said)}$"):
        Supervision(**limits)


@pytest.mark.parametrize("gates", [[3, 3], [5, 2], [-1], [600], [[1]]])
def test_gates_are_ascending_indices(gates):
    said = f"gates {gates}: must be ascending indices of the 600 setpoints"
    with pytest.raises(InputError, match=f"^{re.escape(said)}$"):
        dataclasses.replace(diagonal(10.0), gates=gates)


def test_waits_that_would_exhaust_the_memory_are_refused(rigid, monkeypatch):
    machine, limits = rigid(), {"settle_error": 0.1, "settle_timeout": 3e4}
    monkeypatch.setattr(memory, "available_memory", lambda: 1e9)
    waiting = dataclasses.replace(diagonal(10.0), supervision=Supervision(settle_time=2e4, **limits), gates=[5, 9])
    said = (
        r"^settle_time = 20000 s at each of 2 gates: makes 4e\+07 ticks, which need about [\d.]+ GB of memory, "
        "where 1 GB are available; use a shorter settle_time or program$"
    )
    with pytest.raises(InputError, match=said):
        simulate(machine, lazy(machine), waiting)


def test_a_timeout_of_hours_takes_no_memory_before_the_wait(rigid):
    machine, limits = rigid(), {"settle_error": 0.1, "settle_timeout": 3e4}
    patient = dataclasses.replace(diagonal(10.0), supervision=Supervision(**limits), gates=[5, 9])
    simulation = Simulation.of(machine, lazy(machine), patient)
    assert len(simulation.log.tick) <= 2 * len(patient.position)
    short = dataclasses.replace(patient, supervision=Supervision(**{**limits, "settle_timeout": 1.0}))
    run, same = (simulate(machine, lazy(machine), setpoints) for setpoints in (patient, short))
    np.testing.assert_array_equal(run.nozzle, same.nozzle)


@pytest.mark.parametrize("long", [False, True])
def test_the_log_grows_where_the_run_waits_for_longer_than_it_has_room(rigid, monkeypatch, long):
    machine = rigid()
    limits = {"settle_error": 1e-3, "settle_time": 1.5, "settle_timeout": 30.0, "position_error": 90.0}
    setpoints = supervised(diagonal(10.0), **limits, position_error_delay=7)
    gated = dataclasses.replace(setpoints, gates=[100, 599])
    waited = simulate(machine, lazy(machine), gated)
    assert len(waited.time) > 3000 > 2 * len(gated.position)  # two waits of one and a half seconds
    monkeypatch.setattr(memory, "LONG_RUN", 100 if long else 10**9)
    again = simulate(machine, lazy(machine), gated)
    for name, value in vars(waited).items():
        if isinstance(value, np.ndarray):
            np.testing.assert_array_equal(getattr(again, name), value, name)
