"""Films of runs, from their records: machine and growing bead, with readout and error strip; one run, two, or four."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from gantrysim.bead import BeadSettings
from gantrysim.errors import InputError, finite, positive
from gantrysim.machine.machine import Machine
from gantrysim.render.colours import scale_for
from gantrysim.render.encoding import film_rate, film_writer, save_picture
from gantrysim.render.header import Header, headers
from gantrysim.render.lettering import PAPER, rgb
from gantrysim.render.opengl import Closing
from gantrysim.render.overlay import Panel, run_colours
from gantrysim.render.readout import Readout
from gantrysim.render.renderer import Image, Renderer, checked_size
from gantrysim.run import Run

_LONGEST = 60.0  # of a film whose speed is not asked for [s]
_MOST_FRAMES = 100_000  # of a film
_LEAST_HIGH = 40  # of the pictures [pixels]
_SIZES = {1: (960, 720), 2: (1280, 640), 4: (1280, 960)}
COUNTS = tuple(_SIZES)  # of runs that a film can show
_GAP = 4  # between pictures side by side [pixels]


@dataclass(frozen=True, eq=False)
class Take:
    """A run to be filmed.

    Attributes:
        machine: that ran.
        run: the record.
        label: what it is called; by default by its machine's name.
        bead: how the glue lies.
    """

    machine: Machine
    run: Run
    label: str = ""
    bead: BeadSettings | None = None


@dataclass(frozen=True)
class Cell:
    """Where a take's picture stands in the frame.

    Attributes:
        left, top: its first column and row.
        width, height: its size [pixels].
    """

    left: int
    top: int
    width: int
    height: int

    def of(self, frame: Image) -> Image:
        """Return this part of a frame."""
        return frame[self.top : self.top + self.height, self.left : self.left + self.width]


class Film(Closing):
    """Frames of one run, or of two or four side by side, at the same time of the run. Use it as a context manager.

    Two runs stand one above the other where the frame is higher than wide.

        with Film([Take(machine, slow, "T = 1 s"), Take(machine, fast, "T = 0.01 s")]) as film:
            film.save("comparison.mp4", speed=4)

    A run that is over before the others keeps its last picture, and its readout says so.

    Args:
        takes: the runs.
        camera: name of a camera of the machines, as for `Renderer`.
        size: width and height of the frames, all included; by default one that suits the number of runs [pixels].
        colour: what the colour of the beads tells, one of `gantrysim.render.colours.COLOURS`, on one scale.

    Attributes:
        size: width and height of the frames [pixels].
        end: time at which the longest run ends [s].
        cells: where each run's picture stands.
        panel: what stands below the pictures, at the bottom of the frame.

    Raises:
        InputError: another number of runs, no such camera or colour, or too small a size.
        NoOpenGLError: no EGL and no OSMesa.
    """

    def __init__(
        self,
        takes: Sequence[Take],
        *,
        camera: str | None = None,
        size: tuple[int, int] | None = None,
        colour: str = "plain",
    ) -> None:
        if len(takes) not in _SIZES:
            raise InputError(f"number of runs = {len(takes)}: must be 1, 2 or 4")
        width, height = _SIZES[len(takes)] if size is None else size
        self.size = width, height = checked_size("film", (width, height))
        self._readouts = [Readout(take.run) for take in takes]
        self.end = max(float(take.run.time[-1]) for take in takes)
        scale = scale_for(colour, [take.run for take in takes], [take.bead for take in takes])
        labels = [take.label or take.machine.name for take in takes]
        self.panel = Panel(self._readouts, self.size, labels[0], scale)
        panel = self.panel.size[1]
        self._headers: list[Header] = []
        self.cells: tuple[Cell, ...] = (Cell(0, 0, width, height - panel),)
        rows = 1
        if len(takes) > 1:
            rows = len(takes) if len(takes) == 2 and height > width else len(takes) // 2
            self.cells = self._places(labels, rows, height - panel)
        least = panel + rows * (self.cells[0].top + _LEAST_HIGH)
        if height < least:
            raise InputError(f"height of the film = {height}: must be at least {least}, for the pictures")
        with ExitStack() as opened:
            self._renderers = [
                opened.enter_context(
                    Renderer(take.machine, take.run, camera, (cell.width, cell.height), take.bead, colour, scale)
                )
                for take, cell in zip(takes, self.cells, strict=True)
            ]
            self._opened = opened.pop_all()

    def _places(self, labels: Sequence[str], rows: int, room: int) -> tuple[Cell, ...]:
        """Make the headers and return the places of the pictures, row by row, in the room above the panel."""
        columns = len(labels) // rows
        wide = (self.size[0] - (columns - 1) * _GAP) // columns
        upright = room > rows * wide
        looks = self._readouts, labels, run_colours(len(labels))
        self._headers = headers(*looks, wide, self.panel.font.size, 2 if upright else 1)
        above = self._headers[0].size[1]
        high = (room - rows * above) // rows
        return tuple(
            Cell(column * (wide + _GAP), row * (above + high) + above, wide, high)
            for row in range(rows)
            for column in range(columns)
        )

    def close(self) -> None:
        """Free the OpenGL contexts."""
        self._opened.close()

    @property
    def models(self) -> tuple[mujoco.MjModel, ...]:
        """The machines with their beads."""
        return tuple(renderer.model for renderer in self._renderers)

    def frame(self, time: float, speed: float | None = None) -> Image:
        """Return the frame at a time of the run, (height, width, 3).

        Args:
            time: from 0 to `end` [s].
            speed: seconds of the run in a second of the film, to be shown; None in a picture that stands still.

        Raises:
            InputError: a time before or after the runs.
        """
        self._check(time)
        width, height = self.size
        frame = np.empty((height, width, 3), np.uint8)
        frame[:] = rgb(PAPER)
        for cell, renderer, readout in zip(self.cells, self._renderers, self._readouts, strict=True):
            cell.of(frame)[:] = renderer.frame(readout.tick(time))
        for cell, header in zip(self.cells, self._headers, strict=False):  # one run has none
            Cell(cell.left, cell.top - header.size[1], *header.size).of(frame)[:] = header.picture(time)
        frame[height - self.panel.size[1] :] = self.panel.picture(time, speed)
        return frame

    def _check(self, time: float) -> None:
        if not 0 <= finite("time", time, "s") <= self.end:
            raise InputError(f"time = {time:g} s: must be from 0 s to the end of the run, {self.end:g} s")

    def times(self, fps: float, speed: float) -> list[float]:
        """Return the times of the run that a film shows [s]: speed / fps apart, the last one the end of the run.

        Raises:
            InputError: numbers that are not above 0, or that make too many frames.
        """
        step = positive("speed of the film", speed) / positive("frames per second", fps, "1/s")
        frames = self.end * fps / speed
        if frames > _MOST_FRAMES:
            raise InputError(
                f"number of frames = {frames:.6g}, with {fps:g} frames per second and speed {speed:g}: must be at most "
                f"{_MOST_FRAMES}: ask for fewer frames per second or a higher speed"
            )
        steps = int(np.ceil(self.end / step - 1e-9))
        return [*(k * step for k in range(steps)), self.end]

    def save(
        self,
        file: str | os.PathLike[str],
        *,
        fps: float = 25.0,
        speed: float | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> int:
        """Write the film and return its number of frames; on failure an earlier file stays as it is.

        Args:
            file: to write, .mp4 or .gif. A GIF counts time in hundredths of a second: it gets the nearest frames per
                second that it can say, and shows the right times at these.
            fps: frames per second.
            speed: seconds of the run in a second of the film; by default 1, and more where the film would be longer
                than a minute.
            progress: called after each frame with the share that is done, 0 to 1.

        Raises:
            InputError: another suffix, no such folder, odd numbers of pixels of an MP4, numbers that are not above
                0, or that make more frames than 100,000.
        """
        target = Path(file)
        rate = film_rate(target, fps)
        playing = max(1.0, float(np.ceil(self.end / _LONGEST))) if speed is None else speed
        times = self.times(rate, playing)

        def samples() -> list[Image]:
            return [self.frame(times[k * (len(times) - 1) // 2], playing) for k in range(3)]

        with film_writer(target, rate, self.size, samples) as append:
            for done, time in enumerate(times, 1):
                append(self.frame(time, playing))
                if progress is not None:
                    progress(done / len(times))
        return len(times)

    def save_picture(self, file: str | os.PathLike[str], at: float | None = None) -> None:
        """Write one frame as PNG.

        Args:
            file: to write.
            at: time of the run, by default its end [s].

        Raises:
            InputError: another suffix, no such folder, or a time before or after the runs.
        """
        save_picture(Path(file), self.frame(self.end if at is None else at))


def save_video(
    machine: Machine,
    run: Run,
    file: str | os.PathLike[str],
    *,
    camera: str | None = None,
    size: tuple[int, int] = (800, 600),
    fps: float = 25.0,
    speed: float | None = None,
    bead: BeadSettings | None = None,
    colour: str = "plain",
    label: str = "",
    progress: Callable[[float], None] | None = None,
) -> int:
    """Write a film of one run, MP4 or GIF, and return its number of frames: a `Film` of one take.

    Args:
        machine: the machine that ran.
        run: the record.
        file: to write.
        camera: name of a camera of the machine, as for `Renderer`.
        size: width and height, even numbers of an MP4 [pixels].
        fps: frames per second.
        speed: seconds of the run in a second of video; by default 1, and more where the video would be longer than
            a minute.
        bead: how the glue lies.
        colour: what the bead's colour tells, as for `Film`.
        label: what the run is called, by default by its machine's name.
        progress: called after each frame with the share that is done, 0 to 1.

    Raises:
        InputError: as `Film` and `Film.save` do.
        NoOpenGLError: no EGL and no OSMesa.
    """
    with Film([Take(machine, run, label, bead)], camera=camera, size=size, colour=colour) as film:
        return film.save(file, fps=fps, speed=speed, progress=progress)
