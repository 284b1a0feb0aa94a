"""Draw the pictures of README and docs/: machines, films, a run's page, studies, sections with a task; all, or some.

python scripts/pictures.py [machines] [films] [page] [studies] [how_to] [own_part] [own_machine]
    [own_controller] [NAME OF A PICTURE OF A STUDY OR OF A PLOT OF A PAGE]
"""

import itertools
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from page_plots import PAGE_PLOTS, titled_block
from PIL import Image
from theory_plots import THEORY_PLOTS

from gantrysim import Job
from gantrysim.render import Film, Renderer, Take
from gantrysim.report.plots.style import sheet
from gantrysim.study.laws import LawsStudy
from gantrysim.study.loop import LoopStudy
from gantrysim.study.run import run_study
from gantrysim.study.tuning import TuningStudy

FOLDER = Path(__file__).parent.parent / "docs" / "pictures"
FIRST = "an225"  # job of the README
JOBS = ("an225-3d", "delta-arc", "fanuc-conical", "fanuc-spiral", "softmc-arc", "softmc-helical", "stage-outline")
SEAL = Path(__file__).parent.parent / "examples" / "seal.ngc"  # of the pages of start
COMPARED = (1.0, 0.01)  # periods of the program loop [s]
ALL_PLOTS = {**PAGE_PLOTS, **THEORY_PLOTS}
# pictures of studies: study, job, plot
STUDIES = {
    "study-loop": (LoopStudy, FIRST, "loop_period"),
    "study-laws": (LawsStudy, "softmc-arc", "ladder"),
    "tuned": (TuningStudy, "fanuc-spiral", "path"),
}
LARGE, SMALL, MOVING = (1280, 720), (640, 360), (640, 360)
RATE, SPEED, HELD = 10, 2.5, 3.0  # of the moving picture: frames per second, speed, and time at its end [s]
SHARE = 0.74  # of the run at which the machine is shown
FINER = 3  # pixels drawn per pixel of a picture and side, to smooth the edges of shadows
SMOOTH = Image.Resampling.LANCZOS
MARGIN = 0.03  # around the machine, of the picture's size
COLOURS = 256  # of a palette
PAPER = (255, 255, 255)  # colour that a palette must have
SCREEN = (1280, 1560)  # of the page [pixels]
CHROMIUM = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--virtual-time-budget=5000"]


