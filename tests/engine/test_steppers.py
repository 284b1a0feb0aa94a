"""Steppers in open loop against closed forms, an independent integration of their circuit, and energy."""

import math
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import eigh

from gantrysim import Machine, Servo, simulate
from gantrysim.base.errors import InputError
from gantrysim.engine.advance import Stepper
from gantrysim.engine.drives.field import mean_stepped
from gantrysim.engine.simulation import Simulation
from gantrysim.faults import BusSag
from gantrysim.identify.identification import identify
from gantrysim.identify.log import Log
from gantrysim.job.job import Job
from gantrysim.job.steps import lost_steps
from gantrysim.machine.ideal import without_winding
from gantrysim.metrics.budget import Budget
from gantrysim.record.setpoints import Setpoints
from gantrysim.report.summary import summary
from gantrysim.results.run_results import RunResults

from support.runs import ramp
from support.soaked import suite_runs
from support.tables import EXAMPLES

T_HOLD, AMPERE, OHM, HENRY, POLES, BUS = 0.6, 2.0, 1.2, 2.4e-3, 50, 36.0
K = T_HOLD / (math.sqrt(2) * AMPERE)
ROTOR, SCREW_INERTIA, LEAD = 1.2e-5, 4e-6, 10.0
LOAD, NUT = 1.0, 0.2
PERIOD_OF_FIELD = LEAD / POLES  # four full steps [mm]
TABLE = f"""
arrangement = "bridge"
masses = {{ bridge = 2.0, carriage = {LOAD} }}

[x]
travel = [-200, 200]
speed = 2000
guides = {{ viscous = VISCOUS }}

[x.drive]
voltage = {BUS}
nut_mass = {NUT}
microsteps = MICROSTEPS

[x.drive.motor]
kind = "stepper"
voltage = 24
holding_torque = {T_HOLD}
rated_current = {AMPERE}
resistance = {OHM}
inductance = {HENRY}
rotor_inertia = {ROTOR}
detent_torque = DETENT
max_speed = 20000
mass = 0.4
pole_pairs = {POLES}

[x.drive.transmission]
kind = "screw"
lead = {LEAD}
inertia = {SCREW_INERTIA}
stiffness = 20
damping_ratio = 0.0

[y]
travel = [-200, 200]

[y.drive]
motor = "maxon-re40-24"
encoder = 10000
voltage = 24
transmission = {{ kind = "screw", lead = 10, inertia = 7e-6, stiffness = 13 }}
"""
FINE = 2.5e-5
SMOOTH = 16384  # microsteps so small that the field turns as if without them


@pytest.fixture
def made(tmp_path):
    def make(viscous=0.0, microsteps=SMOOTH, detent=0.0, text=TABLE):
        file = tmp_path / "stepper.toml"
        values = {"VISCOUS": viscous, "MICROSTEPS": microsteps, "DETENT": detent}
        for name, value in values.items():
            text = text.replace(name, str(value))
        file.write_text(text)
        return Machine(file)

    return make


def driven(machine, x, period=FINE, start=None, **given):
    """A run of x alone, at its positions [mm]."""
    x = np.asarray(x, float)
    position = np.zeros((x.size, 2))
    position[:, 0] = x
    setpoints = Setpoints(period, machine.axis_names, position, np.zeros(x.size, bool), ramp(50.0).requested)
    servo = Servo.derive(machine.axes, period, **{"following_error_limit": 1e3, **given})
    simulation = Simulation.of(machine, servo, setpoints, physics_step=min(period, FINE))
    stepper = Stepper(simulation)
    if start is not None:
        start(stepper.data)
    stepper.advance()
    return stepper.run.record()


def pushed(machine, force):
    """The machine with a constant force on everything along x [N]."""

    def edit(spec):
        spec.option.gravity = [force / (LOAD + NUT), 0, 0]
        for body in spec.bodies:
            body.gravcomp = 0

    return machine.edited(edit)


def modes(detent=0.0):
    """Modes of the rotor in its field with the load on its spring, by the two masses' own matrices [Hz]."""
    per_turn = 1e-3 * LEAD / (2 * math.pi)
    own = (ROTOR + SCREW_INERTIA) / per_turn**2 + NUT
    field, spring = POLES * (T_HOLD + 4 * detent) / per_turn**2, 20e6
    stiffness = np.array([[field + spring, -spring], [-spring, spring]])
    return np.sqrt(eigh(stiffness, np.diag([own, LOAD]), eigvals_only=True)) / (2 * math.pi)


