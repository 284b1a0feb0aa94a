"""The edge of the margin: the fastest loops of each shape, and the stiffest shape."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import minimize

from gantrysim.base.arrays import Floats
from gantrysim.study.tuning.space import SearchSpace
from gantrysim.study.tuning.stability import Fastest, Stability

_STEP = 0.3  # of the first simplex of the scan
_SHAPES = 40  # of a scan, for each coordinate of the loop
_NEAR = 0.01  # side of the scan's last simplex
_FLAT = 0.005  # and difference of the gains' logarithms there
_MISSED = 50.0  # in place of the negative logarithm of a gain where no frequency keeps the margin
_LEAST = 1e-30  # of a gain


@dataclass(eq=False)
class MarginEdge:
    """The fastest loops of shapes, each sought from those of the nearest shape that is known.

    A shape with a strong integral term keeps the margin in a narrow band of frequencies alone, which a search from far
    would miss.

    Args:
        space: of the servos.
        stability: whose margin is kept.
    """

    space: SearchSpace
    stability: Stability
    _shapes: list[Floats] = field(default_factory=list)
    _loops: list[Fastest] = field(default_factory=list)

    @property
    def _loop_names(self) -> list[str]:
        """Letters of the coordinates of a shape on which the margin depends: feed-forwards close no loop."""
        return [name for name in self.space.coordinates[1:] if name not in "va"]

    def fastest(self, shape: Floats) -> Fastest:
        """Return the fastest loops of a shape, (shapes,), that keep the margin."""
        loop = shape[: len(self._loop_names) * self.space.groups]
        guess = Fastest(np.zeros(self.space.groups))
        if self._shapes:
            distances = ((np.array(self._shapes) - loop) ** 2).sum(axis=1)
            nearest = int(np.argmin(distances))
            guess = self._loops[nearest]
            if distances[nearest] == 0:
                return guess
        fastest = self.stability.fastest(self.space, shape, guess)
        if fastest.excess <= 0:
            self._shapes.append(loop)
            self._loops.append(fastest)
        return fastest

    def stiffest(self) -> Floats:
        """Return the shape whose fastest loops have the largest product of kp and ki, or kp where ki is not searched.

        No run is needed. The error that a disturbance such as friction makes is its share of the loop's gain at its
        frequency: of ki where it is slow, of kp where it is fast. The largest ki alone lies at the tip of the shapes
        that keep the margin, where any step leaves them. All axes have one shape; feed-forwards are the natural ones.
        """
        natural = self.space.natural
        groups = self.space.groups
        gains = ("kp", "ki") if "n" in self.space.coordinates else ("kp",)
        count = len(self._loop_names)

        def shape_at(loop: Floats) -> Floats:
            return np.concatenate([np.repeat(loop, groups), natural[count * groups :]])

        def softness(loop: Floats) -> float:
            shape = shape_at(loop)
            fastest = self.fastest(shape)
            if fastest.excess > 0:
                return _MISSED + fastest.excess
            servo = self.space.servo(fastest.frequencies, shape)
            values = np.array([servo.per_axis(name) for name in gains])
            return -float(np.log(np.maximum(values, _LEAST)).sum(axis=0).mean())

        start = natural[: count * groups : groups]
        simplex = np.vstack([start, start - _STEP * np.eye(count)])
        options = {"initial_simplex": simplex, "xatol": _NEAR, "fatol": _FLAT, "maxfev": _SHAPES * count}
        stiffest = minimize(softness, start, method="Nelder-Mead", options=options).x
        return np.clip(shape_at(stiffest), *self.space.bounds.T)
