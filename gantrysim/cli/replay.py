"""The command `gantrysim replay`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gantrysim.base.errors import InputError
from gantrysim.cli.options import AllowCode, LogPeriod, named_columns
from gantrysim.cli.terminal import interruptible, plain_table, say, share_bar, show

if TYPE_CHECKING:
    from gantrysim.identify.replay import CommandedLog, Replay


def replay(
    log: Annotated[
        Path, typer.Argument(help="Log of command, position and torque: CSV, Parquet, MAT or MCAP.", show_default=False)
    ],
    model: Annotated[
        str,
        typer.Option("--machine", "--model", help="Simulated machine: built-in, an MJCF file or a machine table."),
    ] = "xyz",
    servo: Annotated[
        Path | None,
        typer.Option(help="TOML file with a table \\[servo]; by default the servo of a job, derived from the machine."),
    ] = None,
    columns: Annotated[
        list[str] | None,
        typer.Option(
            "--column",
            metavar="NAME=COLUMN",
            help="Column of the log for a quantity: 'x command=DPOS AXIS(0) \\[mm]', 'x position=MPOS AXIS(0) \\[mm]', "
            "'x torque=I*0.0302 N·m', 'x disturbance=PULSE \\[N·m]'.",
        ),
    ] = None,
    fitted: Annotated[
        str | None,
        typer.Option(
            metavar="FIRST:LAST", help="Rows of the log to which the machine was fitted; all others are held out."
        ),
    ] = None,
    period: LogPeriod = None,
    rows: Annotated[
        str | None,
        typer.Option(metavar="FIRST:LAST", help="Rows of the log to replay, counted from 1 without its headings."),
    ] = None,
    out: Annotated[Path, typer.Option(help="Output folder.")] = Path("replayed"),
    allow_code: AllowCode = False,
) -> None:
    """Send the command in a log to the simulated axes, and compare following error and torque with the log's.

    Needs no program, path or glue. The axes begin in the log's first position and velocity. A table shows the following
    error and the torque of each axis, measured and simulated, around reversals and elsewhere; beside them stands the
    same machine without friction, which a machine worth its name must be far better than.

    The output folder holds replay.json and report.html.

    Exit status: 0, 2 for bad input, 130 after Ctrl-C.
    """
    from gantrysim.identify.log import Rows
    from gantrysim.identify.replay import read_commanded_log
    from gantrysim.identify.replay import replay as replayed
    from gantrysim.identify.replay_output import write_all
    from gantrysim.job.servo_file import servo_of_file
    from gantrysim.machine.machine import Machine

    machine = Machine(model)
    chosen_rows = None if rows is None else Rows.parse(rows)
    recorded = read_commanded_log(log, machine, named_columns(columns or ()), period, chosen_rows)
    fitted_rows = _fitted_rows(fitted, recorded)
    chosen = servo_of_file(servo, machine, recorded.log.period, allow_code=allow_code)
    with interruptible() as go_on:
        with share_bar("replay", go_on) as advance:
            result = replayed(machine, recorded, chosen, fitted=fitted_rows, progress=advance)
        names = write_all(result, log.name, out)
    _show(result)
    say(f"written to {out}/: {', '.join(names)}")


def _show(result: Replay) -> None:
    """Print tables, sentences and notes of a replay."""
    from gantrysim.identify.replay_output import QUANTITIES, sentences, table_of

    for axis in result.axes:
        for quantity in QUANTITIES:
            show(plain_table(table_of(result, axis, quantity)))
    for line in sentences(result):
        say(line, wrap=True)
    for note in result.notes:
        say(f"note: {note}", wrap=True)


def _fitted_rows(text: str | None, recorded: CommandedLog) -> slice | None:
    """Return the rows of a log that were fitted, from their numbers in its file."""
    from gantrysim.identify.log import Rows

    if text is None:
        return None
    if recorded.first is None:
        raise InputError("--fitted: rows are missing in the log, so that they cannot be counted: cut it by --rows")
    try:
        rows = Rows.parse(text)
    except InputError as error:
        raise InputError(str(error).replace("--rows", "--fitted")) from None
    last = rows.last or recorded.first + len(recorded.command) - 1
    return slice(max(rows.first - recorded.first, 0), max(last - recorded.first + 1, 0))
