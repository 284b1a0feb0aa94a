"""Errors of a machine's geometry against closed forms, and the link of the budget that they have."""

import math
import tomllib
from dataclasses import replace
from functools import cache
from itertools import pairwise

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import Job, Machine, simulate
from gantrysim.base import memory
from gantrysim.base.errors import InputError
from gantrysim.machine.geometry import SCREWS, Geometry, typical
from gantrysim.machine.kinematic_errors import PRESLIDING
from gantrysim.machine.perturbation import Perturbation
from gantrysim.machine.tolerances import Tolerances
from gantrysim.metrics.budget import GEOMETRY, Budget
from gantrysim.record.run import Run

from support.runs import PERIOD, plain, ramp
from support.soaked import examples

EXACT = 1e-12  # of a displacement [mm]
SUM = 1e-12  # of the links against the whole [mm]
SECOND_ORDER = 1e-5  # of the structure, as the foot moves on the path [mm]

LEAD = 10.0  # of the screws of xy [mm]
HALF = 150.0  # travel of x and y to either side [mm]
CIRCLE = np.linspace(0, 2 * np.pi, 721)


@cache
def machine_xy():
    return Machine("xy")


@pytest.fixture(scope="module")
def xy():
    return machine_xy()


@pytest.fixture(scope="module")
def xyz():
    return Machine("xyz")


def shift(machine, motor, geometry, *, blocks=1, factors=(), scales=False):
    """Displacement of the nozzle at positions of the motors, (n, 3)."""
    motor = np.array(motor, float)
    real = machine.with_geometry(geometry)
    if factors:
        real = real.perturbed(Perturbation(geometry=tuple(factors)))
    tips = list(real.kinematic_errors.tips(np.array_split(motor, blocks), scales))
    return np.concatenate(tips) - machine.tip(motor)


def columns(*values):
    return np.stack(np.broadcast_arrays(*values), axis=1)


def test_the_periodic_error_is_a_sine_of_the_screws_angle(xy):
    x = np.linspace(-37, 61, 999)
    found = shift(xy, columns(x, 0.0), Geometry(periodic_error=(0.004, 0.0)))
    assert found == pytest.approx(columns(0.004 * np.sin(2 * np.pi * x / LEAD), 0.0, 0.0), abs=EXACT)


def test_the_travel_error_grows_over_300_mm(xy):
    found = shift(xy, [[-HALF, 0], [HALF, 0], [0, HALF]], Geometry(travel_error=0.052))
    assert found[1, 0] - found[0, 0] == pytest.approx(0.052, abs=EXACT)
    assert found[2] == pytest.approx([0, 0.026, 0], abs=EXACT)


def test_a_warm_screw_grows_from_its_fixed_end(xy):
    motor = [[120.0, -20.0], [-150.0, 150.0]]
    found = shift(xy, motor, Geometry(warming=8, expansion=1.2e-5, fixed_end=(-150.0, 0.0)))
    assert found == pytest.approx(1.2e-5 * 8 * np.array([[270, -20, 0], [0, 150, 0]]), abs=EXACT)


@given(b=st.floats(1e-4, 0.5), turns=st.lists(st.floats(-40, 40), min_size=2, max_size=8), blocks=st.integers(1, 9))
@examples(60)
def test_play_is_lost_at_each_reversal_and_no_more(b, turns, blocks):
    xy = machine_xy()
    x = np.concatenate([np.linspace(a, c, 50) for a, c in zip([0.0, *turns], turns, strict=False)])
    lag = shift(xy, columns(x, 0.0), Geometry(play=(b, 0.0)), blocks=blocks)[:, 0]
    assert lag.min() >= -EXACT
    assert lag.max() <= b + EXACT
    load = x + lag
    # the load moves by the motor's motion or rests, and only on the flank that pushes it
    pushed = (lag[1:] < EXACT) | (lag[1:] > b - EXACT)
    assert np.diff(load)[~pushed] == pytest.approx(0, abs=1e-9)
    assert np.all(np.diff(load) * np.diff(x) >= -1e-9)
    # independently: after a motion of at least b the load is on the flank of its direction
    for k in range(1, len(turns)):
        if abs(turns[k] - turns[k - 1]) > b:
            assert lag[50 * (k + 1) - 1] == pytest.approx(b if turns[k] < turns[k - 1] else 0.0, abs=1e-9)