def test_a_stepper_of_a_table_is_driven_in_open_loop_without_gains(made):
    machine = made()
    servo = Servo.derive(machine.axes)
    assert machine.axes[0].electrical_period == pytest.approx(PERIOD_OF_FIELD)
    assert servo.modes == ("stepper", "torque")
    assert servo.per_axis("feedback") == ("none", "motor")
    assert servo.gains[0].kp == servo.gains[0].kd == 0 < servo.gains[1].kp
    as_before = Servo.derive(machine.axes, mode="torque")
    assert as_before.gains[0].kp > 0
    assert as_before.per_axis("feedback") == ("motor", "motor")


@pytest.mark.validates(
    "a stepper's small oscillations",
    "rotor and field",
    "0.1 %",
)
@pytest.mark.parametrize("detent", [0.0, 0.01])
def test_small_oscillations_have_the_frequency_of_rotor_and_field(made, detent):
    """sqrt(p T / J) of a rigid axis, at a full step with 4 times the detent torque; here with the load's spring."""
    lowest = modes(detent)[0]
    rigid = math.sqrt(POLES * T_HOLD / (ROTOR + SCREW_INERTIA + (LOAD + NUT) * (5e-3 / math.pi) ** 2)) / 2 / math.pi
    assert detent or lowest == pytest.approx(rigid, rel=0.01)
    x = np.zeros(8000)
    x[1:] = 2e-4  # a small step
    swing = driven(made(detent=detent), x).motor[2:, 0]
    swing = swing - swing.mean()
    up = np.flatnonzero((swing[:-1] < 0) & (swing[1:] >= 0))
    crossing = up - swing[up] / (swing[up + 1] - swing[up])
    assert (crossing[-1] - crossing[0]) / (up.size - 1) * FINE == pytest.approx(1 / lowest, rel=1e-3)


@pytest.mark.parametrize("share", [0.1, 0.6, 0.95])
def test_a_loaded_stepper_stands_off_by_the_angle_of_its_load(made, share):
    """asin(T / T_hold) / p, of a load torque T."""
    force = share * T_HOLD * 2 * math.pi / (1e-3 * LEAD)
    machine = pushed(made(viscous=2000.0), force)
    x = np.zeros(12000)

    def start(data):
        data.qpos[machine.addresses[0].joint] = 1e-3 * 0.9 * off  # near it, or the swing would lose steps

    off = math.asin(share) / POLES * LEAD / (2 * math.pi)
    run = driven(machine, x, start=start)
    assert run.motor[-1, 0] == pytest.approx(off, rel=1e-4)
    assert run.torque[-1, 0] == pytest.approx(-share * T_HOLD, rel=1e-4)


def test_more_than_its_holding_torque_turns_it_over(made):
    force = 1.03 * T_HOLD * 2 * math.pi / (1e-3 * LEAD)
    run = driven(pushed(made(viscous=2000.0), force), np.zeros(8000))
    assert run.motor[-1, 0] > PERIOD_OF_FIELD


def test_energy_of_a_large_swing_is_kept(made):
    """J w^2 / 2 - T_hold / p cos p (x - f), with the spring and both masses, of ideal currents and without friction.

    The semi-implicit steps keep it to the first order in the step: halved, they halve what is lost.
    """
    machine, per_turn = without_winding(made()), 1e-3 * LEAD / (2 * math.pi)

    def spread(step):
        def start(data):
            data.qpos[machine.addresses[0].joint] = 1e-3 * 0.35 * PERIOD_OF_FIELD

        run = driven(machine, np.zeros(round(0.02 / step)), period=step, start=start)
        speed = 1e-3 * np.gradient(run.motor[:, 0], step)
        load = 1e-3 * np.gradient(run.nozzle[:, 0], step)
        bend = 1e-3 * (run.nozzle - run.motor_tip)[:, 0]
        kinetic = 0.5 * ((ROTOR + SCREW_INERTIA) / per_turn**2 + NUT) * speed**2 + 0.5 * LOAD * load**2
        field = -T_HOLD / POLES * np.cos(2 * math.pi * run.motor[:, 0] / PERIOD_OF_FIELD)
        energy = (kinetic + field + 0.5 * 20e6 * bend**2)[2:-2]
        return np.ptp(energy) / (T_HOLD / POLES)

    coarse, fine = spread(2.5e-5), spread(1.25e-5)
    assert fine < 0.02
    assert fine < 0.6 * coarse


