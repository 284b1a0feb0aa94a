"""What a film of runs ends with: their verdicts, over the last picture."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from PIL import Image, ImageDraw

from gantrysim.render.encoding import Picture
from gantrysim.render.fonts import LINE, font
from gantrysim.render.telemetry import Telemetry
from gantrysim.results.checks import FAIL, PASS, UNJUDGED, WARN, Place, Row
from gantrysim.results.colours import BAD, GOOD, NEAR, RIGHT
from gantrysim.results.verdict import Verdict

SECONDS = 1.0  # that it is shown
_DIM = 0.16  # brightness of the picture below it
_WHITE = "#ffffff"
# colours of states on the dark picture
STATES = {PASS: GOOD, WARN: NEAR, FAIL: BAD, UNJUDGED: RIGHT}
_LETTERS = 1 / 24  # size of its letters, relative to its height
_WIDEST = 36  # width that a column needs, in sizes of the letters
_LEAST_LETTERS = 9  # [pixels]
_LARGE = 1.7  # size of the headline's letters, relative to the others
_EDGE = 1.2  # around a column, in sizes of the letters
_LINES = 3  # of a row of a verdict that are shown


def end_card(
    picture: Picture, runs: Sequence[Telemetry], labels: Sequence[str], verdicts: Sequence[Verdict | None]
) -> Picture:
    """Return the card of some runs, a column for each, over a picture, (height, width, 3)."""
    image = Image.fromarray(np.round(_DIM * picture).astype(np.uint8))
    draw = ImageDraw.Draw(image)
    width = image.width // len(runs)
    size = max(min(round(_LETTERS * image.height), width // _WIDEST), _LEAST_LETTERS)
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
    large = round(_LARGE * size)
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
