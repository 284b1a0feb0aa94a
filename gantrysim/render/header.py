"""Headers above the pictures of runs side by side: label and readout of each; the caption of a picture."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any, get_args, get_type_hints

import numpy as np
from PIL import Image, ImageDraw

from gantrysim.base.errors import expanded_path
from gantrysim.base.quantity import number_text
from gantrysim.glue.bead import BeadSettings
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.job.job import Job
from gantrysim.job.programs import PROGRAMS, described_fields
from gantrysim.job.settings import ServoSettings
from gantrysim.render.encoding import Picture
from gantrysim.render.fonts import LINE, MUTED, PAPER, Font, font, rgb
from gantrysim.render.telemetry import Telemetry
from gantrysim.report.folder import SavedRun
from gantrysim.report.plots.style import COLOURS
from gantrysim.results.colours import FAULT, INK
from gantrysim.results.verdict import Verdict

# Labels of runs side by side: the values in which their jobs differ.

_MOST_KEYS = 3
_LONGEST_VALUE = 24  # [letters]
_UNIT = re.compile(r"\[([^\[\]]+)\]")


def labels_of(runs: Sequence[SavedRun]) -> list[str]:
    """Return the labels of saved runs.

    A single run is labelled by its job's name, several by the values in which their jobs differ ("loop_period = 1 s")
    or by their folders where no value differs, or all that differ are too long.
    """
    if len(runs) == 1:
        return [runs[0].job.name]
    labels = differences([run.job for run in runs])
    if labels is not None:
        return labels
    names = [expanded_path(run.folder).resolve().name for run in runs]
    return names if len(set(names)) == len(names) else [str(run.folder) for run in runs]


def differences(jobs: Sequence[Job]) -> list[str] | None:
    """Return what each of some jobs differs in from the others, three values at most; None where all are long."""
    contents = [_flat(job.model_dump(exclude={"name"})) for job in jobs]
    keys = dict.fromkeys(key for content in contents for key in content)
    differing = [key for key in keys if any(content.get(key) != contents[0].get(key) for content in contents)]
    texts = {
        key: [_text(job, key, content.get(key)) for job, content in zip(jobs, contents, strict=True)]
        for key in differing
    }
    shown = [key for key in differing if max(map(len, texts[key])) <= _LONGEST_VALUE][:_MOST_KEYS]
    if not shown:
        return None
    short_keys = [key.rpartition(".")[2] for key in shown]
    names = [short if short_keys.count(short) == 1 else key for short, key in zip(short_keys, shown, strict=True)]
    others = len(differing) - len(shown)
    remark = [f"{others} more"] if others else []
    rows = zip(*(texts[key] for key in shown), strict=True)
    return [", ".join([*(f"{name} = {text}" for name, text in zip(names, row, strict=True)), *remark]) for row in rows]


def _flat(content: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return a job's values by their dotted keys."""
    flat: dict[str, Any] = {}
    for key, value in content.items():
        flat.update(_flat(value, f"{prefix}{key}.") if isinstance(value, Mapping) else {f"{prefix}{key}": value})
    return flat


def _text(job: Job, key: str, value: Any) -> str:
    if value is None:
        return "default"
    if key == "machine":
        return Path(str(value)).stem
    if isinstance(value, bool):
        return str(value).lower()
    if not isinstance(value, int | float):
        return " ".join(str(value).split())
    return f"{value:g} {_unit(job, key)}".rstrip()


def _unit(job: Job, key: str) -> str:
    """Return the unit of a number, which its description has in brackets; empty without one or with several."""
    section, *names = key.split(".")
    if section == "simulation":
        return "s"
    if section == "servo":
        description = ServoSettings.model_fields[names[0]].description or ""
    else:
        kinds: dict[str, type[Any]] = {"dispenser": Dispenser, "bead": BeadSettings}
        # a user's own controller is not described: the code of a saved run must not run
        if job.program["controller"] in PROGRAMS:
            kinds["program"] = PROGRAMS[job.program["controller"]]
        description = _description(kinds[section], names) if section in kinds else ""
    units = _UNIT.findall(description)
    return units[-1] if units and not re.search(r",| or ", units[-1]) else ""