def mean_torque(speed, angle):
    """Mean torque of a rotor at a speed [rad/s], behind the field by an electrical angle, from the circuit's equations.

    L di/dt = v - R i - e of each phase, with the voltage that a fast current loop asks for, within the bus.
    """
    rate, current = POLES * speed, math.sqrt(2) * AMPERE
    fast = 1e-6

    def slope(time, i):
        theta = rate * time
        turned = np.array([0, -math.pi / 2])
        wanted, e = current * np.cos(theta + angle + turned), -K * speed * np.sin(theta + turned)
        rise = -rate * current * np.sin(theta + angle + turned)
        v = np.clip(OHM * i + e + HENRY * (rise + (wanted - i) / fast), -BUS, BUS)
        return (v - OHM * i - e) / HENRY

    turn = 2 * math.pi / rate
    settled = max(4, math.ceil(4 * HENRY / OHM / turn))
    at = np.linspace(settled * turn, (settled + 1) * turn, 400, endpoint=False)
    solved = solve_ivp(slope, (0, at[-1]), [current, 0.0], t_eval=at, method="LSODA", max_step=turn / 60)
    theta = rate * at
    return float((K * (solved.y[1] * np.cos(theta) - solved.y[0] * np.sin(theta))).mean())


@pytest.mark.parametrize("speed", [30.0, 120.0, 250.0])
def test_torque_at_a_speed_is_that_of_the_circuit(made, speed):
    """L/R and the bus take torque away at speed; within 1 % of the holding torque, at every angle of the load."""
    machine, angles = made(), (0.4, 1.5, 2.2)
    motor_speed = speed / LEAD * 2 * math.pi
    expected = [mean_torque(motor_speed, angle) for angle in angles]
    turn = PERIOD_OF_FIELD / speed
    periods = math.ceil(4 * HENRY / OHM / turn) + 4
    ticks = math.ceil(periods * turn / FINE) + 1
    heavy = machine.edited(lambda spec: setattr(spec.joint("x"), "armature", 1e7))
    time = np.arange(ticks + 1) * FINE
    for angle, torque in zip(angles, expected, strict=True):

        def start(data):
            data.qpos[heavy.addresses[0].joint] = 0.0
            data.qvel[heavy.physics.joint("x").dofadr[0]] = 1e-3 * speed

        run = driven(heavy, speed * time + angle / (2 * math.pi) * PERIOD_OF_FIELD + speed * FINE, start=start)
        ahead = (run.commanded - run.motor)[-10:, 0].mean() / PERIOD_OF_FIELD * 2 * math.pi
        assert ahead - 2 * math.pi * speed * FINE / PERIOD_OF_FIELD == pytest.approx(angle, abs=0.01)
        last = round(turn / FINE)
        assert run.torque[-last:, 0].mean() == pytest.approx(torque, abs=0.01 * T_HOLD)


def accelerated(speed, way, ramp_time, rest=0.15):
    """Positions from 0 to a way at a speed, by ramps of a half cosine [mm]."""
    at = np.arange(0, way / speed + ramp_time + rest, 1e-3)
    u = np.clip(at / ramp_time, 0, 1)
    v = np.clip((way / speed + ramp_time - at) / ramp_time, 0, 1)
    rate = speed * 0.25 * (1 - np.cos(math.pi * u)) * (1 - np.cos(math.pi * v))
    return np.append(0.0, np.cumsum(0.5 * (rate[1:] + rate[:-1])) * 1e-3)


def test_it_follows_a_period_late_and_loses_nothing_when_gently_accelerated(made):
    machine = made(viscous=20.0)
    run = driven(machine, accelerated(60.0, 30.0, 0.2), period=1e-3)
    servo = Servo.derive(machine.axes)
    assert lost_steps(machine, servo, run) == ()
    assert np.abs(run.commanded[:-1] - run.motor[1:])[:, 0].max() < 0.15 * PERIOD_OF_FIELD
    np.testing.assert_allclose(run.encoder[1:, 0], run.commanded[:-1, 0], atol=PERIOD_OF_FIELD / 4 / SMOOTH)


