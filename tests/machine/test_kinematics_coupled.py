"""Motors that share coordinates: CoreXY belts and a bridge with two motors."""

import math

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import InputError, Machine, Servo, simulate
from gantrysim.controllers.softmc import Group, Program
from gantrysim.machine.ideal import without_compliance
from gantrysim.machine.motors import springs_have_axes
from gantrysim.machine.perturbation import Perturbation
from gantrysim.servo.stability.margins import margins_of

from support.mechanisms import COREXY, corexy, tandem
from support.runs import PERIOD, plain
from support.soaked import examples

EXACT = 1e-9  # [mm or deg]
PULLEY = 10.0  # [mm]
SPAN = 400.0  # of the bridge [mm]


@pytest.fixture(scope="module")
def belts(tmp_path_factory):
    return corexy(tmp_path_factory.mktemp("corexy"))


@pytest.fixture(scope="module")
def bridge(tmp_path_factory):
    return tandem(tmp_path_factory.mktemp("tandem"))


def half_circle(speed=150.0):
    group = Group(velocity=speed, profile="sine")
    return Program(
        program="Circle G1 CirclePoint={0, 100} TargetPoint={-100, 0}", start=(100, 0), group=group
    ).setpoints(PERIOD)


@examples(100)
@given(x=st.floats(-150, 150), y=st.floats(-150, 150))
def test_corexy_motors_turn_by_sum_and_difference(belts, x, y):
    assert belts.kinematics.names == ("x", "y")
    axes = belts.kinematics.inverse(np.array([[x, y]]))
    expected = np.degrees([(x + y) / PULLEY, (x - y) / PULLEY])
    np.testing.assert_allclose(axes[0], expected, rtol=0, atol=1e-8)
    np.testing.assert_allclose(belts.kinematics.forward(axes)[0], [x, y], rtol=0, atol=EXACT)
    np.testing.assert_allclose(belts.tip(axes)[0], [x, y, 0], rtol=0, atol=EXACT)


def test_a_bridge_skews_by_the_difference_of_its_motors(bridge):
    axes = np.array([[30.0, 20.0, 20.0], [30.0, 20.5, 19.5]])
    assert bridge.kinematics.names == ("x", "y")
    np.testing.assert_allclose(bridge.kinematics.inverse(np.array([[30.0, 20.0]])), axes[:1], atol=EXACT)
    np.testing.assert_allclose(bridge.kinematics.forward(axes), [[30, 20], [30, 20]], atol=EXACT)
    skew = -1.0 / SPAN  # the left nut is ahead
    tip = [30 * math.cos(skew), 20 + 30 * math.sin(skew), 0]
    np.testing.assert_allclose(bridge.tip(axes), [[30, 20, 0], tip], rtol=0, atol=EXACT)


@pytest.mark.parametrize("name", ["belts", "bridge"])
def test_mujocos_tendons_are_relaxed_wherever_the_axes_are(name, request):
    machine = request.getfixturevalue(name)
    data = mujoco.MjData(machine.physics)
    random = np.random.default_rng(1)
    for position in random.uniform(-150, 150, (30, 2)):
        data.qpos[:] = machine.to_qpos(machine.kinematics.inverse(position[None])[0])
        mujoco.mj_forward(machine.physics, data)
        assert np.abs(1e3 * data.ten_length).max() < EXACT
        tip = data.xmat[machine.work].reshape(3, 3).T @ (data.site_xpos[machine.nozzle] - data.xpos[machine.work])
        np.testing.assert_allclose(1e3 * tip, [*position, 0], rtol=0, atol=EXACT)


def test_an_axis_of_corexy_carries_a_quarter_of_each_moving_mass(belts):
    """One motor turns with the other at rest: x and y move by half the belt each."""
    own = 1e-4 + 0.4 * 0.05 * 0.01**2
    carried = (0.8 + 0.8 + 1.5) * (0.5e-3 * PULLEY) ** 2
    for axis in belts.axes:
        assert axis.inertia == pytest.approx(math.radians(own + carried), rel=1e-6)


@pytest.mark.parametrize("name", ["belts", "bridge"])
def test_a_half_circle_runs_with_derived_gains(name, request):
    machine = request.getfixturevalue(name)
    servo = Servo.derive(machine.axes, integral_time=0.05)
    for one in margins_of(machine, servo):
        assert min(one.gain, one.together) >= 2
        assert one.sensitivity <= 2.001
    setpoints = half_circle()
    for variant in (machine, without_compliance(machine), machine.perturbed(Perturbation(stiffness=2.0, payload=0.2))):
        run = simulate(variant, servo, setpoints)
        assert run.fault is None
        np.testing.assert_allclose(run.commanded_tip[:, :2], setpoints.position, rtol=0, atol=EXACT)
        assert np.abs(run.nozzle - run.commanded_tip).max() < 0.1


