"""The servo that a search has found, as a file that `gantrysim run --servo` takes."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version
from typing import TYPE_CHECKING

from gantrysim.controllers.servo import DERIVED

if TYPE_CHECKING:
    from gantrysim.tuning.search import History
    from gantrysim.tuning.study import TuningStudy

TUNED = "tuned.toml"

UNITS = {parameter.name: parameter.unit for parameter in DERIVED}  # u is the axis' own unit


def unit_of(name: str, units: Sequence[str]) -> str:
    """Return the unit of a value of the servo, given those of the axes; "u" stands for them where they differ."""
    return UNITS[name].replace("u", units[0]) if len(set(units)) == 1 else UNITS[name]


def servo_toml(study: TuningStudy, history: History) -> str:
    """Return the servo of a search as TOML: a table with everything that there is to say of it.

    What gains are derived from is left out, as there is nothing left to be derived.
    """
    job, servo, best = study.job, history.best.servo, history.best
    axes = job.built_machine.axes
    count, units = study.robust + 1, [axis.unit for axis in axes]
    lines = [
        f"# Gains for the job {job.name} on the machine {job.built_machine.name}, found by gantrysim tune "
        f"{version('gantrysim')}: law {study.searched_law},",
        f"# {study.figure} of {_micrometres(best.figure)}, before {_micrometres(history.start.figure)}"
        f"{f', the largest of {count} machines' if study.robust else ''};",
        f"# gain margin of {study.margin:g} in every direction, torque ripple of at most {study.ripple:g} % of the "
        "peak torque;",
        f"# candidate {best.number} of generation {best.generation}; {history.runs} runs, seed {study.seed}.",
        f"# It takes the place of a job's: gantrysim run JOB --servo {TUNED}",
        f"# One value per axis: {', '.join(f'{axis.name} [{axis.unit}]' for axis in axes)}.",
        "",
        "[servo]",
        f"period = {servo.period!r}  # [s]",
        f"delay = {servo.delay!r}  # [s]",
        f"following_error_limit = {job.servo.following_error_limit!r}  # [{unit_of('resolution', units)}]",
    ]
    for name in UNITS:
        values = ", ".join(repr(float(value)) for value in getattr(servo, name))
        lines.append(f"{name} = [{values}]  # [{unit_of(name, units)}]")
    return "\n".join(lines) + "\n"


def _micrometres(figure: float) -> str:
    return f"{figure:.4g} µm" if figure < float("inf") else "none, a fault"
