"""Logs as other programs write them, and what is refused in them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import InputError
from gantrysim.compare.measured import Trace
from gantrysim.compare.traces import Assignment, Source, read_log
from gantrysim.controllers.softmc.record import Record

from support.jobs import job_run


@pytest.fixture(scope="module")
def run():
    return job_run("fanuc-spiral")


@pytest.fixture
def log(tmp_path):
    def write(text, blocks=0):
        file = tmp_path / "log.csv"
        file.write_text(text, encoding="utf-8")
        return read_log(file, blocks)

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


def test_units_in_names_and_factors_are_applied(log):
    found = log("time [ms],x [um],angle (rad),y_mm,raw\n1,2000,3.141592653589793,4,5\n")
    assert found.values(Source("time"), "s", None).tolist() == [1e-3]
    assert found.values(Source("x"), "mm", None).tolist() == [2.0]
    assert found.values(Source("angle"), "deg", None) == pytest.approx([180])
    assert found.values(Source("y_mm"), "mm", None).tolist() == [4.0]
    assert found.values(Source("raw", -0.5, "in"), "mm", None) == pytest.approx([-63.5])
    assert found.values(Source("5"), "mm", None).tolist() == [5.0]
    with pytest.raises(InputError, match="column angle is in 'rad': must be in mm"):
        found.values(Source("angle"), "mm", None)
    with pytest.raises(InputError, match=r"unknown column of .*did you mean raw"):
        found.values(Source("rav"), "mm", None)


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
        assert log(f"t,x [{unit}]\n0,2.5\n").values(Source("x"), unit_of, None) == pytest.approx(
            [2.5 * factor], rel=1e-15
        )


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
    record, table = (Trace.of(read_log(tmp_path / name), Assignment({}), run) for name in ("record.csv", "run.csv"))
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
    ("text", "columns", "message"),
    [
        ("t,x,y\n" + "0,1\n", "x=x", "line 2 has 2 columns, must have 3"),
        ("t,x\n0,nan\n", "x=x", "line 2: x = 'nan' is no finite number"),
        ("t,x\n0,1_0\n", "x=x", "is no finite number"),
        ("", "x=x", "is empty"),
        ("t,x\n", "x=x", "has no rows"),
        ("x [mm],x [um]\n1,2\n", "x=x", "two columns have one name"),
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
        found = read_log(file, blocks)
    except InputError as error:
        refused = str(error)
    else:
        refused = ""
    assert "\n" not in refused
    if refused:
        return
    lengths = {len(column) for column in found.columns.values()}
    assert len(lengths) == 1
    assert min(lengths) > 0
    assert all(np.isfinite(column).all() for column in found.columns.values())