def _description(kind: type[Any], names: Sequence[str]) -> str:
    """Return the description of a field of a dataclass, or of a dataclass within it."""
    name, *inner_names = names
    if not inner_names:
        return described_fields(kind).get(name, "")
    hint = get_type_hints(kind).get(name)
    for part in (hint, *get_args(hint)):  # a field may be optional
        if isinstance(part, type) and is_dataclass(part):
            return _description(part, inner_names)
    return ""


_HEIGHT = 2.9  # of a header with one line of readout, in sizes of its letters
_WIDTHS = {1: 34, 2: 22}  # by lines of readout, that hold all of it, in sizes of the letters
_MARK = 1.1  # size of the mark at the worst place, in sizes of the letters
# width of the needle's way through its own glue, and with an edge around it, in sizes of that mark
_WAY = 0.16
_WAY_EDGE = 0.36
_MOST_MARK = 0.5  # width of its text, relative to the picture, up to which it names the quantity
_CAPTION_HEIGHT = 1.8  # in sizes of its letters
_LEAST_LETTERS = 10  # size of the letters, unless the panel's are smaller [pixels]


class Header:
    """Label of a run in the colour of its curve, and its readout.

    Args:
        run, label, colour: of the run.
        width: of the header [pixels].
        largest: size of the letters [pixels].
        lines: of the readout, 1 or 2.

    Attributes:
        size: width and height [pixels].
        font: of the readout.
        room: width available for the label [pixels].
    """

    def __init__(self, run: Telemetry, label: str, colour: str, width: int, largest: int, lines: int = 1) -> None:
        self.font = font(max(min(largest, int(width / _WIDTHS[lines])), min(largest, _LEAST_LETTERS)))
        self.size = width, round((_HEIGHT + LINE * (lines - 1)) * self.font.size)
        self.room = width - 2 * self.font.margin
        self._run = run
        first, *self._rows = (round((0.78 + 1.34 * k) * self.font.size) for k in range(lines + 1))
        self._base = Image.new("RGB", self.size, PAPER)
        bold = font(self.font.size, True)
        text = bold.shortened(label, self.room)
        bold.write(ImageDraw.Draw(self._base), (self.font.margin, first), text, colour, "lm")

    def picture(self, time: float) -> Picture:
        """Return the header at a time of the run [s], (height, width, 3).

        Values that do not fit are left out. After the end of the run its state comes first, without momentary values.
        """
        run = self._run
        tick = run.tick(time)
        end = f"at {run.time[-1]:.2f} s"
        error = ("error", MUTED, run.error_text(tick), "8888.8 µm")
        rms_max = ("rms / max", MUTED, run.rms_max_text(tick), "8888 / 8888 µm")
        speed = ("speed", MUTED, f"{run.speed(tick):.1f} mm/s", "888.8 mm/s")
        if run.has_faulted(time):
            values = [(f"fault {end}", COLOURS["fault"], "", ""), rms_max, error]
        elif run.has_ended(time):
            values = [(f"ended {end}", MUTED, "", ""), rms_max]
        else:
            # in two lines the longest value has the second to itself
            values = [error, rms_max, speed] if len(self._rows) == 1 else [error, speed, rms_max]
        image = self._base.copy()
        letters = self.font
        draw = ImageDraw.Draw(image)
        column = float(letters.margin)
        rows = self._rows
        for name, colour, text, widest in values:
            width = letters.width(f"{name} {widest}".rstrip())
            if column + width > self.size[0]:
                column = float(letters.margin)
                rows = rows[1:]
            if not rows or column + width > self.size[0]:
                break
            letters.write(draw, (round(column), rows[0]), name, colour, "lm")
            letters.write(draw, (round(column + letters.width(f"{name} ")), rows[0]), text, INK, "lm")
            column += width + letters.size
        return np.asarray(image)


