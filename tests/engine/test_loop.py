"""The compiled loop against MuJoCo: the same runs, but for rounding; and MuJoCo where the loop cannot be used."""

import copy
import math
import random
from dataclasses import replace
from itertools import pairwise

import mujoco
import numpy as np
import pytest

from gantrysim import Job, Machine, Servo, simulate, simulate_batch
from gantrysim.base.errors import GantryError, InputError
from gantrysim.engine.linear import agrees, difference_note, linear_machine, linear_with, read_responses
from gantrysim.engine.native.plant import STATE, move
from gantrysim.engine.places import LoopPlaces
from gantrysim.engine.simulation import Simulation
from gantrysim.faults import BusSag
from gantrysim.machine.motors import CURRENT_RATE
from gantrysim.machine.perturbation import Perturbation
from gantrysim.machine.row import IN_MODEL, MAX_AXES, NOT_IN_MODEL
from gantrysim.metrics.budget import Budget
from gantrysim.record.setpoints import Setpoints

from support.random_tables import request, table
from support.runs import PERIOD, ramp
from support.soaked import suite_runs

AGREES = 1e-9  # [mm]
NUDGE = Perturbation(motor_constant=1 + 1e-12)
SLIDING = (
    "an225",
    "an225-3d",
    "fanuc-spiral",
    "linuxcnc-flanges",
    "slicer-square",
    "softmc-arc",
    "softmc-basic",
    "svg-gasket",
    "trio-basic",
)
TURNING = {
    "delta-arc": "machine delta has constraints besides the stops of its axes",
    "fanuc-conical": "the physics step of machine xyzr is not linear, as where a joint turns",
    "stage-outline": "the physics step of machine stage is not linear, as where a joint turns",
}


def engines(job):
    """The job's run by MuJoCo, and by the loop."""
    return [job.run(engine=engine) for engine in ("mujoco", "loop")]


def assert_agree(run, other, counts, nudged=None):
    """Motors and nozzle agree until a count of an encoder flips, and the fault is the same.

    Where a run is unstable within a count, as friction makes it, rounding grows: there it may grow as the difference to
    a run of MuJoCo's does whose motor constants are 1e-12 larger, which `nudged` makes.

    Returns:
        Whether a count has flipped.
    """
    assert (str(run.fault), run.time.shape) == (str(other.fault), other.time.shape)
    flips = np.flatnonzero((np.abs(run.encoder - other.encoder) > 0.5 * counts).any(axis=1) & counts.all())
    before = slice(None, flips[0] + 1 if flips.size else None)
    difference = np.abs(run.motor - other.motor)
    allowed = np.full(len(difference), AGREES)
    if nudged is not None and (difference[before] > AGREES).any():
        grown = np.abs(run.motor - nudged().motor).max(axis=1)
        allowed = np.maximum(AGREES, 10 * np.maximum.accumulate(grown))
    assert (difference.max(axis=1)[before] <= allowed[before]).all()
    assert (np.abs(run.nozzle - other.nozzle).max(axis=1)[before] <= 2 * allowed[before]).all()
    # a count that flips is soon made up for, where the loop is stable
    if difference.max() > max(AGREES, 20 * counts.max()):
        assert nudged is not None
        assert difference.max() < 10 * np.abs(run.motor - nudged().motor).max()
    return bool(flips.size)


def counts_of(servo):
    return np.array([drive.resolution for drive in servo.drives])


@pytest.mark.validates(
    "the compiled loop",
    "MuJoCo: nine built-in jobs; random machines, laws, drives and periods",
    "1e-6 µm, until a count of an encoder flips by rounding",
)
@pytest.mark.parametrize("name", suite_runs(SLIDING, 0, 1, 4, 8))
def test_a_job_on_sliding_joints_runs_as_in_mujoco(name):
    job = Job.load(name)
    assert Simulation.of(job.built_machine, job.built_servo, job.setpoints).hindrance is None
    runs = engines(job)
    assert not np.array_equal(runs[0].motor, runs[1].motor), "nothing was compared"
    nudge = job.built_machine.perturbed(NUDGE)
    flipped = assert_agree(*runs, counts_of(job.built_servo), lambda: job.run(machine=nudge))
    contour, other = (Budget(run).values.contour for run in runs)
    assert other.rms == pytest.approx(contour.rms, rel=1e-3)
    assert other.max == pytest.approx(contour.max, rel=1e-3 if not flipped else 0.05)


