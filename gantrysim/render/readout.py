"""What a picture says in numbers of a run: at every tick, from the record alone."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from gantrysim.arrays import Floats
from gantrysim.metrics.analysis import Analysis, path_speed
from gantrysim.run import Run

_UM = 1e3


class Readout:
    """Time, path speed and contour error of a run, tick by tick; each is worked out when it is first asked for.

    Args:
        run: the record; one that has only begun will do.

    Attributes:
        run: the record.
    """

    def __init__(self, run: Run) -> None:
        self.run = run

    @property
    def time(self) -> Floats:
        """Time of every tick, (n,) [s]."""
        return self.run.time

    @cached_property
    def speed(self) -> Floats:
        """Path speed of the nozzle, (n,) [mm/s]."""
        return path_speed(self.run)

    @cached_property
    def error(self) -> Floats:
        """Contour error: distance of the nozzle to the requested path; nan while the dispenser is off, (n,) [µm].

        It ends with the root mean square and the maximum of summary.json's "contour_error_um". In its "error_budget"
        the row "contour" is of the error normal to the requested path, which differs a little at corners and ends.
        """
        error = np.full(len(self.run.time), np.nan)
        if self.run.dispense.any():
            analysis = Analysis(self.run)
            error[analysis.ticks] = _UM * analysis.nozzle.distance
        return error

    @cached_property
    def rms(self) -> Floats:
        """Root mean square of the contour error until each tick; nan before the dispenser was on, (n,) [µm]."""
        on = np.isfinite(self.error)
        count = np.cumsum(on)
        square = np.cumsum(np.where(on, self.error, 0.0) ** 2)
        return np.sqrt(np.divide(square, count, out=np.full(len(on), np.nan), where=count > 0))

    @cached_property
    def max(self) -> Floats:
        """Largest contour error until each tick; nan before the dispenser was on, (n,) [µm]."""
        return np.fmax.accumulate(self.error)

    def tick(self, time: float) -> int:
        """Return the tick at a time [s]; that of the end after the end."""
        return int(np.clip(round(time / self.run.period), 0, len(self.run.time) - 1))

    def over(self, time: float) -> bool:
        """Whether the run has ended before a time [s]."""
        return time > float(self.time[-1]) + 0.5 * self.run.period

    def faulted(self, time: float) -> bool:
        """Whether a fault has ended the run by a time [s]."""
        return self.run.fault is not None and self.tick(time) == len(self.time) - 1
