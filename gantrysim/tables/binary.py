"""Tables in binary files: Parquet, MATLAB and MCAP."""

from __future__ import annotations

import json
import math
import re
import struct
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
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
_MATLAB_HEAD = 128  # bytes
_MATLAB_PACKED = 15  # type of a packed variable
_CHUNK = 1 << 20
_BATCH = 4096  # rows of a Parquet file that are read at a time
# Logs of a machine at rest unpack to less than a hundred times their size.
_EXPANSION = 100
_ALWAYS_ALLOWED = 1 << 27  # that is always allowed [bytes]


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


class _Unpacked:
    """What a file unpacks to, counted while it is read: a small file must not fill the memory.

    Args:
        file: that is read.
        label: of the file in errors.
    """

    def __init__(self, file: Path, label: str) -> None:
        self._label = label
        self._packed = file.stat().st_size
        self._most = max(_ALWAYS_ALLOWED, _EXPANSION * self._packed)
        self._size = 0

    def add(self, size: int) -> None:
        """Count some bytes.

        Raises:
            InputError: there are too many.
        """
        self._size += size
        if self._size > self._most:
            raise InputError(
                f"{self._label}: {self._packed} bytes that unpack to more than {self._most:.3g}, as no log does: save "
                "it as CSV"
            )


def _parquet(file: Path, label: str) -> ColumnTable:
    parquet = _library("pyarrow.parquet", label)
    arrow = _library("pyarrow", label)
    unpacked = _Unpacked(file, label)
    try:
        schema = parquet.read_schema(str(file))
        numbers = [field.name for field in schema if arrow.types.is_primitive(field.type)]
        # a text that recurs is kept once, as it is stored
        texts = [field.name for field in schema if _is_text(field.type, arrow.types)]
        with parquet.ParquetFile(str(file), read_dictionary=texts) as stored:
            batches = []
            for batch in stored.iter_batches(_BATCH, columns=[*numbers, *texts]):
                unpacked.add(batch.nbytes)
                for name in texts:
                    longest = max(map(len, filter(None, batch[name].dictionary.to_pylist())), default=0)
                    unpacked.add(longest * batch.num_rows)
                batches.append(batch)
        content = arrow.Table.from_batches(batches, batches[0].schema if batches else arrow.schema([]))
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"{label}: is no Parquet file that can be read: {_first_line(error)}") from None
    columns = {
        name: content[name].cast(arrow.large_string()) if name in texts else content[name]
        for name in content.column_names
    }
    return _table(label, {name: column.to_numpy() for name, column in columns.items()})


def _is_text(kind: Any, types: Any) -> bool:
    """Return whether an Arrow column holds texts, which may be stored once each."""
    values = kind.value_type if types.is_dictionary(kind) else kind
    return bool(types.is_string(values) or types.is_large_string(values))


def _mat(file: Path, label: str) -> ColumnTable:
    """Read vectors, or those in the struct that has most of them, as `gantrysim export` writes one."""
    from scipy.io import loadmat

    unpacked = _Unpacked(file, label)
    try:
        _check_matlab(file, unpacked)
        content = loadmat(str(file), simplify_cells=True)
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"{label}: is not a readable MATLAB file: {_first_line(error)}") from None
    variables = {name: value for name, value in content.items() if not name.startswith("__")}
    candidates: list[dict[str, Any]] = [value for value in variables.values() if isinstance(value, dict)]
    candidates.append({name: value for name, value in variables.items() if isinstance(value, np.ndarray)})
    fullest = max(candidates, key=lambda fields: sum(np.size(value) > 1 for value in fields.values()))
    return _table(label, {name: np.asarray(value) for name, value in fullest.items()})


def _check_matlab(file: Path, unpacked: _Unpacked) -> None:
    """Count the bytes of a file's variables, and of the elements that they and their fields claim to have."""
    with file.open("rb") as stream:
        order = "<" if stream.read(_MATLAB_HEAD)[-2:] == b"IM" else ">"
        flags, sizes = (re.escape(struct.pack(f"{order}{form}", *tag)) for form, tag in (("II", (6, 8)), ("I", (5,))))
        shapes = re.compile(flags + b".{8}" + sizes + b"(.{4})", re.DOTALL)
        while len(tag := stream.read(8)) == 8:
            kind, size = struct.unpack(f"{order}II", tag)
            content = bytearray()
            unpacker = zlib.decompressobj()
            while size > 0 and (part := stream.read(min(size, _CHUNK))):
                size -= len(part)
                while part:
                    chunk = unpacker.decompress(part, _CHUNK) if kind == _MATLAB_PACKED else part
                    unpacked.add(len(chunk))
                    content += chunk
                    part = unpacker.unconsumed_tail
            for shape in shapes.finditer(content):
                (length,) = struct.unpack(f"{order}I", shape[1])
                dimensions = np.frombuffer(content[shape.end() : shape.end() + length // 4 * 4], f"{order}u4")
                unpacked.add(8 * math.prod(dimensions.tolist()))


def _hdf5(_file: Path, label: str) -> ColumnTable:
    raise InputError(f"{label}: is a file of MATLAB 7.3 (HDF5): must be saved with -v7, or as CSV or Parquet")


def _mcap(file: Path, label: str) -> ColumnTable:
    """Read the messages in JSON of the topic that has most of them; the time of a message is a column, log_time."""
    records = _library("mcap.records", label)
    channels: dict[int, Any] = {}
    messages: dict[str, list[dict[str, Any]]] = {}
    try:
        for record in _mcap_records(file, label):
            if isinstance(record, records.Channel):
                channels[record.id] = record
            elif isinstance(record, records.Message) and channels[record.channel_id].message_encoding == "json":
                row = {"log_time": 1e-9 * record.log_time, **json.loads(record.data)}
                messages.setdefault(channels[record.channel_id].topic, []).append(row)
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"{label}: is no MCAP file that can be read: {_first_line(error)}") from None
    if not messages:
        raise InputError(f"{label}: has no messages in JSON, the encoding that is read")
    fullest = max(messages.values(), key=len)
    rows = sorted(fullest, key=lambda row: float(row["log_time"]))
    content = {name: np.array([_cell(row.get(name)) for row in rows]) for name in rows[0]}
    table = _table(label, content)
    return ColumnTable(label, table.columns, {**table.units, "log_time": "s"}, table.texts)


def _mcap_records(file: Path, label: str) -> Iterator[Any]:
    """Yield the records of a file in their order, those of chunks too, whose sizes are checked before."""
    reading = _library("mcap.stream_reader", label)
    chunk_of = _library("mcap.records", label).Chunk
    unpacked = _Unpacked(file, label)
    with file.open("rb") as stream:
        size = file.stat().st_size
        for record in reading.StreamReader(stream, emit_chunks=True, record_size_limit=size).records:
            if not isinstance(record, chunk_of):
                yield record
                continue
            unpacked.add(max(record.uncompressed_size, len(record.data)))
            # both allocate what the packed data claim
            if record.compression == "zstd":
                unpacked.add(_library("zstandard", label).frame_content_size(record.data))
            elif record.compression == "lz4":
                unpacked.add(_library("lz4.frame", label).get_frame_info(record.data)["content_size"])
            yield from reading.breakup_chunk(record)


def _cell(value: Any) -> Any:
    # of a number that is not finite
    if value is None:
        return np.nan
    return value if isinstance(value, int | float | str) else json.dumps(value)


def _first_line(error: Exception) -> str:
    return (str(error) or type(error).__name__).splitlines()[0]
