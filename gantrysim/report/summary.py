"""The content of summary.json: the numbers of a run, with the versions that they depend on."""

from __future__ import annotations

import math
import platform
from dataclasses import asdict
from importlib.metadata import version
from typing import Any

from gantrysim.bead import BeadValues
from gantrysim.job.causes import Causes
from gantrysim.job.job import Job
from gantrysim.job.losses import Losses, happened
from gantrysim.job.steps import run_notes
from gantrysim.machine.machine import Machine
from gantrysim.metrics.analysis import ErrorSize, Range, torque_ripple
from gantrysim.metrics.budget import Budget
from gantrysim.metrics.parts import PartValues
from gantrysim.record.run import Run
from gantrysim.report.causes import causes_summary
from gantrysim.report.headline import headline
from gantrysim.stability.margins import Margins

_THOUSANDTHS = 1e3


def summary(
    job: Job,
    machine: Machine,
    budget: Budget,
    bead: BeadValues | None = None,
    causes: Causes | None = None,
    losses: Losses | None = None,
) -> dict[str, Any]:
    """Return the content of summary.json; a key's unit stands in its name.

    The file begins with the verdict, see `Verdict.content`. Keys that need an explanation:

        error_budget: by link, and as contour for the whole, the error normal to the path (`PartValues`); by axis its
            share of the servo part; by turn of a spiral the links' errors
        causes: by cause the errors without it, and its worth (`Effect`); null without --causes
        contour_error_um: distance of the nozzle to the path, the size of error_budget's contour
        requested_spacing_mm, bead_spacing_mm: null where the path, or the trace, has no neighbouring turns
        following_error_um: by linear axis; path is the following error along the path
        following_error_mdeg: by rotary axis; only where the machine has some
        path_length_mm: of the commanded path while the dispenser is on
        duration_s: end of the commanded motion
        end_point_mm: the nozzle in the work frame at the end of the run
        servo: by axis its torque ripple and stability margins; an unbounded or unknown margin is null
        bead: `BeadValues`; null without glue
        fault: null for a complete run
        injected: faults on purpose, whether the run came to them, and what they cost (`Losses`); null without any
        headline: the result in a sentence or two; of a run with faults, what happened
    """
    run = budget.analysis.run
    values = budget.analysis.values
    following: dict[str, dict[str, Any]] = {"mm": {}, "deg": {}}
    for unit, (name, error) in zip(run.units, values.following.items(), strict=True):
        following[unit][name] = _thousandths(error)
    rotary = {"following_error_mdeg": following["deg"]} if following["deg"] else {}
    return {
        "job": job.name,
        "machine": machine.name,
        "error_budget": _budget(budget, machine),
        "causes": None if causes is None else causes_summary(causes),
        "requested_spacing_mm": run.requested.turn_spacing,
        "bead_spacing_mm": _range(values.spacing),
        "following_error_um": {**following["mm"], "path": _thousandths(values.following_along)},
        **rotary,
        "program_error_um": _thousandths(values.program),
        "contour_error_um": _thousandths(values.contour),
        "path_speed_mm_s": {"mean": values.speed.mean, "min": values.speed.min, "max": values.speed.max},
        "path_length_mm": values.path_length,
        "duration_s": values.duration,
        "end_point_mm": list(values.end_point),
        "servo": _servo(job, machine, run),
        "bead": None if bead is None else _bead(bead),
        "notes": list(run_notes(job, run)),
        "fault": _fault(run),
        "injected": _injected(run, losses),
        "headline": headline(budget, causes),
        "versions": versions(machine),
    }


def fault_summary(job: Job, machine: Machine, run: Run) -> dict[str, Any]:
    """Return the content of summary.json for a run that a fault ended before the dispenser was on: it has no errors."""
    return {
        "job": job.name,
        "machine": machine.name,
        "error_budget": None,
        "duration_s": float(run.time[-1]),
        "end_point_mm": run.nozzle[-1].tolist(),
        "bead": None,
        "notes": list(run_notes(job, run)),
        "fault": _fault(run),
        "injected": _injected(run, None),
        "headline": f"{happened(run)} The dispenser was never on: there are no errors to evaluate.",
        "versions": versions(machine),
    }


def versions(machine: Machine) -> dict[str, str]:
    """Return the versions that the numbers of a run depend on, and the digest of the compiled machine."""
    return {**package_versions(), "machine_sha256": machine.digest}


