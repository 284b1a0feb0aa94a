"""Sources of the viewer: a record, or a simulation that runs and can be pushed."""

import dataclasses

import mujoco
import numpy as np
import pytest

from gantrysim import Machine, simulate
from gantrysim.base.errors import InputError
from gantrysim.engine.simulation import Simulation
from gantrysim.job.job import Job
from gantrysim.machine.machine import builtin_models
from gantrysim.record.setpoints import Setpoints
from gantrysim.render.scene import Scene
from gantrysim.render.view.source import Bodies, Live, Replay

from support.runs import PERIOD, plain, ramp
from support.soaked import suite_runs

DEFLECTION = 1e-6  # relative, of a servo's spring
RETURNED = 1e-3  # of the spring's deflection, that an integral term leaves
MOMENT = 1e-12  # [N·m]

EVER = 1e9  # [s]


def simulation_of(job):
    return Simulation.of(
        job.built_machine,
        job.built_servo,
        job.setpoints,
        physics_step=job.simulation.physics_step,
        dispenser=job.dispenser,
    )


def assert_same(one, other):
    for field in dataclasses.fields(one):
        a, b = getattr(one, field.name), getattr(other, field.name)
        if isinstance(a, np.ndarray):
            assert np.array_equal(a, b, equal_nan=a.dtype.kind == "f"), field.name
    assert (one.period, one.gap, one.axes, str(one.fault)) == (other.period, other.gap, other.axes, str(other.fault))


@pytest.fixture(scope="module")
def held():
    """Setpoints that stand still for two seconds."""
    return Setpoints(PERIOD, ("x", "y"), np.zeros((2001, 2)), np.ones(2001, bool), ramp(50.0).requested)


@pytest.fixture(scope="module")
def gated():
    """A job that waits at gates, and its run."""
    job = Job.load("softmc-helical")
    return job, job.run()


@pytest.mark.parametrize("chunk", [1, 7, 100, 10**6])
def test_live_run_is_the_engines_to_the_last_bit(rigid, chunk):
    machine = rigid()
    servo, setpoints = plain(machine), ramp(100.0)
    live = Live(Simulation.of(machine, servo, setpoints), chunk=chunk, patience=EVER)
    assert len(live.run.time) == 1
    assert not live.over
    for moment in (0.0, 0.0004, 0.1, 0.1234, 0.1, live.until - PERIOD, EVER):
        live.go(moment)
    assert live.over
    assert live.fault is None
    assert live.tick == len(setpoints.position) - 1
    assert_same(live.run, simulate(machine, servo, setpoints))


def test_live_run_waits_at_gates_as_the_engine_does(gated):
    job, run = gated
    live = Live(simulation_of(job), patience=EVER)
    for k in range(1, 200):
        live.go(0.1 * k)
    assert len(run.time) > len(job.setpoints.position), "the job waits at no gate"
    assert live.until < run.time[-1]
    assert live.over
    assert_same(live.run, run)


def test_live_run_so_far_is_the_beginning_of_the_whole(gated):
    job, run = gated
    live = Live(simulation_of(job), patience=EVER)
    for moment in (0.0, 0.001, 0.0015, 0.5, 2.0):
        live.go(moment)
        n = live.tick + 1
        assert live.run.time[-1] == run.time[n - 1] <= moment < run.time[n]
        for name in ("encoder", "nozzle", "demand", "current", "commanded", "dispense"):
            assert np.array_equal(getattr(live.run, name), getattr(run, name)[:n]), name


def test_live_run_restarts(gated):
    job, run = gated
    live = Live(simulation_of(job), patience=EVER)
    live.go(1.0)
    before = live.run
    live.push(np.full_like(live.forces, 10.0))
    live.go(1.5)
    live.restart()
    assert live.tick == 0
    assert not live.forces.any()
    live.go(1.0)
    assert_same(live.run, before)
    live.go(1.5)
    assert np.array_equal(live.run.encoder, run.encoder[: live.tick + 1])


def test_live_run_returns_when_the_patience_is_exhausted(rigid):
    machine = rigid()
    wall = iter(np.arange(100) * 0.01)
    live = Live(Simulation.of(machine, plain(machine), ramp(100.0)), chunk=10, patience=0.025, timer=lambda: next(wall))
    live.go(EVER)
    assert live.tick == 30
    assert not live.over
    live.go(0.031)
    assert live.tick == 31


