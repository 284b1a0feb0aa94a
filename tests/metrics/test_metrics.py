"""Values of runs with known errors, and the spacing of neighbouring turns."""

import dataclasses
import math
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from gantrysim.base.errors import InputError
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.metrics import (
    Analysis,
    ErrorSize,
    Range,
    following_error,
    path_speed,
    spacing,
    torque_ripple,
    values,
)
from gantrysim.paths.arcs import ArcChain
from gantrysim.paths.chain import Chain
from gantrysim.paths.lengths import arc_length
from gantrysim.paths.pieces import XY, YZ, ZX, Coil
from gantrysim.paths.spirals import Involute
from gantrysim.record.run import Run
from gantrysim.record.run_file import Fault

from support.runs import archimedean
from support.soaked import examples, suite_runs

EXACT = 1e-9  # [mm]
SPACING = 1e-9  # of an involute followed perfectly [mm]
TWO_DECIMALS = 5e-3  # [mm]
CURVED_TRACE = 1e-5  # spacing of a trace whose error varies [mm]
CHORD = 1e-4  # of a length measured by chords, relative
NOISE = 0.02  # of the standard deviation of white noise, relative: three times that of 20,000 samples
LAST_PERIOD = 2e-4  # of a mean speed, as the last of some 10,000 setpoints comes sooner, relative

INVOLUTE = Involute(60, 10, 4)
PERIOD = 0.001
SPEED = 100


def flat(z):
    """Complex points as (n, 3)."""
    z = np.asarray(z)
    return np.stack([z.real, z.imag, 0 * z.real], axis=-1)


def run_along(path, *, encoder=0.0, nozzle=0.0, dispense=None, step=SPEED * PERIOD, stated=True):
    """Return a run commanded along `path`; `encoder` and `nozzle` are added to the commanded points, (n, 3).

    Its progress is stated, as by a controller, or assigned, which takes a hundred times as long.
    """
    s = np.minimum(np.arange(math.ceil(path.length / step - 1e-9) + 1) * step, path.length)
    tip = path.position(s)
    rows = len(s)
    nothing = np.zeros((rows, 2))
    return Run(
        machine="none",
        axes=("x", "y"),
        units=("mm", "mm"),
        requested=path,
        period=PERIOD,
        time=np.arange(rows) * PERIOD,
        commanded=tip[:, :2],
        commanded_tip=tip,
        encoder=(tip + encoder)[:, :2],
        encoder_tip=tip + encoder,
        motor=(tip + encoder)[:, :2],
        motor_tip=tip + encoder,
        nozzle=tip + nozzle,
        demand=nothing,
        torque=nothing,
        current=nothing,
        voltage=nothing,
        flow=np.zeros(rows),
        flow_demand=np.zeros(rows),
        gap=0.5,
        dispense=np.ones(rows, bool) if dispense is None else dispense(s),
        progress=s if stated else None,
    )


def along(path, step=SPEED * PERIOD):
    """Arc lengths of the setpoints of `run_along`, and the path's tangents and normals there."""
    s = np.minimum(np.arange(math.ceil(path.length / step - 1e-9) + 1) * step, path.length)
    return s, path.tangent(s), path.normal(s)


def gap_along_the_normal(curve, parameter, turn, reach, step=1e-6):
    """Distance from curve(parameter) along its normal to the next turn: by bisection on the curve itself."""
    here = curve(parameter)
    tangent = curve(parameter + step) - curve(parameter - step)
    tangent /= abs(tangent)

    def ahead(other):
        return ((curve(other) - here) * tangent.conjugate()).real

    met = brentq(ahead, parameter + turn - reach, parameter + turn + reach, xtol=1e-12)
    return abs(curve(met) - here)


def gaps_at_the_same_heading(radii, angle):
    """Distance across one turn of a chain of arcs of equal angle: (p(theta + 2 pi) - p(theta)) . n(theta).

    Between the joints it is c + u cos(theta) + v sin(theta), with the centres and radii of the two arcs.
    """
    centres = [complex(radii[0], 0)]
    for k, (before, after) in enumerate(pairwise(radii), 1):
        centres.append(centres[-1] + (after - before) * np.exp(-1j * k * angle))  # the joint stays where it is

    def support(phi):
        k = np.minimum((phi / angle).astype(int), len(radii) - 1)
        return np.array(centres)[k], np.array(radii)[k]

    phi = np.linspace(0, 6 * np.pi, 300_001)
    (centre, radius), (centre_next, radius_next) = support(phi), support(phi + 2 * np.pi)
    inward = np.exp(-1j * phi)
    return ((centre_next - centre) * inward.conj()).real + radius - radius_next