@pytest.mark.parametrize("name", TURNING)
def test_a_job_whose_joints_turn_is_mujocos(name):
    job = Job.load(name)
    simulation = Simulation.of(job.built_machine, job.built_servo, job.setpoints)
    assert simulation.hindrance == TURNING[name]
    run, other = engines(job)
    np.testing.assert_array_equal(run.motor, other.motor)
    with pytest.raises(GantryError, match="the compiled loop cannot step this simulation: "):
        LoopPlaces(job.built_machine, 1).load({0: simulation})


def random_servo(machine, choice):
    """A servo with a random law, period and drives, and encoders that count or not, with noise or not."""
    asked = request(choice, machine)
    noise = choice.choice([0.0, 0.0, 2e-4])
    resolution = choice.choice([0.0, 1e-4, 1e-3, 5e-3])
    return Servo.derive(
        machine.axes, **asked, resolution=resolution, encoder_noise=noise, encoder_seed=7, following_error_limit=1e3
    )


def random_motion(machine, servo, choice):
    """Corners at random places, met at random speeds, and rests."""
    speed = min(0.5 * min(axis.speed_limit for axis in machine.axes), 200.0)
    position = [np.zeros(len(machine.axes))]
    for axis, row in zip(machine.axes, position[0][:, None], strict=True):
        row[:] = 0.5 * sum(axis.travel)
    corners = [position[0]]
    for _ in range(choice.randint(3, 6)):
        corners.append(corners[0] + np.array([choice.uniform(-10, 10) for _ in machine.axes]))
    rows = []
    for begin, end in pairwise(corners):
        count = int(np.abs(end - begin).max() / (choice.uniform(0.1, 1.0) * speed * servo.period)) + 2
        rows += [begin + (end - begin) * share for share in np.linspace(0, 1, count)]
        rows += [end] * choice.randint(0, 40)
    rows = np.array(rows)
    return Setpoints(servo.period, machine.axis_names, rows, np.ones(len(rows), bool), ramp(50.0).requested)


def compare_random(seed, tmp_path):
    """Whether the loop could step a random machine, whose run then agreed; None where the request is refused."""
    choice = random.Random(seed)
    file = tmp_path / f"machine{seed}.toml"
    file.write_text(table(choice), encoding="utf-8")
    try:
        machine = Machine(file)
        servo = random_servo(machine, choice)
        setpoints = random_motion(machine, servo, choice)
        simulation = Simulation.of(machine, servo, setpoints)
    except InputError:
        return None
    hindrance = simulation.hindrance
    runs = [simulate(machine, servo, setpoints, engine=engine) for engine in ("mujoco", "loop")]
    if hindrance is not None:
        np.testing.assert_array_equal(runs[0].motor, runs[1].motor)
        return False
    assert_agree(*runs, counts_of(servo), lambda: simulate(machine.perturbed(NUDGE), servo, setpoints))
    return True


@pytest.mark.first
def test_random_machines_run_as_in_mujoco(tmp_path):
    compared = [compare_random(seed, tmp_path) for seed in range(9)]
    assert sum(map(bool, compared)) > 2


@pytest.mark.soak
def test_many_random_machines_run_as_in_mujoco(tmp_path):
    compared = [compare_random(seed, tmp_path) for seed in range(1000, 1800)]
    assert sum(map(bool, compared)) > 200


def test_a_step_that_is_not_linear_is_found_by_the_check(tmp_path):
    """Semi-implicit integration takes the slope of LuGre friction into the speeds: no step of it is linear."""
    plain = Machine("xy")
    spec = mujoco.MjSpec.from_file(str(plain.source))
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    file = tmp_path / "machine.xml"
    file.write_text(spec.to_xml(), encoding="utf-8")
    machine = Machine(file)
    for each, found in ((plain, True), (machine, False)):
        assert (linear_machine(each, each.stepping(PERIOD / 4, stops=False)) is not None) == found


def test_a_spring_that_begins_to_act_away_from_the_middle_is_found_by_the_check(tmp_path):
    text = mujoco.MjSpec.from_file(str(Machine("xy").source)).to_xml()
    spring = '<fixed springlength="-0.01 0.01" stiffness="{}"><joint joint="x" coef="1"/></fixed>'
    for stiffness, found in ((0, True), (1e4, False)):
        file = tmp_path / "machine.xml"
        tendon = f"<tendon>{spring.format(stiffness)}</tendon></mujoco>"
        file.write_text(text.replace("</mujoco>", tendon), encoding="utf-8")
        machine = Machine(file)
        assert (linear_machine(machine, machine.stepping(PERIOD / 4, stops=False)) is not None) == found


