"""Flow out of the dispenser: lags, leads and needles against closed forms, and conservation of volume."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.special import digamma

from gantrysim import InputError
from gantrysim.glue.dispenser.command import cuts
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.glue.dispenser.needle import Needle
from gantrysim.record.setpoints import Setpoints

from support.runs import ramp

PERIOD = 1e-3
FLOW = 200.0  # [mm³/s]
SPEED = 100.0  # [mm/s]
EXACT = 1e-12  # relative, of closed forms
QUADRATURE = 1e-6  # relative, of the power law's integrals
NEEDLE = Needle(bore=0.84, length=25.0, consistency=50.0, index=0.6)

durations = st.floats(0.0, 0.02)


def command(before=20, on=400, after=400):
    return np.repeat([False, True, False], [before, on, after])


def flows(dispenser, on, speed=SPEED):
    return dispenser.flows(on, np.broadcast_to(speed, on.shape), PERIOD)


def test_there_is_no_flow_by_default_or_without_a_command():
    assert not flows(Dispenser(), command()).any()
    assert not flows(Dispenser(flow=FLOW, opening=0.1), np.zeros(10, bool)).any()
    np.testing.assert_array_equal(flows(Dispenser(flow=FLOW), command()), FLOW * command())


@pytest.mark.validates(
    "flow after dead time and lag",
    "closed form",
    "1e-12 relative",
)
@pytest.mark.parametrize("dead_time", [0.0, 0.005, 0.0123456])
def test_a_step_has_a_first_order_response_with_one_time_constant_per_direction(dead_time):
    """Volume: the integral of Q (1 - exp(-t / T)) from the opening, of Q exp(-t / T) from the closing."""
    opening, closing, on = 0.02, 0.05, command(after=1000)
    cumulated = np.concatenate(
        [[0.0], np.cumsum(flows(Dispenser(FLOW, dead_time=dead_time, opening=opening, closing=closing), on)) * PERIOD]
    )
    time = np.arange(on.size + 1) * PERIOD
    t = np.clip(time - 0.02 - dead_time, 0.0, 0.4)
    rising = FLOW * (t - opening * (1 - np.exp(-t / opening)))
    t = np.maximum(time - 0.42 - dead_time, 0.0)
    falling = FLOW * (1 - np.exp(-0.4 / opening)) * closing * (1 - np.exp(-t / closing))
    np.testing.assert_allclose(cumulated, rising + falling, rtol=EXACT, atol=EXACT * FLOW)


@settings(deadline=None)
@given(
    st.fixed_dictionaries(
        dict.fromkeys(("dead_time", "opening", "closing", "start_lead", "stop_lead"), durations),
        optional={"closing_dead_time": durations},
    )
)
def test_start_and_stop_errors_follow_from_lags_and_leads(times):
    """Late by v (dead_time + opening - start_lead), long by v (closing_dead_time + closing - stop_lead)."""
    on = command(on=800, after=800)
    dispenser = Dispenser(FLOW, **times)
    laid = flows(dispenser, on) * PERIOD
    middle = 420
    late = (FLOW * PERIOD * on[:middle].sum() - laid[:middle].sum()) / (FLOW / SPEED)
    assert late == pytest.approx(SPEED * (times["dead_time"] + times["opening"] - times["start_lead"]), abs=1e-6)
    surplus = (laid[middle:].sum() - FLOW * PERIOD * on[middle:].sum()) / (FLOW / SPEED)
    closing_dead_time = times.get("closing_dead_time", times["dead_time"])
    assert surplus == pytest.approx(SPEED * (closing_dead_time + times["closing"] - times["stop_lead"]), abs=1e-6)


@settings(deadline=None)
@given(st.floats(0.0, 0.05), durations, durations, st.floats(1e-4, 8e-3), st.integers(0, 2**32 - 1))
def test_equal_time_constants_conserve_volume(dead_time, constant, lead, period, seed):
    on = np.random.default_rng(seed).random(60) < 0.7
    on = np.concatenate([np.zeros(int(lead / period) + 1, bool), np.repeat(on, 5)])
    on = np.concatenate([on, np.zeros(int((dead_time + 40 * constant) / period) + 2, bool)])
    speed = np.random.default_rng(seed + 1).uniform(0.0, SPEED, on.size)
    dispenser = Dispenser(
        area=2.0, dead_time=dead_time, opening=constant, closing=constant, start_lead=lead, stop_lead=lead
    )
    laid = dispenser.flows(on, speed, period)
    # the lead shifts the valve's times alone, not the speed that it passes
    fine = 200
    time = (np.arange(on.size * fine) + 0.5) / fine
    ahead = np.minimum(time + lead / period, on.size - 0.5).astype(int)
    through = np.where(on[ahead], 2.0 * speed[time.astype(int)], 0.0).mean() * on.size
    assert laid.min() >= 0
    assert laid.sum() == pytest.approx(through, rel=2e-2, abs=2.0 * SPEED / fine * (np.abs(np.diff(on * 1)).sum() + 2))
    if lead == 0:
        assert laid.sum() == pytest.approx(2.0 * speed[on].sum(), rel=1e-9)


def test_a_lead_moves_the_valve_to_any_time_between_ticks():
    on = command()
    laid = flows(Dispenser(FLOW, start_lead=0.0033, stop_lead=0.0005), on)
    assert laid[15:18] == pytest.approx([0.0, 0.3 * FLOW, FLOW])
    assert laid[418:421] == pytest.approx([FLOW, 0.5 * FLOW, 0.0])
    late = flows(Dispenser(FLOW, start_lead=0.0033, stop_lead=0.0005, dead_time=0.0033), on)
    assert late[19:21] == pytest.approx([0.0, FLOW])
    assert late[421:424] == pytest.approx([FLOW, 0.8 * FLOW, 0.0])


def test_leads_can_join_two_stretches_or_leave_nothing_of_a_short_one():
    on = np.repeat([False, True, False, True, False], [20, 30, 5, 30, 20])
    joined = flows(Dispenser(FLOW, start_lead=0.01), on)
    np.testing.assert_allclose(joined, FLOW * np.repeat([False, True, False], [10, 75, 20]))
    short = np.repeat([False, True, False, True, False], [20, 5, 30, 30, 20])
    left = flows(Dispenser(FLOW, stop_lead=0.01), short)
    np.testing.assert_allclose(left, FLOW * np.repeat([False, True, False], [55, 20, 30]))


def test_a_flow_proportional_to_speed_gives_a_constant_section():
    speed = np.linspace(0.0, 150.0, 820)
    laid = flows(Dispenser(area=2.5, dead_time=0.004), command(), speed)
    np.testing.assert_allclose(laid[4:], (2.5 * speed * command())[:-4], rtol=EXACT, atol=EXACT)
    np.testing.assert_array_equal(Dispenser(area=2.5).flow_demand(command(), speed), 2.5 * speed * command())


def test_an_advance_of_the_time_constant_takes_the_lag_off_a_ramp():
    """A first-order lag follows a ramp late by its time constant, once the transient has decayed."""
    speed, constant, ramp_ = np.arange(820) * 0.1, 0.02, slice(400, 820)
    on = np.ones(820, bool)
    lagging = flows(Dispenser(area=2.0, opening=constant, closing=constant), on, speed)
    demand = 2.0 * speed
    assert demand[ramp_] - lagging[ramp_] == pytest.approx(np.full(420, 2.0 * 100.0 * constant), rel=1e-6)
    advanced = flows(Dispenser(area=2.0, opening=constant, closing=constant, advance=constant), on, speed)
    np.testing.assert_allclose(advanced[ramp_], demand[ramp_], rtol=1e-9)
    half = flows(Dispenser(area=2.0, opening=constant, closing=constant, advance=0.5 * constant), on, speed)
    assert demand[ramp_] - half[ramp_] == pytest.approx(np.full(420, 100.0 * constant), rel=1e-6)


def test_an_advance_recovers_the_volume_of_an_opening_but_not_of_a_closing():
    constant, on = 0.02, command(after=1000)
    laid = flows(Dispenser(FLOW, opening=constant, closing=constant, advance=constant), on) * PERIOD
    assert laid[:420].sum() == pytest.approx(FLOW * 0.4, rel=1e-9)
    assert laid[420:].sum() == pytest.approx(FLOW * constant, rel=1e-6)
    assert laid.min() >= 0
    at_once = Dispenser(FLOW, opening=constant, closing=constant, advance=constant)
    assert flows(at_once, np.ones(400, bool)).sum() == pytest.approx(FLOW * 400, rel=1e-9)


def test_the_limit_clips_the_request_and_loses_the_clipped_volume():
    constant, on, peak = 0.02, command(after=0), 3 * FLOW
    free = Dispenser(FLOW, opening=constant, closing=constant, advance=constant)
    held = Dispenser(FLOW, opening=constant, closing=constant, advance=constant, limit=peak)
    # without a lag the flow is the command itself
    instant = {"advance": constant}
    assert flows(Dispenser(FLOW, **instant), on).max() == pytest.approx(FLOW * (1 + constant / PERIOD))
    assert flows(Dispenser(FLOW, **instant, limit=peak), on).max() == pytest.approx(peak)
    missing = (flows(free, on) - flows(held, on)).sum() * PERIOD
    assert missing == pytest.approx((FLOW * (1 + constant / PERIOD) - peak) * PERIOD, rel=1e-3)
    with pytest.raises(InputError, match=r"limit = 150 mm³/s: must be at least the request, 200 mm³/s"):
        Dispenser(FLOW, limit=150.0)
    fast = flows(Dispenser(area=2.0, limit=150.0), on)
    assert fast.max() == 150.0
    with pytest.raises(InputError, match=r"limit = 300 kPa: must be at least the request, 400 kPa"):
        Dispenser(pressure=400.0, metering="time-pressure", needle=NEEDLE, limit=300.0)


def test_a_newtonian_glue_flows_by_hagen_and_poiseuille():
    """Q = pi R^4 dp / (8 mu L), in SI: 300 kPa through 0.4 mm by 20 mm at 2 Pa·s."""
    flow = Needle(0.4, 20.0, 2.0, 1.0).flow(300.0)
    assert flow == pytest.approx(math.pi * 0.2e-3**4 * 300e3 / (8 * 2.0 * 20e-3) * 1e9, rel=EXACT)


def test_the_flow_of_a_power_law_glue_is_the_integral_of_its_velocity_profile():
    """tau(r) = dp r / 2 L, shear rate (tau / K)^(1/n), velocity by one quadrature, flow by another."""
    r = np.linspace(0.0, 0.42e-3, 4001)
    rate = (300e3 * r / (2 * 25e-3) / 50.0) ** (1 / 0.6)
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(r)
    velocity = np.concatenate([np.cumsum(steps[::-1])[::-1], [0.0]])
    assert NEEDLE.flow(300.0) == pytest.approx(np.trapezoid(2 * np.pi * r * velocity, r) * 1e9, rel=1e-5)


def test_a_time_pressure_dispenser_follows_its_pressure_through_the_needle():
    """Against an adaptive integration of dp/dt = (r - p) / T and Q = C p^(1/n)."""
    dispenser = Dispenser(FLOW, metering="time-pressure", needle=NEEDLE, opening=0.03, closing=0.012, dead_time=0.0024)
    on = command()
    laid = np.cumsum(flows(dispenser, on)) * PERIOD
    wanted = float(NEEDLE.pressure(FLOW))

    def slope(rising):
        request, constant = (wanted, 0.03) if rising else (0.0, 0.012)
        return lambda t, y: [(request - y[0]) / constant, NEEDLE.flow(max(y[0], 0.0))]

    up = solve_ivp(slope(True), (0.0, 0.4), [0.0, 0.0], rtol=1e-10, atol=1e-10)
    down = solve_ivp(slope(False), (0.0, 0.3), up.y[:, -1], rtol=1e-10, atol=1e-10, dense_output=True)
    for tick in (425, 440, 600):
        expected = down.sol((tick + 1) * PERIOD - 0.4224)[1]
        assert laid[tick] == pytest.approx(expected, rel=QUADRATURE)


@pytest.mark.parametrize("constant", [1e-5, 1e-3, 0.02])
def test_the_volumes_of_a_pressures_rise_and_fall_have_closed_forms(constant):
    """Missing after an opening: flow times T (digamma(1 + 1/n) + gamma); excess after a closing: flow times n T."""
    n = NEEDLE.index
    dispenser = Dispenser(FLOW, metering="time-pressure", needle=NEEDLE, opening=constant, closing=constant)
    on = command(on=1000, after=1000)
    laid = flows(dispenser, on) * PERIOD
    withheld = FLOW * 0.98 - laid[:1000].sum()
    assert withheld == pytest.approx(FLOW * constant * (digamma(1 + 1 / n) + np.euler_gamma), rel=1e-3)
    # at 1e-5 s a whole period is a hundred time constants
    left_behind = laid[1020:].sum()
    assert left_behind == pytest.approx(FLOW * constant * n, rel=1e-3)


def test_a_pressure_and_the_flow_it_drives_are_equivalent():
    pressure = float(NEEDLE.pressure(FLOW))
    common = {"metering": "time-pressure", "needle": NEEDLE, "opening": 0.01, "closing": 0.03}
    by_flow, by_pressure = Dispenser(FLOW, **common), Dispenser(pressure=pressure, **common)
    np.testing.assert_allclose(flows(by_flow, command()), flows(by_pressure, command()), rtol=1e-9)
    assert by_pressure.flow_demand([True, False], [5.0, 5.0]) == pytest.approx([FLOW, 0.0])
    # with an area the flow is proportional to the speed, not the pressure
    steady = flows(Dispenser(area=2.0, **common), command(on=400), 50.0)[410]
    assert steady == pytest.approx(100.0, rel=1e-6)
    assert flows(Dispenser(area=2.0, metering="time-pressure", needle=NEEDLE), command(), 30.0).max() == pytest.approx(
        60
    )


def test_a_pump_meters_its_flow_whatever_the_needle():
    on = command()
    common = {"flow": FLOW, "opening": 0.01, "closing": 0.03}
    np.testing.assert_array_equal(flows(Dispenser(**common, needle=NEEDLE), on), flows(Dispenser(**common), on))


def test_milliseconds_for_seconds_are_refused():
    for name in ("dead_time", "closing_dead_time", "opening", "closing", "start_lead", "stop_lead", "advance"):
        with pytest.raises(InputError, match=rf"{name} = 20 s: must be at most 4 s"):
            Dispenser(FLOW, **{name: 20.0})
    with pytest.raises(InputError, match=r"opening = -1 s: must be at least 0 s"):
        Dispenser(FLOW, opening=-1.0)


def test_a_start_lead_longer_than_the_programs_wait_delays_the_motion():
    dispenser = Dispenser(FLOW, start_lead=0.0505)
    setpoints = Setpoints(
        PERIOD, ("x", "y"), np.ones((30, 2)), np.arange(30) >= 20, ramp(50.0).requested, gates=np.array([4, 9])
    )
    with pytest.raises(InputError, match=r"start_lead = 0.0505 s: must be at most 0.02 s.*Setpoints.wait holds"):
        flows(dispenser, setpoints.dispense)
    held = dispenser.held_back(setpoints)
    assert len(held.position) == 30 + 31
    assert np.flatnonzero(held.dispense)[0] == 51
    np.testing.assert_array_equal(held.gates, [35, 40])
    np.testing.assert_array_equal(held.position, np.ones((61, 2)))
    assert flows(dispenser, held.dispense)[:2] == pytest.approx([0.5 * FLOW, FLOW])
    moved = ramp(50.0)
    np.testing.assert_array_equal(dispenser.held_back(moved).position[51:], moved.position)
    np.testing.assert_array_equal(dispenser.held_back(moved).position[:51], np.repeat(moved.position[:1], 51, axis=0))
    for unchanged in (Dispenser(FLOW), Dispenser(FLOW, start_lead=0.02)):
        assert unchanged.held_back(setpoints) is setpoints


BAD = {
    "two": ({"flow": 2.0, "area": 3.0}, r"flow = 2 mm³/s and area = 3 mm²: only one of flow, area, pressure, filament"),
    "flow": ({"flow": -1.0}, r"flow = -1 mm³/s: must be at least 0 mm³/s"),
    "nan": ({"flow": math.nan}, "flow = nan mm³/s: must be finite"),
    "dead time": ({"dead_time": -1e-3}, "dead_time = -0.001 s: must be at least 0 s"),
    "limit": ({"limit": 0.0}, "limit = 0 mm³/s: must be greater than 0"),
    "metering": ({"metering": "volumetrical"}, "unknown metering 'volumetrical': did you mean volumetric"),
    "needle": ({"metering": "time-pressure"}, "metering time-pressure: needs a needle"),
    "absurd": ({"flow": 1e300}, r"flow = 1e\+300 mm³/s: must be at most 1e\+09 mm³/s"),
    "absurd pressure": (
        {"metering": "time-pressure", "pressure": 1e9, "needle": Needle(index=0.01)},
        r"pressure = 1e\+09 kPa: drives inf mm³/s through the needle, must be at most 1e\+09 mm³/s",
    ),
    "pressure": ({"pressure": 300.0}, r"pressure = 300 kPa: metering volumetric takes flow or area"),
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("arguments", "text"), BAD.values(), ids=BAD.keys())
def test_an_invalid_dispenser_is_rejected(arguments, text):
    with pytest.raises(InputError, match=text):
        Dispenser(**arguments)


@pytest.mark.parametrize(
    ("on", "speed", "period", "text"),
    [
        (command(), np.full(820, SPEED), 0.0, "period = 0 s: must be greater than 0 s"),
        (command(), np.full(820, SPEED), math.nan, "period = nan s: must be finite"),
        (
            command(),
            np.full(819, SPEED),
            PERIOD,
            r"speed of shape \(819,\): must be that of dispense, \(n,\), here \(820,\)",
        ),
        (command()[:, None], np.full((820, 1), SPEED), PERIOD, r"speed of shape \(820, 1\): must be"),
        (command(), np.where(np.arange(820) == 7, np.nan, SPEED), PERIOD, "speed = nan mm/s at tick 7: must be finite"),
        (command(), np.where(np.arange(820) == 7, -1.0, SPEED), PERIOD, "speed = -1 mm/s at tick 7: must be finite"),
    ],
)
def test_invalid_commands_are_rejected(on, speed, period, text):
    with pytest.raises(InputError, match=text):
        Dispenser(flow=FLOW).flows(on, speed, period)


def test_an_invalid_needle_is_rejected():
    with pytest.raises(InputError, match=r"bore of the needle = 0 mm: must be greater than 0 mm"):
        Needle(bore=0.0)
    with pytest.raises(InputError, match="its flow at 1 kPa is 0 mm³/s"):
        Needle(consistency=1e6, index=0.001)
    with pytest.raises(InputError, match="its flow at 1 kPa is inf mm³/s"):
        Needle(consistency=1e-6, index=0.001)


@given(
    first=st.integers(0, 20),
    count=st.integers(1, 30),
    edges=st.lists(st.integers(-100, 600).map(lambda twelfths: twelfths / 12), max_size=40),
)
# twice between two ticks, at ticks, at the ends and beyond them
@example(first=2, count=3, edges=[2.5, 2.25, 2.5, 3.0, 2.0, 5.0, 1.5, 5.5])
def test_what_cuts_the_time_is_the_union_of_ticks_and_edges(first, count, edges):
    last = first + count
    union = {float(tick) for tick in range(first, last + 1)} | {edge for edge in edges if first <= edge <= last}
    np.testing.assert_array_equal(cuts(np.array(edges), first, last), sorted(union))