def test_perfect_follower_of_the_involute_has_the_pitch_for_spacing():
    found = spacing(INVOLUTE, INVOLUTE.position(np.arange(0, INVOLUTE.length, 1.0)))
    assert found.distance == pytest.approx(np.full(found.distance.size, 10.0), abs=SPACING)


@pytest.mark.parametrize("clockwise", [True, False])
def test_spacing_exists_at_all_points_before_the_last_turn(clockwise):
    path = Involute(60, 10, 3.5, clockwise=clockwise)
    s = np.linspace(0, path.length, 2001)
    found = spacing(path, path.position(s))
    a = 10 / (2 * np.pi)
    last = 60 * 5 * np.pi - 0.5 * a * (5 * np.pi) ** 2  # 2.5 turns from the start
    assert found.s == pytest.approx(s[s <= last], abs=1e-6)
    heading = (60 - np.sqrt(60**2 - 2 * a * s[s <= last])) / a
    assert found.turn == pytest.approx(heading / (2 * np.pi), abs=1e-9)
    assert found.distance == pytest.approx(np.full(found.s.size, 10.0), abs=SPACING)


@given(st.floats(-4, 4), st.floats(1, 15), st.booleans())
@examples(20)
def test_a_constant_lateral_error_does_not_change_the_spacing(error, pitch, clockwise):
    """A curve parallel to an involute has the same normals and the same pitch."""
    path = Involute(5 * pitch, pitch, 4, clockwise=clockwise)
    s = np.linspace(0, path.length, 1201)
    error *= 0.1 * pitch
    found = spacing(path, path.position(s) + error * path.normal(s))
    assert found.distance == pytest.approx(np.full(found.s.size, pitch), abs=SPACING)


@pytest.mark.soak
def test_perfect_follower_of_the_loop_of_one_second_has_the_arcs_spacing():
    spiral = MoveSpiral(120, 4, 10, SPEED, loop_period=1.0)
    angle = SPEED / 60
    change = 2 * 10 * SPEED / (np.pi * 120**2)
    gaps = gaps_at_the_same_heading([60 * (1 - k * change) for k in range(1, 17)], angle)
    assert gaps.min() == pytest.approx(9.92739, abs=5e-6)
    assert gaps.max() == pytest.approx(10.10250, abs=5e-6)
    position = spiral.setpoints(PERIOD).position
    found = spacing(spiral.requested, flat(position @ [1, 1j])).distance
    assert found.min() == pytest.approx(gaps.min(), abs=TWO_DECIMALS)
    assert found.max() == pytest.approx(gaps.max(), abs=TWO_DECIMALS)
    assert (round(found.min(), 2), round(found.max(), 2)) == (9.93, 10.10)


def test_spacing_of_archimedes_spiral_is_measured_along_its_own_normal():
    """Against the requested involute its lateral error reaches 2 a."""
    a = 10 / (2 * np.pi)
    trace = archimedean(60, 10, 4)
    s = np.arange(0, trace.length, 0.1)
    found = spacing(INVOLUTE, trace.position(s))
    at = np.linspace(20, 700, 60)
    # the polar angle psi of the points whose foot on the involute is at arc length `at`
    psi_of_foot = np.interp(
        at, INVOLUTE.project(trace.position(s)).s, np.unwrap(np.angle(60 - trace.position(s) @ [1, 1j, 0]))
    )
    exact = [
        gap_along_the_normal(lambda psi: (60 - a * psi) * np.exp(-1j * psi), psi, 2 * np.pi, 0.5)
        for psi in np.abs(psi_of_foot)
    ]
    assert np.interp(at, found.s, found.distance) == pytest.approx(exact, abs=CURVED_TRACE)
    assert min(exact) < 10 - 5e-3


