"""The volumes of an air-driven syringe over pieces of constant request, against closed forms."""

import math

import numpy as np
import pytest

from gantrysim.glue.dispenser.lag import Lag, NeedleLaw, syringe_volumes

ATMOSPHERE = 101.325
# Newtonian: a flow of 0.02 mm³/s at 1 kPa
LAW = NeedleLaw(conductance=0.02, yield_pressure=0.0, power=1.0, a=4 / 3, b=2.0)
AT_ONCE = Lag(0.0, 0.0)
WIDE = (1e9, 0.5)  # supply that no air lacks


def volumes(request, pressure, duration=0.01, air=1e4, glue=1e5, supply=WIDE, lag=AT_ONCE, valve=None):
    state = np.array([pressure if valve is None else valve, ATMOSPHERE + pressure, glue, air])
    request = np.array(request, float)
    laid = syringe_volumes(np.full(request.size, duration), request, lag, LAW, supply, state)
    return laid, state


@pytest.mark.parametrize("pressure", [0.0, -5.0])
def test_at_rest_and_under_vacuum_nothing_flows(pressure):
    laid, state = volumes([pressure] * 5, pressure)
    assert laid.tolist() == [0.0] * 5
    assert state[2:].tolist() == [1e5, 1e4]


def test_at_a_held_pressure_the_flow_is_the_needles():
    laid, state = volumes([300.0] * 4, 300.0)
    assert laid == pytest.approx([0.02 * 300 * 0.01] * 4, rel=1e-6)
    # the room of the glue is the air's
    assert state[2] == pytest.approx(1e5 - laid.sum())
    assert state[3] == pytest.approx(1e4 + laid.sum())


def test_the_last_glue_is_all_that_flows():
    laid, state = volumes([300.0] * 4, 300.0, glue=0.1)
    assert laid.sum() == pytest.approx(0.1)
    assert state[2] == 0.0


def test_a_valve_that_lags_by_a_time_constant_lays_its_integral():
    """Over h from 0 to p: C p (h - T (1 - e^(-h/T))), and back from p to 0 C p T (1 - e^(-h/T))."""
    constant = 0.02
    h = 0.05
    part = constant * (1 - math.exp(-h / constant))
    laid, _ = volumes([200.0], 0.0, duration=h, lag=Lag(constant, 1e-9))
    assert laid == pytest.approx([0.02 * 200 * (h - part)], rel=1e-2)
    laid, _ = volumes([0.0], 200.0, duration=h, lag=Lag(1e-9, constant))
    assert laid == pytest.approx([0.02 * 200 * part], rel=1e-2)
