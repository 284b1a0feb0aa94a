"""Input shaping by three impulses, less sensitive to the frequency than two."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.record.setpoints import Setpoints
from gantrysim.servo.laws.zv import Zv, impulses, shaped_setpoints


def three_impulses(frequency: float, damping: float, period: float) -> Floats:
    """Return the weights of the setpoints of 0, 1, 2, ... ticks ago, (n,): those of ZV twice; see `impulses`."""
    two = impulses(frequency, damping, period)
    return np.convolve(two, two)


class Zvd(Zv):
    """The law as one of the ladder. It has no linear model: it changes the setpoints, not the loop."""

    name = "zvd"
    meaning = "input shaping by three impulses"
    excludes = ("zv",)

    def sent(self, values: Mapping[str, Sequence[float]], setpoints: Setpoints) -> Setpoints:
        return shaped_setpoints(values, setpoints, three_impulses)


ZVD = Zvd()
