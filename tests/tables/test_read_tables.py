"""Logs as other programs write them, and what is refused in them."""

import csv
import re

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gantrysim import InputError
from gantrysim.compare.measured import Assignment, Trace
from gantrysim.controllers.softmc.basic.recording import Record
from gantrysim.tables.column_table import Source
from gantrysim.tables.reading import read_table
from gantrysim.tables.units import is_unit

from support.jobs import job_run


@pytest.fixture(scope="module")
def run():
    return job_run("fanuc-spiral")


@pytest.fixture
def log(tmp_path):
    def write(text, blocks=0):
        file = tmp_path / "log.csv"
        file.write_text(text, encoding="utf-8")
        return read_table(file, blocks)

    return write


NINE = [0.0, 1.5, -2e-3, 3.0, 4.0, 5.0, 6.0, 7.0, 8.25]


@pytest.mark.parametrize("separator", [",", ";", "\t", "  "])
def test_columns_are_separated_by_any_usual_sign(log, separator):
    rows = [separator.join(map(str, (k, value))) for k, value in enumerate(NINE)]
    found = log("\n".join(["# made by hand", separator.join(("t", "pos")), *rows, ""]))
    assert found.columns["pos"].tolist() == NINE
    assert found.columns["t"].tolist() == list(range(9))


def test_a_decimal_comma_is_read_between_semicolons(log):
    assert log("t;x\n0,5;-1,25\n1,0;2\n").columns["x"].tolist() == [-1.25, 2]


def test_a_comma_is_decimal_only_where_no_number_has_a_point(log):
    whole_and_half = log("t;x\n" + "".join(f"{k};{'1,5' if k % 2 else '2'}\n" for k in range(9)))
    assert whole_and_half.columns["x"].tolist() == [1.5 if k % 2 else 2.0 for k in range(9)]
    # 1,5 is then no number, as two axes in one cell
    with_points = log("t;axes\n" + "".join(f"0.{k};1,5\n" for k in range(9)))
    assert with_points.columns["t"].tolist() == [float(f"0.{k}") for k in range(9)]
    assert with_points.texts["axes"] == ["1,5"] * 9


ROWS = "".join(f"{k},{k}.5,-{k}\n" for k in range(9))


@pytest.mark.parametrize(
    ("heads", "names", "units", "aliases"),
    [
        ("Time,Motor speed,Torque\nms,r/min,%", ("Time", "Motor speed", "Torque"), ("ms", "r/min", "%"), {}),
        ("Time,Position,Torque\n[ms],[kpulse],[0.1%]", ("Time", "Position", "Torque"), ("ms", "kpulse", "0.1%"), {}),
        ("Time,Droop pulses,Torque\nms,pls.,0.1%", ("Time", "Droop pulses", "Torque"), ("ms", "pls.", "0.1%"), {}),
        ("Model,MR-X\nTime,a,b\ns,m/s²,", ("Time", "a", "b"), ("s", "m/s²", ""), {}),
        ("long time,long a,long b\ns,mm,A\nt,a,b", ("long time", "long a", "long b"), ("s", "mm", "A"),
         {"t": "long time", "a": "long a", "b": "long b"}),
        ("Device,of,axis 1\nt,a,b\ns,mm,A", ("t", "a", "b"), ("s", "mm", "A"), {}),
        # names alone, which are symbols of units too
        ("s,m,V", ("s", "m", "V"), ("", "", ""), {}),
    ],
)  # fmt: skip
def test_heads_of_several_lines(log, heads, names, units, aliases):
    found = log(f"{heads}\n{ROWS}")
    assert found.order == names
    assert tuple(found.units.get(name, "") for name in names) == units
    assert dict(found.aliases) == aliases
    assert found.columns[names[1]].tolist() == [k + 0.5 for k in range(9)]
    for short, name in aliases.items():
        assert np.array_equal(found.values(Source(short, unit="s"), "s"), found.columns[name])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("mm", True), ("[µm/s²]", True), ("0.1%", True), ("r/min", True), ("min-1", True), ("N·m", True),
        ("(Nm/A)", True), ("kpulse", True), ("‰ of 1.27 N·m", True), ("", True), ("-", True), ("10 V", True),
        ("Torque", False), ("x", False), ("m1pos", False), ("position mm", False), ("mm/x", False),
        ("9" * 100_000 + "/", False),
    ],
)  # fmt: skip
def test_a_unit_is_told_from_a_name(text, expected):
    assert is_unit(text) == expected