def test_a_position_is_reached_from_below_and_above_at_a_distance_of_the_play(xy):
    x = np.concatenate([np.linspace(0, 30, 31), np.linspace(29, 0, 30)])
    found = shift(xy, columns(x, -x), Geometry(play=(0.016, 0.007)))
    assert found[50] - found[10] == pytest.approx([0.016, -0.007, 0], abs=EXACT)  # at x = 10


@pytest.mark.parametrize(("radius", "lean"), [(40.0, 0.1), (100.0, -0.35)])  # mm, mm/m
def test_a_circle_of_axes_out_of_square_is_an_ellipse_at_45_degrees(xy, radius, lean):
    circle = radius * columns(np.cos(CIRCLE), np.sin(CIRCLE))
    nozzle = circle + shift(xy, circle, Geometry(squareness_xy=lean))[:, :2]
    deviation = np.linalg.norm(nozzle, axis=1) - radius
    a = 1e-3 * lean
    assert deviation == pytest.approx(0.5 * radius * a * np.sin(2 * CIRCLE), abs=radius * a**2)
    assert abs(deviation).max() == pytest.approx(0.5 * radius * abs(a), rel=2 * abs(a))
    axes = nozzle[[0, 180]]  # of the machine: the angle between them is smaller by the lean
    assert math.acos(axes[0] @ axes[1] / radius**2) == pytest.approx(math.pi / 2 - a, abs=2 * abs(a) ** 2)


def test_z_leans_towards_x_and_y(xyz):
    found = shift(xyz, [[0, 0, 50.0]], Geometry(squareness_xz=0.2, squareness_yz=-0.3))
    assert found == pytest.approx(np.array([[0.01, -0.015, 0]]), abs=EXACT)


def test_a_guide_deviates_by_its_straightness_from_the_line_between_its_ends(xyz):
    q = np.linspace(-1, 1, 201)
    found = shift(xyz, columns(HALF * q, 0.0, 0.0), Geometry(straightness=0.008, straightness_vertical=(0.005, 0, 0)))
    for i, size in ((1, 0.008), (2, 0.005)):
        line = found[0, i] + (found[-1, i] - found[0, i]) * (q + 1) / 2
        assert np.ptp(found[:, i] - line) == pytest.approx(size, abs=EXACT)
    assert found[:, 0] == pytest.approx(0, abs=EXACT)
    low, high = xyz.axes[2].travel
    z = np.linspace(low, high, 201)
    bow = shift(xyz, columns(0.0, 0.0, z), Geometry(straightness_vertical=(0, 0, 0.003)))[:, 1]
    line = bow[0] + (bow[-1] - bow[0]) * (z - low) / (high - low)
    assert np.ptp(bow - line) == pytest.approx(0.003, abs=EXACT)
    assert shift(xyz, [[0, 0, 0]], Geometry(accuracy="C7")) == pytest.approx(np.zeros((1, 3)), abs=EXACT)


def test_yaw_of_the_bridge_has_the_carriage_for_its_arm(xy):
    # rotation of 0.1 mm/m at the end of y, over 0.12 m of x and 0.05 m of Abbe offset, and 0.125 m behind the nozzle
    geometry = Geometry(yaw=(0.0, 0.1), abbe=(0.0, 50.0))
    assert shift(xy, [[120.0, HALF]], geometry) == pytest.approx(np.array([[0.0125, 0.017, 0]]), abs=EXACT)
    assert shift(xy, [[120.0, -HALF / 2]], geometry) == pytest.approx(np.array([[-0.00625, -0.0085, 0]]), abs=EXACT)
    # the carriage does not carry the bridge: its arm is the Abbe offset alone
    geometry = Geometry(yaw=(0.1, 0.0), abbe=(-87.0, 0.0))
    assert shift(xy, [[HALF, 140.0]], geometry) == pytest.approx(np.array([[0.0087, 0, 0]]), abs=EXACT)


