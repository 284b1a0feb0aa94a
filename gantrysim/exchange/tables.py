"""Records of runs as tables for other programs: CSV, Parquet, MATLAB, MCAP."""

from __future__ import annotations

import csv
import json
import math
import os
import re
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.errors import InputError, expanded_path, unknown
from gantrysim.base.extras import extra
from gantrysim.base.files import check_whole, replaced_file
from gantrysim.record.named_columns import columns, description
from gantrysim.record.run import Run
from gantrysim.record.run_file import RUN

Columns = Mapping[str, NDArray[Any]]

_LONGEST_FIELD = 63  # of MATLAB [characters]
_TOPIC = "/gantrysim/record/run"


def load_record(run: str | os.PathLike[str]) -> Run:
    """Return the record in a folder that `gantrysim run` has written, or in a .npz file.

    Raises:
        InputError: there is none, or it is damaged.
    """
    place = expanded_path(run)
    if not place.exists():
        raise InputError(f"run {run}: no such folder or file; gantrysim run JOB --out {run} makes one")
    if place.is_dir():
        if not (place / RUN).is_file():
            check_whole(place, f"run {run}")
        if not (place / RUN).is_file():
            raise InputError(f"run {run}: holds no run: {RUN} missing")
        place = place / RUN
    return Run.load(place)


def export(run: Run, file: str | os.PathLike[str], kind: str) -> None:
    """Write a run as a table; an earlier file stays until then.

    Args:
        run: to be written.
        file: to write.
        kind: "csv", "parquet", "mat" or "mcap".

    Raises:
        InputError: another kind, a library that is missing, or a file that cannot be written.
    """
    if kind not in WRITERS:
        raise unknown("format", kind, WRITERS)
    table = columns(run)
    about = description(run)
    with replaced_file(file) as partial:
        WRITERS[kind](partial, table, about)


def _csv(file: Path, table: Columns, about: Mapping[str, str]) -> None:
    """Lines "# key: value", a line of names, and the rows in full precision; dispense is 0 or 1."""
    with file.open("w", newline="", encoding="utf-8") as stream:
        stream.writelines(f"# {key}: {value}\n" for key, value in about.items())
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(table)
        writer.writerows(zip(*(_numbers(column).tolist() for column in table.values()), strict=True))


def _mat(file: Path, table: Columns, about: Mapping[str, str]) -> None:
    """Two structs, `run` with the columns and `about`; other characters in names become _."""
    from scipy.io import savemat

    fields = {re.sub(r"\W", "_", name, flags=re.ASCII): _numbers(column)[:, None] for name, column in table.items()}
    longest = max(fields, key=len)
    if len(fields) < len(table) or len(longest) > _LONGEST_FIELD:
        raise InputError(f"{longest}: MATLAB's fields must differ and have at most {_LONGEST_FIELD} ASCII characters")
    with file.open("wb") as stream:
        savemat(stream, {"run": fields, "about": dict(about)}, do_compression=True, long_field_names=True)


def _parquet(file: Path, table: Columns, about: Mapping[str, str]) -> None:
    """Columns of doubles, and of booleans; the rest as metadata of the schema."""
    arrow = _library("pyarrow", "parquet")
    parquet = _library("pyarrow.parquet", "parquet")
    content = arrow.table({name: np.asarray(column) for name, column in table.items()})
    parquet.write_table(content.replace_schema_metadata(dict(about)), str(file))


def _mcap(file: Path, table: Columns, about: Mapping[str, str]) -> None:
    """A message in JSON per servo tick on /gantrysim/record/run, at its time; nan is null."""
    writer_of = _library("mcap.writer", "mcap").Writer
    kinds = {name: "boolean" if column.dtype == bool else "number" for name, column in table.items()}
    schema = {"type": "object", "properties": {name: {"type": kind} for name, kind in kinds.items()}}
    with file.open("wb") as stream:
        writer = writer_of(stream)
        writer.start(library=f"gantrysim {about['version']}")
        number = writer.register_schema("gantrysim.Run", "jsonschema", json.dumps(schema).encode())
        channel = writer.register_channel(_TOPIC, "json", number)
        rows = zip(*(column.tolist() for column in table.values()), strict=True)
        for k, row in enumerate(rows):
            values = [None if isinstance(value, float) and not math.isfinite(value) else value for value in row]
            time = round(1e9 * row[0])
            message = json.dumps(dict(zip(table, values, strict=True))).encode()
            writer.add_message(channel, log_time=time, data=message, publish_time=time, sequence=k)
        writer.add_metadata("run", dict(about))
        writer.finish()


WRITERS: dict[str, Callable[[Path, Columns, Mapping[str, str]], None]] = {
    "csv": _csv,
    "parquet": _parquet,
    "mat": _mat,
    "mcap": _mcap,
}


def _numbers(column: NDArray[Any]) -> NDArray[Any]:
    return column.astype(np.uint8) if column.dtype == bool else column


def _library(name: str, kind: str) -> Any:
    with extra("tables", f"--format {kind}", "or choose csv or mat"):
        return import_module(name)