def test_words_in_round_brackets_are_part_of_the_name(log):
    found = log(f"Time (s),Position (set),Position (actual)\n{ROWS}")
    assert found.order == ("Time", "Position (set)", "Position (actual)")
    assert found.units == {"Time": "s"}
    assert found.values(Source("Position (actual)", unit="mm"), "mm").tolist() == [-k for k in range(9)]


def test_numbers_between_thousands_are_named_as_no_numbers(log):
    rows = "".join(f'{k},"{1000 * k:,.1f}"\n' for k in range(9))
    with pytest.raises(InputError, match=r"column x has '1,000\.0', which is not a number"):
        log(f"t,x [um]\n{rows}").values(Source("x"), "mm")


def test_a_point_between_thousands_is_no_decimal_point(log):
    """The first thousand comes late, when the comma is known as the decimal sign; it was read as 1.5 once."""
    rows = "".join(f"0,{k};{k}\n" for k in range(300))
    with pytest.raises(InputError, match=r"x .*'1\.500' is not a finite number"):
        log(f"t;x [um]\n{rows}0,3;1.500\n")


def test_clock_times_may_have_a_decimal_comma(log):
    rows = "".join(f"10:59:59,{k}00;{k},5\n" for k in range(9))
    found = log(f"time;x [mm]\n{rows}")
    assert found.values(Source("time"), "s") == pytest.approx([0.1 * k for k in range(9)])


def test_text_of_two_bytes_a_character_is_read_by_its_mark(tmp_path):
    file = tmp_path / "log.txt"
    file.write_text("time [s]\tx [µm]\n0\t1000\n1\t2000\n", encoding="utf-16")
    assert read_table(file).values(Source("x"), "mm").tolist() == [1.0, 2.0]


@pytest.mark.parametrize(
    ("unit", "words"),
    [
        ("0.1%", "in '0.1%': must say of what, as in '0.1% of 1.27 N·m'"),
        ("A", "a current has a torque by its constant, COLUMN*0.0302 N·m"),
    ],
)
def test_what_a_torque_lacks_is_named(log, unit, words):
    found = log(f"t,T\ns,{unit}\n0,10\n1,20\n")
    with pytest.raises(InputError, match=re.escape(words)):
        found.values(Source("T"), "N·m")
    assert found.values(Source("T", unit="0.1% of 1.27 N·m"), "N·m") == pytest.approx([0.0127, 0.0254])


def test_labview_leaves_out_the_comment_at_the_end_of_a_row(log):
    heads = "LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\t\n\nChannels\t2\t\n***End_of_Header***\t\t\n"
    rows = "".join(f"{0.001 * k:.3f}\t{k}.5\t-{k}\n" for k in range(1, 9))
    found = log(f"{heads}X_Value\tForce\tWay\tComment\n0.000\t0.5\t0\tbegun\n{rows}")
    assert found.order == ("X_Value", "Force", "Way", "Comment")
    assert found.columns["Way"].tolist() == [-k for k in range(9)]


def test_units_in_names_and_factors_are_applied(log):
    found = log("time [ms],x [um],angle (rad),y_mm,raw\n1,2000,3.141592653589793,4,5\n")
    assert found.values(Source("time"), "s").tolist() == [1e-3]
    assert found.values(Source("x"), "mm").tolist() == [2.0]
    assert found.values(Source("angle"), "deg") == pytest.approx([180])
    assert found.values(Source("y_mm"), "mm").tolist() == [4.0]
    assert found.values(Source("raw", -0.5, "in"), "mm") == pytest.approx([-63.5])
    assert found.values(Source("5"), "mm").tolist() == [5.0]
    with pytest.raises(InputError, match="column angle is in 'rad': must be in mm"):
        found.values(Source("angle"), "mm")
    with pytest.raises(InputError, match=r": unknown column .*did you mean raw"):
        found.values(Source("rav"), "mm")


