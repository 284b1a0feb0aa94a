"""Small files that unpack to much more than any log, and those that do not."""

import json
import struct

import numpy as np
import pytest
from scipy.io import savemat

from gantrysim import InputError
from gantrysim.tables import binary
from gantrysim.tables.reading import read_table

arrow = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")
writer = pytest.importorskip("mcap.writer")

REFUSED = r"log: \d+ bytes that unpack to more than 1\.05e\+06, as no log does: save it as CSV$"


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """A megabyte is as much as a small file may unpack to."""
    monkeypatch.setattr(binary, "_ALWAYS_ALLOWED", 1 << 20)
    monkeypatch.setattr(binary, "_EXPANSION", 1)


def refused(file):
    with pytest.raises(InputError, match=REFUSED):
        read_table(file)


def written(file, table):
    parquet.write_table(arrow.table(table), file)
    return file


def test_parquet_of_constants_and_of_long_texts(tmp_path):
    file = tmp_path / "log"
    refused(written(file, {"x": np.zeros(200_000)}))
    recurring = ["x" * 1000] * 2000
    time = np.arange(2000.0)
    refused(written(file, {"t": time, "text": recurring}))
    refused(written(file, {"t": time, "text": arrow.array(recurring, arrow.large_string())}))
    refused(written(file, {"t": time, "text": arrow.array(recurring).dictionary_encode()}))


def test_parquet_within_the_bound_is_read_as_it_stands(tmp_path):
    texts = ["idle", None, "moving"] * 100
    table = {
        "t": np.arange(300.0),
        "on": np.arange(300) % 2 == 0,
        "when": np.arange(300).astype("M8[ms]"),
        "state": texts,
        "kind": arrow.array(texts).dictionary_encode(),
        "large": arrow.array(texts, arrow.large_string()),
        "nested": [[1.0]] * 300,
    }
    read = read_table(written(tmp_path / "log", table))
    assert read.columns["t"].tolist() == table["t"].tolist()
    assert read.columns["on"].tolist() == [1.0, 0.0] * 150
    assert read.columns["when"] == pytest.approx(1e-3 * np.arange(300))
    assert read.texts == {name: [str(text) for text in texts] for name in ("state", "kind", "large")}
    with pytest.raises(InputError, match=r"has no columns of more than one value"):
        read_table(written(tmp_path / "log", {"t": np.zeros(0)}))


def test_matlab_of_packed_zeros(tmp_path):
    file = tmp_path / "log"
    with file.open("wb") as stream:
        savemat(stream, {"x": np.zeros(200_000)}, do_compression=True)
    assert file.stat().st_size < 20_000
    refused(file)
    with file.open("wb") as stream:
        savemat(stream, {"x": np.arange(20_000.0), "y": np.zeros(20_000)}, do_compression=True)
    assert read_table(file).columns["x"].tolist() == list(range(20_000))


def element(kind, content):
    """An element of a MATLAB file: its type, its length, and its bytes, filled up to eight."""
    return struct.pack("<II", kind, len(content)) + content + b"\0" * (-len(content) % 8)


def structure(shape, fields):
    """A variable of class struct without a name, with the bytes of its fields' values."""
    names = element(5, struct.pack("<i", 8)) + element(1, b"a".ljust(8, b"\0") if fields else b"")
    head = element(6, struct.pack("<II", 2, 0)) + element(5, struct.pack("<ii", *shape)) + element(1, b"")
    return element(14, head + names + fields)


@pytest.mark.parametrize("size", [2_000_000_000, -1])
def test_matlab_with_a_field_that_claims_billions_of_elements(tmp_path, size):
    file = tmp_path / "log"
    head = b"MATLAB 5.0".ljust(124) + b"\0\1IM"
    file.write_bytes(head + structure((1, 1), structure((1, size), b"")))
    refused(file)


@pytest.mark.parametrize("packing", ["NONE", "ZSTD", "LZ4"])
def test_mcap_of_packed_messages(tmp_path, packing):
    def log(count, length):
        with (tmp_path / "log").open("wb") as stream:
            out = writer.Writer(stream, compression=writer.CompressionType[packing], chunk_size=4000)
            out.start()
            channel = out.register_channel("run", "json", out.register_schema("s", "jsonschema", b"{}"))
            for k in range(count):
                data = json.dumps({"x": k, "text": " " * length}).encode()
                out.add_message(channel, (count - k) * 1_000_000_000, data, 0)
            out.finish()
        return tmp_path / "log"

    if packing != "NONE":
        refused(log(2000, 1000))
    columns = read_table(log(200, 10)).columns
    assert columns["x"].tolist() == list(range(200))[::-1]  # in the order of their times
    assert columns["log_time"] == pytest.approx(np.arange(1, 201))


def test_mcap_whose_chunk_claims_more_than_it_holds(tmp_path):
    """The sizes that the packed data claim are checked before they are taken."""
    import zstandard
    from mcap.records import Chunk

    packed = bytearray(zstandard.ZstdCompressor().compress(b" " * 1_000_000))
    chunk = Chunk("zstd", bytes(packed), 0, 0, 0, 10)
    assert zstandard.frame_content_size(chunk.data) == 1_000_000
    with (tmp_path / "log").open("wb") as stream:
        out = writer.Writer(stream, use_chunking=False)
        out.start()
        builder = writer.RecordBuilder()
        for _ in range(2):
            chunk.write(builder)
        stream.write(builder.end())
        out.finish()
    refused(tmp_path / "log")
