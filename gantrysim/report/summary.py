"""The content of summary.json: the numbers of a run, with the versions that they depend on."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from gantrysim.base.extras import package_versions
from gantrysim.base.quantity import contents
from gantrysim.job.basis import Basis
from gantrysim.job.losses import happened_events
from gantrysim.job.steps import run_notes
from gantrysim.machine.machine import Machine
from gantrysim.metrics.budget import Budget
from gantrysim.metrics.error_quantities import DURATION, END_POINT
from gantrysim.metrics.parts import ERROR_SIZES
from gantrysim.record.run import Run
from gantrysim.report.answer import Answer
from gantrysim.report.causes import causes_section, causes_summary, glue_causes_section, glue_causes_summary
from gantrysim.report.document import Changes, Section
from gantrysim.report.headline import headline
from gantrysim.report.scatter import scatter_section, scatter_summary
from gantrysim.report.sections import faults_section
from gantrysim.results.quantities import GROUPS, LOSSES_GROUP
from gantrysim.results.run_results import RunResults
from gantrysim.results.verdict import Verdict


def summary(results: RunResults, changes: Changes | None = None) -> dict[str, Any]:
    """Return the content of summary.json; a key's unit stands in its name, docs/values.md lists all values.

    Keys that need an explanation:

        verdict: see `Verdict.content`
        error_budget: by link, and as contour for the whole, the error normal to the path (`PartValues`); by axis its
            share of the servo part; by turn of a spiral the links' errors
        causes: by cause the errors without it, and its worth (`Effect`); null without --causes
        glue_causes: by cause the checks of the glue without it, and its worth (`GlueCauses`); null where the glue
            passes, and without --causes
        errors, motion, servo, bead: groups of `gantrysim.results.quantities`; bead is null without glue, a value null
            where the run has none or it is without bound
        unstable_axes: null where the margins are unknown
        fault: null for a complete run
        injected: deliberate faults, whether the run came to them, and what they cost; null without any
        scatter: of runs with other zeros of the encoders; missing without --repeat
        headline: what spoils the run in a sentence or two; of a run with faults, what happened
        spoilt: what spoils the run, by the row of the verdict, the worst first; empty for a pass
        changes: what to change in the job (`Remedy`); null where it was not looked for
        sections: sections of the page whose values took further runs, as text, by the names of `gantrysim show`
    """
    job = results.basis
    run = results.budget.analysis.run
    groups = {group.name: group.contents(results) for group in GROUPS if group is not LOSSES_GROUP}
    scatter = {} if results.scatter is None else {"scatter": scatter_summary(results.scatter)}
    answer = Answer.of(results)
    return {
        "verdict": results.verdict.content(),
        "job": job.name,
        "machine": results.machine.name,
        "error_budget": _budget(results.budget, results.machine),
        "causes": None if results.causes is None else causes_summary(results.causes),
        "glue_causes": None if results.glue_causes is None else glue_causes_summary(results.glue_causes),
        **groups,
        "unstable_axes": _unstable(results),
        "notes": list(run_notes(job, run)),
        "fault": _fault(run),
        "injected": _injected_faults(run, LOSSES_GROUP.contents(results)),
        "headline": headline(results),
        "spoilt": [text for text in (answer.spoilt, answer.also_spoilt) if text],
        "changes": None if changes is None else changes.remedy.content(),
        "sections": {name: section.content() for name, section in sections_in_text(results, changes)},
        "versions": versions(results.machine),
        **scatter,
    }


def sections_in_text(results: RunResults, changes: Changes | None) -> Iterator[tuple[str, Section]]:
    """Yield the sections that `gantrysim show` cannot make from the record, by their names there."""
    if results.budget.analysis.run.injected:
        yield "faults", faults_section(results.budget.analysis.run, results.losses)
    if results.causes is not None:
        yield "causes", causes_section(results.causes)
    if results.glue_causes is not None:
        yield "glue-causes", glue_causes_section(results.glue_causes)
    if results.scatter is not None:
        yield "scatter", scatter_section(results.scatter)
    if changes is not None:
        yield "levers", changes.section


def fault_summary(job: Basis, machine: Machine, run: Run) -> dict[str, Any]:
    """Return the content of summary.json for a run that a fault ended before the dispenser was on: it has no errors."""
    return {
        "verdict": Verdict.of_fault(run).content(),
        "job": job.name,
        "machine": machine.name,
        "error_budget": None,
        "motion": {
            DURATION.key: float(run.time[-1]),
            **{end.key: place for end, place in zip(END_POINT, run.nozzle[-1].tolist(), strict=True)},
        },
        "bead": None,
        "notes": list(run_notes(job, run)),
        "fault": _fault(run),
        "injected": _injected_faults(run, None),
        "headline": f"{happened_events(run)} The dispenser was never on: there are no errors to evaluate.",
        "versions": versions(machine),
    }


def versions(machine: Machine) -> dict[str, str]:
    """Return the versions that the numbers of a run depend on, and the digest of the compiled machine."""
    return {**package_versions(), "machine_sha256": machine.digest}


def _budget(budget: Budget, machine: Machine) -> dict[str, Any]:
    values = budget.values
    by_axis = budget.servo_by_axis(machine)
    return {
        **{name: part.content() for name, part in values.rows.items()},
        "servo_by_axis": {axis: budget.values_of(part).content() for axis, part in by_axis.items()},
        "turns": [
            {
                "turn": turn.turn,
                "name": turn.name,
                "s_mm": list(turn.s),
                **{name: contents(ERROR_SIZES, size) for name, size in turn.parts.items()},
            }
            for turn in values.turns
        ],
    }


def _unstable(results: RunResults) -> list[str] | None:
    if results.basis.margins is None:
        return None
    return [name for name, loop in results.loops.items() if loop.margins is not None and not loop.margins.stable]


def _fault(run: Run) -> dict[str, Any] | None:
    if run.fault is None:
        return None
    numbers = {"value": _finite(run.fault.value), "limit": _finite(run.fault.limit)}
    return {**asdict(run.fault), **numbers, "text": str(run.fault)}


def _injected_faults(run: Run, losses: dict[str, float | None] | None) -> dict[str, Any] | None:
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
    return {"faults": faults, "losses": losses}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
