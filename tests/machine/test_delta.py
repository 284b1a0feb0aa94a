"""The delta robot: geometry against MuJoCo and root finding, dynamics of its closed chain, limits."""

import math
import re

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from gantrysim import Budget, InputError, Machine, Servo, simulate
from gantrysim.controllers.softmc import Group, Program
from gantrysim.machine.kinematics import UnreachableError
from gantrysim.machine.perturbation import Perturbation
from gantrysim.paths.arcs import ArcChain
from gantrysim.record.setpoints import Setpoints, Supervision
from gantrysim.servo.stability.margins import margins_of

from support.runs import PERIOD, STEP, plain
from support.soaked import examples

EXACT = 1e-9  # [mm or deg]
# radius and height of the hinges, length and angle of the arms at home, radius and height of the rods' joints
RADIUS, HEIGHT, ARM, DOWN, JOINTS, ABOVE = 150.0, 1014.3, 200.0, 35.0, 50.0, 109.0
DIRECTIONS = (270.0, 30.0, 150.0)
SIDE = 30.0  # of a rod from its arm's plane [mm]
HOME = 426.0
CIRCLE = "Circle G1 CirclePoint={0, 100, 426} TargetPoint={-100, 0, 426}"

POSITION = st.tuples(
    st.floats(-160, 160), st.floats(-160, 160), st.floats(HOME - 0.4, HOME + 100), st.floats(-3600, 3600)
)


@pytest.fixture(scope="module")
def delta():
    return Machine("delta")


def half_circle(speed=150.0, acceleration=3000.0):
    group = Group(velocity=speed, acceleration=acceleration, profile="sine")
    return Program(program=CIRCLE, start=(100, 0, 426, 0), group=group).setpoints(PERIOD)


def data_at(machine, axes):
    data = mujoco.MjData(machine.physics)
    data.qpos[:] = machine.to_qpos(axes)
    mujoco.mj_forward(machine.physics, data)
    return data


def rod_ends(direction, angle, place):
    """Elbow and platform's joint of an arm's plane, from the drawing: radial, vertical [mm]."""
    c, s = math.cos(math.radians(direction)), math.sin(math.radians(direction))
    down = math.radians(DOWN + angle)
    elbow = np.array([RADIUS + ARM * math.cos(down), 0.0, HEIGHT - ARM * math.sin(down)])
    x, y, z = place
    return elbow, np.array([c * x + s * y + JOINTS, c * y - s * x, z + ABOVE])


ROD = float(np.linalg.norm(np.subtract(*rod_ends(0, 0, (0, 0, HOME)))))


def test_at_home_the_nozzle_is_over_the_middle_at_426_mm(delta):
    assert delta.kinematics.names == ("x", "y", "z", "r")
    assert delta.axis_names == ("a1", "a2", "a3", "r")
    np.testing.assert_allclose(delta.home, [0, 0, HOME, 0], atol=EXACT)
    np.testing.assert_allclose(delta.tip(np.zeros(4)), [0, 0, HOME], atol=EXACT)
    assert delta.gap == pytest.approx(0.5)
    assert pytest.approx(450.0, abs=0.1) == ROD


@pytest.mark.validates(
    "kinematics of the delta robot, forward and inverse",
    "each other",
    "1e-9 mm or deg",
)
@examples(200)
@given(position=POSITION)
def test_inverse_and_forward_kinematics_undo_each_other(delta, position):
    axes = delta.kinematics.inverse(np.array([position]))
    np.testing.assert_allclose(delta.kinematics.forward(axes)[0], position, rtol=0, atol=EXACT)
    np.testing.assert_allclose(delta.tip(axes)[0], position[:3], rtol=0, atol=EXACT)


