"""What a dispenser's parameters predict of measurements, by hand; and which of them are believed."""

import numpy as np
import pytest

from gantrysim.glue.dispenser.needle import Needle
from gantrysim.identify.checks.finding import NotIdentifiedError
from gantrysim.identify.dispenser.checks import check_measurements
from gantrysim.identify.dispenser.measurements import DOTS, RECORD, WEIGHING, Experiment, Measurements
from gantrysim.identify.dispenser.model import (
    CLOSING,
    CLOSING_DEAD_TIME,
    CONSISTENCY,
    DEAD_TIME,
    DISPLACEMENT,
    FALLING,
    FLOW,
    INDEX,
    LEAK,
    OPENING,
    PUMP_COMPLIANCE,
    RISING,
    YIELD,
    Model,
)

DENSITY = 1.2  # [g/cm³]
STEP = 0.01  # between the rows of a record [s]
TIME = np.arange(301) * STEP
VALVE = {FLOW: 5.0, DEAD_TIME: 0.02, CLOSING_DEAD_TIME: 0.1, OPENING: 0.0, CLOSING: 0.0}


def measured(kind, *experiments, density=DENSITY):
    return Measurements(experiments, kind, density, has_needle=True)


def experiment(kind, **columns):
    named = {name.replace("_", " "): np.asarray(values, float) for name, values in columns.items()}
    return Experiment(kind, "test", named, 1.0 + np.arange(len(next(iter(named.values())))))


@pytest.mark.parametrize(("rising", "falling"), [(0.0, 0.0), (0.003, -0.002)])
def test_a_valve_opens_and_closes_after_a_dead_time_of_its_own(rising, falling):
    """It is switched in the middle between two rows, or as much earlier or later as was fitted."""
    on = (TIME > 0.5) & (TIME < 1.0)
    record = experiment(RECORD, time=TIME, command=on, mass=np.zeros(TIME.size))
    values = VALVE | {RISING: rising, FALLING: falling}
    mass = Model(measured("valve", record)).predict(values, record)["mass"]
    opens = TIME[on][0] - 0.5 * STEP + 0.02 + rising
    closes = TIME[on][-1] + 0.5 * STEP + 0.1 + falling
    np.testing.assert_allclose(mass, DENSITY * 5.0 * np.clip(TIME - opens, 0.0, closes - opens), atol=1e-9)


def test_a_dot_flows_from_one_dead_time_to_the_other():
    dots = experiment(DOTS, open_time=[0.01, 0.1], mass=[1.0, 1.0])
    mass = Model(measured("valve", dots)).predict(VALVE, dots)["mass"]
    assert mass == pytest.approx(DENSITY * 5.0 * (np.array([0.01, 0.1]) + 0.1 - 0.02), rel=1e-6)


def test_a_pump_that_turns_lays_what_its_slip_leaves():
    """Of a Newtonian glue D n C / (C + g), with the needle's conductance C."""
    sizes = {"bore": np.full(TIME.size, 0.84), "length": np.full(TIME.size, 12.0)}
    record = experiment(RECORD, time=TIME, pump_speed=np.full(TIME.size, 0.5), mass=np.zeros(TIME.size), **sizes)
    values = {CONSISTENCY: 8.0, INDEX: 1.0, YIELD: 0.0, DISPLACEMENT: 50.0, LEAK: 0.05, PUMP_COMPLIANCE: 1e-3}
    flow = Model(measured("volumetric", record)).predict(values, record)["flow"]
    conductance = Needle(bore=0.84, length=12.0, consistency=8.0, index=1.0).conductance
    assert flow[-50:] == pytest.approx(25.0 * conductance / (conductance + 0.05), rel=1e-3)


@pytest.mark.parametrize("rising", [0.0, 0.004])
def test_a_pump_on_a_rigid_line_lays_what_it_displaces_from_the_middle_between_two_rows(rising):
    on = (TIME > 0.5) & (TIME < 1.0)
    sizes = {"bore": np.full(TIME.size, 0.84), "length": np.full(TIME.size, 12.0)}
    record = experiment(RECORD, time=TIME, pump_speed=0.5 * on, mass=np.zeros(TIME.size), **sizes)
    values = {CONSISTENCY: 8.0, INDEX: 1.0, YIELD: 0.0, DISPLACEMENT: 50.0, LEAK: 0.0, PUMP_COMPLIANCE: 1e-5}
    mass = Model(measured("volumetric", record)).predict(values | {RISING: rising}, record)["mass"]
    starts = TIME[on][0] - 0.5 * STEP + rising
    stops = TIME[on][-1] + 0.5 * STEP + rising
    # less than what flows in a tenth of a row's time
    np.testing.assert_allclose(mass, DENSITY * 25.0 * np.clip(TIME - starts, 0.0, stops - starts), atol=0.03)


def test_a_mass_is_a_speed_in_the_needle_by_its_density():
    """4 m/s of solder paste weigh as much as 16 m/s of a glue of 1 g/cm³, which no needle has."""
    pressure = np.array([100.0, 200.0, 300.0, 400.0])
    speed = 1e3 * np.array([2.0, 3.0, 4.5, 6.0])  # [mm/s]
    sizes = {"bore": np.full(4, 0.41), "length": np.full(4, 12.7)}
    mass = 4.0 * speed * 0.25 * np.pi * 0.41**2
    rows = experiment(WEIGHING, pressure=pressure, time=np.ones(4), mass=mass, **sizes)
    check_measurements(measured("valve", rows, density=4.0))
    with pytest.raises(NotIdentifiedError, match=r"mm/s in the needle: must be 0\.05 to 5000 mm/s"):
        check_measurements(measured("valve", rows, density=1.0))
