"""Geoms left out of a scene and put in another order, against the pictures of MuJoCo's own scene."""

import mujoco
import numpy as np
import pytest

from gantrysim import Dispenser, Servo, simulate
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.machine.machine import Machine
from gantrysim.render import Renderer
from gantrysim.render.renderer import Geoms

from support.soaked import suite_runs

SIZE = (400, 300)
EVERYTHING = mujoco.mjtCatBit.mjCAT_ALL.value
PLANE = mujoco.mjtGeom.mjGEOM_PLANE


@pytest.fixture(scope="module")
def run(xy):
    setpoints = MoveSpiral(100, 2, 15, 100).setpoints(1e-3).hold(0.05)
    return simulate(xy, Servo.derive(xy.axes), setpoints, dispenser=Dispenser(flow=150.0))


def plain(geoms, data, view, scene, shape, *, shadows):
    """A scene as MuJoCo makes it."""
    mujoco.mjv_updateScene(geoms._model, data, mujoco.MjvOption(), None, view, EVERYTHING, scene)


@pytest.mark.parametrize(
    ("camera", "shares"), suite_runs([("overview", [1.0]), ("nozzle", [1.0]), ("bead", [0.0, 0.6, 1.0])], 0)
)
def test_the_pictures_are_those_of_all_geoms_in_the_order_of_the_model(xy, run, camera, shares, monkeypatch):
    tick = len(run.time) // 2
    with Renderer(xy, run, camera, SIZE) as renderer:
        ours = [renderer.frame(tick, share) for share in shares]
        monkeypatch.setattr(Geoms, "update", plain)
        expected = [renderer.frame(tick, share) for share in shares]
    np.testing.assert_array_equal(ours, expected)


def test_a_mirror_shows_what_is_outside_the_picture(run, monkeypatch):
    machine = Machine("xy")
    machine.spec.material("piece").reflectance = 0.5
    with Renderer(machine, run, "bead", SIZE) as renderer:
        ours = renderer.frame(len(run.time) // 2)
        monkeypatch.setattr(Geoms, "update", plain)
        np.testing.assert_array_equal(ours, renderer.frame(len(run.time) // 2))


def test_from_near_most_geoms_are_left_out_and_with_shadows_none(xy, run):
    with Renderer(xy, run, "bead", SIZE) as renderer:
        renderer.frame(len(run.time) - 1)
        drawn = renderer._drawn
        plain(renderer._geoms, renderer.data, renderer.view, drawn, 4 / 3, shadows=False)
        every = drawn.ngeom
        renderer._geoms.update(renderer.data, renderer.view, drawn, 4 / 3, shadows=False)
        assert 0 < drawn.ngeom < 0.7 * every
        renderer._geoms.update(renderer.data, renderer.view, drawn, 4 / 3, shadows=True)
        assert drawn.ngeom == every
        types = [geom.type for geom in drawn.geoms[:every]]
        assert PLANE in types
        assert PLANE not in types[: every - types.count(PLANE)]


@pytest.mark.parametrize("seed", suite_runs([0, 1, 2, 3, 4, 5], 0))
def test_what_is_left_out_is_outside_the_picture(seed):
    """Spheres around a free camera: left out is each whose centre is further outside the frustum than its radius."""
    generator = np.random.default_rng(seed)
    places = generator.uniform(-1, 1, (200, 3))
    radii = generator.uniform(0.01, 0.2, 200)
    balls = "".join(
        f'<geom size="{r}" pos="{x} {y} {z}" contype="0" conaffinity="0"/>'
        for (x, y, z), r in zip(places, radii, strict=True)
    )
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{balls}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    view = mujoco.MjvCamera()
    view.lookat[:] = generator.uniform(-0.5, 0.5, 3)
    view.distance = 0.8
    view.azimuth, view.elevation = generator.uniform(-180, 180), generator.uniform(-80, 80)
    scene = mujoco.MjvScene(model, 1000)
    shape = 1.7
    Geoms(model, []).update(data, view, scene, shape, shadows=False)
    drawn = np.zeros(200, bool)
    drawn[[geom.objid for geom in scene.geoms[: scene.ngeom]]] = True
    # planes of the frustum, with their normals inwards
    azimuth, elevation = np.radians([view.azimuth, view.elevation])
    forward = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    right = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
    up = np.cross(right, forward)
    half = np.radians(0.5 * model.vis.global_.fovy)
    beside = np.arctan(shape * np.tan(half))
    normals = [np.sin(half) * forward + sign * np.cos(half) * up for sign in (1, -1)]
    normals += [np.sin(beside) * forward + sign * np.cos(beside) * right for sign in (1, -1)]
    inwards = (places - (view.lookat - view.distance * forward)) @ np.array([*normals, forward]).T
    np.testing.assert_array_equal(drawn, np.all(inwards > -radii[:, None], axis=1))
    assert 0 < drawn.sum() < 200


def test_groups_that_are_hidden_stay_hidden_and_others_as_they_are(xy, run):
    machine = Machine("xy")
    machine.spec.geom("carriage").group = 3
    with Renderer(machine, run, "overview", SIZE) as renderer:
        machine_geoms = np.delete(np.arange(renderer.model.ngeom), renderer.scene.bead_geoms)
        groups = renderer.model.geom_group[machine_geoms]
        renderer.frame(0)
        drawn = {geom.objid for geom in renderer._drawn.geoms[: renderer._drawn.ngeom]}
        assert renderer.model.geom("carriage").id not in drawn
        np.testing.assert_array_equal(renderer.model.geom_group[machine_geoms], groups)


@pytest.mark.parametrize(("size", "side"), suite_runs([((400, 300), 512), ((1600, 1200), 1536)], 0))
def test_shadows_are_as_fine_as_the_picture_shows_them_and_no_finer_than_the_machine_has_them(xy, run, size, side):
    with Renderer(xy, run, "bead", size) as renderer:
        assert renderer.model.vis.quality.shadowsize == side
    with Renderer(xy, run, "overview", SIZE) as renderer:
        assert renderer.model.vis.quality.shadowsize == xy.model.vis.quality.shadowsize == 1536
