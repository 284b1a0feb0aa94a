"""Saved runs, and what is to be read off pictures, as several test files need them."""

import dataclasses

import mujoco
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from PIL import Image, ImageDraw

from gantrysim import Job
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.render.fonts import PAPER, font, rgb
from gantrysim.report.folder import write_run
from gantrysim.results.run_results import RunResults

# of films, from the smallest, 9:16 to 32:9
SHAPES = (
    (240, 240), (240, 427), (427, 240), (320, 240), (480, 360), (400, 800), (600, 800), (720, 1280), (1080, 1080),
    (1920, 1080), (2560, 720), (853, 240),
)  # fmt: skip

SMALL = ("diameter=40", "turns=1", "thickness=5")  # 1.5 s of motion


def small_job(*settings):
    return Job.load("an225", (*SMALL, *settings))


def saved(folder, job, run=None):
    """Write the folder of a run, as the command does, and return it."""
    folder.mkdir(parents=True, exist_ok=True)
    budget = Budget(Analysis(job.run() if run is None else run))
    write_run(folder, RunResults(job, job.built_machine, budget))
    return folder


def cut(run, ticks):
    """The first ticks of a run."""
    rows = {
        field.name: getattr(run, field.name)[:ticks]
        for field in dataclasses.fields(run)
        if isinstance(getattr(run, field.name), np.ndarray)
    }
    return dataclasses.replace(run, **rows)


def shows(picture, text, size, colour, bold=False, paper=PAPER):
    """Whether a text stands in a picture, to the last bit, wherever it is."""
    face = font(size, bold).face
    sheet = Image.new("RGB", (round(face.getlength(text)) + 20, 2 * size + 20), paper)
    ImageDraw.Draw(sheet).text((10, size + 10), text, rgb(colour), face, anchor="lm")
    letters = np.asarray(sheet)
    rows, columns = (np.flatnonzero((letters != rgb(paper)).any(axis=2).any(axis=axis)) for axis in (1, 0))
    letters = letters[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    height, width = letters.shape[:2]
    if height > picture.shape[0] or width > picture.shape[1]:
        return False
    # where the first of the pixels that differ most from the paper may be, then all of it
    windows = sliding_window_view(picture, (height, width, 3))[:, :, 0]
    row, column = np.unravel_index(np.abs(letters.astype(int) - rgb(paper)).sum(axis=2).argmax(), (height, width))
    places = np.argwhere((windows[:, :, row, column] == letters[row, column]).all(axis=2))
    return any(np.array_equal(windows[r, c], letters) for r, c in places)


def glue_share(renderer):
    """Share of the pixels of a renderer's last picture, without its inset, whose foremost geom is the bead."""
    inset, renderer._inset = renderer._inset, None
    renderer.frame(len(renderer.scene.run.time) - 1)
    renderer._inset = inset
    flags = renderer._drawn.flags
    numbered = [mujoco.mjtRndFlag.mjRND_SEGMENT.value, mujoco.mjtRndFlag.mjRND_IDCOLOR.value]
    flags[numbered] = 1
    width, height = renderer.size
    picture = np.empty((height, width, 3), np.uint8)
    viewport = mujoco.MjrRect(0, 0, width, height)
    mujoco.mjr_render(viewport, renderer._drawn, renderer._context)
    mujoco.mjr_readPixels(picture, None, viewport, renderer._context)
    flags[numbered] = 0
    numbers = picture.astype(int) @ [1, 2**8, 2**16] - 1  # a segment's colour is its number, and 1 more
    geoms = renderer._drawn.geoms[: renderer._drawn.ngeom]
    beads = renderer.scene.bead_geoms
    segments = [g.segid for g in geoms if g.objtype == mujoco.mjtObj.mjOBJ_GEOM and g.objid in beads]
    glue = np.isin(numbers, segments)
    if inset is not None:
        place = inset.viewport
        glue[place.bottom : place.bottom + place.height, place.left : place.left + place.width] = False
    return float(glue.mean())