@pytest.fixture(scope="module")
def servo(xy):
    return Servo.derive(xy.axes, PERIOD)


def test_a_fault_a_law_of_the_users_own_and_a_law_in_python_are_mujocos(xy, servo):
    def plain(tick):
        return 0.0 * tick.error

    def own(tick, state, torque):
        torque[:] = 0.0

    faulty = Simulation.of(xy, servo, ramp(50.0), faults=[BusSag(time=0.1, share=0.5)])
    assert faulty.hindrance == "a run with deliberate faults is MuJoCo's"
    with_law = Simulation.of(xy, Servo.derive(xy.axes, PERIOD, law=own), ramp(50.0))
    assert with_law.hindrance == "a run with a law of its user's own is MuJoCo's"
    runs = [simulate(xy, servo, ramp(50.0), law=plain, engine=engine) for engine in ("mujoco", "loop")]
    np.testing.assert_array_equal(runs[0].motor, runs[1].motor)


def beside_the_stop(machine):
    """A move at 80 mm/s to 0.002 mm before the end of x's travel, under a servo that overshoots."""
    end = machine.axes[0].travel[1] - 0.002
    x = np.minimum(end - 16.0 + 0.08 * np.arange(300), end)
    position = np.stack([x, np.zeros(300)], axis=1)
    derived = Servo.derive(machine.axes, PERIOD, law=["pid", "friction", "observer"])
    soft = derived.with_values(kd=tuple(0.5 * gain for gain in derived.per_axis("kd")))
    return soft, Setpoints(PERIOD, ("x", "y"), position, np.zeros(300, bool), ramp(50.0).requested)


def test_a_run_that_reaches_a_stop_goes_on_in_mujoco(xy):
    servo, setpoints = beside_the_stop(xy)
    run = simulate(xy, servo, setpoints)
    assert run.motor[:, 0].max() > xy.axes[0].travel[1], "x is to reach its stop"
    assert_agree(run, simulate(xy, servo, setpoints, engine="loop"), counts_of(servo))


def test_places_that_reach_a_stop_leave_the_others_in_the_loop(xy):
    servo, setpoints = beside_the_stop(xy)
    away = replace(setpoints, position=setpoints.position - np.array([30.0, 0.0]))
    places = LoopPlaces(xy, 3, 2)
    places.load({k: Simulation.of(xy, servo, each) for k, each in enumerate((away, setpoints, away))})
    for _ in range(13):
        places.advance(steps=100)
    assert places.field("stops").tolist() == [NOT_IN_MODEL, IN_MODEL, NOT_IN_MODEL]
    for place, each in enumerate((away, setpoints, away)):
        assert_agree(simulate(xy, servo, each), places.runs[place].record(), counts_of(servo))
    # another run at this place is in the loop again
    places.load({1: Simulation.of(xy, servo, away)})
    places.advance([1])
    np.testing.assert_array_equal(places.runs[1].record().motor, places.runs[0].record().motor)


@pytest.mark.parametrize("when", [20, 1100])
def test_a_saved_moment_goes_on_as_it_was(xy, when):
    """Before the stop, and when MuJoCo has taken over."""
    servo, setpoints = beside_the_stop(xy)
    places = LoopPlaces(xy, 2)
    places.load({0: Simulation.of(xy, servo, setpoints)})
    places.advance([0], steps=when)
    moment = places.moment(0)
    places.advance([0])
    places.resume(1, Simulation.of(xy, servo, setpoints), moment)
    places.advance([1])
    # MuJoCo's solver begins with the forces of the step before, which are no part of a state
    np.testing.assert_allclose(places.runs[1].record().motor, places.runs[0].record().motor, rtol=0, atol=AGREES)


