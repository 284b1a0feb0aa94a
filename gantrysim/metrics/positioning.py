"""Positioning of an axis in the manner of ISO 230-2.

ISO 230-2 "Test code for machine tools, part 2: Determination of accuracy and repeatability of positioning of
numerically controlled axes", edition of 2014, as publicly described. With x_ij the deviation at target i in cycle j,
approached from below (u) or above (d), xbar_i and s_i their mean and standard deviation over the cycles:

    B_i = xbar_i,u - xbar_i,d                                          B = max over i of |B_i|, reversal
    R_i,u = 4 s_i,u, likewise d                                        R_u, R_d: largest of them, one direction
    R_i = max(2 s_i,u + 2 s_i,d + |B_i|, R_i,u, R_i,d)                 R: largest of them, both directions
    E = max over i, u, d of xbar - min over i, u, d of xbar            systematic deviation, both directions
    A = max over i, u, d of (xbar + 2 s) - min of (xbar - 2 s)         accuracy, both directions

A data sheet that states a repeatability of plus or minus r usually means R / 2.
"""

from __future__ import annotations

from dataclasses import dataclass

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError


@dataclass(frozen=True, eq=False)
class Positioning:
    """Deviations of an axis at its targets.

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
