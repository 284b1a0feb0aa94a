"""Repeatability in the manner of ISO: of an axis at its targets, ISO 230-2, and of a path, ISO 9283.

Both standards are followed as publicly described.
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
class Positioning:
    """Deviations of an axis at its targets, in the manner of ISO 230-2.

    ISO 230-2 "Test code for machine tools, part 2: Determination of accuracy and repeatability of positioning of
    numerically controlled axes", edition of 2014. With x_ij the deviation at target i in cycle j, approached from below
    (u) or above (d), xbar_i and s_i their mean and standard deviation over the cycles:

        B_i = xbar_i,u - xbar_i,d                                      B = max over i of |B_i|, reversal
        R_i,u = 4 s_i,u, likewise d                                    R_u, R_d: largest of them, one direction
        R_i = max(2 s_i,u + 2 s_i,d + |B_i|, R_i,u, R_i,d)             R: largest of them, both directions
        E = max over i, u, d of xbar - min over i, u, d of xbar        systematic deviation, both directions
        A = max over i, u, d of (xbar + 2 s) - min of (xbar - 2 s)     accuracy, both directions

    A data sheet that states a repeatability of plus or minus r usually means R / 2.

    Attributes:
        targets: positions of the axis, (m,) [mm].
        up: deviations after an approach from below, by cycle, (n, m) [mm].
        down: likewise from above, (n, m) [mm].

    Raises:
        InputError: deviations of other shapes, or of fewer than two cycles.
    """

    targets: Floats
    up: Floats
    down: Floats

    def __post_init__(self) -> None:
        cycles = len(self.up)
        if self.up.shape != self.down.shape or self.up.shape != (cycles, self.targets.size) or cycles < 2:
            raise InputError(
                f"deviations of shapes {self.up.shape} and {self.down.shape}: must be (n, {self.targets.size}) with n "
                "at least 2"
            )

    @property
    def reversal(self) -> float:
        """B [mm]."""
        return float(abs(self.up.mean(axis=0) - self.down.mean(axis=0)).max())

    @property
    def unidirectional_repeatability(self) -> float:
        """The larger of R_u and R_d [mm]."""
        return 4 * float(max(self.up.std(axis=0, ddof=1).max(), self.down.std(axis=0, ddof=1).max()))

    @property
    def repeatability(self) -> float:
        """R [mm]."""
        spread = 2 * (self.up.std(axis=0, ddof=1) + self.down.std(axis=0, ddof=1))
        both = spread + abs(self.up.mean(axis=0) - self.down.mean(axis=0))
        return max(float(both.max()), self.unidirectional_repeatability)

    @property
    def systematic(self) -> float:
        """E [mm]."""
        means = (self.up.mean(axis=0), self.down.mean(axis=0))
        return float(max(mean.max() for mean in means) - min(mean.min() for mean in means))

    @property
    def accuracy(self) -> float:
        """A [mm]."""
        highest = []
        lowest = []
        for deviation in (self.up, self.down):
            mean = deviation.mean(axis=0)
            spread = 2 * deviation.std(axis=0, ddof=1)
            highest.append((mean + spread).max())
            lowest.append((mean - spread).min())
        return float(max(highest) - min(lowest))


@dataclass(frozen=True, eq=False)
class RepeatedPath:
    """Path accuracy ATp and path repeatability RTp along a path that was run several times, in the manner of ISO 9283.

    ISO 9283:1998 "Manipulating industrial robots, performance criteria and related test methods", clause 8. With n
    cycles, m points c_i along the command path, and x_ij the point in which the j-th attained path meets the plane
    normal to the command path at c_i:

        xbar_i = mean over j of x_ij            barycentre
        ATp = max over i of |xbar_i - c_i|
        l_ij = |x_ij - xbar_i|,  lbar_i = mean over j of l_ij,  S_i^2 = sum over j of (l_ij - lbar_i)^2 / (n - 1)
        RTp = max over i of (lbar_i + 3 S_i)

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
