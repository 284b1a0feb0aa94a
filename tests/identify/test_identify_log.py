"""Logs of torque and position: units, heads, and what is refused."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from gantrysim import InputError, Machine, Servo, simulate
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.exchange.tables import export
from gantrysim.identify.log import Log, read_log

MACHINE = Machine("xy")
N = 200


def written(folder, heads, *columns):
    file = folder / "log.csv"
    rows = [",".join(f"{value:.12g}" for value in row) for row in zip(*columns, strict=True)]
    file.write_text("\n".join([",".join(heads), *rows, ""]), encoding="utf-8")
    return file


def columns():
    k = np.arange(N)
    return k, np.sin(0.1 * k), np.cos(0.1 * k)


@pytest.mark.parametrize(
    ("heads", "factors"),
    [
        (("time [s]", "x torque [N·m]", "x position [mm]"), (1e-3, 1.0, 1.0)),
        (("time", "x_torque", "x_position"), (1e-3, 1.0, 1e3)),
        (("time [ms]", "x torque [mN·m]", "x position [µm]"), (1e-6, 1e-3, 1e-3)),
        ((" time (us)", "x.torque (Nm)", "x.position (m)"), (1e-9, 1.0, 1e3)),
        (("time", "x torque", "x position [counts]"), (1e-3, 1.0, 1e-3)),
    ],
    ids=["units", "SI", "small", "round", "counts"],
)
def test_units_are_converted(tmp_path, heads, factors):
    k, torque, position = columns()
    log = read_log(written(tmp_path, heads, 1e-3 * k, torque, position), MACHINE)
    period, by_torque, by_position = factors
    assert log.axes == ("x",)
    assert not log.held
    assert log.period == pytest.approx(period)
    assert np.allclose(log.torque[:, 0], by_torque * torque, atol=1e-11)
    assert np.allclose(log.position[:, 0], by_position * position, atol=1e-8)


def test_a_hinge_in_radians(tmp_path):
    k, torque, position = columns()
    heads = ("time", "r demand", "r position [rad]")
    log = read_log(written(tmp_path, heads, 1e-3 * k, torque, position), Machine("xyzr"))
    assert log.held
    assert np.allclose(log.position[:, 0], np.degrees(position), atol=1e-8)


def test_columns_of_any_name(tmp_path):
    k, torque, position = columns()
    file = written(tmp_path, ("Tick", "DAC", "MPOS AXIS(0)"), k, torque, position)
    named = {"time": "Tick [ms]", "x torque": "DAC [N·m]", "x position": "MPOS AXIS(0) [mm]"}
    log = read_log(file, MACHINE, named)
    assert log.period == pytest.approx(1e-3)
    assert np.allclose(log.position[:, 0], position, atol=1e-9)
    with pytest.raises(InputError, match=r"unknown column of .*log\.csv 'MPOS'.* known: .*MPOS AXIS\(0\)"):
        read_log(file, MACHINE, {**named, "x position": "MPOS"})
    with pytest.raises(InputError, match="unknown column 'z position': did you mean y position"):
        read_log(file, MACHINE, {"z position": "DAC"})


def test_a_unit_may_end_the_name_of_a_column(tmp_path):
    k, torque, position = columns()
    file = tmp_path / "log.mat"
    savemat(file, {"time_ms": k, "x_torque_Nm": torque, "x_position_um": 1e3 * position})
    log = read_log(file, MACHINE)
    assert log.period == pytest.approx(1e-3)
    assert np.allclose(log.position[:, 0], position, atol=1e-9)
    assert np.allclose(log.torque[:, 0], torque, atol=1e-12)


def test_a_table_that_export_writes_is_a_log(tmp_path):
    run = simulate(MACHINE, Servo.derive(MACHINE.axes), MoveSpiral(24, 1, 5, 80))
    export(run, tmp_path / "run.csv", "csv")
    log, expected = read_log(tmp_path / "run.csv", MACHINE), Log.of(run)
    assert log.axes == expected.axes
    assert log.held
    assert log.period == pytest.approx(expected.period)
    np.testing.assert_allclose(log.position, expected.position, atol=1e-12)
    np.testing.assert_allclose(log.torque, expected.torque, atol=1e-12)


@settings(deadline=None, max_examples=20)
@given(period=st.floats(1e-5, 1e-2), size=st.floats(1e-6, 1e3), held=st.booleans())
def test_a_log_is_read_as_it_was_saved(tmp_path_factory, period, size, held):
    _, torque, position = columns()
    log = Log(("x", "y"), period, size * np.stack([position, -position], 1), np.stack([torque, 2 * torque], 1), held)
    file = tmp_path_factory.mktemp("log") / "log.csv"
    log.save(file, {"x": "mm", "y": "mm"})
    again = read_log(file, MACHINE)
    assert (again.axes, again.held) == (log.axes, held)
    assert math.isclose(again.period, period, rel_tol=1e-6)
    assert np.allclose(again.position, log.position, rtol=1e-8)
    assert np.allclose(again.torque, log.torque, rtol=1e-8)


@pytest.mark.parametrize(
    ("heads", "change", "text"),
    [
        (
            ("t", "x torque", "x position"),
            None,
            r"has no column time: name it, as in --column 'time=t \[ms\]', or give --period; it has: t, x torque, x pos",
        ),
        (
            ("time", "a torque", "x position"),
            None,
            "x has motion and no torque; it must have columns such as x position",
        ),
        (("time", "x torque", "a position"), None, "has no axis with position or velocity, and torque; it must have"),
        (("time", "x torque [V]", "x position"), None, r"column x torque is in 'V': must be in N·m"),
        (("time [h]", "x torque", "x position"), None, "column time is in 'h': must be in s"),
        (("time", "x torque", "x position [N]"), None, "column x position is in 'N': must be in mm"),
        (
            ("time", "x torque", "x position"),
            "gaps",
            "has 90 samples in pieces of at least 20 without a gap, must have at least 100",
        ),
        (
            ("time", "x torque", "x position"),
            "twice",
            r"time does not rise: rows 100 and 101 both have 0\.099 s; log at every servo tick, with all digits; if only "
            r"the stamps are rounded, give the period by --period$",
        ),
        (("time", "x torque", "x position"), "text", "line 12: x torque = 'abc' is not a finite number"),
        (("time", "x torque", "x position"), "short", "has 49 samples, must have at least 100"),
    ],
)
def test_a_bad_log_is_refused(tmp_path, heads, change, text):
    k, torque, position = columns()
    if change == "gaps":
        k = np.where(k > 89, k + 5, k)
        torque[np.arange(109, 200, 20)] = np.nan
    if change == "twice":
        k = np.where(k > 99, k - 1, k)
    file = written(tmp_path, heads, 1e-3 * k, torque, position)
    lines = file.read_text(encoding="utf-8").splitlines()
    if change == "text":
        lines[11] = "0.01,abc,0"
    file.write_text("\n".join(lines[: 50 if change == "short" else None]), encoding="utf-8")
    with pytest.raises(InputError, match=f"^log {file}: {text}"):
        read_log(file, MACHINE)


def test_gaps_end_a_piece_and_are_said(tmp_path):
    k, torque, position = columns()
    heads = ("time", "x torque", "x position [mm]")
    later = np.where(k > 149, k + 7, k)  # seven samples are missing
    torque[20] = np.nan
    log = read_log(written(tmp_path, heads, 1e-3 * later, torque, position), MACHINE)
    assert log.starts == (0, 20, 149)
    assert np.allclose(log.position[:, 0], np.delete(position, 20), atol=1e-9)
    assert np.allclose(log.torque[:, 0], np.delete(torque, 20), atol=1e-12)
    assert np.allclose(log.time, 1e-3 * np.delete(later, 20))
    assert log.notes == (
        "log: of 200 rows, 199 are used, in 3 pieces, as rows or values are missing after 0.019 s, 0.149 s",
    )
    # a piece of nine rows shows nothing
    torque[10] = np.nan
    log = read_log(written(tmp_path, heads, 1e-3 * k, torque, position), MACHINE)
    assert log.starts == (0,)
    assert log.begins == (0.021,)
    assert np.allclose(log.position[:, 0], position[21:], atol=1e-9)
    assert log.notes == ("log: of 200 rows, 179 are used, those without a gap from 0.021 s to 0.199 s",)


def test_torque_from_a_current_or_a_share_of_the_rated_one(tmp_path):
    k, torque, position = columns()
    heads = ("time", "I [A]", "TRQ ‰", "pos")
    file = written(tmp_path, heads, 1e-3 * k, torque, 1000 * torque, position)
    of_current = read_log(file, MACHINE, {"x torque": "I*0.0302 N·m", "x position": "pos/2 [counts]"})
    assert np.allclose(of_current.torque[:, 0], 0.0302 * torque, atol=1e-12)
    assert np.allclose(of_current.position[:, 0], 0.5 * MACHINE.axes[0].resolution * position, atol=1e-12)
    of_rated = read_log(file, MACHINE, {"x torque": "TRQ ‰[‰ of 1.27 N·m]", "x position": "pos [mm]"})
    assert np.allclose(of_rated.torque[:, 0], 1.27 * torque, atol=1e-11)
    with pytest.raises(InputError, match=r"must say of what, as in '‰ of 1\.27 N·m'"):
        read_log(file, MACHINE, {"x torque": "TRQ ‰[‰]", "x position": "pos [mm]"})
    with pytest.raises(InputError, match="column I is in 'A': must be in N·m"):
        read_log(file, MACHINE, {"x torque": "I", "x position": "pos [mm]"})


def test_no_such_file(tmp_path):
    with pytest.raises(InputError, match=r"missing\.csv: cannot be read: No such file"):
        read_log(tmp_path / "missing.csv", MACHINE)


def test_a_log_of_several_pieces():
    position, torque = np.arange(8.0)[:, None], -np.arange(8.0)[:, None]
    log = Log(("x",), 1e-3, position, torque, held=True, starts=(0, 2, 6))
    assert log.pieces == (slice(0, 2), slice(2, 6), slice(6, 8))
    longest = log.longest
    assert longest.position[:, 0].tolist() == [2, 3, 4, 5]
    assert longest.torque[:, 0].tolist() == [-2, -3, -4, -5]
    assert longest.starts == (0,)
    assert longest.notes == ("log: of 8 rows in 3 pieces, the 4 of the longest are used",)
    assert longest.longest is longest
