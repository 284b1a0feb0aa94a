"""The sampled servo on the simulated machine, against independent models of both."""

import dataclasses
import math

import mujoco
import numpy as np
import pytest
from scipy.signal import cont2discrete

from gantrysim import GantryError, InputError, Machine, Servo, simulate
from gantrysim.controllers.path import ArcChain
from gantrysim.controllers.servo import Tick
from gantrysim.controllers.setpoints import Setpoints
from gantrysim.controllers.trio import MoveSpiral

PERIOD = 1e-3
STEP = 2.5e-4
# Agreement with a model of the same integrator, in mm: rounding over ten thousand steps.
SAME_INTEGRATOR = 1e-9


def plain(machine, period=PERIOD, **gains):
    """A servo without encoder quantisation, whose gains the test gives."""
    gains = {"resolution": 0.0, "following_error_limit": 1e3, **gains}
    return Servo.derive(machine.axes, period, **gains)


def constants(machine, a):
    """Mass moved by an axis, force per ampere, viscous damping, winding's time constant: the MJCF's numbers [SI]."""
    radians_per_metre = 1e3 / machine.axes[a].scale
    mass = (1.0 if machine.axes[a].name == "x" else 4.0) + 1.5e-5 * radians_per_metre**2
    return mass, 0.03 * radians_per_metre, 12.0, 1e-3


def simulate_alone(machine, servo, position, substeps):
    """The servo and one axis after the other in plain Python: semi-implicit Euler, exact winding, sampled law.

    Returns measured positions and torque demands at the ticks, (n, axes) [mm], [N·m].
    """
    n, axes = position.shape
    measured, demands = np.zeros((n, axes)), np.zeros((n, axes))
    h, t = servo.period / substeps, servo.period
    delay = round(servo.delay / h)
    for a in range(axes):
        mass, force, damping, winding = constants(machine, a)
        p, v, i, held, pending, total = position[0, a] * 1e-3, 0.0, 0.0, 0.0, 0.0, 0.0
        command = position[:, a]
        before = None
        for k in range(n):
            count = servo.resolution[a]
            m = p * 1e3 if count == 0 else count * math.floor(p * 1e3 / count + 0.5)
            e = command[k] - m
            last_command, last_velocity, last_m, last_e = before or (command[k], 0.0, m, e)
            velocity = (command[k] - last_command) / t
            sum_now = total + e * t
            torque = (
                servo.kp[a] * e
                + servo.ki[a] * sum_now
                + servo.kd[a] * (e - last_e) / t
                + servo.velocity_ff[a] * velocity
                + servo.acceleration_ff[a] * (velocity - last_velocity) / t
                + servo.output_velocity[a] * (m - last_m) / t
            )
            limit = servo.torque_limit[a]
            if abs(torque) <= limit or torque * e < 0:
                total = sum_now
            if delay == substeps:
                held = pending
            pending = min(max(torque, -limit), limit)
            measured[k, a], demands[k, a] = m, pending
            before = (command[k], velocity, m, e)
            if k == n - 1:
                break
            for sub in range(substeps):
                if sub == delay:
                    held = pending
                i += (held / 0.03 - i) * (1 - math.exp(-h / winding))  # MuJoCo's dcmotor acts early
                v += h * (force * i - damping * v) / (mass + h * damping)
                p += h * v
    return measured, demands


VARIANTS = {
    "pd": {"feedforward": 0.0},
    "pd with feed-forward": {},
    "pid": {"integral_time": 0.05},
    "output velocity": {"output_velocity": -2e-4, "feedforward": 0.5},
    "half a period of delay": {"delay": 5e-4, "frequency": 12.0},
    "a period of delay": {"delay": 1e-3, "frequency": 10.0},
    "encoder": {"resolution": 0.01},
    "saturated": {"torque_limit": 0.02, "integral_time": 0.05},
    "encoder, integral, saturated, delayed": {
        "resolution": 0.004,
        "integral_time": 0.03,
        "torque_limit": 0.1,
        "delay": 2.5e-4,
    },
}


