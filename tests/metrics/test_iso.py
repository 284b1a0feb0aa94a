"""Values in the manner of ISO 230-4 and ISO 9283, against circles and scatters whose values are known."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brute

from gantrysim.base.errors import InputError
from gantrysim.metrics import CircularTest, RepeatedPath, Trace, least_squares_circle, minimum_zone, offset_over_length
from gantrysim.paths.chain import Chain
from gantrysim.paths.pieces import Coil

from support.soaked import examples

EXACT = 1e-9  # [mm]
ZONE = 1e-8  # [mm], against a search on a grid that is refined
REVERSAL = 1e-7  # [mm], of steps and spikes where there are none
SCATTER = 0.06  # relative, of the expectation of 3 sigma over so many cycles
RADIUS = 50.0
CENTRE = (0.0, 0.0)
ANGLES = np.linspace(0, 2 * np.pi, 3600, endpoint=False)


def round_trip(deviation=0.0, *, clockwise=False, shift=(0.0, 0.0), scale=(1.0, 1.0), begin=0.3):
    """Points of a circle with a radial deviation, an eccentricity, and axes of other scales."""
    theta = begin + (-1 if clockwise else 1) * ANGLES
    r = RADIUS + (deviation(theta % (2 * np.pi)) if callable(deviation) else deviation)
    return np.stack([scale[0] * r * np.cos(theta) + shift[0], scale[1] * r * np.sin(theta) + shift[1]], axis=1)


def traced(points):
    return Trace(points, CENTRE, RADIUS)


def backlash(width, clockwise, axis=0):
    """Points of a machine with one axis that lags half a backlash behind its motion."""
    theta = 0.3 + (-1 if clockwise else 1) * ANGLES
    points = RADIUS * np.stack([np.cos(theta), np.sin(theta)], axis=1)
    velocity = np.gradient(points[:, axis])
    points[:, axis] -= 0.5 * width * np.sign(velocity)
    return points


def test_an_eccentric_circle_has_no_circular_deviation_but_a_radial_one():
    trace = traced(round_trip(0.004, shift=(0.03, -0.04)))
    assert least_squares_circle(trace.points)[0] == pytest.approx((0.03, -0.04), abs=EXACT)
    assert least_squares_circle(trace.points)[1] == pytest.approx(RADIUS + 0.004, abs=EXACT)
    assert trace.circular_deviation == pytest.approx(0, abs=EXACT)
    assert trace.deviation.max() == pytest.approx(0.004 + 0.05, abs=1e-7)
    assert trace.deviation.min() == pytest.approx(0.004 - 0.05, abs=3e-5)


@pytest.mark.parametrize("mismatch", [1e-5, 4e-4])
def test_axes_of_different_scale_make_an_ellipse_whose_deviation_is_the_difference_of_its_half_axes(mismatch):
    trace = traced(round_trip(scale=(1 + mismatch, 1 - mismatch), shift=(0.01, 0.02)))
    assert trace.circular_deviation == pytest.approx(2 * mismatch * RADIUS, rel=1e-6)
    zone = minimum_zone(trace.points)
    assert zone.centre == pytest.approx((0.01, 0.02), abs=1e-7)
    assert (zone.inner, zone.outer) == pytest.approx((RADIUS * (1 - mismatch), RADIUS * (1 + mismatch)), abs=1e-7)


@pytest.mark.parametrize("lobes", [2, 3, 5, 7])
def test_even_lobes_have_the_double_amplitude(lobes):
    points = round_trip(lambda theta: 0.002 * np.cos(lobes * theta), shift=(0.1, 0.0))
    assert minimum_zone(points).width == pytest.approx(0.004, abs=1e-6)


@pytest.mark.validates(
    "circular deviation (minimum zone)",
    "search on a refined grid",
    "1e-8 mm",
)
@examples(15)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(8, 200),
    st.floats(1e-5, 1e-1),
)
def test_the_minimum_zone_is_that_of_a_search_by_brute_force(seed, count, size):
    generator = np.random.default_rng(seed)
    theta = np.linspace(0, 2 * np.pi, count, endpoint=False)
    r = RADIUS + size * generator.uniform(-1, 1, count) + 2 * size * np.cos(theta - 1)
    points = np.stack([r * np.cos(theta), r * np.sin(theta)], axis=1)

    def width(centre):
        return np.ptp(np.linalg.norm(points - centre, axis=1))

    zone = minimum_zone(points)
    middle, reach = np.array(least_squares_circle(points)[0]), 4 * size
    for _ in range(12):  # the grid draws together about its best point
        middle = brute(width, [(c - reach, c + reach) for c in middle], Ns=13, finish=None)
        reach *= 0.35
    assert zone.width <= width(middle) + ZONE * size
    assert zone.width == pytest.approx(width(middle), rel=0.02)
    assert zone.width == pytest.approx(width(zone.centre), abs=EXACT)
    assert zone.width <= width(least_squares_circle(points)[0]) + EXACT


def scattered(seed):
    generator = np.random.default_rng(seed)
    return generator.uniform(-50, 50, (generator.integers(4, 9), 2))


def rough(seed):
    generator = np.random.default_rng(seed)
    return round_trip(lambda theta: generator.normal(0, 0.002, theta.size), shift=(0.05, 0.01))


@pytest.mark.parametrize("points", [*map(scattered, range(12)), *map(rough, range(3))])
def test_the_minimum_zone_is_a_local_minimum_for_any_points(points):
    zone = minimum_zone(points)

    def width(centre):
        return np.ptp(np.linalg.norm(points - centre, axis=1))

    around = [
        h * np.array([math.cos(t), math.sin(t)]) for t in np.linspace(0, 2 * np.pi, 90) for h in (1e-5, 1e-4, 1e-2)
    ]
    assert zone.width <= min(width(zone.centre + step) for step in around) + EXACT
    assert zone.width <= width(least_squares_circle(points)[0]) + EXACT


def test_the_gradient_vanishes_at_the_least_squares_circle():
    generator = np.random.default_rng(3)
    points = round_trip(lambda theta: 0.1 * generator.uniform(-1, 1, theta.size))
    (x, y), r = least_squares_circle(points)
    out = points - (x, y)
    distance = np.linalg.norm(out, axis=1)
    assert (distance - r).sum() == pytest.approx(0, abs=1e-6)
    assert ((distance - r)[:, None] * out / distance[:, None]).sum(axis=0) == pytest.approx([0, 0], abs=1e-6)


@pytest.mark.parametrize("clockwise", [False, True])
@pytest.mark.parametrize("axis", [0, 1])
def test_backlash_is_a_step_at_the_reversals_of_its_axis_only(clockwise, axis):
    trace = traced(backlash(0.01, clockwise, axis))
    assert trace.clockwise is clockwise
    reversals = trace.reversals()
    assert [(reversal.axis, reversal.angle) for reversal in reversals] == [(0, 0), (1, 90), (0, 180), (1, 270)]
    for reversal in reversals:
        assert reversal.step == pytest.approx(0.01 if reversal.axis == axis else 0, abs=1e-5)
        assert reversal.spike == pytest.approx(0, abs=1e-5)


def test_ovality_and_a_squareness_error_are_no_steps():
    def smooth(theta):
        return 0.005 * np.cos(2 * theta) + 0.005 * np.sin(2 * theta) + 0.01 * np.cos(theta + 0.4)

    for reversal in traced(round_trip(smooth)).reversals():
        assert reversal.step == pytest.approx(0, abs=REVERSAL)
        assert reversal.spike == pytest.approx(0, abs=REVERSAL)


@pytest.mark.parametrize("clockwise", [False, True])
def test_height_and_place_of_a_spike_are_independent_of_the_step(clockwise):
    points = backlash(0.003, clockwise, axis=1)
    angle = np.degrees(np.arctan2(points[:, 1], points[:, 0]))
    since = (-1 if clockwise else 1) * (angle - 90)
    points *= 1 + 0.008 / RADIUS * np.exp(-(((since - 5) / 1.5) ** 2))[:, None]
    reversals = traced(points).reversals()
    assert reversals[1].spike == pytest.approx(0.008, rel=2e-3)
    assert reversals[1].spike_at == pytest.approx(5, abs=0.1)
    assert [reversal.step for reversal in reversals] == pytest.approx([0, 0.003, 0, 0.003], abs=1e-5)
    assert [reversal.spike for reversal in reversals if reversal.angle != 90] == pytest.approx([0, 0, 0], abs=1e-5)


def test_steps_of_one_axis_may_differ_between_its_ends():
    """A backlash only where x is positive."""
    points = backlash(0.01, False)
    other = round_trip()
    right = points[:, 0] > 0
    reversals = traced(np.where(right[:, None], points, other)).reversals()
    assert [reversal.step for reversal in reversals] == pytest.approx([0.01, 0, 0, 0], abs=1e-4)


def test_a_dent_is_a_negative_spike():
    def dent(theta):
        since = (np.degrees(theta) - 180 + 180) % 360 - 180
        return -0.006 * np.exp(-(((since - 4) / 1.0) ** 2))

    assert traced(round_trip(dent)).reversals()[2].spike == pytest.approx(-0.006, rel=0.02)


def test_bidirectional_values_of_two_circles_of_different_size():
    test = CircularTest(traced(round_trip(0.006, clockwise=True)), traced(round_trip(-0.002)))
    assert test.clockwise.circular_deviation == pytest.approx(0, abs=EXACT)
    assert test.counter_clockwise.circular_deviation == pytest.approx(0, abs=EXACT)
    assert test.bidirectional_circular_deviation == pytest.approx(0.008, abs=EXACT)
    assert test.mean_bidirectional_radial_deviation == pytest.approx(0.002, abs=EXACT)


def test_backlash_in_both_directions():
    """Each path is shifted by half the backlash; both together show all of it."""
    test = CircularTest(*(traced(backlash(0.01, clockwise)) for clockwise in (True, False)))
    assert test.counter_clockwise.circular_deviation == pytest.approx(0.01, rel=0.01)
    assert test.bidirectional_circular_deviation == pytest.approx(0.01, rel=0.01)
    assert test.mean_bidirectional_radial_deviation == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize(
    ("build", "text"),
    [
        (lambda: minimum_zone(np.zeros((2, 2))), r"points of shape \(2, 2\): must be \(n, 2\) with at least three"),
        (lambda: minimum_zone([[0, 0], [1, 1], [2, 2], [3, 3]]), "must be at least three that do not lie on one line"),
        (lambda: traced(round_trip()[:3000]), "leaves out 60.1 deg of the circle, must be at most 5 deg"),
        (lambda: Trace(round_trip(), CENTRE, 0.0), "radius = 0 mm: must be greater than 0 mm"),
        (
            lambda: CircularTest(traced(round_trip()), traced(round_trip())),
            "must have one path clockwise and one counter-clockwise",
        ),
        (
            lambda: CircularTest(traced(round_trip(clockwise=True)), Trace(round_trip(), (0.1, 0.0), RADIUS)),
            "both paths must have one nominal circle",
        ),
        (
            lambda: RepeatedPath(np.zeros(4), np.zeros((4, 3)), np.zeros((2, 5, 3))),
            r"attained paths of shape \(2, 5, 3\): must be \(n, 4, 3\), as the command",
        ),
        (
            lambda: RepeatedPath(np.zeros(4), np.zeros((4, 3)), np.zeros((1, 4, 3))),
            "1 attained path: must be at least 2, for a scatter",
        ),
    ],
)
def test_input_without_defined_values_is_refused(build, text):
    with pytest.raises(InputError, match=text):
        build()


def repeats(count, places, offset, sigma, seed=0):
    """Attained points about a straight command, with an offset and a normal scatter perpendicular to it."""
    generator = np.random.default_rng(seed)
    s = np.linspace(0, 100, places)
    command = np.stack([s, np.zeros(places), np.zeros(places)], axis=1)
    scatter = np.zeros((count, places, 3))
    scatter[:, :, 1:] = generator.normal(0, sigma, (count, places, 2))
    return RepeatedPath(s, command, command + offset + scatter)


def test_identical_repeats_have_no_scatter_and_the_accuracy_of_each():
    path = repeats(5, 20, np.array([0, 0.03, 0.04]), 0.0)
    assert path.path_repeatability == pytest.approx(0, abs=1e-12)
    assert path.path_accuracy == pytest.approx(0.05, abs=1e-12)


def test_repeatability_by_hand():
    command = np.zeros((2, 3))
    attained = np.zeros((3, 2, 3))
    attained[:, 1, 1] = [0.0, 1.0, 5.0]  # barycentre 2, distances 2, 1, 3: mean 2, standard deviation 1
    path = RepeatedPath(np.array([0.0, 1.0]), command, attained)
    assert path.repeatability == pytest.approx([0, 2 + 3])
    assert path.path_repeatability == pytest.approx(5)
    assert path.accuracy == pytest.approx([0, 2])
    assert path.path_accuracy == pytest.approx(2)


def test_repeatability_of_normal_scatter_is_that_of_rayleigh_distances():
    """Distances of a normal scatter in a plane: mean sigma sqrt(pi/2), variance sigma^2 (2 - pi/2)."""
    sigma = 0.01
    path = repeats(400, 300, np.array([0, 0.1, 0]), sigma)
    expected = sigma * (math.sqrt(math.pi / 2) + 3 * math.sqrt(2 - math.pi / 2))
    assert np.median(path.repeatability) == pytest.approx(expected, rel=SCATTER)
    assert path.accuracy == pytest.approx(0.1, abs=5 * sigma / math.sqrt(400))
    assert path.path_repeatability == path.repeatability.max()
    assert path.path_accuracy == path.accuracy.max()


def arc():
    return Chain([Coil((0.0, 0.0, 0.0), (40.0, 40.0), 0.0, math.pi)])


def test_traces_are_compared_in_planes_normal_to_the_path():
    """Two arcs, larger and smaller, sampled differently: their barycentre is the command everywhere."""
    path = arc()
    traces = []
    for count, radius, begin, end in ((400, 40.02, 0.0, math.pi), (331, 39.98, 0.05, 0.97 * math.pi)):
        theta = np.linspace(begin, end, count)
        traces.append(radius * np.stack([np.cos(theta), np.sin(theta), np.zeros(count)], axis=1))
    result = RepeatedPath.of(path, traces, 50)
    assert result.s[[0, -1]] == pytest.approx([40 * 0.05, 40 * 0.97 * math.pi], abs=1e-6)
    assert result.accuracy == pytest.approx(np.zeros(50), abs=1e-5)
    assert np.linalg.norm(result.attained[0] - result.command, axis=1) == pytest.approx(np.full(50, 0.02), abs=1e-5)
    assert result.repeatability == pytest.approx(np.full(50, 0.02), abs=1e-5)


def test_points_where_a_trace_goes_back_are_left_out():
    theta = np.concatenate([np.linspace(0, 1, 100), np.linspace(1, 0.8, 20), np.linspace(0.8, 2, 120)])
    s, offset = offset_over_length(arc(), 40.01 * np.stack([np.cos(theta), np.sin(theta), 0 * theta], axis=1))
    assert np.all(np.diff(s) > 0)
    assert np.linalg.norm(offset, axis=1) == pytest.approx(np.full(s.size, 0.01), abs=1e-6)
