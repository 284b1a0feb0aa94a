"""Draw the pictures of docs/: every job on its machine, plots of a run, a study and a tuning."""

import itertools
import shutil
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from gantrysim import Bead, Job
from gantrysim.metrics.analysis import Analysis
from gantrysim.plots import save_plots
from gantrysim.render import Film, Renderer, Take
from gantrysim.study.laws import LawsStudy
from gantrysim.study.loop import LoopStudy
from gantrysim.study.run import run_study
from gantrysim.tuning import TuningStudy

FOLDER = Path(__file__).parent.parent / "docs" / "pictures"
PLOTTED, TUNED = "an225", "fanuc-spiral"
COMPARED = (1.0, 0.01)  # periods of the program loop [s]
PLOTS = ("budget", "plan", "spacing", "bead")
SIZE, SMALL, FILMED, ANIMATED = (960, 720), (640, 480), (1280, 960), (560, 460)
SHARE = 0.74  # of the run at which the machine is shown
# Picture of each job's bead: camera, share of the run, and whether it is a film frame coloured by error.
DETAILS = {
    "an225": ("nozzle", 0.74, False),
    "an225-3d": ("nozzle", 0.74, False),
    "delta-arc": ("top", 0.7, True),
    "fanuc-conical": ("nozzle", 0.25, False),
    "fanuc-spiral": ("top", 0.87, True),
    "softmc-arc": ("top", 0.7, True),
    "softmc-helical": ("nozzle", 0.27, False),
    "stage-outline": ("nozzle", 0.74, False),
}
FINER = 3  # pixels drawn per pixel of a picture and side, to smooth the edges of shadows
SMOOTH = Image.Resampling.LANCZOS
MARGIN = 0.03  # around the machine, of the picture's size
COLOURS = 256  # of a palette


def save(image: Image.Image, name: str) -> None:
    """Save a picture; a small one with a palette, half of it for frequent colours and half for rare ones."""
    if image.width >= SIZE[0]:
        image.save(FOLDER / f"{name}.png", optimize=True)
        return
    shades = np.unique(np.asarray(image).reshape(-1, 3) // 8 * 8, axis=0)
    halves = [each.quantize(COLOURS // 2).getpalette() for each in (image, Image.fromarray(shades[None]))]
    palette = Image.new("P", (1, 1))
    palette.putpalette([value for half in halves for value in half[: 3 * COLOURS // 2]])
    image.quantize(palette=palette, dither=Image.Dither.NONE).save(FOLDER / f"{name}.png", optimize=True)


def machine_box(renderer: Renderer) -> tuple[float, ...]:
    """Return the smallest part of a picture, of its proportions, with the machine: left, top, right, bottom."""
    model, data, camera = renderer.model, renderer.data, renderer.view.fixedcamid
    drawn = (model.geom_rbound > 0) & (model.geom_group == 2)  # no floor, no bead
    signs = np.array(list(itertools.product((-1, 1), repeat=3)))
    corners = model.geom_aabb[drawn, None, :3] + signs * model.geom_aabb[drawn, None, 3:]
    world = np.einsum("gij,gcj->gci", data.geom_xmat[drawn].reshape(-1, 3, 3), corners) + data.geom_xpos[drawn, None]
    local = (world.reshape(-1, 3) - data.cam_xpos[camera]) @ data.cam_xmat[camera].reshape(3, 3)
    size = np.array(renderer.size)
    focal = 0.5 * size[1] / np.tan(0.5 * np.radians(model.cam_fovy[camera]))
    places = 0.5 * size + focal * local[:, :2] * [1, -1] / -local[:, 2:]
    low, high = places.min(axis=0) - MARGIN * size, places.max(axis=0) + MARGIN * size
    box = size * min(1.0, ((high - low) / size).max())
    corner = np.clip(0.5 * (low + high - box), 0, size - box)
    return (*corner, *(corner + box))


FOLDER.mkdir(exist_ok=True)
for name in DETAILS:
    job = Job.load(name)
    run, machine, size = job.run(), job.built_machine, SIZE if name == PLOTTED else SMALL
    with Renderer(machine, run, "overview", (FINER * size[0], FINER * size[1]), job.bead) as renderer:
        picture = Image.fromarray(renderer.frame(int(SHARE * len(run.time))))
        save(picture.resize(size, SMOOTH, machine_box(renderer)), name)
    camera, share, filmed = DETAILS[name]
    if filmed:
        with Film([Take(machine, run, name, job.bead)], camera=camera, size=FILMED, colour="error") as film:
            picture = Image.fromarray(film.frame(share * film.end))
    else:
        with Renderer(machine, run, camera, (FINER * SMALL[0], FINER * SMALL[1]), job.bead) as renderer:
            picture = Image.fromarray(renderer.frame(int(share * len(run.time))))
    save(picture.resize(SMALL, SMOOTH), f"{name}-detail")
    if name == PLOTTED:
        with tempfile.TemporaryDirectory() as scratch:
            analysis = Analysis(run)
            for plot in save_plots(analysis, Path(scratch), Bead(run, job.bead, analysis)):
                if plot.stem in PLOTS:
                    shutil.copy(plot, FOLDER / f"{name}-{plot.name}")

jobs = [Job.load(PLOTTED, [f"loop_period={period}"]) for period in COMPARED]
takes = [Take(job.built_machine, job.run(), f"T = {period:g} s") for job, period in zip(jobs, COMPARED, strict=True)]
with Film(takes, camera="top", colour="error") as film:
    save(Image.fromarray(film.frame(SHARE * film.end)), "compared")
job = Job.load(PLOTTED)
with Film([Take(job.built_machine, job.run(), PLOTTED, job.bead)], size=ANIMATED, colour="error") as film:
    film.save(FOLDER / f"{PLOTTED}.gif", fps=12.5, speed=4)

for study, plot, picture_name in (
    (LoopStudy(Job.load(PLOTTED)), "loop_period", "study-loop"),
    (LawsStudy(Job.load("softmc-arc")), "ladder", "study-laws"),
    (TuningStudy(Job.load(TUNED)), "path", "tuned"),
):
    with tempfile.TemporaryDirectory() as scratch:
        run_study(study, Path(scratch))
        shutil.copy(Path(scratch) / "plots" / f"{plot}.png", FOLDER / f"{picture_name}.png")