@pytest.mark.parametrize("gains", VARIANTS.values(), ids=VARIANTS.keys())
def test_engine_equals_an_independent_simulation_of_servo_and_axis(rigid, gains):
    machine = rigid()
    servo = plain(machine, **gains)
    setpoints = MoveSpiral(60, 2, 10, 150, loop_period=0.05).setpoints(PERIOD)
    run = simulate(machine, servo, setpoints, physics_step=STEP)
    measured, demands = simulate_alone(machine, servo, setpoints.position, 4)
    assert run.fault is None
    np.testing.assert_allclose(run.encoder, measured, rtol=0, atol=SAME_INTEGRATOR)
    np.testing.assert_allclose(run.demand, demands, rtol=0, atol=SAME_INTEGRATOR)


def closed_loop(servo, a, lifted_a, lifted_b, speed, radius):
    """E/R of one axis at the circle's frequency, by the z-transform of the law and a lifted plant [p, v, i] in mm."""
    w = speed / radius
    z = np.exp(1j * w * servo.period)
    plant = np.array([1e3, 0, 0]) @ np.linalg.solve(z * np.eye(3) - lifted_a, lifted_b)
    back = (1 - 1 / z) / servo.period
    law = servo.kp[a] + servo.kd[a] * back
    forward = servo.velocity_ff[a] * back + servo.acceleration_ff[a] * back**2
    return (1 - plant * forward) / (1 + plant * law)


def steady_circle(machine, servo, circle, speed, radius, step):
    """Following error over the last of many turns, and the angle of the command there."""
    setpoints = Setpoints.along(circle(radius, 4.0), speed, servo.period)
    run = simulate(machine, servo, setpoints, physics_step=step)
    last = run.time > 0.75 * run.time[-1]
    last[-1] = False  # the last way is shorter than the others
    return (run.commanded - run.encoder)[last], (speed / radius) * run.time[last]


@pytest.mark.parametrize("feedforward", [0.0, 1.0])
def test_following_error_on_a_circle_is_that_of_the_discrete_linear_model(rigid, circle, feedforward):
    machine, speed, radius = rigid(), 100.0, 20.0
    servo = plain(machine, feedforward=feedforward)
    error, angle = steady_circle(machine, servo, circle, speed, radius, STEP)
    for a, phase in enumerate((0.0, -0.5 * np.pi)):
        mass, force, damping, winding = constants(machine, a)
        kept, h = np.exp(-STEP / winding), STEP
        grip, push = mass / (mass + h * damping), h * force / (mass + h * damping)
        # [p, v, i] over one physics step: the winding first, then the velocity, then the position
        one = np.array([[1, h * grip, h * push * kept], [0, grip, push * kept], [0, 0, kept]])
        drive = np.array([h * push, push, 1]) * (1 - kept) / 0.03
        lifted = np.linalg.matrix_power(one, 4)
        held = sum(np.linalg.matrix_power(one, k) @ drive for k in range(4))
        expected = radius * (closed_loop(servo, a, lifted, held, speed, radius) * np.exp(1j * (angle + phase))).real
        np.testing.assert_allclose(error[:, a], expected, rtol=0, atol=1e-8)


def test_circle_converges_to_the_exact_sampled_plant_at_first_order_in_the_physics_step(rigid, circle):
    machine, speed, radius = rigid(), 200.0, 20.0
    servo = plain(machine, feedforward=0.0)
    mass, force, damping, winding = constants(machine, 0)
    a = np.array([[0, 1, 0], [0, -damping / mass, force / mass], [0, 0, -1 / winding]])
    b = np.array([[0], [0], [1 / (0.03 * winding)]])
    exact_a, exact_b, *_ = cont2discrete((a, b, np.eye(3), np.zeros((3, 1))), PERIOD)
    response = closed_loop(servo, 0, exact_a, exact_b[:, 0], speed, radius)
    gaps = []
    for step in (5e-4, 2.5e-4, 1.25e-4, 6.25e-5):
        error, angle = steady_circle(machine, servo, circle, speed, radius, step)
        gaps.append(np.abs(error[:, 0] - radius * (response * np.exp(1j * angle)).real).max())
    ratios = np.array(gaps[:-1]) / gaps[1:]
    np.testing.assert_allclose(ratios, 2.0, rtol=0.1)
    assert gaps[1] < 5e-3 * radius * abs(response)  # the default step: below 0.5 % of the error


