"""Columns of binary files that other programs write: which are taken, with which units, in which order."""

import json

import numpy as np
import pytest
from scipy.io import savemat

from gantrysim import InputError
from gantrysim.tables.column_table import Source
from gantrysim.tables.reading import read_table

TIME = 1e-3 * np.arange(6)


@pytest.fixture
def mat(tmp_path):
    def written(content):
        file = tmp_path / "log.mat"
        savemat(file, content)
        return read_table(file)

    return written


def test_columns_are_the_vectors_of_the_length_that_most_have(mat):
    table = mat(
        {
            "t": TIME,
            "x_um": 1e3 * TIME[:, None],
            "on": np.array([True, False] * 3),
            "state": np.array(["idle", "run", "run", "run", "run", "idle"], dtype=object),
            "gain": 0.3,
            "pair": np.array([1.0, 2.0]),
            "grid": np.ones((2, 3)),
        }
    )
    assert set(table.columns) == {"t", "x_um", "on"}
    assert table.columns["on"].tolist() == [1.0, 0.0] * 3
    assert table.texts == {"state": ["idle", "run", "run", "run", "run", "idle"]}
    assert table.units == {"x_um": "um"}
    assert table.values(Source("x_um"), "mm") == pytest.approx(TIME)


def test_a_column_that_is_named_as_a_unit_has_none(mat):
    assert mat({"t": TIME, "mm": TIME, "y_mm": TIME, "y_foo": TIME}).units == {"y_mm": "mm"}


def test_of_several_structs_the_fullest_is_read(mat):
    few = {"a": TIME, "b": 1.0, "c": 2.0, "d": 3.0}
    table = mat({"few": few, "log": {"t": TIME, "x": 2 * TIME}, "loose": TIME})
    assert set(table.columns) == {"t", "x"}


def test_a_file_without_columns_of_numbers_is_refused(mat):
    with pytest.raises(InputError, match=r"has no columns of more than one value; it has: grid, none"):
        mat({"grid": np.ones((2, 3)), "none": np.zeros((0, 0))})
    with pytest.raises(InputError, match=r"has no columns of numbers; it has: state"):
        mat({"state": np.array(["idle", "run", "on"], dtype=object)})


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("log.parquet", b"PAR1" + bytes(40) + b"PAR1", "is no Parquet file that can be read: "),
        ("log.mat", b"MATLAB 5.0 MAT-file" + bytes(200), "is not a readable MATLAB file: "),
        (
            "log.mat",
            b"\x89HDF\r\n\x1a\n" + bytes(600),
            "is a file of MATLAB 7.3 (HDF5): must be saved with -v7, or as CSV or Parquet",
        ),
        ("log.mcap", b"\x89MCAP0\r\n" + bytes(40), "is no MCAP file that can be read: "),
    ],
)
def test_a_binary_file_that_is_damaged_is_refused_in_one_line(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError) as refused:
        read_table(tmp_path / name)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


def test_instants_count_from_the_first_row_even_where_they_fall(tmp_path):
    pandas = pytest.importorskip("pandas")
    file = tmp_path / "log.parquet"
    instants = np.datetime64("2026-05-01T12:00:00") + np.array([0, 1500, -250]) * np.timedelta64(1, "ms")
    pandas.DataFrame({"stamp": instants, "x": np.arange(3.0)}).to_parquet(file)
    assert read_table(file).values(Source("stamp"), "s").tolist() == pytest.approx([0.0, 1.5, -0.25])


@pytest.fixture
def mcap(tmp_path):
    writer_of = pytest.importorskip("mcap.writer").Writer

    def written(messages, encoding="json"):
        """Messages as topic, time [ns] and content."""
        file = tmp_path / "log.mcap"
        with file.open("wb") as stream:
            writer = writer_of(stream)
            writer.start()
            schema = writer.register_schema(name="any", encoding="jsonschema", data=b"{}")
            topics = dict.fromkeys(topic for topic, _, _ in messages)
            channels = {
                topic: writer.register_channel(topic=topic, message_encoding=encoding, schema_id=schema)
                for topic in topics
            }
            for topic, time, content in messages:
                writer.add_message(channels[topic], log_time=time, publish_time=time, data=json.dumps(content).encode())
            writer.finish()
        return read_table(file)

    return written


def test_messages_of_the_topic_that_has_most_are_rows_in_the_order_of_their_times(mcap):
    rows = [(3_000_000, {"x_um": 30.0, "n": 3, "deep": {"a": 1}}), (1_000_000, {"x_um": 10.0, "n": 1, "deep": [2]})]
    rows += [(2_000_000, {"x_um": None, "deep": "text"})]
    table = mcap([("/axes", *row) for row in rows] + [("/door", time, {"open": 1}) for time in (1, 2)])
    assert table.columns["log_time"].tolist() == pytest.approx([1e-3, 2e-3, 3e-3])
    assert table.unit_of("log_time") == "s"
    assert table.columns["x_um"].tolist() == pytest.approx([10.0, np.nan, 30.0], nan_ok=True)
    assert table.columns["n"].tolist() == pytest.approx([1.0, np.nan, 3.0], nan_ok=True)
    assert table.texts["deep"] == ["[2]", "text", '{"a": 1}']
    assert "open" not in table.columns


def test_messages_of_another_encoding_are_refused(mcap):
    with pytest.raises(InputError, match="has no messages in JSON"):
        mcap([("/axes", 1, {"x": 1.0})], encoding="cdr")
