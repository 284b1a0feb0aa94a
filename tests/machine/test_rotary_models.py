"""The machines with rotary axes: geometry, torque reserves and tracking."""

import itertools
import math

import mujoco
import numpy as np
import pytest

from gantrysim import Machine, Servo, simulate
from gantrysim.machine.machine import builtin_models
from gantrysim.record.setpoints import Setpoints
from gantrysim.servo.derivation import natural_frequency

from support.runs import PERIOD, ends_of_travel, ramp, round_the_piece, smooth
from support.soaked import suite_runs

EXACT = 1e-9  # [mm]
# TH [deg], outline point u [mm], stage S [mm]: the edges of a piece of 100 x 60 mm and the middle of its first corner
OUTLINE = [
    (0, (-50, -20), (150, -20)),
    (0, (-50, 20), (150, 20)),
    (90, (-40, 30), (-40, -170)),
    (90, (40, 30), (40, -170)),
    (180, (50, 20), (-150, 20)),
    (180, (50, -20), (-150, -20)),
    (270, (40, -30), (40, 170)),
    (270, (-40, -30), (-40, 170)),
    (45, (-47.071068, 27.071068), (94.350288, -114.350288)),
]


@pytest.fixture(scope="module")
def stage():
    return Machine("stage")


@pytest.fixture(scope="module")
def xyzr():
    return Machine("xyzr")


def data_at(machine, position):
    data = mujoco.MjData(machine.model)
    data.qpos[:] = machine.to_qpos(position)
    mujoco.mj_forward(machine.model, data)
    return data


@pytest.mark.parametrize(("th", "u", "slides"), OUTLINE)
def test_the_stage_brings_the_outline_under_the_needle(stage, th, u, slides):
    np.testing.assert_allclose(stage.tip([[th, *slides]])[0], [*u, 0.0], atol=1e-5)


def test_the_stages_tip_has_its_closed_form(stage):
    th, x, y = np.random.default_rng(0).uniform([-450, -220, -220], [450, 220, 220], (50, 3)).T
    a = np.radians(th)
    expected = np.stack([-200 * np.cos(a) + x, 200 * np.sin(a) + y, 0 * a], axis=1)
    np.testing.assert_allclose(stage.tip(np.stack([th, x, y], axis=1)), expected, atol=EXACT)


def test_the_stage_turns_its_work_counter_clockwise_and_its_needle_stands(stage):
    needle = data_at(stage, [0, 0, 0]).site_xpos[stage.nozzle].copy()
    for th in (30.0, -200.0):
        data = data_at(stage, [th, 40.0, -70.0])
        np.testing.assert_array_equal(data.site_xpos[stage.nozzle], needle)
        frame = data.xmat[stage.work].reshape(3, 3)
        assert math.atan2(frame[1, 0], frame[0, 0]) == pytest.approx(math.remainder(math.radians(th), 2 * math.pi))
        # a positive position moves the work in the negative direction of the turned axes
        moved = frame.T @ (data.xpos[stage.work] - data_at(stage, [th, 0, 0]).xpos[stage.work])
        np.testing.assert_allclose(1e3 * moved, [-40.0, 70.0, 0.0], atol=EXACT)


def test_the_nozzle_turns_visibly_about_its_tip(xyzr):
    tips = xyzr.tip([[10.0, 20.0, 30.0, r] for r in (-3600.0, 0.0, 77.0, 3600.0)])
    np.testing.assert_allclose(tips, [[10.0, 20.0, 30.0]] * 4, atol=EXACT)
    head = xyzr.model.body("head").id
    drawn = [g for g in range(xyzr.model.ngeom) if xyzr.model.geom_bodyid[g] == head]
    far = max(drawn, key=lambda g: np.linalg.norm(xyzr.model.geom_pos[g, :2]))
    moved = np.linalg.norm(data_at(xyzr, [0, 0, 0, 180.0]).geom_xpos[far] - data_at(xyzr, [0] * 4).geom_xpos[far])
    assert moved > 0.03


def inertia(machine, position, axis):
    data, model = data_at(machine, position), machine.model
    matrix = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, matrix)
    dof = int(model.joint(axis).dofadr[0])
    return matrix[dof, dof]


