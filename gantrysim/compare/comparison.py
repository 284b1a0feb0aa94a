"""A measured trace beside its simulation: both error budgets, and what the model does not explain."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import find_peaks, welch

from gantrysim.base.arrays import Floats, spans
from gantrysim.base.errors import InputError
from gantrysim.base.quantity import contents
from gantrysim.compare.alignment import Alignment, turned_points
from gantrysim.compare.compare_quantities import DIFFERENCES, EXPLAINED, PEAK, ROTATION, SHIFT
from gantrysim.compare.measured import Trace
from gantrysim.compare.trace_faults import aligned_as_named, scale_and_clock
from gantrysim.machine.machine import Machine
from gantrysim.metrics import circle_row
from gantrysim.metrics.analysis import Analysis, ErrorSize
from gantrysim.metrics.budget import DESCRIPTIONS, LINKS, Budget
from gantrysim.metrics.parts import Part
from gantrysim.record.run import Run

# The records of a measured and of a simulated run, at the same instants.
#
# The measured samples are never interpolated: the simulation, which is smooth, is taken at their instants.

_UNEVEN = 0.01  # of a period, between samples of one rate


def beside(trace: Trace, alignment: Alignment, run: Run, machine: Machine) -> tuple[Run, Run]:
    """Return the records of the measured and of the simulated run, at the trace's instants that both cover.

    A link that is not measured repeats the link before it, in both runs, so that its share is zero: without
    the encoder, the nozzle's whole deviation from the command is structure; without the nozzle, the rigid machine's at
    the encoder is the nozzle. Of an encoder that is measured on some axes alone, the others are the command. Command,
    dispenser and flow are the simulation's unless the command is measured. What no link needs is nan.

    Raises:
        InputError: the dispenser is off for as long as both last.
    """
    instants = trace.time - alignment.shift
    rows = np.flatnonzero((instants >= run.time[0]) & (instants <= run.time[-1]))
    instants = instants[rows]
    period = float(np.median(np.diff(trace.time)))
    tick = np.clip(np.floor(instants / run.period + 1e-6).astype(int), 0, len(run.time) - 1)
    if not run.dispense[tick].any():
        bead = run.time[np.flatnonzero(run.dispense)[[0, -1]]]
        raise InputError(
            f"the trace covers {instants[0]:.4g} to {instants[-1]:.4g} s of the run, in which the dispenser is off: "
            f"must cover some of {bead[0]:.4g} to {bead[1]:.4g} s"
        )
    simulated = {name: CubicSpline(run.time, getattr(run, name), axis=0)(instants) for name in ("commanded", "encoder")}
    measured: dict[str, Floats] = {"commanded": simulated["commanded"]}
    if "commanded" in trace.axes:
        commanded = trace.axes["commanded"][rows] - alignment.offsets["axes"]
        measured["commanded"] = np.where(np.isnan(commanded), simulated["commanded"], commanded)
    if "encoder" in trace.axes:
        encoder = trace.axes["encoder"][rows] - alignment.offsets["axes"]
        missing = np.isnan(encoder)
        measured["encoder"] = np.where(missing, measured["commanded"], encoder)
        simulated["encoder"] = np.where(missing, simulated["commanded"], simulated["encoder"])
    else:
        measured["encoder"] = measured["commanded"]
        simulated["encoder"] = simulated["commanded"]
    records = []
    for chain, actual in ((measured, True), (simulated, False)):
        tips = {link: machine.tip(chain[link]) for link in ("commanded", "encoder")}
        if trace.nozzle is None:
            nozzle = tips["encoder"]
        elif actual:
            nozzle = turned_points(trace.nozzle[rows] - alignment.offsets["nozzle"], -np.radians(alignment.rotation))
            nozzle = np.where(np.isnan(nozzle), tips["commanded"], nozzle)
        else:
            nozzle = CubicSpline(run.time, run.nozzle, axis=0)(instants)
            nozzle = np.where(np.isnan(trace.nozzle[rows]), tips["commanded"], nozzle)
        # a trace cannot separate errors of the geometry from structure
        columns: dict[str, Any] = {
            "geometric_tip": None,
            **chain,
            **dict.fromkeys(("demand", "torque", "current", "voltage"), np.full_like(chain["encoder"], np.nan)),
        }
        records.append(
            replace(
                run,
                period=period,
                time=instants,
                **columns,
                motor=chain["encoder"],
                commanded_tip=tips["commanded"],
                encoder_tip=tips["encoder"],
                motor_tip=tips["encoder"],
                nozzle=nozzle,
                flow=run.flow[tick],
                flow_demand=run.flow_demand[tick],
                dispense=run.dispense[tick],
                progress=None if run.progress is None else np.interp(instants, run.time, run.progress),
            )
        )
    return records[0], records[1]


def evenly(time: Floats) -> bool:
    """Return whether samples have one rate."""
    steps = np.diff(time)
    return bool(np.ptp(steps) <= _UNEVEN * np.median(steps))


# The part of a run that a measured trace covers.

_WHOLE = 0.999  # of the dispensing time, from which a trace covers it all


def coverage(measured: Run, run: Run, alignment: Alignment) -> list[str]:
    """Return notes on the part of the bead that the trace covers, and on other parts that it fits as well."""
    notes = []
    covered = measured.dispense.sum() * measured.period / (run.dispense.sum() * run.period)
    if covered < _WHOLE:
        notes.append(
            f"the trace covers {measured.time[0]:.4g} to {measured.time[-1]:.4g} s of the run, {100 * covered:.1f} % "
            "of the time for which the dispenser is on"
        )
    if alignment.others:
        shifts = ", ".join(f"{shift - alignment.shift:+.4g}" for shift in alignment.others)
        notes.append(
            f"the trace fits other parts of the run as well, with a time shift larger by {shifts} s: which part it "
            "covers is not identified"
        )
    return notes


PEAKS = 5  # of the spectrum that are named
_SEGMENT = 1024  # samples of a segment of the spectrum
NOTHING = 1e-6  # rms of an error, or of a peak of its spectrum, that is rounding [mm]
_FEW_SAMPLES = 64  # samples below which there is no spectrum


class Peak(NamedTuple):
    """A peak of the spectrum of what the model does not explain.

    Attributes:
        frequency: [Hz].
        rms: of the difference within the peak's bin and its neighbours [mm].
    """

    frequency: float
    rms: float


@dataclass(frozen=True)
class Explained:
    """How much of the measured error the simulation explains, over the links that are compared.

    With m the measured error across the path, the sum of those links, and s the simulated one at the same instants,

        share = 1 - sum |m - s|^2 / sum |m|^2

    A link that is not measured is in neither sum: it is the simulation's in both budgets, and would explain itself.

    Attributes:
        links: that are compared.
        measured, simulated: rms of the error [mm].
        difference: rms of the difference [mm].
        share: explained share of the measured mean square, at most 1 and below zero where the difference is larger
            than the error; None where there is no measured error.
    """

    links: tuple[str, ...]
    measured: float
    simulated: float
    difference: float
    share: float | None


@dataclass(frozen=True, eq=False)
class Comparison:
    """A measured trace and the simulation at its instants.

    Attributes:
        measured, simulated: budgets over the same samples and links.
        links: what is measured.
        unmeasured_command: axes in motion whose command is not measured.
        alignment: of the trace.
        machine: of the run.
        notes: what had to be filled in, or was left out.
    """

    measured: Budget
    simulated: Budget
    links: tuple[str, ...]
    unmeasured_command: tuple[str, ...]
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
            InputError: a run that ended in a fault, a trace that covers none of the bead, one whose axes are swapped,
                mirrored or in another unit, or one that measures the command of some axes alone.
        """
        if run.fault is not None:
            raise InputError(f"the run ended in a fault, which no trace can be compared with: {run.fault}")
        unmeasured = _unmeasured_command(trace, run)
        if trace.links == ("commanded",) and unmeasured:
            raise InputError(
                f"the trace has the command of some axes alone, not of {', '.join(unmeasured)}: must have that of "
                "every axis in motion, the encoders or the nozzle"
            )
        alignment = aligned_as_named(trace, run, what)
        measured, simulated = beside(trace, alignment, run, machine)
        notes = [*trace.notes, *scale_and_clock(trace, run, alignment)]
        if "commanded" not in trace.links:
            notes.append("the command is not measured: it is the simulation's in both budgets")
        notes += coverage(measured, run, alignment)
        if not evenly(measured.time):
            notes.append("the samples have no even rate: there is no spectrum")
        of_trace = Budget(Analysis(measured))
        of_run = Budget(Analysis(simulated))
        return cls(of_trace, of_run, trace.links, unmeasured, alignment, machine, tuple(notes))

    @property
    def parts(self) -> dict[str, str]:
        """The links that are compared, with what they span: those that the trace measures and separates."""
        spans = {}
        if not self.unmeasured_command:
            spans["program"] = DESCRIPTIONS["program"]
        last = "commanded"
        if "encoder" in self.links:
            spans["servo"] = DESCRIPTIONS["servo"]
            last = "encoder"
        if "nozzle" in self.links:
            spans["structure"] = f"{last} to nozzle"
        return spans

    @property
    def not_compared(self) -> dict[str, str]:
        """The links that are not compared, each with what is not measured."""
        missing = {}
        if self.unmeasured_command:
            of = f" of {', '.join(self.unmeasured_command)}" if "commanded" in self.links else ""
            missing["program"] = f"the command{of} is not measured"
        if "nozzle" not in self.links:
            if "encoder" not in self.links:
                missing["servo"] = "the encoder is not measured"
            missing["structure"] = "the nozzle is not measured"
        return missing

    @property
    def explained(self) -> Explained:
        """How much of the measured error the simulation explains."""
        measured, simulated = (
            np.sum([_across(budget.parts[name]) for name in self.parts], axis=0)
            for budget in (self.measured, self.simulated)
        )
        size, simulated_size, difference = (
            ErrorSize.of(np.linalg.norm(error, axis=1)).rms for error in (measured, simulated, measured - simulated)
        )
        share = 1 - (difference / size) ** 2 if size >= NOTHING else None
        return Explained(tuple(self.parts), size, simulated_size, difference, share)

    @cached_property
    def difference(self) -> dict[str, Floats]:
        """Measured less simulated error across the path, of each link and in all as "contour", (m, 2) [mm]."""
        differences = {}
        for name in (*LINKS, "contour"):
            measured, simulated = (
                budget.contour if name == "contour" else budget.parts[name]
                for budget in (self.measured, self.simulated)
            )
            differences[name] = _across(measured) - _across(simulated)
        return differences

    @property
    def unexplained(self) -> dict[str, ErrorSize]:
        """Size of the difference of each link that is compared, and of the contour error [mm]."""
        return {name: ErrorSize.of(np.linalg.norm(self.difference[name], axis=1)) for name in (*self.parts, "contour")}

    @cached_property
    def spectrum(self) -> tuple[Floats, Floats]:
        """Frequencies [Hz], and the density of the lateral difference of the contour error [mm²/Hz].

        It is of the longest stretch with the dispenser on, by Welch's method; empty where the samples have no even
        rate, or are too few.
        """
        run = self.measured.analysis.run
        first, after = max(spans(run.dispense), key=lambda span: span[1] - span[0])
        if after - first < _FEW_SAMPLES or not evenly(run.time):
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
        peaks = [Peak(float(frequency[k]), math.sqrt(float(density[max(k - 1, 0) : k + 2].sum() * step))) for k in best]
        return [peak for peak in peaks if peak.rms > NOTHING]

    def circle(self, radius: float, centre: tuple[float, float] = (0.0, 0.0)) -> dict[str, Mapping[str, Any]]:
        """Return the values of `gantrysim study circle` of both, over the circle's middle 360 degrees.

        Args:
            radius: of the nominal circle [mm].
            centre: of the nominal circle, in the work frame [mm].

        Raises:
            InputError: the command is no full circle about the centre.
        """
        rows: dict[str, Mapping[str, Any]] = {}
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
            rows[name] = {key: value for key, value in row.items() if not isinstance(value, list)}
        return rows

    def summary(self) -> dict[str, Any]:
        """Return all values, for JSON; a key ends in its unit, offsets and residual are in mm or deg."""
        budgets = {}
        for name, budget in (("measured", self.measured), ("simulated", self.simulated)):
            parts = {part: budget.values.parts[part] for part in self.parts} | {"contour": budget.values.contour}
            budgets[name] = {part: values.content() for part, values in parts.items()}
        alignment = {
            "by": self.alignment.by,
            **contents((SHIFT, ROTATION), self.alignment),
            "offsets": {name: values.tolist() for name, values in self.alignment.offsets.items()},
            "residual": self.alignment.residual,
        }
        return {
            "links": list(self.links),
            "alignment": alignment,
            "budgets": budgets,
            "explained": {"links": list(self.explained.links), **contents(EXPLAINED, self.explained)},
            "not_compared": self.not_compared,
            "unexplained": {name: contents(DIFFERENCES, size) for name, size in self.unexplained.items()},
            "spectrum_peaks": [contents(PEAK, peak) for peak in self.peaks],
            "notes": list(self.notes),
        }


def _unmeasured_command(trace: Trace, run: Run) -> tuple[str, ...]:
    """Return the axes that the program moves and whose command the trace lacks."""
    moving = np.ptp(run.commanded, axis=0) > 0
    command = trace.axes.get("commanded", np.full(run.commanded.shape, np.nan))
    missing = moving & np.isnan(command).all(axis=0)
    return tuple(axis for axis, unmeasured in zip(run.axes, missing, strict=True) if unmeasured)


def _across(part: Part) -> Floats:
    """Return an error across the path, lateral and vertical, (m, 2) [mm]."""
    return np.column_stack([part.lateral, part.vertical])
