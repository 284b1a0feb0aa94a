"""Draw the README's pictures anew into pictures/: every built-in job on its machine, and the plots of one."""

import shutil
import tempfile
from pathlib import Path

import imageio.v2 as imageio

from gantrysim import Job
from gantrysim.job import builtin_jobs
from gantrysim.metrics import Analysis
from gantrysim.plots import save_plots
from gantrysim.render import Renderer

FOLDER = Path(__file__).parent.parent / "pictures"
PLOTTED = "an225"
SIZE, SMALL = (960, 720), (640, 480)
SHARE = 0.74  # of the run, at which the machine is shown

FOLDER.mkdir(exist_ok=True)
for name in builtin_jobs():
    job = Job.load(name)
    run = job.run()
    with Renderer(job.built_machine, run, "overview", SIZE if name == PLOTTED else SMALL) as renderer:
        imageio.imwrite(FOLDER / f"{name}.png", renderer.frame(int(SHARE * len(run.time))))
    if name == PLOTTED:
        with tempfile.TemporaryDirectory() as scratch:
            for plot in save_plots(Analysis(run), Path(scratch)):
                shutil.copy(plot, FOLDER / f"{name}-{plot.name}")
