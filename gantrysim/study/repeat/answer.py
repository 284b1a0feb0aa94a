"""The answer of a repeat study: whether every repeat keeps the limits, and what to change where one does not."""

from __future__ import annotations

from collections.abc import Sequence

from gantrysim.metrics import RepeatedPath
from gantrysim.report.plots.style import UM
from gantrysim.study.acceptance import Acceptance, Scope, improve_command
from gantrysim.study.cases import Row
from gantrysim.study.repeat.repeats import ALL
from gantrysim.study.repeat.study import RepeatStudy

QUESTION = "Does every repeat of this job meet the tolerance?"


def repeat_answer(study: RepeatStudy, rows: Sequence[Row], paths: dict[str, RepeatedPath]) -> str:
    """Return the answer.

    Args:
        study: the study.
        rows: of all repeats.
        paths: repeated paths by varied source, with that of all sources.
    """
    path = paths[ALL]
    result = (
        f"path accuracy ATp = {UM * path.path_accuracy:.2f} µm, path repeatability RTp = "
        f"{UM * path.path_repeatability:.2f} µm over {len(path.attained)} repeats of {study.job.name}"
    )
    repeats = [Acceptance.of(row) for row in rows if row["varied"] == ALL]
    judged = [acceptance for acceptance in repeats if acceptance is not None]
    if not judged:
        return f"Not judged by a tolerance: {result}."
    scope = Scope.of(judged)
    worst = max(judged, key=lambda acceptance: acceptance.use(scope.aspects))
    accepted = sum(acceptance.keeps(scope.aspects) for acceptance in judged)
    if accepted == len(repeats):
        return (
            f"Yes, all {accepted} repeats keep {scope.words}, with at most {scope.usage(worst)}{scope.remark(worst)}: "
            f"{result}."
        )
    failures = f"; the worst is at {scope.excess(worst)}"
    if worst.keeps(scope.aspects):  # then the others have no run that could be judged
        failures = "; the others were refused or ended in a fault"
    return f"No, {accepted} of {len(repeats)} repeats keep {scope.words}{failures}: {result}; {_lever(study, paths)}."


def _lever(study: RepeatStudy, paths: dict[str, RepeatedPath]) -> str:
    """Return which part of the error to reduce: the systematic one, or the scatter with its largest source."""
    path = paths[ALL]
    improve = f"{improve_command(study.job)} tries the levers"
    if path.path_accuracy >= path.path_repeatability:
        return f"the systematic error is the larger part, and {improve}"
    alone = {name: source.path_repeatability for name, source in paths.items() if name != ALL}
    if not alone:
        return f"the scatter is the larger part, and {improve}"
    source = max(alone, key=lambda name: alone[name])
    return f"the scatter is the larger part, most of it from the {source} ({UM * alone[source]:.2f} µm alone)"
