"""The camera that is fitted to the bead: closed forms, and what the pictures show."""

from functools import cache
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.job.job import Job
from gantrysim.render.camera import FADED, FIELD_OF_VIEW, PICTURE_MARGIN, Flight, Framing, Sight, View
from gantrysim.render.film import Film, Take, _common_framing
from gantrysim.render.renderer import Inset
from gantrysim.render.scene import Scene

from support.soaked import examples

SHAPE = 16 / 9
JOBS = ("an225", "fanuc-conical", "softmc-arc", "stage-outline", "delta-arc")

points = st.lists(st.tuples(*[st.floats(-0.2, 0.2)] * 3), min_size=2, max_size=30).map(np.array)


def seen(framing, shape, distance):
    """Places of the points in a pinhole camera's picture, by the matrix of its pose."""
    azimuth, elevation = np.radians([framing.azimuth, framing.elevation])
    forward = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    relative = framing.points - (framing.centre - distance * forward)
    depth = relative @ forward
    half = np.tan(np.radians(FIELD_OF_VIEW / 2))
    return np.stack([relative @ right / (depth * half * shape), relative @ up / (depth * half)], axis=1), depth


@given(points, st.floats(-180, 180), st.sampled_from([-35.0, -50.0]), st.floats(0.5, 3))
@examples(60)
def test_the_least_distance_just_holds_every_point_with_the_margin(place, azimuth, elevation, shape):
    framing = Framing(place, azimuth, elevation)
    distance = framing.distance(shape)
    where, depth = seen(framing, shape, distance)
    assert depth.min() > 0
    assert np.abs(where).max() <= 1 / PICTURE_MARGIN + 1e-9
    if distance > 0.081:  # not held back by the needle's room: nearer, a point would leave the margin
        nearer, _ = seen(framing, shape, 0.99 * distance)
        assert np.abs(nearer).max() > 1 / PICTURE_MARGIN
    np.testing.assert_allclose(framing.in_picture(shape), where, atol=1e-9)


@given(points, st.floats(-180, 180), st.floats(0, 360))
@examples(30)
def test_bead_and_camera_turned_together_give_the_same_picture(place, azimuth, turn):
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    turned = place @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T
    square = np.array([[x, y, z] for x in (-0.3, 0.3) for y in (-0.3, 0.3) for z in (-0.1, 0.1)])
    turned_square = square @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T
    # a cube around the points, so that the box around them has the same centre in both frames
    before = Framing(np.concatenate([square, square, place * 0.5]), azimuth, -35.0)
    after = Framing(np.concatenate([turned_square, turned_square, turned * 0.5]), azimuth + turn, -35.0)
    assert after.distance(SHAPE) == pytest.approx(before.distance(SHAPE), abs=1e-9)


@cache
def stage(name):
    job = Job.load(name)
    run = job.run()
    return job, run, Scene(job.built_machine, run, job.bead)


@pytest.fixture(params=JOBS)
def staged(request):
    return stage(request.param)


@pytest.fixture
def gantry():
    return stage("an225")


def test_the_whole_bead_is_in_the_picture_at_every_time(staged):
    job, run, scene = staged
    flight = Flight(scene, job.built_machine, SHAPE)
    data = scene.data
    work = job.built_machine.work
    laid = 1e-3 * run.nozzle[run.dispense]
    for tick in np.linspace(0, len(run.time) - 1, 5).astype(int):
        scene.pose(tick)
        view = flight.view(1.0)
        world = data.xpos[work] + laid @ data.xmat[work].reshape(3, 3).T
        pinhole = Framing(world, view.azimuth, view.elevation)
        forward, right, up = pinhole.axes
        relative = world - (view.centre - view.distance * forward)
        half = np.tan(np.radians(view.field / 2)) * (relative @ forward)
        assert np.abs(relative @ up / half).max() < 1 / PICTURE_MARGIN + 0.02  # between the looked-at points
        assert np.abs(relative @ right / (half * SHAPE)).max() < 1 / PICTURE_MARGIN + 0.02


def test_what_hides_the_bead_fades_and_nothing_else(staged):
    job, run, scene = staged
    flight = Flight(scene, job.built_machine, SHAPE)
    sight = Sight(scene.model, job.built_machine, run, SHAPE)
    hiding = set(sight.hiding(flight.framing).tolist())
    before = scene.model.geom_rgba[:, 3].copy()
    flight.view(0.0)
    np.testing.assert_allclose(scene.model.geom_rgba[:, 3], before)
    flight.view(0.5)
    halfway = scene.model.geom_rgba[:, 3].copy()
    flight.view(1.0)
    np.testing.assert_allclose(halfway, 0.5 * (before + scene.model.geom_rgba[:, 3]), atol=1e-6)
    faded = scene.model.geom_rgba[:, 3] < before
    assert set(np.flatnonzero(faded).tolist()) == hiding
    np.testing.assert_allclose(scene.model.geom_rgba[faded, 3], FADED * before[faded], rtol=1e-6)
    names = {mujoco.mj_id2name(scene.model, mujoco.mjtObj.mjOBJ_GEOM, geom) for geom in hiding}
    assert not names & {"needle", "gantrysim bead"}
    assert sight.hidden_share(flight.framing) <= 0.25


def test_a_plate_over_the_work_is_found_and_looked_past(gantry):
    """A roof on the carriage hides the bead from all sides: as much of it as is there is found."""
    job, run, _ = gantry
    machine = job.built_machine
    spec = machine.spec.copy()
    spec.body("carriage").add_geom(
        name="roof", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.4, 0.4, 0.001], pos=[0.1, 0.1, 0.06], mass=0
    )
    model = spec.compile()
    sight = Sight(model, machine, run, SHAPE)
    framing = sight.framing()
    assert sight.hidden_share(framing) > 0.9
    assert model.geom("roof").id in sight.hiding(framing)


