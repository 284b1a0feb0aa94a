"""Tables in binary files: Parquet, MATLAB and MCAP."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.errors import InputError
from gantrysim.base.extras import extra
from gantrysim.tables.column_table import ColumnTable
from gantrysim.tables.units import SUFFIXES

_MCAP = b"\x89MCAP0\r\n"
_PARQUET = b"PAR1"
_MATLAB = b"MATLAB 5.0"
_HDF5 = b"\x89HDF\r\n\x1a\n"


def binary_reader(head: bytes) -> Callable[[Path, str], ColumnTable] | None:
    """Return the reader of a binary file by its first bytes, None of a text."""
    if head.startswith(_PARQUET):
        return _parquet
    if head.startswith(_MATLAB):
        return _hdf5 if _HDF5 in head else _mat
    if head.startswith(_HDF5):
        return _hdf5
    return _mcap if head.startswith(_MCAP) else None


def _library(name: str, label: str) -> Any:
    with extra("tables", label):
        return import_module(name)


def _table(label: str, content: Mapping[str, NDArray[Any]]) -> ColumnTable:
    """Return the columns of one length that most have; numbers and booleans, and texts."""
    vectors = {
        name: np.ravel(values)
        for name, values in content.items()
        if np.size(values) == max(np.shape(values), default=0)
    }
    sizes = Counter(values.size for values in vectors.values() if values.size > 1)
    if not sizes:
        raise InputError(f"{label}: has no columns of more than one value; it has: {', '.join(content) or 'nothing'}")
    size = sizes.most_common(1)[0][0]
    columns = {}
    texts = {}
    units = {}
    for name, values in vectors.items():
        if values.size != size:
            continue
        if values.dtype.kind in "biuf":
            columns[name] = values.astype(float)
            suffix = name.rpartition("_")[2]
            if suffix in SUFFIXES and suffix != name:
                units[name] = suffix
        elif values.dtype.kind == "M":
            columns[name] = (values - values[0]) / np.timedelta64(1, "ns") * 1e-9
            units[name] = "s"
        else:
            texts[name] = [str(value) for value in values]
    if not columns:
        raise InputError(f"{label}: has no columns of numbers; it has: {', '.join(texts)}")
    return ColumnTable(label, columns, units, texts)


def _is_vector(values: NDArray[Any]) -> bool:
    return values.size == max(values.shape, default=0)


def _parquet(file: Path, label: str) -> ColumnTable:
    parquet = _library("pyarrow.parquet", label)
    try:
        content = parquet.read_table(str(file))
    except Exception as error:
        raise InputError(f"{label}: is no Parquet file that can be read: {_first_line(error)}") from None
    return _table(label, {name: content[name].to_numpy() for name in content.column_names})


def _mat(file: Path, label: str) -> ColumnTable:
    """Read vectors, or those in the struct that has most of them, as `gantrysim export` writes one."""
    from scipy.io import loadmat

    try:
        content = loadmat(str(file), simplify_cells=True)
    except Exception as error:
        raise InputError(f"{label}: is not a readable MATLAB file: {_first_line(error)}") from None
    variables = {name: value for name, value in content.items() if not name.startswith("__")}
    candidates: list[dict[str, Any]] = [value for value in variables.values() if isinstance(value, dict)]
    candidates.append({name: value for name, value in variables.items() if isinstance(value, np.ndarray)})
    fullest = max(candidates, key=lambda fields: sum(np.size(value) > 1 for value in fields.values()))
    return _table(label, {name: np.asarray(value) for name, value in fullest.items()})


def _hdf5(_file: Path, label: str) -> ColumnTable:
    raise InputError(f"{label}: is a file of MATLAB 7.3 (HDF5): must be saved with -v7, or as CSV or Parquet")


def _mcap(file: Path, label: str) -> ColumnTable:
    """Read the messages in JSON of the topic that has most of them; the time of a message is a column, log_time."""
    reader_of = _library("mcap.reader", label).make_reader
    messages: dict[str, list[dict[str, Any]]] = {}
    try:
        with file.open("rb") as stream:
            for _, channel, message in reader_of(stream).iter_messages():
                if channel.message_encoding == "json":
                    fields = json.loads(message.data)
                    messages.setdefault(channel.topic, []).append({"log_time": 1e-9 * message.log_time, **fields})
    except Exception as error:
        raise InputError(f"{label}: is no MCAP file that can be read: {_first_line(error)}") from None
    if not messages:
        raise InputError(f"{label}: has no messages in JSON, the encoding that is read")
    rows = max(messages.values(), key=len)
    content = {name: np.array([_cell(row.get(name)) for row in rows]) for name in rows[0]}
    table = _table(label, content)
    return ColumnTable(label, table.columns, {**table.units, "log_time": "s"}, table.texts)


def _cell(value: Any) -> Any:
    if value is None:  # of a number that is not finite
        return np.nan
    return value if isinstance(value, int | float | str) else json.dumps(value)


def _first_line(error: Exception) -> str:
    return (str(error) or type(error).__name__).splitlines()[0]
