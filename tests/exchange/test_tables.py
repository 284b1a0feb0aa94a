"""Tables of runs: every value comes back as it was, in every format, units in the names."""

import csv
import json
import sys

import numpy as np
import pytest
from scipy.io import loadmat

from gantrysim import Job, Run
from gantrysim.exchange.tables import export, load_record
from gantrysim.record.named_columns import columns

from support.jobs import job_run
from support.soaked import suite_runs


@pytest.fixture(scope="module")
def run():
    return job_run("fanuc-spiral")


def read_csv(file):
    with file.open(encoding="utf-8") as stream:
        lines = list(stream)
    about = dict(line[2:].rstrip("\n").split(": ", 1) for line in lines if line.startswith("# "))
    names, *rows = csv.reader(line for line in lines if not line.startswith("#"))
    return dict(zip(names, np.array(rows, float).T, strict=True)), about


def read_mat(file):
    content = loadmat(file, squeeze_me=True)
    run, about = content["run"], content["about"]
    return {n: run[n].item() for n in run.dtype.names}, {n: str(about[n].item()) for n in about.dtype.names}


def read_parquet(file):
    parquet = pytest.importorskip("pyarrow.parquet")
    table = parquet.read_table(str(file))
    about = {key.decode(): value.decode() for key, value in table.schema.metadata.items()}
    return {name: table[name].to_numpy() for name in table.column_names}, about


def read_mcap(file):
    reader = pytest.importorskip("mcap.reader")
    with file.open("rb") as stream:
        opened = reader.make_reader(stream)
        found = [(message.log_time, json.loads(message.data)) for _, _, message in opened.iter_messages()]
        (about,) = [record.metadata for record in opened.iter_metadata()]
    assert [time for time, _ in found] == [round(1e9 * row["time_s"]) for _, row in found]
    return {name: np.array([row[name] for _, row in found], float) for name in found[0][1]}, about


READERS = {"csv": read_csv, "mat": read_mat, "parquet": read_parquet, "mcap": read_mcap}


@pytest.mark.parametrize("kind", suite_runs(READERS, 0, 1))
def test_every_value_comes_back_as_it_was(run, tmp_path, kind):
    if kind in ("parquet", "mcap"):
        pytest.importorskip({"parquet": "pyarrow"}.get(kind, kind))
    file = tmp_path / f"table.{kind}"
    export(run, file, kind)
    table, about = READERS[kind](file)
    for a, axis in enumerate(run.axes):
        for name, unit in (("commanded", "mm"), ("encoder", "mm"), ("motor", "mm"), ("torque", "Nm"), ("voltage", "V")):
            assert np.array_equal(table[f"{name}_{axis}_{unit}"], getattr(run, name)[:, a], equal_nan=True)
    for k, axis in enumerate("xyz"):
        assert np.array_equal(table[f"nozzle_{axis}_mm"], run.nozzle[:, k])
    assert np.array_equal(table["time_s"], run.time)
    assert np.array_equal(table["dispense"].astype(bool), run.dispense)
    assert np.array_equal(table["flow_mm3_s"], run.flow)
    assert (about["machine"], float(about["period_s"])) == (run.machine, run.period)
    assert len(table) == len(columns(run)) == 1 + 7 * len(run.axes) + 4 * 3 + 3


def test_a_data_frame_has_the_columns_and_describes_the_run(run):
    pytest.importorskip("pandas")
    frame = run.to_frame()
    assert frame.shape == (len(run.time), len(columns(run)))
    assert frame["nozzle_x_mm"].to_numpy().tolist() == run.nozzle[:, 0].tolist()
    assert frame.attrs["machine"] == run.machine


def test_a_library_that_is_missing_is_told_in_one_line(run, tmp_path, monkeypatch):
    for name in ("pandas", "pyarrow", "pyarrow.parquet", "mcap", "mcap.writer"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ValueError, match="pandas is not installed: pip install"):
        run.to_frame()
    for kind, library in (("parquet", "pyarrow"), ("mcap", "mcap")):
        with pytest.raises(ValueError, match=f"--format {kind}: {library} is not installed"):
            export(run, tmp_path / "table", kind)
    assert not list(tmp_path.iterdir())


def test_the_command_exports_the_run_of_a_folder(run, tmp_path, gantrysim_command):
    folder = tmp_path / "out"
    folder.mkdir()
    run.save(folder / "run.npz")
    status, out, err = gantrysim_command("export", folder)
    assert (status, err) == (0, "")
    assert f"written to {folder / 'run.csv'}" in out.replace("\n", "")
    table, _ = read_csv(folder / "run.csv")
    assert table["encoder_y_mm"].tolist() == run.encoder[:, 1].tolist()
    for arguments, message in (
        ((folder, "--format", "xls"), "unknown format 'xls'"),
        ((tmp_path / "none",), "no such folder or file"),
        ((tmp_path,), "holds no run"),
    ):
        status, _, err = gantrysim_command("export", *arguments)
        assert status == 2
        assert message in err.replace("\n", " ")


@pytest.mark.parametrize(
    ("name", "options", "kind"),
    suite_runs(
        [
            ("m1.xyz", (), "csv"),
            ("m1", (), "csv"),
            ("m1.CSV", (), ""),
            ("m1.mat", (), ""),
            ("m1.xyz", ("--format", "mat"), "mat"),
            ("m1.mat", ("--format", "csv"), "csv"),
        ],
        0,
        2,
        5,
    ),
)
def test_the_format_is_that_of_the_name_or_is_said(run, tmp_path, gantrysim_command, name, options, kind):
    run.save(tmp_path / "run.npz")
    file = tmp_path / name
    status, out, _ = gantrysim_command("export", tmp_path, "--out", file, *options)
    assert status == 0
    said = f"written to {file}" + (f" in the format {kind}" if kind else "")
    assert "".join(out.split()) == "".join(said.split())
    is_mat = file.read_bytes()[:6] == b"MATLAB"
    assert is_mat == ((kind or name.rpartition(".")[2].lower()) == "mat")


def test_a_record_is_loaded_from_its_folder_or_file(run, tmp_path):
    run.save(tmp_path / "run.npz")
    for place in (tmp_path, tmp_path / "run.npz"):
        assert isinstance(load_record(place), Run)
    assert Job.load("fanuc-spiral").machine == load_record(tmp_path).machine
