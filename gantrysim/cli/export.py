"""The command `gantrysim export`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gantrysim.base.errors import expanded_path
from gantrysim.cli.terminal import say


def export(
    run: Annotated[Path, typer.Argument(help="Output folder of gantrysim run, or a run.npz.", show_default=False)],
    kind: Annotated[str, typer.Option("--format", help="csv, mat, parquet or mcap.")] = "csv",
    out: Annotated[
        Path | None, typer.Option(help="File to write; by default beside the record, as run.csv.", show_default=False)
    ] = None,
) -> None:
    """Write the record of a run as a table with units in its columns' names, for other programs.

    Exit status: 0, 2 for bad input.
    """
    from gantrysim.exchange.tables import WRITERS, load_record
    from gantrysim.exchange.tables import export as write
    from gantrysim.record.run_file import RUN

    record = load_record(run)
    file = out
    if file is None:
        beside = run / RUN if expanded_path(run).is_dir() else run
        file = beside.with_suffix(f".{kind}" if kind in WRITERS else ".csv")
    write(record, file, kind)
    say(f"written to {file}")
