"""The bead along the trace: conservation, shapes of the section, and values against closed forms."""

import math
import re
from contextlib import suppress
from dataclasses import replace
from io import StringIO
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

from gantrysim import Dispenser, InputError, Job, Machine
from gantrysim.base import columns
from gantrysim.cli.tables import outcome_table
from gantrysim.engine.simulate import perfect_follower
from gantrysim.glue.bead import Bead, BeadSettings, Section
from gantrysim.glue.bead.trace import BeadTrace, spread
from gantrysim.record.run_file import Fault
from gantrysim.record.setpoints import Setpoints
from gantrysim.report.sections import bead_section

from support.beads import AREA, GAP, PERIOD, PLATE, SPEED, away_from_ends, laid, line, spiral, volume_of
from support.soaked import of_jobs

CONSTANT = 1e-3  # relative, the width under constant flow and speed
EXACT = 1e-9  # relative, of volumes and closed forms
PLACE = 0.02  # [mm], of half a section found between two stations
COVERED = 0.01  # of the annulus
XY = Machine("xy")


def section(area, gap=math.inf, contact_angle=60.0, face=PLATE):
    area = np.atleast_1d(np.asarray(area, float))
    return Section(area, np.broadcast_to(np.asarray(gap, float), area.shape), contact_angle, face)


areas, gaps, angles = st.floats(0.01, 50.0), st.floats(0.05, 5.0) | st.just(math.inf), st.floats(5.0, 90.0)
faces = st.floats(0.1, 5.0) | st.just(PLATE)


def across(shape):
    """Offsets on one side of a section, apart on and beside its flat and dense where it is steep, with weights."""
    flat, half = 0.5 * float(shape.flat[0]), 0.5 * float(shape.width[0])
    nodes, weights = np.polynomial.legendre.leggauss(200)
    turn = 0.25 * np.pi * (nodes + 1)
    beside = flat + (half - flat) * np.sin(turn)
    return (
        np.concatenate([0.5 * flat * (nodes + 1), beside]),
        np.concatenate([0.5 * flat * weights, 0.25 * np.pi * (half - flat) * np.cos(turn) * weights]),
    )


@pytest.mark.validates(
    "area and end of a bead's section under a needle",
    "quadrature",
    "1e-9 relative",
)
@settings(deadline=None)
@given(areas, gaps, angles, faces)
def test_a_section_holds_its_area_between_its_height_and_its_width(area, gap, angle, face):
    shape = section(area, gap, angle, face)
    width, height, flat = float(shape.width[0]), float(shape.height[0]), float(shape.flat[0])
    u, weight = across(shape)
    profile = shape.profile(u)[0]
    assert 2 * profile @ weight == pytest.approx(area, rel=EXACT)
    assert shape.half_body()[0] == pytest.approx(np.pi * (profile * u) @ weight, rel=EXACT)
    assert profile.max() == pytest.approx(height, rel=1e-3)
    assert 0 <= flat <= face
    assert height <= gap * (1 + EXACT) or flat == face
    assert shape.profile([0.0])[0, 0] == pytest.approx(min(gap, height))
    assert shape.groove[0] == pytest.approx(max(height - gap, 0.0), abs=1e-9 * height)
    assert shape.profile([0.5001 * width, -0.6 * width]) == pytest.approx(np.zeros((1, 2)))


@settings(deadline=None)
@given(areas, st.floats(0.05, 5.0), angles, faces)
def test_a_section_has_no_jump_where_the_gap_or_the_glue_changes(area, gap, angle, face):
    """Relative steps of 1e-7, at the point itself and where the flat begins and where it is as wide as the face."""
    theta = math.radians(angle)
    low = (gap / (1 - math.cos(theta))) ** 2 * (theta - 0.5 * math.sin(2 * theta))
    for at in (area, low, low + min(face, 10.0) * gap):
        one, more, higher = (section(at * f, gap * g, angle, face) for f, g in ((1, 1), (1 + 1e-7, 1), (1, 1 + 1e-7)))
        for other in (more, higher):
            assert other.height[0] == pytest.approx(one.height[0], rel=1e-5)
            assert other.width[0] == pytest.approx(one.width[0], rel=1e-5)
        assert more.width[0] >= one.width[0] * (1 - 1e-12)  # more glue is never narrower


@settings(deadline=None)
@given(areas, gaps, angles, faces, st.floats(0.1, 10.0))
def test_a_section_is_similar_to_one_of_another_size(area, gap, angle, face, scale):
    one, other = section(area, gap, angle, face), section(area * scale**2, gap * scale, angle, face * scale)
    for name, power in (("width", 1), ("height", 1), ("flat", 1), ("radius", 1)):
        assert getattr(other, name)[0] == pytest.approx(getattr(one, name)[0] * scale**power, rel=1e-6, abs=1e-9)
    assert other.half_body()[0] == pytest.approx(one.half_body()[0] * scale**3, rel=1e-6)


