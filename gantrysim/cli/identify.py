"""The command `gantrysim identify`, for axes and for a dispenser."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from gantrysim.base.errors import InputError
from gantrysim.cli.options import LogPeriod, named_columns
from gantrysim.cli.terminal import NOT_IDENTIFIED, interruptible, say, share_bar, show, warn

if TYPE_CHECKING:
    from gantrysim.identify.log import Log
    from gantrysim.machine.machine import Machine


_AXES = "axes"
_DISPENSER = "dispenser"


class _AxesByDefault(TyperGroup):
    """Commands of which that for axes needs no name: `gantrysim identify log.csv`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if args[:1] != ["--help"] and args[:1] != [_AXES] and args[:1] != [_DISPENSER]:
            args = [_AXES, *args]
        return super().parse_args(ctx, args)


identify_app = typer.Typer(
    cls=_AxesByDefault,
    add_completion=False,
    help="Fit a machine's axes to a log, as in gantrysim identify LOG, or a dispenser to measurements.",
)


@identify_app.command(_AXES)
def identify(
    log: Annotated[
        Path | None, typer.Argument(help="Log of the moves: CSV, Parquet, MAT or MCAP.", show_default=False)
    ] = None,
    model: Annotated[
        str, typer.Option("--machine", "--model", help="Nominal machine: built-in, an MJCF file or a machine table.")
    ] = "xyz",
    out: Annotated[
        Path | None,
        typer.Option(help="Output folder; with --plan, the program file; by default identified/ or excitation.*"),
    ] = None,
    columns: Annotated[
        list[str] | None,
        typer.Option(
            "--column",
            metavar="NAME=COLUMN",
            help="Column of the log for a quantity: 'x position=MPOS AXIS(0) \\[mm]', 'x torque=I*0.0302 N·m'. "
            "Quantities: time; position, velocity, demand and torque of an axis.",
        ),
    ] = None,
    period: LogPeriod = None,
    rows: Annotated[
        str | None,
        typer.Option(metavar="FIRST:LAST", help="Rows of the log to read, counted from 1 without its headings."),
    ] = None,
    plan: Annotated[bool, typer.Option("--plan", help="Write the program that excites the machine; takes no log.")] = (
        False
    ),
    controller: Annotated[str, typer.Option(help="Language of the program: trio, softmc or linuxcnc.")] = "trio",
) -> None:
    """Fit inertia, friction, first mode and delay of a machine's axes to a log of their torque and position.

    With --plan, write the program of the moves that are to be logged. Otherwise write report.html, the page with
    log, fit, friction and what to record next; identified.toml with the values and their 95 % confidence intervals;
    machine.xml with the fitted machine for all other commands; and three plots. The fitted machine is simulated
    with the log's torque, and a line states what the model lacks.

    The log has a column time, or --period, and for each axis columns such as 'x position' or 'x velocity', and 'x
    torque' or 'x demand', with their units in brackets or below. Rows may be missing; --column names other headings.

    A defective log, for example with a frozen encoder or a torque in another unit, is not identified: a line names the
    defect.

    Exit status: 0, 1 if no value of an axis is identified, 2 for bad input, 130 after Ctrl-C, which leaves the
    output folder unchanged.
    """
    from gantrysim.machine.machine import Machine

    machine = Machine(model)
    if plan:
        if log is not None:
            raise InputError(f"--plan takes no log, got {log}")
        for option, value in {"--column": columns, "--period": period, "--rows": rows}.items():
            if value is not None:
                raise InputError(f"{option}: describes a log, and --plan takes none")
        _write_plan(machine, controller, out)
        return
    if log is None:
        raise InputError("a log is missing; gantrysim identify --plan writes the program of the moves to log")
    from gantrysim.identify.log import Rows, read_log

    chosen = None if rows is None else Rows.parse(rows)
    read = read_log(log, machine, named_columns(columns or ()), period, chosen)
    _identify(machine, read, Path("identified") if out is None else out)


def _write_plan(machine: Machine, controller: str, out: Path | None) -> None:
    from gantrysim.base.files import replaced_file
    from gantrysim.identify.plan import excitation

    text, suffix = excitation(machine, controller)
    file = Path(f"excitation{suffix}") if out is None else out
    with replaced_file(file) as partial:
        partial.write_text(text, encoding="utf-8")
    say(f"written to {file}; log torque and position of the motors at every servo tick")