def headers(
    runs: Sequence[Telemetry], labels: Sequence[str], colours: Sequence[str], width: int, largest: int, lines: int = 1
) -> list[Header]:
    """Return the headers of runs side by side, with labels shortened so that they stay different."""
    first = Header(runs[0], labels[0], colours[0], width, largest, lines)
    labels = font(first.font.size, True).distinct(labels, first.room)
    return [
        Header(run, label, colour, width, largest, lines)
        for run, label, colour in zip(runs, labels, colours, strict=True)
    ]


class Caption:
    """What stands in a picture: the verdict at the upper edge to the left, and a mark at its worst place.

    Args:
        verdict: headline and words of the worst value say it without colour; None for nothing.
        width: of the picture [pixels]; a longer text is cut.
        largest: size of the letters [pixels].
    """

    def __init__(self, verdict: Verdict | None, width: int, largest: int) -> None:
        self._verdict = _line("" if verdict is None else verdict.headline, font(largest, True), INK, width)
        place = None if verdict is None or verdict.worst_row is None else verdict.worst_place
        worst = ""
        if verdict is not None and place is not None:
            check = next(check for row in verdict.rows for check in row.checks if check.place == place)
            letters = font(largest)
            worst = f"{number_text(check.value, check.form)} {check.unit}".rstrip()
            named = f"{check.quantity} {worst}"
            if letters.width(named) + 2 * letters.margin <= _MOST_MARK * width:
                worst = named
        self._worst = _line(worst, font(largest), FAULT, width)
        self._size = round(_MARK * largest)
        self.place = place

    def write(
        self,
        picture: Picture,
        worst: tuple[float, float] | None = None,
        ways: Sequence[Sequence[tuple[float, float]]] = (),
    ) -> None:
        """Write the caption over a picture, (height, width, 3).

        Args:
            picture: to be written on.
            worst: column and row of the worst place; None where it is not to be marked.
            ways: columns and rows of the needle's ways through its own glue.
        """
        self._draw_ways(picture, [way for way in ways if len(way) > 1])
        if worst is not None:
            self._mark(picture, *worst)
        if self._verdict is not None:
            rows, columns = self._verdict.shape[:2]
            picture[:rows, :columns] = self._verdict[: len(picture)]

    def _draw_ways(self, picture: Picture, ways: Sequence[Sequence[tuple[float, float]]]) -> None:
        """Draw the needle's ways through its own glue."""
        if not ways:
            return
        image = Image.fromarray(picture)
        draw = ImageDraw.Draw(image)
        for share, colour in ((_WAY_EDGE, PAPER), (_WAY, FAULT)):
            for way in ways:
                draw.line(list(way), rgb(colour), max(round(share * self._size), 1), "curve")
        picture[:] = np.asarray(image)

    def _mark(self, picture: Picture, column: float, row: float) -> None:
        """Draw a triangle that points down to a place, with its text beside it, inside the picture."""
        height, width = picture.shape[:2]
        size = self._size
        image = Image.fromarray(picture)
        draw = ImageDraw.Draw(image)
        corners = [(column, row - 0.4 * size), (column - 0.6 * size, row - 1.5 * size)]
        draw.polygon([*corners, (column + 0.6 * size, row - 1.5 * size)], rgb(FAULT), rgb(PAPER))
        if self._worst is not None:
            rows, columns = self._worst.shape[:2]
            first = column + 0.8 * size
            if first + columns > width:
                first = column - 0.8 * size - columns
            top = min(max(row - 1.6 * size - 0.5 * rows, 0), height - rows)
            image.paste(Image.fromarray(self._worst), (round(max(first, 0)), round(top)))
        picture[:] = np.asarray(image)


def _line(text: str, letters: Font, colour: str, width: int) -> Picture | None:
    """Return a line of text cut to a width [pixels], (height, width, 3), or None without text."""
    if not text:
        return None
    shortened = letters.shortened(text, width - 2 * letters.margin)
    size = min(width, round(letters.width(shortened)) + 2 * letters.margin), round(_CAPTION_HEIGHT * letters.size)
    image = Image.new("RGB", size, PAPER)
    letters.write(ImageDraw.Draw(image), (letters.margin, size[1] / 2), shortened, colour, "lm")
    return np.asarray(image)
