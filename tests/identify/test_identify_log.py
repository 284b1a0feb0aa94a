"""Logs of torque and position: units, heads, and what is refused."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import savemat

from gantrysim import InputError, Machine, Servo, simulate
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.exchange.tables import export
from gantrysim.identify.log import Log, Rows, _agreement, read_log

from support.soaked import examples

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
    with pytest.raises(InputError, match=r"log\.csv: unknown column 'MPOS'.* known: .*MPOS AXIS\(0\)"):
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


@examples(20)
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
            r"has no column time: name it, as in --column 'time=t \[ms\]', or give --period; it has: t, x torque",
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
            r"time does not rise: rows 100 and 101 have 0\.099 and 0\.099 s; log at every servo tick, with all digits; "
            r"if only the stamps are rounded, give the period by --period$",
        ),
        (("time", "x torque", "x position"), "text", "line 12: x torque = 'abc' is not a finite number"),
        (("time", "x torque", "x position"), "short", "has 49 samples, must have at least 100"),
    ],
)
def test_a_bad_log_is_refused(tmp_path, heads, change, text):
    k, torque, position = columns()
    if change == "gaps":
        torque[np.arange(90, 200, 20)] = np.nan
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


PITCH = MACHINE.axes[0].scale  # of the screw, per radian [mm]


@pytest.mark.parametrize(
    ("unit", "factor"),
    [
        ("", 1e-3),
        (" [mm/s]", 1.0),
        (" [m/min]", 0.06),
        (" [r/min]", 30 / math.pi / PITCH),
        (" [rad/s]", 1 / PITCH),
        (" [counts/s]", 1 / MACHINE.axes[0].resolution),
    ],
)
def test_a_velocity_is_integrated(tmp_path, unit, factor):
    """Of 5 + 2 t mm/s: 5 t + t² mm, which the trapezoidal rule gives exactly."""
    k, torque, _ = columns()
    t = 1e-3 * k
    heads = ("time", "x torque", f"x velocity{unit}")
    log = read_log(written(tmp_path, heads, t, torque, factor * (5 + 2 * t)), MACHINE)
    assert np.allclose(log.position[:, 0], 5 * t + t**2, atol=1e-9)
    assert log.notes == ("x: its position is integrated from its velocity: where in the travel it moves is not known",)


def test_nothing_is_integrated_over_rows_that_are_missing(tmp_path):
    k, torque, _ = columns()
    velocity = np.full(N, 2.0)
    torque[100:110] = np.nan
    log = read_log(written(tmp_path, ("time", "x torque", "x velocity [mm/s]"), 1e-3 * k, torque, velocity), MACHINE)
    assert log.starts == (0, 100)
    expected = np.concatenate([2e-3 * k[:100], 2e-3 * 99 + 2e-3 * np.arange(90)])
    assert np.allclose(log.position[:, 0], expected, atol=1e-12)


@pytest.mark.parametrize(
    ("factor", "shift", "text"),
    [
        (1.0, 0.0, ""),
        (0.91, 0.0, ""),
        (0.88, 0.0, r"its velocity is 0\.88 times the change of its position per time, must be 0\.9 to 1\.1 times"),
        (60.0, 0.0, r"its velocity is 60 times the change .* \(mm/min read as mm/s\?\), must be"),
        (-1.0, 0.0, "its velocity is -1 times the change"),
        (
            1.0,
            0.5,
            r"its velocity is not that of its position: their changes correlate by -0\.\d+, must be at least 0\.9",
        ),
        (0.0, 0.0, "its velocity is not that of its position: their changes correlate by "),
    ],
)
def test_a_velocity_that_is_not_the_position_s_is_named(tmp_path, factor, shift, text):
    t = 1e-3 * np.arange(2000)
    position = 10 * np.sin(5 * t)
    velocity = factor * 50 * np.cos(5 * (t - shift)) + 1e-6
    heads = ("time", "x torque", "x position [mm]", "x velocity [mm/s]")
    file = written(tmp_path, heads, t, np.cos(t), position, velocity)
    if text:
        with pytest.raises(InputError, match=f"^log {file}: axis x: {text}.*; name one of the two by --column"):
            read_log(file, MACHINE)
        alone = read_log(file, MACHINE, {"x position": "x position"})
        assert np.allclose(alone.position[:, 0], position, atol=1e-9)
        assert alone.notes == ()
    else:
        log = read_log(file, MACHINE)
        assert np.allclose(log.position[:, 0], position, atol=1e-9)
        (note,) = log.notes
        assert note.startswith("x: its position is used; its velocity agrees within ")


def test_what_is_named_goes_before_the_heads(tmp_path):
    """Of an axis with a demand by its heads, the torque is taken if it is named; a head alone decides nothing."""
    k, torque, position = columns()
    heads = ("time", "x demand", "x position [mm]", "I", "y demand", "y position [mm]", "v")
    file = written(tmp_path, heads, 1e-3 * k, torque, position, 100 * torque, torque, position, np.ones(N))
    by_heads = read_log(file, MACHINE)
    assert (by_heads.axes, by_heads.held) == (("x", "y"), True)
    named = read_log(file, MACHINE, {"x torque": "I*0.02 N·m"})
    assert (named.axes, named.held) == (("x",), False)
    assert np.allclose(named.torque[:, 0], 2 * torque, atol=1e-11)
    both = read_log(file, MACHINE, {"x torque": "I*0.02 N·m", "x demand": "I*0.01 N·m"})
    assert both.held
    assert np.allclose(both.torque[:, 0], torque, atol=1e-11)
    moved = read_log(file, MACHINE, {"x velocity": "v[mm/s]"})
    assert np.allclose(moved.position[:, 0], 1e-3 * k, atol=1e-12)


def test_a_log_without_time_has_a_period(tmp_path):
    k, torque, position = columns()
    file = written(tmp_path, ("x torque", "x position [mm]"), torque, position)
    log = read_log(file, MACHINE, period=2e-3)
    assert (log.period, log.starts) == (2e-3, (0,))
    assert np.allclose(log.time, 2e-3 * k)
    with pytest.raises(InputError, match="has no column time: name it"):
        read_log(file, MACHINE)
    with pytest.raises(InputError, match="period = 0 s: must be greater than 0"):
        read_log(file, MACHINE, period=0.0)


@pytest.mark.parametrize(("period", "digit"), [(1e-3, 1e-2), (1.25e-3, 1e-3), (4e-4, 1e-3)])
def test_rounded_stamps_need_the_period(tmp_path, period, digit):
    """They show only where more rows are missing than they are rounded by."""
    k, torque, position = columns()
    stamps = np.floor(period * k / digit + 1e-9) * digit
    file = written(tmp_path, ("time", "x torque", "x position [mm]"), stamps, torque, position)
    with pytest.raises(InputError, match=r"time does not rise|samples are not even.*give the period by --period"):
        read_log(file, MACHINE)
    log = read_log(file, MACHINE, period=period)
    assert (log.period, log.starts) == (period, (0,))
    assert log.notes[0].startswith("log: its time stamps are off even ones by up to ")
    with pytest.raises(InputError, match=rf"period = {2 * period:g} s is given, but 200 rows last .* s by their time"):
        read_log(file, MACHINE, period=2 * period)
    later = stamps + np.where(k > 99, 5 * digit, 0.0)
    file = written(tmp_path, ("time", "x torque", "x position [mm]"), later, torque, position)
    assert read_log(file, MACHINE, period=period).starts == (0, 100)


def test_a_recording_that_begins_anew_is_a_piece(tmp_path):
    k, torque, position = columns()
    stamps = 1e-3 * np.where(k > 119, k - 120, k)
    log = read_log(written(tmp_path, ("time", "x torque", "x position [mm]"), stamps, torque, position), MACHINE)
    assert (log.starts, log.begins) == ((0, 120), (0.0, 0.0))


@pytest.mark.parametrize(
    ("text", "rows"), [("51:180", (51, 180)), ("51:", (51, 200)), (":180", (1, 180)), (":", (1, 200))]
)
def test_rows_are_chosen(tmp_path, text, rows):
    k, torque, position = columns()
    file = written(tmp_path, ("time", "x torque", "x position [mm]"), 1e-3 * k, torque, position)
    log = read_log(file, MACHINE, rows=Rows.parse(text))
    assert np.allclose(log.position[:, 0], position[rows[0] - 1 : rows[1]], atol=1e-9)
    assert log.begins == (pytest.approx(1e-3 * (rows[0] - 1)),)
    assert log.notes == ()


@pytest.mark.parametrize("text", ["5", "0:9", "a:9", "-3:9", "1:2:3", "1.5:9"])
def test_rows_that_are_none(text):
    with pytest.raises(InputError, match=f"^--rows {text}: must be FIRST:LAST, numbers of rows from 1, as in 1000:200"):
        Rows.parse(text)


@pytest.mark.parametrize(("rows", "shown"), [(Rows(1, 201), "1:201"), (Rows(9, 8), "9:8"), (Rows(201), "201:")])
def test_rows_beyond_the_log(tmp_path, rows, shown):
    k, torque, position = columns()
    file = written(tmp_path, ("time", "x torque", "x position [mm]"), 1e-3 * k, torque, position)
    with pytest.raises(InputError, match=f"rows {shown}: must rise from 1 to 200, its last row"):
        read_log(file, MACHINE, rows=rows)


def test_heads_in_any_case_with_units_below(tmp_path):
    k, torque, position = columns()
    lines = ["Time;X Torque;X Position;State", "ms;mNm;um;"]
    lines += [f"{i};{1e3 * a:.9f};{1e3 * b:.9f};0" for i, a, b in zip(k, torque, position, strict=True)]
    file = tmp_path / "log.csv"
    file.write_text("\n".join(lines), encoding="utf-8")
    log = read_log(file, MACHINE)
    assert log.period == pytest.approx(1e-3)
    assert np.allclose(log.torque[:, 0], torque, atol=1e-9)
    assert np.allclose(log.position[:, 0], position, atol=1e-9)
    assert (log.axes, log.held) == (("x",), False)


def test_a_servo_tool_s_log_of_speed_and_share_of_the_rated_torque(tmp_path):
    """At 600 rpm a screw moves 10 leads a second; 25 % of 1.27 N·m are 0.3175 N·m."""
    lines = ["Model,SERVO-100", "Time,Motor speed,Torque", "ms,r/min,0.1%", *(f"{k},600,250" for k in range(N))]
    file = tmp_path / "log.csv"
    file.write_text("\n".join(lines), encoding="utf-8")
    log = read_log(file, MACHINE, {"x velocity": "Motor speed", "x torque": "Torque*0.1[% of 1.27 N·m]"})
    assert log.period == pytest.approx(1e-3)
    assert np.allclose(log.torque[:, 0], 0.3175)
    assert np.allclose(log.position[:, 0], 20 * math.pi * PITCH * 1e-3 * np.arange(N))
    with pytest.raises(InputError, match=r"column Torque is in '0\.1%': must say of what, as in '0\.1% of 1\.27 N·m'"):
        read_log(file, MACHINE, {"x velocity": "Motor speed", "x torque": "Torque"})


@pytest.mark.parametrize("name", ["1st motor position", "m1pos", "M1POS"])
def test_long_and_short_names(tmp_path, name):
    k, torque, position = columns()
    lines = ["Time;1st motor position;1st motor current;", "ms;ticks;A;", "t;m1pos;m1cur;"]
    lines += [f"{i};{round(1e3 * b)};{50 * a:.9f};" for i, a, b in zip(k, torque, position, strict=True)]
    file = tmp_path / "log.csv"
    file.write_text("\n".join(lines), encoding="utf-8")
    log = read_log(file, MACHINE, {"x position": name, "x torque": "m1cur*0.02 N·m"})
    assert np.allclose(log.position[:, 0], position, atol=0.5001 * MACHINE.axes[0].resolution)
    assert np.allclose(log.torque[:, 0], torque, atol=1e-9)


def test_a_log_in_pieces_is_read_as_it_was_saved(tmp_path):
    _, torque, position = columns()
    log = Log(("x",), 1e-3, position[:, None], torque[:, None], held=True, starts=(0, 90))
    log.save(tmp_path / "log.csv", {"x": "mm"})
    again = read_log(tmp_path / "log.csv", MACHINE)
    assert again.starts == (0, 90)
    assert np.allclose(again.position, log.position, rtol=1e-8)


def test_torque_of_one_axis_and_demand_of_another_do_not_go_together(tmp_path):
    k = np.arange(N)
    heads = ("time", "x torque", "x position", "y demand", "y position")
    log = written(tmp_path, heads, 1e-3 * k, *(np.sin(0.1 * k + n) for n in range(4)))
    with pytest.raises(InputError, match="has the torque of some axes and the demand of others: y has no torque"):
        read_log(log, MACHINE)


def test_a_velocity_agrees_by_the_changes_of_windows_of_both():
    """Twice the true speed has changes twice as large; one that is never along the position has no size."""
    k = np.arange(2000)
    position = np.sin(0.01 * k)
    speed = 0.01 * np.cos(0.01 * k) / 1e-3
    double = _agreement(position, 2 * speed, (0,), 1e-3)
    assert double.size == pytest.approx(2.0, rel=1e-3)
    assert double.correlation == pytest.approx(1.0, abs=1e-3)
    opposed = _agreement(position, -speed, (0,), 1e-3)
    assert (opposed.size, opposed.correlation) == (pytest.approx(-1, rel=1e-3), pytest.approx(-1, abs=1e-3))
    assert _agreement(position[:10], speed[:10], (0,), 1e-3) is None
    assert _agreement(np.zeros(2000), np.zeros(2000), (0,), 1e-3) is None
    still = _agreement(np.zeros(2000), speed, (0,), 1e-3)
    assert math.isnan(still.size)
    assert still.correlation == 0