@pytest.mark.soak
@pytest.mark.parametrize("waves", suite_runs([3.3, 41.7], 0))
def test_spacing_of_a_wavy_trace_is_measured_along_its_own_normal(waves):
    amplitude = 0.2

    def error(s):
        return amplitude * np.sin(2 * np.pi * waves * s / INVOLUTE.length)

    def trace(s):
        return INVOLUTE.position(s) + np.atleast_1d(error(s))[:, None] * INVOLUTE.normal(s)

    s = np.linspace(0, INVOLUTE.length, 40_001)
    found = spacing(INVOLUTE, trace(s))
    for k in range(0, found.s.size, found.s.size // 25):
        here = found.s[k]
        turn = np.interp(np.interp(here, s, INVOLUTE.phi(s)) + 2 * np.pi, INVOLUTE.phi(s), s) - here
        if here < 1 or here + turn + 5 > INVOLUTE.length:
            continue  # the slope of the error is one-sided at the ends
        exact = gap_along_the_normal(lambda at: complex(*trace(at)[0, :2]), here, turn, 5, step=1e-4)
        # the slope is taken over 0.25 mm to both sides, and tilts the normal that meets the next turn askew
        wave = 2 * np.pi * waves / INVOLUTE.length
        tilt = amplitude * wave**3 * 0.25**2 / 6 * 10 * 2 * amplitude * wave
        assert found.distance[k] == pytest.approx(exact, abs=CURVED_TRACE + tilt)


def test_a_trace_of_another_pitch_has_that_pitch_for_spacing():
    narrow = Involute(60, 9.8, 4)
    phi = INVOLUTE.phi(along(INVOLUTE)[0])
    trace = narrow.position(60 * phi - 9.8 / (4 * np.pi) * phi**2)
    found = values(run_along(INVOLUTE, nozzle=trace - INVOLUTE.position(along(INVOLUTE)[0]))).spacing
    assert (found.min, found.mean, found.max) == pytest.approx((9.8, 9.8, 9.8), abs=CURVED_TRACE)


@pytest.mark.parametrize("drift", suite_runs([0.03, -0.03], 0))
def test_spacing_ends_where_the_normal_no_longer_meets_the_trace(drift):
    """A lateral error that grows by `drift` a millimetre leans the normal forwards or back."""
    further = Involute(60, 10, 4.5)

    def trace(s):
        return further.position(s) + (drift * (np.atleast_1d(s) - 920))[:, None] * further.normal(s)

    s = np.arange(830, INVOLUTE.length, 0.02)
    found = spacing(INVOLUTE, trace(s))
    tangent = trace(found.s[-1] + 1e-4) - trace(found.s[-1] - 1e-4)

    def ahead(at):
        return float((trace(at) - trace(found.s[-1]))[0] @ tangent[0])

    met = brentq(ahead, INVOLUTE.length - 20, INVOLUTE.length + 20)
    if drift < 0:  # backwards: the last point is the one a whole turn of the requested path before the end
        assert INVOLUTE.phi(found.s[-1]) == pytest.approx(6 * np.pi, abs=1e-2)
        assert met < INVOLUTE.length
    else:
        assert met == pytest.approx(INVOLUTE.length, abs=0.03)  # two samples
        assert INVOLUTE.phi(found.s[-1]) < 6 * np.pi - 2e-3


@cache
def wavy_spacing():
    """Arc lengths, a lateral error there, and the spacing of the involute with it."""
    s = np.linspace(0, INVOLUTE.length, 601)
    wave = 0.3 * np.sin(s / 17)[:, None]
    return s, wave, spacing(INVOLUTE, INVOLUTE.position(s) + wave * INVOLUTE.normal(s))


@given(st.floats(-4, 4), st.tuples(st.floats(-200, 200), st.floats(-200, 200)), st.booleans())
@examples(10)
def test_spacing_is_the_same_for_a_path_moved_turned_and_mirrored(angle, shift, clockwise):
    s, wave, plain = wavy_spacing()
    path = Involute(60, 10, 4, shift, 0.5 * np.pi + angle, clockwise)
    sense = 1 if clockwise else -1
    moved = spacing(path, path.position(s) + sense * wave * path.normal(s))
    assert moved.distance == pytest.approx(plain.distance, abs=1e-7)
    assert moved.s == pytest.approx(plain.s, abs=1e-7)
    assert moved.turn == pytest.approx(plain.turn, abs=1e-9)


@pytest.mark.parametrize(
    "path",
    [
        ArcChain([0, 0], 0.3, 0, 200),
        ArcChain([0, 0], 0.3, 1 / 30, 0.99 * 2 * np.pi * 30),
        Involute(60, 10, 0.95),
        ArcChain([0, 0], 0, [1 / 30, -1 / 30], [90, 90]),
    ],
    ids=["line", "less than a circle", "less than a turn of a spiral", "to and fro"],
)
def test_a_path_without_neighbouring_turns_has_no_spacing(path):
    assert spacing(path, path.position(np.linspace(0, path.length, 301))).distance.size == 0
    assert values(run_along(path)).spacing is None


def test_a_run_that_a_fault_ended_within_the_first_turn_has_no_spacing():
    whole = run_along(INVOLUTE)
    rows = {name: value[:1000] for name, value in vars(whole).items() if isinstance(value, np.ndarray)}
    faulted = Run(
        machine="none",
        axes=("x", "y"),
        units=("mm", "mm"),
        requested=INVOLUTE,
        period=PERIOD,
        gap=0.5,
        fault=Fault("following error", "x", 1.0, 2.0, 1.0, "mm"),
        **rows,
    )
    found = values(faulted)
    assert found.spacing is None
    assert found.duration == pytest.approx(0.999)
    assert found.contour.max == pytest.approx(0, abs=EXACT)


@pytest.mark.parametrize("stated", [True, False])
def test_values_of_a_perfect_follower(stated):
    found = values(run_along(INVOLUTE, stated=stated))
    assert found.spacing.mean == pytest.approx(10, abs=SPACING)
    assert found.spacing.std == pytest.approx(0, abs=SPACING)
    assert (found.spacing.min, found.spacing.max) == pytest.approx((10, 10), abs=SPACING)
    for spread in (*found.following.values(), found.following_along, found.program, found.contour):
        assert (spread.rms, spread.max) == pytest.approx((0, 0), abs=EXACT)
    assert found.speed.mean == pytest.approx(SPEED, rel=LAST_PERIOD)
    assert found.path_length == pytest.approx(INVOLUTE.length, rel=CHORD)
    assert found.path_length < INVOLUTE.length
    assert found.duration == pytest.approx(math.ceil(INVOLUTE.length / SPEED / PERIOD) * PERIOD, abs=1e-12)
    assert found.end_point == pytest.approx((40, 0, 0), abs=EXACT)


@pytest.mark.parametrize("error", [0.05, -0.3])
def test_a_constant_lateral_offset_of_the_nozzle_is_contour_error_alone(error):
    _, _, normal = along(INVOLUTE)
    found = values(run_along(INVOLUTE, nozzle=error * normal))
    assert (found.contour.rms, found.contour.max) == pytest.approx((abs(error), abs(error)), abs=EXACT)
    assert (found.program.max, found.following_along.max) == pytest.approx((0, 0), abs=EXACT)
    assert found.spacing.mean == pytest.approx(10, abs=SPACING)


def test_a_nozzle_lifted_off_the_plane_is_contour_error():
    found = values(run_along(INVOLUTE, nozzle=np.array([0, 0, 0.4])))
    assert (found.contour.rms, found.contour.max) == pytest.approx((0.4, 0.4), abs=EXACT)


def test_a_commanded_path_beside_the_requested_one_is_program_error():
    parallel = ArcChain([0, 0.2], 0, 1 / 29.8, 20)
    run = run_along(ArcChain([0, 0], 0, 1 / 30, 15))
    inside = parallel.position(np.linspace(0, 14, len(run.time)))
    shifted = Run(**{**vars(run), "commanded_tip": inside})
    found = values(shifted).program
    assert (found.rms, found.max) == pytest.approx((0.2, 0.2), abs=EXACT)


@pytest.mark.parametrize("lag", [0.2, -0.07])
def test_a_constant_lag_is_tracking_error_along_the_path(lag):
    _, tangent, _ = along(INVOLUTE)
    run = run_along(INVOLUTE, encoder=-lag * tangent)
    found = values(run)
    assert found.following_along.rms == pytest.approx(abs(lag), abs=EXACT)
    assert found.following_along.max == pytest.approx(abs(lag), abs=EXACT)
    # per axis: the lag times the cosine and the sine of the heading
    heading = 0.5 * np.pi - (60 - np.sqrt(60**2 - 10 / np.pi * along(INVOLUTE)[0])) / (10 / (2 * np.pi))
    for name, part in (("x", np.cos(heading)), ("y", np.sin(heading))):
        assert found.following[name].rms == pytest.approx(abs(lag) * np.sqrt(np.mean(part**2)), abs=1e-8)
        assert found.following[name].max == pytest.approx(abs(lag) * np.abs(part).max(), abs=1e-8)
    assert following_error(run) == pytest.approx(lag * tangent[:, :2], abs=EXACT)
    assert found.contour.max == pytest.approx(0, abs=EXACT)


def test_an_error_across_the_path_has_no_component_along_it():
    _, _, normal = along(INVOLUTE)
    assert values(run_along(INVOLUTE, encoder=0.2 * normal)).following_along.max == pytest.approx(0, abs=EXACT)


def test_a_steady_offset_of_one_axis_is_that_axis_alone():
    offset = 0.13
    found = values(run_along(INVOLUTE, encoder=np.array([0, -offset, 0]), nozzle=np.array([0, -offset, 0])))
    assert (found.following["x"].rms, found.following["x"].max) == pytest.approx((0, 0), abs=EXACT)
    assert (found.following["y"].rms, found.following["y"].max) == pytest.approx((offset, offset), abs=EXACT)
    # along a line it is the offset times the cosine of the angle between them, across it the sine
    line = ArcChain([0, 0], math.atan2(4, 3), 0, 50)
    found = values(run_along(line, encoder=np.array([0, -offset, 0])))
    assert (found.following_along.rms, found.following_along.max) == pytest.approx((0.8 * offset,) * 2, abs=EXACT)
    # a millimetre off the ends, so that every foot is square to the line
    run = run_along(line, nozzle=np.array([0, -offset, 0]), dispense=lambda s: (s > 1) & (s < 49))
    found = values(run)
    assert (found.contour.rms, found.contour.max) == pytest.approx((0.6 * offset,) * 2, abs=EXACT)


def test_errors_count_only_while_the_dispenser_is_on():
    s, tangent, normal = along(INVOLUTE)
    on = (s > 100) & (s < 900)
    error = np.where((s > 99) & (s < 901), 0.1, 3.0)[:, None]
    run = run_along(INVOLUTE, encoder=-error * tangent, nozzle=error * normal, dispense=lambda s: (s > 100) & (s < 900))
    found = values(run)
    assert (found.contour.rms, found.contour.max) == pytest.approx((0.1, 0.1), abs=EXACT)
    assert (found.following_along.rms, found.following_along.max) == pytest.approx((0.1, 0.1), abs=EXACT)
    assert max(found.following["x"].max, found.following["y"].max) <= 0.1 + EXACT
    assert found.speed.max < 1.01 * SPEED
    assert found.path_length == pytest.approx(np.ptp(s[on]), rel=CHORD)
    assert found.spacing.min == pytest.approx(10, abs=SPACING)
    # duration and end are those of the whole run
    assert found.duration == run.time[-1]
    assert found.end_point == pytest.approx(tuple(run.nozzle[-1]), abs=EXACT)


def test_path_speed_on_a_circle_is_that_of_the_chords_over_two_periods():
    radius, speed, period = 20.0, 200.0, 0.004
    circle = ArcChain([0, 0], 0, 1 / radius, 2 * np.pi * radius)
    run = run_along(circle, step=speed * period)
    run = Run(**{**vars(run), "time": np.arange(len(run.time)) * period, "period": period})
    found = path_speed(run)
    angle = speed * period / radius
    assert found[1:-2] == pytest.approx(np.full(len(found) - 3, speed * math.sin(angle) / angle), rel=1e-12)
    assert found[0] == pytest.approx(speed * math.sin(angle / 2) / (angle / 2), rel=1e-12)
    assert found[1:-2] == pytest.approx(speed, rel=angle**2 / 6)


def test_path_speed_counts_all_three_directions():
    line = ArcChain([0, 0], 0, 0, 1)
    run = run_along(line)
    climbing = Run(**{**vars(run), "nozzle": run.time[:, None] * np.array([20, -40, 40])})
    assert path_speed(climbing) == pytest.approx(np.full(len(run.time), 60), rel=1e-12)


def test_path_speed_of_a_single_sample_is_zero():
    run = run_along(ArcChain([0, 0], 0, 0, 1))
    rows = {name: value[:1] for name, value in vars(run).items() if isinstance(value, np.ndarray)}
    single = dataclasses.replace(run, **rows)
    assert path_speed(single).tolist() == [0]
    assert values(single).spacing is None


def test_error_size_and_range_by_hand():
    assert ErrorSize.of(np.array([3.0, -4.0])) == ErrorSize(rms=math.sqrt(12.5), max=4.0)
    found = Range.of(np.array([1.0, 2.0, 6.0]))
    assert (found.mean, found.min, found.max) == (3.0, 1.0, 6.0)
    assert found.std == pytest.approx(math.sqrt(14 / 3), rel=1e-15)


def test_a_run_that_never_dispenses_has_no_values():
    run = run_along(INVOLUTE, dispense=lambda s: np.zeros(s.shape, bool))
    with pytest.raises(InputError, match="the dispenser is never on"):
        values(run)


@pytest.mark.parametrize("off", [5.1, 8.0, -12.0])
def test_a_trace_with_a_large_error_stays_on_its_own_turn(off):
    _, _, normals = along(INVOLUTE)
    shifted = run_along(INVOLUTE, nozzle=off * normals, encoder=off * normals)
    found = values(shifted)
    assert found.contour.rms == pytest.approx(abs(off), rel=1e-9)
    assert found.spacing.min == pytest.approx(10, abs=1e-6)
    assert found.spacing.max == pytest.approx(10, abs=1e-6)


@pytest.mark.soak
def test_a_loop_whose_spiral_drifts_by_turns_keeps_its_local_pitch():
    spiral = MoveSpiral(120, 4, 10, 100, interpreter_time=0.02)
    trace = np.pad(spiral.setpoints(PERIOD).position, ((0, 0), (0, 1)))
    found = spacing(INVOLUTE, trace)
    # thickness / (1 + d / (T x)), at the ratio half way between the two turns
    turned = -np.cumsum(spiral.generated._kappa * spiral.generated._flat)
    ratio = np.interp((found.turn + 0.5) * 2 * np.pi, turned, spiral.ratios)
    assert found.distance == pytest.approx(10 / (1 + 0.02 / (0.1 * ratio)), rel=0.02)
    assert INVOLUTE.follow(trace).distance.max() > 8  # more than the half pitch that the nearest turn would say


def test_following_a_trace_agrees_with_projecting_it_near_the_path():
    path = archimedean(60, 10, 4)
    trace = path.position(np.linspace(0, path.length, 3001)) + np.array([0.3, -0.2, 0.1])
    assert path.follow(trace).s == pytest.approx(path.project(trace).s, abs=1e-9)


def test_a_closed_path_is_followed_from_its_start():
    circle = ArcChain([20, 0], np.pi / 2, [1 / 20], [40 * np.pi])
    s = np.linspace(0, circle.length, 500)
    assert circle.follow(circle.position(s)).s == pytest.approx(s, abs=1e-6)


def test_a_gap_of_the_dispenser_is_neither_length_nor_spacing():
    gap = lambda s: ~((s > 300) & (s < 400))  # noqa: E731
    analysis = Analysis(run_along(INVOLUTE, dispense=gap))
    found = analysis.values
    assert found.path_length == pytest.approx(INVOLUTE.length - 100, abs=0.3)
    assert found.spacing.mean == pytest.approx(10, abs=1e-6)
    # no spacing from the gap to its neighbours, on either side
    met = analysis.spacing
    assert not ((met.s > 300 + EXACT) & (met.s < 400 - EXACT)).any()
    heading = INVOLUTE.phi(np.array([300.0, 400.0])) / (2 * np.pi)
    before = (met.turn + 1 > heading[0] + 1e-3) & (met.turn + 1 < heading[1] - 1e-3)
    assert not before.any()


@pytest.mark.soak
def test_tight_archimedean_spirals_meet_their_next_turn_and_not_themselves():
    path = archimedean(40, 10, 3.5)
    found = spacing(path, path.position(np.arange(0, path.length, 0.05)))
    assert found.distance.min() > 9
    assert found.distance.max() < 10.2


@pytest.mark.parametrize("height", suite_runs([20.0, 2000.0, -2000.0], 1))
def test_the_spacing_of_a_climbing_trace_is_that_of_its_plan(height):
    """Laid c + e n with an e that drifts: a cone and the spiral below it have their feet at the same angles."""
    turns = 8 * math.pi
    flat, cone = (Chain([Coil((0, 0, 0), (60, 20), 0.0, turns, rise)]) for rise in (0.0, height))
    angle = np.linspace(0, turns, 3001)
    found = []
    for path, climb in ((flat, 0.0), (cone, height / turns)):
        s = arc_length(60, -40 / turns, math.hypot(40 / turns, climb), angle)
        trace = path.position(s) + (0.4 * np.sin(2.5 * angle) + 0.05 * angle)[:, None] * path.normal(s)
        found.append(spacing(path, trace))
    assert found[1].turn == pytest.approx(found[0].turn, abs=1e-6)
    assert found[1].distance == pytest.approx(found[0].distance, abs=2e-4)
    assert found[0].distance.std() > 0.1  # the drift shows


@pytest.mark.parametrize("plane", suite_runs([(XY,), (ZX,), (YZ,)], 1))
def test_spacing_is_taken_in_the_plane_of_the_spiral(plane):
    path = Chain([Coil((3, 4, 5), (60, 20), 0.3, 8 * math.pi, frame=plane)])
    found = spacing(path, path.position(np.linspace(0, path.length, 1501)))
    level = archimedean(60, 10, 4, clockwise=False)
    expected = spacing(level, level.position(np.linspace(0, level.length, 1501)))
    assert found.distance == pytest.approx(expected.distance, abs=1e-9)


def test_spacing_is_that_of_the_stretch_that_turns_furthest_one_way():
    """A lead-in that turns right, a spiral of three turns that turns left, and a lead-out to the right."""
    spiral = Coil((0, 0, 0), (40, 10), 0.0, 6 * math.pi)
    lead_in = Coil((50, 0, 0), (10, 10), 1.5 * math.pi, -0.5 * math.pi)  # ends at (40, 0)
    path = Chain([lead_in, spiral, Coil((20, 0, 0), (10, 10), math.pi, -0.5 * math.pi)])
    found = spacing(path, path.position(np.linspace(0, path.length, 2001)))
    alone = Chain([spiral])
    expected = spacing(alone, alone.position(np.linspace(0, alone.length, 2001)))
    assert found.distance.size > 0.9 * expected.distance.size
    assert found.distance.mean() == pytest.approx(expected.distance.mean(), abs=1e-3)
    assert [found.distance.min(), found.distance.max()] == pytest.approx(
        [expected.distance.min(), expected.distance.max()], abs=0.02
    )


def demanded(demand, dispense=None):
    """A run with these torque demands, (n, 2) [N·m]."""
    run = run_along(ArcChain((0.0, 0.0), 0.0, [0.0], [0.1 * (len(demand) - 1)]))
    assert len(run.demand) == len(demand)
    return dataclasses.replace(run, demand=demand, dispense=run.dispense if dispense is None else dispense)


def test_torque_ripple_of_white_noise_is_its_standard_deviation():
    noise = np.random.default_rng(1).normal(0.3, [0.02, 0.5], (20_000, 2))
    assert torque_ripple(demanded(noise)) == pytest.approx([0.02, 0.5], rel=NOISE)


def test_torque_ripple_of_an_alternating_and_of_a_constant_torque():
    alternating = 0.25 * (-1.0) ** np.arange(50)  # changes by 0.5
    run = demanded(np.column_stack([alternating, np.full(50, 0.7)]))
    assert torque_ripple(run) == pytest.approx([0.5 / math.sqrt(2), 0.0], rel=1e-12, abs=0)


def test_torque_ripple_of_a_ramp_is_its_change_in_a_tick():
    for ticks in (10, 1000):
        ramp = np.linspace(0, 0.9, ticks)
        assert torque_ripple(demanded(np.column_stack([ramp, -ramp]))) == pytest.approx(
            0.9 / (ticks - 1) / math.sqrt(2) * np.ones(2), rel=1e-12
        )


def test_torque_ripple_is_taken_between_ticks_that_both_dispense():
    """Jumps at the ends and across the gap do not count."""
    demand = np.array([9.0, 0.1, 0.2, 7.0, 7.0, 0.4, 0.7, -5.0])[:, None] * [1, 2]
    dispense = np.array([0, 1, 1, 0, 0, 1, 1, 0], bool)
    once = math.sqrt((0.1**2 + 0.3**2) / 2 / 2)
    assert torque_ripple(demanded(demand, dispense)) == pytest.approx([once, 2 * once], rel=1e-12)


def test_torque_ripple_of_single_ticks_is_zero_and_without_any_is_refused():
    demand = np.arange(10.0).reshape(5, 2)
    assert torque_ripple(demanded(demand, np.array([1, 0, 1, 0, 0], bool))).tolist() == [0, 0]
    with pytest.raises(InputError, match="the dispenser is never on in this run: nothing to measure"):
        torque_ripple(demanded(demand, np.zeros(5, bool)))