@pytest.mark.parametrize(
    ("unit_of", "each"),
    [
        ("s", {"s": 1, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}),
        ("mm", {"m": 1e3, "mm": 1, "um": 1e-3, "µm": 1e-3, "nm": 1e-6, "in": 25.4}),
        ("deg", {"deg": 1, "mdeg": 1e-3, "rad": 180 / np.pi}),
    ],
)
def test_every_unit_is_its_si_prefix_times_its_base(log, unit_of, each):
    for unit, factor in each.items():
        assert log(f"t,x [{unit}]\n0,2.5\n").values(Source("x"), unit_of) == pytest.approx([2.5 * factor], rel=1e-15)


def test_halsampler_s_output_has_numbered_columns_and_may_lose_samples(log, run):
    rows = [f"{k} {value:f} {2 * value:f} " for k, value in enumerate(NINE)]
    found = log("\n".join(rows) + "\n")
    given = Assignment.parse("time=1[samples],encoder.x=2,encoder.y=3")
    with pytest.raises(InputError, match="in 'samples'"):
        Trace.of(found, given, run)
    trace = Trace.of(found, Assignment(given.columns, 2e-3), run)
    assert trace.time == pytest.approx(2e-3 * np.arange(9))
    assert trace.axes["encoder"][:, 1] == pytest.approx(2 * np.array(NINE), abs=1e-6)
    lost = log("\n".join([*rows[:4], "overrun", "20 1 2 ", *(f"{k} 1 2" for k in range(21, 25))]))
    assert Trace.of(lost, Assignment(given.columns, 2e-3), run).time[4] == pytest.approx(0.04)
    untimed = Assignment({"encoder.x": Source("2")}, 2e-3)
    with pytest.raises(InputError, match="samples were lost"):
        Trace.of(lost, untimed, run)


def test_halscope_s_file_gives_names_and_period(log, run):
    lines = [f"joint.0.pos {value:+.14f} joint.1.pos {-value:+.14f} " for value in NINE]
    found = log("Sampling period is 500000 ns \n\n" + "\n".join([*lines, "joint.0.pos +9.0 "]))
    assert found.period == pytest.approx(5e-4)
    trace = Trace.of(found, Assignment.parse("encoder.x=joint.0.pos,encoder.y=joint.1.pos*2"), run)
    assert trace.axes["encoder"][:, 1] == pytest.approx(-2 * np.array(NINE))
    assert trace.time[-1] == pytest.approx(8 * 5e-4)
    with pytest.raises(InputError, match="different numbers of samples: joint"):
        log("Sampling period is 500000 ns \n\n" + "\n".join([*lines, *["joint.0.pos +9.0 "] * 2]))


@pytest.mark.parametrize("statement", [True, False])
def test_a_table_dump_holds_block_after_block(log, run, statement):
    values = [*NINE, *reversed(NINE)]
    text = (
        "".join(f"TABLE({k},{value!r})\n" for k, value in enumerate(values))
        if statement
        else "\n".join(f"{value:.4f}" for value in values)
    )
    found = log(text, blocks=2)
    given = Assignment.parse("commanded.x=1,commanded.y=2")
    trace = Trace.of(found, Assignment(given.columns, 1e-3), run)
    assert trace.axes["commanded"].tolist() == np.column_stack([NINE, NINE[::-1]]).tolist()
    with pytest.raises(InputError, match="18 values, which are not 4 blocks"):
        log(text, blocks=4)


def test_softmc_s_record_and_the_package_s_own_tables_need_no_assignment(run, tmp_path):
    from gantrysim.exchange.tables import export

    Record(10**6, 2, ("PCMD", "PFB")).write(run, tmp_path / "record.csv")
    export(run, tmp_path / "run.csv", "csv")
    record, table = (Trace.of(read_table(tmp_path / name), Assignment({}), run) for name in ("record.csv", "run.csv"))
    assert record.links == ("commanded", "encoder")
    assert np.array_equal(record.axes["encoder"], run.encoder[::2])
    assert table.links == ("commanded", "encoder", "nozzle")
    assert np.array_equal(table.nozzle, run.nozzle)
    assert np.array_equal(table.time, run.time)


