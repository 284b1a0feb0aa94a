"""Where the search for a dispenser's parameters begins, what pumps, plungers and jets are predicted to lay, by hand."""

import math

import numpy as np
import pytest

from gantrysim.base.errors import InputError
from gantrysim.identify.checks.finding import NotIdentifiedError
from gantrysim.identify.dispenser.checks import check_measurements
from gantrysim.identify.dispenser.identification import identify_dispenser
from gantrysim.identify.dispenser.measurements import (
    BEAD,
    DROPS,
    RECORD,
    WEIGHING,
    Experiment,
    Measurements,
    read_measurements,
)
from gantrysim.identify.dispenser.model import (
    CONSISTENCY,
    DISPLACEMENT,
    DROP,
    FLOW,
    INDEX,
    LEAK,
    PLUNGER,
    YIELD,
    Model,
    needle_with,
)
from gantrysim.identify.dispenser.start import starts

DENSITY = 1.2  # [g/cm³]
NEWTONIAN = {CONSISTENCY: 8.0, INDEX: 1.0, YIELD: 0.0}
PASTE = {CONSISTENCY: 40.0, INDEX: 0.5, YIELD: 30.0}


def measured(kind, *experiments, density=DENSITY, has_needle=True):
    return Measurements(experiments, kind, density, has_needle)


def experiment(kind, **columns):
    named = {name.replace("_", " "): np.asarray(values, float) for name, values in columns.items()}
    return Experiment(kind, "test", named, 1.0 + np.arange(len(next(iter(named.values())))))


def test_a_jet_begins_at_the_volume_of_its_drops_and_lays_them():
    drops = experiment(DROPS, drops=[100, 300, 200], mass=[240.0, 720.0, 480.0])
    jet = measured("jet", drops)
    assert [start[DROP] for start in starts(jet)] == pytest.approx([2.0] * len(starts(jet)))
    assert Model(jet).predict({DROP: 0.5}, drops)["mass"] == pytest.approx([60.0, 180.0, 120.0])


@pytest.mark.parametrize(("kind", "driver"), [("volumetric", "pump_speed"), ("piston", "plunger_speed")])
def test_a_pump_and_a_plunger_begin_at_their_volume_per_revolution_or_stroke(kind, driver):
    """Of rows that were weighed, and of a record in which they move for a part of its time."""
    speed = np.array([0.5, 2.0, 1.0])
    rows = experiment(
        WEIGHING, time=[10.0, 20.0, 40.0], mass=DENSITY * 50.0 * speed * [10.0, 20.0, 40.0], **{driver: speed}
    )
    time = np.linspace(0.0, 4.0, 401)
    moved = np.clip(time - 1.0, 0.0, 2.0)
    record = experiment(
        RECORD, time=time, mass=DENSITY * 50.0 * 0.7 * moved, **{driver: 0.7 * ((time > 1) & (time < 3))}
    )
    for experiments, tolerance in (((rows,), 1e-9), ((record,), 0.01)):
        for start in starts(measured(kind, *experiments)):
            assert start[DISPLACEMENT] == pytest.approx(50.0, rel=tolerance)
            assert math.pi / 4 * start[PLUNGER] ** 2 == pytest.approx(50.0, rel=tolerance)


@pytest.mark.parametrize("share", [0.25, 0.5, 1.0])
def test_a_record_of_a_flow_meter_begins_at_the_flow_while_it_is_on(share):
    time = np.linspace(0.0, 4.0, 401)
    on = time < share * 4.01
    record = experiment(RECORD, time=time, command=on, flow=6.0 * on)
    assert starts(measured("valve", record))[0][FLOW] == pytest.approx(6.0)


def conductance(values, bore, length):
    """Flow per pressure of a Newtonian glue, pi d^4 / (128 eta L) [mm³/s/kPa]."""
    return math.pi * bore**4 / (128 * values[CONSISTENCY] * length) * 1e3


def test_a_leaking_pump_loses_the_share_of_its_slip_through_each_needle():
    """D n C / (C + g) and D n / (C + g) of a Newtonian glue; the mass over the time weighed goes with the density."""
    bore = np.array([0.84, 0.84, 0.41, 0.41])
    length = np.array([12.0, 12.0, 25.0, 25.0])
    speed = np.array([0.5, 1.0, 0.5, 1.0])
    time = np.array([10.0, 20.0, 30.0, 40.0])
    rows = experiment(WEIGHING, time=time, mass=time, pump_speed=speed, bore=bore, length=length)
    model = Model(measured("volumetric", rows))
    values = {**NEWTONIAN, DISPLACEMENT: 50.0, LEAK: 0.05}
    through = conductance(values, bore, length)
    predicted = model.predict(values, rows)
    assert predicted["pressure"] == pytest.approx(50.0 * speed / (through + 0.05), rel=1e-9)
    assert predicted["mass"] == pytest.approx(DENSITY * time * 50.0 * speed * through / (through + 0.05), rel=1e-9)
    flow, pressure = model.steady({**values, LEAK: 0.0}, rows)
    assert flow == pytest.approx(50.0 * speed)
    assert pressure == pytest.approx(50.0 * speed / through, rel=1e-9)