def test_the_bridge_racks_at_a_reversal(xy):
    y = np.concatenate([np.linspace(0, 10, 101), np.linspace(10, 5, 5001)])
    found = shift(xy, columns(100.0, y), Geometry(racking=0.2))[:, 1]
    assert found[:101] == pytest.approx(0, abs=EXACT)
    back = 10 - y[101:]
    assert found[101:] == pytest.approx(0.02 * np.minimum(back / PRESLIDING, 1), abs=1e-9)


@pytest.mark.validates(
    "sag of the bridge",
    "beam on two supports",
    "1e-12 mm",
)
def test_the_bridge_sags_as_a_beam_on_two_supports(xy):
    x = np.linspace(-HALF, HALF, 301)
    found = shift(xy, columns(x, 30.0), Geometry(sag=0.012))[:, 2]
    a, length = x + HALF, 2 * HALF
    beam = a**2 * (length - a) ** 2 / (length / 2) ** 4  # deflection under a load at a, 1 at the middle
    assert found == pytest.approx(-0.012 * (beam - beam[150]), abs=EXACT)
    assert found[0] == pytest.approx(0.012, abs=EXACT)


@pytest.mark.parametrize("load", ["weight", "force"])
def test_the_ram_bends_as_a_cantilever_out_of_its_guide(xyz, load):
    # a steel tube of 30 mm and 2 mm wall under 4 N at its end, or under 3 kg whose centre is 40 mm beside it
    stiffness = 210e9 * np.pi / 64 * (0.030**4 - 0.026**4)  # E I [N·m²]
    low, high = xyz.axes[2].travel
    z = np.linspace(low, high, 31)
    free = 80.0 + (high - z)  # ram out of its guide [mm]

    def tip(length):  # deflection at the end by integrating the curvature twice [mm]
        s = np.linspace(0, 1e-3 * length, 4001)
        moment = 3 * 9.81 * 0.04 + 0 * s if load == "weight" else 4.0 * (s[-1] - s)
        step = s[1] - s[0]
        slope = np.concatenate([[0], np.cumsum(0.5 * (moment[1:] + moment[:-1]))]) * step / stiffness
        return 1e3 * step * np.sum(0.5 * (slope[1:] + slope[:-1]))

    bends = np.array([tip(length) for length in free])
    geometry = Geometry(bending_x=bends[0], bending_y=-0.5 * bends[0], bending_load=load, ram=80.0)
    found = shift(xyz, columns(7.0, -9.0, z), geometry)
    expected = bends - tip(80.0 + high)
    assert found == pytest.approx(columns(expected, -0.5 * expected, 0.0), abs=1e-6 * bends[0])
    assert np.ptp(expected) > 1e-4
    assert shift(xyz, [[50, 20, 0]], geometry) == pytest.approx(np.zeros((1, 3)), abs=EXACT)


def test_a_class_bends_a_ram_and_nothing_without_one(xy, xyz):
    found = xyz.with_geometry(Geometry(accuracy="C7")).kinematic_errors.values
    assert (found["bending_x"], found["bending_y"]) == (0.012, 0.012)
    assert not {"bending_x", "bending_y"} & set(xy.with_geometry(Geometry(accuracy="C7")).kinematic_errors.columns)
    job = Job.load("an225-3d", ["accuracy=C5", "geometry.bending_x=0.02", "geometry.bending_load=force"])
    assert Job(**tomllib.loads(job.toml())).geometry == job.geometry
    real = job.built_machine
    drawn = Tolerances().machines(real, 8, 1)
    factors = [dict(one.geometry)["bending_x"] for one in drawn]
    assert -1 <= min(factors) < 0 < max(factors) <= 1
    assert real.perturbed(drawn[3]).kinematic_errors.values["bending_x"] == pytest.approx(0.02 * factors[3])


def test_a_scale_on_the_load_takes_the_screw_out_and_grows_itself(xy):
    motor = [[0.0, 0.0], [120.0, -20.0], [100.0, 30.0]]
    screw = {"travel_error": 0.05, "periodic_error": 0.006, "play": 0.02, "warming": 5.0}
    geometry = Geometry(**screw, squareness_xy=0.1, scale_warming=3.0, scale_expansion=8e-6, scale_fixed=(-150.0, 0.0))
    both = shift(xy, motor, geometry, scales=True)
    own = 8e-6 * 3 * (np.array(motor) - [-150.0, 0.0])
    lean = 1e-4 * np.array(motor)[:, 1:]  # guides and frame stay
    assert both == pytest.approx(np.hstack([own[:, :1] + lean, own[:, 1:], 0 * lean]), abs=EXACT)
    one = shift(xy, motor, geometry, scales=[True, False])
    assert one[:, 0] == pytest.approx(both[:, 0], abs=EXACT)
    assert one[:, 1] == pytest.approx(shift(xy, motor, geometry)[:, 1], abs=EXACT)
    assert abs(one[:, 1] - both[:, 1]).max() > 0.01


