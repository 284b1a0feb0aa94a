"""Deliberate faults against closed forms, one by one, with and without; runs they must not change."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gantrysim import Dispenser, InputError, Machine, Run, Servo, simulate, simulate_batch
from gantrysim.faults import (
    ATMOSPHERE,
    AirBubble,
    BusSag,
    CloggedNozzle,
    DrippingNozzle,
    EncoderDropout,
    EncoderGlitch,
    EncoderSlip,
    LostPackets,
    OpenWinding,
    SlippingAxis,
    StuckAxis,
)
from gantrysim.record.setpoints import Setpoints, Supervision

from support.runs import PERIOD, ideal_motors, plain, ramp
from support.soaked import examples

SPEED = 100.0  # [mm/s]
AT = 0.3  # time of faults [s]
K = round(AT / PERIOD)
COUNT = 0.001  # [mm], of the rigid machine's encoders
MASS = 1.0 + 1.5e-5 * (2e3 * math.pi / 10) ** 2  # carriage, and rotor by its 10 mm lead [kg]
FORCE = 0.03 * 2e3 * math.pi / 10  # per current [N/A]


def arrays(run):
    """All arrays of a run, by name."""
    return {f.name: v for f in dataclasses.fields(run) if isinstance(v := getattr(run, f.name), np.ndarray)}


def x(run):
    """True motor position of x [mm]."""
    return run.motor[:, 0]


@pytest.fixture
def free(rigid):
    """The rigid machine without any friction."""
    return rigid(damping=0.0)


def moved(machine, *faults, law=None, length=140.0, settle=0.0, dispenser=None, **servo):
    """A run at constant speed along x."""
    servo = plain(machine, **{"resolution": COUNT, **servo})
    return simulate(machine, servo, ramp(SPEED, length).hold(settle), faults=faults, law=law, dispenser=dispenser)


def test_an_axis_with_an_open_winding_and_without_friction_coasts_at_its_speed(free):
    run = moved(free, OpenWinding(time=AT, axis="x"))
    speed = (x(run)[K] - x(run)[K - 5]) / 5 / PERIOD
    coasting = x(run)[K] + speed * PERIOD * np.arange(len(run.time) - K)
    np.testing.assert_allclose(x(run)[K:], coasting, atol=0.01)
    assert not run.current[K:, 0].any()
    assert not run.torque[K:, 0].any()
    assert np.abs(run.current[:K, 0]).max() > 0


@pytest.mark.validates(
    "coasting of an axis with an open winding",
    "energy, m v² / 2 F",
    "5e-4 relative",
)
@pytest.mark.parametrize("inductance", [3e-4, 0.0])
@pytest.mark.parametrize("friction", [3.0, 10.0])
def test_an_axis_with_an_open_winding_and_dry_friction_coasts_to_rest_within_the_distance_of_its_energy(
    rigid, friction, inductance
):
    machine = rigid(damping=0.0, inductance=inductance)
    faults = (OpenWinding(time=AT, axis="x"), StuckAxis(time=AT, axis="x", friction=friction))
    run = moved(machine, *faults, resolution=0.0)
    speed = (x(run)[K] - x(run)[K - 5]) / 5 / PERIOD
    # semi-implicit Euler moves with the speed at the end of a step: half a step's way less
    distance = 1e3 * (speed / 1e3) ** 2 * MASS / (2 * friction) - speed * machine.physics.opt.timestep / 2
    assert x(run)[-1] - x(run)[K] == pytest.approx(distance, rel=5e-4)
    assert np.ptp(x(run)[-100:]) < 1e-5  # and stays there
    slides = moved(machine, *faults[:1], resolution=0.0)
    assert x(slides)[-1] - x(slides)[K] > 1.5 * distance


def test_viscous_friction_lets_an_axis_with_an_open_winding_coast_by_m_v_over_c(rigid):
    run = moved(rigid(damping=60.0), OpenWinding(time=AT, axis="x"))
    speed = (x(run)[K] - x(run)[K - 5]) / 5 / PERIOD
    at = PERIOD * (len(run.time) - 1 - K)
    distance = speed * MASS / 60 * (1 - math.exp(-at * 60 / MASS))
    assert x(run)[-1] - x(run)[K] == pytest.approx(distance, rel=5e-3)


def test_an_open_winding_of_an_ideal_motor_has_no_torque(tmp_path, rigid):
    rigid(damping=0.0)
    machine = Machine(ideal_motors(tmp_path / "rigid.xml"))
    run = moved(machine, OpenWinding(time=AT, axis="x", duration=0.2))
    assert not run.torque[K : K + 200, 0].any()
    assert run.torque[K + 200, 0] == run.demand[K + 200, 0]
    assert run.fault is None


@pytest.mark.parametrize("speed", [40.0, 80.0])
@pytest.mark.parametrize("inductance", [3e-4, 0.0])
def test_a_sagging_bus_bounds_the_speed_by_the_back_emf(rigid, speed, inductance):
    machine = rigid(damping=0.0, inductance=inductance)
    left = speed / 1e3 * FORCE  # back-EMF at that speed [V]
    run = moved(machine, BusSag(time=AT, axis="x", share=left / 24))
    assert np.diff(x(run))[-1] / PERIOD == pytest.approx(speed, rel=1e-4)
    assert np.abs(run.voltage[K:, 0]).max() <= left * (1 + 1e-12)
    assert np.diff(x(moved(machine)))[-1] / PERIOD == pytest.approx(SPEED, rel=1e-3)


def test_a_sagging_bus_bounds_the_speed_under_viscous_friction_by_the_voltage_law(rigid):
    machine, damping, share = rigid(damping=300.0), 300.0, 0.08
    run = moved(machine, BusSag(time=AT, share=share))
    volts = share * 24
    # FORCE i = c v, R i = U - FORCE v
    speed = 1e3 * FORCE * volts / (0.3 * damping + FORCE**2)
    assert np.diff(x(run))[-1] / PERIOD == pytest.approx(speed, rel=1e-3)
    assert run.current[-1, 0] == pytest.approx(speed / 1e3 * damping / FORCE, rel=1e-3)


def test_between_two_servo_ticks_the_sagging_bus_brakes_with_the_motor_s_time_constant(rigid):
    """v = v1 + (v0 - v1) exp(-t / T), T = m R / FORCE^2: the bus' voltage stays, the back-EMF falls with the speed."""
    machine, period, left = rigid(damping=0.0, inductance=0.0), 0.008, 40.0
    path = ramp(SPEED).requested
    setpoints = Setpoints.along(path, SPEED, period)
    tick = 60
    fault = BusSag(time=tick * period, axis="x", share=left / 1e3 * FORCE / 24)
    run = simulate(machine, plain(machine, period=period), setpoints, faults=[fault], physics_step=2.5e-5)
    constant = MASS * 0.3 / FORCE**2
    gone = left * period + (SPEED - left) * constant * (1 - math.exp(-period / constant))
    assert x(run)[tick + 1] - x(run)[tick] == pytest.approx(gone, rel=5e-3)
    assert gone < 0.8 * SPEED * period


