"""The command `gantrysim machine`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gantrysim.cli.options import AllowCode
from gantrysim.cli.terminal import interruptible, say, share_bar, show

if TYPE_CHECKING:
    from gantrysim.machine.machine import Machine


machine_app = typer.Typer(help="Create machines from tables.", no_args_is_help=True)
ForJob = Annotated[str | None, typer.Option("--job", help="Job whose torques are compared with the motors.")]


@machine_app.callback()
def _machine() -> None:
    """Keep `new` a subcommand."""


@machine_app.command()
def new(
    file: Annotated[Path, typer.Argument(help="TOML file of the machine, or URDF.", show_default=False)],
    out: Annotated[
        Path | None,
        typer.Option(help="MJCF file or folder to write; by default beside the table, with the suffix .xml."),
    ] = None,
    job: ForJob = None,
    allow_code: AllowCode = False,
) -> None:
    """Write the MJCF of a machine that a TOML table describes, and size its drives.

    Jobs also accept the table itself, as in `machine = "belt.toml"` or --machine belt.toml, and a URDF with its table
    beside it.
    """
    from gantrysim.base.errors import InputError, expanded_path
    from gantrysim.base.files import replaced_file
    from gantrysim.machine.design.build import mjcf_in
    from gantrysim.machine.machine import Machine

    source = expanded_path(file)
    if source.suffix.lower() not in (".toml", ".urdf"):
        raise InputError(f"machine {file}: must be a TOML file, or a URDF with one beside it")
    text = mjcf_in(source)
    # refused here rather than written
    machine = Machine(source)
    target = source.with_suffix(".xml") if out is None else expanded_path(out)
    if out is not None and target.suffix.lower() != ".xml":
        target.mkdir(parents=True, exist_ok=True)
        target = target / f"{source.stem}.xml"
    describe(machine, job, allow_code=allow_code)
    with replaced_file(target) as scratch:
        scratch.write_text(text, encoding="utf-8")
    say(f"written to {target}")


def describe(machine: Machine, job: str | None, *, allow_code: bool = False) -> None:
    """Print the sizing of a machine's drives, and what is wrong with it."""
    from gantrysim.cli.sizing import sizing_table
    from gantrysim.job.job import Job
    from gantrysim.machine.checks import notes
    from gantrysim.machine.sizing import Sizing
    from gantrysim.results.checks import PASS
    from gantrysim.results.verdict import machine_verdict

    period = 1e-3
    run = None
    row = None
    if job is not None:
        loaded = Job.load(job, machine=str(machine.source), allow_code=allow_code)
        loaded.check_fit()
        period = loaded.servo.period
        with interruptible() as go_on, share_bar("simulate", go_on) as advance:
            run = loaded.run(advance)
        row = None if run.fault is not None else machine_verdict(loaded, run)
    sizing = Sizing.of(machine, period, run)
    show(sizing_table(machine, sizing, period))
    for text in notes(machine):
        say(f"note: {text}", wrap=True)
    findings = list(sizing.findings)
    if run is not None and run.fault is not None:
        findings.append(f"the job ends in a fault: {run.fault}")
    if row is not None and row.state != PASS:
        findings += [f"{row.state}: {text}" for text in row.texts]
    suits = f"the drives suit the machine{' and the job' if run is not None else ''}"
    say(f"verdict: {'to be changed:' if findings else suits}")
    for text in findings:
        say(f"- {text}", wrap=True)
