"""The sampled servo on the simulated machine, against independent models of both."""

import math

import numpy as np
import pytest
from scipy.signal import cont2discrete

from gantrysim import Servo, simulate
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.record.setpoints import Setpoints

from support.runs import PERIOD, STEP, plain, ramp

# Agreement with a model of the same integrator, in mm: rounding over ten thousand steps.
SAME_INTEGRATOR = 1e-9


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
            count = servo.drives[a].resolution
            m = p * 1e3 if count == 0 else count * math.floor(p * 1e3 / count + 0.5)
            e = command[k] - m
            last_command, last_velocity, last_m, last_e = before or (command[k], 0.0, m, e)
            velocity = (command[k] - last_command) / t
            sum_now = total + e * t
            torque = (
                servo.gains[a].kp * e
                + servo.gains[a].ki * sum_now
                + servo.gains[a].kd * (e - last_e) / t
                + servo.gains[a].velocity_ff * velocity
                + servo.gains[a].acceleration_ff * (velocity - last_velocity) / t
                + servo.gains[a].output_velocity * (m - last_m) / t
            )
            limit = servo.drives[a].torque_limit
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
                v += h * (force * i - damping * v) / (mass + h * damping)
                p += h * v
                i += (held / 0.03 - i) * (1 - math.exp(-h / winding))
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


@pytest.mark.validates(
    "servo and axis",
    "independent simulation with the same integrator",
    "1e-9 mm",
)
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
    law = servo.gains[a].kp + servo.gains[a].kd * back
    forward = servo.gains[a].velocity_ff * back + servo.gains[a].acceleration_ff * back**2
    return (1 - plant * forward) / (1 + plant * law)


def steady_circle(machine, servo, circle, speed, radius, step):
    """Following error over the last of many turns, and the angle of the command there."""
    setpoints = Setpoints.along(circle(radius, 4.0), speed, servo.period)
    run = simulate(machine, servo, setpoints, physics_step=step)
    last = run.time > 0.75 * run.time[-1]
    last[-1] = False  # the last way is shorter than the others
    return (run.commanded - run.encoder)[last], (speed / radius) * run.time[last]


@pytest.mark.validates(
    "following error on a circle",
    "z-transform of the sampled loop",
    "1e-8 mm",
)
@pytest.mark.parametrize("feedforward", [0.0, 1.0])
def test_following_error_on_a_circle_is_that_of_the_discrete_linear_model(rigid, circle, feedforward):
    machine, speed, radius = rigid(), 100.0, 20.0
    servo = plain(machine, feedforward=feedforward)
    error, angle = steady_circle(machine, servo, circle, speed, radius, STEP)
    for a, phase in enumerate((0.0, -0.5 * np.pi)):
        mass, force, damping, winding = constants(machine, a)
        kept, h = np.exp(-STEP / winding), STEP
        grip, push = mass / (mass + h * damping), h * force / (mass + h * damping)
        # [p, v, i] over one physics step: the velocity first, then the position, and the winding for the next step
        one = np.array([[1, h * grip, h * push], [0, grip, push], [0, 0, kept]])
        drive = np.array([0, 0, 1]) * (1 - kept) / 0.03
        lifted = np.linalg.matrix_power(one, 4)
        held = sum(np.linalg.matrix_power(one, k) @ drive for k in range(4))
        expected = radius * (closed_loop(servo, a, lifted, held, speed, radius) * np.exp(1j * (angle + phase))).real
        np.testing.assert_allclose(error[:, a], expected, rtol=0, atol=1e-8)


@pytest.mark.validates(
    "physics step of 0.25 ms on a circle",
    "exact sampled plant",
    "0.05 % of the following error",
)
@pytest.mark.parametrize(("viscous", "order"), [(0.0, 2), (12.0, 1)])
def test_circle_converges_to_the_exact_sampled_plant_with_the_physics_step(rigid, circle, viscous, order):
    """At second order, but for MuJoCo's viscous friction, which is implicit: a share h d / m of it, at first order."""
    machine, speed, radius = rigid(damping=viscous), 200.0, 20.0
    servo = plain(machine, feedforward=0.0)
    mass, force, _, winding = constants(machine, 0)
    a = np.array([[0, 1, 0], [0, -viscous / mass, force / mass], [0, 0, -1 / winding]])
    b = np.array([[0], [0], [1 / (0.03 * winding)]])
    exact_a, exact_b, *_ = cont2discrete((a, b, np.eye(3), np.zeros((3, 1))), PERIOD)
    response = closed_loop(servo, 0, exact_a, exact_b[:, 0], speed, radius)
    gaps = []
    for step in (5e-4, 2.5e-4, 1.25e-4, 6.25e-5):
        error, angle = steady_circle(machine, servo, circle, speed, radius, step)
        gaps.append(np.abs(error[:, 0] - radius * (response * np.exp(1j * angle)).real).max())
    ratios = np.array(gaps[:-1]) / gaps[1:]
    np.testing.assert_allclose(ratios, 2.0**order, rtol=0.11)
    assert gaps[1] < 5e-4 * radius * abs(response)  # the default step


@pytest.mark.validates(
    "steady error at constant speed",
    "viscous torque / kp",
    "1e-6 relative",
)
@pytest.mark.parametrize("speed", [20.0, 100.0, 400.0])
def test_steady_ramp_error_is_the_viscous_torque_over_the_gain(rigid, speed):
    machine = rigid()
    servo = plain(machine, feedforward=0.0, output_velocity=-1e-4)
    run = simulate(machine, servo, ramp(speed), physics_step=STEP)
    viscous = 12.0 * machine.axes[0].scale * 1e-6  # N·s/m at the guide, as N·m·s/mm at the motor
    error = run.commanded[-5, 0] - run.encoder[-5, 0]
    assert error == pytest.approx((viscous + 1e-4) * speed / servo.gains[0].kp, rel=1e-6)


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
    assert error == pytest.approx((axis.viscous * speed + friction) / servo.gains[0].kp, rel=1e-3)


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


def test_a_step_that_does_not_divide_the_period_is_made_shorter(rigid):
    machine = rigid()
    odd = simulate(machine, plain(machine), ramp(50.0), physics_step=4e-4)  # a third of the period is the next shorter
    third = simulate(machine, plain(machine), ramp(50.0), physics_step=PERIOD / 3)
    np.testing.assert_array_equal(odd.nozzle, third.nozzle)
