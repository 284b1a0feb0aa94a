"""How the episodes of a batch stand after a decision."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats


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
