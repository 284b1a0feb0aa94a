"""Time, path speed and contour error of a run at every tick, from its record."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit
from gantrysim.base.quantity import number_text
from gantrysim.bead.trace import BeadTrace
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.error_quantities import CONTOUR
from gantrysim.record.run import Run

_LARGE = 100.0  # error from which rms and maximum together are shown without decimals, for want of room [µm]


class Telemetry:
    """Time, path speed and contour error of a run at every tick; each is computed on first use.

    Args:
        run: the record, also of a run that has only begun.
        bead: the run's bead, if there is one already, which holds its analysis.

    Attributes:
        run: the record.
    """

    def __init__(self, run: Run, bead: BeadTrace | None = None) -> None:
        self.run = run
        self._bead = bead

    @property
    def time(self) -> Floats:
        """Time of every tick, (n,) [s]."""
        return self.run.time

    def speed(self, tick: int) -> float:
        """Return the path speed of the nozzle at a tick, `gantrysim.metrics.analysis.path_speed` [mm/s]."""
        before = max(tick - 1, 0)
        around = self.run.nozzle[before : tick + 2]
        if len(around) < 2:
            return 0.0
        return float(np.linalg.norm(np.gradient(around, self.run.period, axis=0)[tick - before]))

    @cached_property
    def error(self) -> Floats:
        """Contour error: distance of the nozzle to the requested path; nan while the dispenser is off, (n,) [µm].

        Its final rms and maximum are summary.json's "contour_rms_um" and "contour_max_um".
        """
        error = np.full(len(self.run.time), np.nan)
        if self.run.dispense.any():
            analysis = Analysis(self.run) if self._bead is None else self._bead.analysis
            error[analysis.ticks] = analysis.nozzle.distance
            error *= CONTOUR.factor
        return error

    @cached_property
    def rms(self) -> Floats:
        """Root mean square of the contour error up to each tick; nan before the dispenser is on, (n,) [µm]."""
        return _running_rms(self.error)

    @cached_property
    def max(self) -> Floats:
        """Largest contour error up to each tick; nan before the dispenser is on, (n,) [µm]."""
        return np.fmax.accumulate(self.error)

    def tick(self, time: float) -> int:
        """Return the tick at a time [s]; the last one after the end."""
        return int(np.clip(round(time / self.run.period), 0, len(self.run.time) - 1))

    def ended(self, time: float) -> bool:
        """Return whether the run has ended before a time [s]."""
        return time > float(self.time[-1]) + 0.5 * self.run.period

    def faulted(self, time: float) -> bool:
        """Return whether a fault has ended the run by a time [s]."""
        return self.run.fault is not None and self.tick(time) == len(self.time) - 1

    def error_text(self, tick: int) -> str:
        """Return the contour error at a tick with its unit, or "no glue" while the dispenser is off."""
        error = self.error[tick]
        return f"{number_text(error, CONTOUR.form)} {CONTOUR.unit}" if np.isfinite(error) else "no glue"

    def rms_max_text(self, tick: int) -> str:
        """Return rms and maximum contour error up to a tick with their unit."""
        if not np.isfinite(self.max[tick]):
            return "–"
        form = CONTOUR.form if self.max[-1] < _LARGE else ".0f"
        return f"{number_text(self.rms[tick], form)} / {number_text(self.max[tick], form)} {CONTOUR.unit}"


@jit
def _running_rms(values: Floats) -> Floats:
    """Return the root mean square of the finite values up to each, nan before the first, (n,); without other arrays."""
    rms = np.empty(values.size)
    count = 0
    square = 0.0
    for k in range(values.size):
        if np.isfinite(values[k]):
            count += 1
            square += values[k] ** 2
        rms[k] = np.sqrt(square / count) if count else np.nan
    return rms
