"""The keys that the view adds to those of MuJoCo's viewer, which takes none of them for itself while others step."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple


class Action(Enum):
    """What a key does."""

    PAUSE = "pause, go on"
    BACK = "1 s back"
    FORWARD = "1 s forward"
    FASTER = "twice as fast"
    SLOWER = "half as fast"
    START = "to the start"


class Line(NamedTuple):
    """A line of the legend: keys, what they do, and what they do of a live run; there is none of it where None."""

    keys: str
    replay: str
    live: str | None


# by the numbers that GLFW gives them
ACTIONS = {
    32: Action.PAUSE,
    262: Action.FORWARD,
    263: Action.BACK,
    264: Action.SLOWER,
    265: Action.FASTER,
    259: Action.START,
    268: Action.START,
}

LEGEND = (
    Line("Space", "pause, go on", "pause, go on"),
    Line("Left, Right", "1 s back, forward", None),
    Line("Up, Down", "speed x 2, / 2", "speed x 2, / 2"),
    Line("Home, Backspace", "to the start", "run anew"),
)

# what MuJoCo's viewer does by itself, and is worth to know here
VIEWER = (
    Line("[ ], Esc", "cameras, free view", "cameras, free view"),
    Line("Ctrl + right drag", "", "push what a double click chose"),
    Line("Ctrl + left drag", "", "twist it"),
    Line("F1", "the viewer's own keys", "the viewer's own keys"),
)

MORE = ("Space", "pause, and what the keys do")


def legend(*, live: bool) -> list[tuple[str, str]]:
    """Return keys and what they do, line by line."""
    lines = ((line.keys, line.live if live else line.replay) for line in LEGEND + VIEWER)
    return [(keys, text) for keys, text in lines if text]