def test_a_seized_axis_stands_and_trips_the_following_error_when_it_must(rigid):
    run = moved(rigid(), StuckAxis(time=AT, axis="x"), following_error_limit=5.0)
    assert np.abs(np.diff(x(run)[K + 2 :])).max() < 1e-4
    assert np.ptp(x(run)[K + 2 :]) < 1e-3  # against the largest torque
    assert run.fault is not None
    assert (run.fault.kind, run.fault.axis) == ("following error", "x")
    assert run.fault.time == pytest.approx(AT + 5.0 / SPEED, abs=3 * PERIOD)
    assert moved(rigid(), following_error_limit=5.0).fault is None


def test_a_tight_spot_lets_go_again(rigid):
    machine, friction = rigid(), 20.0
    run = moved(machine, StuckAxis(time=AT, axis="x", friction=friction, duration=0.4))
    lag = run.commanded[:, 0] - x(run)
    force = run.torque[:, 0] * FORCE / 0.03
    before, within = force[K - 20 : K].mean(), force[K + 300 : K + 390].mean()
    assert within - before == pytest.approx(friction, rel=0.02)
    assert abs(lag[-1]) < 0.1 * lag[K + 300]


@pytest.mark.validates(
    "a slipped encoder",
    "its counts",
    "1e-9 mm",
)
@pytest.mark.parametrize("counts", [250, -70])
def test_a_slipped_encoder_leaves_the_load_off_by_its_counts_and_no_following_error(rigid, counts):
    run = moved(rigid(), EncoderSlip(time=AT, axis="x", counts=counts), settle=0.5)
    exact = COUNT * np.floor(x(run)[K:] / COUNT + 0.5) + counts * COUNT
    np.testing.assert_allclose(run.encoder[K:, 0], exact, atol=1e-9)
    assert run.commanded[-1, 0] - run.encoder[-1, 0] == pytest.approx(0, abs=1.01 * COUNT)
    assert run.nozzle[-1, 0] - run.commanded[-1, 0] == pytest.approx(-counts * COUNT, abs=1.51 * COUNT)
    healthy = moved(rigid(), settle=0.5)
    assert healthy.nozzle[-1, 0] == pytest.approx(healthy.commanded[-1, 0], abs=1.51 * COUNT)


