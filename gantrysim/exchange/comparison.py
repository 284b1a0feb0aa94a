"""A measured trace beside its simulation: both error budgets, and what the model does not explain."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import find_peaks, welch

from gantrysim.arrays import Floats, spans
from gantrysim.errors import InputError
from gantrysim.exchange.alignment import Alignment, aligned
from gantrysim.exchange.beside import beside, evenly
from gantrysim.exchange.measured import Trace
from gantrysim.machine.machine import Machine
from gantrysim.metrics.analysis import Analysis, ErrorSize
from gantrysim.metrics.budget import DESCRIPTIONS, LINKS, Budget
from gantrysim.run import Run
from gantrysim.study.circle.study import circle_row

PEAKS = 5  # of the spectrum that are named
_SEGMENT = 1024  # samples of a segment of the spectrum
_NOTHING = 1e-6  # rms of a peak that is rounding [mm]
_FEW = 64  # samples below which there is no spectrum


class Peak(NamedTuple):
    """A peak of the spectrum of what the model does not explain.

    Attributes:
        frequency: [Hz].
        rms: of the difference within the peak's bin and its neighbours [mm].
    """

    frequency: float
    rms: float


@dataclass(frozen=True, eq=False)
class Comparison:
    """A measured trace and the simulation at its instants.

    Attributes:
        measured, simulated: budgets over the same samples and links.
        links: what is measured.
        alignment: of the trace.
        machine: of the run.
        notes: what had to be filled in, or was left out.
    """

    measured: Budget
    simulated: Budget
    links: tuple[str, ...]
    alignment: Alignment
    machine: Machine
    notes: tuple[str, ...]

    @classmethod
    def of(cls, trace: Trace, run: Run, machine: Machine, what: tuple[str, ...] = ("time", "offset")) -> Comparison:
        """Align a trace with a run, and compare them.

        Args:
            trace: measured.
            run: simulated, of the same program.
            machine: of the run.
            what: as in `aligned`.

        Raises:
            InputError: a run that ended in a fault, or a trace that does not cover the start of the bead.
        """
        if run.fault is not None:
            raise InputError(f"the run ended in a fault, which no trace can be compared with: {run.fault}")
        Analysis(run)
        found = aligned(trace, run, what)
        measured, simulated = beside(trace, found, run, machine)
        notes = list(trace.notes)
        if "commanded" not in trace.links:
            notes.append("the command is not measured: it is the simulation's in both budgets")
        covered = measured.dispense.sum() * measured.period / (run.dispense.sum() * run.period)
        if covered < 0.999:
            notes.append(f"the trace covers {100 * covered:.1f} % of the time for which the dispenser is on")
        if not evenly(measured.time):
            notes.append("the samples have no even rate: there is no spectrum")
        return cls(Budget(measured), Budget(simulated), trace.links, found, machine, tuple(notes))

    @property
    def parts(self) -> dict[str, str]:
        """The links that the trace tells apart, with what they span."""
        told = {"generation": DESCRIPTIONS["generation"]}
        last = "commanded"
        if "encoder" in self.links:
            told["tracking"], last = DESCRIPTIONS["tracking"], "encoder"
        if "nozzle" in self.links:
            told["structure"] = f"{last} to nozzle"
        return told

    @cached_property
    def difference(self) -> dict[str, Floats]:
        """Measured less simulated error across the path, of each link and in all as "contour", (m, 2) [mm]."""
        found = {}
        for name in (*LINKS, "contour"):
            one, other = (
                budget.contour if name == "contour" else budget.parts[name]
                for budget in (self.measured, self.simulated)
            )
            found[name] = np.column_stack([one.lateral - other.lateral, one.vertical - other.vertical])
        return found

    @property
    def unexplained(self) -> dict[str, ErrorSize]:
        """Size of the difference of each link that is told apart, and of the contour error [mm]."""
        return {name: ErrorSize.of(np.linalg.norm(self.difference[name], axis=1)) for name in (*self.parts, "contour")}

    @cached_property
    def spectrum(self) -> tuple[Floats, Floats]:
        """Frequencies [Hz], and the density of the lateral difference of the contour error [mm²/Hz].

        It is of the longest stretch with the dispenser on, by Welch's method; empty where the samples have no even
        rate, or are too few.
        """
        run = self.measured.analysis.run
        first, after = max(spans(run.dispense), key=lambda span: span[1] - span[0])
        if after - first < _FEW or not evenly(run.time):
            return np.zeros(0), np.zeros(0)
        start = int(np.searchsorted(self.measured.analysis.ticks, first))
        lateral = self.difference["contour"][start : start + after - first, 0]
        frequency, density = welch(lateral, 1 / run.period, nperseg=min(_SEGMENT, lateral.size), detrend="linear")
        return np.asarray(frequency), np.asarray(density)

    @property
    def peaks(self) -> list[Peak]:
        """The highest peaks of the spectrum that stand out from it by a factor of ten, highest first."""
        frequency, density = self.spectrum
        if not density.size:
            return []
        floor = float(np.median(density))
        places, _ = find_peaks(density, height=10 * floor, distance=3)
        best = sorted(places, key=lambda k: -density[k])[:PEAKS]
        step = frequency[1] - frequency[0]
        found = [Peak(float(frequency[k]), math.sqrt(float(density[max(k - 1, 0) : k + 2].sum() * step))) for k in best]
        return [peak for peak in found if peak.rms > _NOTHING]

    def circle(self, radius: float, centre: tuple[float, float] = (0.0, 0.0)) -> dict[str, Mapping[str, Any]]:
        """Return the values of `gantrysim study circle` of both, over the circle's middle 360 degrees.

        Args:
            radius: of the nominal circle [mm].
            centre: of the nominal circle, in the work frame [mm].

        Raises:
            InputError: the command is no full circle about the centre.
        """
        found: dict[str, Mapping[str, Any]] = {}
        for name, budget in (("measured", self.measured), ("simulated", self.simulated)):
            run = budget.analysis.run
            x, y = (run.commanded_tip[:, :2] - centre).T
            off = float(np.abs(np.hypot(x, y) - radius).max())
            swept = float(np.ptp(np.degrees(np.unwrap(np.arctan2(y, x)))))
            if off > 0.1 * radius or swept < 360:
                raise InputError(
                    f"circle: the command runs {swept:.4g} deg about {centre[0]:g}, {centre[1]:g} mm, up to {off:.4g} "
                    f"mm off the radius of {radius:g} mm: must be a full circle there"
                )
            row = circle_row(run, centre, radius, (swept - 360) / 2, 15.0)
            found[name] = {key: value for key, value in row.items() if not isinstance(value, list)}
        return found

    def summary(self) -> dict[str, Any]:
        """Return all values, for JSON; lengths in mm."""
        budgets = {}
        for name, budget in (("measured", self.measured), ("simulated", self.simulated)):
            parts = {part: budget.values.parts[part] for part in self.parts} | {"contour": budget.values.contour}
            budgets[name] = {part: asdict(values) for part, values in parts.items()}
        alignment = asdict(self.alignment)
        alignment["offsets"] = {name: values.tolist() for name, values in self.alignment.offsets.items()}
        return {
            "links": list(self.links),
            "alignment": alignment,
            "budgets": budgets,
            "unexplained": {name: asdict(size) for name, size in self.unexplained.items()},
            "spectrum_peaks": [peak._asdict() for peak in self.peaks],
            "notes": list(self.notes),
        }
