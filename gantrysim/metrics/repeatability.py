"""Path accuracy ATp and path repeatability RTp in the manner of ISO 9283.

ISO 9283:1998 "Manipulating industrial robots, performance criteria and related test methods", clause 8 as publicly
described. With n cycles, m points c_i along the command path, and x_ij the point in which the j-th attained path meets
the plane normal to the command path at c_i:

    xbar_i = mean over j of x_ij            barycentre
    ATp = max over i of |xbar_i - c_i|
    l_ij = |x_ij - xbar_i|,  lbar_i = mean over j of l_ij,  S_i^2 = sum over j of (l_ij - lbar_i)^2 / (n - 1)
    RTp = max over i of (lbar_i + 3 S_i)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.metrics.spacing import forward
from gantrysim.paths.path import Path

_LEAST_CYCLES = 2  # S_i has n - 1 in the denominator


@dataclass(frozen=True, eq=False)
class RepeatedPath:
    """Path accuracy and repeatability along a path that was run several times.

    Attributes:
        s: arc lengths on the command path, (m,) [mm].
        command: points c_i there, (m, 3) [mm].
        attained: points x_ij of the attained paths, (n, m, 3) [mm].
    """

    s: Floats
    command: Floats
    attained: Floats

    def __post_init__(self) -> None:
        if self.attained.ndim != 3 or self.attained.shape[1:] != self.command.shape:
            raise InputError(
                f"attained paths of shape {self.attained.shape}: must be (n, {len(self.command)}, 3), as the command"
            )
        if len(self.attained) < _LEAST_CYCLES:
            raise InputError(f"{len(self.attained)} attained path: must be at least {_LEAST_CYCLES}, for a scatter")

    @classmethod
    def of(cls, path: Path, traces: Sequence[ArrayLike], places: int) -> RepeatedPath:
        """Compare traces with a path.

        Args:
            path: the command path.
            traces: attained paths in the order of the motion, each (k, 3) [mm].
            places: number m of points, evenly spaced where all traces overlap.
        """
        offsets = [offset_over_length(path, trace) for trace in traces]
        begin = max(arc_length[0] for arc_length, _ in offsets)
        end = min(arc_length[-1] for arc_length, _ in offsets)
        s = np.linspace(begin, end, places)
        command = path.position(s)
        attained = [command + interpolated(s, arc_length, offset) for arc_length, offset in offsets]
        return cls(s, command, np.array(attained))

    @property
    def barycentre(self) -> Floats:
        """xbar_i, (m, 3) [mm]."""
        return self.attained.mean(axis=0)

    @property
    def accuracy(self) -> Floats:
        """|xbar_i - c_i|, (m,) [mm]."""
        return np.linalg.norm(self.barycentre - self.command, axis=1)

    @property
    def repeatability(self) -> Floats:
        """lbar_i + 3 S_i, (m,) [mm]."""
        distance = np.linalg.norm(self.attained - self.barycentre, axis=2)
        return distance.mean(axis=0) + 3 * distance.std(axis=0, ddof=1)

    @property
    def path_accuracy(self) -> float:
        """ATp [mm]."""
        return float(self.accuracy.max())

    @property
    def path_repeatability(self) -> float:
        """RTp [mm]."""
        return float(self.repeatability.max())


def offset_over_length(path: Path, trace: ArrayLike) -> tuple[Floats, Floats]:
    """Return the offset of a trace from a path over the path's arc length, without points that go back.

    Args:
        path: the command path.
        trace: points in the order of the motion, (k, 3) [mm].

    Returns:
        Arc lengths, ascending (r,) [mm], and offsets normal to the path, (r, 3) [mm].
    """
    foot = path.follow(trace)
    ahead = forward(foot.s)
    return foot.s[ahead], foot.offset[ahead]


def interpolated(places: Floats, s: Floats, offset: Floats) -> Floats:
    """Interpolate offsets (r, 3) given at arc lengths s (r,) at other arc lengths (m,), (m, 3) [mm]."""
    return np.stack([np.interp(places, s, offset[:, i]) for i in range(3)], axis=1)
