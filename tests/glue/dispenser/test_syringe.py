"""The air of a syringe: ISO 6358 against integrals and closed forms, and what it does to the flow as glue is used."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from gantrysim import InputError, Job, Needle
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.glue.dispenser.syringe import ATMOSPHERE, Syringe, exchanged_pressure

from support.soaked import suite_runs

PERIOD = 1e-3
EXACT = 1e-9  # relative, of the air's pressure against closed forms
AIR = 1e-6  # the same against integrals
VOLUME = 2e-4  # relative, of a pulse's volume against an integration of air's mass in small steps
NEEDLE = Needle(bore=1.2, length=25.0, consistency=50.0, index=0.6)
PRESSURE = 400.0  # [kPa]
BEFORE, ON, AFTER = 5, 60, 400  # ticks of a pulse

ratios, pressures = st.floats(0.0, 0.6), st.floats(50.0, 900.0)


def psi(r, b):
    return 1.0 if r <= b else math.sqrt(max(1 - ((r - b) / (1 - b)) ** 2, 0.0))


def pulse(syringe, needle=NEEDLE, pressure=PRESSURE, on=ON, **dispenser):
    """Flow of each period for one pulse."""
    command = np.repeat([False, True, False], [BEFORE, on, AFTER])
    made = Dispenser(pressure=pressure, metering="time-pressure", needle=needle, syringe=syringe, **dispenser)
    return made.flows(command, np.zeros(command.size), PERIOD)


@pytest.mark.validates(
    "pressure of a syringe's air through a valve",
    "integral of the law of ISO 6358",
    "1e-6 relative",
)
@settings(deadline=None)
@given(pressures, pressures, ratios, st.floats(0.0, 1.0))
def test_air_flows_by_iso_6358(pressure, supply, ratio, share):
    """The time to a pressure, by the integral of dp / p' up to 0.999 of the supply."""
    assume(abs(pressure / supply - 1) > 1e-3)

    def per_pressure(p):
        return 1 / (supply * psi(p / supply, ratio) if supply > p else -p * psi(supply / p, ratio))

    goal = pressure + share * (0.999 * supply + 0.001 * pressure - pressure)
    choked = ratio * supply if supply > pressure else supply / ratio if ratio > 0 else math.inf
    points = [choked] if min(pressure, goal) < choked < max(pressure, goal) else None
    time = quad(per_pressure, pressure, goal, points=points, epsabs=1e-12, epsrel=1e-11, limit=200)[0]
    found = exchanged_pressure(pressure, supply, 0.03 * time, 0.03, ratio)
    assert found == pytest.approx(goal, rel=AIR)


@settings(deadline=None)
@given(pressures, pressures, ratios, st.floats(0.0, 3.0), st.floats(0.0, 1.0))
def test_two_times_in_a_row_are_one(pressure, supply, ratio, time, share):
    halfway = exchanged_pressure(pressure, supply, share * time, 1.0, ratio)
    both = exchanged_pressure(halfway, supply, (1 - share) * time, 1.0, ratio)
    assert both == pytest.approx(exchanged_pressure(pressure, supply, time, 1.0, ratio), rel=AIR)
    assert min(pressure, supply) * (1 - EXACT) <= both <= max(pressure, supply) * (1 + EXACT)


def test_choked_air_rises_linearly_and_falls_exponentially_and_settles_in_a_finite_time():
    assert exchanged_pressure(100.0, 1000.0, 0.2, 2.0, 0.5) == pytest.approx(200.0, rel=EXACT)
    assert exchanged_pressure(1000.0, 100.0, 1.0, 2.0, 0.5) == pytest.approx(1000.0 * math.exp(-0.5), rel=EXACT)
    # from the critical ratio b on, r = b + (1 - b) sin(t / ((1 - b) T))
    assert exchanged_pressure(500.0, 1000.0, 0.4, 2.0, 0.5) == pytest.approx(
        1000 * (0.5 + 0.5 * math.sin(0.4)), rel=EXACT
    )
    assert exchanged_pressure(500.0, 1000.0, 0.5 * math.pi, 2.0, 0.5) == 1000.0
    assert exchanged_pressure(500.0, 500.0, 1.0, 2.0, 0.5) == 500.0