def save(image: Image.Image, name: str) -> None:
    """Save a picture with a palette, half of it for frequent colours and half for rare ones."""
    shades = np.unique(np.asarray(image.convert("RGB")).reshape(-1, 3) // 8 * 8, axis=0)
    frequent = image.convert("RGB").quantize(COLOURS // 2).getpalette()
    rare = Image.fromarray(shades[None]).quantize(COLOURS // 2).getpalette()
    palette = Image.new("P", (1, 1))
    colours = [value for half in (frequent, rare) for value in half[: 3 * COLOURS // 2]]
    palette.putpalette([*colours[:-3], *PAPER])
    reduced = image.convert("RGB").quantize(palette=palette, dither=Image.Dither.NONE)
    reduced.save(FOLDER / f"{name}.png", optimize=True)


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


def take(job: Job) -> Take:
    return Take(job.built_machine, job.run(), bead=job.bead)


def last_frame(takes: list[Take], size: tuple[int, int], name: str, colour: str | None = None) -> None:
    """Save the last frame of a film, drawn twice as large."""
    with Film(takes, size=(2 * size[0], 2 * size[1]), colour=colour) as film:
        save(Image.fromarray(film.frame(film.end)).resize(size, SMOOTH), name)


def hold_last_frame(file: Path) -> None:
    """Let a GIF stay at its end: the time of a frame, in hundredths of a second, is bytes 4 and 5 of its control."""
    content = bytearray(file.read_bytes())
    control = content.rindex(b"\x21\xf9\x04")
    content[control + 4 : control + 6] = round(100 * HELD).to_bytes(2, "little")
    file.write_bytes(content)


def draw_machine(job: Job, name: str) -> None:
    run = job.run()
    with Renderer(job.built_machine, run, "overview", (FINER * SMALL[0], FINER * SMALL[1]), job.bead) as renderer:
        picture = Image.fromarray(renderer.frame(int(SHARE * len(run.time))))
        save(picture.resize(SMALL, SMOOTH, machine_box(renderer)), name)


def machines() -> None:
    for name in JOBS:
        draw_machine(Job.load(name), name)


def films() -> None:
    for name in JOBS:
        last_frame([take(Job.load(name))], SMALL, f"{name}-detail")
    job = Job.load(FIRST)
    last_frame([take(job)], LARGE, FIRST)
    takes = [take(Job.load(FIRST, [f"loop_period={period}"])) for period in COMPARED]
    last_frame(takes, (1280, 720), "compared", "error")
    with Film([take(job)], size=MOVING) as film:
        film.save(FOLDER / f"{FIRST}.gif", fps=RATE, speed=SPEED)
    hold_last_frame(FOLDER / f"{FIRST}.gif")


def page() -> None:
    """The upper part of the page of a run, as Chromium shows it."""
    with tempfile.TemporaryDirectory() as scratch:
        subprocess.run(["gantrysim", "run", FIRST, "--out", scratch], check=True)
        picture = Path(scratch) / "page.png"
        size = f"--window-size={SCREEN[0]},{SCREEN[1]}"
        browser = shutil.which("chromium") or "google-chrome"
        command = [browser, *CHROMIUM, f"--user-data-dir={scratch}/chromium", size, f"--screenshot={picture}"]
        subprocess.run([*command, f"file://{scratch}/report.html"], check=True)
        save(Image.open(picture), "page")


def draw_study(name: str) -> None:
    kind, job, plot = STUDIES[name]
    with tempfile.TemporaryDirectory() as scratch:
        run_study(kind(Job.load(job)), Path(scratch))
        save(Image.open(Path(scratch) / "plots" / f"{plot}.png"), name)


def studies() -> None:
    for name in STUDIES:
        draw_study(name)


def draw_page_plot(name: str) -> None:
    draw, width, height = ALL_PLOTS[name]
    with tempfile.TemporaryDirectory() as scratch, sheet(width, height) as figure:
        draw(figure)
        picture = Path(scratch) / "plot.png"
        figure.savefig(picture)
        save(Image.open(picture), name)


def how_to() -> None:
    for name in ALL_PLOTS:
        draw_page_plot(name)


def own_part() -> None:
    slow_valve = Job.load(SEAL).changed({"dispenser.opening": 0.05, "dispenser.closing": 0.05})
    last_frame([take(slow_valve)], SMALL, "start-seal")


def own_machine() -> None:
    """The machine of the table that a page shows."""
    with tempfile.TemporaryDirectory() as scratch:
        table = Path(scratch) / "gantry.toml"
        table.write_text(titled_block("start/own-machine.md", "gantry.toml"), encoding="utf-8")
        draw_machine(Job.load(SEAL, [f'machine="{table}"']), "start-machine")


def own_controller() -> None:
    """The bead of the job that a page shows with its controller."""
    with tempfile.TemporaryDirectory() as scratch:
        for file in ("wave.py", "wave.toml"):
            (Path(scratch) / file).write_text(titled_block("controllers.md", file), encoding="utf-8")
        job = Job.load(Path(scratch) / "wave.toml", allow_code=True)
        last_frame([take(job)], SMALL, "how-to-controller")


PARTS = {
    part.__name__: part for part in (machines, films, page, studies, how_to, own_part, own_machine, own_controller)
}

FOLDER.mkdir(exist_ok=True)
for part_name in sys.argv[1:] or PARTS:
    if part_name in ALL_PLOTS:
        draw_page_plot(part_name)
    elif part_name in STUDIES:
        draw_study(part_name)
    else:
        PARTS[part_name]()
