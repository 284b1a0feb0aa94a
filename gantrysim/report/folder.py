"""What is written of a run: the job, the record, the plots, the summary, the report, the video; whole or not at all."""

from __future__ import annotations

import json
import math
import os
import platform
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from gantrysim.bead import BeadValues
from gantrysim.errors import InputError
from gantrysim.job.job import Job
from gantrysim.machine.machine import Machine
from gantrysim.metrics.analysis import ErrorSize, Range, torque_ripple
from gantrysim.metrics.budget import Budget, PartValues
from gantrysim.run import Run
from gantrysim.stability.margins import Margins, margins_of

JOB, RUN, SUMMARY, VIDEO, PLOTS = "job.toml", "run.npz", "summary.json", "video.mp4", "plots"
RENDER = "render"  # the film or picture that gantrysim render draws of a saved run, less its suffix
REPORT = "report.html"
RECORD = "record.csv"  # what the controller itself writes down, where its program asks for it
_DRAWN = ("plan", "error", "budget", "spacing", "bead")
_RENDERED = tuple(f"{RENDER}{suffix}" for suffix in (".mp4", ".gif", ".png"))
_FILES = (JOB, RUN, SUMMARY, VIDEO, REPORT, RECORD, *_RENDERED, *(f"{PLOTS}/{name}.png" for name in _DRAWN))

_THOUSANDTHS = 1e3
_PARTIAL = ".partial-"  # with the number of the process that writes it


@dataclass(frozen=True)
class Output:
    """The files that one kind of command writes into its folder.

    Attributes:
        kind: what the command makes, as a message names it.
        mark: the file that tells a folder of this kind.
        files: all that it may write, the mark included; none outside the folder and its folder of plots.
    """

    kind: str
    mark: str
    files: tuple[str, ...]

    def check(self, folder: Path) -> Path:
        """Return the absolute path of a folder that may be written to.

        Raises:
            InputError: it is a file, or holds such files that no command of this kind has written.
        """
        target = folder.expanduser().absolute()
        if target.exists() and not target.is_dir():
            raise InputError(f"--out {folder}: is a file, must be a folder")
        foreign = [name for name in self.files if (target / name).exists()]
        if foreign and not (target / self.mark).exists():
            raise InputError(
                f"--out {folder}: holds {foreign[0]}, which no {self.kind} has written: name another folder"
            )
        return target


_RUN_OUTPUT = Output("run", RUN, _FILES)


@contextmanager
def output_folder(folder: Path, output: Output = _RUN_OUTPUT) -> Iterator[Path]:
    """Give a scratch folder inside `folder`; on success its files take the places of an earlier run's, or study's.

    Other files in the folder stay. On failure nothing is left, not even a folder that was not there before.

    Args:
        folder: to write into.
        output: what is written, by default the files of a run.

    Raises:
        InputError: the folder cannot be made, or holds such files that no run has written.
    """
    target = output.check(folder)
    made = [parent for parent in (target, *target.parents) if not parent.exists()]
    try:
        target.mkdir(parents=True, exist_ok=True)
        _clear_away(target)
        scratch = Path(tempfile.mkdtemp(prefix=partial_name(""), dir=target))
    except OSError as error:
        raise InputError(f"--out {folder}: cannot be written: {error.strerror}") from None
    try:
        (scratch / PLOTS).mkdir()
        yield scratch
        (target / PLOTS).mkdir(exist_ok=True)
        for name in output.files:
            if (scratch / name).exists():
                (scratch / name).replace(target / name)
            else:  # the one there is another run's
                (target / name).unlink(missing_ok=True)
        with suppress(OSError):
            (target / PLOTS).rmdir()  # where it holds no plots
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
        if not (target / output.mark).exists():
            for parent in made:
                with suppress(OSError):
                    parent.rmdir()