def test_the_default_conductance_is_that_of_its_hose():
    """Fanno flow through 2.5 mm by 1 m with a Darcy friction factor of 0.03, from rest to the speed of sound."""
    k, gas, temperature, density = 1.4, 287.05, 293.15, 1.185
    lost = 0.03 * 1.0 / 2.5e-3

    def friction(mach):
        inner = (k + 1) * mach**2 / (2 + (k - 1) * mach**2)
        return (1 - mach**2) / (k * mach**2) + (k + 1) / (2 * k) * math.log(inner)

    low, high = 1e-3, 1.0
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if friction(middle) > lost else (low, middle)
    temperature_ratio = 1 + 0.5 * (k - 1) * low**2
    speed = math.sqrt(k / (gas * temperature)) * low * temperature_ratio ** (-(k + 1) / (2 * (k - 1)))
    conductance = 0.25 * math.pi * 2.5e-3**2 * speed / density * 1e3 * 1e5  # [dm³/(s bar)]
    critical = temperature_ratio ** (-k / (k - 1)) * low * math.sqrt(2 * temperature_ratio / (k + 1))
    assert Syringe().conductance == pytest.approx(conductance, rel=0.03)
    assert Syringe().critical_ratio == pytest.approx(critical, abs=0.01)
    assert Syringe().dead_volume == pytest.approx(
        0.25 * math.pi * 0.25**2 * 100 + 1, rel=0.02
    )  # and 1 ml above the glue


