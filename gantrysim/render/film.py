"""Films of one, two or four runs: the machine and the growing bead, with readout, error strip, and verdicts last."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from PIL import Image, ImageDraw

from gantrysim.base import memory
from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, finite, positive
from gantrysim.glue.bead import BeadSettings
from gantrysim.glue.bead.trace import BeadTrace
from gantrysim.machine.machine import Machine
from gantrysim.record.run import Run
from gantrysim.render.camera import Framing, Sight
from gantrysim.render.colours import chosen_colour, scale_for
from gantrysim.render.encoding import Picture, film_rate, film_writer, save_picture
from gantrysim.render.fonts import LINE, PAPER, font, rgb
from gantrysim.render.header import Caption, Header, differences, headers
from gantrysim.render.opengl import Closing
from gantrysim.render.panel import Panel, run_colours
from gantrysim.render.renderer import BEAD, Renderer, checked_size
from gantrysim.render.telemetry import Telemetry
from gantrysim.results.checks import FAIL, PASS, UNJUDGED, WARN, Place, Row
from gantrysim.results.colours import BAD, GOOD, NEAR, RIGHT
from gantrysim.results.glue import PASS_TIMES
from gantrysim.results.verdict import GLUE, Verdict

_LONGEST_FILM = 60.0  # of a film at the default speed [s]
_MOST_FRAMES = 100_000
_LEAST_HEIGHT = 40  # of the pictures [pixels]
_SIZES = {1: (1280, 720), 2: (1280, 720), 4: (1920, 1080)}
COUNTS = tuple(_SIZES)  # numbers of runs that a film can show
_GAP = 4  # between pictures side by side [pixels]
_PASS_POINTS = 17  # of the needle's way through its own glue in one pass
_MACHINE_TIME = 1.0  # of the film, that shows the whole machine [s]
_FLIGHT_TIME = 1.5  # of the film, in which the camera flies to the bead [s]
_INTRODUCTION = 0.25  # of a film, that both take at most

SECONDS = 1.0  # that it is shown
_DIM = 0.16  # brightness of the picture below it
_WHITE = "#ffffff"
# colours of states on the dark picture
STATES = {PASS: GOOD, WARN: NEAR, FAIL: BAD, UNJUDGED: RIGHT}
_LETTERS = 1 / 24  # size of its letters, relative to its height
_COLUMN_WIDTH = 36  # width that a column needs, in sizes of the letters
_LEAST_LETTERS = 9  # [pixels]
_HEADLINE_SIZE = 1.7  # size of the headline's letters, relative to the others
_EDGE = 1.2  # around a column, in sizes of the letters
_LINES = 3  # of a row of a verdict that are shown


@dataclass(frozen=True, eq=False)
class Take:
    """A run to be filmed.

    Attributes:
        label: of the run; by default what its job differs in from those of the other takes, or the name of its job or
            machine.
        bead: settings of the bead, or the bead itself, which is then not computed again.
        verdict: on the run, shown above its picture; by default the run's own, which takes a moment to find.
    """

    machine: Machine
    run: Run
    label: str = ""
    bead: BeadSettings | BeadTrace | None = None
    verdict: Verdict | None = None


class Cell(NamedTuple):
    """Place of a take's picture in the frame: first column and row, width and height [pixels]."""

    left: int
    top: int
    width: int
    height: int

    def of(self, frame: Picture) -> Picture:
        """Return this part of a frame."""
        return frame[self.top : self.top + self.height, self.left : self.left + self.width]