def test_a_flight_goes_from_the_overview_to_the_bead_without_a_turn_the_long_way():
    start = View(np.zeros(3), 2.0, 170.0, -20.0, 25.0)
    end = View(np.ones(3), 0.5, -170.0, -35.0, 35.0)
    middle = start.towards(end, 0.5)
    assert middle.azimuth == pytest.approx(180.0)
    assert middle.distance == pytest.approx(1.0)  # geometric mean
    for share, view in ((0.0, start), (1.0, end)):
        arrived = start.towards(end, share)
        assert arrived.distance == pytest.approx(view.distance)
        np.testing.assert_allclose(arrived.centre, view.centre)
        assert np.cos(np.radians(arrived.azimuth - view.azimuth)) == pytest.approx(1.0)


def test_the_first_frame_of_a_flight_is_the_overview(gantry):
    job, _, scene = gantry
    scene.pose(0)
    view = Flight(scene, job.built_machine, SHAPE).view(0.0)
    number = scene.camera().fixedcamid
    forward = -scene.data.cam_xmat[number].reshape(3, 3)[:, 2]
    azimuth, elevation = np.radians([view.azimuth, view.elevation])
    looks = [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    np.testing.assert_allclose(looks, forward, atol=1e-6)
    place = view.centre - view.distance * forward
    np.testing.assert_allclose(place, scene.data.cam_xpos[number], atol=1e-6)
    assert view.field == pytest.approx(scene.model.cam_fovy[number])


@pytest.mark.parametrize("corner", [(1, -1), (-1, -1), (1, 1), (-1, 1)])
def test_the_inset_takes_the_corner_without_glue(gantry, corner):
    _, _, scene = gantry

    class Placed:
        def in_picture(self, shape):
            corners = np.array([(1, -1), (-1, -1), (1, 1), (-1, 1)])
            return 0.8 * corners[~np.all(corners == corner, axis=1)]

    inset = Inset.of(scene, Placed(), (960, 540))
    assert (inset.viewport.left == 0) == (corner[0] < 0)
    assert (inset.viewport.bottom == 0) == (corner[1] < 0)
    assert Inset.of(scene, Placed(), (300, 200)) is None


def test_a_film_begins_with_the_machine_and_ends_at_the_bead():
    job = Job.load("softmc-arc")
    run = job.run()
    with Film([Take(job.built_machine, run, bead=job.bead)], size=(480, 360)) as film:
        shares = [film._flight_share(time, 1.0) for time in (0.0, 0.3, 3.0, film.end)]
        assert shares == [0.0, 0.0, 1.0, 1.0]
        assert film._flight_share(0.0, None) == 1.0  # a single picture
        np.testing.assert_array_equal(film.frame(film.end), film.frame(film.end, None))


@pytest.mark.parametrize("sizes", [(50,), (7000,), (7001, 4999, 3)])
def test_a_framing_looks_at_places_evenly_from_all_runs(sizes):
    """Those that every so many rows of all places with glue give, or all places of a run without glue."""
    random = np.random.default_rng(1)
    runs = [
        SimpleNamespace(nozzle=random.normal(size=(size, 3)), dispense=random.random(size) < 0.7, time=np.arange(size))
        for size in sizes
    ]
    runs[-1].dispense[:] = False
    places = np.concatenate([run.nozzle[run.dispense] if run.dispense.any() else run.nozzle for run in runs])
    expected = 1e-3 * places[:: max(1, len(places) // 2000)]
    np.testing.assert_array_equal(Framing.of(runs, 30.0).points, expected)


def test_runs_of_different_machines_have_no_framing_in_common():
    """A bead of one may lie where the other has none."""
    takes = []
    for machine in ("xy", "xyz"):
        program = {"controller": "linuxcnc.Program", "text": "G21 G90 G1 X20 F3000\nY10\nM2\n"}
        content = {"name": "corner", "machine": machine, "program": program, "dispenser": {"area": 1.0}}
        job = Job.of_content(content, "job corner")
        takes.append(Take(job.built_machine, job.follow()))
    assert _common_framing(takes, (640, 360)) is None
    assert _common_framing([takes[0], takes[0]], (640, 360)) is not None


def test_runs_of_one_machine_are_all_in_their_framing():
    jobs = [
        Job.load("an225", {"program.start": [x, 0.0], "program.diameter": 30.0, "program.turns": 1})
        for x in (-60.0, 60.0)
    ]
    takes = [Take(job.built_machine, job.follow()) for job in jobs]
    for order in (takes, takes[::-1]):
        points = _common_framing(order, (640, 360)).points
        for take in takes:
            laid = 1e-3 * take.run.nozzle[take.run.dispense]
            assert points[:, 0].min() <= laid[:, 0].min() + 1e-3
            assert points[:, 0].max() >= laid[:, 0].max() - 1e-3


def test_a_bead_seen_from_near_is_lit_without_shadows():
    job = Job.load("an225", {"program.turns": 1})
    with Film([Take(job.built_machine, job.follow())], size=(320, 180)) as film:
        (model,) = film.models
        near, far = (film.frame(time, 1.0) for time in (film.end, 0.0))
        model.light_castshadow[:] = False
        np.testing.assert_array_equal(film.frame(film.end, 1.0), near)
        assert not np.array_equal(film.frame(0.0, 1.0), far)