@settings(deadline=None)
@given(areas, st.floats(0.05, 5.0), angles)
def test_a_thin_needle_leaves_the_sessile_section_and_a_wide_one_presses_all_of_it(area, gap, angle):
    free, thin = section(area, math.inf, angle), section(area, gap, angle, 1e-9)
    assert thin.width[0] == pytest.approx(free.width[0], rel=1e-6)
    assert thin.height[0] == pytest.approx(min(free.height[0], max(gap, thin.height[0])), rel=1e-6)
    wide, plate = section(area, gap, angle, 1e4), section(area, gap, angle)
    assert wide.width[0] == plate.width[0]
    assert wide.height[0] == pytest.approx(min(free.height[0], gap))
    # between the two the bead is neither narrower nor higher than either
    some = section(area, gap, angle, 0.5)
    assert free.width[0] * (1 - EXACT) <= some.width[0] <= plate.width[0] * (1 + EXACT)
    assert plate.height[0] * (1 - EXACT) <= some.height[0] <= free.height[0] * (1 + EXACT)


def test_a_low_needle_leaves_a_groove_as_wide_as_its_face_between_halves_of_a_drop():
    """2 mm² under 0.82 mm at 0.5 mm: 0.41 mm² in the groove, and a drop of 1.59 mm² beside it."""
    shape = section(2.0, 0.5, 60.0, 0.82)
    drop = section(2.0 - 0.41)
    assert shape.flat[0] == 0.82
    assert shape.width[0] == pytest.approx(drop.width[0] + 0.82, rel=EXACT)
    assert shape.height[0] == pytest.approx(drop.height[0], rel=EXACT)
    u = np.linspace(0.0, 1.7, 18)
    expected = np.where(u < 0.41, 0.5, drop.profile(u - 0.41)[0])
    assert shape.profile(u)[0] == pytest.approx(expected)
    assert shape.profile(-u)[0] == pytest.approx(expected)
    # without the limit it would be a film of 0.5 mm, 2.77 mm wide between its sides
    assert section(2.0, 0.5).flat[0] == pytest.approx(2.772, abs=1e-3)


@settings(deadline=None)
@given(st.floats(0.01, 100.0), gaps, angles, faces)
def test_a_round_drop_has_its_volume(volume, gap, angle, face):
    shape = Section.drop(volume, np.array([gap]), angle, face)
    assert 2 * shape.half_body()[0] == pytest.approx(volume, rel=EXACT)
    assert shape.flat[0] <= face


@settings(deadline=None)
@given(st.floats(0.01, 50.0), st.floats(5.0, 90.0))
def test_a_drop_is_a_segment_that_meets_the_surface_at_its_contact_angle(area, angle):
    shape = section(area, contact_angle=angle)
    width, theta = float(shape.width[0]), math.radians(angle)
    assert area == pytest.approx(width**2 / (8 * math.sin(theta) ** 2) * (2 * theta - math.sin(2 * theta)))
    assert shape.height[0] == pytest.approx(0.5 * width * math.tan(0.5 * theta))
    step = 1e-7 * width
    slope = (shape.profile([0.5 * width - 2 * step]) - shape.profile([0.5 * width - step]))[0, 0] / step
    if angle < 80:
        assert slope == pytest.approx(math.tan(theta), rel=1e-3)


@settings(deadline=None)
@given(st.floats(0.1, 2.0), st.floats(5.0, 90.0))
def test_a_bead_is_squashed_where_it_would_stand_higher_than_the_nozzle_and_without_a_jump(gap, angle):
    theta = math.radians(angle)
    width = 2 * gap / math.tan(0.5 * theta)
    just = width**2 / (8 * math.sin(theta) ** 2) * (2 * theta - math.sin(2 * theta))
    below, above = section([just * (1 - 1e-9)], gap, angle), section([just * (1 + 1e-9)], gap, angle)
    assert below.flat[0] == pytest.approx(0.0, abs=1e-12 * width)
    assert above.flat[0] > 0
    assert above.width[0] == pytest.approx(below.width[0], rel=1e-6) == pytest.approx(width, rel=1e-6)
    # from there on each more of area is so much of a film of the gap's height
    more = section([just + 3.0], gap, angle)
    assert more.width[0] == pytest.approx(width + 3.0 / gap)
    assert more.height[0] == pytest.approx(gap)
    # without the nozzle it stands higher and is narrower
    free = section([just + 3.0], math.inf, angle)
    assert free.height[0] > gap
    assert free.width[0] < more.width[0]


def test_half_a_body_of_a_half_disc_is_a_quarter_of_a_ball():
    area = 0.5 * np.pi * 1.5**2
    assert section(area, contact_angle=90.0).half_body()[0] == pytest.approx(np.pi * 1.5**3 / 3, rel=1e-3)


