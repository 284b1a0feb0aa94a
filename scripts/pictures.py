"""Draw the README's pictures anew into pictures/."""

import shutil
import tempfile
from pathlib import Path

import imageio.v2 as imageio

from gantrysim import Job
from gantrysim.metrics import Analysis
from gantrysim.plots import save_plots
from gantrysim.render import Renderer

FOLDER = Path(__file__).parent.parent / "pictures"
SIZE = (960, 720)
SHARE = 0.74  # of the run, at which the machine is shown

job = Job.load("an225")
run = job.run()
FOLDER.mkdir(exist_ok=True)
with Renderer(job.built_machine, run, "overview", SIZE) as renderer:
    imageio.imwrite(FOLDER / "an225.png", renderer.frame(int(SHARE * len(run.time))))
with tempfile.TemporaryDirectory() as scratch:
    for plot in save_plots(Analysis(run), Path(scratch)):
        shutil.copy(plot, FOLDER / f"an225-{plot.name}")
