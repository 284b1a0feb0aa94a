"""Tuning: the gains with which a job's error is smallest, within a stability margin and on machines that differ."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gantrysim.tuning.study import TuningStudy

__all__ = ["TuningStudy"]


def __getattr__(name: str) -> Any:
    if name in __all__:  # imported when it is asked for: the command line needs no more of the package than a command
        from gantrysim.tuning.study import TuningStudy

        return TuningStudy
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
