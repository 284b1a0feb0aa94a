"""Many simulations in one call: each the same to the last bit as alone, whatever the number of threads."""

import dataclasses
import math

import mujoco
import numpy as np
import pytest

from gantrysim import Dispenser, InputError, Job, Machine, Servo, simulate, simulate_batch
from gantrysim.base.errors import GantryError
from gantrysim.engine.advance import CALLS
from gantrysim.engine.places import MuJoCoPlaces
from gantrysim.engine.simulation import Simulation
from gantrysim.machine.perturbation import Perturbation
from gantrysim.paths.path import Path

from support.runs import STEP, ramp

SLOW, FAST, FASTER = 50.0, 80.0, 120.0  # [mm/s]


def same(one, other):
    """Whether two records are equal to the last bit."""
    for field in dataclasses.fields(one):
        if field.name in ("job", "rig"):  # a batch has no job, and a rig of its own
            continue
        a, b = getattr(one, field.name), getattr(other, field.name)
        if isinstance(a, np.ndarray):
            if not np.array_equal(a, b, equal_nan=a.dtype.kind == "f"):
                return False
        elif isinstance(a, Path):
            if repr(a.parameters()) != repr(b.parameters()):
                return False
        elif a != b:
            return False
    return True


@pytest.fixture(scope="module")
def servo(xy):
    return Servo.derive(xy.axes, 1e-3, integral_time=0.03)


@pytest.fixture(scope="module")
def various(xy, servo):
    """Machines, servos and setpoints that all differ, one of them with a fault, and the records one at a time."""
    machines = [
        xy,
        xy.perturbed(Perturbation(payload=0.4, friction=1.3)),
        xy,
        xy.perturbed(Perturbation(stiffness=0.7)),
    ]
    unstable = servo.with_values(kp=tuple(40 * kp for kp in servo.per_axis("kp")))
    servos = [servo, servo, unstable, servo.with_values(delay=5e-4)]
    setpoints = [ramp(SLOW), ramp(FAST), ramp(FASTER), ramp(FAST, 60.0)]
    alone = [simulate(*one) for one in zip(machines, servos, setpoints, strict=True)]
    assert [run.fault is None for run in alone] == [True, True, False, True]
    return machines, servos, setpoints, alone


@pytest.mark.validates(
    "a batch on any number of threads",
    "one run at a time",
    "every bit",
)
@pytest.mark.parametrize("threads", [1, 2, 3, 7])
def test_a_batch_is_the_same_to_the_last_bit_as_one_at_a_time(various, threads):
    *each, alone = various
    together = simulate_batch(*each, threads=threads)
    assert len(together) == len(alone)
    assert all(same(a, b) for a, b in zip(together, alone, strict=True))


def test_the_comparison_sees_the_last_bit(various):
    run = various[-1][0]
    nozzle = run.nozzle.copy()
    nozzle[100, 0] = np.nextafter(nozzle[100, 0], 1e3)
    assert same(run, dataclasses.replace(run))
    assert not same(run, dataclasses.replace(run, nozzle=nozzle))


@pytest.mark.parametrize("share", [0.3, 1.5, 2.5, 20.5])  # of the calls that a batch is stepped in
def test_a_fault_in_any_call_ends_no_other_simulation(xy, servo, share):
    length = 140.0
    none = dict.fromkeys(("kp", "ki", "kd", "velocity_ff", "acceleration_ff"), (0.0, 0.0))
    still = servo.with_values(**none, following_error_limit=(length * share / CALLS, 10.0))
    faulty, whole = simulate_batch(xy, [still, servo], ramp(SLOW, length))
    assert faulty.fault.kind == "following error"
    assert whole.fault is None
    assert len(whole.time) == len(ramp(SLOW, length).position)


def test_jobs_of_different_machines_run_in_one_batch():
    jobs = [Job.load(name) for name in ("stage-outline", "softmc-arc", "softmc-helical", "fanuc-conical", "softmc-arc")]
    together = simulate_batch(
        [job.built_machine for job in jobs],
        [job.built_servo for job in jobs],
        [job.setpoints for job in jobs],
        dispenser=[job.dispenser for job in jobs],
    )
    assert len({run.machine for run in together}) > 2
    assert any(job.setpoints.gates.size for job in jobs), "one of them waits at gates"
    for job, run in zip(jobs, together, strict=True):
        assert same(run, job.run())


