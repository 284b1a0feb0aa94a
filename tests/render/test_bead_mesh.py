"""The bead's mesh in pieces: what has been uploaded for a picture, against the whole mesh."""

import dataclasses

import numpy as np
import pytest

from gantrysim import Dispenser, Servo, simulate
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.glue.bead import BeadSettings
from gantrysim.render import Renderer
from gantrysim.render.colours import scale_for
from gantrysim.render.scene import Scene, mesh_part

SIZE = (240, 180)
PAUSE = slice(2000, 2400)  # ticks without glue
PARTS = ("vert", "normal", "texcoord")


@pytest.fixture(scope="module")
def run(xy):
    """A spiral in two stretches of glue."""
    setpoints = MoveSpiral(100, 2, 15, 100).setpoints(1e-3).hold(0.05)
    run = simulate(xy, Servo.derive(xy.axes), setpoints, dispenser=Dispenser(flow=150.0))
    flow = run.flow.copy()
    flow[PAUSE] = 0.0
    return dataclasses.replace(run, flow=flow)


def corners(model, mesh, parts):
    """Vertices, normals and texture coordinates of the corners of a mesh's triangles that have an area, (f, 24)."""
    start = model.mesh_faceadr[mesh]
    faces = model.mesh_face[start : start + model.mesh_facenum[mesh]]
    vertices = parts["vert"][faces]
    sides = np.roll(vertices, 1, axis=1) - vertices
    solid = np.all(np.any(sides != 0, axis=2), axis=1)
    return np.concatenate([parts[part][faces].reshape(len(faces), -1) for part in PARTS], axis=1)[solid]


def parts_of(model, mesh):
    return {part: mesh_part(model, mesh, part).copy() for part in PARTS}


def in_order(rows):
    return rows[np.lexsort(rows.T)]


def test_what_is_shown_of_the_uploaded_pieces_is_the_bead_of_every_picture_in_any_order(xy, run):
    scale = scale_for("error", [run])
    whole = Scene(xy, run, BeadSettings(), colour="error", scale=scale)
    scene = Scene(xy, run, BeadSettings(), colour="error", scale=scale, in_pieces=True)
    assert len(scene.bead_geoms) > 10
    last = len(run.time) - 1
    uploaded = {}
    ticks = [
        0,
        300,
        301,
        PAUSE.stop - 10,
        PAUSE.stop + 300,
        PAUSE.stop - 10,
        last,
        last // 3,
        last // 2,
        last // 2,
        last,
    ]
    for tick in ticks:
        scene.pose(tick)
        for mesh in scene.draw_bead():
            uploaded[mesh] = parts_of(scene.model, mesh)
        shown = [scene.model.geom_dataid[geom] for geom in scene.bead_geoms if scene.model.geom_group[geom] == 0]
        pieces = np.concatenate([corners(scene.model, mesh, uploaded[mesh]) for mesh in shown])
        whole.pose(tick)
        expected = corners(whole.model, whole.mesh, parts_of(whole.model, whole.mesh))
        np.testing.assert_array_equal(in_order(pieces), in_order(expected))
        np.testing.assert_array_equal(mesh_part(whole.model, whole.mesh, "vert"), whole.sweep.mesh(tick).vertices)


def test_a_growing_bead_uploads_the_piece_with_its_end_and_what_stays_nothing(xy, run):
    scene = Scene(xy, run, in_pieces=True)
    for tick in range(0, len(run.time) - 60, 40):
        scene.pose(tick)
        uploads = scene.draw_bead()
        assert len(uploads) <= 2 or tick == 0
        if 500 <= tick < PAUSE.start:
            assert uploads
        if PAUSE.start + 50 <= tick < PAUSE.stop:
            assert uploads == []
        assert scene.draw_bead() == []


def test_frames_do_not_depend_on_those_before(xy, run):
    last = len(run.time) - 1
    frames = []
    with Renderer(xy, run, "bead", SIZE) as renderer:
        for tick in (0, last, last // 3, last // 2):
            renderer.frame(tick)
        frames = [renderer.frame(last // 2), renderer.frame(last // 4)]
    for tick, frame in zip((last // 2, last // 4), frames, strict=True):
        with Renderer(xy, run, "bead", SIZE) as renderer:
            np.testing.assert_array_equal(renderer.frame(tick), frame)