def test_stiff_belts_keep_the_nozzle_on_the_motors(belts):
    runs = [
        simulate(machine, plain(belts), half_circle(500.0))
        for machine in (belts, belts.perturbed(Perturbation(stiffness=2.0)), without_compliance(belts))
    ]
    soft, stiff, rigid = (np.abs(run.nozzle - run.motor_tip).max() for run in runs)
    assert stiff == pytest.approx(0.5 * soft, rel=0.2)
    assert rigid < 1e-3 < stiff


def test_stiffness_factors_go_to_the_axis_that_pulls_the_belt(belts, bridge):
    assert springs_have_axes(belts.layout)
    changed = belts.perturbed(Perturbation(stiffness=(0.5, 2.0)))
    assert changed.physics.tendon_stiffness.tolist() == [2e5, 8e5]
    assert not springs_have_axes(bridge.layout)  # no axis carries the hinge of the bridge
    with pytest.raises(InputError, match="no axis carries the spring 'skew'; give one for all"):
        bridge.perturbed(Perturbation(stiffness=(1.0, 2.0, 1.0)))


@pytest.mark.parametrize("name", ["belts", "bridge"])
def test_a_home_offset_moves_the_nozzle(name, request):
    machine = request.getfixturevalue(name)
    offset = {"belts": (1.0, -0.5), "bridge": (0.0, 0.2, 0.1)}[name]
    wrong = machine.perturbed(Perturbation(home_offset=offset))
    run = simulate(wrong, plain(machine), half_circle())
    expected = machine.tip(run.motor + np.array(offset))
    assert np.abs(run.nozzle - expected).max() < 0.03
    assert np.abs(machine.tip(run.motor) - expected).max() > 0.09


def test_travel_of_coordinates_and_models_without_the_mechanism_are_refused(belts, tmp_path):
    with pytest.raises(InputError, match="x = 151, y = 0 mm: x must lie in the travel -150 to 150 mm"):
        belts.kinematics.inverse(np.array([[0.0, 0.0], [151.0, 0.0]]))
    for old, new, text in (
        ('<joint joint="x" coef="-1"/><joint joint="y" coef="1"/>', "", "do not determine|as many of each"),
        (
            '<joint joint="x" coef="-1"/><joint joint="y" coef="1"/>',
            '<joint joint="x" coef="-1"/><joint joint="y" coef="-1"/>',
            "tendons do not determine the joints that follow",
        ),
        ('stiffness="4e5" ', "", "0 fixed tendons with stiffness or an equality join 0 axes and 0 other joints"),
    ):
        assert old in COREXY
        (tmp_path / "wrong.xml").write_text(COREXY.replace(old, new))
        with pytest.raises(InputError, match=text):
            Machine(tmp_path / "wrong.xml")


def test_belts_that_are_longer_at_rest_shift_the_motors(tmp_path):
    """0.01 a = x + y + l: with the slides at 0 the motors stand where the belts are relaxed."""
    text = COREXY
    for name, length in (("belt_a", 4e-3), ("belt_b", 7e-3)):
        old = f'<fixed name="{name}" stiffness="4e5" damping="80" springlength="0">'
        assert old in text
        text = text.replace(old, old.replace('springlength="0"', f'springlength="{length}"'))
    (tmp_path / "long.xml").write_text(text)
    machine = Machine(tmp_path / "long.xml")
    data = mujoco.MjData(machine.physics)
    for x, y in np.random.default_rng(2).uniform(-140, 140, (10, 2)):
        axes = machine.kinematics.inverse(np.array([[x, y]]))
        np.testing.assert_allclose(axes[0], np.degrees([(x + y + 4) / PULLEY, (x - y + 7) / PULLEY]), atol=1e-8)
        np.testing.assert_allclose(machine.kinematics.forward(axes)[0], [x, y], atol=EXACT)
        data.qpos[:] = machine.to_qpos(axes[0])
        mujoco.mj_forward(machine.physics, data)
        np.testing.assert_allclose(1e3 * data.ten_length, [4, 7], atol=EXACT)
        tip = data.xmat[machine.work].reshape(3, 3).T @ (data.site_xpos[machine.nozzle] - data.xpos[machine.work])
        np.testing.assert_allclose(1e3 * tip, [x, y, 0], atol=EXACT)
    origin = machine.kinematics.inverse(np.zeros((1, 2)))[0]
    assert np.abs(origin).min() > 20
