"""Video of a run, from its record: the machine, and the bead growing behind the nozzle."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from gantrysim.bead import BeadSettings
from gantrysim.errors import InputError, positive
from gantrysim.machine import Machine
from gantrysim.render.renderer import Renderer
from gantrysim.run import Run

__all__ = ["save_video"]

_LONGEST_VIDEO = 60.0  # [s]


def save_video(
    machine: Machine,
    run: Run,
    file: Path,
    *,
    camera: str | None = None,
    size: tuple[int, int] = (800, 600),
    fps: float = 25.0,
    speed: float | None = None,
    bead: BeadSettings | None = None,
    progress: Callable[[float], None] | None = None,
) -> int:
    """Write an MP4 of a run and return its number of frames.

    Args:
        machine: the machine that ran.
        run: the record.
        file: to write.
        camera: name of a camera of the machine, as for `Renderer`.
        size: width and height, even numbers [pixels].
        fps: frames per second.
        speed: seconds of the run in a second of video; by default 1, and more where the video would be longer than
            a minute.
        bead: how the glue lies.
        progress: called after each frame with the share that is done, 0 to 1.
    """
    import imageio.v2 as imageio

    if any(value % 2 for value in size):
        raise InputError(f"size of the video = {size[0]} x {size[1]}: must be even numbers of pixels")
    if speed is None:
        speed = max(1.0, float(np.ceil(run.time[-1] / _LONGEST_VIDEO)))
    per_frame = positive("speed of the video", speed) / positive("frames per second", fps, "1/s")
    ticks = list(_frame_ticks(run, per_frame))
    with (
        Renderer(machine, run, camera, size, bead) as renderer,
        imageio.get_writer(file, fps=fps, codec="libx264", quality=8, macro_block_size=1) as writer,
    ):
        for done, tick in enumerate(ticks, 1):
            writer.append_data(renderer.frame(tick))
            if progress is not None:
                progress(done / len(ticks))
    return len(ticks)


def _frame_ticks(run: Run, per_frame: float) -> Iterator[int]:
    for k in range(round(float(run.time[-1]) / per_frame) + 1):
        yield min(round(k * per_frame / run.period), len(run.time) - 1)