@pytest.mark.validates(
    "glue of a pulse from a syringe",
    "integration of the air's mass in steps of 2 µs",
    "2e-4 relative",
)
@pytest.mark.parametrize("lags", [{}, {"opening": 0.01, "closing": 0.02}], ids=["none", "lags"])
@pytest.mark.parametrize(
    "syringe", suite_runs([Syringe(), Syringe(fill=0.1), Syringe(volume=1.0, dead_volume=0.2, conductance=0.05)], 1, 2)
)
@pytest.mark.parametrize("stress", suite_runs([0.0, 150.0], 1))
def test_a_pulse_lays_what_the_mass_of_the_air_says(syringe, lags, stress):
    """Against small steps of the air's mass m = p V and of the glue's volume."""
    needle = replace(NEEDLE, yield_stress=stress)
    laid = np.cumsum(pulse(syringe, needle, **lags)) * PERIOD
    fine = 500
    dt, expected = PERIOD / fine, []
    valve, pressure, used = 0.0, ATMOSPHERE, 0.0
    # the needle's law as a table, for speed
    table = np.linspace(0.0, PRESSURE, 20001)
    law = needle.flow(table).tolist()
    for tick in range(ON + 60):
        request = PRESSURE if tick < ON else 0.0
        constant = lags.get("opening" if tick < ON else "closing", 0.0)
        decay = math.exp(-dt / constant) if constant else 0.0
        for _ in range(fine):
            supply = valve + ATMOSPHERE if constant else request + ATMOSPHERE
            upper, lower = max(supply, pressure), min(supply, pressure)
            inflow = math.copysign(
                syringe.rate * upper * psi(lower / upper, syringe.critical_ratio) * dt, supply - pressure
            )
            place = min((pressure - ATMOSPHERE) / PRESSURE * 20000, 19999.0)
            k = int(place)
            flow = law[k] + (place - k) * (law[k + 1] - law[k])
            air = syringe.air + used
            used += flow * dt
            nearer = (pressure * air + inflow) / (syringe.air + used)
            pressure = supply if (nearer - supply) * (pressure - supply) < 0 else nearer
            valve = request + (valve - request) * decay
        expected.append(used)
    for tick in (ON // 3, ON - 1, ON + 20, ON + 59):
        assert laid[BEFORE + tick] == pytest.approx(expected[tick], rel=VOLUME, abs=2e-4 * expected[-1])


def test_at_constant_volume_the_pressure_has_a_closed_form():
    """A needle that hardly lets glue through, Newtonian: the flow is the pressure times its conductance."""
    needle, syringe = Needle(0.1, 25.0, 1.0, 1.0), Syringe(fill=0.5)
    flow = pulse(syringe, needle, on=100)
    constant = syringe.air / syringe.rate  # V / (C p0)
    b = syringe.critical_ratio
    supply = PRESSURE + ATMOSPHERE
    assert constant == pytest.approx((6.0 + 5.0) / 0.35 * 1e-3, rel=1e-12)
    start = math.asin((ATMOSPHERE / supply - b) / (1 - b))
    for tick in (3, 20, 99):
        time = (tick + np.array([0.0, 0.5, 1.0])) * PERIOD
        angle = np.minimum(start + time / constant / (1 - b), 0.5 * np.pi)
        mean = np.array([1, 4, 1]) @ (supply * (b + (1 - b) * np.sin(angle)) - ATMOSPHERE) / 6
        assert flow[BEFORE + tick] == pytest.approx(needle.flow(mean), rel=1e-4)


@settings(deadline=None)
@given(st.floats(0.05, 0.95), st.floats(0.01, 0.05), st.integers(5, 60))
def test_a_pulse_lays_less_the_emptier_the_syringe(fill, less, on):
    fuller, emptier = (pulse(Syringe(fill=share), on=on)[: BEFORE + on].sum() for share in (fill, fill - 0.8 * less))
    assert emptier < fuller
    assert fuller < pulse(None, on=on)[: BEFORE + on].sum()


@settings(deadline=None)
@given(st.floats(0.1, 10.0), st.floats(0.3, 3.0))
def test_only_the_volume_per_conductance_counts(scale, conductance):
    """As long as little glue flows."""
    thin, one = Needle("30G"), Syringe(dead_volume=20.0, conductance=conductance)
    other = replace(one, dead_volume=20.0 * scale, conductance=conductance * scale)
    assert other.air / other.rate == pytest.approx(one.air / one.rate)
    expected = pulse(one, thin, on=30)
    assert pulse(other, thin, on=30) == pytest.approx(expected, rel=1e-3, abs=1e-3 * expected.max())


def test_without_resistance_the_pressure_is_that_of_the_valve():
    lags = {"opening": 0.01, "closing": 0.02}
    wide = Syringe(conductance=1e4)
    assert pulse(wide, **lags).sum() == pytest.approx(pulse(None, **lags).sum(), rel=1e-3)
    assert pulse(wide, **lags) == pytest.approx(pulse(None, **lags), abs=2e-3 * pulse(None).max())


def test_pulses_lay_less_and_less_and_the_flow_ends_with_the_glue():
    syringe = Syringe(volume=0.3, dead_volume=0.05, conductance=0.02)
    on = np.tile(np.repeat([True, False], [20, 180]), 120)
    dispenser = Dispenser(pressure=PRESSURE, metering="time-pressure", needle=NEEDLE, syringe=syringe)
    flow = dispenser.flows(on, np.zeros(on.size), PERIOD)
    each = flow.reshape(120, 200).sum(axis=1) * PERIOD
    assert flow.sum() * PERIOD == pytest.approx(300.0, rel=1e-12)  # glue out is fill lost
    assert flow.min() >= 0
    last = int(np.flatnonzero(each)[-1])
    assert 10 < last < 118
    assert (np.diff(each[:last]) < 0).all()
    assert not each[last + 1 :].any()
    # the rise within a pulse is the later the more air there is
    assert each[last - 1] < 0.9 * each[0]
    end = (np.flatnonzero(flow)[-1] + 1) * PERIOD
    assert dispenser.notes(on, np.zeros(on.size), PERIOD) == (f"the syringe of 300 mm³ runs empty at t = {end:.4g} s",)
    assert dispenser.notes(on[: 200 * last], np.zeros(200 * last), PERIOD) == ()
    assert replace(dispenser, syringe=None).notes(on, np.zeros(on.size), PERIOD) == ()


def test_a_job_with_too_little_glue_says_so():
    changes = ["metering=time-pressure", "flow=200", "syringe.volume=3", "syringe.fill=0.5", "needle.bore=15G"]
    job = Job.load("an225", changes)
    assert [note for note in job.notes if "runs empty" in note]
    run = job.follow()
    assert run.flow.sum() * run.period == pytest.approx(1500.0)
    assert run.flow_demand[-600] == pytest.approx(200.0)
    assert not [note for note in job.changed({"dispenser.syringe.volume": 10.0}).notes if "syringe" in note]


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"fill": 0.0}, "fill of the syringe = 0: must be greater than 0"),
        ({"fill": 1.01}, "fill of the syringe = 1.01: must be at most 1"),
        ({"volume": -3.0}, "volume of the syringe = -3 ml: must be greater than 0 ml"),
        ({"dead_volume": 0.0}, "dead_volume of the syringe = 0 ml: must be greater than 0 ml"),
        ({"conductance": 1e7}, r"conductance of the syringe = 1e\+07 dm³/\(s·bar\): must be at most 1e\+06"),
        ({"critical_ratio": 1.0}, "critical_ratio of the syringe = 1: must be below 1"),
    ],
)
def test_an_impossible_syringe_is_refused(values, text):
    with pytest.raises(InputError, match=text):
        Syringe(**values)


def test_a_pump_has_no_syringe_of_air():
    with pytest.raises(InputError, match="metering volumetric: takes no syringe; a syringe needs time-pressure"):
        Dispenser(flow=1.0, syringe=Syringe())


def test_extreme_syringes_cause_no_error():
    for syringe in (Syringe(dead_volume=1e-9, conductance=1e6), Syringe(conductance=1e-9), Syringe(critical_ratio=0.0)):
        flow = pulse(syringe, opening=1e-9, closing=1e-9)
        assert np.isfinite(flow).all()
        assert flow.min() >= 0


def test_the_glue_ends_at_the_end_of_the_tick_that_takes_its_last():
    """The valve's pressure at once, so that V / Q = 123.4 ticks."""
    flow = float(NEEDLE.flow(PRESSURE))
    syringe = Syringe(volume=123.4 * PERIOD * flow / 1e3, dead_volume=0.05, conductance=1e4)
    dispenser = Dispenser(pressure=PRESSURE, metering="time-pressure", needle=NEEDLE, syringe=syringe)
    (note,) = dispenser.notes(np.ones(300, bool), np.zeros(300), PERIOD)
    assert note.endswith("mm³ runs empty at t = 0.124 s")
