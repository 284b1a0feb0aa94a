"""How the episodes of a batch stand after a decision."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.engine.places import Moment
from gantrysim.env.settings import PathSettings

# A saved moment of an episode.


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


class Ends(NamedTuple):
    """How the episodes stand after a decision.

    Attributes:
        faulty: places at which a fault has ended the episode, (places,).
        ended: places that have reached the end of the path without one, (places,).
        undone: decisions until the end of the path and the one just taken, which a fault costs, (places,).
    """

    faulty: NDArray[np.bool_]
    ended: NDArray[np.bool_]
    undone: NDArray[np.int64]


class Outcome(NamedTuple):
    """Outcome of a decision at every place; meaningless where none was taken.

    Attributes:
        reward: (places,).
        terminated: whether a fault has ended the episode, or its only decision is taken, (places,).
        truncated: whether the path is at its end, in an episode of several decisions, (places,).
        info: values by name, (places,) each.
        final: values at an episode's end by name, (places,) each.
    """

    reward: Floats
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    info: dict[str, NDArray[Any]]
    final: dict[str, NDArray[Any]]