@pytest.mark.parametrize("ticks", [1, 3])
def test_a_glitch_is_a_torque_pulse_by_the_gains(rigid, ticks):
    machine, counts = rigid(), 20
    servo = plain(machine, resolution=COUNT).with_values(output_velocity=(-1e-3, 0.0))
    runs = [
        simulate(machine, servo, ramp(SPEED), faults=faults)
        for faults in ((), (EncoderGlitch(time=AT, axis="x", counts=counts, ticks=ticks),))
    ]
    healthy, run = runs
    jump = counts * COUNT
    kp, ki, kd, damping = (servo.per_axis(name)[0] for name in ("kp", "ki", "kd", "output_velocity"))
    pulse = -(kp + ki * PERIOD + kd / PERIOD - damping / PERIOD) * jump
    assert abs(healthy.demand[K, 0] + pulse) < 0.9  # not clamped
    assert run.demand[K, 0] - healthy.demand[K, 0] == pytest.approx(pulse, rel=1e-9)
    off = run.encoder[K - 1 : K + ticks + 1, 0] - COUNT * np.floor(x(run)[K - 1 : K + ticks + 1] / COUNT + 0.5)
    np.testing.assert_allclose(off, [0, *[jump] * ticks, 0], atol=1e-9)


def test_a_dropped_out_encoder_freezes_and_comes_back(rigid):
    run = moved(rigid(), EncoderDropout(time=AT, axis="x", duration=0.004))
    assert (run.encoder[K : K + 4, 0] == run.encoder[K - 1, 0]).all()
    np.testing.assert_allclose(run.encoder[K + 4 :, 0], COUNT * np.floor(x(run)[K + 4 :] / COUNT + 0.5), atol=1e-9)
    trips = moved(rigid(), EncoderDropout(time=AT, axis="x"), following_error_limit=5.0)
    assert trips.fault is not None
    assert trips.fault.time > AT


def test_faults_on_one_value_act_in_one_order_however_they_are_given(rigid):
    """An encoder that stands still reports no glitch, and an open winding has no torque from a sagging bus."""
    pairs = (
        (EncoderDropout(time=AT, axis="x", duration=0.01), EncoderGlitch(time=AT, axis="x", counts=40, ticks=5)),
        (OpenWinding(time=AT, axis="x", duration=0.01), BusSag(time=AT, axis="x", share=0.5, duration=0.01)),
    )
    machine = rigid(damping=0.0)
    for first, second in pairs:
        run = moved(machine, first, second)
        other = moved(machine, second, first)
        for name, values in arrays(run).items():
            np.testing.assert_array_equal(values, arrays(other)[name], err_msg=name)
    frozen = moved(machine, *reversed(pairs[0])).encoder[K : K + 5, 0]
    assert np.ptp(frozen) == 0
    assert not moved(machine, *pairs[1]).torque[K : K + 10, 0].any()


def test_a_slipping_axis_lags_its_motor_while_the_encoder_sees_nothing_at_rest(rigid):
    run = moved(rigid(), SlippingAxis(time=AT, axis="x", offset=0.4), settle=0.5)
    np.testing.assert_allclose(run.motor[K:, 0] - run.nozzle[K:, 0], 0.4, atol=1e-9)
    np.testing.assert_allclose(run.motor[:K, 0], run.nozzle[:K, 0], atol=1e-9)
    assert run.commanded[-1, 0] - run.encoder[-1, 0] == pytest.approx(0, abs=1.01 * COUNT)
    assert run.commanded[-1, 0] - run.nozzle[-1, 0] == pytest.approx(0.4, abs=1.51 * COUNT)