def ramp(speed, length=140.0):
    return Setpoints.along(ArcChain((-70.0, 0.0), 0.0, [0.0], [length]), speed, PERIOD)


@pytest.mark.parametrize("speed", [20.0, 100.0, 400.0])
def test_steady_ramp_error_is_the_viscous_torque_over_the_gain(rigid, speed):
    machine = rigid()
    servo = plain(machine, feedforward=0.0, output_velocity=-1e-4)
    run = simulate(machine, servo, ramp(speed), physics_step=STEP)
    viscous = 12.0 * machine.axes[0].scale * 1e-6  # N·s/m at the guide, as N·m·s/mm at the motor
    error = run.commanded[-5, 0] - run.encoder[-5, 0]
    assert error == pytest.approx((viscous + 1e-4) * speed / servo.kp[0], rel=1e-6)


def test_velocity_feed_forward_and_the_integral_each_remove_the_ramp_error(rigid):
    machine = rigid()
    for gains in ({"feedforward": 1.0}, {"feedforward": 0.0, "integral_time": 0.02}):
        run = simulate(machine, plain(machine, **gains), ramp(100.0), physics_step=STEP)
        assert abs(run.commanded[-5, 0] - run.encoder[-5, 0]) < 1e-6


@pytest.mark.parametrize("speed", [50.0, 200.0])
def test_steady_ramp_error_of_a_machine_with_friction(xy, speed):
    servo = plain(xy, feedforward=0.0)
    run = simulate(xy, servo, ramp(speed))
    axis = xy.axes[0]
    # LuGre in steady sliding is Coulomb friction plus what the Stribeck curve leaves at that speed
    stribeck = float(xy.model.actuator_biasprm[0, 5])
    static = float(xy.model.actuator_biasprm[0, 4])
    friction = axis.coulomb + (static - axis.coulomb) * math.exp(-((speed / axis.scale / stribeck) ** 2))
    error = (run.commanded - run.encoder)[-60:-10, 0].mean()
    assert error == pytest.approx((axis.viscous * speed + friction) / servo.kp[0], rel=1e-3)


def test_torque_limit_bites_only_where_it_is_below_the_need(rigid):
    setpoints = MoveSpiral(60, 2, 10, 150).setpoints(PERIOD)
    strong = rigid(current=1e4, voltage=1e4)
    free = simulate(strong, plain(strong, torque_limit=math.inf), setpoints)
    need = np.abs(free.demand).max()
    loose = simulate(strong, plain(strong, torque_limit=1.01 * need), setpoints)
    tight = simulate(strong, plain(strong, torque_limit=0.5 * need), setpoints)
    np.testing.assert_array_equal(loose.encoder, free.encoder)
    assert np.abs(tight.demand).max() == pytest.approx(0.5 * need, rel=1e-12)
    assert np.abs(tight.commanded - tight.encoder).max() > 1.2 * np.abs(free.commanded - free.encoder).max()


def test_bus_voltage_bites(rigid):
    setpoints = ramp(700.0)
    runs = {}
    for voltage in (24.0, 15.0):
        machine = rigid(voltage=voltage)
        runs[voltage] = simulate(machine, plain(machine), setpoints)
        assert np.abs(runs[voltage].voltage).max() <= voltage * (1 + 1e-12)
    # K v 2 pi / lead = 13.2 V of back-EMF, and acceleration wants 9 V more
    assert (
        np.abs(runs[24.0].commanded - runs[24.0].encoder).max()
        < np.abs(runs[15.0].commanded - runs[15.0].encoder).max()
    )


def test_encoder_lies_on_its_counts_and_within_half_a_count_of_the_nozzle(rigid):
    machine = rigid()
    servo = Servo.derive(machine.axes, PERIOD, resolution=0.02)
    run = simulate(machine, servo, MoveSpiral(60, 2, 10, 150).setpoints(PERIOD))
    counts = run.encoder / 0.02
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    off = np.abs(run.encoder - run.nozzle[:, :2])
    assert 0.009 < off.max() <= 0.01 + 1e-9