def test_an_assignment_is_read_from_toml(tmp_path, log, run):
    file = tmp_path / "columns.toml"
    file.write_text('period = 0.002\n[columns]\nx = "1*0.001"\ny = "2[um]"\n')
    trace = Trace.of(log("\n".join(f"{value} {value}" for value in NINE)), Assignment.parse(str(file)), run)
    assert trace.nozzle[:, 0] == pytest.approx(trace.nozzle[:, 1])
    assert np.isnan(trace.nozzle[:, 2]).all()
    assert "nozzle in z is not measured" in trace.notes[0]
    assert trace.time[1] == 0.002


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("period = 0.002\n", "must have a table [columns], and may have period and blocks"),
        ("columns = 3\n", "must have a table [columns], and may have period and blocks"),
        ("rate = 500\n[columns]\nx = 1\n", "must have a table [columns], and may have period and blocks"),
        ("blocks = 1.5\n[columns]\nx = 1\n", "blocks = 1.5: must be a whole number"),
        ("period = 0\n[columns]\nx = 1\n", "period = 0 s: must be greater than 0"),
    ],
)
def test_an_assignment_in_toml_that_is_none_is_refused(tmp_path, text, message):
    file = tmp_path / "columns.toml"
    file.write_text(text)
    with pytest.raises(InputError) as refused:
        Assignment.parse(str(file))
    assert message in str(refused.value)


@pytest.mark.parametrize(
    ("text", "columns", "message"),
    [
        ("t,x,y\n" + "0,1\n", "x=x", "line 2 has 2 columns, must have 3"),
        ("t,x,y\n" + "1,1,1\n" * 9 + "2,inf,1\n", "x=x,y=y", "line 11: x = 'inf' is not a finite number"),
        ("t,x,y\n" + "1,1,1\n" * 9 + "2,-inf,1\n", "x=x,y=y", "line 11: x = '-inf' is not a finite number"),
        ("t,x,y\n" + "1,1,1\n" * 9 + "2,1_0,1\n", "x=x,y=y", "line 11: x = '1_0' is not a finite number"),
        ("t,x,y\n" + "1,on,1\n" * 9, "time=t,x=x,y=y", "column x has 'on', which is not a number"),
        ("", "x=x", "is empty"),
        ("t,x\n", "x=x", "has no rows"),
        ("# only\n# remarks\n", "x=x", "is empty"),
        ("t,x\0\n1,1\n", "x=x", "is neither text nor a Parquet, MATLAB or MCAP file"),
        ("t,x,y\n" + "noon,1,1\n" * 9, "time=t,x=x,y=y", "has 'noon': must be numbers, dates or hh:mm:ss"),
        ("x [mm],x [um]\n1,2\n", "x=x,y=2", "two columns are named x: name it by its number"),
        ("t,x,y\n" + "1,1,1\n" * 9, "time=t,x=x,y=y", "time goes from 1 s to 1 s: must rise"),
        ("t,x,y\n" + "1,1,1\n" * 3, "time=t,x=x,y=y", "has 3 samples, must have at least 8"),
        ("t,x,y\n" + "1,1,1\n" * 9, "x=x,y=y", "has no time"),
        ("t,x,y\n" + "1,1,1\n" * 9, "time=t,x=x", "must be in x and y"),
        ("t,x,y\n" + "1,1,1\n" * 9, "time=t,encoders.x=x", "did you mean encoder.x"),
        ("t,x,y\n" + "1,1,1\n" * 9, "time=t", "no position is measured"),
    ],
)
def test_a_log_that_cannot_be_used_is_refused_in_one_line(log, run, text, columns, message):
    with pytest.raises(InputError) as refused:
        Trace.of(log(text), Assignment.parse(columns), run)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


@given(
    text=st.one_of(
        st.text(max_size=80),
        st.lists(st.sampled_from(["1", "-2.5e3", "x", ";", ",", " ", "\n", "overrun\n", "nan", "#", '"', "_"])).map(
            "".join
        ),
    ),
    blocks=st.integers(0, 3),
)
def test_any_text_is_read_or_refused_in_one_line(tmp_path_factory, text, blocks):
    file = tmp_path_factory.getbasetemp() / "any.csv"
    file.write_bytes(text.encode("utf-8", "surrogatepass"))
    try:
        found = read_table(file, blocks)
    except InputError as error:
        refused = str(error)
    else:
        refused = ""
    assert "\n" not in refused
    if refused:
        return
    lengths = {len(column) for column in (*found.columns.values(), *found.texts.values())}
    assert len(lengths) == 1
    assert min(lengths) > 0
    assert not any(np.isinf(column).any() for column in found.columns.values())