@pytest.mark.parametrize("drive", ["hold", "extrapolate"])
@pytest.mark.parametrize("axis", ["x", None])
def test_a_drive_without_setpoints_holds_or_extrapolates(rigid, drive, axis):
    seen = []

    def law(tick):
        seen.append(tick.commanded)
        return np.zeros(2)

    lost = 7
    setpoints = dataclasses.replace(ramp(SPEED), axes=("x", "y"))
    curved = setpoints.position.copy()
    curved[:, 1] = 1e-4 * np.arange(len(curved)) ** 1.5 - curved[0, 1]
    setpoints = dataclasses.replace(setpoints, position=curved)
    fault = LostPackets(time=AT, ticks=lost, axis=axis, drive=drive)
    machine = rigid(travel=10.0)
    run = simulate(machine, plain(machine), setpoints, faults=[fault], law=law)
    expected = curved.copy()
    step = curved[K - 1] - curved[K - 2] if drive == "extrapolate" else np.zeros(2)
    hit = [0] if axis else [0, 1]
    expected[K : K + lost, hit] = (curved[K - 1] + np.arange(1, lost + 1)[:, None] * step)[:, hit]
    np.testing.assert_allclose(np.array(seen), expected, atol=1e-9)
    np.testing.assert_array_equal(run.commanded, curved)  # what the controller sends


def test_the_controller_sees_a_drive_that_holds(rigid):
    """The position error of the group is against the setpoints sent, which the drive does not see."""
    machine = rigid()
    setpoints = dataclasses.replace(ramp(SPEED), supervision=Supervision(position_error=3.0))
    fault = LostPackets(time=AT, ticks=100)
    run = simulate(machine, plain(machine), setpoints, faults=[fault])
    assert run.fault is not None
    assert run.fault.kind == "position error"
    assert run.fault.time == pytest.approx(AT + 3.0 / SPEED, abs=0.015)  # less the lag with which the axis stops
    assert simulate(machine, plain(machine), setpoints).fault is None


FLOW = 200.0
GLUE = Dispenser(flow=FLOW)


def volume(run):
    return run.flow[:-1].sum() * run.period


@pytest.mark.validates(
    "glue lost in a clogged nozzle",
    "integral in closed form",
    "1e-9 relative",
)
@pytest.mark.parametrize(("begin", "duration"), [(AT, 0.2), (0.30037, 0.12345), (0.5, math.inf)])
@pytest.mark.parametrize("share", [0.0, 0.3])
def test_a_clogged_nozzle_loses_its_share_of_the_flow_over_its_time(rigid, begin, duration, share):
    machine = rigid()
    run = moved(machine, CloggedNozzle(time=begin, duration=duration, share=share), dispenser=GLUE)
    healthy = moved(machine, dispenser=GLUE)
    held_back = (1 - share) * FLOW * (min(begin + duration, run.time[-1]) - begin)
    assert volume(healthy) - volume(run) == pytest.approx(held_back, rel=1e-9)
    np.testing.assert_array_equal(run.nozzle, healthy.nozzle)


def test_a_dripping_nozzle_drips_while_the_valve_is_closed(rigid):
    machine = rigid()
    setpoints = ramp(SPEED)
    off = (setpoints.time > 0.4) & (setpoints.time < 0.6)
    setpoints = dataclasses.replace(setpoints, dispense=setpoints.dispense & ~off)
    leads = Dispenser(flow=FLOW, start_lead=0.0, stop_lead=0.0234)
    healthy, run = (
        simulate(machine, plain(machine), setpoints, dispenser=leads, faults=faults)
        for faults in ((), (DrippingNozzle(time=0.1, duration=0.45, flow=7.0),))
    )
    closes = np.flatnonzero(off)[0] * PERIOD - 0.0234
    assert volume(run) - volume(healthy) == pytest.approx(7.0 * (0.55 - closes), rel=1e-9)
    assert (run.flow[: int(closes / PERIOD)] == FLOW).all()


@pytest.mark.parametrize("pressure", [0.0, 150.0])
def test_an_air_bubble_takes_its_own_volume_and_gives_back_its_compression(rigid, pressure):
    machine, size, recovery = rigid(), 5.0, 0.03
    bubble = AirBubble(time=AT + 0.00042, volume=size, pressure=pressure, recovery=recovery)
    run, healthy = moved(machine, bubble, dispenser=GLUE), moved(machine, dispenser=GLUE)
    held = size * pressure / ATMOSPHERE
    assert volume(healthy) - volume(run) == pytest.approx(size, rel=1e-6)
    left = bubble.time + (size + held) / FLOW
    inside = (run.time > bubble.time) & (run.time + PERIOD < left)
    assert inside.sum() > 20
    assert not run.flow[inside].any()
    after = run.time > left
    surge = held / recovery * np.exp(-(run.time[after] - left) / recovery)
    mean = surge * recovery / PERIOD * -math.expm1(-PERIOD / recovery)
    np.testing.assert_allclose(run.flow[after] - FLOW, mean, atol=1e-6)


