"""Runs beside one another: verdicts, differences of their jobs, errors, budgets, causes and values."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.display import Shown
from gantrysim.compare.runs.answer import answer, best_of
from gantrysim.compare.runs.common_path import Parting, PlaceDifference, Track, difference_at_places, partings_of
from gantrysim.compare.runs.compared_run import FEWEST, ComparedRun
from gantrysim.compare.runs.differences import (
    CheckChange,
    JobDifference,
    ValueChange,
    check_changes,
    differences_of,
    value_changes,
)
from gantrysim.metrics.parts import ERROR_SIZES, Part, PartValues
from gantrysim.results.verdict import Verdict

NOTHING_APART = 1e-9  # largest difference of two errors that is rounding [mm]


@dataclass(frozen=True, eq=False, repr=False)
class ComparedRuns(Shown):
    """Runs beside one another; changes are counted from the first.

    Attributes:
        runs: two to four.
    """

    runs: tuple[ComparedRun, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the runs."""
        return tuple(run.name for run in self.runs)

    @cached_property
    def verdicts(self) -> tuple[Verdict, ...]:
        """Verdict on each run."""
        return tuple(run.results.verdict for run in self.runs)

    @property
    def best(self) -> int | None:
        """Number of the run that is better than all others, from 0; None where there is none."""
        return best_of(self.verdicts)

    @cached_property
    def differences(self) -> tuple[JobDifference, ...]:
        """What differs between the jobs: keys, machine and servo."""
        return differences_of(self.runs)

    @cached_property
    def checks(self) -> tuple[CheckChange, ...]:
        """The checks of the verdicts; none of a run that ended in a fault."""
        return tuple(check_changes(self.verdicts))

    @cached_property
    def values(self) -> tuple[ValueChange, ...]:
        """Every value that a run has."""
        return tuple(value_changes([run.results for run in self.runs]))

    @cached_property
    def partings(self) -> tuple[Parting, ...]:
        """Where requested paths leave the first run's; empty where all are the same."""
        return partings_of([run.run.requested for run in self.runs])

    @property
    def by_path(self) -> bool:
        """Whether the common abscissa is the distance along the requested path, else the time."""
        return not self.partings

    @cached_property
    def tracks(self) -> tuple[Track, ...]:
        """Each run against the common abscissa."""
        return tuple(Track.of(run.analysis, self.by_path) for run in self.runs)

    @cached_property
    def apart(self) -> tuple[PlaceDifference | None, ...]:
        """Difference of each run's contour error and the first one's at the same place; None on another path."""
        if not self.by_path:
            return (None,) * len(self.runs)
        errors = [_across(run.results.budget.contour) for run in self.runs]
        return tuple(
            difference_at_places((self.tracks[0], track), (errors[0], error))
            for track, error in zip(self.tracks, errors, strict=True)
        )

    @cached_property
    def budgets(self) -> dict[str, tuple[PartValues | None, ...]]:
        """The rows of the error budgets by link; None where a run has no such link."""
        tables = [run.results.budget.values.rows for run in self.runs]
        # the whole last, also where only a later run has a link of its own
        links = [name for name in dict.fromkeys(name for table in tables for name in table) if name != "contour"]
        return {name: tuple(table.get(name) for table in tables) for name in (*links, "contour")}

    @cached_property
    def causes(self) -> dict[str, tuple[float | None, ...]]:
        """What causes are worth of the rms contour error [mm]; empty unless they are known of two runs or more."""
        known = [run.causes or {} for run in self.runs]
        if sum(bool(worth) for worth in known) < FEWEST:
            return {}
        names = dict.fromkeys(name for worth in known for name in worth)
        return {name: tuple(worth.get(name) for worth in known) for name in names}

    @property
    def are_same(self) -> bool:
        """Whether no value of the runs differs, nor their errors at any place."""
        errors = all(apart is not None and apart.max <= NOTHING_APART for apart in self.apart)
        return errors and all(len(set(change.values)) == 1 for change in self.values)

    @cached_property
    def sentence(self) -> str:
        """Which run is better, by what, by how much, and what differs between the jobs."""
        return answer(self.names, self.verdicts, self.checks, self.differences, self.are_same)

    @property
    def notes(self) -> list[str]:
        """How the runs were laid beside one another, and what cannot be compared."""
        return [*self._path_notes(), *self._run_notes()]

    def _path_notes(self) -> list[str]:
        if self.by_path:
            return ["all runs request the same path: errors are compared at the same distance along it"]
        notes = []
        for parting in self.partings:
            x, y, z = parting.point
            lengths = " against ".join(f"{length:.1f} mm" for length in parting.lengths)
            notes.append(
                f"the path that {self.names[parting.run]} requests leaves that of {self.names[0]} {parting.s:.1f} mm "
                f"from its start, at x = {x:.1f}, y = {y:.1f}, z = {z:.1f} mm ({lengths} long)"
            )
        notes.append(
            "errors are drawn over the time, each from the run's own path; no difference at the same place is given"
        )
        return notes

    def _run_notes(self) -> list[str]:
        notes = []
        for run in self.runs:
            if run.run.fault is not None:
                notes.append(f"{run.name} ended in a fault, and all its values are up to it: {run.run.fault}")
            if run.changed:
                notes.append(f"machine {run.results.machine.name} has changed since {run.name} was written")
        axes = {tuple(zip(run.run.axes, run.run.units, strict=True)) for run in self.runs}
        if len(axes) > 1:
            notes.append("the machines have different axes: values of an axis are given for the runs that have it")
        return notes

    def facts(self) -> dict[str, str]:
        verdicts = {
            f"verdict on {name}": verdict.headline for name, verdict in zip(self.names, self.verdicts, strict=True)
        }
        return {"answer": self.sentence, **verdicts}

    def __str__(self) -> str:
        return "\n".join([self.sentence, *(f"note: {note}" for note in self.notes)])

    def summary(self) -> dict[str, Any]:
        """Return all values, for JSON; a key ends in its unit."""
        return {
            "runs": list(self.names),
            "answer": self.sentence,
            "better": None if self.best is None else self.names[self.best],
            "same": self.are_same,
            "differences": [
                {"of": difference.kind, "key": difference.key, "values": list(difference.texts)}
                for difference in self.differences
            ],
            "abscissa": "path" if self.by_path else "time",
            "verdicts": [verdict.headline for verdict in self.verdicts],
            "checks": [check.content() for check in self.checks],
            "error_budgets": {
                name: [None if part is None else part.content() for part in parts]
                for name, parts in self.budgets.items()
            },
            "contour_difference": [_apart(apart) for apart in self.apart],
            "causes_rms_um": {
                name: [ERROR_SIZES[0].content(value) for value in worth] for name, worth in self.causes.items()
            },
            "values": [
                {
                    "group": value.group,
                    "key": value.quantity.key,
                    "values": list(value.values),
                    "changes": [value.change(run) for run in range(len(self.runs))],
                }
                for value in self.values
            ],
            "notes": self.notes,
        }


def _apart(apart: PlaceDifference | None) -> dict[str, float | None] | None:
    if apart is None or not apart.length:
        return None
    sizes = {size.key: size.content(size.get(apart)) for size in ERROR_SIZES}
    return {**sizes, "length_mm": apart.length}


def _across(part: Part) -> Floats:
    """Return an error across the path, lateral and vertical, (m, 2) [mm]."""
    return np.column_stack([part.lateral, part.vertical])