@pytest.mark.validates(
    "width of a bead laid at constant flow and speed",
    "constant",
    "1e-3 relative",
)
@pytest.mark.parametrize("path", [line(), spiral(8.0)], ids=["line", "spiral"])
@pytest.mark.parametrize("squashed", [True, False])
@pytest.mark.parametrize("face", [0.82, PLATE])
def test_constant_flow_and_speed_lay_a_bead_of_constant_width(path, squashed, face):
    """Its area is Q / v, but for the last, incomplete period."""
    bead = laid(XY, path, squashed=squashed, face=face)
    inner = away_from_ends(bead)
    assert bead.area[inner] == pytest.approx(np.full(inner.sum(), AREA), rel=CONSTANT)
    expected = float(section(AREA, GAP if squashed else math.inf, face=face).width[0])
    assert bead.width[inner] == pytest.approx(np.full(inner.sum(), expected), rel=CONSTANT)
    assert bead.values.width.mean == pytest.approx(expected, rel=CONSTANT)
    assert bead.values.nominal == pytest.approx(AREA, rel=1e-6)
    whole = laid(XY, line())
    assert whole.values.width.std / whole.values.width.mean < CONSTANT
    assert whole.values.width.max / whole.values.width.min - 1 < CONSTANT


def test_half_the_speed_lays_twice_the_section():
    fast, slow = (laid(XY, line(), Dispenser(flow=150.0), speed) for speed in (100.0, 50.0))
    assert slow.area[away_from_ends(slow)] == pytest.approx(np.full(away_from_ends(slow).sum(), 3.0), rel=CONSTANT)
    assert fast.area[away_from_ends(fast)] == pytest.approx(np.full(away_from_ends(fast).sum(), 1.5), rel=CONSTANT)


def test_a_flow_in_proportion_to_the_speed_keeps_the_section_through_a_change_of_speed():
    bead = laid(XY, line(), Dispenser(area=AREA))
    position = np.cumsum(np.where(np.arange(1500) < 500, 0.1, 0.04)) - 50.0
    setpoints = replace(
        run_setpoints(bead), position=np.stack([position, 0 * position], axis=1), dispense=np.ones(1500, bool)
    )
    proportional = Bead(perfect_follower(XY, setpoints, dispenser=Dispenser(area=AREA)))
    fixed = Bead(perfect_follower(XY, setpoints, dispenser=Dispenser(flow=AREA * 40.0)))
    assert proportional.area == pytest.approx(np.full(proportional.area.size, AREA), rel=CONSTANT)
    assert proportional.values.volume_error == pytest.approx(0.0, abs=1e-6)
    assert fixed.area[40] == pytest.approx(0.4 * AREA, rel=CONSTANT)
    assert fixed.area[-40] == pytest.approx(AREA, rel=CONSTANT)
    assert fixed.values.requested_volume == pytest.approx(AREA * fixed.place[-1], rel=1e-9)
    assert fixed.values.volume_error == pytest.approx(-0.6 * AREA * 49.9, rel=1e-2)