def test_nozzle_of_a_rigid_machine_is_where_the_encoder_says(rigid):
    machine = rigid()
    run = simulate(machine, plain(machine), MoveSpiral(60, 2, 10, 150).setpoints(PERIOD))
    np.testing.assert_allclose(run.nozzle, run.encoder_tip, atol=1e-12)


def test_runs_are_equal_to_the_last_bit_sliced_or_not(xy):
    servo = Servo.derive(xy.axes)
    setpoints = MoveSpiral(60, 1, 10, 100).setpoints(PERIOD)
    seen = []
    runs = [
        simulate(xy, servo, setpoints),
        simulate(xy, servo, setpoints),
        simulate(xy, servo, setpoints, progress=seen.append),
    ]
    for name in ("encoder", "nozzle", "demand", "torque", "current", "voltage"):
        for other in runs[1:]:
            np.testing.assert_array_equal(getattr(runs[0], name), getattr(other, name))
    assert seen == sorted(seen)
    assert seen[-1] == 1.0


def test_axes_that_the_program_leaves_out_stand_still(xyz):
    run = simulate(xyz, Servo.derive(xyz.axes), MoveSpiral(60, 1, 10, 100).setpoints(PERIOD))
    assert run.fault is None
    assert np.abs(run.nozzle[:, 2]).max() < 1e-3


def pd_in_python(servo):
    before = {}

    def law(tick: Tick):
        error = np.subtract(tick.commanded, tick.measured)
        change = (error - before.get("error", error)) / servo.period
        before["error"] = error
        return (
            np.array(servo.kp) * error
            + np.array(servo.ki) * 0.0
            + np.array(servo.kd) * change
            + np.array(servo.velocity_ff) * tick.demand_velocity
            + np.array(servo.acceleration_ff) * tick.demand_acceleration
            + np.array(servo.output_velocity) * tick.measured_velocity
        )

    return law


def test_a_law_in_plain_python_runs_through_the_same_tick(xy):
    servo = Servo.derive(xy.axes)
    setpoints = MoveSpiral(60, 1, 10, 100).setpoints(PERIOD)
    compiled = simulate(xy, servo, setpoints)
    plain_law = simulate(xy, servo, setpoints, law=pd_in_python(servo))
    np.testing.assert_allclose(plain_law.demand, compiled.demand, rtol=0, atol=1e-11)
    np.testing.assert_allclose(plain_law.encoder, compiled.encoder, rtol=0, atol=1e-9)


def test_what_a_plain_law_raises_reaches_the_caller(xy):
    setpoints = MoveSpiral(60, 1, 10, 100).setpoints(PERIOD)

    def broken(tick):
        raise ZeroDivisionError("gain of nothing")

    with pytest.raises(ZeroDivisionError, match="gain of nothing"):
        simulate(xy, Servo.derive(xy.axes), setpoints, law=broken)
    with pytest.raises(InputError, match="must be 2 finite torques"):
        simulate(xy, Servo.derive(xy.axes), setpoints, law=lambda tick: [0.0])


@pytest.mark.parametrize("frequency", [100.0, 140.0, 200.0, 400.0, 1000.0])
def test_unstable_gains_end_in_a_fault_with_time_and_axis(xy, frequency):
    servo = Servo.derive(xy.axes, PERIOD, frequency=frequency)
    run = simulate(xy, servo, MoveSpiral(120, 4, 10, 100).setpoints(PERIOD))
    assert run.fault is not None
    assert run.fault.axis in ("x", "y")
    assert run.time[-1] == pytest.approx(run.fault.time)
    assert run.fault.time < 2.0
    assert f"{run.fault.kind} on axis {run.fault.axis} at t = {run.fault.time:.4f} s" in str(run.fault)