def test_a_run_with_its_encoders_on_the_load_shows_the_scales_growth():
    small = ["turns=1", "diameter=40"]
    warm = ["geometry.warming=20", "geometry.scale_warming=10", "geometry.scale_fixed=100"]
    load = Job.load("an225", [*small, *warm, "servo.feedback=load"]).run()
    expected = 8e-6 * 10 * (load.motor - 100.0)
    assert (load.geometric_tip - load.motor_tip)[:, :2] == pytest.approx(expected, abs=EXACT)
    on_motor = Job.load("an225", [*small, *warm]).run()
    expected = 11.5e-6 * 20 * on_motor.motor
    assert (on_motor.geometric_tip - on_motor.motor_tip)[:, :2] == pytest.approx(expected, abs=EXACT)


def test_an_axis_without_a_limited_travel_has_no_bow_but_all_else(xy):
    def unlimit(spec):
        spec.joint("y").limited = mujoco.mjtLimited.mjLIMITED_FALSE

    endless = xy.edited(unlimit)
    geometry = Geometry(travel_error=0.03, squareness_xy=0.1, straightness=(0.01, 0.0), sag=0.01, yaw=(0.1, 0.0))
    motor = [[50.0, 700.0], [-150.0, -700.0]]
    found = shift(endless, motor, geometry)
    assert found[:, 1] == pytest.approx([0.07 + 0.01 / 9, -0.07 + 0.01], abs=EXACT)
    assert found[:, 0] == pytest.approx([0.005 + 0.07, -0.015 - 0.07], abs=EXACT)
    for error in ({"straightness": 0.01}, {"yaw": 0.1}):
        with pytest.raises(InputError, match="axis y of machine xy has no limited travel"):
            endless.with_geometry(Geometry(**error))


def test_a_class_gives_what_is_not_given():
    geometry = Geometry(accuracy="C7", play=0.0)
    assert geometry.of("play") == 0
    assert geometry.of("travel_error") == pytest.approx(0.05)
    assert Geometry(accuracy="T7").of("travel_error") == pytest.approx(0.052)
    assert Geometry(accuracy="P3").of("periodic_error") == pytest.approx(0.003)
    for kind in "CPT":  # a coarser grade has no smaller error
        every = [typical(name) for name in sorted((n for n in SCREWS if n[0] == kind), key=lambda n: int(n[1:]))]
        assert all(one[name] <= other[name] for one, other in pairwise(every) for name in one)


sizes = st.floats(-0.5, 0.5)


@given(
    motor=st.lists(st.tuples(*[st.floats(-HALF, HALF)] * 2), min_size=1, max_size=20),
    error=st.builds(
        Geometry, travel_error=sizes, straightness=sizes, yaw=sizes, squareness_xy=sizes, sag=sizes, warming=sizes,
        play=st.floats(0, 0.5), periodic_error=st.floats(0, 0.5), racking=st.floats(0, 0.5),
    ),
)  # fmt: skip
@examples(20)
def test_errors_of_size_zero_change_no_bit_and_half_of_them_is_half(motor, error):
    xy, motor = machine_xy(), np.array(motor)
    names = [*xy.with_geometry(error).kinematic_errors.columns, "warming"]
    none = xy.with_geometry(error).perturbed(Perturbation(geometry=tuple((name, 0.0) for name in names)))
    assert np.array_equal(next(none.kinematic_errors.tips([motor])), xy.tip(motor))
    linear = replace(error, play=0.0, racking=0.0)
    half = shift(xy, motor, linear, factors=[(name, 0.5) for name in names])
    assert half == pytest.approx(0.5 * shift(xy, motor, linear), abs=1e-9)