def run_setpoints(bead):
    """Setpoints that would give a bead's commanded trace."""
    run = bead.run
    return Setpoints(run.period, run.axes, run.commanded, run.dispense, run.requested)


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.5, 5.0), st.booleans())
def test_no_glue_is_lost_between_the_flow_and_the_sections(seed, gap, squashed):
    random = np.random.default_rng(seed)
    bead = laid(XY, line(60.0), gap=gap, squashed=squashed)
    n = len(bead.run.time)
    speed = np.repeat(random.uniform(0.0, 3.0, n // 20 + 1), 20)[:n] * (random.random(n) < 0.8)
    s = np.concatenate([[0.0], np.cumsum(speed[:-1])]) * 0.1
    nozzle = np.stack([s - 50.0, 0 * s, 0 * s], axis=1)
    flow = np.repeat(random.uniform(0.0, 500.0, n // 50 + 1), 50)[:n]
    other = Bead(replace(bead.run, nozzle=nozzle, flow=flow), bead.settings)
    assert other.area.min() >= 0
    assert volume_of(other) == pytest.approx(flow[:-1].sum() * PERIOD, rel=EXACT)


def test_what_is_laid_at_rest_spreads_no_further_than_it_is_wide():
    setpoints = run_setpoints(laid(XY, line()))
    rest = np.insert(np.arange(len(setpoints.position)), 500, np.full(200, 500))
    setpoints = replace(setpoints, position=setpoints.position[rest], dispense=np.ones(rest.size, bool))
    heap = Bead(perfect_follower(XY, setpoints, dispenser=Dispenser(flow=AREA * SPEED)))
    assert heap.nominal == pytest.approx(AREA)
    assert volume_of(heap) == pytest.approx(AREA * SPEED * (rest.size - 1) * PERIOD, rel=EXACT)
    assert abs(heap.place[heap.area.argmax()] - 50.0) < 0.3
    usual = np.abs(heap.place - 50.0) > 2 * heap.width.max()
    assert heap.area[usual] == pytest.approx(np.full(usual.sum(), AREA), rel=CONSTANT)
    # 40 mm³ on a point: over the nominal section's own width it would stand 4.5 mm long and more than 20 mm wide
    assert heap.width.max() < 18.0
    assert heap.width[np.abs(heap.place - 50.0) < 4.0].min() > 1.5 * float(heap.nominal_section.width[0])


LAGS = {"dead_time": 0.02, "opening": 0.03, "closing": 0.04}


@pytest.mark.parametrize("lead", [0.0, 0.015])
def test_start_and_stop_are_off_by_the_distance_of_their_lags(lead):
    """By volume v (dead time + time constant - lead)."""
    dispenser = Dispenser(flow=AREA * SPEED, **LAGS, start_lead=lead, stop_lead=lead)
    values = laid(XY, line(200.0, start=(-100.0, 0.0)), dispenser, on=(0.4, 1.3)).values
    assert values.missing_at_start.mean == pytest.approx(SPEED * (0.05 - lead), rel=1e-4)
    assert values.excess_at_stop.mean == pytest.approx(SPEED * (0.06 - lead), rel=1e-4)
    # half the section is reached after the dead time and ln 2 time constants
    assert values.delay_at_start.mean == pytest.approx(SPEED * (0.02 + 0.03 * math.log(2) - lead), abs=PLACE)
    assert values.overrun_at_stop.mean == pytest.approx(SPEED * (0.02 + 0.04 * math.log(2) - lead), abs=PLACE)
    assert values.requested_volume == pytest.approx(AREA * 90.0)
    assert values.volume_error == pytest.approx(AREA * 1.0, rel=1e-3)
    assert values.volume_error_percent == pytest.approx(100 / 90, rel=1e-3)


def ramped(dispenser):
    """A bead along a line whose speed ramps to SPEED and back in 0.2 s each, at SPEED for a second."""
    speed = np.concatenate(
        [np.linspace(0, SPEED, 200), np.full(1000, SPEED), np.linspace(SPEED, 0, 200), np.zeros(300)]
    )
    position = np.concatenate([[0.0], np.cumsum(speed) * PERIOD])[:-1] - 60.0
    on = np.arange(speed.size) < 1400
    base = run_setpoints(laid(XY, line()))
    points = replace(base, position=np.stack([position, 0 * position], axis=1), dispense=on)
    return Bead(perfect_follower(XY, points, dispenser=dispenser), BeadSettings())


@pytest.mark.parametrize(
    "lags", [{}, LAGS, {**LAGS, "start_lead": 0.0, "stop_lead": 0.04}], ids=["none", "lags", "lead"]
)
@pytest.mark.parametrize("fixed", [True, False])
def test_the_volume_error_is_the_sum_of_its_parts(fixed, lags):
    """A fixed flow on ramps of 0.2 s each demands 0.2 s too much; an area nothing; without lags no other error."""
    values = ramped(Dispenser(**({"flow": AREA * SPEED} if fixed else {"area": AREA}), **lags)).values
    parts = values.ramp_error + values.start_error + values.running_error + values.stop_error
    assert parts == pytest.approx(values.volume_error, abs=1e-9)
    assert values.ramp_error == pytest.approx(AREA * SPEED * 0.2 if fixed else 0.0, rel=1e-2, abs=1e-9)
    if not lags:
        assert [values.start_error, values.running_error, values.stop_error] == pytest.approx([0, 0, 0], abs=1e-9)
    elif fixed:
        assert values.start_error == pytest.approx(-AREA * SPEED * 0.05, rel=1e-3)
        assert values.stop_error == pytest.approx(AREA * SPEED * (0.06 - lags.get("stop_lead", 0.0)), rel=1e-3)
        assert values.running_error == pytest.approx(0, abs=1e-3)
    else:  # on a ramp a lag costs the volume of the same distance; after the last setpoint the flow ends with 0.06 s
        assert values.start_error == pytest.approx(-AREA * SPEED * 0.05, rel=1e-2)
        assert values.running_error == pytest.approx(0, abs=1e-2)


def test_what_a_flow_limit_withholds_is_steady_error_and_not_a_late_start():
    """The limit is three quarters of the demand at speed, and does not act on the lower parts of the ramps."""
    dispenser = Dispenser(area=AREA, limit=0.75 * AREA * SPEED, dead_time=0.01, opening=0.01, closing=0.01)
    values = ramped(dispenser).values
    assert values.running_error == pytest.approx(-0.25 * AREA * SPEED * 1.0, rel=0.1)
    assert values.ramp_error == pytest.approx(0.0, abs=1e-9)
    assert values.missing_at_start.mean < 8.0  # [mm], while 27 mm are missing in total
    dispenser_error = values.start_error + values.running_error + values.stop_error
    assert dispenser_error == pytest.approx(values.volume_error, abs=1e-9)
    whole = ramped(replace(dispenser, limit=math.inf)).values
    assert whole.running_error == pytest.approx(0.0, abs=1e-2)


LAG = 0.03  # [s]


def stepped_bead(speeds, durations, **dispenser):
    """A bead along a line at speeds for durations [s], with a section in proportion, and what the flow then is.

    After each piece the flow is q = d + (q0 - d) exp(-t / LAG), by hand.
    """
    speed = np.concatenate([np.full(round(t / PERIOD), v) for v, t in zip(speeds, durations, strict=True)])
    position = np.concatenate([[0.0], np.cumsum(speed) * PERIOD, np.full(600, speed.sum() * PERIOD)])
    on = np.arange(position.size) < speed.size
    base = run_setpoints(laid(XY, line()))
    points = replace(base, position=np.stack([position - 60.0, 0 * position], axis=1), dispense=on)
    values = {"area": AREA, "opening": LAG, "closing": LAG} | dispenser
    flows = [0.0]
    for v, t in zip(speeds, durations, strict=True):
        flows.append(AREA * v + (flows[-1] - AREA * v) * math.exp(-t / LAG))
    return Bead(perfect_follower(XY, points, dispenser=Dispenser(**values)), BeadSettings()), flows[1:]


@pytest.mark.parametrize("seed", range(4))
def test_starts_and_stops_are_told_from_a_speed_that_changes_all_the_time(seed):
    """Of a lag T, T (q2 - q1) is missing between flows q1 and q2. Nothing settles here: pieces of 0.3 to 1.5 T.

    The start ends where the flow first meets its demand, at the first fall of the speed through it, and the stop begins
    where it last did.
    """
    rng = np.random.default_rng(seed)
    speeds = np.array([40.0, 90.0, *rng.uniform(20.0, 100.0, 20), 80.0, 20.0, 70.0]).round(1)
    durations = (LAG * rng.uniform(0.3, 1.5, speeds.size)).round(3)
    bead, flows = stepped_bead(speeds, durations)
    crosses = (np.array(flows[:-1]) - AREA * speeds[:-1]) * (np.array(flows[:-1]) - AREA * speeds[1:]) < 0
    assert crosses.any()
    first, last = np.flatnonzero(crosses)[[0, -1]]
    values = bead.values
    assert values.start_error == pytest.approx(-LAG * flows[first], rel=1e-9)
    assert values.stop_error == pytest.approx(LAG * flows[last], rel=1e-6)
    assert values.running_error == pytest.approx(-LAG * (flows[last] - flows[first]), abs=1e-9)


@pytest.mark.parametrize("slow", [1.0, 0.3])
def test_a_start_is_that_of_the_first_speed_at_which_the_flow_settles(slow):
    """12 lags at both ends: the start misses T A v1, the stop lays T A v2 too much, however often the speed changes."""
    speeds = [60.0 * slow, *[100.0, 30.0] * 4, 50.0]
    bead, _ = stepped_bead(speeds, [12 * LAG, *[0.8 * LAG] * 8, 12 * LAG])
    assert bead.values.missing_at_start.mean == pytest.approx(LAG * 60.0 * slow, rel=2e-3)
    assert bead.values.excess_at_stop.mean == pytest.approx(LAG * 50.0, rel=2e-3)


def test_a_start_compensated_by_an_advance_has_no_shortfall():
    bead = ramped(Dispenser(flow=AREA * SPEED, opening=0.02, closing=0.02, advance=0.02))
    assert bead.values.missing_at_start.mean == pytest.approx(0.0, abs=1e-3)


def test_every_stretch_has_a_start_and_a_stop():
    path = line(200.0, start=(-100.0, 0.0))
    bead = laid(XY, path, Dispenser(flow=AREA * SPEED, dead_time=0.01))
    time = bead.run.time
    dispense = ((time > 0.2) & (time < 0.7)) | ((time > 1.0) & (time < 1.8))
    setpoints = replace(run_setpoints(bead), dispense=dispense)
    bead = Bead(perfect_follower(XY, setpoints, dispenser=Dispenser(flow=AREA * SPEED, dead_time=0.01)))
    assert len(bead.stretches) == 2
    values = bead.values
    for length in (values.missing_at_start, values.excess_at_stop, values.delay_at_start, values.overrun_at_stop):
        assert length.mean == pytest.approx(1.0, abs=PLACE)
        assert length.std < PLACE
    assert values.volume == pytest.approx(AREA * SPEED * dispense.sum() * PERIOD)
    # all of them count in the ranges, and what happens within one counts neither as its begin nor as its end
    heavy = np.where(time < 0.8, 2.0, 1.0) * np.where((np.abs(time - 0.3) < 0.02) | (np.abs(time - 1.6) < 0.02), 0, 1)
    other = Bead(replace(bead.run, flow=bead.run.flow * heavy))
    assert other.values.section.max == pytest.approx(2 * AREA, rel=CONSTANT)
    assert other.values.delay_at_start.mean == pytest.approx(1.0, abs=0.2)
    assert other.values.overrun_at_stop.mean == pytest.approx(1.0, abs=0.2)
    # between the two the nozzle is dry
    assert bead.area[np.abs(bead.place - 85.0) < 10].max() == 0
    assert bead.values.width.min == 0


def test_a_record_that_ends_while_the_dispenser_is_on_has_no_stop():
    bead = laid(XY, line(), Dispenser(flow=AREA * SPEED, dead_time=0.01, stop_lead=0.05))
    faulted = Bead(replace(bead.run, fault=Fault("travel", "x", 1.0, 2.0, 1.0, "mm")))
    assert faulted.values.excess_at_stop is None
    assert faulted.values.overrun_at_stop is None
    assert faulted.values.missing_at_start.mean == pytest.approx(1.0)
    assert bead.run.flow[-1] == pytest.approx(AREA * SPEED)


def test_turns_keep_the_pitch_less_their_width_between_them():
    for pitch in (8.0, 3.0):
        bead = laid(XY, spiral(pitch))
        inner = (bead.analysis.spacing.s > 10) & (bead.analysis.spacing.next_s < bead.place[-1] - 10)
        width = float(bead.nominal_section.width[0])
        assert bead.clearance()[inner] == pytest.approx(np.full(inner.sum(), pitch - width), abs=CONSTANT * width)
        apart = pitch > width
        assert bead.values.gap_share == pytest.approx(float(apart), abs=0.02)
        assert bead.values.overlap_share == pytest.approx(float(not apart), abs=0.02)


def test_the_share_that_overlaps_is_that_of_the_length():
    """Twice the flow makes 8.5 mm of 4.5: turns 7 mm apart overlap where both are so wide, not where one is."""
    bead = laid(XY, spiral(7.0))
    spacing = bead.analysis.spacing
    least = float(np.interp(spacing.s[0] + 0.4 * (spacing.s[-1] - spacing.s[0]), spacing.s, spacing.next_s))
    flow = np.where(bead.length < least, 2.0, 1.0) * AREA * SPEED
    heavy = Bead(replace(bead.run, flow=flow))
    assert heavy.values.overlap_share == pytest.approx(0.4, abs=0.02)
    assert heavy.values.overlap_share + heavy.values.gap_share == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("ratio", [1.25, 2.0, 3.0])
def test_the_annulus_is_covered_by_the_share_of_the_width_in_the_pitch(ratio):
    width = float(section(AREA, GAP).width[0])
    values = laid(XY, spiral(ratio * width, radius=45.0, turns=1.6)).values
    assert values.coverage == pytest.approx(1 / ratio, abs=COVERED)


def test_a_bead_without_turns_has_no_clearance_and_no_coverage():
    values = laid(XY, line()).values
    assert values.clearance is values.coverage is values.overlap_share is values.gap_share is None


def test_a_nozzle_that_stands_higher_lays_a_narrower_bead():
    bead = laid(XY, line())
    up = bead.run.nozzle + np.where(np.arange(len(bead.run.time)) > 500, 0.1, 0.0)[:, None] * [0, 0, 1]
    raised = Bead(replace(bead.run, nozzle=up))
    assert raised.nozzle_height[40] == pytest.approx(GAP)
    assert raised.nozzle_height[-40] == pytest.approx(GAP + 0.1)
    assert raised.height[-40] == pytest.approx(GAP + 0.1)
    assert raised.width[-40] == pytest.approx(float(section(AREA, GAP + 0.1).width[0]))
    # a nozzle that dips into the work keeps a twentieth of its gap
    down = Bead(replace(bead.run, nozzle=bead.run.nozzle - [0, 0, 0.6]))
    assert down.nozzle_height == pytest.approx(np.full(down.place.size, 0.05 * GAP))
    assert Bead(bead.run, BeadSettings(gap=0.3)).height[-40] == pytest.approx(0.3)


def test_glue_that_flows_while_the_nozzle_lifts_lies_on_the_spot():
    bead = laid(XY, line())
    lift = np.clip(np.arange(len(bead.run.time)) - 800, 0, 100)[:, None] * [0, 0, 0.1]
    stop = np.minimum(bead.run.nozzle, [30.0, 0, 0])
    lifted = Bead(replace(bead.run, nozzle=stop + lift))
    assert lifted.place[-1] == pytest.approx(80.0)
    assert volume_of(lifted) == pytest.approx(AREA * 100.0, rel=EXACT)
    assert np.abs(lifted.point[:, 2]).max() < 1e-6
    # on a slope it goes on along it
    slope = bead.run.nozzle * [1, 1, 0] + (bead.run.nozzle[:, :1] + 50) * [0, 0, 0.75]
    assert Bead(replace(bead.run, nozzle=slope)).place[-1] == pytest.approx(125.0)


def test_a_run_without_glue_has_no_values_and_one_at_rest_neither():
    with pytest.raises(InputError, match="requests no glue while the nozzle moves"):
        _ = laid(XY, line(), Dispenser()).values
    bead = laid(XY, line(), Dispenser())
    assert not bead.area.any()
    still = replace(run_setpoints(bead), position=np.zeros((100, 2)), dispense=np.ones(100, bool))
    resting = Bead(perfect_follower(XY, still, dispenser=Dispenser(flow=10.0)))
    with pytest.raises(InputError, match="requests no glue while the nozzle moves"):
        _ = resting.values
    # it is a dot, which is no part of the bead
    assert volume_of(resting) == 0
    (dot,) = resting.dots
    assert dot.volume == pytest.approx(0.99, rel=EXACT)


def test_impossible_settings_are_refused():
    for values, text in (
        ({"gap": 0.0}, "gap = 0 mm: must be at least 1e-06 mm"),
        ({"gap": 1e-300}, "gap = 1e-300 mm: must be at least 1e-06 mm"),
        ({"cell": -1.0}, "cell = -1 mm: must be at least 1e-06 mm"),
        ({"contact_angle": 1e-300}, "contact_angle = 1e-300 deg: must be at least 1 and at most 90 deg"),
        ({"contact_angle": 91.0}, "contact_angle = 91 deg: must be at least 1 and at most 90 deg"),
    ):
        with pytest.raises(InputError, match=text):
            BeadSettings(**values)


@pytest.mark.parametrize("name", of_jobs("an225-3d", "delta-arc", "linuxcnc-flanges", "slicer-square"))
def test_a_jobs_bead_holds_what_flowed(name):
    job = Job.load(name)
    bead = Bead(job.follow(), job.bead)
    flowed = bead.run.flow[:-1].sum() * bead.run.period
    assert volume_of(bead) + sum(dot.volume + dot.string for dot in bead.dots) == pytest.approx(flowed, rel=EXACT)
    assert bead.values.volume == pytest.approx(volume_of(bead), rel=EXACT)
    assert bead.map.volume == pytest.approx(bead.values.volume + sum(dot.volume for dot in bead.dots), rel=1e-6)


def test_a_job_configures_its_dispenser_and_its_bead(tmp_path):
    overrides = ["bead.gap=0.4", "cell=0.5", "squashed=false", "contact_angle=45", "closing=0.2", "needle.bore=0.5"]
    overrides += ["metering='time-pressure'"]
    job = Job.load("an225", overrides)
    assert job.bead == BeadSettings(gap=0.4, contact_angle=45.0, squashed=False, cell=0.5)
    assert job.dispenser.closing == 0.2
    assert job.dispenser.needle.bore == 0.5
    (tmp_path / "job.toml").write_text(job.toml())
    assert Job.load(str(tmp_path / "job.toml")) == job
    for override, text in (
        ("bead.cells=1", "unknown key 'bead.cells': did you mean bead.cell"),
        ("cell=0", "job an225: cell = 0 mm: must be at least 1e-06 mm"),
        ("dispenser.area=3", "flow = 200 mm³/s and area = 3 mm²: only one"),
        ("dispenser.needle=3", "dispenser.needle = 3"),
        ("dispenser.limit=100", "limit = 100 mm³/s: must be at least the request, 200"),
    ):
        with pytest.raises(InputError, match=text):
            Job.load("an225", [override])
    (tmp_path / "bad.toml").write_text('name = "bad"\nbead = 3\n[program]\ncontroller = "trio.MoveSpiral"\n')
    with pytest.raises(InputError, match=r"bead = 3: must be a table, \[bead\]"):
        Job.load(str(tmp_path / "bad.toml"))
    held = Job.load("an225", ["start_lead=0.0305"])
    assert np.flatnonzero(held.setpoints.dispense)[0] == 31
    assert len(held.setpoints.position) == len(Job.load("an225").setpoints.position) + 31


def test_after_a_fault_on_the_first_ramp_the_requested_section_is_unknown():
    """Of a fixed flow the median would be that of some speed on the ramp; an area needs no speed."""
    fault = Fault("travel", "x", 0.1, 2.0, 1.0, "mm")

    def faulted(dispenser, ticks):
        run = ramped(dispenser).run
        arrays = {name: value[:ticks] for name, value in vars(run).items() if isinstance(value, np.ndarray)}
        return Bead(replace(run, fault=fault, **arrays))

    early = faulted(Dispenser(flow=AREA * SPEED), 150)
    assert early.nominal == 0
    with pytest.raises(InputError, match="the fault came before the path speed was steady"):
        _ = early.values
    assert faulted(Dispenser(area=AREA), 150).values.nominal == pytest.approx(AREA)
    assert faulted(Dispenser(flow=AREA * SPEED), 600).values.nominal == pytest.approx(AREA)


def test_a_bead_needs_two_stations():
    with pytest.raises(InputError, match="stations = 1: must be at least 2"):
        Bead(laid(XY, line()).run, stations=1)


@pytest.mark.filterwarnings("error")
def test_extreme_settings_cause_no_warning():
    run = laid(XY, line()).run
    for values in ({"gap": 1e-6}, {"contact_angle": 1.0}, {"gap": 1e9}, {"cell": 1e-6}):
        bead = Bead(run, BeadSettings(**values))
        assert np.isfinite(bead.width).all()
        with suppress(InputError):
            assert np.isfinite(bead.map.height).all()
    heavy = laid(XY, line(), Dispenser(flow=1e9))
    with pytest.raises(InputError, match=r"of a bead 2e\+07 mm wide"):
        _ = heavy.map


def printed(bead):
    console = Console(width=200, file=StringIO())
    console.print(outcome_table(bead.analysis, bead.values, None))
    return console.file.getvalue()


def test_the_console_shows_the_volumes_of_a_tiny_bead():
    """Of 1e-3 mm² along 100 mm, of whose start 1 mm is missing."""
    dispenser = Dispenser(flow=1e-3 * SPEED, dead_time=0.01)
    text = printed(laid(XY, line(), dispenser, cell=0.01, gap=0.05))
    assert re.search(r"volume +0.099 mm³ +−1.00 % of 0.1 requested", text)
    assert re.search(r"missing at start +1.00 mm +length of nominal bead", text)
    assert re.search(r"volume error +−0.00100\d* mm³ +ramps 0, starts −0.00100\d*, running 0, stops 0", text)
    assert "late" not in text


def test_the_console_warns_of_a_map_that_has_not_settled():
    bead = laid(XY, line())
    text = printed(bead)
    assert "not settled" not in text
    bead.values = replace(bead.values, ridge=0.5)
    assert re.search(r"height map +not settled +glue stands 50 % above the nozzle", printed(bead))
    note = bead_section(bead).text
    assert note == ["The height map has not settled: " + bead.values.ridge_note + "."]


@pytest.mark.parametrize("size", [61, 1000])
def test_the_surface_below_the_nozzle_does_not_depend_on_the_blocks_it_is_found_in(size, monkeypatch):
    run = Job.load("an225-3d").run()
    time, end = np.arange(len(run.time)), len(run.time)
    run = replace(run, dispense=run.dispense & ((time < end // 3) | (time > end // 2)))  # a pause while it climbs
    trace = BeadTrace.of(run, BeadSettings(gap=GAP))
    on, offset = np.flatnonzero(run.dispense), trace.analysis.nozzle.offset[:, 2]
    expected = np.interp(time, on, run.nozzle[on, 2] - offset) - GAP
    monkeypatch.setattr(columns, "BLOCK", size)
    np.testing.assert_allclose(trace.surface(), expected, rtol=0, atol=1e-12)
    assert np.ptp(expected[end // 3 : end // 2]) > 1.0


@pytest.mark.parametrize("ds", [0.25, 0.5])
def test_a_surplus_spreads_over_its_width_by_two_means(ds):
    """A mean over n stations, twice, is a triangle; n is that of half a width to either side."""
    width = 4.0
    reach = round(0.5 * width / ds)
    n = 2 * reach + 1
    stations = np.arange(401)
    area = np.ones(401)
    area[200] += 12.0
    triangle = 1 + 12.0 * np.maximum(n - np.abs(stations - 200), 0) / n**2
    once = spread(area, 1.0, width, ds, longest=5.0)
    assert once == pytest.approx(triangle, rel=1e-12)
    assert spread(area, 1.0, width, ds, longest=4.0) == pytest.approx(area)
    # what is wider than two widths spreads over two
    twice = spread(area, 1.0, width, ds, longest=9.0)
    assert twice.sum() == pytest.approx(area.sum())
    if triangle.max() > 2:
        assert twice.max() < triangle.max()
        widest = np.abs(stations - 200)[triangle > 2].max()
        assert np.flatnonzero(twice > 1 + 1e-9).max() - 200 == widest + 4 * reach
    else:
        assert twice == pytest.approx(once)


@pytest.mark.parametrize(("gap", "angle", "face"), [(0.5, 60.0, 0.8), (1.2, 90.0, 2.0), (0.3, 120.0, 0.4)])
def test_the_largest_section_without_a_groove_is_pressed_by_all_of_the_face(gap, angle, face):
    """Beside the face's rectangle it is the circular segment as high as the gap."""
    theta = math.radians(angle)
    radius = gap / (1 - math.cos(theta))
    largest = Section.pressed_flat(gap, angle, face)
    assert largest.area.tolist() == pytest.approx([radius**2 * (theta - math.sin(2 * theta) / 2) + face * gap])
    assert (largest.flat[0], largest.height[0]) == pytest.approx((face, gap))
    assert largest.groove[0] == pytest.approx(0.0, abs=1e-12)
    assert section(1.01 * largest.area[0], gap, angle, face).groove[0] > 0
    assert section(0.99 * largest.area[0], gap, angle, face).flat[0] < face


def test_the_largest_flow_is_that_of_any_tick():
    run = laid(XY, line()).run
    flow = np.full(len(run.time), 20.0)
    flow[[7, 11]] = (321.0, 0.0)
    assert Bead(replace(run, flow=flow)).most_flow == 321.0


@pytest.mark.parametrize("drift", [0.0, 4e-4])
def test_a_flow_that_a_limit_holds_short_has_settled_where_it_is_steady(drift):
    """Also one that falls by 0.04 % a second, as a syringe empties; one that still rises has not settled."""
    tick = np.arange(1000)
    demand = np.where((tick >= 100) & (tick < 900), 10.0, 0.0)
    flow = 6.0 * np.clip((tick - 100) / 200, 0.0, 1.0) * (1 - drift * 1e-3 * np.clip(tick - 300, 0, None))
    flow = np.where(tick < 900, flow, 0.0)
    run = SimpleNamespace(period=1e-3, flow=flow, flow_demand=demand)
    first, after = Bead._settled_ticks(SimpleNamespace(run=run), 0, 1000)
    assert first == 300
    assert after in (899, 900)
    # the middle, where it never settles
    run = SimpleNamespace(period=1e-3, flow=np.linspace(0.0, 6.0, 1000), flow_demand=demand)
    assert Bead._settled_ticks(SimpleNamespace(run=run), 0, 1000) == (500, 500)
