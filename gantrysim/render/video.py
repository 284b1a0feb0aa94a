"""The film of one run in a call."""

from __future__ import annotations

import os
from collections.abc import Callable

from gantrysim.glue.bead import BeadSettings
from gantrysim.glue.bead.trace import BeadTrace
from gantrysim.machine.machine import Machine
from gantrysim.record.run import Run
from gantrysim.render.film import Film, Take


def save_video(
    machine: Machine,
    run: Run,
    file: str | os.PathLike[str],
    *,
    camera: str | None = None,
    size: tuple[int, int] = (800, 600),
    fps: float = 25.0,
    speed: float | None = None,
    bead: BeadSettings | BeadTrace | None = None,
    colour: str | None = None,
    true_width: bool = False,
    label: str = "",
    verdict: str = "",
    progress: Callable[[float], None] | None = None,
) -> int:
    """Write a film of one run, MP4 or GIF, and return its number of frames.

    Arguments and errors as of `Take`, `Film` and `Film.save`.
    """
    take = Take(machine, run, label, bead, verdict)
    with Film([take], camera=camera, size=size, colour=colour, true_width=true_width) as film:
        return film.save(file, fps=fps, speed=speed, progress=progress)
