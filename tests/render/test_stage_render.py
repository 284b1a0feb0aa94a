"""The bead on a work that moves."""

import shutil

import mujoco
import numpy as np
import pytest

from gantrysim import Dispenser, Machine, Servo, simulate
from gantrysim.render import Renderer
from gantrysim.render.scene import Scene

from support.pinhole import on_work, to_pixels
from support.runs import round_the_piece
from support.soaked import suite_runs

SIZE = (640, 480)
CAMERA = "nozzle"  # stands still, as the needle does


@pytest.fixture(scope="module")
def stage():
    return Machine("stage")


@pytest.fixture(scope="module")
def run(stage):
    return simulate(stage, Servo.derive(stage.axes), round_the_piece(6.0)[0], dispenser=Dispenser(flow=40.0))


@pytest.mark.parametrize("share", suite_runs([0.3, 0.6, 0.9], 1))
def test_the_bead_lies_where_it_was_laid_on_the_work_that_has_moved_on(stage, run, share):
    tick = int(share * (len(run.time) - 1))
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(run.nozzle, axis=0), axis=1))])
    each = np.searchsorted(length, np.arange(0, length[-1]))  # the ticks of every millimetre
    with Renderer(stage, run, CAMERA, SIZE) as renderer:
        picture = renderer.frame(tick).astype(int)
        places = to_pixels(
            renderer, on_work(stage, renderer, run.nozzle[each] - [0, 0, 0.2])
        )  # in the upper half of the bead
    red, green, blue = np.moveaxis(picture, 2, 0)
    glue = (red > 1.35 * green) & (green > 1.35 * blue) & (red > 60)  # in the shadow, too
    inside = (np.abs(places - np.divide(SIZE, 2)) < np.divide(SIZE, 2) - 12).all(axis=1)
    behind = np.linalg.norm(run.nozzle[each] - run.nozzle[tick], axis=1) < 6  # the needle stands before it
    laid = each < tick
    column, row = np.round(places[inside & ~behind & laid]).astype(int).T
    assert len(row) > 20
    assert glue[row, column].mean() > 0.9
    ahead = (
        inside & ~laid & (np.linalg.norm(run.nozzle[each, None] - run.nozzle[None, :tick:10], axis=2).min(axis=1) > 5)
    )
    column, row = np.round(places[ahead]).astype(int).T
    assert not glue[row, column].any()


@pytest.mark.parametrize("share", [0.2, 0.45, 0.8])
def test_the_drop_hangs_at_the_needle_however_the_work_is_turned(stage, run, share):
    scene = Scene(stage, run)
    scene.pose(int(share * (len(run.time) - 1)))
    assert abs(scene.data.joint("th").qpos[0]) > 0.4
    drawn = mujoco.MjvScene(scene.model, maxgeom=100)
    scene.decorate(drawn)
    (drop,) = drawn.geoms[: drawn.ngeom]
    np.testing.assert_allclose(drop.pos[:2], scene.data.site("nozzle").xpos[:2], atol=3e-5)


def test_the_gap_of_the_stage_is_measured_with_its_needle_beside_the_work(stage, tmp_path):
    assert stage.gap == pytest.approx(0.5, abs=1e-6)
    shutil.copytree(stage.source.parent, tmp_path / "models")
    piece = tmp_path / "models" / "parts" / "piece_asset.xml"
    piece.write_text(piece.read_text().replace(" -0.0005", " -0.0013"))
    assert Machine(tmp_path / "models" / "stage.xml").gap == pytest.approx(1.3, abs=1e-6)
