"""The command `gantrysim tune`."""

from __future__ import annotations

from typing import Annotated

import typer

from gantrysim.cli.options import Model, Settings
from gantrysim.cli.study import Backend, JobArgument, Out, Seed, Workers, carry_out


def tune(
    job: JobArgument = "fanuc-spiral",
    law: Annotated[
        str | None,
        typer.Option(
            help="Gains to search: pd for kp, kd, velocity_ff and acceleration_ff, pid for these and ki; by default "
            "pid where the job has an integral term."
        ),
    ] = None,
    budget: Annotated[int, typer.Option(help="Most runs of the search.")] = 300,
    robust: Annotated[
        int, typer.Option(metavar="K", help="Machines besides the job's own; the worst of all counts.")
    ] = 4,
    figure: Annotated[
        str,
        typer.Option(help="What is to be small: rms, p95 or max of the contour or the tracking error, as contour_rms."),
    ] = "contour_rms",
    margin: Annotated[
        float,
        typer.Option(
            metavar="M",
            help="Least gain margin, kept in every direction: the peak of |S| is at most M/(M - 1), and the phase "
            "margin of 2 at least 29 deg.",
        ),
    ] = 2.0,
    ripple: Annotated[float, typer.Option(metavar="%", help="Most torque ripple, of the peak torque.")] = 2.0,
    per_axis: Annotated[
        bool, typer.Option("--per-axis", help="Search the gains of every axis by themselves, not one factor for all.")
    ] = False,
    spread: Annotated[
        str, typer.Option(help="How far machines differ, as for gantrysim study machine: payload=0.5,friction=0.3.")
    ] = "",
    unseen: Annotated[
        int, typer.Option(metavar="N", help="Machines that the answer is tried on in the end, not in the budget.")
    ] = 32,
    seed: Seed = 1,
    out: Out = None,
    model: Model = None,
    settings: Settings = None,
    workers: Workers = None,
    backend: Backend = None,
) -> None:
    """Search the servo's gains with which a job's error is smallest, on machines that differ.

    CMA-ES begins at the job's own gains. Every candidate keeps the margin on every axis and machine; those whose torque
    ripple is too much, or which end in a fault, come after all others. What was found is written as tuned.toml, for
    gantrysim run --servo, with a report of before and after. One that was interrupted goes on where it stopped.

    Exit status: 0, 2 for bad input, 3 where every run ends in a fault, 130 after Ctrl-C.
    """
    from gantrysim.job.job import Job
    from gantrysim.machine.tolerances import Tolerances
    from gantrysim.tuning.study import TuningStudy

    study = TuningStudy(
        Job.load(job, settings or (), model),
        law=law,
        figure=figure,
        budget=budget,
        robust=robust,
        margin=margin,
        ripple=ripple,
        per_axis=per_axis,
        spread=Tolerances.parse(spread),
        unseen=unseen,
        seed=seed,
    )
    carry_out(study, out, workers, backend)