def test_the_inertia_about_the_table_grows_by_a_third_on_the_outline_as_the_readme_says(stage):
    rest = inertia(stage, [0, 0, 0], "th")
    assert rest == pytest.approx(0.754, abs=1e-3)
    reached = [inertia(stage, [th, *slides], "th") / rest for th, _, slides in OUTLINE]
    assert max(reached) < 1.33
    assert inertia(stage, [0, 190, 0], "th") / rest == pytest.approx(1.32, abs=0.01)
    assert inertia(stage, [0, 220, 220], "th") / rest == pytest.approx(1.53, abs=0.01)


def needed(machine, position, velocity, acceleration):
    """Torque of each motor for a motion [mm or deg, s], with Coulomb friction, (axes,) [N·m]."""
    model = machine.model
    data = data_at(machine, position)
    dofs = [int(model.joint(name).dofadr[0]) for name in machine.axis_names]
    si = np.array([1e-3 if axis.unit == "mm" else math.radians(1) for axis in machine.axes])
    data.qvel[dofs], data.qacc[:] = si * velocity, 0
    data.qacc[dofs] = si * acceleration
    mujoco.mj_inverse(model, data)
    return np.abs(data.qfrc_inverse[dofs] / model.actuator_gear[:, 0]) + [axis.coulomb for axis in machine.axes]


@pytest.mark.parametrize(
    ("velocity", "reserve"), [((0, 0, 0), 2.0), ((286.5, 950, 0), 1.5), ((286.5, 0, 950), 1.5), ((286.5, 0, -950), 1.5)]
)
def test_the_stage_has_torque_in_reserve_on_the_outline(stage, velocity, reserve):
    peak = np.array([axis.peak_torque for axis in stage.axes])
    for position in ([0, 190, 0], [0, 0, 190], [0, 134, -134]):
        for signs in itertools.product((-1, 1), repeat=3):
            torque = needed(stage, position, velocity, np.multiply(signs, (2000.0, 2000.0, 2000.0)))
            assert (peak / torque > reserve).all()


def rms(error):
    return 1e3 * np.sqrt(np.mean(error**2, axis=0))


def test_tracking_of_the_stage_on_a_smooth_path_around_the_piece(stage):
    setpoints, u = round_the_piece(6.0)
    run = simulate(stage, Servo.derive(stage.axes), setpoints)
    assert run.fault is None
    np.testing.assert_allclose(run.commanded_tip[:, :2], u, atol=EXACT)
    error = run.commanded - run.encoder
    th, x, y = rms(error)
    assert th < 12  # [mdeg]
    assert max(x, y) < 40  # [µm]
    assert 1e3 * np.linalg.norm(run.nozzle - run.commanded_tip, axis=1).max() < 60  # [µm]
    assert 1e3 * np.linalg.norm(run.nozzle - run.encoder_tip, axis=1).max() < 15  # [µm]
    integral = simulate(stage, Servo.derive(stage.axes, integral_time=0.05), setpoints)
    assert (rms(integral.commanded - integral.encoder) < 0.3 * rms(error)).all()  # most of it was friction


def test_tracking_of_the_turning_nozzle_on_two_circles(xyzr):
    phi = 4 * np.pi * smooth(4.0)
    position = np.column_stack([30 * np.cos(phi) - 30, 30 * np.sin(phi), 0 * phi, np.degrees(phi)])
    setpoints = Setpoints(PERIOD, xyzr.axis_names, position, np.ones(len(phi), bool), ramp(50.0).requested)
    run = simulate(xyzr, Servo.derive(xyzr.axes), setpoints)
    assert run.fault is None
    x, y, _, r = rms(run.commanded - run.encoder)
    assert max(x, y) < 40  # [µm]
    assert r < 350  # [mdeg]: friction over the little inertia of a small motor
    assert 1e3 * np.linalg.norm(run.nozzle - run.encoder_tip, axis=1).max() < 5  # [µm]
    integral = simulate(xyzr, Servo.derive(xyzr.axes, integral_time=0.05), setpoints)
    assert rms(integral.commanded - integral.encoder)[3] < 30  # [mdeg]