def test_a_fault_ends_a_live_run(rigid):
    machine = rigid()
    servo, setpoints = plain(machine, following_error_limit=0.02, feedforward=0.0), ramp(100.0)
    live, run = Live(Simulation.of(machine, servo, setpoints), patience=EVER), simulate(machine, servo, setpoints)
    assert run.fault is not None
    live.go(run.fault.time - 2 * PERIOD)
    assert live.fault is None
    assert not live.over
    live.go(EVER)
    assert live.over
    assert live.fault == run.fault
    assert len(live.run.time) == len(run.time)


def test_chunk_of_nothing(rigid):
    machine = rigid()
    with pytest.raises(InputError, match=r"^chunk = 0: must be at least 1$"):
        Live(Simulation.of(machine, plain(machine), ramp(100.0)), chunk=0)


def test_replay_is_at_the_last_tick_before_the_moment(rigid):
    machine = rigid()
    run = simulate(machine, plain(machine), ramp(100.0))
    replay, n = Replay(run), len(run.time)
    assert replay.until == run.time[-1]
    assert replay.tick == 0
    assert replay.run is run
    for moment, tick in ((0.0, 0), (PERIOD, 1), (1.999 * PERIOD, 1), (0.3, 300), (-5.0, 0), (run.time[-1], n - 1)):
        replay.go(moment)
        assert replay.tick == tick
    assert replay.over
    for tick in range(n):
        replay.go(tick * PERIOD)
        assert replay.tick == tick
    replay.go(EVER)
    assert replay.tick == n - 1
    replay.restart()
    assert replay.tick == 0
    assert not replay.over
    replay.push(np.ones((3, 6)))


def test_replay_has_its_fault_at_its_end(rigid):
    machine = rigid()
    run = simulate(machine, plain(machine, following_error_limit=0.02, feedforward=0.0), ramp(100.0))
    replay = Replay(run)
    assert run.fault is not None
    assert replay.fault is None
    replay.go(EVER)
    assert replay.fault is run.fault


@pytest.mark.parametrize(("axis", "body"), [("x", "carriage"), ("y", "carriage"), ("y", "bridge")])
def test_a_push_bends_the_servo_as_its_spring_would(rigid, held, axis, body):
    """F = kp e g: the torque kp e of the motor, times its turns per travel g, holds the force."""
    machine = rigid()
    servo = plain(machine, integral_time=np.inf)
    live = Live(Simulation.of(machine, servo, held), patience=EVER)
    a, force, gear = machine.axis_names.index(axis), -25.0, 2 * np.pi / 0.01
    wrench = np.zeros((machine.physics.nbody, 6))
    wrench[machine.physics.body(body).id, "xy".index(axis)] = force
    live.go(0.5)
    assert not live.run.motor.any()
    live.push(wrench)
    assert np.array_equal(live.forces, wrench)
    live.go(1.5)
    expected = force / (servo.gains[a].kp * gear)
    assert live.run.motor[-1, a] == pytest.approx(expected, rel=DEFLECTION)
    assert live.run.nozzle[-1, "xy".index(axis)] == pytest.approx(expected, rel=DEFLECTION)
    assert live.run.motor[-1, 1 - a] == pytest.approx(0.0, abs=DEFLECTION * abs(expected))
    live.push(np.zeros_like(wrench))
    live.go(EVER)
    assert abs(live.run.motor[-1, a]) < DEFLECTION * abs(expected)


def test_an_integral_term_brings_a_pushed_axis_back(rigid, held):
    machine = rigid()
    servo = plain(machine, integral_time=0.03)
    live = Live(Simulation.of(machine, servo, held), patience=EVER)
    wrench = np.zeros((machine.physics.nbody, 6))
    wrench[machine.physics.body("carriage").id, 0] = 25.0
    spring = 25.0 / (servo.gains[0].kp * 2 * np.pi / 0.01)
    live.push(wrench)
    live.go(EVER)
    assert live.run.motor[:, 0].max() > 0.1 * spring
    assert abs(live.run.motor[-1, 0]) < RETURNED * spring