def _identify(machine: Machine, log: Log, folder: Path) -> None:
    from gantrysim.identify.checks.finding import NotIdentifiedError
    from gantrysim.identify.identification import identify as identified
    from gantrysim.identify.output import values_table, write_all
    from gantrysim.identify.whole_run import whole_run

    with interruptible() as go_on:
        try:
            with share_bar("identify", go_on) as advance:
                identification = identified(machine, log, advance)
        except NotIdentifiedError as error:
            warn(str(error), "not identified")
            raise typer.Exit(NOT_IDENTIFIED) from None
        runs = whole_run(identification, log)
        names = write_all(identification, log, folder, runs)
    show(values_table(identification))
    for note in (*log.notes, *identification.notes, *(run.sentence for run in runs)):
        say(note, wrap=True)
    say(f"written to {folder}/: {', '.join(names)}")
    for line in identification.unidentified:
        warn(line, "not identified")
    if identification.unidentified:
        raise typer.Exit(NOT_IDENTIFIED)


@identify_app.command(_DISPENSER)
def identify_dispenser(
    data: Annotated[
        list[Path] | None,
        typer.Argument(help="Tables of measurements: CSV, Parquet, MAT or MCAP.", show_default=False),
    ] = None,
    density: Annotated[
        float | None, typer.Option(help="Density of the glue \\[g/cm³], where the tables have no column density.")
    ] = None,
    needle: Annotated[
        str | None,
        typer.Option(
            metavar="BORExLENGTH", help="Needle \\[mm], as in 0.41x12.7 or 22Gx12.7, where the tables do not have it."
        ),
    ] = None,
    columns: Annotated[
        list[str] | None,
        typer.Option(
            "--column", metavar="NAME=COLUMN", help="Column of the tables for a quantity: 'mass=Balance \\[g]'."
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="File for the tables of a job.")] = Path("dispenser.toml"),
) -> None:
    r"""Fit a dispenser and its glue to masses, beads, dots and records of switching.

    The filled cells of a row show what was measured, with units in brackets:

    - weighing: time \[s], mass \[mg], and pressure \[kPa] of a valve, pump speed \[rpm] or plunger speed \[mm/s]

    - dots of a valve: open time \[ms], mass \[mg], dots (their number)

    - drops of a jet: drops (their number), mass \[mg]

    - bead: speed \[mm/s], gap \[mm], width \[mm] or height \[mm]

    - record: time \[s], command (0 or 1) or the motor's speed, and flow \[mm³/s] or mass \[mg]

    A column experiment separates several of a kind. Density and needle are columns (density \[g/cm³], bore \[mm],
    length \[mm], outer \[mm]) or options.

    Writes the tables \[dispenser] and \[bead] of a job with the values and their 95 % intervals, and says which two
    measurements would narrow the intervals most.

    Exit status: 0, 1 if no value is identified or the measurements are spoiled, which a line names, 2 for bad input.
    """
    if not data:
        raise InputError(
            "a table of measurements is missing, as in gantrysim identify dispenser DATA.csv; a log of axes that is "
            "named dispenser is read as ./dispenser"
        )
    from gantrysim.identify.checks.finding import NotIdentifiedError
    from gantrysim.identify.dispenser.identification import identify_dispenser as identified
    from gantrysim.identify.dispenser.measurements import needle_of, read_measurements
    from gantrysim.identify.dispenser.output import advice_words, tables_text, values_table, write_tables

    size = None if needle is None else needle_of(needle)
    with interruptible() as go_on:
        try:
            measured = read_measurements(data, named_columns(columns or ()), density, size)
            with share_bar("identify", go_on) as advance:
                identification = identified(measured, advance)
        except NotIdentifiedError as error:
            warn(str(error), "not identified")
            raise typer.Exit(NOT_IDENTIFIED) from None
    show(values_table(identification))
    for note in identification.notes:
        say(note, wrap=True)
    if identification.advice is not None:
        say(advice_words(identification.advice, identification), wrap=True)
    if not any(value.identified for value in identification.values):
        warn("no value is known within its bound; nothing is written", "not identified")
        raise typer.Exit(NOT_IDENTIFIED)
    write_tables(identification, out)
    say(tables_text(identification))
    say(f"written to {out}")