class Film(Closing):
    """Frames of one, two or four runs at the same time of the run. Use it as a context manager.

        with Film([Take(machine, slow, "T = 1 s"), Take(machine, fast, "T = 0.01 s")]) as film:
            film.save("comparison.mp4", speed=4)

    Two runs are stacked where the frame is higher than wide. A run that ends before the others keeps its last picture.

    Args:
        takes: the runs.
        camera: name of a camera of the machines, as for `Renderer`; by default one that is fitted to the bead, after
            a second of the whole machine and a flight from there.
        size: width and height of the frames; the default depends on the number of runs [pixels].
        colour: quantity that colours the beads on one scale, one of `gantrysim.render.colours.COLOURS`; by default the
            worse of error and width by the verdicts, or the error of runs without a job.

    Attributes:
        end: time at which the longest run ends [s].
        cells: places of the runs' pictures.
        panel: drawn at the top of the frame, out of reach of a player's controls.

    Raises:
        InputError: another number of runs, no such camera or colour, or too small a size.
        NoOpenGLError: no OpenGL without a display.
    """

    def __init__(
        self,
        takes: Sequence[Take],
        *,
        camera: str | None = None,
        size: tuple[int, int] | None = None,
        colour: str | None = None,
    ) -> None:
        if len(takes) not in _SIZES:
            raise InputError(f"number of runs = {len(takes)}: must be 1, 2 or 4")
        self.size = checked_size("film", _SIZES[len(takes)] if size is None else size)
        width, height = self.size
        beads = [BeadTrace.of(take.run, take.bead) for take in takes]
        self._runs = [Telemetry(bead.run, bead) for bead in beads]
        self.end = max(float(take.run.time[-1]) for take in takes)
        runs = [take.run for take in takes]
        self._verdicts = verdicts = [take.run.known_verdict if take.verdict is None else take.verdict for take in takes]
        colour = chosen_colour(colour, runs, verdicts)
        scale = scale_for(colour, runs, beads, verdicts[0])
        self._labels = labels = _labels(takes)
        self.panel = Panel(self._runs, self.size, labels[0], scale)
        above = self.panel.size[1]
        room = height - above
        self._headers: list[Header] = []
        self.cells: tuple[Cell, ...] = (Cell(0, above, width, room),)
        rows = 1
        if len(takes) > 1:
            rows = len(takes) if len(takes) == 2 and height > width else len(takes) // 2
            self.cells = self._places(labels, rows, room)
        least = above + rows * (self.cells[0].top - above + _LEAST_HEIGHT)
        if height < least:
            raise InputError(f"height of the film = {height}: must be at least {least}, for the pictures")
        self._renderers: list[Renderer] = []
        shape = (self.cells[0].width, self.cells[0].height)  # of all pictures
        framing = _common_framing(takes, shape) if camera is None else None
        # closes those that are open where one cannot be opened
        with ExitStack() as opened:
            for take, cell, bead in zip(takes, self.cells, beads, strict=True):
                size = (cell.width, cell.height)
                view = camera or framing or BEAD
                renderer = Renderer(take.machine, take.run, view, size, bead, colour, scale)
                self._renderers.append(opened.enter_context(renderer))
            self._opened = opened.pop_all()
        letters = self.panel.font.size
        self._captions = [
            Caption(verdict, cell.width, letters) for verdict, cell in zip(verdicts, self.cells, strict=True)
        ]
        self._passes = [_passes(run, verdict) for run, verdict in zip(runs, verdicts, strict=True)]
        # frames of a long run need it
        memory.give_back()

    def _places(self, labels: Sequence[str], rows: int, room: int) -> tuple[Cell, ...]:
        """Draw the headers and return the places of the pictures, row by row, in the height above the panel."""
        columns = len(labels) // rows
        width = (self.size[0] - (columns - 1) * _GAP) // columns
        lines = 2 if room > rows * width else 1
        self._headers = headers(self._runs, labels, run_colours(len(labels)), width, self.panel.font.size, lines)
        above = self._headers[0].size[1]
        height = (room - rows * above) // rows
        cells = []
        for row in range(rows):
            top = self.panel.size[1] + row * (above + height) + above
            cells += [Cell(column * (width + _GAP), top, width, height) for column in range(columns)]
        return tuple(cells)

    def close(self) -> None:
        """Free the OpenGL contexts, and return the memory that a renderer in software leaves."""
        self._opened.close()
        memory.give_back()

    @property
    def models(self) -> tuple[mujoco.MjModel, ...]:
        """The machines with their beads."""
        return tuple(renderer.model for renderer in self._renderers)

    def frame(self, time: float, speed: float | None = None) -> Picture:
        """Return the frame at a time of the run, (height, width, 3).

        Args:
            time: from 0 to `end` [s].
            speed: seconds of the run in a second of the film, which the readout shows; None for a single picture.

        Raises:
            InputError: a time before or after the runs.
        """
        if not 0 <= finite("time", time, "s") <= self.end:
            raise InputError(f"time = {time:g} s: must be from 0 s to the end of the run, {self.end:g} s")
        return self._frame(time, speed, has_marks=self._flight_share(time, speed) == 1)

    def _frame(self, time: float, speed: float | None, *, has_marks: bool) -> Picture:
        """Return a frame with or without the marks of the verdict: its worst place, the needle's ways through glue."""
        width, height = self.size
        frame = np.empty((height, width, 3), np.uint8)
        # by rows: pixel by pixel takes ten times as long
        frame[:] = np.full((width, 3), rgb(PAPER), np.uint8)
        share = self._flight_share(time, speed)
        for cell, renderer, run in zip(self.cells, self._renderers, self._runs, strict=True):
            cell.of(frame)[:] = renderer.frame(run.tick(time), share)
        for k, (cell, caption, renderer) in enumerate(zip(self.cells, self._captions, self._renderers, strict=True)):
            ways = list(self._ways(k, time)) if has_marks else []
            caption.write(cell.of(frame), self._worst(caption, renderer, time) if has_marks else None, ways)
        for cell, header in zip(self.cells, self._headers, strict=False):  # one run has none
            Cell(cell.left, cell.top - header.size[1], *header.size).of(frame)[:] = header.picture(time)
        frame[: self.panel.size[1]] = self.panel.picture(time, speed)
        return frame

    def _worst(self, caption: Caption, renderer: Renderer, time: float) -> tuple[float, float] | None:
        """Return column and row of the verdict's worst place in a picture; None before the run has come to it."""
        place = caption.place
        if place is None or place.point is None or place.time is None or time < place.time:
            return None
        return renderer.pixel_of(place.point)

    def _ways(self, k: int, time: float) -> Iterator[list[tuple[float, float]]]:
        """Yield columns and rows of the needle's way through its own glue in a picture, pass by pass, until a time."""
        for times, points in self._passes[k]:
            pixels = map(self._renderers[k].pixel_of, points[times <= time].tolist())
            yield [pixel for pixel in pixels if pixel is not None]

    def end_card(self, speed: float | None = None) -> Picture:
        """Return what the film ends with for a second: the verdicts on its runs, (height, width, 3); speed as above."""
        # the label of the worst place would shine through the card's text
        frame = self._frame(self.end, speed, has_marks=False)
        return end_card(frame, self._runs, self._labels, self._verdicts)

    def _flight_share(self, time: float, speed: float | None) -> float:
        """Return the share of the flight to the bead at a time of the run, 0 to 1; a single picture shows the bead.

        It starts and ends at rest: 3 x² - 2 x³ of the share x of its duration.
        """
        if speed is None:
            return 1.0
        shorter = min(1.0, _INTRODUCTION * self.end / speed / (_MACHINE_TIME + _FLIGHT_TIME))
        x = (time / speed - shorter * _MACHINE_TIME) / (shorter * _FLIGHT_TIME) if shorter else 1.0
        x = min(max(x, 0.0), 1.0)
        return x * x * (3 - 2 * x)

    def times(self, fps: float, speed: float) -> list[float]:
        """Return the times of the run in a film [s]: speed / fps apart, ending with the end of the run.

        Raises:
            InputError: numbers that are not above 0, or that make more than 100,000 frames.
        """
        step = positive("speed of the film", speed) / positive("frames per second", fps, "1/s")
        frames = self.end * fps / speed
        if frames > _MOST_FRAMES:
            raise InputError(
                f"number of frames = {frames:.6g}, with {fps:g} frames per second and speed {speed:g}: must be at most "
                f"{_MOST_FRAMES}: use fewer frames per second or a higher speed"
            )
        count = int(np.ceil(self.end / step - 1e-9))
        return [*(k * step for k in range(count)), self.end]

    def save(
        self,
        file: str | os.PathLike[str],
        *,
        fps: float = 25.0,
        speed: float | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> int:
        """Write the film, with its end card, and return its number of frames; on failure an earlier file is kept.

        Args:
            file: to write, .mp4 or .gif. The frames of a GIF last whole hundredths of a second, so it gets the nearest
                possible frames per second.
            fps: frames per second.
            speed: seconds of the run in a second of the film; by default 1, or more to keep the film below a minute.
            progress: called after each frame with the share that is done, 0 to 1.

        Raises:
            InputError: another suffix, no such folder, an odd size of an MP4, or numbers that `times` refuses.
        """
        target = Path(file)
        rate = film_rate(target, fps)
        if speed is None:
            speed = max(1.0, float(np.ceil(self.end / _LONGEST_FILM)))
        times = self.times(rate, speed)

        def samples() -> list[Picture]:  # first, middle and last
            return [*(self.frame(times[k * (len(times) - 1) // 2], speed) for k in range(3)), card]

        card = self.end_card(speed)
        card_frames = max(round(SECONDS * rate), 1)
        with film_writer(target, rate, self.size, samples) as append:
            for count, time in enumerate(times, 1):
                append(self.frame(time, speed))
                if progress is not None:
                    progress(count / len(times))
            for _ in range(card_frames):
                append(card)
        return len(times) + card_frames

    def save_picture(self, file: str | os.PathLike[str], at: float | None = None) -> None:
        """Write one frame as PNG, at a time of the run or by default at its end [s].

        Raises:
            InputError: another suffix, no such folder, or a time before or after the runs.
        """
        save_picture(Path(file), self.frame(self.end if at is None else at))


def _labels(takes: Sequence[Take]) -> list[str]:
    """Return the labels of takes: those given, else what their jobs differ in, or the names of jobs or machines."""
    jobs = [take.run.job for take in takes]
    names = [
        take.label or (take.machine.name if job is None else job.name) for take, job in zip(takes, jobs, strict=True)
    ]
    known = [job for job in jobs if job is not None]
    if any(take.label for take in takes) or len(takes) == 1 or len(known) < len(jobs):
        return names
    return differences(known) or names


def _passes(run: Run, verdict: Verdict | None) -> list[tuple[Floats, Floats]]:
    """Return times [s] and places [mm] of the needle's passes through its own glue, (m,) and (m, 3) each."""
    spans = verdict[GLUE].values.get(PASS_TIMES, []) if verdict is not None and verdict.rows else []
    passes = []
    for begin, end in spans:
        times = np.linspace(begin, end, _PASS_POINTS)
        places = np.stack([np.interp(times, run.time, run.nozzle[:, axis]) for axis in range(3)], axis=1)
        passes.append((times, places))
    return passes


def _common_framing(takes: Sequence[Take], size: tuple[int, int]) -> Framing | None:
    """Return one framing for runs of the same machine, so that their pictures can be compared; else None."""
    first = takes[0]
    if any(take.machine.name != first.machine.name for take in takes):
        return None
    sight = Sight(first.machine.model, first.machine, first.run, size[0] / size[1])
    return sight.framing([take.run for take in takes[1:]])


# The film of one run in a call.


def save_video(
    machine: Machine,
    run: Run,
    file: str | os.PathLike[str],
    *,
    camera: str | None = None,
    size: tuple[int, int] = (960, 540),
    fps: float = 25.0,
    speed: float | None = None,
    bead: BeadSettings | BeadTrace | None = None,
    colour: str | None = None,
    label: str = "",
    verdict: Verdict | None = None,
    progress: Callable[[float], None] | None = None,
) -> int:
    """Write a film of one run, MP4 or GIF, and return its number of frames.

    Arguments and errors as of `Take`, `Film` and `Film.save`.
    """
    take = Take(machine, run, label, bead, verdict)
    with Film([take], camera=camera, size=size, colour=colour) as film:
        return film.save(file, fps=fps, speed=speed, progress=progress)


def end_card(
    picture: Picture, runs: Sequence[Telemetry], labels: Sequence[str], verdicts: Sequence[Verdict | None]
) -> Picture:
    """Return the card of some runs, a column for each, over a picture, (height, width, 3)."""
    image = Image.fromarray(np.round(_DIM * picture).astype(np.uint8))
    draw = ImageDraw.Draw(image)
    width = image.width // len(runs)
    size = max(min(round(_LETTERS * image.height), width // _COLUMN_WIDTH), _LEAST_LETTERS)
    room = width - 2 * _EDGE * size
    columns = [
        list(_lines(run, label, verdict, size, room))
        for run, label, verdict in zip(runs, labels, verdicts, strict=True)
    ]
    height = max(sum(LINE * lettering for _, _, lettering, _ in lines) for lines in columns)
    for number, lines in enumerate(columns):
        row = max(0.5 * (image.height - height), 0.0)
        for text, colour, lettering, bold in lines:
            font(lettering, bold).write(draw, (number * width + _EDGE * size, row), text, colour)
            row += LINE * lettering
    return np.asarray(image)


def _lines(
    run: Telemetry, label: str, verdict: Verdict | None, size: int, room: float
) -> Iterator[tuple[str, str, int, bool]]:
    """Yield the lines of a column: text, colour, size of its letters, and whether it is bold."""
    large = round(_HEADLINE_SIZE * size)
    yield font(size, True).shortened(label, room), _WHITE, size, True
    if verdict is None:
        text = f"contour error, rms / max: {run.rms_max_text(len(run.time) - 1)}"
        yield font(size).shortened(text, room), _WHITE, size, False
        return
    headline = font(large, True)
    for line in headline.wrapped(verdict.headline, room)[:_LINES]:
        yield headline.shortened(line, room), STATES[verdict.state], large, True
    if verdict.unjudged:
        return
    letters = font(size)
    for row in verdict.rows:
        yield "", _WHITE, size // 2, False
        text = f"{row.symbol} {row.name}: {_words(row)}"
        for line in letters.wrapped(text, room)[:_LINES]:
            yield letters.shortened(line, room), STATES[row.state], size, False


def _words(row: Row) -> str:
    """Return the worst value of a row and its limit, without its place, or what else there is to say."""
    check = row.worst_check
    return next(iter(row.texts), row.state) if check is None else str(replace(check, place=Place()))
