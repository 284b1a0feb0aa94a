"""Outline tracing within limits of its axes: they hold, they bite, and what they cost; blending."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.controllers.stage import OutlineTrace

from support.outlines import (
    ACCELERATION,
    ELL,
    INF,
    NODES,
    POSITION,
    RECTANGLE,
    SET_UP,
    VELOCITY,
    Rounded,
    accelerations,
    angle_between,
    on_the_work,
    traces,
    turned,
    velocities,
)
from support.soaked import examples

LIMITS = [("velocity", 0, 150.0), ("velocity", 1, 150.0), ("velocity", 2, 90.0)]
ACCELERATIONS = [("acceleration", 0, 900.0), ("acceleration", 1, 700.0), ("acceleration", 2, 400.0)]


def alone(name, axis, limit):
    return {name: tuple(limit if k == axis else INF for k in range(3))}


@pytest.mark.parametrize("corners", [RECTANGLE, ELL], ids=["rectangle", "ell"])
@pytest.mark.parametrize(("name", "axis", "limit"), LIMITS)
def test_a_velocity_limit_bites_and_holds(name, axis, limit, corners):
    free = OutlineTrace(corners=corners, **SET_UP)
    held = OutlineTrace(corners=corners, **SET_UP, **alone(name, axis, limit))
    without, within = (np.abs(velocities(trace.setpoints(2e-4))[:, axis]).max() for trace in (free, held))
    assert without > 1.2 * limit
    assert 0.999 * limit <= within <= limit * (1 + VELOCITY)
    assert held.duration > free.duration


@pytest.mark.parametrize("blend", [0.0, 6.0])
@pytest.mark.parametrize("corners", [RECTANGLE, ELL], ids=["rectangle", "ell"])
@pytest.mark.parametrize(("name", "axis", "limit"), ACCELERATIONS)
def test_an_acceleration_limit_bites_and_holds(name, axis, limit, corners, blend):
    free = OutlineTrace(corners=corners, **SET_UP, blend=blend)
    held = OutlineTrace(corners=corners, **SET_UP, blend=blend, **alone(name, axis, limit))
    without, within = (np.abs(accelerations(trace.setpoints(2e-4))[:, axis]).max() for trace in (free, held))
    assert without > 2 * limit
    assert 0.99 * limit <= within <= limit * (1 + ACCELERATION)
    assert held.duration > free.duration


@given(traces(), st.sampled_from([0.0, 0.2, 0.8]), st.data())
@examples(16)
def test_all_limits_hold_together_whatever_the_set_up(job, blend, data):
    """With the needle on the outline all the while: the limits change when, not where."""
    oracle = Rounded(job["corners"], job["corner_radius"])
    velocity = tuple(data.draw(st.floats(20, 200)) for _ in range(3))
    acceleration = tuple(data.draw(st.floats(200, 2000)) for _ in range(3))
    blend *= job["corner_radius"]
    trace = OutlineTrace(**job, blend=blend, velocity=velocity, acceleration=acceleration)
    setpoints = trace.setpoints(trace.duration / 20_000.5)
    assert np.all(np.abs(velocities(setpoints)).max(axis=0) <= np.array(velocity) * (1 + ACCELERATION))
    assert np.all(np.abs(accelerations(setpoints)).max(axis=0) <= np.array(acceleration) * (1 + 2 * ACCELERATION))
    u = on_the_work(trace, setpoints.position)
    way = trace.profile.position(setpoints.time)
    assert u == pytest.approx(oracle(way)[0], abs=1e-8)
    assert np.all(np.diff(way) >= 0)
    assert trace.profile.velocity(np.linspace(0, trace.duration, 5001)).max() <= job["speed"] * (1 + 1e-9)
    assert trace.duration > oracle.length / job["speed"]


@pytest.mark.parametrize(("name", "axis", "limit"), LIMITS)
def test_a_velocity_limit_holds_along_linear_pieces(name, axis, limit):
    """Constant speed in every piece: that of its chord, or of the limit."""
    held = OutlineTrace(corners=ELL, **SET_UP, corner_pieces=5, **alone(name, axis, limit))
    free = OutlineTrace(corners=ELL, **SET_UP, corner_pieces=5)
    parts = [np.linspace(*free.turning.s[k : k + 2], 6 if k % 2 else 2) for k in range(len(free.turning.s) - 1)]
    s = np.unique(np.concatenate(parts))
    step = np.abs(np.diff(free.coordinates(s), axis=0))[:, axis]
    times = np.maximum(np.diff(s) / 60, step / limit)
    assert held.duration == pytest.approx(times.sum(), rel=1e-6)
    assert np.abs(velocities(held.setpoints(2e-4))[:, axis]).max() <= limit * (1 + VELOCITY)
    assert np.abs(velocities(free.setpoints(2e-4))[:, axis]).max() > 1.2 * limit


def test_linear_pieces_halt_at_every_joint_where_an_acceleration_is_limited():
    limits = {"acceleration": (3000.0, 3000.0, 3000.0)}
    trace = OutlineTrace(**limits, corner_pieces=3)
    s = np.concatenate([np.linspace(*trace.turning.s[k : k + 2], 4) for k in (1, 3, 5, 7)])
    halts = trace.profile.velocity(np.array([trace.profile.time_at(at) for at in s]))
    assert halts == pytest.approx(np.zeros(s.size), abs=1e-2)
    # each from rest to rest: the axis that needs most of its limit a millimetre sets the pace
    edges = np.unique(np.concatenate([trace.turning.s, s]))
    edges = edges[np.diff(edges, prepend=-1) > 1e-6]
    rate = np.abs(np.diff(trace.coordinates(edges), axis=0)).max(axis=1) / np.diff(edges)
    times = [trapezoid(length, 50, 3000 / most) for length, most in zip(np.diff(edges), rate, strict=True)]
    assert trace.duration == pytest.approx(sum(times), rel=1e-3)
    assert trace.duration > OutlineTrace(**limits).duration


def trapezoid(length, speed, acceleration):
    """Time from rest to rest."""
    if speed**2 / acceleration <= length:
        return length / speed + speed / acceleration
    return 2 * math.sqrt(length / acceleration)


@pytest.mark.parametrize("alpha", [300.0, 3000.0, 30_000.0])
def test_the_time_with_halts_at_every_joint_in_closed_form(alpha):
    """With C = K - r n_K the stage moves along edges alone and the table in corners alone, each from rest to rest."""
    trace = OutlineTrace(centre=(-190.0, 0.0), acceleration=(alpha, 400.0, 400.0))
    edges = sum(2 * trapezoid(length, 50, 400) for length in (40, 80))
    corners = 4 * trapezoid(5 * math.pi, 50, math.radians(alpha) * 10)
    assert trace.duration == pytest.approx(edges + corners, rel=1e-3)  # a thousandth of the accelerations is in hand
    assert trace.duration >= edges + corners
    halts = trace.profile.velocity(np.array([trace.profile.time_at(s) for s in trace.turning.s]))
    assert halts == pytest.approx(np.zeros(9), abs=1e-3)


def test_the_time_where_only_the_table_is_limited():
    """Edges are run at LSP but for what two nodes cost at their ends."""
    trace = OutlineTrace(acceleration=(3000.0, INF, INF))
    corners = 4 * trapezoid(5 * math.pi, 50, math.radians(3000) * 10)
    late = trace.duration - (240 / 50 + corners)
    assert 0 < late <= 8 * NODES / 50 + 1e-3 * corners
    assert trace.notes == (
        f"speed: the axes' limits increase the duration from 6.057 s to {trace.duration:.3f} s and reduce the mean "
        "speed by 6 %; lowest speed 0 mm/s at 40.0 mm of the outline",
    )


def test_the_time_where_the_tables_velocity_is_limited():
    trace = OutlineTrace(velocity=(100.0, INF, INF))
    slow = math.radians(100) * 10
    assert trace.duration == pytest.approx(240 / 50 + 20 * math.pi / slow, rel=1e-9)
    assert trace.notes == (
        "speed: the axes' limits increase the duration from 6.057 s to 8.400 s and reduce the mean speed by 28 %; "
        "lowest speed 17.5 mm/s at 40.0 mm of the outline",
    )
    t = np.linspace(0, trace.duration, 1001)
    speed = trace.profile.velocity(t)
    assert np.all(np.isclose(speed, 50) | np.isclose(speed, slow) | (np.abs(np.gradient(speed)) > 0))


@pytest.mark.parametrize("axis", [1, 2])
def test_the_time_where_an_axis_of_the_stage_has_a_velocity_limit(axis):
    """In a corner |S'| is 19 and turns with TH: dt = ds / min(LSP, limit / |S'| |cos|).

    So that no velocity passes its limit between two nodes, their speeds are held to both: that costs a share of
    the angle of 0.05 mm, 0.005 rad.
    """
    trace = OutlineTrace(velocity=tuple(200.0 if k == axis else INF for k in range(3)))
    s = (np.arange(400_000) + 0.5) / 400_000 * 5 * math.pi
    part = np.abs(np.cos(s / 10)) * 19
    corner = np.sum(1 / np.minimum(50, 200 / part)) * 5 * math.pi / 400_000
    assert 0 <= trace.duration - (240 / 50 + 4 * corner) <= 0.005 * 4 * corner


def test_limits_above_the_demand_have_no_effect():
    trace = OutlineTrace(velocity=(300.0, 1000.0, 1000.0))
    assert trace.duration == pytest.approx(6.05664, abs=5e-6)
    assert trace.notes == ()
    setpoints = trace.setpoints(1e-3)
    assert setpoints.position == pytest.approx(OutlineTrace().setpoints(1e-3).position, abs=1e-7)
    chord = np.linalg.norm(np.diff(on_the_work(trace, setpoints.position), axis=0), axis=1)[:-1]
    assert chord / 1e-3 == pytest.approx(np.full(chord.size, 50), rel=2e-6)  # r = 10 mm: the chord is shorter by 1e-6


def test_blending_is_faster_than_stopping_and_leaves_the_needle_on_the_outline():
    limits = {"acceleration": (3000.0, 3000.0, 3000.0)}
    times = [OutlineTrace(**limits, blend=blend).duration for blend in (0.0, 2.0, 5.0, 10.0)]
    assert np.all(np.diff(times) < 0)
    trace = OutlineTrace(**limits, blend=5.0)
    setpoints = trace.setpoints(1e-3)
    oracle = Rounded(RECTANGLE, 10)
    points, normals = oracle(trace.profile.position(setpoints.time))
    assert on_the_work(trace, setpoints.position) == pytest.approx(points, abs=POSITION)
    off = np.abs(angle_between(turned(normals, np.radians(setpoints.position[:, 0])), np.array([-1.0, 0.0])))
    bound = math.degrees(5 / 10 / 8)
    assert 0.99 * bound < off.max() <= bound * (1 + 1e-9)
    lost = 100 * (1 - 302.8318530717959 / 50 / trace.duration)
    assert trace.notes == (
        f"speed: the axes' limits increase the duration from 6.057 s to {trace.duration:.3f} s and reduce the mean "
        f"speed by {lost:.0f} %; lowest speed {trace.profile.slowest[0]:.3g} mm/s at "
        f"{trace.profile.slowest[1]:.1f} mm of the outline",
        f"blend: the normal at the needle deviates by up to {bound:.2f} deg",
    )
    assert trace.profile.slowest[0] > 10
    # the slowest that is text is between the first rise and the last fall
    t = np.linspace(0.5, trace.duration - 0.5, 20_001)
    assert trace.profile.velocity(t).min() == pytest.approx(trace.profile.slowest[0], rel=1e-2)


@given(traces(), st.floats(0.05, 3))
@examples(24)
def test_a_blended_normal_deviates_by_no_more_than_its_bound(job, share):
    """By w / 8 r where all corners turn one way, and by twice that where some turn the other.

    The mean over a window w is off by the integral of half the second difference, (TH' after - TH' before) t, and
    the slope TH' lies in (0, 1/r) or in (-1/r, 1/r).
    """
    oracle = Rounded(job["corners"], job["corner_radius"])
    blend = min(share * job["corner_radius"], oracle.length)
    trace = OutlineTrace(**job, blend=blend)
    s = np.concatenate([np.linspace(0, oracle.length, 8001), oracle.ends[:-1]])
    at = trace.coordinates(s)
    points, normals = oracle(s)
    assert on_the_work(trace, at) == pytest.approx(points, abs=POSITION)
    off = np.abs(angle_between(turned(normals, np.radians(at[:, 0])), np.array(job["normal"])))
    convex = np.all(np.sign(oracle.turn) == np.sign(oracle.turn[0]))
    assert off.max() <= math.degrees(blend / job["corner_radius"] / 8) * (1 if convex else 2) + 1e-7
    assert (
        trace.notes[-1]
        == f"blend: the normal at the needle deviates by up to {float(trace.notes[-1].split()[-2]):.2f} deg"
    )
    assert float(trace.notes[-1].split()[-2]) == pytest.approx(off.max(), abs=0.0051)
    # the table's rate does not jump: by central differences its slope changes by no more than w's share a step
    fine = np.linspace(0, oracle.length, 20_001)
    rate = np.diff(np.radians(trace.coordinates(fine)[:, 0])) / fine[1]
    step = 2 / job["corner_radius"] * (fine[1] / blend)
    assert np.abs(np.diff(rate)).max() <= step * (1 + 1e-6) + 1e-9
    # and in the end it has turned as far, but for what is eased beyond the ends
    assert at[len(s) - len(oracle.ends), 0] - at[0, 0] == pytest.approx(360 * oracle.outside, abs=math.degrees(blend))