def package_versions() -> dict[str, str]:
    """Return the versions of the packages that the numbers of a run depend on."""
    packages = {name: version(name) for name in ("gantrysim", "mujoco", "numpy", "numba", "scipy")}
    return {**packages, "python": platform.python_version()}


def _budget(budget: Budget, machine: Machine) -> dict[str, Any]:
    def part(of: PartValues) -> dict[str, Any]:
        sizes = {f"{name}_um": _THOUSANDTHS * getattr(of, name) for name in ("rms", "p95", "max")}
        where = {"s_mm": of.s, "time_s": of.time, "point_mm": list(of.point)}
        return {**sizes, "share": of.share, "at_max": where}

    values = budget.values
    by_axis = budget.servo_by_axis(machine)
    return {
        **{name: part(of) for name, of in values.rows.items()},
        "servo_by_axis": {axis: part(budget.values_of(of)) for axis, of in by_axis.items()},
        "lag_um": _thousandths(values.lag),
        "turns": [
            {
                "turn": turn.turn,
                "name": turn.name,
                "s_mm": list(turn.s),
                **{name: _thousandths(size, "_um") for name, size in turn.parts.items()},
            }
            for turn in values.turns
        ],
    }


def _servo(job: Job, machine: Machine, run: Run) -> dict[str, Any]:
    margins = job.margins
    ripple = torque_ripple(run)
    return {
        axis.name: {
            "torque_ripple_nm": float(ripple[a]),
            "torque_ripple_share": float(ripple[a]) / axis.peak_torque,
            "margins": None if margins is None else _margins(margins[a]),
        }
        for a, axis in enumerate(machine.axes)
    }


def _margins(margins: Margins) -> dict[str, Any]:
    return {
        "gain": _finite(margins.gain),
        "gain_lower": _finite(margins.gain_lower),
        "phase_deg": _finite(margins.phase),
        "delay_s": _finite(margins.delay),
        "sensitivity": _finite(margins.sensitivity),
        "crossover_hz": _finite(margins.crossover),
        "stable": margins.stable,
    }


def _bead(bead: BeadValues) -> dict[str, Any]:
    return {
        "nominal_section_mm2": bead.nominal,
        "section_mm2": _range(bead.section),
        "width_mm": _range(bead.width),
        "clearance_of_turns_mm": _range(bead.clearance),
        "overlapping_share": bead.overlap_share,
        "gapping_share": bead.gap_share,
        "coverage": bead.coverage,
        "turns_apart_share": bead.apart_share,
        "turns_apart_mm": bead.height_apart,
        "missing_at_start_mm": _range(bead.missing_at_start),
        "too_much_at_stop_mm": _range(bead.excess_at_stop),
        "seen_to_begin_late_mm": _range(bead.delay_at_start),
        "seen_to_end_late_mm": _range(bead.overrun_at_stop),
        "volume_mm3": bead.volume,
        "volume_asked_mm3": bead.requested_volume,
        "volume_error_mm3": bead.volume_error,
        "volume_error_percent": bead.volume_error_percent,
        "volume_error_parts_mm3": bead.volume_error_parts,
        "height_map_ridge": bead.ridge,
    }


def _fault(run: Run) -> dict[str, Any] | None:
    if run.fault is None:
        return None
    numbers = {"value": _finite(run.fault.value), "limit": _finite(run.fault.limit)}
    return {**asdict(run.fault), **numbers, "text": str(run.fault)}


def _injected(run: Run, losses: Losses | None) -> dict[str, Any] | None:
    if not run.injected:
        return None
    faults = [
        {
            **{name: _finite(value) if isinstance(value, float) else value for name, value in fault.table().items()},
            "text": str(fault),
            "reached": fault.time <= float(run.time[-1]),
        }
        for fault in run.injected
    ]
    if losses is None:
        return {"faults": faults, "losses": None}
    lost = {
        "missing_volume_mm3": losses.volume,
        "missing_length_mm": losses.length,
        "width_error_mm": losses.width,
        "width_error_s_mm": losses.width_s,
        "nozzle_displaced_um": _THOUSANDTHS * losses.shift,
        "nozzle_displaced_s_mm": losses.shift_s,
    }
    return {"faults": faults, "losses": lost}


def _range(values: Range | None) -> dict[str, float] | None:
    return None if values is None else asdict(values)


def _thousandths(error: ErrorSize, suffix: str = "") -> dict[str, float]:
    return {f"rms{suffix}": _THOUSANDTHS * error.rms, f"max{suffix}": _THOUSANDTHS * error.max}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
