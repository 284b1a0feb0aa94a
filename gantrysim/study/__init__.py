"""Studies: many runs of a job, what they say, and a report of it."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from gantrysim.study.backends import on_backend
from gantrysim.study.cases import OK, Case, Row, figures_row, measure, simulated
from gantrysim.study.checks import NoFiguresError
from gantrysim.study.ledger import Ledger
from gantrysim.study.runner import run_cases
from gantrysim.study.study import Outcome, Plot, Rounds, Study, StudyInterrupted, run_study
from gantrysim.study.worker import WorkerError

if TYPE_CHECKING:
    from gantrysim.study.circle import CircleStudy
    from gantrysim.study.loop import LoopStudy
    from gantrysim.study.machine import MachineStudy
    from gantrysim.study.repeat import RepeatStudy
    from gantrysim.study.speed import SpeedStudy

__all__ = [
    "OK",
    "Case",
    "CircleStudy",
    "Ledger",
    "LoopStudy",
    "MachineStudy",
    "NoFiguresError",
    "Outcome",
    "Plot",
    "RepeatStudy",
    "Rounds",
    "Row",
    "SpeedStudy",
    "Study",
    "StudyInterrupted",
    "WorkerError",
    "figures_row",
    "measure",
    "on_backend",
    "run_cases",
    "run_study",
    "simulated",
]

# imported when they are asked for: each brings its plots and statistics with it
_STUDIES = {f"{name.capitalize()}Study": name for name in ("circle", "loop", "machine", "repeat", "speed")}


def __getattr__(name: str) -> Any:
    if name in _STUDIES:
        return getattr(import_module(f"gantrysim.study.{_STUDIES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