def test_a_bubble_that_does_not_leave_takes_the_rest_of_the_run(rigid):
    run = moved(rigid(), AirBubble(time=AT, volume=1e6), dispenser=GLUE)
    assert not run.flow[K:].any()
    assert run.flow[K - 1] == pytest.approx(FLOW)


NAMES = st.sampled_from(["x", "y"])
TIMES = st.floats(0.0, 0.15)
SPANS = st.floats(0.0, 0.1) | st.just(math.inf)
COUNTS = st.integers(-30, 30)


def lasting(kind, time=TIMES, span=SPANS, **values):
    return st.builds(kind, time=time, duration=span, **values)


def faults_of(time=TIMES, span=SPANS, share=None, size=None, counts=COUNTS, ticks=None):
    """Faults of every kind."""
    share = st.floats(0.0, 1.0) if share is None else share
    size = st.floats(0.0, 1.0) if size is None else size
    ticks = st.integers(0, 9) if ticks is None else ticks
    drive = st.sampled_from(["hold", "extrapolate"])
    return st.one_of(
        lasting(EncoderDropout, time, span, axis=NAMES),
        st.builds(EncoderGlitch, time=time, axis=NAMES, counts=counts, ticks=ticks),
        lasting(EncoderSlip, time, span, axis=NAMES, counts=counts),
        lasting(StuckAxis, time, span, axis=NAMES, friction=size | st.just(math.inf)),
        lasting(SlippingAxis, time, span, axis=NAMES, offset=size),
        lasting(OpenWinding, time, span, axis=NAMES),
        lasting(BusSag, time, span, share=share, axis=NAMES | st.none()),
        st.builds(LostPackets, time=time, ticks=ticks, axis=NAMES | st.none(), drive=drive),
        lasting(CloggedNozzle, time, span, share=share),
        lasting(DrippingNozzle, time, span, flow=size),
        st.builds(AirBubble, time=time, volume=size, pressure=size),
    )


ZERO = st.just(0.0)
NOTHING = st.one_of(
    faults_of(span=ZERO, counts=st.just(0), ticks=st.just(0), size=ZERO),
    lasting(StuckAxis, axis=NAMES, friction=ZERO),
    lasting(EncoderSlip, axis=NAMES, counts=st.just(0)),
    lasting(SlippingAxis, axis=NAMES, offset=ZERO),
    lasting(BusSag, share=st.just(1.0), axis=NAMES | st.none()),
    lasting(CloggedNozzle, share=st.just(1.0)),
    lasting(DrippingNozzle, flow=ZERO),
)


class Short(tuple):
    """A short run, whose text hypothesis may print."""

    def __repr__(self):
        return "short"


@pytest.fixture(scope="module")
def short():
    """Machine, servo and setpoints of a short run, and its record."""
    machine = Machine("xy")
    servo = Servo.derive(machine.axes, PERIOD)
    setpoints = ramp(SPEED, 12.0).hold(0.05)
    return Short([(machine, servo, setpoints), simulate(machine, servo, setpoints, dispenser=GLUE)])


@examples(60)
@given(faults=st.lists(NOTHING, max_size=4))
def test_faults_of_no_size_or_no_duration_change_no_bit(short, faults):
    parts, healthy = short
    run = simulate(*parts, dispenser=GLUE, faults=faults)
    assert run.fault is None
    for name, array in arrays(healthy).items():
        np.testing.assert_array_equal(getattr(run, name), array, err_msg=name)


@examples(60)
@given(faults=st.lists(faults_of(), min_size=1, max_size=3))
@example(faults=[CloggedNozzle(time=0.052, duration=0.0625, share=0.0)])  # the edge of tick 52 is a rounding later
def test_before_its_time_a_fault_changes_no_bit_and_a_batch_has_the_same_faults(short, faults):
    parts, healthy = short
    run = simulate(*parts, dispenser=GLUE, faults=faults)
    first = int(min(fault.time for fault in faults) / PERIOD)
    for name in ("encoder", "motor", "nozzle", "demand", "torque", "voltage", "flow"):
        np.testing.assert_array_equal(getattr(run, name)[:first], getattr(healthy, name)[:first], err_msg=name)
    batched, beside = simulate_batch(*parts, dispenser=GLUE, faults=[faults, []], threads=1)
    for name, array in arrays(run).items():
        np.testing.assert_array_equal(getattr(batched, name), array, err_msg=name)
    np.testing.assert_array_equal(beside.nozzle, healthy.nozzle)