def partial_name(name: str) -> str:
    """Return the name under which this process writes what is to be called `name`, hidden until it is whole."""
    return f"{_PARTIAL}{os.getpid()}-{name}"


def _clear_away(folder: Path) -> None:
    """Remove what processes that were killed have left of theirs."""
    for left in folder.glob(f"{_PARTIAL}*"):
        owner = left.name.removeprefix(_PARTIAL).partition("-")[0]
        if owner.isdigit() and not _alive(int(owner)):
            shutil.rmtree(left, ignore_errors=True)


def _alive(process: int) -> bool:
    """Whether there is a process of this number; where it cannot be asked harmlessly, yes."""
    if os.name != "posix":
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def write_run(folder: Path, job: Job, machine: Machine, budget: Budget, bead: BeadValues | None = None) -> None:
    """Write the job, the record, the summary, and what the controller has recorded into a folder."""
    run = budget.analysis.run
    (folder / JOB).write_text(job.toml(), encoding="utf-8")
    run.save(folder / RUN)
    content = json.dumps(summary(job, machine, budget, bead), indent=2, allow_nan=False)
    (folder / SUMMARY).write_text(content + "\n", encoding="utf-8")
    job.controller.write_record(run, folder / RECORD)


def summary(job: Job, machine: Machine, budget: Budget, bead: BeadValues | None = None) -> dict[str, Any]:
    """Return the content of summary.json; a key's unit stands in its name.

    error_budget holds by link, and for the whole as contour, what it adds to the error normal to the path
    (`PartValues`), by axis what the following error of each makes of the tracking part, and the links' errors by
    turn of a spiral; contour_error_um is the nozzle's distance to the path, which is more than error_budget's contour
    where the nozzle is beyond an end or outside a corner; requested_spacing_mm is null where the path asks for none,
    and bead_spacing_mm where the trace has no neighbouring turns; tracking_error_um.path is the tracking error along
    the path; tracking_error_mdeg, that of the rotary axes, is there only where the machine has some; path_length_mm
    is that of the commanded path while the dispenser was on; duration_s is the time at which the commanded motion
    ends; end_point_mm is the nozzle in the work frame when the run ends; servo holds by axis the ripple of its torque
    demand and the margins of its loop, null where there is none; bead holds the figures of `BeadValues` and
    is null where no glue is asked for; notes are what the controller had to say of its program; fault is null where
    the run went through.
    """
    run, figures = budget.analysis.run, budget.analysis.values
    tracking: dict[str, dict[str, Any]] = {"mm": {}, "deg": {}}
    for unit, (name, spread) in zip(run.units, figures.tracking.items(), strict=True):
        tracking[unit][name] = _thousandths(spread)
    rotary = {"tracking_error_mdeg": tracking["deg"]} if tracking["deg"] else {}
    return {
        "job": job.name,
        "machine": machine.name,
        "error_budget": _budget(budget, machine),
        "requested_spacing_mm": run.requested.turn_spacing,
        "bead_spacing_mm": None if figures.spacing is None else asdict(figures.spacing),
        "tracking_error_um": {**tracking["mm"], "path": _thousandths(figures.tracking_along)},
        **rotary,
        "generation_error_um": _thousandths(figures.generation),
        "contour_error_um": _thousandths(figures.contour),
        "path_speed_mm_s": _mean_min_max(figures.speed),
        "path_length_mm": figures.path_length,
        "duration_s": figures.duration,
        "end_point_mm": list(figures.end_point),
        "servo": _servo(job, machine, run),
        "bead": None if bead is None else _bead(bead),
        "notes": list(job.notes),
        "fault": _fault(run),
        "versions": versions(machine),
    }


def versions(machine: Machine) -> dict[str, str]:
    """Return the versions that a run's numbers depend on, and the digest of the compiled machine."""
    return {**package_versions(), "machine_sha256": machine.digest}


