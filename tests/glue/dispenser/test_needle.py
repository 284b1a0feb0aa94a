"""Flow of a yield-stress glue through a needle against closed forms and integrals; the needle's sizes."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad, solve_ivp

from gantrysim import InputError, Needle
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.glue.dispenser.needle import GAUGES

PERIOD = 1e-3
EXACT = 1e-12  # relative, of closed forms
INVERSE = 1e-9  # relative, of the pressure for a flow
QUADRATURE = 1e-6  # relative, of integrals
INCH = 25.4  # [mm]
BINGHAM = Needle(bore=0.5, length=20.0, consistency=30.0, index=1.0, yield_stress=200.0)
HERSCHEL_BULKLEY = Needle(bore=0.84, length=25.0, consistency=50.0, index=0.6, yield_stress=150.0)

bores, lengths, consistencies = st.floats(0.1, 2.0), st.floats(5.0, 50.0), st.floats(0.1, 500.0)
indices, stresses, ratios = st.floats(0.2, 1.5), st.floats(1.0, 5000.0), st.floats(1e-3, 1e3)


def integrated(needle, pressure):
    """The flow by integrals over the velocity's profile, with a plug where tau < tau_y [mm³/s]."""
    radius, slope = 0.5e-3 * needle.inner, pressure * 1e3 / (2e-3 * needle.length)
    plug = min(needle.yield_stress / slope, radius)

    def rate(r):
        return (max(slope * r - needle.yield_stress, 0.0) / needle.consistency) ** (1 / needle.index)

    def velocity(r):
        return quad(rate, max(r, plug), radius, epsabs=0, epsrel=1e-9)[0]

    sheared = quad(lambda r: 2 * np.pi * r * velocity(r), plug, radius, epsabs=0, epsrel=1e-9)[0]
    return 1e9 * (np.pi * plug**2 * velocity(plug) + sheared)


@pytest.mark.validates(
    "flow of a Herschel-Bulkley glue through a needle",
    "integral of the velocity profile",
    "1e-6 relative",
)
@pytest.mark.parametrize("needle", [BINGHAM, HERSCHEL_BULKLEY, Needle("25G", 12.7, 5.0, 1.3, 40.0)])
@pytest.mark.parametrize("ratio", [1.05, 1.5, 4.0, 50.0])
def test_the_flow_is_the_integral_of_the_velocitys_profile(needle, ratio):
    pressure = ratio * needle.yield_pressure
    assert needle.flow(pressure) == pytest.approx(integrated(needle, pressure), rel=QUADRATURE)


@pytest.mark.validates(
    "flow of a Bingham glue through a needle",
    "law of Buckingham and Reiner",
    "1e-9 relative",
)
@settings(deadline=None)
@given(bores, lengths, consistencies, stresses, st.floats(1.0, 1e3))
def test_a_bingham_glue_flows_by_buckingham_and_reiner(bore, length, viscosity, stress, ratio):
    """Q = pi R^4 p / (8 mu L) (1 - 4/3 phi + 1/3 phi^4), in SI."""
    needle = Needle(bore, length, viscosity, 1.0, stress)
    pressure = ratio * 4 * stress * length / bore  # [Pa]
    newtonian = math.pi * (0.5e-3 * bore) ** 4 * pressure / (8 * viscosity * 1e-3 * length) * 1e9
    expected = newtonian * (1 - 4 / 3 / ratio + ratio**-4 / 3)
    assert needle.flow(1e-3 * pressure) == pytest.approx(expected, rel=1e-9, abs=1e-12 * newtonian)


@settings(deadline=None)
@given(bores, lengths, consistencies, indices, stresses, ratios)
def test_nothing_flows_below_the_yield_pressure_and_the_power_law_is_the_limit_above(
    bore, length, consistency, index, stress, ratio
):
    needle = Needle(bore, length, consistency, index, stress)
    free = Needle(bore, length, consistency, index)
    least = 4e-3 * stress * length / bore  # [kPa]
    assert needle.yield_pressure == pytest.approx(least, rel=EXACT)
    assert not needle.flow([0.0, 0.5 * least, needle.yield_pressure]).any()
    flows = needle.flow(least * (1 + ratio * np.array([0.5, 1.0, 2.0])))
    assert (np.diff(flows) > 0).all()
    assert flows[1] < free.flow(least * (1 + ratio))
    assert needle.flow(1e7 * least) == pytest.approx(float(free.flow(1e7 * least)), rel=1e-5)
    # just above it the flow grows with the power 1 + 1/n
    near = needle.flow(least * (1 + np.array([1e-4, 2e-4])))
    assert near[1] / near[0] == pytest.approx(2 ** (1 + 1 / index), rel=2e-3)
    # only the pressure per length counts, and at one wall stress the bore to the third
    assert Needle(bore, 2 * length, consistency, index, stress).flow(2 * least * (1 + ratio)) == pytest.approx(flows[1])
    wider = Needle(2 * bore, length, consistency, index, stress)
    assert wider.flow(0.5 * least * (1 + ratio)) == pytest.approx(8 * flows[1], rel=1e-6)


