"""What measurements of a dispenser are proposed next: settings, times and sizes by hand."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from gantrysim.glue.dispenser.dispenser import JET
from gantrysim.identify.dispenser.advice import _dots, _ratios, _records, _scales, _settings, _weighings
from gantrysim.identify.dispenser.measurements import DOTS, RECORD, WEIGHING, Experiment
from gantrysim.identify.dispenser.model import parameters_of


def experiment(kind, **columns):
    arrays = {name: np.array(values, float) for name, values in columns.items()}
    return Experiment(kind, "so far", arrays, np.ones(len(next(iter(arrays.values())))))


def fit_of(kind, driver, *experiments, values=()):
    measured = SimpleNamespace(
        kind=kind,
        driver=driver,
        experiments=experiments,
        of_kind=lambda wanted: [one for one in experiments if one.kind == wanted],
    )
    return SimpleNamespace(measured=measured, values=dict.fromkeys(values, 1.0))


NEEDLE = {"bore": [0.41, 0.41], "length": [12.0, 12.0]}
PRESSED = experiment(WEIGHING, pressure=[100.0, 400.0], time=[10.0, 10.0], mass=[5.0, 50.0], **NEEDLE)


def test_half_intervals_are_two_deviations_over_their_bounds():
    """Of two variables with the inverse information [[0.25, 0.1], [0.1, 0.09]]."""
    information = np.linalg.inv(np.array([[0.25, 0.1], [0.1, 0.09]]))
    assert _ratios(information, np.array([0.5, 3.0])) == pytest.approx([2 * 0.5 / 0.5, 2 * 0.3 / 3.0])


def test_a_bound_is_a_share_of_a_value_or_of_its_scale_where_that_is_absent():
    parameters = [
        SimpleNamespace(name="consistency", is_log=True, spread=2.0, value=math.exp),
        SimpleNamespace(name="yield", is_log=False, spread=100.0, value=lambda x: 100.0 * x),
        SimpleNamespace(name="dead_time", is_log=False, spread=100.0, value=lambda x: 100.0 * x),
    ]
    fit = SimpleNamespace(parameters=parameters, x=np.array([0.3, -0.5, 1e-6]))
    bounds = {"consistency": 0.1, "yield": 0.2, "dead_time": 0.3}
    assert _scales(fit, bounds) == pytest.approx([0.1 / 2, 0.2 * 50 / 100, 0.3 * 0.02])


def test_a_jet_whose_dots_are_equal_is_not_weighed_over_a_time():
    assert _weighings(fit_of(JET, "pressure", PRESSED)) == []


def test_settings_go_from_below_the_lowest_to_beyond_the_highest():
    fit = fit_of("valve", "pressure", PRESSED, experiment(WEIGHING, pressure=[0.0], time=[1.0], mass=[0.0]))
    assert _settings(fit) == pytest.approx([70, 100, 200, 400, 600])


def test_a_mass_is_weighed_at_each_setting_through_the_needle_of_the_first_measurement():
    weighings = _weighings(fit_of("valve", "pressure", PRESSED))
    times = {float(one.columns["time"][0]) for _, one in weighings}
    (time,) = times
    assert [words for words, _ in weighings] == [f"a mass at {p} kPa over {time:g} s" for p in (70, 100, 200, 400, 600)]
    for (_, one), pressure in zip(weighings, (70, 100, 200, 400, 600), strict=True):
        row = {name: float(values[0]) for name, values in one.columns.items()}
        assert one.kind == WEIGHING
        assert row == {"pressure": pytest.approx(pressure), "time": time, "bore": 0.41, "length": 12.0}


def test_a_pump_that_leaks_is_weighed_through_a_shorter_needle_too_with_its_pressure():
    pumped = experiment(WEIGHING, **{"pump speed": [1.0, 1.0]}, time=[1.0, 1.0], mass=[1.0, 1.0], **NEEDLE)
    weighings = _weighings(fit_of("volumetric", "pump speed", pumped, values=("pump.leak",)))
    (time,) = {float(one.columns["time"][0]) for _, one in weighings}
    # turns per second, said per minute
    assert [words for words, _ in weighings][2:4] == [
        f"a mass at 60 rpm over {time:g} s, with its pressure",
        f"a mass at 60 rpm through a needle of half the length over {time:g} s, with its pressure",
    ]
    lengths = [float(one.columns["length"][0]) for _, one in weighings]
    assert lengths == [12.0, 6.0] * (len(weighings) // 2)
    assert {float(one.columns["pressure"][0]) for _, one in weighings} == {1.0}


def test_dots_have_half_and_twice_the_open_times_so_far():
    dotted = experiment(DOTS, **{"open time": [0.02, 0.05]}, dots=[10.0, 10.0], mass=[1.0, 2.0], **NEEDLE)
    dots = _dots(fit_of("valve", "pressure", PRESSED, dotted))
    assert [words for words, _ in dots] == [f"dots of {ms:g} ms open time" for ms in (10, 20, 50, 100)]
    assert [float(one.columns["open time"][0]) for _, one in dots] == pytest.approx([0.01, 0.02, 0.05, 0.1])
    # at the highest setting so far
    assert {(float(one.columns["pressure"][0]), float(one.columns["dots"][0])) for _, one in dots} == {(400.0, 20.0)}


def test_a_record_is_switched_on_and_off_where_a_time_is_sought():
    assert _records(fit_of("valve", "pressure", PRESSED)) == []
    ((_, record),) = _records(fit_of("valve", "pressure", PRESSED, values=("dead_time",)))
    assert record.kind == RECORD
    time = record.columns["time"]
    on = record.columns["command"]
    assert (time[0], time[-1], np.diff(time)) == (0.0, 2.0, pytest.approx(0.01, rel=0.01))
    switches = time[1:][np.diff(on) != 0]
    assert switches == pytest.approx([0.5, 1.2], abs=0.011)
    assert (on[0], on[-1]) == (0.0, 0.0)
    assert set(record.columns["pressure"].tolist()) == {400.0}


def parameters(kind, driver, *experiments):
    """By name: usual value, spread, whether the logarithm is searched, and the bounds."""
    found = parameters_of(fit_of(kind, driver, *experiments).measured)
    return {one.name: (one.usual, one.spread, one.is_log, one.low, one.high) for one in found}


TIME = (0.0, 1.0, False, 0.0, 100.0)


def test_the_parameters_of_a_fit_begin_at_usual_values_within_what_the_measurements_admit():
    """The stress at the wall of a needle is p R / (2 L): 400 kPa through 0.41 mm of 12 mm are 3,417 Pa."""
    stress = 400e3 * 0.41 / (4 * 12)
    pressed = parameters("valve", "pressure", PRESSED)
    rheology = {
        "needle.consistency": (10.0, 2.5, True, 1e-5, 1e7),
        "needle.index": (1.0, 0.7, True, 0.1, 2.5),
        "needle.yield_stress": (0.0, pytest.approx(stress), False, 0.0, pytest.approx(0.999 * stress)),
    }
    assert pressed == rheology
    dotted = parameters("valve", "pressure", PRESSED, experiment(DOTS, mass=[1.0]))
    assert dotted == {**rheology, **dict.fromkeys(("dead_time", "closing_dead_time", "opening", "closing"), TIME)}
    # without a pressure that sets the flow, the flow itself
    assert parameters("valve", "", experiment(WEIGHING, time=[1.0], mass=[1.0])) == {
        "flow": (1.0, 2.5, True, 1e-9, 1e9)
    }


def test_the_parameters_of_a_pump_and_a_plunger_have_their_compliance_only_from_a_record():
    """All that a pump displaces at its largest speed, at its largest pressure, is the scale of its slip."""
    record = experiment(RECORD, time=[0.0, 0.02, 0.04], **{"pump speed": [0.0, 3.0, 0.0]}, pressure=[0.0, 200.0, 0.0])
    pump = parameters("volumetric", "pump speed", record)
    assert pump["pump.displacement"] == (50.0, 2.5, True, 1e-9, 1e9)
    assert pump["pump.leak"] == (0.0, pytest.approx(50.0 * 3 / 200), False, 0.0, 1e9)
    assert pump["pump.compliance"] == (0.005, 2.5, True, 1e-9, 1e9)
    # anywhere between two rows
    half = pytest.approx(0.01)
    for name in ("record.rising", "record.falling"):
        usual, spread, is_log, low, high = pump[name]
        assert (usual, spread, is_log, -low, high) == (0.0, pytest.approx(0.01 / math.sqrt(3)), False, half, half)
    plunger = experiment(WEIGHING, **{"plunger speed": [1.0]}, time=[1.0], mass=[1.0], pressure=[1.0])
    piston = parameters("piston", "plunger speed", plunger)
    assert piston["piston.plunger"] == (16.0, 2.5, True, 1e-9, 1e9)
    assert "piston.compliance" not in piston
    jet = parameters("jet", "", experiment("drops", drops=[10.0], mass=[1.0]))
    assert jet == {"jet.drop": (0.02, 2.5, True, 1e-6, 1e9)}
    bead = experiment("bead", speed=[10.0], gap=[1.0], width=[2.0])
    assert parameters("jet", "", bead)["contact_angle"] == (60.0, 60.0, False, 1.0, 90.0)
