"""Print what a film's frame costs by part: the time of a film less its time without the part, and frames per second.

python scripts/film_cost.py [JOB ...]
"""

import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

from rich.console import Console
from rich.table import Table

from gantrysim import Job
from gantrysim.render import Film, Take, film, renderer

JOBS = ("an225", "softmc-helical")
SIZE = (960, 540)  # as gantrysim run writes it [pixels]
RATE = 25.0  # frames per second
LENGTH = 3.0  # of the film, so that most of it is the bead from near [s]
ROUNDS = 5  # of which the fastest counts
PARTS = ("encoding", "panel and verdict", "smooth edges", "inset", "bead", "the whole picture")


@contextmanager
def no_encoder(*_: Any) -> Iterator[Callable[[object], None]]:
    yield lambda frame: None


def without(part: str, shown: Film) -> ExitStack:
    """Return a context in which a film lacks a part."""
    (drawer,) = shown._renderers
    panel = shown.panel.picture(shown.end, 1.0)
    patches = {
        "encoding": [patch.object(film, "film_writer", no_encoder)],
        "panel and verdict": [
            patch.object(shown.panel, "picture", lambda *_: panel),
            patch.object(shown._captions[0], "write", lambda frame: None),
        ],
        "smooth edges": [patch.object(renderer, "smoothed", lambda picture: picture)],
        "inset": [patch.object(drawer, "_inset", None)],
        "bead": [patch.object(drawer.scene, "draw_bead", lambda *_, **__: [])],
        "the whole picture": [patch.object(drawer, "frame", lambda *_: 0)],
    }
    context = ExitStack()
    for change in patches.get(part, []):
        context.enter_context(change)
    return context


def durations(shown: Film, file: Path) -> dict[str, float]:
    """Return the times of a frame of a whole film and of one without each part, in turns, the shortest of each [ms]."""
    times: dict[str, list[float]] = {part: [] for part in ("", *PARTS)}
    for _ in range(ROUNDS):
        for part, measured in times.items():
            with without(part, shown):
                start = time.perf_counter()
                frames = shown.save(file, fps=RATE, speed=shown.end / LENGTH)
                measured.append(1e3 * (time.perf_counter() - start) / frames)
    return {part: min(measured) for part, measured in times.items()}


warnings.filterwarnings("ignore", module="glfw")  # MuJoCo tries it before what needs no display
table = Table("job", "part", "ms a frame", "frames/s")
for name in sys.argv[1:] or JOBS:
    job = Job.load(name)
    run = job.run()
    take = Take(job.built_machine, run, name, job.bead, run.known_verdict)
    with Film([take], size=SIZE) as shown, tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "film.mp4"
        shown.frame(shown.end)  # compiles
        times = durations(shown, file)
        whole = times.pop("")
        table.add_row(name, "whole", f"{whole:.1f}", f"{1e3 / whole:.1f}")
        for part, remaining in times.items():
            table.add_row("", part, f"{whole - remaining:.1f}", "")
Console().print(table)