def test_a_batch_gives_the_runs_of_single_loops_for_any_number_of_threads(xy):
    servos = [Servo.derive(xy.axes, PERIOD, frequency=frequency) for frequency in (20.0, 25.0, 30.0)]
    machines = [xy, xy.perturbed(Perturbation(payload=0.4)), xy]
    single = [
        simulate(machine, servo, ramp(100.0), engine="loop") for machine, servo in zip(machines, servos, strict=True)
    ]
    for threads in (1, 3):
        batch = simulate_batch(machines, servos, ramp(100.0), threads=threads, engine="loop")
        for run, other in zip(batch, single, strict=True):
            np.testing.assert_array_equal(run.motor, other.motor)
    perturbed = simulate(machines[1], servos[1], ramp(100.0))
    assert_agree(perturbed, single[1], counts_of(servos[1]))
    assert not np.array_equal(single[1].motor, simulate(xy, servos[1], ramp(100.0), engine="loop").motor)


def test_a_servo_that_diverges_trips_as_in_mujoco(xy):
    servo = Servo.derive(xy.axes, PERIOD, frequency=30.0, damping=0.02, following_error_limit=0.5)
    runs = [simulate(xy, servo, ramp(300.0), engine=engine) for engine in ("mujoco", "loop")]
    assert runs[0].fault is not None
    assert (runs[0].fault.kind, runs[0].fault.axis) == (runs[1].fault.kind, runs[1].fault.axis)


@pytest.mark.parametrize(
    ("place", "speed", "force", "is_lost"),
    [
        (0.0, 0.0, 1e9, False),
        (9e9, 0.0, 0.0, False),
        (2e10, 0.0, 0.0, True),
        (-2e10, 0.0, 0.0, True),
        (0.0, 2e10, 0.0, True),
        (0.0, math.nan, 0.0, True),
        (0.0, 0.0, 1e14, True),
        (0.0, 0.0, -1e14, True),
    ],
)
def test_a_state_that_mujoco_would_warn_of_is_lost(xy, place, speed, force, is_lost):
    """Places, speeds and accelerations beyond 1e10 m, m/s and m/s², and none that is no number."""
    plant = linear_machine(xy, xy.stepping(xy.layout.opt.timestep, stops=False)).plant[0]
    state = np.zeros(1, STATE)[0]
    # of the joints that motors drive, and that no spring holds
    driven = plant["dof"][: plant["axes"]]
    state["place"][driven] = place
    state["speed"][driven] = speed
    applied = np.full(MAX_AXES, force)
    assert move(plant, state, np.zeros(MAX_AXES), applied) == is_lost


def test_an_engine_that_does_not_exist_is_refused(xy, servo):
    for make in (simulate, simulate_batch):
        with pytest.raises(InputError, match="engine 'warp': must be mujoco or loop"):
            make(xy, servo, ramp(50.0), engine="warp")


def test_a_note_tells_how_far_the_search_was_from_what_is_shown(xy, servo):
    run = simulate(xy, servo, ramp(100.0))
    near = run.replaced(nozzle=run.nozzle + 0.9e-4)
    far = run.replaced(nozzle=run.nozzle + np.array([0.0, 2.6e-4, 0.0]))
    assert difference_note(run, near) == ""
    assert difference_note(run, far) == (
        "MuJoCo's run, which is shown, is up to 0.3 µm from the compiled loop's, which searched."
    )
    shorter = simulate(xy, servo, ramp(100.0, 70.0))
    assert difference_note(run, shorter) == (
        f"MuJoCo's run, which is shown, has {len(run.time)} servo ticks, the compiled loop's {len(shorter.time)}."
    )


def test_a_job_says_what_makes_its_steps():
    assert not [note for note in Job.load("an225").notes if "engine" in note]
    loop, turning = (Job.load(name, ["simulation.engine=loop"]) for name in ("an225", "stage-outline"))
    assert loop.notes[-1] == 'simulation.engine = "loop": the compiled loop makes the physics steps'
    assert (
        turning.notes[-1] == f'simulation.engine = "loop": MuJoCo makes the physics steps: {TURNING["stage-outline"]}'
    )
    np.testing.assert_array_equal(loop.run().motor, Job.load("an225").run(engine="loop").motor)


def test_a_limit_of_the_current_s_rate_is_that_of_mujoco():
    """No built-in motor has one; with one that acts, steps from random states are MuJoCo's, and without it not."""
    machine = Machine("xy")
    model = copy.copy(machine.stepping(machine.layout.opt.timestep, stops=False))
    model.actuator_dynprm[:, CURRENT_RATE] = 50.0
    data = mujoco.MjData(model)
    linear = linear_with(read_responses(machine, model, data), model)
    assert agrees(machine, model, data, linear)
    linear.plant["rate"] = np.inf
    assert not agrees(machine, model, data, linear)
