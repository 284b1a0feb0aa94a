"""Drops of a jet: their number, places and times by hand."""

import math

import numpy as np
import pytest

from gantrysim import InputError
from gantrysim.controllers.gcode.slicer import Program
from gantrysim.glue.dispenser.command import Material
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.glue.dispenser.jet import Jet

PERIOD = 1e-3


def test_drops_are_spaced_evenly_along_the_path_whatever_the_speed():
    """0.02 mm³ at 0.04 mm² are 0.5 mm apart, the first after half of that."""
    speed = np.concatenate([np.linspace(0, 50, 500), np.full(500, 50.0), np.linspace(50, 0, 500)])
    on = np.ones(speed.size, bool)
    flow = Dispenser(area=0.04, kind="jet", jet=Jet(drop=0.02, top_rate=1000.0)).flows(on, speed, PERIOD)
    place = np.cumsum(speed) * PERIOD
    ticks = np.flatnonzero(flow)
    assert flow[ticks] == pytest.approx(20.0)
    expected = 0.25 + 0.5 * np.arange(ticks.size)
    # within the tick in which it is shot
    assert (place[ticks] >= expected - 1e-9).all()
    assert (place[ticks] - speed[ticks] * PERIOD <= expected + 1e-9).all()
    assert ticks.size == round(place[-1] / 0.5)


@pytest.mark.parametrize(("open_time", "drops"), [(0.1, 10), (0.05, 5), (0.004, 0), (0.006, 1)])
def test_a_dot_at_rest_has_as_many_drops_as_its_time_admits(open_time, drops):
    """2 mm³/s in drops of 0.02 mm³ are 100 a second."""
    on = np.zeros(300, bool)
    on[50 : 50 + round(open_time / PERIOD)] = True
    flow = Dispenser(flow=2.0, kind="jet", jet=Jet(drop=0.02)).flows(on, np.zeros(300), PERIOD)
    assert flow.sum() * PERIOD == pytest.approx(0.02 * drops)


def test_the_dead_time_shifts_the_drops():
    on = np.ones(300, bool)
    early, late = (
        Dispenser(flow=2.0, kind="jet", dead_time=time).flows(on, np.zeros(300), PERIOD) for time in (0.0, 0.01)
    )
    np.testing.assert_array_equal(late[10:], early[:-10])


def test_a_jet_shoots_no_faster_than_it_can_and_says_what_it_loses():
    on = np.ones(1000, bool)
    jet = Dispenser(flow=8.0, kind="jet", jet=Jet(drop=0.02, top_rate=200.0))
    flow = jet.flows(on, np.zeros(1000), PERIOD)
    assert flow.sum() * PERIOD == pytest.approx(0.02 * 200, rel=0.01)
    assert np.diff(np.flatnonzero(flow)).min() >= 4
    (note,) = jet.notes(on, np.zeros(1000), PERIOD)
    assert "its largest flow is 4 mm³/s, at 200 Hz" in note
    assert Dispenser(flow=3.0, kind="jet").notes(on, np.zeros(1000), PERIOD) == ()


def test_e_s_volume_is_shot_in_drops():
    points = Program(text="M83\nG1 X20 E1 F600\nG1 E-1\nG0 X40\nG1 E1\nG1 X60 E1").setpoints(PERIOD)
    jet = Dispenser(filament=1.0, kind="jet", jet=Jet(drop=0.01))
    flow = jet.flows(points.dispense, np.zeros(len(points.time)), PERIOD, Material(points.extrusion))
    assert flow.sum() * PERIOD == pytest.approx(2 * math.pi / 4, abs=0.005)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"opening": 0.1}, "dispenser.opening with kind = jet: must be with kind = valve"),
        ({"jet": Jet(), "kind": "valve"}, "dispenser.jet with kind = valve: must be with kind = jet"),
    ],
)
def test_values_of_another_kind_are_refused(arguments, text):
    with pytest.raises(InputError, match=text):
        Dispenser(**{"kind": "jet", **arguments})
    with pytest.raises(InputError, match="drop of the jet = 0 mm³: must be greater than 0"):
        Jet(drop=0.0)


def test_drops_that_a_jet_loses_are_counted_at_once():
    """8 mm³/s over 1 s are 8000 drops of 0.001 mm³, of which 200 Hz shoot 200; of 1e-5 mm³, all but 200 of 800 000."""
    on = np.ones(1000, bool)
    for drop, due in ((0.001, 8000), (1e-5, 800_000)):
        jet = Dispenser(flow=8.0, kind="jet", jet=Jet(drop=drop, top_rate=200.0))
        flow = jet.flows(on, np.zeros(1000), PERIOD)
        shot = round(flow.sum() * PERIOD / drop)
        assert shot == pytest.approx(200, abs=1)
        (note,) = jet.notes(on, np.zeros(1000), PERIOD)
        # one waits at the end
        assert int(note.split()[3]) == pytest.approx(due - shot, abs=10)
    with pytest.raises(InputError, match=r"drop of the jet = 1e-09 mm³: must be at least 1e-06 mm³"):
        Jet(drop=1e-9)


def test_a_jet_takes_back_no_drop_where_its_advance_falls_below_zero():
    """Twice 200 ms at 2 mm³/s, each with 0.05 s · 2 mm³/s on top as it begins: 1 mm³ is 50 drops."""
    speed = np.repeat([0.0, 50.0, 0.0, 50.0, 0.0], [10, 200, 50, 200, 50])
    jet = Dispenser(area=0.04, kind="jet", jet=Jet(drop=0.02, top_rate=1e5), advance=0.05)
    flow = jet.flows(np.ones(speed.size, bool), speed, PERIOD)
    assert flow.sum() * PERIOD == pytest.approx(50 * 0.02)
