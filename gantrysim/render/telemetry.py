"""Time, path speed and contour error of a run at every tick, from its record."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.columns import Column, blocks, table_by_blocks
from gantrysim.base.jit import jit
from gantrysim.base.quantity import number_text
from gantrysim.glue.bead.trace import BeadTrace
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.error_quantities import CONTOUR
from gantrysim.record.run import Run

_LARGE_ERROR = 100.0  # error from which rms and maximum together are shown without decimals, for want of room [µm]


@dataclass(frozen=True)
class _Errors:
    """Contour error at every tick, and its rms and maximum until then, (n,) [µm]."""

    error: Column[Floats] = Column()
    rms: Column[Floats] = Column()
    max: Column[Floats] = Column()


class Telemetry:
    """Time, path speed and contour error of a run at every tick; errors are computed on first use.

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

    @property
    def error(self) -> Floats:
        """Contour error: distance of the nozzle to the requested path; nan while the dispenser is off, (n,) [µm].

        Its final rms and maximum are summary.json's "contour_rms_um" and "contour_max_um".
        """
        return self._errors.error

    @property
    def rms(self) -> Floats:
        """Root mean square of the contour error up to each tick; nan before the dispenser is on, (n,) [µm]."""
        return self._errors.rms

    @property
    def max(self) -> Floats:
        """Largest contour error up to each tick; nan before the dispenser is on, (n,) [µm]."""
        return self._errors.max

    @cached_property
    def _errors(self) -> _Errors:
        return table_by_blocks(self._blocks_of_errors(), len(self.run.time))

    def _blocks_of_errors(self) -> Iterator[_Errors]:
        """Yield the errors of one block of ticks after the other."""
        analysis = None
        if self.run.dispense.any():
            analysis = Analysis(self.run) if self._bead is None else self._bead.analysis
        # number of errors so far, and the sum of their squares
        state = np.zeros(2)
        largest = np.nan
        for block in blocks(len(self.run.time)):
            error = np.full(block.stop - block.start, np.nan)
            if analysis is not None:
                first, after = np.searchsorted(analysis.ticks, (block.start, block.stop))
                distance = analysis.nozzle.distance[first:after]
                error[analysis.ticks[first:after] - block.start] = CONTOUR.factor * distance
            rms = np.empty(error.size)
            _write_running_rms(error, state, rms)
            until = np.fmax.accumulate(np.append(largest, error))
            largest = until[-1]
            yield _Errors(error, rms, until[1:])

    def tick(self, time: float) -> int:
        """Return the tick at a time [s]; the last one after the end."""
        return int(np.clip(round(time / self.run.period), 0, len(self.run.time) - 1))

    def has_ended(self, time: float) -> bool:
        """Return whether the run has ended before a time [s]."""
        return time > float(self.time[-1]) + 0.5 * self.run.period

    def has_faulted(self, time: float) -> bool:
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
        form = CONTOUR.form if self.max[-1] < _LARGE_ERROR else ".0f"
        return f"{number_text(self.rms[tick], form)} / {number_text(self.max[tick], form)} {CONTOUR.unit}"


@jit
def _write_running_rms(values: Floats, state: Floats, rms: Floats) -> None:
    """Write the root mean square of the finite values up to each, nan before the first, (n,).

    Args:
        values: of a block.
        state: number of finite values in the blocks before, and the sum of their squares; brought up to date.
        rms: to be written.
    """
    for k in range(values.size):
        if np.isfinite(values[k]):
            state[0] += 1
            state[1] += values[k] ** 2
        rms[k] = np.sqrt(state[1] / state[0]) if state[0] else np.nan
