"""The limits that a program of printers' firmware has set so far."""

from __future__ import annotations

from typing import Any

from gantrysim.base.errors import positive
from gantrysim.controllers.gcode.motion_limits import MotionLimits

_MOST = 10_000  # settings of a program, which may set them anew at every line


class LimitsInForce:
    """Limits of speed, acceleration and corners while a program runs.

    Attributes:
        rows: limits that were in force, to which moves refer by their index.
    """

    def __init__(self) -> None:
        self.rows = [MotionLimits()]
        self._numbers = {self.rows[0]: 0}
        self._now = MotionLimits()
        self._printing: float | None = None
        self._travel: float | None = None
        self._index = {True: 0, False: 0}

    @property
    def now(self) -> MotionLimits:
        """The limits in force, without the accelerations along the path."""
        return self._now

    def index(self, feeds: bool) -> int:
        """Return the index of the limits of a move that feeds material or not."""
        return self._index[feeds]

    def change(self, **values: Any) -> None:
        """Set limits by their names, as of `MotionLimits`."""
        for name, value in values.items():
            for number in value if isinstance(value, tuple) else (value,):
                if number is not None and number != float("inf"):
                    positive(name.replace("_", " "), number)
        self._now = self._now._replace(**values)
        self._enter()

    def accelerate(self, printing: float | None, travel: float | None) -> None:
        """Set the acceleration along the path of moves that feed material, and of others; None leaves it [mm/s²]."""
        if printing is not None:
            self._printing = positive("acceleration", printing, "mm/s²")
        if travel is not None:
            self._travel = positive("acceleration", travel, "mm/s²")
        self._enter()

    def _enter(self) -> None:
        for feeds, acceleration in ((True, self._printing), (False, self._travel)):
            limits = self._now._replace(acceleration=acceleration)
            if limits not in self._numbers and len(self.rows) < _MOST:
                self._numbers[limits] = len(self.rows)
                self.rows.append(limits)
            self._index[feeds] = self._numbers.get(limits, self._index[feeds])