def test_an_argument_is_one_for_all_or_one_for_each(xy, servo):
    setpoints = ramp(FAST, 40.0)
    a, b = simulate_batch(xy, servo, setpoints, physics_step=[None, STEP / 2], dispenser=Dispenser(flow=10.0))
    assert same(a, simulate(xy, servo, setpoints, dispenser=Dispenser(flow=10.0)))
    assert same(b, simulate(xy, servo, setpoints, physics_step=STEP / 2, dispenser=Dispenser(flow=10.0)))
    assert not np.array_equal(a.nozzle, b.nozzle)
    (only,) = simulate_batch(xy, servo, setpoints)
    assert same(only, simulate(xy, servo, setpoints))


def test_a_warning_of_mujoco_in_one_simulation_stops_no_other(xy, servo):
    servo = servo.with_values(following_error_limit=(math.inf, math.inf))
    wild = xy.perturbed(Perturbation())
    wild.physics.jnt_limited[:] = 0
    wild.physics.opt.gravity[0] = 1e13  # an acceleration that MuJoCo calls bad
    wild.plain_axes = tuple(
        dataclasses.replace(a, travel=(-math.inf, math.inf), declared_speed=math.inf) for a in xy.plain_axes
    )
    machines = [wild, xy, wild, xy, xy, wild]
    setpoints = ramp(FAST, 40.0)
    together = simulate_batch(machines, servo, setpoints, threads=1)
    assert simulate(wild, servo, setpoints).fault.kind == "diverged"
    for machine, run in zip(machines, together, strict=True):
        assert same(run, simulate(machine, servo, setpoints))


def test_progress_goes_from_nothing_to_all(xy, servo):
    shares = []
    simulate_batch([xy, xy], servo, [ramp(SLOW, 60.0), ramp(FAST, 60.0)], progress=shares.append)
    assert len(shares) > 10
    assert shares == sorted(shares)
    assert shares[0] > 0
    assert shares[-1] == 1


def test_progress_never_falls_from_one_machine_s_file_to_the_next(xy, xyz):
    servos = [Servo.derive(machine.axes) for machine in (xy, xyz)]
    shares = []
    simulate_batch([xy, xyz], servos, ramp(SLOW, 60.0), progress=shares.append)
    assert shares == sorted(shares)
    assert 0 < shares[0] < 0.5 < shares[-2] < shares[-1] == 1


def test_an_interrupt_ends_a_batch(xy, servo):
    def interrupt(share):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate_batch([xy, xy], servo, ramp(SLOW, 60.0), progress=interrupt)
    assert mujoco.get_mjcb_control() is None


@pytest.mark.parametrize(
    ("counts", "said"),
    [
        ((2, 3), "a batch of 2 of machine, 3 of servo: must be one for all, or as many of each"),
        ((0, 0), "a batch of no simulation: must have at least one"),
    ],
)
def test_a_batch_whose_parts_do_not_fit_is_refused(xy, servo, counts, said):
    with pytest.raises(InputError) as refused:
        simulate_batch([xy] * counts[0], [servo] * counts[1], ramp(FAST))
    assert str(refused.value) == said


ONE = ", or a list, a tuple or an array of them"
WRITE_MACHINE = "write gantrysim.Machine('xy')"
WRITE_SERVO = "write gantrysim.Servo.derive(machine.axes)"
SETPOINTS = "must be Setpoints or a controller with its program"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"physics_step": "1e-4"}, f"physics_step is of type str: must be a number or None{ONE}"),
        ({"physics_step": b"12"}, f"physics_step is of type bytes: must be a number or None{ONE}"),
        ({"physics_step": True}, f"physics_step is of type bool: must be a number or None{ONE}"),
        ({"physics_step": {0: 1e-4}}, f"physics_step is of type dict: must be a number or None{ONE}"),
        ({"physics_step": {1e-4}}, f"physics_step is of type set: must be a number or None{ONE}"),
        ({"physics_step": range(2)}, f"physics_step is of type range: must be a number or None{ONE}"),
        ({"physics_step": ["1e-4"]}, "physics_step[0] is of type str: must be a number or None"),
        ({"physics_step": [None, [1e-4]]}, "physics_step[1] is of type list: must be a number or None"),
        ({"physics_step": np.ones((2, 2))}, "physics_step[0] is of type ndarray: must be a number or None"),
        ({"machine": "xy"}, f"machine is of type str: must be a Machine{ONE}; {WRITE_MACHINE}"),
        ({"machine": (m for m in "xy")}, f"machine is of type generator: must be a Machine{ONE}"),
        ({"machine": ["xy"]}, f"machine[0] is of type str: must be a Machine; {WRITE_MACHINE}"),
        ({"servo": {}}, f"servo is of type dict: must be a Servo{ONE}; {WRITE_SERVO}"),
        ({"servo": [None]}, f"servo[0] is of type NoneType: must be a Servo; {WRITE_SERVO}"),
        ({"setpoints": map(ramp, [50.0])}, f"setpoints is of type map: {SETPOINTS}{ONE}"),
        ({"setpoints": np.zeros((3, 2))}, f"setpoints[0] is of type ndarray: {SETPOINTS}"),
        ({"dispenser": "none"}, f"dispenser is of type str: must be a Dispenser or None{ONE}"),
    ],
)
def test_an_argument_that_is_neither_one_nor_a_list_is_refused_by_name(xy, servo, given, said):
    with pytest.raises(InputError) as refused:
        simulate_batch(**{"machine": xy, "servo": servo, "setpoints": ramp(FAST), **given})
    assert str(refused.value) == said


