"""A dispenser identified from measurements that are made up without gantrysim."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom

from gantrysim import Job
from gantrysim.base.errors import InputError
from gantrysim.glue.dispenser.needle import Needle
from gantrysim.identify.checks.finding import NotIdentifiedError
from gantrysim.identify.dispenser.advice import _weighings
from gantrysim.identify.dispenser.identification import identify_dispenser
from gantrysim.identify.dispenser.measurements import needle_of, read_measurements
from gantrysim.identify.dispenser.model import FLOW
from gantrysim.identify.dispenser.output import tables_text
from gantrysim.identify.dispenser.start import starts

from support.dispensers import FLUIDS, KINDS, Fluid, bead_width, dispenser_data, tube_flow
from support.soaked import suite_runs


def identified(tmp_path, text, **options):
    file = tmp_path / "data.csv"
    file.write_text(text, encoding="utf-8")
    return identify_dispenser(read_measurements([file], **options))


CASES = [(kind, fluid, seed) for seed in range(5) for kind in KINDS for fluid in FLUIDS]


def allowed_misses(count):
    """Return how many of so many 95 % intervals miss their values by chance, but in one of a hundred sets."""
    return int(binom.ppf(0.99, count, 0.05))


@pytest.mark.soak
@pytest.mark.parametrize(("kind", "fluid", "seed"), suite_runs(CASES, 2))
def test_intervals_hold_the_truth(tmp_path, kind, fluid, seed):
    """Each set by itself misses no more of its values than exact intervals would; `test_coverage` counts them all."""
    data = dispenser_data(kind, fluid, seed)
    values = [value for value in identified(tmp_path, data.text).values if value.name in data.truth]
    known = [value for value in values if value.identified]
    missed = [value.name for value in known if not value.low <= data.truth[value.name] <= value.high]
    assert len(missed) <= allowed_misses(len(known))
    for value in known:
        assert value.value == pytest.approx(data.truth[value.name], rel=0.45)
    assert len(known) >= len(values) - 2


@pytest.mark.soak
def test_coverage(tmp_path):
    """60 sets: 95 % of the identified values are within their interval, and most are identified."""
    known = 0
    held = 0
    fitted = 0
    for kind, fluid, seed in CASES:
        data = dispenser_data(kind, fluid, seed)
        for value in identified(tmp_path, data.text).values:
            if value.name not in data.truth:
                continue
            # a term that a dispenser has not cannot be identified
            fitted += data.truth[value.name] != 0
            known += value.identified
            held += value.identified and value.low <= data.truth[value.name] <= value.high
    assert held / known >= 0.95
    assert known / fitted >= 0.85


def weighings(fluid, pressures, share=0.004, time=30.0, bore=0.41, length=12.7):
    """Rows of pressure, time and mass of a glue of 1.2 g/cm³, with a fixed noise of alternating sign."""
    lines = ["pressure [kPa],time [s],mass [mg]"]
    for k, pressure in enumerate(pressures):
        mass = 1.2 * tube_flow(fluid, bore, length, pressure) * time * (1 + share * (-1) ** k * (1 + 0.3 * (k % 3)))
        lines.append(f"{pressure},{time},{mass:.2f}")
    return "\n".join(lines) + "\n"


PRESSURES = (60.0, 100.0, 150.0, 220.0, 300.0, 400.0, 550.0, 700.0)
GLUE = {"density": 1.2, "needle": (0.41, 12.7)}


def test_the_fit_begins_at_the_flow_that_was_weighed(tmp_path):
    """6 mg/s over the density; where widths and heights show a volume, without one."""
    file = tmp_path / "data.csv"
    file.write_text("time [s],mass [mg]\n10,60\n20,120\n5,30\n", encoding="utf-8")
    for density, flow in ((1.2, 5.0), (1.5, 4.0)):
        measured = read_measurements([file], density=density)
        assert [start[FLOW] for start in starts(measured)] == [pytest.approx(flow)] * len(starts(measured))
    file.write_text("speed [mm/s],width [mm],height [mm]\n50,2,1\n50,2,1\n50,2,1\n", encoding="utf-8")
    # a section of 0.6 times width and height
    assert starts(read_measurements([file]))[0][FLOW] == pytest.approx(60.0)


def test_a_newtonian_glue_has_no_other_terms(tmp_path):
    found = identified(tmp_path, weighings(Fluid(8.0, 1.0, 0.0), PRESSURES), **GLUE)
    assert found["needle.index"].value == 1
    assert found["needle.yield_stress"].value == 0
    assert found["needle.yield_stress"].reason == "includes zero"
    assert found["needle.consistency"].identified
    assert found["needle.consistency"].value == pytest.approx(8.0, rel=0.01)
    assert found.tables["dispenser"]["needle"]["yield_stress"] == 0


def test_a_yield_stress_is_found_from_pressures_that_show_it(tmp_path):
    glue = Fluid(12.0, 0.7, 300.0)
    found = identified(tmp_path, weighings(glue, (45.0, *PRESSURES)), **GLUE)
    assert found["needle.yield_stress"].identified
    assert found["needle.yield_stress"].low <= 300 <= found["needle.yield_stress"].high
    # far above it the same glue shows none
    far = identified(tmp_path, weighings(glue, (600.0, 640.0, 680.0, 720.0, 760.0), share=0.01), **GLUE)
    assert not far["needle.yield_stress"].identified


def test_without_its_needle_a_glue_has_no_consistency_but_a_flow(tmp_path):
    """The flow at each pressure is measured; which glue it is depends on the needle."""
    glue = Fluid(30.0, 0.6, 0.0)
    found = identified(tmp_path, weighings(glue, PRESSURES), density=1.2)
    assert found["needle.consistency"].reason == "needle not given"
    assert found["needle.index"].identified
    table = found.tables["dispenser"]
    flow = float(Needle(**table["needle"]).flow(300.0))
    assert flow == pytest.approx(tube_flow(glue, 0.41, 12.7, 300.0), rel=0.01)


def test_the_tables_run_in_a_job_with_the_measured_flow(tmp_path):
    found = identified(tmp_path, weighings(Fluid(30.0, 0.6, 0.0), PRESSURES), **GLUE)
    # of a power law, at the mean wall stress p R / (2 L) of 60 kPa and 700 kPa
    stress = 1e3 * np.sqrt(60.0 * 700.0) * 0.41 / (4 * 12.7)
    assert found["viscosity"].value == pytest.approx(stress / (stress / 30.0) ** (1 / 0.6), rel=0.03)
    program = "G21 G90 G64 P0.01\nG0 Z5\nG0 X10 Y10\nG1 Z0.3 F600\nM8\nG1 X60 F600\nM9\nG0 Z5\nM2\n"
    (tmp_path / "line.ngc").write_text(program, encoding="utf-8")
    head = 'name = "line"\nmachine = "xyz"\n[program]\ncontroller = "linuxcnc.Program"\nfile = "line.ngc"\n\n'
    text = head + tables_text(found)
    tables = tomllib.loads(text)
    (tmp_path / "job.toml").write_text(text, encoding="utf-8")
    job = Job.load(tmp_path / "job.toml")
    pressure = tables["dispenser"]["pressure"]
    on = job.setpoints.dispense
    volume = float(job.dispenser.flow_demand(on, np.ones(on.size)).sum()) * job.setpoints.period
    right = tube_flow(Fluid(30.0, 0.6, 0.0), 0.41, 12.7, pressure)
    # 50 mm at 10 mm/s
    assert volume == pytest.approx(right * 5.0, rel=0.02)
    assert float(job.dispenser.flows(on, np.ones(on.size), job.setpoints.period).max()) == pytest.approx(
        right, rel=0.02
    )


def test_dots_give_the_flow_and_the_difference_of_the_valve_s_times(tmp_path):
    """Mass = density (q (t + offset)) by hand: 2 mm³/s, 4 ms more open than commanded."""
    rows = [
        f"{t},20,{20 * 1.1 * 2.0 * (1e-3 * t + 0.004) * (1 + e):.3f}"
        for t, e in zip((20, 40, 60, 100, 200), (0.004, -0.003, 0.002, -0.002, 0.001), strict=True)
    ]
    found = identified(tmp_path, "open time [ms],dots,mass [mg]\n" + "\n".join(rows), density=1.1)
    assert found["flow"].low <= 2.0 <= found["flow"].high
    assert found["open_time_offset"].low <= 0.004 <= found["open_time_offset"].high
    assert found["open_time_offset"].identified
    assert not found["opening"].identified
    assert found["opening"].reason == "not measured"
    # the values that the dots leave open are written so that they repeat the dots
    table = found.tables["dispenser"]
    offset = table["closing_dead_time"] + table["closing"] - table["dead_time"] - table["opening"]
    assert offset == pytest.approx(0.004, abs=5e-4)


def test_a_valve_whose_times_are_alike_is_known_to_have_no_offset(tmp_path):
    """Within a tenth of the shortest open time, whatever that is of an offset near zero."""
    lines = ["open time [ms],mass [mg]"]
    lines += [f"{time},{2.4e-3 * time * (1 + 0.002 * (-1) ** k):.4f}" for k, time in enumerate((50, 50, 100, 200, 400))]
    offset = identified(tmp_path, "\n".join(lines) + "\n", density=1.2)["open_time_offset"]
    assert offset.identified
    assert abs(offset.value) < 5e-3
    assert offset.high - offset.low < 0.01


def test_advice_is_a_measurement_that_narrows(tmp_path):
    """What is advised is made up and added: the interval narrows about as much as was said."""
    glue = Fluid(30.0, 0.6, 0.0)
    first = identified(tmp_path, weighings(glue, (300.0, 330.0, 360.0, 400.0, 430.0)), **GLUE)
    assert first.advice.share < 0.8
    assert any("kPa" in words for words in first.advice.words)
    pressures = [float(words.split("at ")[1].split(" kPa")[0]) for words in first.advice.words]
    more = identified(tmp_path, weighings(glue, (300.0, 330.0, 360.0, 400.0, 430.0, *pressures)), **GLUE)
    name = first.advice.name

    def width(found):
        return found[name].high - found[name].low

    assert width(more) < width(first)


def test_a_fixed_flow_is_weighed_over_one_time_and_pressed_under_a_needle(tmp_path):
    """2 mm³/s by hand, and a bead of 0.1 mm² that is a segment of 70°."""
    rows = [f"10,{10 * 1.1 * 2.0 * (1 + e):.3f},,," for e in (0.003, -0.002, 0.004, -0.004, 0.001)]
    rows += [f",,{v},1.0,{bead_width(2.0 / v, 1.0, 70.0, 0.72):.4f}" for v in (10, 20, 40)]
    text = "time [s],mass [mg],speed [mm/s],gap [mm],width [mm]\n" + "\n".join(rows)
    found = identified(tmp_path, text, density=1.1, needle=(0.41, 12.7))
    assert found["flow"].value == pytest.approx(2.0, rel=0.005)
    assert found["contact_angle"].low <= 70 <= found["contact_angle"].high
    tables = found.tables
    assert tables["dispenser"]["needle"] == {"bore": 0.41, "length": 12.7}
    assert tables["bead"]["contact_angle"] == pytest.approx(70, abs=1.0)


def test_a_pressure_at_which_nothing_flows_is_a_measurement(tmp_path):
    glue = Fluid(12.0, 0.7, 300.0)
    text = weighings(glue, (20.0, 30.0, *PRESSURES), share=0.01)
    assert ",0.00\n" in text
    found = identified(tmp_path, text, **GLUE)
    assert found["needle.yield_stress"].identified
    assert found["needle.yield_stress"].low <= 300 <= found["needle.yield_stress"].high


def test_intervals_stay_finite_where_nothing_fits_well(tmp_path):
    """Dots whose masses scatter by a third: no flow is known, and no figure overflows."""
    rows = ("9.75,202.7", "29.3,1293.8", "40.9,2353.1", "47.0,2351.1", "47.3,1870.2")
    try:
        values = identified(tmp_path, "open time [ms],mass [mg]\n" + "\n".join(rows), density=1.2).values
    except NotIdentifiedError:
        return
    assert all(np.isfinite([value.value, value.low, value.high]).all() for value in values)
    assert not any(value.identified for value in values if value.name in ("flow", "opening", "closing", "dead_time"))


def test_experiments_are_told_apart_by_their_names(tmp_path):
    """Two records in one table, the time of each from zero; a command in volts."""
    times = np.arange(0, 3, 0.02)
    lines = [
        f"{name},{t:.2f},{24 * (1 < t < 2)},{sound_mass(t):.2f}" for name in ("first", "second") for t in times.tolist()
    ]
    text = "experiment,time [s],command [V],mass [mg]\n" + "\n".join(lines)
    found = identified(tmp_path, text, density=1.1)
    assert [experiment.label for experiment in found.measured.experiments] == ["first (record)", "second (record)"]
    assert found["flow"].value == pytest.approx(40 / 1.1, rel=0.01)
    assert any("include those of the scale" in note for note in found.notes)


@pytest.mark.soak
def test_a_pump_s_slip_needs_two_needles(tmp_path):
    """With one needle and a Newtonian glue only D / (1 + g / C) shows: pressure and flow are proportional."""
    lines = ["pump speed [rpm],length [mm],time [s],mass [mg],pressure [kPa]"]
    glue = Fluid(20.0, 1.0, 0.0)
    displacement = 10.0
    leak = 2e-4

    def rows(length):
        per_pressure = tube_flow(glue, 0.61, length, 1.0)
        for k, speed in enumerate((5.0, 10.0, 20.0, 40.0, 80.0)):
            pressure = displacement * speed / 60 / (per_pressure + leak)
            mass = 1.2 * 30 * per_pressure * pressure * (1 + 0.002 * (-1) ** k)
            lines.append(f"{speed},{length},30,{mass:.2f},{pressure * (1 + 0.002 * (-1) ** (k // 2)):.2f}")

    rows(12.7)
    one = identified(tmp_path, "\n".join(lines), density=1.2, needle=(0.61, 12.7))
    assert not one["pump.leak"].identified
    # what could be weighed next is between 0.7 and 1.5 times the speeds so far
    speeds = {float(re.search(r"at ([\d.]+) rpm", words)[1]) for words, _ in _weighings(one.fit)}
    assert (min(speeds), max(speeds)) == pytest.approx((0.7 * 5, 1.5 * 80), rel=0.01)
    assert one["pump.displacement"].low <= displacement <= one["pump.displacement"].high
    rows(50.0)
    two = identified(tmp_path, "\n".join(lines), density=1.2, needle=(0.61, 12.7))
    assert two["pump.leak"].identified
    assert two["pump.leak"].low <= leak <= two["pump.leak"].high
    assert two["pump.displacement"].low <= displacement <= two["pump.displacement"].high


@pytest.mark.parametrize(
    ("text", "size"), [("0.41x12.7", (0.41, 12.7)), ("22Gx12.7", (0.413, 12.7)), ("0.41 × 12.7 mm", (0.41, 12.7))]
)
def test_a_needle_is_bore_and_length(text, size):
    assert needle_of(text) == size


# Spoiled data, and what names the defect

RIGHT = weighings(Fluid(8.0, 1.0, 0.0), PRESSURES)


def changed(change, text=RIGHT):
    """Return a table with the numbers of its rows changed."""
    head, *lines = text.splitlines()
    rows = [[float(cell) for cell in line.split(",")] for line in lines]
    return "\n".join([head, *(",".join(f"{x:.6g}" for x in change(k, row)) for k, row in enumerate(rows))]) + "\n"


def record_text(mass, command=None, times=None):
    """Return a record of a scale over 3 s, on from 1 s to 2 s."""
    times = np.arange(0, 3, 0.02) if times is None else times
    on = ((times > 1) & (times < 2)).astype(int) if command is None else command
    lines = [f"{t:.3f},{c},{m:.2f}" for t, c, m in zip(times, on, mass(times), strict=True)]
    return "time [s],command,mass [mg]\n" + "\n".join(lines) + "\n"


def sound_mass(times):
    return 50 + 40 * np.clip(times - 1, 0, 1)


BEADS = "speed [mm/s],gap [mm],width [mm]\n"
SPOILED = {
    "mass in mg read as g": (RIGHT.replace("[mg]", "[g]"), GLUE, "must be 0.05 to 5000 mm/s; check the units of mass"),
    "mass in g read as mg": (changed(lambda k, r: [r[0], r[1], 1e-3 * r[2]]), GLUE, "g read as mg, or ms read as s?"),
    "scale not tared": (
        "pressure [kPa],time [s],mass [mg]\n"
        + "".join(f"{p},{t},{250 + 0.02 * p * t:.2f}\n" for p in (100, 200, 300) for t in (10, 20, 40)),
        GLUE,
        "250 mg of the masses do not grow with the time: the scale was not tared",
    ),
    "scale drifts": (
        record_text(lambda t: sound_mass(t) + 3 * t),
        {"density": 1.1},
        "before the dispenser is on, 18 % of what",
    ),
    "mass falls": (
        record_text(lambda t: np.where(t > 1.5, 0.3, 1.0) * sound_mass(t)),
        {"density": 1.1},
        "the mass falls by",
    ),
    "time reversed": (
        record_text(sound_mass, times=np.arange(3, 0, -0.02)),
        {"density": 1.1},
        "its time runs backwards",
    ),
    "two records": (
        record_text(sound_mass, times=np.tile(np.arange(0, 3, 0.02), 2)),
        {"density": 1.1},
        "its time goes back from",
    ),
    "scale at its limit": (
        changed(lambda k, r: [r[0], r[1], min(r[2], 80.0)]),
        GLUE,
        "the mass stays at exactly 80 mg in rows 6 to 8",
    ),
    "pressure never changed": (changed(lambda k, r: [300.0, r[1], r[2]]), GLUE, "pressure never changed, 300 to 300"),
    "one speed": (
        BEADS + "20,0.3,1.1\n20,0.4,1.0\n20,0.5,0.95\n",
        {"needle": (0.41, 12.7)},
        "speed never changed, 20 to 20",
    ),
    "speed and width swapped": (
        "width [mm],gap [mm],speed [mm/s]\n10,0.4,1.4\n20,0.4,1.0\n40,0.4,0.7\n",
        {"needle": (0.41, 12.7)},
        "check that no columns are swapped",
    ),
    "time and mass swapped": (changed(lambda k, r: [r[0], r[2], r[1]]), GLUE, "columns mass and time are swapped"),
    "another order": (
        changed(lambda k, r: [PRESSURES[-1 - k], r[1], r[2]]),
        GLUE,
        "falls from 5.7 to 0.493 as pressure rises",
    ),
    "too few rows": ("\n".join(RIGHT.splitlines()[:4]), GLUE, "has 3 rows: must have at least 4"),
    "no density": (RIGHT, {"needle": (0.41, 12.7)}, "the density of the glue is missing"),
    "density in kg/m³": (RIGHT, {"density": 1200.0}, "density = 1200 g/cm³: must be 0.5 to 10 g/cm³; kg/m³ read as"),
    "pressure in Pa": (changed(lambda k, r: [1e3 * r[0], r[1], r[2]]), GLUE, "a pressure in Pa read as kPa"),
    "negative mass": (changed(lambda k, r: [r[0], r[1], r[2] - 40]), GLUE, "mass = -"),
    "repeated row": (changed(lambda k, r: [300.0, 30.0, 55.0]), GLUE, "all its 8 rows are the same"),
    "rows of two glues": (
        changed(lambda k, r: [r[0], r[1], r[2] * (1 + k % 2)]),
        GLUE,
        "of the mass unexplained, must be at most 15 %",
    ),
    "command never changed": (
        record_text(sound_mass, command=np.ones(150, int)),
        {"density": 1.1},
        "its command never changed",
    ),
    "dots of a pump": (
        "pump speed [rpm],open time [ms],mass [mg]\n10,20,1\n10,40,2\n10,80,4\n",
        {"density": 1.1},
        "of a volumetric dispenser: only a valve has an open time",
    ),
    "weighings of a jet": (
        "drops,time [s],mass [mg]\n100,,1.1\n200,,2.2\n,1,5\n,2,10\n,3,15\n,4,20\n",
        {"density": 1.1},
        "weighing: of a jet: must be drops and mass",
    ),
    "drops in another order": (
        "drops,mass [mg]\n100,4.4\n200,3.3\n300,2.2\n400,1.1\n",
        {"density": 1.1},
        "the mass [mg] falls from 4.4 to 1.1 as drops rises from 100 to 400",
    ),
    "drops weighed with their cup": (
        "drops,mass [mg]\n" + "".join(f"{n},{250 + 0.011 * n}\n" for n in (100, 200, 300, 400)),
        {"density": 1.1},
        "250 mg of the masses do not grow with the number of drops: the scale was not tared",
    ),
    "dots in another order": (
        "open time [ms],mass [mg]\n20,3\n40,2\n80,1\n",
        {"density": 1.1},
        "the mass of a dot [mg] falls from 3 to 1 as open time rises",
    ),
    "an experiment without the pressure of the other": (
        "experiment,pressure [kPa],time [s],mass [mg]\n"
        + "".join(f"a,{p},10,{p}\nb,,10,{p}\n" for p in (100, 200, 300, 400)),
        GLUE,
        "b (weighing): has no column pressure, which sets the flow elsewhere",
    ),
    "dots without the pressure of the others": (
        "experiment,pressure [kPa],open time [ms],mass [mg]\n"
        + "".join(f"a,100,{t},{t}\nb,,{t},{t}\n" for t in (10, 20, 40, 80)),
        GLUE,
        "b (dots): has no column pressure, which sets the flow elsewhere",
    ),
    "a pump that never steps": (
        "time [s],pump speed [rpm],flow [mm³/s]\n" + "".join(f"{k},10,5\n" for k in range(20)),
        {"density": 1.1},
        "its pump speed never changed: must step",
    ),
    "a record without the pump's speed": (
        "experiment,time [s],pump speed [rpm],flow [mm³/s]\n"
        + "".join(f"a,{k},{10 * (k > 5)},{5 * (k > 5)}\nb,{k},,5\n" for k in range(20)),
        {"density": 1.1},
        "b (record): has no column pump speed or command, nothing switches",
    ),
    "width in µm": (
        BEADS + "20,0.3,1100\n40,0.3,800\n60,0.3,700\n80,0.3,600\n",
        {"needle": (0.41, 12.7)},
        "times the gap: must be 0.01 to 100 times; µm read as mm?",
    ),
    "two kinds": (
        "pump speed [rpm],plunger speed [mm/s],time [s],mass [mg]\n" + "".join(f"{k},{k},5,{k}\n" for k in range(1, 6)),
        {"density": 1.1},
        "of different kinds of dispenser",
    ),
}


@pytest.mark.parametrize("name", SPOILED)
def test_spoiled_data_are_named(tmp_path, name):
    text, options, sentence = SPOILED[name]
    with pytest.raises(NotIdentifiedError) as caught:
        identified(tmp_path, text, **options)
    assert sentence in str(caught.value)


def test_the_unit_of_a_source_counts_before_that_of_the_head(tmp_path):
    file = tmp_path / "data.csv"
    file.write_text(RIGHT.replace("mass [mg]", "mass [kg]").replace("time [s]", "span"), encoding="utf-8")
    columns = {"mass": "mass [g]", "time": "span [ms]"}
    (experiment,) = read_measurements([file], columns, **GLUE).experiments
    rows = np.array([line.split(",") for line in RIGHT.splitlines()[1:]], float)
    assert experiment.columns["mass"] == pytest.approx(1e3 * rows[:, 2])
    assert experiment.columns["time"] == pytest.approx(1e-3 * rows[:, 1])
    with pytest.raises(InputError, match="column span has no unit: must be one of"):
        read_measurements([file], {"mass": "mass [g]", "time": "span"}, **GLUE)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("pressure [kPa],time [s],mass [mg]\n,,\n,,\n", "has no rows with values"),
        ("pump speed,time [s],mass [mg]\n1,2,3\n", "U/min, as in pump speed [rpm]"),
        ("pump speed [rpm],time,mass [mg]\n1,2,3\n", "min, as in time [s]"),
        (
            "speed [mm/s],width [mm],gap [mm]\n10,2,0.7\n20,1,\n",
            "bead: gap is empty in row 2: must be filled in all",
        ),
        ("time [s],command,mass [mg]\n0,0,\n1,1,\n2,0,\n", "record: has neither mass nor flow over its time"),
        ("gap [mm],width [mm]\n0.3,2\n0.3,1\n", "bead: speed is missing; it needs speed"),
        ("speed [mm/s],width [mm]\n10,2\n,1\n", "bead: speed is empty in some of its rows; it needs speed"),
    ],
)
def test_a_table_that_is_no_measurement_is_refused(tmp_path, text, message):
    with pytest.raises(InputError) as caught:
        identified(tmp_path, text, density=1.1)
    assert message in str(caught.value)


def test_sound_data_pass(tmp_path):
    """The same records and tables without their defects."""
    found = identified(tmp_path, record_text(sound_mass), density=1.1)
    assert found["flow"].value == pytest.approx(40 / 1.1, rel=0.01)
    assert identified(tmp_path, RIGHT, **GLUE)["needle.consistency"].identified


def test_the_example_of_the_docs_is_identified(tmp_path):
    page = (Path(__file__).parents[2] / "docs" / "dispensers.md").read_text(encoding="utf-8")
    text = re.search(r"```csv\n(.*?)```", page, re.DOTALL)[1]
    found = identified(tmp_path, text, density=1.35, needle=(0.41, 12.7))
    shown = " ".join(page.split())
    for name, form in (("needle.consistency", ".0f"), ("needle.index", ".2f"), ("contact_angle", ".0f")):
        value = found[name]
        assert value.identified
        numbers = [f"{number:{form}}" for number in (value.value, value.low, value.high)]
        assert re.search(r"{}\D+{}\D+{}".format(*map(re.escape, numbers)), shown)
    assert found["needle.yield_stress"].reason == "includes zero"
    assert found["open_time_offset"].value == pytest.approx(0.006, abs=5e-4)
    assert not found["dead_time"].identified
    assert any("a record of the flow" in words for words in found.advice.words)
