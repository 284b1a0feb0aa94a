"""Closed forms of the errors that a controller's program loop makes, as a study asks any controller for them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats


@dataclass(frozen=True)
class Deviation:
    """Root mean square and largest magnitude of a deviation [mm]."""

    rms: float
    max: float

    @classmethod
    def of(cls, deviation: Floats) -> Deviation:
        return cls(float(np.sqrt(np.mean(deviation**2))), float(np.max(np.abs(deviation))))


@dataclass(frozen=True)
class Spread:
    """Mean, standard deviation, smallest and largest of a length [mm]."""

    mean: float
    std: float
    min: float
    max: float

    @classmethod
    def of(cls, lengths: Floats) -> Spread:
        return cls(float(lengths.mean()), float(lengths.std()), float(lengths.min()), float(lengths.max()))


@dataclass(frozen=True)
class LoopErrors:
    """Predicted errors of a path that a program loop commands.

    Attributes:
        program: distance from the requested path [mm].
        spacing: of neighbouring turns, None without any [mm].
    """

    program: Deviation
    spacing: Spread | None


class LoopTheory(ABC):
    """Closed forms of the errors of a program that commands a path of turns in the passes of a loop.

    Among the arguments of such a program are `loop_period`, the nominal time of a pass, 0 for the continuous limit;
    `interpreter_time`, which a pass takes besides; and `servo_period`, at whose ticks commands take effect, 0 for a
    program that acts between ticks [s].

    Attributes:
        alone: arguments that remove all limits of the controller but its loop.
        exact_waits: arguments that remove the rounding of waits.
        ramps: the controller's word for the acceleration of its axes.
        wait: the controller's word for a wait.
        first_order: formula of `first_order_error`.
    """

    alone: ClassVar[Mapping[str, Any]]
    exact_waits: ClassVar[Mapping[str, Any]]
    ramps: ClassVar[str]
    wait: ClassVar[str]
    first_order: ClassVar[str]

    @property
    @abstractmethod
    def speed(self) -> float:
        """Programmed path speed [mm/s]."""

    @property
    @abstractmethod
    def pitch(self) -> float:
        """Requested distance of neighbouring turns [mm]."""

    @property
    @abstractmethod
    def wait_resolution(self) -> float:
        """Multiple to which waits are rounded down, 0 for exact waits [s]."""

    @property
    @abstractmethod
    def ramp_period(self) -> float | None:
        """Loop period whose error is that of the ramps; None without ramps [s]."""

    @abstractmethod
    def errors(self) -> LoopErrors | None:
        """Return the predicted errors; None without a loop, or where the controller refuses the program."""

    @abstractmethod
    def first_order_error(self, loop_period: float) -> float:
        """Return the rms distance from the requested path of the loop alone, to first order in its period [s], [mm]."""

    @abstractmethod
    def local_pitches(self, interpreter_time: ArrayLike) -> dict[str, Floats]:
        """Return the pitch over the interpreter time [s], (m,), at named places of the path, each (m,) [mm]."""

    @abstractmethod
    def radius_of_curvature(self, share: ArrayLike) -> Floats:
        """Return the requested path's radius of curvature after a share of its length, 0 to 1, each (m,) [mm]."""