@pytest.mark.parametrize("several", [list, tuple, lambda values: np.array(values, object)])
def test_lists_tuples_and_arrays_are_the_same(xy, servo, several):
    steps, short = [STEP, STEP / 2], ramp(FAST, 5.0)
    expected = simulate_batch(xy, servo, short, physics_step=steps)
    machines, servos, setpoints = several([xy, xy]), several([servo, servo]), several([short, short])
    found = simulate_batch(machines, servos, setpoints, physics_step=several(steps), dispenser=several([None, None]))
    numbers = simulate_batch(xy, servo, short, physics_step=np.array(steps))
    for one, other, third in zip(expected, found, numbers, strict=True):
        assert same(one, other)
        assert same(one, third)
    assert not same(*expected)


def test_invalid_input_of_one_simulation_is_refused_with_its_number(xy, servo):
    with pytest.raises(InputError) as refused:
        simulate_batch(xy, servo, [ramp(FAST), ramp(9000.0)])
    assert str(refused.value).startswith("simulation 1 of the batch: speed of x = ")
    with pytest.raises(InputError, match=r"threads = 0: must be at least 1"):
        simulate_batch(xy, servo, ramp(FAST), threads=0)


def test_a_batch_takes_one_layout_of_machine(xy, xyz, servo):
    batch = MuJoCoPlaces(xy, 2)
    other = Simulation.of(xyz, Servo.derive(xyz.axes, 1e-3), ramp(FAST))
    with pytest.raises(GantryError, match="cannot take a simulation of"):
        batch.load({0: other})


def test_a_place_can_be_reused(xy, servo):
    batch = MuJoCoPlaces(xy, 3, 1)
    long, short = (lambda: Simulation.of(xy, servo, ramp(SLOW))), (lambda: Simulation.of(xy, servo, ramp(FAST, 40.0)))
    batch.load({place: long() for place in range(3)})
    batch.advance(steps=1501)
    batch.load({1: short()})
    while not all(run.done for run in batch.runs.values()):
        batch.advance(steps=777)
    assert same(batch.runs[1].record(), simulate(xy, servo, ramp(FAST, 40.0)))
    assert same(batch.runs[0].record(), simulate(xy, servo, ramp(SLOW)))


def test_a_place_alone_can_be_stepped(xy, servo):
    batch = MuJoCoPlaces(xy, 2, 1)
    batch.load({place: Simulation.of(xy, servo, ramp(FAST, 40.0)) for place in range(2)})
    batch.advance([1], steps=400)
    assert [batch.runs[place].ticks for place in range(2)] == [0, 100]
    with pytest.raises(GantryError, match="ran for 100 of 501 ticks"):
        batch.runs[1].record()
    partial = batch.runs[1].record(partial=True)
    assert np.array_equal(partial.nozzle, simulate(xy, servo, ramp(FAST, 40.0)).nozzle[:100])


def test_machines_read_twice_from_one_file_share_a_batch(servo):
    setpoints = ramp(FAST, 40.0)
    machines = [Machine("xy"), Machine("xy")]
    assert all(
        same(run, simulate(Machine("xy"), servo, setpoints)) for run in simulate_batch(machines, servo, setpoints)
    )


def test_what_runs_beside_begins_when_the_simulations_are_about_to_step(xy, servo):
    batch = MuJoCoPlaces(xy, 2)
    batch.load({place: Simulation.of(xy, servo, ramp(SLOW)) for place in range(2)})
    steps = []
    batch.beside = lambda: steps.append([run.steps for run in batch.runs.values()])
    for _ in range(3):
        batch.advance(steps=40)
    assert steps == [[0, 0], [40, 40], [80, 80]]
    assert [run.steps for run in batch.runs.values()] == [120, 120]