def test_the_arms_are_where_root_finding_puts_them(delta):
    random = np.random.default_rng(1)
    for place in random.uniform([-160, -160, HOME], [160, 160, HOME + 100], (40, 3)):
        found = delta.kinematics.inverse(np.array([[*place, 0.0]]))[0, :3]
        for direction, angle in zip(DIRECTIONS, found, strict=True):

            def error(a, direction=direction, place=place):
                return np.linalg.norm(np.subtract(*rod_ends(direction, a, place))) - ROD

            assert angle == pytest.approx(brentq(error, -70, 60, xtol=1e-13), abs=EXACT)


def test_mujocos_rods_keep_their_lengths_at_every_position_of_the_arms(delta):
    low, high = np.array([axis.travel for axis in delta.axes]).T
    for axes in np.random.default_rng(2).uniform(low, high, (100, 4)):
        data = data_at(delta, axes)
        np.testing.assert_allclose(1e3 * data.ten_length, ROD, rtol=0, atol=EXACT)
        assert data.ne == 3  # one rod of each pair holds the platform
    # and all of the workspace lies within the travel of the motors
    grid = np.stack(np.meshgrid([-160, 0, 160], [-160, 0, 160], [HOME - 0.4, HOME + 100], [0]), axis=-1).reshape(-1, 4)
    axes = delta.kinematics.inverse(grid)
    assert (axes > low).all()
    assert (axes < high).all()


def test_an_arms_inertia_is_that_of_the_energy_of_all_it_moves(delta):
    """Rotor, hub and arm turn, and the platform moves by the slope of the exact inverse."""
    model = delta.physics
    step = 1e-4
    there = np.array([delta.home + step * unit for unit in np.eye(4)[:3]])
    back = np.array([delta.home - step * unit for unit in np.eye(4)[:3]])
    turned = (delta.kinematics.inverse(there) - delta.kinematics.inverse(back))[:, :3] / (2 * step)  # deg/mm, [x, arm]
    moved = np.linalg.inv(np.radians(turned.T) * 1e3)  # m/rad, [xyz, arm]
    carried = sum(float(model.body(name).mass[0]) for name in ("platform", "belt", "head"))
    arm = 1.74e-3 + 0.24 * 0.11**2 + 4e-5
    for a in range(3):
        inertia = 2.51e-5 * 50**2 + arm + carried * moved[:, a] @ moved[:, a]
        assert delta.axes[a].inertia == pytest.approx(math.radians(inertia) / 50, rel=1e-6)


def test_gravity_is_balanced(delta):
    data = data_at(delta, np.zeros(4))
    assert np.abs(data.qacc).max() < 1e-7


@pytest.mark.parametrize("speed", [150.0, 600.0])
def test_the_rods_stretch_by_less_than_a_quarter_micrometre(delta, speed):
    """A rod is held by a = -k e, k = 1 / T^2 with its time constant T: centripetal acceleration a stretches it."""
    servo = plain(delta)
    run = simulate(delta, servo, half_circle(speed, 5000.0))
    assert run.fault is None
    model = delta.stepping(STEP)
    data = mujoco.MjData(model)
    data.qpos[:] = delta.to_qpos(run.commanded[0])
    stretched = []
    for demand in run.demand[:-1]:
        data.ctrl[:] = demand
        mujoco.mj_step(model, data, round(PERIOD / STEP))
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_tendon(model, data)
        stretched.append(1e6 * np.abs(data.ten_length - model.tendon_length0).max())
    turning = (1e-3 * speed) ** 2 / (1e-3 * ROD)  # the platform's speed across a rod
    assert max(stretched) < 1e6 * 2 * turning * (5e-4) ** 2 + 0.03
    assert max(stretched) < 0.25


