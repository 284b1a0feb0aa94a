"""A measured trace beside its simulation: both error budgets, and what the model does not explain."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import find_peaks, welch

from gantrysim.base.arrays import Floats, spans
from gantrysim.base.errors import InputError
from gantrysim.base.quantity import contents, number_text
from gantrysim.compare.alignment import DEFAULT, Alignment, alignment_content
from gantrysim.compare.compare_quantities import DIFFERENCES, EXPLAINED, PEAK
from gantrysim.compare.equal_times import turned_points
from gantrysim.compare.measured import Trace
from gantrysim.compare.over_time import FOLLOWING, TORQUE, AxisDifference, axis_differences
from gantrysim.compare.trace_faults import aligned_beside_faults, fault_notes
from gantrysim.machine.machine import Machine
from gantrysim.metrics import circle_row
from gantrysim.metrics.analysis import Analysis, ErrorSize
from gantrysim.metrics.budget import DESCRIPTIONS, LINKS, Budget
from gantrysim.metrics.parts import Part
from gantrysim.record.run import Run

# The records of a measured and of a simulated run, at the same instants.
#
# The measured samples are never interpolated: the simulation, which is smooth, is taken at their instants.

_UNEVEN_PERIOD = 0.01  # of a period, between samples of one rate


def beside(trace: Trace, alignment: Alignment, run: Run, machine: Machine) -> tuple[Run, Run]:
    """Return the records of the measured and of the simulated run, at the trace's samples that are part of the run.

    A link that is not measured repeats the link before it, in both runs, so that its share is zero: without
    the encoder, the nozzle's whole deviation from the command is structure; without the nozzle, the rigid machine's at
    the encoder is the nozzle. Of an encoder that is measured on some axes alone, the others are the command. Command,
    dispenser and flow are the simulation's unless the command is measured. What no link needs is nan.

    Raises:
        InputError: the dispenser is off for as long as both last.
    """
    rows = covered_rows(alignment, run)
    instants = alignment.instants[rows]
    tick = _ticks_at(run, instants)
    if not run.dispense[tick].any():
        bead = run.time[np.flatnonzero(run.dispense)[[0, -1]]]
        raise InputError(
            f"the trace covers {instants[0]:.4g} to {instants[-1]:.4g} s of the run, in which the dispenser is off: "
            f"must cover some of {bead[0]:.4g} to {bead[1]:.4g} s"
        )
    simulated = simulated_record(trace, alignment, run, machine)
    measured = {"commanded": np.asarray(CubicSpline(run.time, run.commanded, axis=0)(instants))}
    if "commanded" in trace.axes:
        commanded = trace.axes["commanded"][rows] - alignment.offsets["axes"]
        measured["commanded"] = np.where(np.isnan(commanded), measured["commanded"], commanded)
    measured["encoder"] = measured["commanded"]
    if "encoder" in trace.axes:
        encoder = trace.axes["encoder"][rows] - alignment.offsets["axes"]
        measured["encoder"] = np.where(np.isnan(encoder), measured["commanded"], encoder)
    nozzle = machine.tip(measured["encoder"])
    if trace.nozzle is not None:
        nozzle = turned_points(trace.nozzle[rows] - alignment.offsets["nozzle"], -np.radians(alignment.rotation))
        nozzle = np.where(np.isnan(nozzle), machine.tip(measured["commanded"]), nozzle)
    torques = {kind: values[rows] for kind, values in trace.torques.items()}
    record = _record(simulated, machine, {**measured, **torques}, nozzle)
    # its own time: at other speeds the instants of the run are not even
    return replace(record, time=trace.time[rows] - trace.time[rows[0]] + instants[0]), simulated


def covered_rows(alignment: Alignment, run: Run) -> NDArray[np.intp]:
    """Return the samples of a trace that are part of a run."""
    instants = np.nan_to_num(alignment.instants, nan=-np.inf)
    return np.flatnonzero((instants >= run.time[0]) & (instants <= run.time[-1]))


def simulated_record(trace: Trace, alignment: Alignment, run: Run, machine: Machine) -> Run:
    """Return the record of a run at the samples of a trace, with the links that the trace measures; see `beside`."""
    rows = covered_rows(alignment, run)
    instants = alignment.instants[rows]
    tick = _ticks_at(run, instants)

    def at_samples(name: str) -> Floats:
        return np.asarray(CubicSpline(run.time, getattr(run, name), axis=0)(instants))

    chain = {"commanded": at_samples("commanded")}
    chain["encoder"] = chain["commanded"]
    if "encoder" in trace.axes:
        missing = np.isnan(trace.axes["encoder"][rows])
        chain["encoder"] = np.where(missing, chain["commanded"], at_samples("encoder"))
    nozzle = machine.tip(chain["encoder"])
    if trace.nozzle is not None:
        nozzle = np.where(np.isnan(trace.nozzle[rows]), machine.tip(chain["commanded"]), at_samples("nozzle"))
    # torques are held from tick to tick
    torques = {kind: np.asarray(getattr(run, kind))[tick] for kind in trace.torques}
    timed = replace(
        run,
        period=float(np.median(np.diff(trace.time))),
        time=instants,
        flow=run.flow[tick],
        flow_demand=run.flow_demand[tick],
        dispense=run.dispense[tick],
        progress=None if run.progress is None else np.interp(instants, run.time, run.progress),
    )
    return _record(timed, machine, {**chain, **torques}, nozzle)


def _ticks_at(run: Run, instants: Floats) -> NDArray[np.intp]:
    return np.clip(np.floor(instants / run.period + 1e-6).astype(np.intp), 0, len(run.time) - 1)


def _record(timed: Run, machine: Machine, columns: Mapping[str, Floats], nozzle: Floats) -> Run:
    """Return a record with other positions, of which a trace separates no more links."""
    tips = {link: machine.tip(columns[link]) for link in ("commanded", "encoder")}
    unknown = dict.fromkeys(("demand", "torque", "current", "voltage"), np.full_like(columns["encoder"], np.nan))
    changes: dict[str, Any] = {**unknown, **columns}
    return replace(
        timed,
        # a trace cannot separate errors of the geometry from structure
        geometric_tip=None,
        motor=columns["encoder"],
        commanded_tip=tips["commanded"],
        encoder_tip=tips["encoder"],
        motor_tip=tips["encoder"],
        nozzle=nozzle,
        **changes,
    )


def evenly(time: Floats) -> bool:
    """Return whether samples have one rate."""
    steps = np.diff(time)
    return bool(np.ptp(steps) <= _UNEVEN_PERIOD * np.median(steps))


# The part of a run that a measured trace covers.

_COVERED_TIME = 0.999  # of the dispensing time, from which a trace covers it all


def coverage(simulated: Run, run: Run, alignment: Alignment) -> list[str]:
    """Return notes on the part of the bead that the trace covers, and on other parts that it fits as well."""
    notes = []
    begin, end = simulated.time[[0, -1]].tolist()
    inside = (run.time > begin - run.period) & (run.time < end + run.period)
    covered = run.dispense[inside].sum() / run.dispense.sum()
    if covered < _COVERED_TIME:
        notes.append(
            f"the trace covers {begin:.4g} to {end:.4g} s of the run, {100 * covered:.1f} % of the time for which the "
            "dispenser is on"
        )
    if alignment.others:
        shifts = ", ".join(number_text(shift - alignment.shift, "+.4g") for shift in alignment.others)
        notes.append(
            f"the trace fits other parts of the run as well, with a time shift larger by {shifts} s: which part it "
            "covers is not identified"
        )
    return notes


PEAKS = 5  # of the spectrum that are named
_SEGMENT = 1024  # samples of a segment of the spectrum
NOTHING = 1e-6  # rms of an error, or of a peak of its spectrum, that is rounding [mm]
_EXACT_RMS = 2e-5  # rms of a difference of an exact trace, from its instants [mm, deg or N·m]
_NOISES = 1.5  # deviations of the noise, within which a difference is noise
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
        frictionless: the same of the machine without friction; None where that was not simulated.
        over_time: following errors and torques of the axes, those that are measured.
        links: what is measured.
        unmeasured_command: axes in motion whose command is not measured.
        alignment: of the trace.
        machine: of the run.
        notes: what had to be filled in, or was left out.
    """

    measured: Budget
    simulated: Budget
    frictionless: Budget | None
    over_time: tuple[AxisDifference, ...]
    links: tuple[str, ...]
    unmeasured_command: tuple[str, ...]
    alignment: Alignment
    machine: Machine
    notes: tuple[str, ...]

    @classmethod
    def of(
        cls,
        trace: Trace,
        run: Run,
        machine: Machine,
        what: tuple[str, ...] = DEFAULT,
        frictionless: Run | None = None,
        alignment: Alignment | None = None,
    ) -> Comparison:
        """Align a trace with a run, and compare them.

        Args:
            trace: measured.
            run: simulated, of the same program.
            machine: of the run.
            what: as in `aligned_trace`.
            frictionless: the same command on the machine without friction, see `frictionless_run`.
            alignment: with a run of the same command, in place of one that is sought.

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
        if alignment is None:
            alignment = aligned_beside_faults(trace, run, what)
        measured, simulated = beside(trace, alignment, run, machine)
        wrong = None if frictionless is None else simulated_record(trace, alignment, frictionless, machine)
        notes = [*trace.notes, *alignment.notes, *fault_notes(trace, run, alignment)]
        if "commanded" not in trace.links:
            notes.append("the command is not measured: it is the simulation's in both budgets")
        notes += coverage(simulated, run, alignment)
        if not evenly(measured.time):
            notes.append("the samples have no even rate: there is no spectrum")
        return cls(
            measured=Budget(Analysis(measured)),
            simulated=Budget(Analysis(simulated)),
            frictionless=None if wrong is None else Budget(Analysis(wrong)),
            over_time=tuple(axis_differences(trace, measured, simulated, wrong)),
            links=trace.links,
            unmeasured_command=unmeasured,
            alignment=alignment,
            machine=machine,
            notes=tuple(notes),
        )

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
    def not_over_time(self) -> dict[str, str]:
        """What is not compared over time, by axis and quantity, each with what is not measured."""
        compared = {(row.axis, row.quantity) for row in self.over_time}
        run = self.measured.analysis.run
        missing = {}
        for axis in run.axes:
            if (axis, FOLLOWING) not in compared:
                missing[f"{FOLLOWING} of {axis}"] = "command or encoder are not measured"
            if (axis, TORQUE) not in compared:
                missing[f"{TORQUE} of {axis}"] = "it is not measured"
        return missing

    @property
    def is_all_noise(self) -> bool:
        """Whether every link, following error and torque is measured, and every difference is within the noise."""
        if self.not_compared or self.not_over_time:
            return False
        allowed = max(_NOISES * math.sqrt(2) * self.alignment.noise, _EXACT_RMS)
        across = all(size.rms <= allowed for size in self.unexplained.values())
        return across and all(row.is_noise or row.difference.rms < _EXACT_RMS for row in self.over_time)

    @property
    def explained(self) -> Explained:
        """How much of the measured error the simulation explains."""
        return self._explained_by(self.simulated)

    @property
    def explained_without_friction(self) -> Explained | None:
        """The same of the machine without friction; None where that was not simulated."""
        return None if self.frictionless is None else self._explained_by(self.frictionless)

    def _explained_by(self, of_run: Budget) -> Explained:
        measured, simulated = (
            np.sum([_across(budget.parts[name]) for name in self.parts], axis=0) for budget in (self.measured, of_run)
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
        return {
            "links": list(self.links),
            "alignment": alignment_content(self.alignment),
            "budgets": budgets,
            "explained": _explained_content(self.explained),
            "explained_without_friction": _explained_content(self.explained_without_friction),
            "not_compared": self.not_compared,
            "over_time": [row.content() for row in self.over_time],
            "not_over_time": self.not_over_time,
            "unexplained": {name: contents(DIFFERENCES, size) for name, size in self.unexplained.items()},
            "spectrum_peaks": [contents(PEAK, peak) for peak in self.peaks],
            "notes": list(self.notes),
        }


def _explained_content(explained: Explained | None) -> dict[str, Any] | None:
    return None if explained is None else {"links": list(explained.links), **contents(EXPLAINED, explained)}


def _unmeasured_command(trace: Trace, run: Run) -> tuple[str, ...]:
    """Return the axes that the program moves and whose command the trace lacks."""
    moving = np.ptp(run.commanded, axis=0) > 0
    command = trace.axes.get("commanded", np.full(run.commanded.shape, np.nan))
    missing = moving & np.isnan(command).all(axis=0)
    return tuple(axis for axis, unmeasured in zip(run.axes, missing, strict=True) if unmeasured)


def _across(part: Part) -> Floats:
    """Return an error across the path, lateral and vertical, (m, 2) [mm]."""
    return np.column_stack([part.lateral, part.vertical])