def test_divergence_without_any_limit_is_a_fault_too(rigid):
    machine = rigid(travel=1e6, speed=0.0, voltage=1e9, current=1e9)
    servo = plain(machine, frequency=400.0, following_error_limit=math.inf, torque_limit=math.inf)
    run = simulate(machine, servo, MoveSpiral(120, 4, 10, 100).setpoints(PERIOD))
    assert run.fault is not None
    assert np.abs(run.commanded - run.encoder)[:-1].max() > 10


def test_a_limit_cycle_between_the_torque_limits_is_a_fault_and_a_hard_start_is_none(rigid):
    machine = rigid()
    lazy = {"following_error_limit": 1e3, "resolution": 0.0}
    wild = simulate(machine, Servo.derive(machine.axes, PERIOD, frequency=150.0, **lazy), ramp(100.0))
    assert wild.fault is not None
    assert (wild.fault.kind, wild.fault.axis, wild.fault.value) == ("oscillation", "x", 20)
    assert np.abs(wild.commanded - wild.encoder).max() < 20  # bounded: no other limit would have seen it
    limited = simulate(machine, Servo.derive(machine.axes, PERIOD, torque_limit=0.1, **lazy), ramp(100.0))
    assert limited.fault is None
    assert (np.abs(limited.demand[:, 0]) == 0.1).sum() > 10


@pytest.mark.parametrize(
    ("limits", "kind"),
    [
        ({"following_error_limit": 0.5}, "following error"),
        ({"following_error_limit": 1e6}, "overspeed"),
    ],
)
def test_a_run_away_axis_trips_on_the_first_limit_it_meets(rigid, limits, kind):
    machine = rigid()
    servo = Servo.derive(machine.axes, PERIOD, **limits)
    run = simulate(machine, servo, ramp(50.0), law=lambda tick: [0.9, 0.0])
    assert run.fault is not None
    assert (run.fault.kind, run.fault.axis) == (kind, "x")
    reached = run.commanded[-1, 0] - run.encoder[-1, 0] if kind == "following error" else run.fault.value
    assert reached == pytest.approx(run.fault.value)
    assert abs(run.fault.value) > run.fault.limit
    if kind == "overspeed":
        assert run.fault.limit == pytest.approx(1.2 * machine.axes[0].speed_limit)


def test_leaving_the_travel_is_a_fault(rigid):
    machine = rigid()
    servo = Servo.derive(machine.axes, PERIOD, following_error_limit=1e6)
    machine.model.jnt_limited[:] = 0  # no hard stop before the limit switch
    run = simulate(machine, servo, ramp(50.0), law=lambda tick: [0.05 if tick.measured_velocity[0] < 300 else 0.0, 0.0])
    assert run.fault is not None
    assert (run.fault.kind, run.fault.axis) == ("travel", "x")
    assert run.encoder[-1, 0] > 150.1
    assert run.encoder[-2, 0] <= 150.1 + 1e-9


def test_the_same_run_within_its_limits_has_no_fault(rigid):
    machine = rigid()
    run = simulate(machine, Servo.derive(machine.axes, PERIOD, following_error_limit=0.6), ramp(50.0))
    assert run.fault is None
    assert len(run.time) == len(ramp(50.0).position)


BAD = {
    "unknown axis": (
        lambda m: {"setpoints": dataclasses.replace(ramp(50.0), axes=("x", "w"))},
        "moves axis 'w'.*has x, y",
    ),
    "travel": (
        lambda m: {"setpoints": ramp(50.0, 240.0)},
        r"x = 170 mm at t = .*travel -150 to 150 mm of machine rigid",
    ),
    "speed": (lambda m: {"setpoints": ramp(1500.0)}, r"speed of x = 1500 mm/s.*at most 1000 mm/s"),
    "period": (
        lambda m: {"servo": Servo.derive(m.axes, 5e-4)},
        r"period = 0.001 s: must be the servo period, 0.0005 s",
    ),
    "axes": (lambda m: {"servo": Servo.derive(m.axes[:1], PERIOD)}, "servo has 1 axes: machine rigid has 2"),
    "physics step": (lambda m: {"physics_step": 0.0}, "physics_step = 0 s: must be at least"),
    "flow": (lambda m: {"flow": -1.0}, "flow = -1 mm³/s: must be at least 0"),
    "delay": (
        lambda m: {"servo": Servo.derive(m.axes, PERIOD, delay=3e-4)},
        "servo delay = 0.0003 s: must be a multiple",
    ),
}


