"""card.png of a run, for a forum or a ticket: the bead, the verdict's rows, what spoils it, and what to change."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from gantrysim.base.files import replaced_file
from gantrysim.report.answer import Answer, written_on
from gantrysim.report.plots.laid import draw_laid
from gantrysim.report.plots.style import common_style, sheet
from gantrysim.results.checks import FAIL, PASS, UNJUDGED, WARN
from gantrysim.results.colours import INK, SOFT, STATES
from gantrysim.results.run_results import RunResults

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

WIDTH = 1200  # [pixels]
HEIGHT = 630
_DPI = 100
_PICTURE = 0.5  # of the width, for the bead
_EDGE = 36  # [pixels]
_LARGE = 20.0  # of type [pt]
_PAPER = "#ffffff"
# of the shapes of a verdict's state, which stay without colour
_MARKERS = {PASS: "o", WARN: "^", FAIL: "s", UNJUDGED: "D"}


def save_card(file: Path, results: RunResults, answer: Answer) -> None:
    """Write the card of a run, 1200 by 630 pixels, as a PNG file."""
    with sheet(WIDTH / _DPI, HEIGHT / _DPI) as figure:
        figure.set_layout_engine("none")
        draw_card(figure, results, answer)
    with replaced_file(file) as new, common_style():
        figure.savefig(new, format="png", dpi=_DPI, facecolor=_PAPER)


def draw_card(figure: Figure, results: RunResults, answer: Answer) -> None:
    """Draw the card on a figure of its size."""
    colour = STATES[answer.state]
    picture = figure.add_axes((0.02, 0.12, _PICTURE - 0.04, 0.84))
    draw_laid(picture, results, text_size=10)
    text = _Column(figure, WIDTH * _PICTURE + 10, WIDTH - _EDGE)
    text.add(f"{results.basis.name} on {results.machine.name}", 12, SOFT, after=20)
    text.shape(answer.state, 30)
    text.add(answer.title, 24, colour, lines=2, indent=46, after=14)
    for row in answer.rows:
        text.shape(row.state, 13)
        where = f", {row.place}" if row.place and row.state != PASS else ""
        text.add(f"{row.name}: {row.text}{where}", 12, INK, lines=2, indent=26, after=5)
    for title, content, lines in _parts(answer):
        text.space(9)
        text.add(title, 10.5, SOFT, after=2)
        text.add(content, 13, INK, lines=lines)
    place = ((WIDTH - _EDGE) / WIDTH, 20 / HEIGHT)
    figure.text(*place, f"gantrysim  ·  {written_on()}", fontsize=10, color=SOFT, ha="right", va="bottom")
    figure.add_artist(_bar(colour))


def _parts(answer: Answer) -> list[tuple[str, str, int]]:
    parts = [("Spoilt by", answer.spoilt, 3)]
    if answer.remedy is not None:
        parts += [("Change", answer.remedy.change, 3), ("Then", answer.remedy.outcome, 2)]
    return [part for part in parts if part[1]]


def _bar(colour: str) -> Rectangle:
    from matplotlib.patches import Rectangle  # slow to import

    return Rectangle((0, 1 - 8 / HEIGHT), 1, 8 / HEIGHT, color=colour, lw=0)


def _weight(size: float) -> str:
    """Return the weight of letters of a size [pt]: the verdict's are bold."""
    return "bold" if size > _LARGE else "normal"


class _Column:
    """Lines of text from top to bottom, wrapped at their measured width.

    Args:
        figure: to draw on.
        begin: of the text, from the left [pixels].
        end: of it, likewise.
    """

    def __init__(self, figure: Figure, begin: float, end: float) -> None:
        self._figure = figure
        self._begin = begin
        self._end = end
        self._y = HEIGHT - 56.0

    def space(self, height: float) -> None:
        self._y -= height

    def shape(self, state: str, size: float) -> None:
        """Draw the shape of a state before the line that follows."""
        marker = _MARKERS[state]
        colour = STATES[state]
        x = (self._begin + 0.5 * size) / WIDTH
        y = (self._y + 0.32 * size) / HEIGHT
        from matplotlib.lines import Line2D

        points = 72 / _DPI * size
        self._figure.add_artist(Line2D([x], [y], marker=marker, ms=points, color=colour, ls="none", mew=0))
        symbol = {PASS: "✓", WARN: "!", FAIL: "✗", UNJUDGED: "–"}[state]
        self._figure.text(
            x, y, symbol, color="white", fontsize=0.62 * points, ha="center", va="center_baseline", weight="bold"
        )

    def add(
        self,
        text: str,
        size: float,
        colour: str,
        lines: int = 1,
        indent: float = 0,
        after: float = 4,
    ) -> None:
        """Draw a text on so many lines at most, the last one cut where it is longer."""
        height = 1.3 * size * _DPI / 72
        for line in self._wrapped(text, size, lines, self._end - self._begin - indent):
            self._figure.text(
                (self._begin + indent) / WIDTH,
                self._y / HEIGHT,
                line,
                fontsize=size,
                color=colour,
                weight=_weight(size),
            )
            self._y -= height
        self._y -= after

    def _wrapped(self, text: str, size: float, lines: int, width: float) -> list[str]:
        rows: list[str] = []
        line = ""
        for word in text.split():
            longer = f"{line} {word}".strip()
            if line and self._wide(longer, size) > width:
                rows.append(line)
                longer = word
            line = longer
        rows.append(line)
        if len(rows) <= lines:
            return rows
        last = f"{rows[lines - 1]} …"
        while self._wide(last, size) > width:
            last = f"{last[:-2].rpartition(' ')[0]} …"
        return [*rows[: lines - 1], last]

    def _wide(self, text: str, size: float) -> float:
        """Return the width of a line [pixels]."""
        label = self._figure.text(0, 0, text, fontsize=size, weight=_weight(size))
        wide = float(label.get_window_extent().width)
        label.remove()
        return wide
