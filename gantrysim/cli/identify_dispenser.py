"""The command `gantrysim identify dispenser`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gantrysim.base.errors import InputError
from gantrysim.cli.options import named_columns
from gantrysim.cli.terminal import NOT_IDENTIFIED, interruptible, say, share_bar, show, warn


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