def test_a_job_keeps_its_table_and_shares_no_machine_of_another_geometry():
    plain_job = Job.load("an225")
    job = Job.load("an225", ["accuracy=C7", "geometry.play=[0.01, 0.02]"])
    again = Job(**tomllib.loads(job.toml()))
    assert again.geometry == job.geometry == Geometry(accuracy="C7", play=(0.01, 0.02))
    assert again.digest == job.digest != plain_job.digest
    assert "geometry" not in plain_job.toml()
    assert plain_job.built_machine.geometry is None
    assert job.sharing(plain_job).built_machine.kinematic_errors.values["play_y"] == 0.02
    assert plain_job.sharing(job).built_machine.geometry is None
    same = job.changed({"program.speed": 50.0}).sharing(job)
    assert same.built_machine is job.built_machine


@pytest.fixture(scope="module")
def runs():
    """A job's run on the ideal machine, with a geometry of no errors, and with those of a class."""
    jobs = [Job.load("an225", [*more, "turns=1", "diameter=40"]) for more in ([], ["play=0"], ["accuracy=C7"])]
    return [job.run() for job in jobs]


def test_without_a_table_a_run_has_no_such_link_and_zero_changes_no_bit(runs):
    plain_run, zero, _ = runs
    assert plain_run.geometric_tip is None
    assert GEOMETRY not in Budget(plain_run).parts
    assert np.array_equal(plain_run.nozzle, zero.nozzle)
    assert not Budget(zero).parts[GEOMETRY].size.any()
    assert np.array_equal(Budget(zero).contour.size, Budget(plain_run).contour.size)


def test_encoders_do_not_see_the_geometry_and_the_links_add_up(runs):
    plain_run, _, real = runs
    assert np.array_equal(plain_run.encoder, real.encoder)
    assert np.array_equal(plain_run.motor, real.motor)
    budget = Budget(real)
    for name in ("lateral", "vertical", "beyond"):
        whole = sum(getattr(part, name) for part in budget.parts.values())
        assert whole == pytest.approx(getattr(budget.contour, name), abs=SUM)
    ideal = Budget(plain_run).parts["structure"]
    assert budget.parts["structure"].lateral == pytest.approx(ideal.lateral, abs=SECOND_ORDER)
    assert list(budget.parts) == ["program", "servo", "encoder", GEOMETRY, "structure"]
    assert budget.values.parts[GEOMETRY].rms > 5e-3


def test_the_link_is_the_displacement_along_the_normal(runs):
    real = runs[2]
    on = Budget(real).analysis.ticks
    normal = real.requested.normal(Budget(real).analysis.motor.s)
    moved = np.einsum("ij,ij->i", (real.geometric_tip - real.motor_tip)[on], normal)
    assert Budget(real).parts[GEOMETRY].lateral == pytest.approx(moved, abs=5e-5)


def test_a_record_keeps_it(runs, tmp_path):
    for k, run in enumerate(runs):
        run.save(tmp_path / f"{k}.npz")
        loaded = Run.load(tmp_path / f"{k}.npz")
        assert (loaded.geometric_tip is None) == (run.geometric_tip is None)
        if run.geometric_tip is not None:
            assert np.array_equal(loaded.geometric_tip, run.geometric_tip)
    with np.load(tmp_path / "0.npz") as archive:
        assert "geometric_tip" not in archive


def test_a_long_run_has_the_same_in_its_file(xy, monkeypatch):
    real = xy.with_geometry(Geometry(accuracy="C7"))
    servo, setpoints = plain(xy), ramp(200.0)
    short = simulate(real, servo, setpoints)
    monkeypatch.setattr(memory, "LONG_RUN", 100)
    long = simulate(real, servo, setpoints)
    assert np.array_equal(long.geometric_tip, short.geometric_tip)
    assert np.array_equal(long.nozzle, short.nozzle)
    assert np.abs(short.geometric_tip - short.motor_tip).max() > 0.01
    assert short.period == PERIOD


