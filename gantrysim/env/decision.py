"""Around a decision of an agent: entries of observations and actions, measured values, and how episodes stand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.engine.places import Moment
from gantrysim.env.interval import AXIS_VALUES, PATH_VALUES
from gantrysim.env.settings import PathSettings


class Entry(NamedTuple):
    """One entry of an observation or of an action."""

    name: str
    low: float
    high: float
    unit: str
    meaning: str


def following_entries(axis: str, worst: float) -> list[Entry]:
    """Return the entries of an axis' following error.

    Args:
        axis: its name.
        worst: largest error that is observed [tolerances].
    """
    return [
        Entry(f"following_{axis}", -worst, worst, "tolerances", f"mean following error of {axis}, signed"),
        Entry(f"following_change_{axis}", -worst, worst, "tolerances", "change since the interval before"),
    ]


class IntervalValues(NamedTuple):
    """Values measured between two decisions, one row per environment; all zero before the first interval.

    Attributes:
        contour_rms, contour_max: contour error [mm], (n,).
        lateral: mean contour error, signed [mm], (n,).
        speed: path speed of the nozzle [mm/s], (n,).
        heading: direction of the path at the last foot [rad], (n,).
        curvature: curvature of the path there [1/mm], (n,).
        following_rms, following_max, following_mean: following error [mm or deg], (n, axes).
        torque: largest torque demand, share of the peak torque, (n, axes).
        ripple: torque ripple, RMS change of the demand over pairs of ticks with the dispenser on divided by sqrt(2),
            share of the peak torque, (n, axes).
    """

    contour_rms: Floats
    contour_max: Floats
    lateral: Floats
    speed: Floats
    heading: Floats
    curvature: Floats
    following_rms: Floats
    following_max: Floats
    following_mean: Floats
    torque: Floats
    ripple: Floats

    @classmethod
    def of(cls, of_path: NDArray[np.void], of_axes: NDArray[np.void]) -> IntervalValues:
        """Return live views of values written by `measure`, (n,) of `PATH_VALUES` and (n, axes) of `AXIS_VALUES`."""
        return cls(
            **{name: of_path[name] for name in PATH_VALUES.fields or ()},
            **{name: of_axes[name] for name in AXIS_VALUES.fields or ()},
        )


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
