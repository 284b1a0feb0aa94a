"""A saved moment of an episode."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from gantrysim.engine.batch import Moment
from gantrysim.env.settings import PathSettings


@dataclass(frozen=True, eq=False)
class EpisodeState:
    """A saved moment of an episode, from which another environment with the same settings can go on.

    Attributes:
        settings: of the environment.
        drawn: values drawn for the episode.
        moment: of its simulation.
        values: of the task, by name.
        random: state of the random numbers, from which the next episodes are drawn.
    """

    settings: PathSettings
    drawn: dict[str, float]
    moment: Moment
    values: dict[str, NDArray[Any]]
    random: Mapping[str, Any]