def test_machines_of_a_design_vary_within_their_class(xy):
    real = xy.with_geometry(Geometry(accuracy="C5"))
    drawn = Tolerances().machines(real, 20, 1)
    factors = {name: [dict(one.geometry)[name] for one in drawn] for name in real.kinematic_errors.columns}
    for name, values in factors.items():
        low = 0 if name.startswith(("play", "racking")) else -1
        assert low <= min(values) < low + 0.2
        assert 0.8 < max(values) <= 1
    machine = real.perturbed(drawn[0])
    expected = real.kinematic_errors.values["squareness_xy"] * factors["squareness_xy"][0]
    assert machine.kinematic_errors.values["squareness_xy"] == pytest.approx(expected)
    same = Tolerances().machines(xy, 20, 1)
    assert not any(one.geometry for one in same)


@pytest.mark.parametrize(
    ("machine", "values", "says"),
    [
        ("xy", {"accuracy": "C8"}, "unknown accuracy class 'C8'"),
        ("xy", {"play": -0.01}, "play = -0.01"),
        ("xy", {"play": float("nan")}, "play = nan"),
        ("xy", {"travel_error": (0.01,)}, "geometry.travel_error has 1 values: must be one or 2, of the axes x, y"),
        ("xy", {"squareness_xz": 0.1}, "machine xy with the axes x .mm., y .mm. can have no squareness_xz"),
        ("xy", {"bending_x": 0.1}, "machine xy .* can have no bending_x"),
        ("delta", {"bending_y": 0.1}, "machine delta .* can have no bending_y"),
        ("xyz", {"bending_load": "wind"}, "unknown bending_load 'wind': .*known: force, weight"),
        ("xyz", {"ram": -1.0}, "ram = -1"),
        ("delta", {"scale_warming": 1.0}, "machine delta .* can have no growth"),
        ("delta", {"accuracy": "C7"}, "machine delta .* can have no straightness"),
        ("delta", {"play": 0.01}, "can have no play"),
        ("delta", {"warming": 3.0}, "can have no growth"),
        ("stage", {"sag": 0.01}, "can have no sag"),
        ("xyzr", {"yaw": (0, 0, 0.1, 0)}, "can have no yaw of axis z"),
    ],
)
def test_what_a_machine_cannot_have_is_refused(machine, values, says):
    with pytest.raises(InputError, match=says):
        Machine(machine).with_geometry(Geometry(**values))


MM = dict.fromkeys(("straightness", "straightness_vertical"), 10.0) | dict.fromkeys(
    ("sag", "bending_x", "bending_y"), 5.0
)
ANGLES = ("yaw", "squareness_xy", "squareness_xz", "squareness_yz")
LIMITS = [
    ("travel_error", -10.0, 10.0, "mm"),
    ("periodic_error", 0.0, 1.0, "mm"),
    ("play", 0.0, 5.0, ""),
    ("racking", 0.0, 10.0, "mm/m"),
    *[(name, -bound, bound, "mm") for name, bound in MM.items()],
    *[(name, -10.0, 10.0, "mm/m") for name in ANGLES],
    *[(name, -1e4, 1e4, "mm") for name in ("abbe", "guide_arm", "fixed_end", "scale_fixed")],
    ("ram", 0.0, 1e4, "mm"),
    *[(name, -100.0, 100.0, "K") for name in ("warming", "scale_warming")],
]


@pytest.mark.parametrize(("name", "low", "high", "unit"), LIMITS)
def test_a_value_is_taken_up_to_its_bounds_and_refused_beyond_them(name, low, high, unit):
    for bound, beyond in ((low, low - 0.01), (high, high + 1.0)):
        assert getattr(Geometry(**{name: bound}), name) == bound
        with pytest.raises(InputError) as error:
            Geometry(**{name: beyond})
        behind = f" {unit}" if unit else ""
        text = str(error.value).replace("\xa0", " ")
        assert text == f"{name} = {beyond:.12g}{behind}: must be {low:g} to {high:g}{behind}"


@pytest.mark.parametrize("name", ["expansion", "scale_expansion"])
def test_an_expansion_is_at_least_0_and_at_most_a_thousandth(name):
    for value in (0.0, 1e-3):
        assert getattr(Geometry(**{name: value}), name) == value
    for value, bound in ((-1e-9, "at least 0 1/K"), (1.1e-3, "at most 0.001 1/K")):
        with pytest.raises(InputError, match=f"^{name} = .*: must be {bound}$"):
            Geometry(**{name: value})
