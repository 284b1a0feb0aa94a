"""The command `gantrysim export`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gantrysim.base.errors import expanded_path
from gantrysim.cli.terminal import say

_BY_DEFAULT = "csv"


def export(
    run: Annotated[Path, typer.Argument(help="Output folder of gantrysim run, or a run.npz.", show_default=False)],
    kind: Annotated[
        str | None,
        typer.Option(
            "--format",
            help="csv, mat, parquet or mcap; by default that of the suffix of --out, or csv.",
            show_default=False,
        ),
    ] = None,
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
    suffix = "" if out is None else out.suffix.lower().removeprefix(".")
    if kind is None:
        kind = suffix if suffix in WRITERS else _BY_DEFAULT
    file = out
    if file is None:
        beside = run / RUN if expanded_path(run).is_dir() else run
        file = beside.with_suffix(f".{kind}" if kind in WRITERS else f".{_BY_DEFAULT}")
    write(record, file, kind)
    unlike = out is not None and suffix != kind
    say(f"written to {file}{f' in the format {kind}' if unlike else ''}")
