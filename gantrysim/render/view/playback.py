"""A run and all that is needed to play it in a window."""

from __future__ import annotations

from typing import NamedTuple

from gantrysim.render.scene import Scene
from gantrysim.render.view.push import Bodies
from gantrysim.render.view.source import Source


class Playback(NamedTuple):
    """A run to be played.

    Attributes:
        name: of the job.
        scene: of the source's machine.
        source: of the run.
        bodies: that the mouse may push; None for a replay.
    """

    name: str
    scene: Scene
    source: Source
    bodies: Bodies | None = None