@pytest.mark.parametrize(("name", "position"), [("xyzr", (0, 0, 5, 0)), ("stage", (0, 0, 0)), ("stage", (0, 150, 150))])
def test_derived_gains_have_a_margin_of_a_quarter_on_every_axis(name, position):
    machine = Machine(name)
    frequency = 1.25 * natural_frequency(PERIOD + max(axis.lag for axis in machine.axes), 1.0)
    servo = Servo.derive(machine.axes, PERIOD, frequency=frequency)
    for a, axis in enumerate(machine.axes):
        motion = np.tile(np.array(position, float), (1001, 1))
        motion[:, a] += (90.0 if axis.unit == "deg" else 40.0) * smooth(1.0)
        setpoints = Setpoints(PERIOD, machine.axis_names, motion, np.ones(1001, bool), ramp(50.0).requested)
        run = simulate(machine, servo, setpoints)
        assert run.fault is None
        # no ringing: the demand changes little from tick to tick
        assert np.std(np.diff(run.demand[:, a], 2)) < 0.1 * axis.peak_torque


def moving(model, body):
    while body:
        if model.body_jntnum[body]:
            return True
        body = model.body_parentid[body]
    return False


def test_the_moving_parts_of_the_stage_clear_the_fixed_ones(stage):
    model = stage.model
    shapes = [g for g in range(model.ngeom) if model.geom_type[g] != mujoco.mjtGeom.mjGEOM_PLANE]
    turning = np.array([g for g in shapes if moving(model, model.geom_bodyid[g])])
    standing = np.array([g for g in shapes if not moving(model, model.geom_bodyid[g])])
    for th, x, y in itertools.product(range(0, 360, 30), (-220, 0, 220), (-220, 0, 220)):
        data = data_at(stage, [th, x, y])
        apart = np.linalg.norm(data.geom_xpos[turning][:, None] - data.geom_xpos[standing][None], axis=2)
        near = apart < model.geom_rbound[turning][:, None] + model.geom_rbound[standing][None] + 1e-3
        for i, k in zip(*np.nonzero(near), strict=True):
            assert mujoco.mj_geomDistance(model, data, int(turning[i]), int(standing[k]), 0.01, None) > 4e-4


def test_the_work_piece_lies_half_a_millimetre_below_the_tip(stage):
    data = data_at(stage, [0, 0, 0])
    hit = np.full(1, -1, np.int32)
    for x, y in ((-50, 20), (50, -20), (-47, 27), (0, 30), (-52.5, 0)):
        start = data.xpos[stage.work] + [1e-3 * x, 1e-3 * y, 0]
        distance = mujoco.mj_ray(stage.model, data, start, np.array([0.0, 0, -1]), None, 1, -1, hit, None)
        assert distance == pytest.approx(0.5e-3, abs=1e-9)
        assert stage.model.geom_bodyid[hit[0]] == stage.work
    corner = data.xpos[stage.work] + [0.0515, 0.0315, 0]  # rounded off
    mujoco.mj_ray(stage.model, data, corner, np.array([0.0, 0, -1]), None, 1, -1, hit, None)
    assert stage.model.geom(hit[0]).name != "piece"


def corners(machine, position):
    """Corners of the boxes round all shapes but the floor [m]."""
    model, data = machine.model, data_at(machine, position)
    signs = np.array(list(itertools.product((-1, 1), repeat=3)))
    found = []
    for g in range(model.ngeom):
        if model.geom_type[g] != mujoco.mjtGeom.mjGEOM_PLANE:
            local = model.geom_aabb[g, :3] + signs * model.geom_aabb[g, 3:]
            found.append(data.geom_xpos[g] + local @ data.geom_xmat[g].reshape(3, 3).T)
    return np.concatenate(found)


@pytest.mark.parametrize("name", suite_runs(builtin_models(), 0, 2))
def test_the_overview_holds_the_machine_in_every_position_at_4_to_3(name):
    machine = Machine(name)
    camera = machine.model.camera("overview").id
    tangent = math.tan(0.5 * math.radians(machine.model.cam_fovy[camera]))
    for position in ends_of_travel(machine):
        data = data_at(machine, position)
        seen = (corners(machine, position) - data.cam_xpos[camera]) @ data.cam_xmat[camera].reshape(3, 3)
        assert (np.abs(seen[:, 0]) < 4 / 3 * tangent * -seen[:, 2]).all()
        assert (np.abs(seen[:, 1]) < tangent * -seen[:, 2]).all()