@settings(deadline=None)
@given(bores, lengths, consistencies, indices, st.just(0.0) | stresses, ratios)
def test_a_needles_pressure_is_the_inverse_of_its_flow(bore, length, consistency, index, stress, ratio):
    needle = Needle(bore, length, consistency, index, stress)
    pressure = needle.yield_pressure + max(needle.yield_pressure, 1.0) * ratio
    assert needle.pressure(needle.flow(pressure)) == pytest.approx(pressure, rel=INVERSE)
    assert needle.pressure([0.0, 0.0]).tolist() == [0.0, 0.0]


def test_a_lagging_pressure_drives_a_yield_stress_glue_once_it_is_above_its_yield_pressure():
    """Against an adaptive integration; nothing flows for T ln(p / (p - p_y)) after an opening."""
    on, pressure, opening, closing = np.repeat([True, False], [200, 400]), 400.0, 0.02, 0.035
    dispenser = Dispenser(
        pressure=pressure, metering="time-pressure", needle=HERSCHEL_BULKLEY, opening=opening, closing=closing
    )
    laid = np.cumsum(dispenser.flows(on, np.zeros(on.size), PERIOD)) * PERIOD
    until = opening * math.log(pressure / (pressure - HERSCHEL_BULKLEY.yield_pressure))
    assert np.flatnonzero(laid)[0] == int(until / PERIOD)

    def slope(request, constant):
        return lambda t, y: [(request - y[0]) / constant, float(HERSCHEL_BULKLEY.flow(max(y[0], 0.0)))]

    exact = {"rtol": 1e-10, "atol": 1e-10, "max_step": 1e-3}
    up = solve_ivp(slope(pressure, opening), (0.0, 0.2), [0.0, 0.0], **exact, dense_output=True)
    down = solve_ivp(slope(0.0, closing), (0.0, 0.4), up.y[:, -1], **exact, dense_output=True)
    for tick in (20, 60, 199):
        assert laid[tick] == pytest.approx(up.sol((tick + 1) * PERIOD)[1], rel=10 * QUADRATURE)
    for tick in (210, 260, 599):
        assert laid[tick] == pytest.approx(down.sol((tick + 1) * PERIOD - 0.2)[1], rel=10 * QUADRATURE)
    assert laid[599] == laid[400]


def test_a_demanded_flow_is_laid_through_a_yield_stress():
    dispenser = Dispenser(area=2.0, metering="time-pressure", needle=HERSCHEL_BULKLEY)
    speed = np.linspace(0.0, 60.0, 50)
    assert dispenser.flows(np.ones(50, bool), speed, PERIOD) == pytest.approx(2.0 * speed, rel=1e-9)


def test_gauges_have_their_inches_and_a_bore_the_wall_of_the_gauge():
    """Regular walls, nominal, to a hundredth of a millimetre: 18 gauge 0.033 in 0.050, 21 gauge 0.0203 in 0.0323."""
    for gauge, bore, outer in (
        ("14G", 0.063, 0.083),
        ("18G", 0.033, 0.050),
        ("21G", 0.02025, 0.03225),
        ("30G", 0.00625, 0.01225),
    ):
        needle = Needle(gauge)
        assert needle.inner == pytest.approx(bore * INCH, abs=0.01)
        assert needle.face == pytest.approx(outer * INCH, abs=0.01)
        assert Needle(needle.inner).face == pytest.approx(needle.face)
        assert Needle(gauge, outer=3.0).face == 3.0
    sizes = np.array(list(GAUGES.values()))
    assert (np.diff(sizes, axis=0) < 0).all()
    assert (sizes[:, 1] > sizes[:, 0]).all()
    assert Needle(gauge).flow(300.0) == Needle(GAUGES[gauge][0]).flow(300.0)


@settings(deadline=None)
@given(st.floats(0.01, 5.0), st.floats(1e-3, 0.1))
def test_a_larger_bore_has_a_larger_face(bore, more):
    assert bore < Needle(bore).face < Needle(bore + more).face


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"bore": "26G"}, "unknown gauge of the needle '26G': did you mean"),
        ({"bore": 0.8, "outer": 0.8}, "outer of the needle = 0.8 mm: must be greater than its bore, 0.8 mm"),
        ({"outer": -1.0}, "outer of the needle = -1 mm: must be greater than 0 mm"),
        ({"yield_stress": -1.0}, "yield_stress of the needle = -1 Pa: must be at least 0 Pa"),
        ({"yield_stress": math.inf}, "yield_stress of the needle = inf Pa: must be finite"),
    ],
)
def test_an_impossible_needle_is_refused(values, text):
    with pytest.raises(InputError, match=text):
        Needle(**values)


def test_a_pressure_below_the_yield_pressure_is_refused():
    with pytest.raises(
        InputError, match=r"pressure = 10 kPa: must be greater than the needle's yield pressure, 32 kPa"
    ):
        Dispenser(pressure=10.0, metering="time-pressure", needle=BINGHAM)