@examples(25)
@given(fault=faults_of())
def test_a_record_keeps_its_faults(short, fault, tmp_path_factory):
    _, healthy = short
    file = tmp_path_factory.mktemp("run") / "run.npz"
    dataclasses.replace(healthy, injected=(fault, fault)).save(file)
    assert Run.load(file).injected == (fault, fault)
    healthy.save(file)
    assert Run.load(file).injected == ()


@pytest.mark.parametrize(
    ("fault", "text"),
    [
        (OpenWinding(time=0.1, axis="q"), r"^fault open winding: axis = 'q': machine rigid has x, y$"),
        (
            OpenWinding(time=99, axis="x"),
            r"^fault open winding: time = 99 s: must be at most 1\.40\d s, the run's length$",
        ),
        ("open winding", r"^faults: holds a str: must be faults such as encoder glitch, "),
    ],
)
def test_a_fault_that_the_run_cannot_have_is_refused(rigid, fault, text):
    with pytest.raises(InputError, match=text):
        moved(rigid(), fault)


def test_an_encoder_without_counts_has_no_glitch_and_an_ideal_motor_no_bus(tmp_path, rigid):
    machine = rigid()
    with pytest.raises(InputError, match="fault encoder slip: axis x has no encoder counts; its position is exact"):
        simulate(machine, plain(machine), ramp(SPEED), faults=[EncoderSlip(time=0, axis="x", counts=1)])
    machine = Machine(ideal_motors(tmp_path / "rigid.xml"))
    for axis in ("x", None):
        with pytest.raises(InputError, match="fault bus sag: axis x is an ideal torque source, it has no bus"):
            simulate(machine, plain(machine), ramp(SPEED), faults=[BusSag(time=0, axis=axis, share=0.5)])


def test_a_delayed_actuator_has_no_electrical_fault(tmp_path, rigid):
    rigid()
    file = tmp_path / "rigid.xml"
    file.write_text(file.read_text().replace('name="x" joint="x"', 'name="x" joint="x" nsample="4" delay="0.001"', 1))
    machine = Machine(file)
    servo = plain(machine, kp=1.0, kd=0.01)
    for fault in (OpenWinding(time=0, axis="x"), BusSag(time=0, share=0.5)):
        with pytest.raises(InputError, match="machine rigid has an actuator with a delay of its own"):
            simulate(machine, servo, ramp(SPEED), faults=[fault])


@pytest.mark.parametrize(("name", "axis"), [("delta", "a1"), ("stage", "th"), ("xyzr", "r")])
def test_an_axis_that_turns_seizes_and_slips_too(name, axis):
    machine = Machine(name)
    axis = axis if axis in machine.axis_names else machine.axis_names[0]
    a = machine.axis_names.index(axis)
    position = np.zeros((400, len(machine.axes)))
    position[:, a] = 20.0 * np.clip(np.arange(400) * PERIOD, 0.0, 0.3)
    setpoints = Setpoints(PERIOD, machine.axis_names, position, np.ones(400, bool), ramp(50.0).requested)
    servo = Servo.derive(machine.axes, PERIOD)
    healthy, seized, slipped = (
        simulate(machine, servo, setpoints, faults=faults)
        for faults in ((), (StuckAxis(time=0.1, axis=axis),), (SlippingAxis(time=0.1, axis=axis, offset=0.5),))
    )
    assert np.ptp(healthy.motor[110:, a]) > 3
    assert np.ptp(seized.motor[102:, a]) < 5e-3
    assert slipped.motor[-1, a] == pytest.approx(healthy.motor[-1, a], abs=0.05)  # the servo holds the motor
    held = slipped.motor[-1].copy()
    held[a] -= 0.5
    shift = machine.tip(held) - machine.tip(healthy.motor[-1])
    # the delta's arms bend
    np.testing.assert_allclose(slipped.nozzle[-1] - healthy.nozzle[-1], shift, atol=0.1)
