"""What softMC's RECORD samples of a run."""

import csv

import numpy as np
import pytest

from gantrysim import Servo, simulate
from gantrysim.base.errors import InputError
from gantrysim.controllers import fanuc
from gantrysim.controllers.softmc import Group, Move, Program, Record

from support.runs import PERIOD


@pytest.fixture(scope="module")
def run(xy):
    program = Program([Move((20, 0)), Move((20, 10))], Group(velocity=100))
    return simulate(xy, Servo.derive(xy.axes, PERIOD), program.setpoints(PERIOD))


@pytest.mark.parametrize(("points", "gap", "count"), [(5, 1, 5), (10, 7, 10), (10_000, 3, None), (1, 1000, 1)])
def test_every_gap_ticks_are_sampled_up_to_the_number_of_points(run, points, gap, count):
    columns = Record(points, gap).of(run)
    expected = np.arange(0, len(run.time), gap)[:points]
    assert len(expected) == (count or len(expected))
    np.testing.assert_array_equal(columns["time"], run.time[expected])
    assert all(len(values) == len(expected) for values in columns.values())


def test_the_expressions_are_those_of_the_run(run):
    columns = Record(10_000).of(run)
    for a, axis in enumerate("xy"):
        np.testing.assert_array_equal(columns[f"PCMD {axis}"], run.commanded[:, a])
        np.testing.assert_array_equal(columns[f"PFB {axis}"], run.encoder[:, a])
        np.testing.assert_array_equal(columns[f"PE {axis}"], run.commanded[:, a] - run.encoder[:, a])
        for name, values in (("VCMD", run.commanded), ("VFB", run.encoder)):
            assert columns[f"{name} {axis}"][0] == 0
            np.testing.assert_array_equal(columns[f"{name} {axis}"][1:], np.diff(values[:, a]) / PERIOD)
    for a, axis in enumerate("xyz"):
        np.testing.assert_array_equal(columns[f"SETPOINT {axis}"], run.commanded_tip[:, a])
    assert np.abs(columns["VCMD x"]).max() == pytest.approx(100)


def test_the_delayed_position_error_compares_an_older_command(run):
    error = Record(10_000, what=("PE",)).of(run, delay=2)["PE x"]
    np.testing.assert_array_equal(error[2:], run.commanded[:-2, 0] - run.encoder[2:, 0])
    np.testing.assert_array_equal(error[:2], run.commanded[0, 0] - run.encoder[:2, 0])


def test_columns_are_in_the_requested_order(run):
    assert list(Record(3, what=("pfb", "PCMD")).of(run)) == ["time", "PFB x", "PFB y", "PCMD x", "PCMD y"]


def test_a_program_writes_a_record_only_if_it_keeps_one(run, tmp_path):
    for record in (None, Record(5)):
        file = tmp_path / "record.csv"
        assert Program("Move {20, 0}", record=record).write_record(run, file) is (record is not None)
        assert file.exists() is (record is not None)
    assert not fanuc.Program("G00 X10").write_record(run, tmp_path / "none.csv")


def test_written_and_read_again_the_record_is_the_same(run, tmp_path):
    record = Record(50, 4)
    record.write(run, tmp_path / "record.csv")
    with (tmp_path / "record.csv").open(encoding="utf-8") as stream:
        head, *rows = csv.reader(stream)
    assert head[:4] == ["time [s]", "PCMD x [mm]", "PCMD y [mm]", "PFB x [mm]"]
    assert head[7:9] == ["VCMD x [mm/s]", "VCMD y [mm/s]"]
    assert head[-1] == "SETPOINT z [mm]"
    np.testing.assert_array_equal(np.array(rows, float), np.column_stack(list(record.of(run).values())))


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((5, 1, ("PFX",)), "unknown expression 'PFX': did you mean PFB? known: PFB, PCMD, PE, SETPOINT, VCMD, VFB"),
        ((0,), "points = 0: must be at least 1"),
        ((5, 0.5), "gap = 0.5: must be at least 1"),
        ((5, 1.5), "gap = 1.5: must be a whole number"),
    ],
)
def test_a_value_out_of_its_bound_is_named(arguments, text):
    with pytest.raises(InputError) as caught:
        Record(*arguments)
    assert str(caught.value) == text
