"""The figures of one run, as a study keeps them of each of its cases."""

from __future__ import annotations

from gantrysim.base.errors import InputError, check_type
from gantrysim.glue.bead import Bead
from gantrysim.machine.machine import Machine
from gantrysim.record.run import Run, check_run
from gantrysim.results.verdict import Verdict
from gantrysim.study.cases import Row, judged_row, values_row, verdict_columns


def figures(run: Run, machine: Machine | None = None) -> Row:
    """Return the figures of a run as one flat row, by the keys that studies and summary.json have, see docs/values.md.

    `status` comes first: "ok", "fault: ..." for a run that a fault ended, or "refused: ..." for one without glue; these
    have no other figure. Errors, motion and bead follow, and of a run with a job its verdict.

    Args:
        run: the run; the bead and the limits are those of its job, if it has one.
        machine: machine of the run if not its job's own; the stability margins of the verdict are computed for it.

    Raises:
        InputError: no run.
    """
    check_run(run)
    if machine is not None:
        check_type("machine", machine, Machine, "a Machine")

    def values(run: Run) -> Row:
        job = run.job
        if job is None:
            return values_row(run)
        verdict = Verdict.of_results(job, run.budget, Bead(run, job.bead, run.budget.analysis), machine)
        # errors that are not known keep no limit
        if verdict.contradiction:
            raise InputError(verdict.contradiction)
        return {**values_row(run, job.bead), **verdict_columns(verdict)}

    return judged_row(lambda: run, values)
