"""The command `gantrysim tune`."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from gantrysim.cli.options import AllowCode, JobArgument, Model, Settings
from gantrysim.cli.study import Backend, Out, Seed, Workers, carry_out
from gantrysim.cli.terminal import say, warn

Law = Annotated[
    str | None,
    typer.Option(
        help="Gains to search: pd for kp, kd, velocity_ff and acceleration_ff; pid for these and ki; by default pid "
        "if the job has an integral term."
    ),
]
Budget = Annotated[int, typer.Option(help="Maximum number of runs of the search.")]
Robust = Annotated[
    int, typer.Option(metavar="K", help="Number of perturbed machines besides the job's own; the worst of them counts.")
]
Guards = Annotated[
    int, typer.Option(metavar="N", help="Number of further machines on which the margin is kept, without runs.")
]
Batch = Annotated[
    int,
    typer.Option(
        metavar="N", help="Points of the simplex moved in parallel; more points use more cores, but need more runs."
    ),
]
Metric = Annotated[
    str,
    typer.Option(
        "--figure",
        help="Metric to minimise: contour or servo error, followed by _rms, _p95 or _max.",
    ),
]
Margin = Annotated[
    float,
    typer.Option(
        metavar="M",
        help="Smallest gain margin, expressed as a bound on |S|: its peak is at most M/(M - 1); a margin of 2 gives a "
        "phase margin of at least 29 deg.",
    ),
]
Ripple = Annotated[float, typer.Option(metavar="%", help="Largest torque ripple, in % of the peak torque.")]
PerAxis = Annotated[
    bool,
    typer.Option("--per-axis", help="Search the gains of each axis separately, instead of one factor for all axes."),
]
Spread = Annotated[
    str,
    typer.Option(help="Tolerances of the machines, as in gantrysim study machine: payload=0.5,friction=0.3."),
]
Unseen = Annotated[
    int,
    typer.Option(
        metavar="N", help="Number of machines for the final check of the tuned gains, in addition to the budget."
    ),
]
Export = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Also write the tuned gains in the parameters of a controller: trio, linuxcnc, linuxcnc-ini, softmc or "
        "fanuc, as gantrysim gains does.",
    ),
]


def tune(
    job: JobArgument = "fanuc-spiral",
    law: Law = None,
    budget: Budget = 300,
    robust: Robust = 4,
    guards: Guards = 28,
    batch: Batch = 1,
    metric: Metric = "contour_rms",
    margin: Margin = 2.0,
    ripple: Ripple = 2.0,
    per_axis: PerAxis = False,
    spread: Spread = "",
    unseen: Unseen = 32,
    seed: Seed = 1,
    export: Export = None,
    out: Out = None,
    model: Model = None,
    settings: Settings = None,
    workers: Workers = None,
    backend: Backend = None,
    allow_code: AllowCode = False,
) -> None:
    """Find the servo gains that minimise a job's error on the worst of several perturbed machines.

    A simplex search starts at the best of three sets: the job's gains, those derived from the machine, and the stiffest
    within the margin. Every candidate keeps the margin on every axis and machine; candidates with too much torque
    ripple, or with a fault, rank behind all others.

    The tuned gains are written to tuned.toml, for gantrysim run --servo, with a report that compares start and result.
    An interrupted search resumes when rerun. --export trio adds tuned-trio.bas for the controller; gains for which it
    has no parameter are not searched, and must be zero from the start.

    Exit status: 0, 2 for bad input, 3 where every run ends in a fault, 130 after Ctrl-C.
    """
    from gantrysim.exchange.gains import dialect, export_gains
    from gantrysim.job.job import Job
    from gantrysim.machine.tolerances import Tolerances
    from gantrysim.study.tuning.space import SEARCHED_GAINS
    from gantrysim.study.tuning.study import TuningStudy

    loaded = Job.load(job, settings or (), model, allow_code=allow_code)
    held: tuple[str, ...] = ()
    # refused before the search, not after
    if export is not None:
        export_gains(export, loaded.built_machine.axes, loaded.built_servo)
        held = tuple(gain for gain in SEARCHED_GAINS if gain not in dialect(export).carries)
    study = TuningStudy(
        loaded,
        law=law,
        metric=metric,
        budget=budget,
        robust=robust,
        guards=guards,
        batch=batch,
        margin=margin,
        ripple=ripple,
        per_axis=per_axis,
        spread=Tolerances.parse(spread),
        unseen=unseen,
        seed=seed,
        held=held,
    )
    said: list[str] = []
    folder = carry_out(study, out, workers, backend, lambda folder: said.extend(write_words(folder, export)))
    # the gains are no promise for the job without them
    if settings or model:
        warn(f"note: {usage_with_changes(folder)}")
    if said:
        say(said[0])
    for note in said[1:]:
        warn(f"note: {note}")


def usage_with_changes(folder: Path) -> str:
    """Return how tuned gains are run with what --set and --machine have changed, in words."""
    from gantrysim.report.folder import JOB
    from gantrysim.study.tuning.servo import TUNED

    job, servo = (shlex.quote(str(folder / name)) for name in (JOB, TUNED))
    return f"tuned with the values of --set and --machine, which {JOB} has: gantrysim run {job} --servo {servo}"


def write_words(folder: Path, name: str | None) -> list[str]:
    """Write the tuned gains of a folder in a controller's parameters, and remove the files of an earlier search.

    Returns:
        Where they are written, then notes; nothing where no controller is named.
    """
    from gantrysim.base.files import replaced_file
    from gantrysim.exchange.gains import DIALECTS, export_gains
    from gantrysim.job.job import Job
    from gantrysim.report.folder import JOB
    from gantrysim.study.tuning.servo import TUNED

    files = {chosen.name: folder / f"{Path(TUNED).stem}-{chosen.name}{chosen.suffix}" for chosen in DIALECTS.values()}
    for other, file in files.items():
        if other != name:
            file.unlink(missing_ok=True)
    if name is None:
        return []
    # its code has run in the search
    tuned = Job.load(folder / JOB, servo=folder / TUNED, allow_code=True)
    content, lost = export_gains(name, tuned.built_machine.axes, tuned.built_servo)
    with replaced_file(files[name]) as partial:
        partial.write_text(content, encoding="utf-8")
    return [f"written to {files[name]}", f"assumed of {name}: {DIALECTS[name].assumes}", *lost]