def test_a_half_circle_runs_with_tracking_contour_and_margins(delta):
    servo = Servo.derive(delta.axes, integral_time=0.03)
    setpoints = half_circle()
    run = simulate(delta, servo, setpoints)
    assert run.fault is None
    assert run.axes == ("a1", "a2", "a3", "r")
    np.testing.assert_allclose(run.commanded_tip, setpoints.position[:, :3], rtol=0, atol=EXACT)
    np.testing.assert_allclose(np.hypot(*run.commanded_tip[:, :2].T), 100.0, rtol=0, atol=EXACT)
    # between motor and nozzle are only the gears' springs
    assert 0.01 < np.abs(run.nozzle - run.motor_tip).max() < 0.1
    assert 0.005 < np.sqrt(np.mean(Budget(run).contour.size ** 2)) < 0.1
    for margins in margins_of(delta, servo):
        assert margins.stable
        assert min(margins.gain, margins.together) >= 2


def test_a_home_offset_moves_the_nozzle_as_the_arms_do(delta):
    offset = (0.1, -0.05, 0.02, 0.0)
    wrong = delta.perturbed(Perturbation(home_offset=offset))
    run = simulate(wrong, plain(wrong), half_circle())
    expected = delta.tip(run.motor + np.array(offset))
    assert np.abs(run.nozzle - expected).max() < 0.1  # the gears' springs, as above
    assert np.abs(delta.tip(run.motor) - expected).max() > 0.2
    data = data_at(wrong, np.zeros(4))
    np.testing.assert_allclose(1e3 * data.ten_length, ROD, rtol=0, atol=EXACT)


def line(delta, start, end, ticks=200, axes=("x", "y", "z")):
    share = np.linspace(0, 1, ticks)[:, None]
    position = np.array(start) + share * (np.array(end) - np.array(start))
    return Setpoints(PERIOD, axes, position, np.ones(ticks, bool), ArcChain((0, 0), 0, [0], [10]))


def test_coordinates_that_a_program_does_not_move_stay_at_home(delta):
    run = simulate(delta, plain(delta), line(delta, (0, HOME), (20, HOME + 10), axes=("x", "z")))
    np.testing.assert_allclose(run.commanded_tip[-1], [20, 0, HOME + 10], atol=EXACT)
    message = (
        r"does not move z and its path begins at z = 0 mm: on machine delta it must move z, which is 426 mm with all"
    )
    with pytest.raises(InputError, match=message):
        simulate(delta, plain(delta), line(delta, (0, 0), (20, 10), axes=("x", "y")))
    # a program may also move the motors
    run = simulate(delta, plain(delta), line(delta, (0, 0), (5, 5), axes=("a1", "a2")))
    np.testing.assert_allclose(run.commanded[-1], [5, 5, 0, 0], atol=EXACT)


@pytest.mark.parametrize(
    ("end", "text"),
    [
        (
            (0, 0, 420),
            r"z = 425.5\d* mm, r = 0 deg: z must lie in the travel 425.6 to 526 mm, at t = 0.0\d+ s, on machine",
        ),
        ((170, 0, 430), "x must lie in the travel -160 to 160 mm"),
        ((0, 0, math.nan), "must be finite"),
        ((155, 0, 426), r"speed of a\d = .* deg/s at t = .* s \(x = .*, z = 426 mm, r = 0 deg\): must be at most 720"),
    ],
)
def test_what_the_machine_cannot_do_is_refused_in_one_line(delta, end, text):
    with pytest.raises(InputError, match=text) as raised:
        simulate(delta, plain(delta), line(delta, (0, 0, 426), end, ticks=30 if end[0] == 155 else 200))
    assert "\n" not in str(raised.value)


def test_an_unknown_coordinate_and_a_motors_travel_are_named(delta):
    with pytest.raises(InputError, match="the program moves axis 'u': machine delta has x, y, z, r"):
        simulate(delta, plain(delta), line(delta, (0,), (1,), axes=("u",)))
    with pytest.raises(
        InputError, match=r"a1 = 60 deg at t = 0.199 s \(x = .*\): must lie in the travel -55 to 50 deg"
    ):
        simulate(delta, plain(delta), line(delta, (0,), (60,), axes=("a1",)))


def roomy(delta):
    """The robot without the travel of its platform."""

    def edit(spec):
        for axis in "xyz":
            spec.joint(f"platform_{axis}").range = [-2.0, 2.0]

    return delta.edited(edit)


