"""What is written of a run: the job, the record, the plots, the summary, the video; whole or not at all."""

from __future__ import annotations

import json
import math
import platform
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import gantrysim
from gantrysim.errors import InputError
from gantrysim.job import Job
from gantrysim.machine import Machine
from gantrysim.metrics import Figures, Range, Spread
from gantrysim.run import Run

__all__ = ["JOB", "PLOTS", "RUN", "SUMMARY", "VIDEO", "output_folder", "summary", "versions", "write_run"]

JOB, RUN, SUMMARY, VIDEO, PLOTS = "job.toml", "run.npz", "summary.json", "video.mp4", "plots"

_UM = 1e3


@contextmanager
def output_folder(folder: Path) -> Iterator[Path]:
    """Give a scratch folder beside `folder`; on success its content takes the place of an earlier run's.

    Raises:
        InputError: the folder cannot be made.
    """
    target = folder.expanduser().absolute()
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.exists() and not target.is_dir():
            raise InputError(f"--out {folder}: is a file, must be a folder")
        scratch = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    except OSError as error:
        raise InputError(f"--out {folder}: cannot be written: {error.strerror}") from None
    try:
        yield scratch
        target.mkdir(exist_ok=True)
        for name in (JOB, RUN, SUMMARY, VIDEO, PLOTS):
            _replace(scratch / name, target / name)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _replace(new: Path, old: Path) -> None:
    """Put `new` in the place of `old`; where there is no new one the old one belongs to another run."""
    if old.is_dir():
        shutil.rmtree(old)
    elif old.exists():
        old.unlink()
    if new.exists():
        new.replace(old)


def write_run(folder: Path, job: Job, machine: Machine, run: Run, figures: Figures) -> None:
    """Write the job, the record and the summary into a folder."""
    (folder / JOB).write_text(job.toml(), encoding="utf-8")
    run.save(folder / RUN)
    content = json.dumps(summary(job, machine, run, figures), indent=2, allow_nan=False)
    (folder / SUMMARY).write_text(content + "\n", encoding="utf-8")


def summary(job: Job, machine: Machine, run: Run, figures: Figures) -> dict[str, Any]:
    """Return the content of summary.json; a key's unit stands in its name.

    bead_spacing_mm is null where the trace has no neighbouring turns; tracking_error_um.path is the tracking
    error along the path; path_length_mm is that of the commanded path; end_point_mm is the nozzle in the
    work frame when the run ends; fault is null where the run went through.
    """
    return {
        "job": job.name,
        "machine": machine.name,
        "requested_spacing_mm": job.controller.thickness,
        "bead_spacing_mm": None if figures.spacing is None else asdict(figures.spacing),
        "tracking_error_um": {
            **{name: _micrometres(spread) for name, spread in figures.tracking.items()},
            "path": _micrometres(figures.tracking_along),
        },
        "generation_error_um": _micrometres(figures.generation),
        "contour_error_um": _micrometres(figures.contour),
        "path_speed_mm_s": _mean_min_max(figures.speed),
        "path_length_mm": figures.path_length,
        "duration_s": figures.duration,
        "end_point_mm": list(figures.end_point),
        "fault": _fault(run),
        "versions": versions(machine),
    }


def versions(machine: Machine) -> dict[str, str]:
    """Return the versions that a run's numbers depend on, and the digest of the compiled machine."""
    packages = {name: version(name) for name in ("mujoco", "numpy", "numba", "scipy")}
    return {
        "gantrysim": gantrysim.__version__,
        **packages,
        "python": platform.python_version(),
        "machine_sha256": machine.digest,
    }


def _fault(run: Run) -> dict[str, Any] | None:
    if run.fault is None:
        return None
    numbers = asdict(run.fault)
    for key in ("value", "limit"):
        if not math.isfinite(numbers[key]):
            numbers[key] = None
    return {**numbers, "text": str(run.fault)}


def _micrometres(spread: Spread) -> dict[str, float]:
    return {"rms": _UM * spread.rms, "max": _UM * spread.max}


def _mean_min_max(values: Range) -> dict[str, float]:
    return {"mean": values.mean, "min": values.min, "max": values.max}
