"""Texts of the viewer: the values of the moment, what keys do, and the fault that ended a run."""

from __future__ import annotations

import textwrap
from typing import NamedTuple

import numpy as np

from gantrysim.render.telemetry import Telemetry
from gantrysim.render.view.clock import Clock
from gantrysim.render.view.source import Source

Row = tuple[str, str]

_WIDTH = 44  # of a line of a fault message
_BEHIND = 0.9  # of the requested speed, below which the actual one is shown
# the viewer's font is limited to ASCII
_ASCII = str.maketrans({"µ": "u", "·": " ", "²": "2", "³": "3", "°": " deg", "–": "-", "−": "-", "×": "x"})

_CAMERA_KEYS = (("[ ], Esc", "switch camera, free camera"), ("Drag, wheel", "turn, move, zoom"))
REPLAY_KEYS = (
    ("Space", "pause or resume"),
    ("Left, Right", "1 s back, forward"),
    ("Up, Down", "double, halve speed"),
    ("Home, Backspace", "go to start"),
    *_CAMERA_KEYS,
)
LIVE_KEYS = (
    ("Space", "pause or resume"),
    ("Up, Down", "double, halve speed"),
    ("Home, Backspace", "restart"),
    ("Double click", "select a body"),
    ("Ctrl + right drag", "push the selected body"),
    ("Ctrl + left drag", "twist the selected body"),
    *_CAMERA_KEYS,
)
_HINT = ("Space", "pause and show keys")


class Texts(NamedTuple):
    """The texts in the window, in rows of two columns: values of the moment, keys, and the fault if there is one."""

    values: tuple[Row, ...]
    keys: tuple[Row, ...]
    fault: tuple[Row, ...]


class ViewState(NamedTuple):
    """State of the viewer.

    Attributes:
        clock: with the requested speed.
        pace: actual speed, in seconds of the run per second; None if unknown.
        push: force of the mouse on the machine [N].
        keys: whether all keys are listed.
    """

    clock: Clock
    pace: float | None
    push: float
    keys: bool


def moment_texts(name: str, source: Source, telemetry: Telemetry, view: ViewState) -> Texts:
    """Return the texts of a source's present tick.

    Args:
        name: of the job.
        source: of the run.
        telemetry: of its record.
        view: state of the viewer.
    """
    clock = view.clock
    pace = view.pace
    push = view.push
    tick = source.tick
    paused = clock.is_paused
    ended = source.over
    time = float(telemetry.time[tick])
    error = float(telemetry.error[tick])
    behind = not (paused or ended) and pace is not None and pace < _BEHIND * clock.speed
    values = [
        ("live" if source.live else "replay", plain(name)),
        ("time", f"{time:.2f} of {max(source.until, time):.2f} s"),
        ("path speed", f"{telemetry.speed(tick):.1f} mm/s"),
        ("contour error", f"{error:.1f} micron" if np.isfinite(error) else "dispenser off"),
        ("speed", f"{clock.speed:g} x" + (f", actual {pace:.2g} x" if behind else "")),
    ]
    if push > 0:
        values.append(("push", f"{push:.0f} N" if push >= 10 else f"{push:.1f} N"))
    if paused or ended:
        values.append(("", "ended" if ended else "paused"))
    fault = source.fault
    lines = textwrap.wrap(plain(str(fault)), _WIDTH) if fault is not None else []
    keys: tuple[Row, ...] = (_HINT,)
    if view.keys:
        keys = LIVE_KEYS if source.live else REPLAY_KEYS
    return Texts(
        tuple(values),
        keys,
        tuple(("" if number else "fault", line) for number, line in enumerate(lines)),
    )


def plain(text: str) -> str:
    """Return a text in ASCII, which the viewer's font is limited to."""
    return text.replace("µm", "micron").translate(_ASCII).encode("ascii", "replace").decode()
