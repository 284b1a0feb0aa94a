"""What the view says in words: the figures of the moment, the keys, and the fault that ended a run."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass

import numpy as np

from gantrysim.run import Fault
from gantrysim.view.keys import MORE, legend

_WIDTH = 44  # of a line of the fault's text
_BEHIND = 0.9  # of the speed that was asked for, below which the view says how fast it is
# the viewer's font has no others than those of ASCII
_PLAIN = str.maketrans({"µ": "u", "·": " ", "²": "2", "³": "3", "°": " deg", "–": "-", "−": "-", "×": "x"})


@dataclass(frozen=True)
class Panel:
    """The texts in the window, each of lines of two columns.

    Attributes:
        figures: of the moment.
        keys: what keys and mouse do.
        fault: why the run ended early; none where it did not.
    """

    figures: tuple[tuple[str, str], ...]
    keys: tuple[tuple[str, str], ...]
    fault: tuple[tuple[str, str], ...]


def told(
    name: str,
    *,
    time: float,
    until: float,
    speed: float,
    error: float,
    factor: float,
    pace: float | None = None,
    paused: bool = False,
    over: bool = False,
    live: bool = False,
    push: float = 0.0,
    keys: bool = True,
    fault: Fault | None = None,
) -> Panel:
    """Return the texts of a moment.

    Args:
        name: of the job.
        time: of the moment [s].
        until: the last moment [s].
        speed: path speed of the nozzle [mm/s].
        error: contour error [µm]; nan while the dispenser is off.
        factor: speed asked for, seconds shown in a second.
        pace: speed reached, likewise; None where it is not known.
        paused: whether it stands because a key said so.
        over: whether there is no more to come.
        live: whether it is simulated now.
        push: force of the mouse on the machine [N].
        keys: whether to say what all the keys do.
        fault: why the run ended early.
    """
    state = "over" if over else "pause" if paused else ""
    behind = not (paused or over) and pace is not None and pace < _BEHIND * factor
    figures = [
        ("live" if live else "replay", plain(name)),
        ("time", f"{time:.2f} of {max(until, time):.2f} s"),
        ("path speed", f"{speed:.1f} mm/s"),
        ("contour error", f"{error:.1f} um" if np.isfinite(error) else "dispenser off"),
        ("speed", f"{factor:g} x" + (f", reaches {pace:.2g} x" if behind else "")),
    ]
    if push > 0:
        figures.append(("push", f"{push:.0f} N" if push >= 10 else f"{push:.1f} N"))
    if state:
        figures.append(("", state))
    broken = textwrap.wrap(plain(str(fault)), _WIDTH) if fault is not None else []
    return Panel(
        tuple(figures),
        tuple(legend(live=live) if keys else [MORE]),
        tuple(("" if number else "fault", line) for number, line in enumerate(broken)),
    )


def plain(text: str) -> str:
    """Return a text in the letters that the viewer's font has."""
    return text.translate(_PLAIN).encode("ascii", "replace").decode()
