"""The command `gantrysim machine`, and its table of what the drives can do."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from gantrysim.cli.options import AllowCode
from gantrysim.cli.terminal import interruptible, say, share_bar, show
from gantrysim.machine.machine import Machine
from gantrysim.machine.sizing import AxisSizing, Mode, Sizing

if TYPE_CHECKING:
    from gantrysim.machine.machine import Machine


machine_app = typer.Typer(help="Create machines from tables.", no_args_is_help=True)
ForJob = Annotated[str | None, typer.Option("--job", help="Job whose torques are compared with the motors.")]

_Row = tuple[str, Callable[[AxisSizing], float]]


def _positive(value: float) -> float:
    """Return a value, NaN for 0: an axis without encoder or without an accuracy class, which is not an exact one."""
    return value if value > 0 else math.nan


_MACHINE: tuple[_Row, ...] = (
    ("no-load speed [{u}/s]", lambda sizing: sizing.axis.no_load_speed),
    ("speed limit [{u}/s]", lambda sizing: sizing.axis.speed_limit),
    ("peak force at rest [{f}]", lambda sizing: sizing.peak_force),
    ("continuous force [{f}]", lambda sizing: sizing.continuous_force),
    ("torque left at the speed limit [N·m]", lambda sizing: sizing.torque_at_speed),
    ("friction there [N·m]", lambda sizing: sizing.friction_at_speed),
    ("acceleration from rest [{u}/s²]", lambda sizing: sizing.acceleration),
    ("inertia ratio, load to rotor", lambda sizing: sizing.inertia_ratio),
    ("encoder count [{m}]", lambda sizing: _positive(1e3 * sizing.axis.resolution)),
    ("error of the travel, plus or minus [µm]", lambda sizing: _positive(sizing.travel_error)),
    ("natural frequency of the loop [Hz]", lambda sizing: sizing.frequency),
    ("gain margin", lambda sizing: sizing.gain_margin),
)
_JOB: tuple[_Row, ...] = (
    ("rms torque of the job [N·m]", lambda sizing: sizing.rms),
    ("largest torque of the job [N·m]", lambda sizing: sizing.peak),
    ("continuous torque [N·m]", lambda sizing: sizing.continuous_torque),
    ("thermal load, rms to continuous [%]", lambda sizing: 100 * sizing.load),
)


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


def sizing_table(machine: Machine, sizing: Sizing, period: float) -> Table:
    """Return a row per quantity, a column per axis; quantities of a job where it ran."""
    table = Table(title=f"drives of {machine.name}", title_justify="left", caption_justify="left")
    table.add_column("quantity")
    for axis_sizing in sizing.axes:
        table.add_column(axis_sizing.axis.name, justify="right", no_wrap=True)
    job = any(not math.isnan(axis_sizing.rms) for axis_sizing in sizing.axes)
    travels = ("{:.4g} to {:.4g}".format(*axis_sizing.axis.travel) for axis_sizing in sizing.axes)
    units = "/".join(dict.fromkeys(axis_sizing.axis.unit for axis_sizing in sizing.axes))
    symbols = {
        "u": units,
        "m": units.replace("mm", "µm").replace("deg", "mdeg"),
        "f": units.replace("mm", "N").replace("deg", "N·m"),
    }
    table.add_row(f"travel \\[{units}]", *travels)
    for name, value in (*_MACHINE, *(_JOB if job else ())):
        text = name.format(**symbols).replace("[", "\\[")
        table.add_row(text, *(_number(value(axis_sizing)) for axis_sizing in sizing.axes))
    table.caption = (
        f"modes, motors locked: {_modes(sizing.locked)}; free: {_modes(sizing.free)}; forces with the transmission's "
        f"efficiency; loop derived at a servo period of {1e3 * period:g} ms"
    )
    return table


def _number(value: float) -> str:
    return f"{value:.4g}" if math.isfinite(value) else "–"


def _modes(modes: Iterable[Mode]) -> str:
    return ", ".join(f"{mode.frequency:.0f} Hz ({mode.joint})" for mode in modes) or "none"