@given(
    rows=st.lists(
        st.tuples(
            st.floats(-1e6, 1e6),
            st.floats(-1e-3, 1e-3),
            st.integers(-9, 9),
            st.sampled_from(("on", "off", "door; open", "A, B")),
        ),
        min_size=2,
        max_size=12,
    ),
    separator=st.sampled_from((";", "\t", ",", "|")),
    decimal_comma=st.booleans(),
    mark=st.booleans(),
    preamble=st.sampled_from(((), ("# any remark",), ("Model,TBS2000", "Points;1000", "# more"), ("made by hand",))),
    quoting=st.sampled_from((csv.QUOTE_MINIMAL, csv.QUOTE_ALL)),
)
@example(  # blanks and tabs divide as many lines into numbers
    rows=[(0.0, 0.0, 0, "on")] * 2,
    separator="\t",
    decimal_comma=False,
    mark=False,
    preamble=("Model,TBS2000", "Points;1000", "# more"),
    quoting=csv.QUOTE_MINIMAL,
)
def test_a_table_that_the_csv_module_writes_in_any_dialect_is_read_as_it_was(
    tmp_path_factory, rows, separator, decimal_comma, mark, preamble, quoting
):
    def cell(value):
        text = repr(value) if isinstance(value, float | int) else value
        return text.replace(".", ",") if decimal_comma and isinstance(value, float) else text

    file = tmp_path_factory.getbasetemp() / "dialect.csv"
    with file.open("w", encoding="utf-8-sig" if mark else "utf-8", newline="") as stream:
        stream.writelines(f"{line}\n" for line in preamble)
        writer = csv.writer(stream, delimiter=separator, quoting=quoting)
        writer.writerow(("time [s]", "x pos [mm]", "n", "door"))
        writer.writerows([cell(value) for value in row] for row in rows)
    found = read_table(file)
    assert found.order == ("time", "x pos", "n", "door")
    assert found.units == {"time": "s", "x pos": "mm"}
    assert found.columns["time"].tolist() == [row[0] for row in rows]
    assert found.columns["x pos"].tolist() == [row[1] for row in rows]
    assert found.columns["n"].tolist() == [row[2] for row in rows]
    assert found.texts["door"] == [row[3] for row in rows]


@pytest.mark.parametrize("kind", ["csv", "parquet", "mat", "mcap"])
def test_what_export_writes_comes_back(run, tmp_path, kind):
    from gantrysim.exchange.tables import export

    file = tmp_path / "no_suffix_tells"
    export(run, file, kind)
    table = read_table(file)
    trace = Trace.of(table, Assignment({}), run)
    assert np.array_equal(trace.time, run.time)
    assert np.array_equal(trace.axes["encoder"], run.encoder)
    assert np.array_equal(trace.nozzle, run.nozzle)
    torque = table.values(Source(f"demand_{run.axes[0]}_Nm"), "N·m")
    assert np.array_equal(torque, run.demand[:, 0], equal_nan=True)


def test_instants_in_parquet_are_seconds_from_the_first(tmp_path):
    pandas = pytest.importorskip("pandas")
    instants = np.datetime64("2026-05-01T12:00:00") + np.arange(9) * np.timedelta64(250, "us")
    file = tmp_path / "log.parquet"
    pandas.DataFrame({"stamp": instants, "x_um": np.arange(9.0)}).to_parquet(file)
    table = read_table(file)
    assert table.values(Source("stamp"), "s") == pytest.approx(0.25e-3 * np.arange(9), abs=1e-12)
    assert table.values(Source("x_um"), "mm") == pytest.approx(1e-3 * np.arange(9), abs=1e-12)


@pytest.mark.parametrize(
    ("text", "source"),
    [
        ("I*0.0302 N·m", Source("I", 0.0302, "N·m")),
        ("I * -0.0302[N·m]", Source("I", -0.0302, "N·m")),
        ("Iq/1000*5", Source("Iq/1000", 5.0)),
        ("pos/8192 rev", Source("pos", 1 / 8192, "rev")),
        ("MPOS AXIS(0) [mm]", Source("MPOS AXIS(0)", 1.0, "mm")),
        ("MPOS AXIS(0)", Source("MPOS AXIS(0)")),
        ("torque ‰", Source("torque ‰")),
        ("x", Source("x")),
    ],
)
def test_a_source_is_a_column_with_factor_and_unit(text, source):
    assert Source.parse("x torque", text) == source