def test_out_of_reach_and_near_singularities_is_refused(delta):
    kinematics = roomy(delta).kinematics
    with pytest.raises(UnreachableError, match=r"out of reach of a\d, .* mm from its shoulder, must be 250 to 650 mm"):
        kinematics.inverse(np.array([[0, 0, 250.0, 0]]))
    for place, text in (((0, 0, 675.5), "deg from a line, at least 5"), ((0, 0, 264), "parallel or in one plane")):
        with pytest.raises(UnreachableError, match=rf"z = {place[2]:g} mm, r = 0 deg: near a singularity, .*{text}"):
            kinematics.inverse(np.array([[0, 0, HOME, 0], [*place, 0.0]]))
    with pytest.raises(UnreachableError, match=r"in one plane, det = -0.\d+, at least 0.1"):
        kinematics.inverse(np.array([[0, 0, 1300.0, 0]]))  # the rods stand on the arms
    # the positions before these are taken, and forward kinematics agree there too
    column = np.array([[0, 0, z, 0.0] for z in np.arange(265.0, 675.0, 5.0)])
    np.testing.assert_allclose(kinematics.forward(kinematics.inverse(column)), column, rtol=0, atol=EXACT)


def refusal(kinematics, *positions):
    """The row that is refused, and the sentence; none of a row and an empty one where all are reached."""
    try:
        kinematics.inverse(np.array(positions, float))
    except UnreachableError as error:
        return error.row, str(error)
    return None, ""


def test_the_first_position_out_of_reach_and_its_arm_are_named(delta):
    """A platform that leaves the middle leaves the reach of one arm first, all around the robot of each in its turn."""
    kinematics = roomy(delta).kinematics
    home = (0, 0, HOME, 0)
    # of any arm
    out = (1900, 0, HOME, 0)
    assert "beside the plane in which it turns, must be at most 450 mm" in refusal(kinematics, out)[1]
    named = set()
    for angle in np.radians(np.arange(0.0, 360.0, 40.0)):
        places = [(r * math.cos(angle), r * math.sin(angle), HOME, 0) for r in range(300, 1900, 5)]
        beyond = next(place for place in places if "out of reach" in refusal(kinematics, place)[1])
        row, text = refusal(kinematics, home, beyond, out)
        assert row == 1
        assert text == refusal(kinematics, beyond)[1]
        arm, measured, bound = re.search(r"out of reach of (a\d), (\S*) mm .* (\S*) mm$", text).groups()
        assert float(measured) > float(bound)
        named.add(arm)
    assert named == set(kinematics.names_of_arms)


def test_limits_of_linear_axes_are_refused(delta):
    setpoints = line(delta, (0, HOME), (20, HOME), axes=("x", "z"))
    for limit in ("position_error", "velocity_limit"):
        watched = Setpoints(
            PERIOD, ("x", "z"), setpoints.position, setpoints.dispense, setpoints.requested, Supervision(**{limit: 1.0})
        )
        with pytest.raises(InputError, match=f"{limit} = 1 mm.*: must be inf on machine delta, whose axes a1"):
            simulate(delta, plain(delta), watched)


@pytest.mark.parametrize(
    ("edit", "text"),
    [
        (lambda spec: spec.delete(spec.equalities[0]), "2 rods .* hold 1 bodies: must be 3"),
        (lambda spec: setattr(spec.joint("platform_x"), "axis", [1, 0.1, 0]), "must be along x, y and z of the work"),
        (lambda spec: spec.delete(spec.joint("platform_x")), "the platform 'platform' must have three slides that no"),
        (lambda spec: setattr(spec.texts[0], "data", "dalta"), "unknown kinematics 'dalta': did you mean delta?"),
    ],
)
def test_a_model_without_the_mechanism_is_refused(delta, edit, text):
    with pytest.raises(InputError, match=text):
        delta.edited(edit)