@pytest.mark.parametrize("encoder", [0, 4000])
def test_lost_steps_are_multiples_of_four_and_told(made, encoder):
    text = TABLE if not encoder else TABLE.replace(f"voltage = {BUS}\n", f"voltage = {BUS}\nencoder = {encoder}\n")
    machine = made(viscous=300.0, text=text)
    run = driven(machine, accelerated(150.0, 30.0, 0.004, rest=0.3), period=1e-3)
    off = (run.commanded - run.motor)[-1, 0]
    assert abs(off) > 0.5 * PERIOD_OF_FIELD
    assert off / PERIOD_OF_FIELD == pytest.approx(round(off / PERIOD_OF_FIELD), abs=0.01)
    (lost,) = lost_steps(machine, Servo.derive(machine.axes), run)
    assert lost.steps == 4 * round(off / PERIOD_OF_FIELD)
    assert lost.offset == pytest.approx(-off, abs=0.01 * PERIOD_OF_FIELD)
    assert 0 < lost.time < 0.1
    assert f"stepper x lost up to {lost.most} full steps" in str(lost)
    seen = (run.commanded - run.encoder)[-1, 0]  # by what the servo knows
    assert seen == pytest.approx(off if encoder else 0.0, abs=1.01 * 10 / 4000)


def test_it_rests_on_its_microsteps(made):
    machine = made(viscous=300.0, microsteps=4)
    x = np.append(0.0, np.full(600, 0.031))
    rests = round(0.031 / (PERIOD_OF_FIELD / 16)) * PERIOD_OF_FIELD / 16
    assert abs(rests - 0.031) > 0.005
    run = driven(machine, x, period=1e-3)
    assert run.motor[-1, 0] == pytest.approx(rests, abs=1e-4)
    assert run.encoder[-1, 0] == pytest.approx(rests, abs=1e-12)


@pytest.mark.parametrize("delay", [0.0, 2.5e-4, 1e-3])
def test_a_delay_of_the_servo_is_one_of_the_field(made, delay):
    machine, speed = made(viscous=20.0), 10.0
    run = driven(machine, accelerated(speed, 3.0, 0.1), period=1e-3, delay=delay)
    middle = slice(180, 220)
    late = (run.commanded - run.encoder)[middle, 0]
    np.testing.assert_allclose(late, speed * (1e-3 + delay), rtol=1e-3)


def test_a_finer_physics_step_gives_the_same_motion(made):
    """In the limit of small steps: halved, they halve the change."""
    machine, x = made(viscous=50.0), accelerated(60.0, 3.0, 0.02)
    position = np.zeros((x.size, 2))
    position[:, 0] = x
    setpoints = Setpoints(1e-3, machine.axis_names, position, np.zeros(x.size, bool), ramp(50.0).requested)
    servo = Servo.derive(machine.axes)
    motors = [simulate(machine, servo, setpoints, physics_step=5e-5 / 2**k).motor[:, 0] for k in range(3)]
    first, second = (np.abs(b - a).max() for a, b in pairwise(motors))
    assert second < 0.7 * first
    assert first < 0.02 * PERIOD_OF_FIELD


@pytest.mark.parametrize(("name", "more"), suite_runs([("softmc-arc", ()), ("an225", ("turns=1",))], 0))
def test_the_torque_at_the_default_physics_step_is_that_of_a_short_one(name, more):
    """Microsteps come faster than physics steps: sampled there, they shook the rotor, with 10 to 13 % more torque."""
    job = Job.load(name, list(more), machine=str(EXAMPLES / "stepper.toml"))
    axis = job.built_machine.axis_names.index("x")
    torques = [
        simulate(job.built_machine, job.built_servo, job.setpoints, physics_step=step).torque[:, axis]
        for step in (None, 1.25e-5)
    ]
    default, short = (math.sqrt(np.mean(torque**2)) for torque in torques)
    assert default == pytest.approx(short, rel=0.01)