def test_a_hard_push_trips_the_drive(rigid, held):
    machine = rigid()
    servo = plain(machine, following_error_limit=1.0)
    live = Live(Simulation.of(machine, servo, held), patience=EVER)
    wrench = np.zeros((machine.physics.nbody, 6))
    wrench[machine.physics.body("bridge").id, 1] = 2000.0
    live.push(wrench)
    live.go(EVER)
    assert live.over
    assert live.fault is not None
    assert (live.fault.kind, live.fault.axis) == ("following error", "y")
    assert live.fault.value < -1.0


@pytest.mark.parametrize("name", suite_runs(builtin_models(), 0, 3))
def test_a_push_reaches_the_body_that_was_chosen(name):
    machine = Machine(name)
    job = next(
        job
        for job in map(Job.load, ("an225", "an225-3d", "delta-arc", "softmc-helical", "stage-outline"))
        if job.built_machine.name == name
    )
    shown, stepped = Scene(machine, job.follow(), job.bead).model, machine.stepping(1e-4)
    bodies = Bodies(shown, stepped)
    for body in range(1, shown.nbody):
        wrench = np.zeros((shown.nbody, 6))
        wrench[body] = np.arange(1.0, 7.0)
        handed = bodies.transferred(wrench, np.zeros((shown.nbody, 3)))
        (target,) = np.flatnonzero(handed.any(axis=1))
        assert stepped.body(target).name == shown.body(body).name
        assert np.array_equal(handed[target], wrench[body])


CHAIN = """
<mujoco>
  <worldbody>
    <body name="a"><joint name="j" type="slide"/><geom size="0.1" mass="1"/>
      {between}
      <body name="b" pos="0.5 0 0"><joint name="k" type="slide"/><geom size="0.1" mass="1"/>{tip}</body>
    </body>
    <body name="post"><geom size="0.1"/></body>
  </worldbody>
</mujoco>
"""


def test_a_body_that_is_only_shown_hands_its_force_to_the_one_that_holds_it():
    cover = (
        '<body name="cover" pos="0 0.2 0"><geom size="0.1" mass="1"/><body><geom size="0.1" mass="1"/></body></body>'
    )
    shown = mujoco.MjModel.from_xml_string(CHAIN.format(between=cover, tip=""))
    stepped = mujoco.MjModel.from_xml_string(CHAIN.format(between="", tip=""))
    bodies = Bodies(shown, stepped)
    rng = np.random.default_rng(1)
    wrench, centre = rng.normal(size=(shown.nbody, 6)), rng.normal(size=(shown.nbody, 3))
    handed = bodies.transferred(wrench, centre)
    # force, and moment about the world's origin, are those of all that hangs on each body
    for name, parts in (("a", (1, 2, 3)), ("b", (4,)), ("post", (5,))):
        target, own = stepped.body(name).id, shown.body(name).id
        moment = sum(wrench[k, 3:] + np.cross(centre[k], wrench[k, :3]) for k in parts)
        assert handed[target, :3] == pytest.approx(sum(wrench[k, :3] for k in parts))
        assert handed[target, 3:] + np.cross(centre[own], handed[target, :3]) == pytest.approx(moment, abs=MOMENT)
    assert not handed[0].any()
    assert not bodies.transferred(np.eye(shown.nbody, 6)[:1].repeat(shown.nbody, 0) * 0, centre).any()


def test_bodies_without_names_are_known_by_their_numbers():
    text = CHAIN.format(between="", tip="<body><joint/><geom size='0.1' mass='1'/></body>")
    shown = stepped = mujoco.MjModel.from_xml_string(text)
    wrench = np.zeros((shown.nbody, 6))
    wrench[3] = 1.0
    assert np.array_equal(Bodies(shown, stepped).transferred(wrench, np.zeros((shown.nbody, 3))), wrench)


def test_models_of_different_machines():
    shown = mujoco.MjModel.from_xml_string("<mujoco><worldbody><body name='q'/></worldbody></mujoco>")
    stepped = mujoco.MjModel.from_xml_string("<mujoco><worldbody><body name='r'/></worldbody></mujoco>")
    with pytest.raises(InputError, match=r"^the displayed model has no body of the simulated one$"):
        Bodies(shown, stepped)
