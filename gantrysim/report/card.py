"""card.png of a run, for a forum or a ticket: the bead, the verdict's rows, what spoils it, and what to change."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from gantrysim.base.files import replaced_file
from gantrysim.base.quantity import joined
from gantrysim.report.answer import Answer, written_on
from gantrysim.report.plots.bead import draw_laid
from gantrysim.report.plots.style import common_style, sheet
from gantrysim.results.checks import FAIL, PASS, SYMBOLS, UNJUDGED, WARN
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
_BEGIN = WIDTH * _PICTURE + 10  # of the text, from the left [pixels]
_BOTTOM = 48  # of the text, above the date [pixels]
_SIZE_SHARES = tuple(1 - 0.04 * step for step in range(16))  # of the usual size of type, until all of it has room
_MEASURED = 20.0  # size of type at which words are measured [pt]
_SPARE_WIDTH = 1.02  # for the rounding of other sizes
_BOLD_SIZE = 20.0  # usual size of type from which it is bold [pt]
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
    """Draw the card on a figure of its size; its texts are as large as there is room for all of them."""
    picture = figure.add_axes((0.02, 0.12, _PICTURE - 0.04, 0.84))
    draw_laid(picture, results, text_size=10)
    words = _Words(figure)
    title = f"{results.basis.name} on {results.machine.name}"
    columns = (_written_column(_Column(words, share), title, answer) for share in _SIZE_SHARES)
    column = next((column for column in columns if column.bottom >= _BOTTOM), None)
    (column or _written_column(_Column(words, _SIZE_SHARES[-1]), title, answer)).draw(figure)
    place = ((WIDTH - _EDGE) / WIDTH, 20 / HEIGHT)
    figure.text(*place, f"gantrysim  ·  {written_on()}", fontsize=10, color=SOFT, ha="right", va="bottom")
    figure.add_artist(_bar(STATES[answer.state]))


def _written_column(text: _Column, title: str, answer: Answer) -> _Column:
    text.add(title, 12, SOFT, after=20)
    text.add(answer.title, 24, STATES[answer.state], state=answer.state, after=14)
    for row in answer.rows:
        where = f", {row.place}" if row.place and row.state != PASS else ""
        text.add(f"{row.name}: {row.text}{where}", 12, INK, state=row.state, after=5)
    for name, content in _parts(answer):
        text.space(9)
        text.add(name, 10.5, SOFT, after=2)
        text.add(content, 13, INK)
    return text


def _parts(answer: Answer) -> list[tuple[str, str]]:
    parts = [("Spoilt by", answer.spoilt)]
    if answer.remedy is not None:
        parts += [("Change", answer.remedy.change), ("Then", answer.remedy.outcome)]
    return [part for part in parts if part[1]]


def _bar(colour: str) -> Rectangle:
    from matplotlib.patches import Rectangle  # slow to import

    return Rectangle((0, 1 - 8 / HEIGHT), 1, 8 / HEIGHT, color=colour, lw=0)


class _Words:
    """Widths of words, measured once each at one size, in proportion to which those of other sizes are.

    Args:
        figure: on which they are measured.
    """

    def __init__(self, figure: Figure) -> None:
        self._figure = figure
        self._widths: dict[tuple[str, str], float] = {}

    def width(self, text: str, size: float, weight: str) -> float:
        """Return the width of a line at a size of type in points [pixels]."""
        words = sum(self._width(word, weight) for word in text.split(" "))
        space = self._width("x x", weight) - 2 * self._width("x", weight)
        return _SPARE_WIDTH * size / _MEASURED * (words + text.count(" ") * space)

    def _width(self, text: str, weight: str) -> float:
        if (text, weight) not in self._widths:
            label = self._figure.text(0, 0, text, fontsize=_MEASURED, weight=weight)
            self._widths[text, weight] = float(label.get_window_extent().width)
            label.remove()
        return self._widths[text, weight]


class _Line(NamedTuple):
    """A line of the card, its left end and base line from the lower left corner [pixels]."""

    x: float
    y: float
    text: str
    points: float
    colour: str
    weight: str
    state: str


class _Column:
    """Lines of text from top to bottom beside the picture, wrapped between words.

    Args:
        words: measures them.
        share: of the usual size of all types.

    Attributes:
        bottom: base line of the text that would follow, from the picture's lower edge [pixels].
    """

    def __init__(self, words: _Words, share: float) -> None:
        self._words = words
        self._share = share
        self._lines: list[_Line] = []
        self.bottom = HEIGHT - 56.0

    def space(self, height: float) -> None:
        """Leave a gap [pixels]."""
        self.bottom -= self._share * height

    def add(self, text: str, size: float, colour: str, state: str = "", after: float = 4) -> None:
        """Add a text, after the shape of a state where one is given."""
        points = self._share * size
        weight = "bold" if size > _BOLD_SIZE else "normal"
        indent = 2 * points if state else 0.0
        rows = self._wrapped_lines(text, points, weight, WIDTH - _EDGE - _BEGIN - indent)
        for k, row in enumerate(rows):
            shape = "" if k else state
            self._lines.append(_Line(_BEGIN + indent, self.bottom, row, points, colour, weight, shape))
            self.bottom -= 1.3 * points * _DPI / 72
        self.bottom -= self._share * after

    def draw(self, figure: Figure) -> None:
        """Draw all lines."""
        for line in self._lines:
            place = (line.x / WIDTH, line.y / HEIGHT)
            figure.text(*place, line.text, fontsize=line.points, color=line.colour, weight=line.weight)
            if line.state:
                _draw_shape(figure, line)

    def _wrapped_lines(self, text: str, points: float, weight: str, width: float) -> list[str]:
        rows: list[str] = []
        line = ""
        for word in joined(text).split(" "):
            longer = f"{line} {word}" if line else word
            if line and self._words.width(longer, points, weight) > width:
                rows.append(line)
                longer = word
            line = longer
        return [*rows, line]


def _draw_shape(figure: Figure, line: _Line) -> None:
    """Draw the shape of a state before a line."""
    from matplotlib.lines import Line2D  # slow to import

    points = 0.9 * line.points
    x = (_BEGIN + 0.75 * points) / WIDTH
    y = (line.y + 0.45 * points) / HEIGHT
    colour = STATES[line.state]
    figure.add_artist(Line2D([x], [y], marker=_MARKERS[line.state], ms=points, color=colour, ls="none", mew=0))
    sign = SYMBOLS[line.state]
    figure.text(x, y, sign, color="white", fontsize=0.62 * points, ha="center", va="center_baseline", weight="bold")