def test_flow_and_slip_of_a_paste_are_what_the_pump_displaces():
    rows = experiment(
        WEIGHING, time=np.ones(3), mass=np.ones(3), pump_speed=[0.01, 0.2, 2.0], bore=[0.84] * 3, length=[12.0] * 3
    )
    values = {**PASTE, DISPLACEMENT: 20.0, LEAK: 0.02}
    flow, pressure = Model(measured("volumetric", rows)).steady(values, rows)
    assert flow + 0.02 * pressure == pytest.approx(20.0 * np.array([0.01, 0.2, 2.0]), rel=1e-9)
    assert flow == pytest.approx(needle_with(values, 0.84, 12.0).flow(pressure), rel=1e-6)


def test_a_plunger_displaces_its_face_times_its_speed():
    rows = experiment(
        WEIGHING, time=np.ones(2), mass=np.ones(2), plunger_speed=[0.1, 0.3], bore=[0.84] * 2, length=[12.0] * 2
    )
    flow, _ = Model(measured("piston", rows)).steady({**NEWTONIAN, PLUNGER: 8.0}, rows)
    assert flow == pytest.approx(math.pi / 4 * 64.0 * np.array([0.1, 0.3]))


def read(tmp_path, text, **options):
    file = tmp_path / "data.csv"
    file.write_text(text, encoding="utf-8")
    return read_measurements([file], **options)


def test_sizes_that_stand_in_some_rows_alone_are_those_of_the_row_above_or_the_first_one(tmp_path):
    text = "pressure [kPa],time [s],mass [mg],bore [mm],length [mm],density [g/cm³]\n"
    text += "100,1,10,,12,\n200,1,20,0.41,,1.3\n300,1,30,,,\n400,1,40,0.61,,\n500,1,50,,25,\n"
    found = read(tmp_path, text)
    (rows,) = found.experiments
    assert rows.columns["bore"].tolist() == [0.41, 0.41, 0.41, 0.61, 0.61]
    assert rows.columns["length"].tolist() == [12, 12, 12, 12, 25]
    assert found.density == 1.3


def test_a_column_of_numbers_names_experiments(tmp_path):
    found = read(tmp_path, "experiment,time [s],mass [mg]\n1,10,5\n1,20,10\n2,10,6\n", density=1.0)
    assert [(x.label, len(x)) for x in found.experiments] == [
        ("experiment 1 (weighing)", 2),
        ("experiment 2 (weighing)", 1),
    ]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            "time [s],mass [mg],density [g/cm³]\n1,2,1.1\n2,4,1.3\n",
            "density = 1.1 and 1.3 g/cm³: must be one value",
        ),
        ("speed [mm/s],gap [mm],width [mm]\n10,0.5,1\n20,0.5,\n", "row 2 has speed, gap, which is no measurement"),
    ],
)
def test_a_table_that_contradicts_itself_is_refused(tmp_path, text, sentence):
    with pytest.raises(InputError) as caught:
        read(tmp_path, text)
    assert sentence in str(caught.value)


FOUR = np.array([1.0, 2.0, 3.0, 4.0])
NEEDLE = {"bore": np.full(4, 0.61), "length": np.full(4, 12.7)}
STEADY = np.arange(100.0)


@pytest.mark.parametrize(
    ("kind", "experiments", "sentence"),
    [
        (
            "volumetric",
            [experiment(WEIGHING, pump_speed=FOUR, time=FOUR, mass=10 * FOUR**2, pressure=900 - 100 * FOUR, **NEEDLE)],
            "the pressure [kPa] falls from 800 to 500 as pump speed rises",
        ),
        (
            "valve",
            [
                experiment(WEIGHING, pressure=100 * FOUR, time=FOUR, mass=10 * FOUR**2, **NEEDLE),
                experiment(BEAD, speed=10 * FOUR, width=2 / FOUR, **NEEDLE),
            ],
            "has no column pressure, which sets the flow elsewhere",
        ),
        ("valve", [experiment(BEAD, speed=10 * FOUR, width=2 / FOUR)], "the needle is missing, whose face presses"),
        ("valve", [experiment(BEAD, speed=10 * FOUR, height=2 * FOUR, **NEEDLE)], "the height grows with the speed"),
        (
            "valve",
            [experiment(RECORD, time=STEADY, flow=STEADY)],
            "has no column command, which shows when the valve switches",
        ),
        (
            "valve",
            [experiment(RECORD, time=STEADY, command=STEADY > 10, mass=np.clip(STEADY - 10, 0, 40) * 3.0)],
            "the mass stays at exactly 120 mg from row 51 while the dispenser is on: the scale is at its limit",
        ),
    ],
)
def test_spoiled_measurements_of_other_kinds_are_named(kind, experiments, sentence):
    with pytest.raises(NotIdentifiedError) as caught:
        check_measurements(measured(kind, *experiments))
    assert sentence in str(caught.value)


def test_a_jet_is_identified_by_its_drops_and_its_advice_is_more_of_them(tmp_path):
    text = "drops,mass [mg]\n" + "".join(f"{n},{0.6 * n + (-1) ** k:.3f}\n" for k, n in enumerate((100, 200, 300, 400)))
    found = identify_dispenser(read(tmp_path, text, density=1.2))
    value = found[DROP]
    assert value.low <= 0.5 <= value.high
    assert found.tables == {"dispenser": {"kind": "jet", "jet": {"drop": value.value}}}
    assert found.notes == []
    if found.advice is not None:
        assert all("drops" in words for words in found.advice.words)
