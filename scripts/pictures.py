"""Draw the README's pictures anew into pictures/: every job on its machine, plots of a run, of a study, of a tuning."""

import shutil
import tempfile
from pathlib import Path

import imageio.v2 as imageio

from gantrysim import Bead, Job
from gantrysim.job import builtin_jobs
from gantrysim.metrics import Analysis
from gantrysim.plots import save_plots
from gantrysim.render import Renderer
from gantrysim.study.loop import LoopStudy
from gantrysim.study.study import run_study
from gantrysim.tuning import TuningStudy

FOLDER = Path(__file__).parent.parent / "pictures"
PLOTTED, TUNED = "an225", "fanuc-spiral"
PLOTS = ("budget", "plan", "spacing", "bead")
SIZE, SMALL = (960, 720), (640, 480)
SHARE = 0.74  # of the run, at which the machine is shown

FOLDER.mkdir(exist_ok=True)
for name in builtin_jobs():
    job = Job.load(name)
    run = job.run()
    with Renderer(job.built_machine, run, "overview", SIZE if name == PLOTTED else SMALL, job.bead) as renderer:
        imageio.imwrite(FOLDER / f"{name}.png", renderer.frame(int(SHARE * len(run.time))))
    if name == PLOTTED:
        with tempfile.TemporaryDirectory() as scratch:
            analysis = Analysis(run)
            for plot in save_plots(analysis, Path(scratch), Bead(run, job.bead, analysis)):
                if plot.stem in PLOTS:
                    shutil.copy(plot, FOLDER / f"{name}-{plot.name}")

for study, plot, picture in (
    (LoopStudy(Job.load(PLOTTED)), "loop_period", "study-loop"),
    (TuningStudy(Job.load(TUNED)), "path", "tuned"),
):
    with tempfile.TemporaryDirectory() as scratch:
        run_study(study, Path(scratch))
        shutil.copy(Path(scratch) / "plots" / f"{plot}.png", FOLDER / f"{picture}.png")