def package_versions() -> dict[str, str]:
    """Return the versions that a run's numbers depend on."""
    packages = {name: version(name) for name in ("mujoco", "numpy", "numba", "scipy")}
    return {"gantrysim": version("gantrysim"), **packages, "python": platform.python_version()}


def _budget(budget: Budget, machine: Machine) -> dict[str, Any]:
    def of(part: PartValues) -> dict[str, Any]:
        lengths = {f"{name}_um": _THOUSANDTHS * getattr(part, name) for name in ("rms", "p95", "max")}
        where = {"s_mm": part.s, "time_s": part.time, "point_mm": list(part.point)}
        return {**lengths, "share": part.share, "at_max": where}

    figures = budget.values
    turns = [
        {"turn": turn.turn, "s_mm": list(turn.s), **{name: _um(spread) for name, spread in turn.parts.items()}}
        for turn in figures.turns
    ]
    return {
        **{link: of(part) for link, part in figures.parts.items()},
        "contour": of(figures.contour),
        "tracking_by_axis": {
            axis: of(budget.values_of(part)) for axis, part in budget.tracking_by_axis(machine).items()
        },
        "lag_um": _thousandths(figures.lag),
        "turns": turns,
    }


def _servo(job: Job, machine: Machine, run: Run) -> dict[str, Any]:
    found = margins_of(machine, job.built_servo, job.simulation.physics_step)
    ripple = torque_ripple(run)
    return {
        axis.name: {
            "torque_ripple_nm": float(ripple[a]),
            "torque_ripple_share": float(ripple[a]) / axis.peak_torque,
            "margins": None if found is None else _margins(found[a]),
        }
        for a, axis in enumerate(machine.axes)
    }


def _margins(margins: Margins) -> dict[str, Any]:
    numbers = {
        "gain": margins.gain,
        "gain_lower": margins.gain_lower,
        "phase_deg": margins.phase,
        "delay_s": margins.delay,
        "sensitivity": margins.sensitivity,
        "crossover_hz": margins.crossover,
    }
    return {
        **{name: value if math.isfinite(value) else None for name, value in numbers.items()},
        "stable": margins.stable,
    }


def _um(spread: ErrorSize) -> dict[str, float]:
    return {f"{name}_um": value for name, value in _thousandths(spread).items()}


def _bead(figures: BeadValues) -> dict[str, Any]:
    def of(values: Range | None) -> dict[str, float] | None:
        return None if values is None else asdict(values)

    return {
        "nominal_section_mm2": figures.nominal,
        "section_mm2": of(figures.section),
        "width_mm": of(figures.width),
        "clearance_of_turns_mm": of(figures.clearance),
        "overlapping_share": figures.overlapping,
        "gapping_share": figures.gapping,
        "coverage": figures.coverage,
        "missing_at_start_mm": of(figures.start),
        "too_much_at_stop_mm": of(figures.stop),
        "seen_to_begin_late_mm": of(figures.begins),
        "seen_to_end_late_mm": of(figures.ends),
        "volume_mm3": figures.laid,
        "volume_asked_mm3": figures.asked,
        "volume_error_mm3": figures.error,
        "volume_error_percent": figures.error_percent,
        "volume_error_parts_mm3": {
            "ramps": figures.ramps,
            "starts": figures.starts,
            "running": figures.running,
            "stops": figures.stops,
        },
        "height_map_ridge": figures.ridge,
    }


def _fault(run: Run) -> dict[str, Any] | None:
    if run.fault is None:
        return None
    numbers = asdict(run.fault)
    for key in ("value", "limit"):
        if not math.isfinite(numbers[key]):
            numbers[key] = None
    return {**numbers, "text": str(run.fault)}


def _thousandths(spread: ErrorSize) -> dict[str, float]:
    return {"rms": _THOUSANDTHS * spread.rms, "max": _THOUSANDTHS * spread.max}


def _mean_min_max(values: Range) -> dict[str, float]:
    return {"mean": values.mean, "min": values.min, "max": values.max}