@pytest.mark.parametrize(("change", "text"), BAD.values(), ids=BAD.keys())
def test_bad_input_is_refused_before_anything_moves(rigid, change, text):
    machine = rigid()
    arguments = {"servo": Servo.derive(machine.axes, PERIOD), "setpoints": ramp(50.0), **change(machine)}
    with pytest.raises(InputError, match=text):
        simulate(machine, **arguments)


def test_speed_limit_is_the_declared_one_or_the_bus_voltage(rigid):
    assert rigid().axes[0].speed_limit == pytest.approx(1000.0)
    slow = rigid(voltage=12.0).axes[0]
    assert slow.speed_limit == pytest.approx(slow.no_load_speed) == pytest.approx(12 / 0.03 * 10 / (2 * math.pi))


def test_speed_limit_is_met_exactly(rigid):
    machine = rigid()
    servo = plain(machine)
    for speed, refused in ((999.9, False), (1000.2, True)):
        setpoints = ramp(speed)
        if refused:
            with pytest.raises(InputError, match="speed of x"):
                simulate(machine, servo, setpoints)
        else:
            simulate(machine, servo, setpoints)


def test_voltage_is_what_the_winding_needs_and_the_back_emf(rigid):
    machine = rigid()
    run = simulate(machine, plain(machine), ramp(600.0), physics_step=1e-4)
    speed = np.gradient(run.nozzle[:, 0], PERIOD)  # [mm/s]
    motor = speed / machine.axes[0].scale
    expected = 0.3 / 0.03 * run.demand[:, 0] + 0.03 * motor
    cruising = slice(len(run.time) // 2, -5)
    np.testing.assert_allclose(run.voltage[cruising, 0], expected[cruising], rtol=1e-5)
    assert run.voltage[cruising, 0].min() > 11  # most of it back-EMF


def test_torque_is_limited_by_the_drive_where_the_current_is_not(rigid):
    machine = rigid(current=2.0)
    run = simulate(machine, plain(machine, torque_limit=5.0), ramp(300.0))
    assert np.abs(run.demand).max() == pytest.approx(0.06)
    assert np.abs(run.torque).max() <= 0.06 * (1 + 1e-12)


def test_a_fault_disables_the_drives_at_once_even_with_a_delay(rigid):
    machine = rigid()
    servo = Servo.derive(machine.axes, PERIOD, delay=5e-4, following_error_limit=0.05)
    seen = []
    run = simulate(machine, servo, ramp(400.0), physics_step=STEP, progress=seen.append)
    assert run.fault is not None
    assert seen[-1] < 1.0  # the job has ended there
    row_end = len(run.time) - 1
    assert run.fault.time == pytest.approx(row_end * PERIOD)
    assert np.isfinite(run.nozzle).all()


def test_slow_swings_between_the_limits_are_no_oscillation(rigid):
    machine = rigid(speed=5.0)
    n = 25 * 300
    x = 5 * np.sign(np.sin(2 * np.pi * np.arange(n) * PERIOD / 0.3))  # jumps to and fro, every 0.15 s
    x = np.clip(np.convolve(x, np.ones(12) / 12, "same"), -5, 5)
    path = ArcChain((0.0, 0.0), 0.0, [0.0], [10.0])
    setpoints = Setpoints(PERIOD, ("x",), x[:, None], np.ones(n, bool), path)
    servo = Servo.derive(machine.axes, PERIOD, torque_limit=0.15, following_error_limit=1e3, resolution=0.0)
    run = simulate(machine, servo, setpoints)
    clamped = np.abs(run.demand[:, 0]) == 0.15
    swings = np.abs(np.diff(np.sign(run.demand[clamped, 0]))).sum() / 2
    assert swings > 20
    assert run.fault is None


def test_a_control_that_mujoco_would_switch_off_is_a_fault(rigid):
    source = rigid(current=0.0).source  # no limit
    content = source.read_text()
    for name in "xy":
        content = content.replace(
            f'<dcmotor name="{name}" joint="{name}"/>',
            f'<motor name="{name}" joint="{name}" gear="628.3185307179587"/>',
        )
    source.write_text(content)
    machine = Machine(source)
    servo = Servo.derive(machine.axes, PERIOD, following_error_limit=math.inf)
    run = simulate(machine, servo, ramp(50.0), law=lambda tick: [1e300, 0.0])
    assert run.fault is not None
    assert (run.fault.kind, run.fault.axis, run.fault.time) == ("diverged", "x", 0.0)
    wild = dataclasses.replace(servo, kp=(1e14, 1e14))
    run = simulate(machine, wild, ramp(50.0))
    assert run.fault is not None
    assert run.fault.kind in ("diverged", "overspeed")
    assert run.fault.time < 0.01


def test_what_mujoco_warns_of_is_a_fault_at_the_next_tick(rigid, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    machine = rigid(speed=0.0, travel=1e7)
    servo = Servo.derive(machine.axes, PERIOD, following_error_limit=math.inf)
    machine.model.jnt_limited[:] = 0
    object.__setattr__(
        machine,
        "axes",
        tuple(dataclasses.replace(a, speed_limit=math.inf, travel=(-math.inf, math.inf)) for a in machine.axes),
    )
    machine.model.opt.gravity[0] = 1e13  # an acceleration that MuJoCo calls bad
    run = simulate(machine, servo, ramp(50.0))
    assert run.fault is not None
    assert (run.fault.kind, run.fault.axis) == ("diverged", "x")
    assert run.fault.time <= 2 * PERIOD
    assert [item.name for item in tmp_path.iterdir()] == ["rigid.xml"]  # and no log file in the working directory


def test_physics_steps_are_at_most_what_the_machine_is_made_for(rigid):
    machine = rigid()
    with pytest.raises(
        InputError, match=r"physics_step = 0.001 s: must be at most 0.0005 s, the timestep that machine"
    ):
        simulate(machine, plain(machine), ramp(50.0), physics_step=1e-3)
    default = simulate(machine, plain(machine), ramp(50.0))
    same = simulate(machine, plain(machine), ramp(50.0), physics_step=5e-4)
    np.testing.assert_array_equal(default.nozzle, same.nozzle)


def test_a_step_that_does_not_divide_the_period_is_made_shorter(rigid):
    machine = rigid()
    odd = simulate(machine, plain(machine), ramp(50.0), physics_step=4e-4)  # a third of the period is the next shorter
    third = simulate(machine, plain(machine), ramp(50.0), physics_step=PERIOD / 3)
    np.testing.assert_array_equal(odd.nozzle, third.nozzle)


def test_nested_runs_in_a_law_are_refused_and_a_law_may_step_other_models(rigid):
    machine = rigid()
    servo = plain(machine)
    other = machine.stepping(5e-4)
    state = mujoco.MjData(other)

    def nested(tick):
        simulate(machine, servo, ramp(50.0))

    with pytest.raises(GantryError, match="cannot run a simulation: it is inside one"):
        simulate(machine, servo, ramp(50.0), law=nested)
    with pytest.raises(GantryError, match="cannot run inside another simulation"):
        simulate(
            machine, servo, ramp(50.0), progress=lambda _: simulate(machine, servo, ramp(50.0), law=lambda t: [0, 0])
        )

    def stepping(tick):
        mujoco.mj_step(other, state)
        return 0.0 * tick.error

    alone = simulate(machine, servo, ramp(5.0, 1.0), law=lambda tick: 0.0 * tick.error)
    beside = simulate(machine, servo, ramp(5.0, 1.0), law=stepping)
    np.testing.assert_array_equal(alone.nozzle, beside.nozzle)


def test_an_interrupt_in_a_law_reaches_the_caller(rigid):
    machine = rigid()

    def interrupted(tick):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(machine, plain(machine), ramp(50.0), law=interrupted)