@pytest.mark.parametrize("text", ["", "*3", "a*0", "a/0", "[mm]"])
def test_a_source_without_column_or_factor_is_refused(text):
    with pytest.raises(InputError, match="must be"):
        Source.parse("x", text)


def test_gaps_are_cut_out_and_said(log, run):
    rows = [f"{k};{k};;{k}" if k in (3, 4) else f"{k};{k};{2 * k};{k}" for k in range(12)]
    table = log("t [ms];x;y;status\n" + "\n".join(rows))
    trace = Trace.of(table, Assignment.parse("time=t,x=x,y=y"), run)
    assert trace.time.tolist() == [1e-3 * k for k in range(12) if k not in (3, 4)]
    assert "2 of 12 rows have gaps and are left out" in trace.notes


def test_units_may_stand_below_the_heads_and_times_may_be_clock_times(log):
    table = log("Time,X\n[s],[um]\n" + "\n".join(f"2026-05-01 12:00:{k:02d}.500,{k}" for k in range(9)))
    assert table.values(Source("Time"), "s").tolist() == list(range(9))
    assert table.values(Source("x"), "mm") == pytest.approx(1e-3 * np.arange(9), rel=1e-15)
    # a column may be named as a unit is, and of two lines of names the last has those of the columns
    speed = log("t,V,x\ns,mm/s,mm\n" + "".join(f"{k},{k},{k}\n" for k in range(9)))
    assert (speed.order, speed.unit_of("x")) == (("t", "V", "x"), "mm")
    length = log("Monday,early,shift\nt,s,x\n" + "".join(f"{k},{k},{k}\n" for k in range(9)))
    assert length.order == ("t", "s", "x")
    clock = log("t;x\n" + "\n".join(f"0:59:{k:02d}.25;{k}" for k in range(50, 60)))
    assert clock.values(Source("t"), "s").tolist() == list(range(10))


def test_heads_in_a_remark_are_taken_where_they_fit(log):
    from_numpy = log("# t x y\n0 1 2\n1 2 3\n")
    assert from_numpy.order == ("t", "x", "y")
    assert log("# made by hand, twice\n0 1 2\n1 2 3\n").order == ("1", "2", "3")


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_a_row_whose_last_cells_are_all_empty_has_them(log, separator):
    """Once "has 1 columns, must have 3"."""
    table = log("t,x,y\n0.1,1,2\n0.2,,\n0.3,3,4\n".replace(",", separator))
    np.testing.assert_equal(table.columns["x"], [1, np.nan, 3])
    np.testing.assert_equal(table.columns["y"], [2, np.nan, 4])
    with pytest.raises(InputError, match="line 3 has 1 columns, must have 3"):
        log("t,x,y\n0.1,1,2\n0.2\n0.3,3,4\n".replace(",", separator))


def test_a_record_of_a_run_names_the_command_that_writes_it_as_a_table(run, tmp_path):
    run.save(tmp_path / "run.npz")
    with pytest.raises(InputError, match=r"is the record of a run: gantrysim export .*run\.npz writes it as a table"):
        read_table(tmp_path / "run.npz")


@pytest.mark.parametrize("share", ["0.1%", "0,1%", "0,1 %"])
def test_a_share_of_the_rated_torque_has_either_decimal_sign(log, share):
    found = log("t;T\n0;10\n1;20\n")
    assert found.values(Source("T", unit=f"{share} of 1.27 N·m"), "N·m") == pytest.approx([0.0127, 0.0254])
    assert not is_unit("0x1%")


def test_a_column_with_another_decimal_sign_is_named(log):
    found = log("time\ttorque\tx\n0.001\t1,5\t0.10\n0.002\t2,5\t0.20\n0.003\t3,5\t0.30\n")
    with pytest.raises(InputError, match="column torque has '1,5': must have the decimal sign of the other columns"):
        found.values(Source("torque"), "N·m")


@pytest.mark.parametrize("day", ["", "2024-05-01 "])
def test_a_clock_has_fractions_after_a_comma(log, day):
    found = log(f"t;x\n{day}10:00:00,100;1\n{day}10:00:00,350;2\n")
    assert found.values(Source("t"), "s") == pytest.approx([0.0, 0.25])


def test_columns_of_one_name_are_numbered_from_the_second_on(log):
    assert log("x,t,x,x,t\n1,2,3,4,5\n2,3,4,5,6\n").order == ("x", "t", "x (2)", "x (3)", "t (2)")