@pytest.mark.parametrize(("low", "high"), [(0.0, 0.0), (0.2, 1.7), (1.7, 0.2), (-3.2, 4.9), (1e5 + 0.3, 1e5 + 0.9)])
def test_the_mean_of_a_field_in_microsteps_is_that_of_its_samples(low, high):
    drive = SimpleNamespace(microstep=0.01)
    field = np.linspace(low, high, 200001)
    expected = 0.01 * np.floor(field + 0.5).mean()
    assert mean_stepped.py_func(0.01 * low, 0.01 * high, drive) == pytest.approx(expected, abs=1e-6)


@pytest.fixture(scope="module")
def spiral():
    return Job.load("an225", machine=str(EXAMPLES / "stepper.toml"))


def test_the_spiral_runs_in_open_loop(spiral):
    machine, servo = spiral.built_machine, spiral.built_servo
    assert servo.modes[machine.axis_names.index("x")] == "stepper"
    run = spiral.run()
    assert run.fault is None
    assert lost_steps(machine, servo, run) == ()
    for a in (a for a, mode in enumerate(servo.modes) if mode == "stepper"):
        behind = np.abs(run.commanded[:-1] - run.motor[1:])[:, a]
        assert 0 < behind.max() < machine.axes[a].electrical_period / 4
    assert Budget(run).values.parts["encoder"].rms > 0


def test_the_budget_has_lost_steps_where_the_servo_sees_them(spiral):
    """Unseen steps lie between step counter and motor; an encoder on the motor shows them as tracking error."""
    weak = {"servo.torque_limit": [0.045, 2.0, 0.5], "servo.following_error_limit": 1e3}
    for seen, link in ((0.0, "encoder"), (0.0025, "servo")):
        job = spiral.changed({**weak, "program.turns": 1, "servo.resolution": [seen, 0.0025, 0.00125]})
        run = job.run()
        (lost,) = lost_steps(job.built_machine, job.built_servo, run)
        assert lost.axis == "x"
        budget = Budget(run)
        told = [note for note in summary(RunResults(job, job.built_machine, budget))["notes"] if "lost" in note]
        assert told == [str(lost)]
        parts = budget.values.parts
        other = {"encoder": "servo", "servo": "encoder"}[link]
        assert parts[link].max > 0.1 > parts[other].max


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"mode": "stepper"}, "mode of axis y = 'stepper': its motor is not a stepper"),
        ({"feedback": ["motor", "none"]}, "feedback = 'none': a drive in mode 'torque' needs it"),
        ({"kp": [1.0, 1.0]}, "kp = 1 in mode 'stepper': must be 0, nothing is fed back"),
        ({"mode": "servo"}, "mode = 'servo': must be one of 'torque', "),
        ({"mode": ["stepper"]}, "mode has 1 values: must be one or 2"),
    ],
)
def test_a_mode_that_makes_no_sense_is_refused_in_one_line(made, given, text):
    with pytest.raises(InputError, match=text) as caught:
        driven(made(), np.zeros(3), **given)
    assert "\n" not in str(caught.value)


def test_an_electrical_fault_of_a_stepper_is_refused(made):
    machine = made()
    setpoints = Setpoints(1e-3, ("x", "y"), np.zeros((5, 2)), np.zeros(5, bool), ramp(50.0).requested)
    with pytest.raises(InputError, match="axis x is a stepper in open loop"):
        simulate(machine, Servo.derive(machine.axes), setpoints, faults=[BusSag(time=0.0, share=0.5, axis="x")])


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ('motor = "maxon-re40-24"\nencoder = 10000', 'motor = "maxon-re40-24"', "encoder is missing, a brushed motor"),
        ("encoder = 10000", "encoder = 10000\nmicrosteps = 8", "microsteps: a brushed motor has none"),
    ],
)
def test_a_table_that_makes_no_sense_is_refused(made, old, new, text):
    assert old in TABLE
    with pytest.raises(InputError, match=text):
        made(text=TABLE.replace(old, new))


def test_a_stepper_in_open_loop_is_not_identified(made):
    machine = made()
    log = Log(("x",), 1e-3, np.zeros((50, 1)), np.zeros((50, 1)), held=True)
    with pytest.raises(InputError, match="axis x is a stepper in open loop, whose torque cannot be logged"):
        identify(machine, log)
