"""The fastest law along a path within limits of the feed and of the axes."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog
from scipy.sparse import coo_array

from gantrysim.base.errors import InputError
from gantrysim.paths.arcs import ArcChain
from gantrysim.paths.chain import Chain
from gantrysim.paths.limits import Derivatives, Limited, fastest, nodes
from gantrysim.paths.pieces import Coil, Line

from support.soaked import examples

IN_HAND = 1e-3  # of an acceleration limit, kept for what lies between the nodes
# Between nodes 0.02 mm apart, along waves of 15 mm and more, relative:
VELOCITY = 3e-3  # by which an axis' velocity may pass its limit
ACCELERATION = 2e-3  # by which an axis' acceleration may pass its limit
FEASIBLE = 1e-7  # by which a law may pass a limit at the nodes themselves, relative
OPTIMUM = 0.03  # by which the sum of the squared speeds may fall short of a linear programme's, relative
USUAL = 1e-3  # of 95 in 100
# What a law takes longer than without the bound at constant speed, relative
MEDIAN_COST = 3e-3
USUAL_COST = 0.01  # of nine out of ten
TIME = 1e-4  # of a duration whose switching point lies between two nodes, relative
WAY = 1e-9  # [mm]
H = 1e-5  # step of finite differences, of the duration


def straight(length, speed, acceleration, step=0.01, velocity=math.inf, **ends):
    """The law along a line of one axis."""
    s = nodes([length], step)[0]
    rate = np.ones((s.size, 1))
    return fastest(Derivatives(s, rate, 0 * rate), speed, [velocity], [acceleration], **ends)


class Waves:
    """Axes q(s) that are sums of sines of the way: smooth, with derivatives in closed form."""

    def __init__(self, amplitude, wave, phase):
        self.amplitude, self.wave, self.phase = amplitude, 2 * math.pi / wave, phase

    def _sum(self, factor, function, s):
        angle = self.wave * np.asarray(s, float)[:, None, None] + self.phase
        return (self.amplitude * factor * function(angle)).sum(axis=2)

    def position(self, s):
        return self._sum(1.0, np.sin, s)

    def rate(self, s):
        return self._sum(self.wave, np.cos, s)

    def bend(self, s):
        return -self._sum(self.wave**2, np.sin, s)


def random_waves(random, axes):
    shape = axes, 3
    return Waves(random.uniform(-8, 8, shape), random.uniform(15, 80, shape), random.uniform(-3, 3, shape))


@st.composite
def waves(draw, axes=3):
    return random_waves(np.random.default_rng(draw(st.integers(0, 2**31))), draw(st.integers(1, axes)))


def axes_of(path, s, piece=None):
    """Derivatives of x, y, z over the way of a plane path; at joints from within each piece."""
    at = s
    if piece is not None:
        edges = np.concatenate([[0.0], path.ends])
        at = np.clip(s, edges[piece] + 1e-9, edges[piece + 1] - 1e-9)
    return path.tangent(at), path.local(at).curvature


def moved(law, position, velocity, acceleration):
    """Largest share of every velocity and acceleration limit that differences of sampled positions take."""
    h = H * law.duration
    q = position(law.position(np.arange(2 * h, law.duration - 2 * h, h)))
    speed = np.diff(q, axis=0) / h
    change = np.diff(q, 2, axis=0) / h**2
    with np.errstate(invalid="ignore"):
        return np.nanmax(np.abs(speed) / velocity), np.nanmax(np.abs(change) / acceleration)


def programme(s, top, rate, bend, limit):
    """Squares of the speeds, the largest everywhere, by a linear programme over the nodes.

    Between two nodes u = (x[k+1] - x[k]) / (2 ds), and |q' u + q'' x| is at most the limit at both of them.
    """
    m, axes = rate.shape
    twice = 2 * np.diff(s)
    k, scale = np.arange(m - 1), np.abs(limit)
    rows, bounds = [], []
    for i in range(axes):
        for node in (k, k + 1):
            for sign in (1, -1):
                slope = sign * rate[node, i] / twice
                low, high = -slope, slope.copy()
                (low if node is k else high)[:] += sign * bend[node, i]
                rows.append((low / scale[i], high / scale[i]))
                bounds.append(np.ones(m - 1))
    count = len(rows)
    row = np.tile(np.arange(count * (m - 1)).reshape(count, m - 1), 2).ravel()
    low, high = (np.array([pair[side] for pair in rows]) for side in (0, 1))
    values = np.concatenate([low, high], axis=1).ravel()
    columns = np.tile(np.concatenate([k, k + 1]), count)
    matrix = coo_array((values, (row, columns)), shape=(count * (m - 1), m))
    found = linprog(
        -np.ones(m),
        A_ub=matrix.tocsr(),
        b_ub=np.concatenate(bounds),
        bounds=np.stack([np.zeros(m), top], axis=1),
        method="highs",
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )
    assert found.status == 0, found.message
    return np.maximum(found.x, 0)


@given(st.floats(0.1, 500), st.floats(1, 300), st.floats(50, 5000))
@examples(100)
def test_a_line_from_rest_to_rest_is_a_trapezoid(length, speed, acceleration):
    law = straight(length, speed, acceleration, step=length / 4000)
    a = acceleration * (1 - IN_HAND)
    shortest = length / speed + speed / a if speed**2 / a <= length else 2 * math.sqrt(length / a)
    # each of the two ramps ends at a node, at most a step late
    assert shortest * (1 - 1e-9) <= law.duration <= shortest * (1 + TIME) + 2 * length / 4000 / speed
    t = np.linspace(0, law.duration, 500)
    shape = np.minimum(np.minimum(a * t, speed), a * (law.duration - t))
    assert np.all(law.velocity(t) <= shape * (1 + 1e-6) + 1e-6 * speed)
    assert law.length == length


def test_each_limit_bites():
    free = straight(100, 50, math.inf)
    assert free.duration == pytest.approx(2.0, rel=1e-12)
    assert straight(100, 50, math.inf, velocity=40).duration == pytest.approx(2.5, rel=1e-12)
    assert straight(100, 50, math.inf, velocity=60).duration == pytest.approx(2.0, rel=1e-12)
    assert straight(100, 50, 1000).duration == pytest.approx(2.05, rel=TIME)
    assert straight(100, 50, 500).duration == pytest.approx(2.1, rel=TIME)
    assert straight(100, math.inf, 500, velocity=50).duration == pytest.approx(2.1, rel=TIME)
    assert straight(100, math.inf, 500).duration == pytest.approx(2 * math.sqrt(100 / 500), rel=1e-3)


def test_axis_that_takes_half_the_way_has_half_the_limit_to_spare():
    s = nodes([100.0], 0.01)[0]
    rate = np.tile([0.8, -0.6], (s.size, 1))
    both = fastest(Derivatives(s, rate, 0 * rate), 1000.0, [40, 60], [400, 1e9])
    only = fastest(Derivatives(s, rate[:, :1], 0 * rate[:, :1]), 1000.0, [40], [400])
    assert both.duration == pytest.approx(100 / 50 + 50 / 500 / (1 - IN_HAND), rel=TIME)
    assert both.duration == pytest.approx(only.duration, rel=1e-12)
    unlimited = fastest(Derivatives(s, rate, 0 * rate), 50.0, [math.inf] * 2, [400, math.inf])
    assert unlimited.duration == pytest.approx(both.duration, rel=1e-9)


def test_full_turns_of_a_circle_are_no_faster_than_its_centripetal_acceleration():
    """v^2 / r <= a where an axis turns back; a tangential acceleration would take from the other axis."""
    radius, a = 20.0, 900.0
    path = ArcChain((radius, 0), math.pi / 2, 1 / radius, 6 * math.pi * radius)
    s, piece = nodes(path.ends, 0.02)
    rate, bend = (value[:, :2] for value in axes_of(path, s, piece))
    law = fastest(Derivatives(s, rate, bend), 1000.0, [math.inf] * 2, [a, a])
    best = math.sqrt(a * radius)
    # where the tangent is along an axis, the other takes all of the centripetal acceleration
    quarters = 0.5 * math.pi * radius * np.arange(2, 11)
    speed = np.array([law.velocity(law.time_at(at)) for at in quarters])
    assert np.all(speed <= best * (1 + 1e-9))
    assert speed == pytest.approx(np.full(9, best), rel=2 * IN_HAND)
    assert law.duration < 6 * math.pi * radius / best + 2 * best / a
    velocity, acceleration = moved(law, lambda at: path.position(at)[:, :2], math.inf, a)
    assert 1 - 2 * IN_HAND < acceleration <= 1 + ACCELERATION
    assert velocity == 0
    # the feed alone
    slow = fastest(Derivatives(s, rate, bend), 50.0, [math.inf] * 2, [a, a])
    assert slow.slowest[0] == pytest.approx(50, rel=1e-12)
    assert slow.duration == pytest.approx(6 * math.pi * radius / 50 + 50 / a, rel=1e-3)


def test_a_halt_at_a_corner_cuts_the_path_in_two():
    path = Chain([Line((0, 0, 0), (30, 0, 0)), Line((30, 0, 0), (30, 40, 0))])
    s, piece = nodes(path.ends, 0.01)
    rate, bend = axes_of(path, s, piece)
    corner = s == 30
    assert corner.sum() == 2
    law = fastest(Derivatives(s, rate, bend), np.where(corner, 0.0, 50.0), [math.inf] * 3, [500, 1000, math.inf])
    parts = 30 / 50 + 50 / 500 + 40 / 50 + 50 / 1000
    assert law.duration == pytest.approx(parts, rel=2e-4)
    assert law.velocity(law.time_at(30.0)) == pytest.approx(0, abs=1e-9)
    assert law.slowest == (0.0, 30.0)
    assert law.time_at(30.0) == pytest.approx(30 / 50 + 50 / 500, rel=1e-3)
    through = fastest(Derivatives(s, rate, bend), 50.0, [math.inf] * 3, [500, 1000, math.inf])
    assert through.duration < law.duration


def test_a_line_into_an_arc_brakes_before_it():
    """v^2 = a r in the arc from its first point on, and before it v^2 falls with 2 a."""
    radius, a = 5.0, 400.0
    path = Chain([Line((0, 0, 0), (50, 0, 0)), Coil((50, radius, 0), (radius, radius), -math.pi / 2, math.pi)])
    s, piece = nodes(path.ends, 0.01)
    rate, bend = axes_of(path, s, piece)
    law = fastest(Derivatives(s, rate, bend), 1000.0, [math.inf] * 3, [a] * 3, end=math.sqrt(a * radius))
    corner = law.velocity(law.time_at(50.0))
    assert corner == pytest.approx(math.sqrt(a * radius), rel=IN_HAND)
    before = law.velocity(law.time_at(45.0))
    assert before**2 == pytest.approx(corner**2 + 2 * a * 5, rel=3e-3)
    _, acceleration = moved(law, path.position, math.inf, a)
    assert acceleration <= 1 + ACCELERATION


@given(
    path=waves(),
    length=st.floats(30, 150),
    speed=st.floats(20, 300),
    seed=st.integers(0, 2**31),
)
@examples(30)
def test_axes_stay_within_random_limits_along_random_smooth_paths(path, length, speed, seed):
    random = np.random.default_rng(seed)
    axes = path.amplitude.shape[0]
    velocity, acceleration = random.uniform(20, 300, axes), 10 ** random.uniform(2, 3.7, axes)
    if axes > 1 and seed % 3 == 0:
        velocity[0] = acceleration[-1] = math.inf
    s = nodes([length], 0.02)[0]
    law = fastest(Derivatives(s, path.rate(s), path.bend(s)), speed, velocity, acceleration)
    used_velocity, used_acceleration = moved(law, path.position, velocity, acceleration)
    assert used_velocity <= 1 + VELOCITY
    assert used_acceleration <= 1 + ACCELERATION
    t = np.linspace(0, law.duration, 5001)
    assert law.velocity(t).max() <= speed * (1 + 1e-12)
    assert np.diff(law.position(t)).min() >= 0
    # but for the intervals in which one limit takes over from another, some limit is met at one of their ends
    v = law.velocity(np.array([law.time_at(at) for at in s]))[:, None]
    u = np.diff(v**2, axis=0) / (2 * np.diff(s)[:, None])
    rate, bend = path.rate(s), path.bend(s)
    steady = np.concatenate([v / speed, np.abs(rate) * v / velocity, np.abs(bend) * v**2 / acceleration], axis=1)
    used = np.maximum(steady[:-1].max(axis=1), steady[1:].max(axis=1))
    for k in (slice(None, -1), slice(1, None)):
        used = np.maximum(used, (np.abs(rate[k] * u + bend[k] * v[k] ** 2) / acceleration).max(axis=1))
    assert np.mean(used >= 1 - 2 * IN_HAND) > 0.95


def shortfall(path, length, speed, seed):
    """By which share a law's sum of squared speeds is less than a linear programme's under the same rules."""
    random = np.random.default_rng(seed)
    axes = path.amplitude.shape[0]
    velocity, acceleration = random.uniform(20, 300, axes), 10 ** random.uniform(2, 3.7, axes)
    begin, end = random.choice([0.0, 1.0, 5.0], 2)
    s = np.linspace(0, length, 301)
    rate, bend = path.rate(s), path.bend(s)
    law = fastest(Derivatives(s, rate, bend), speed, velocity, acceleration, begin, end)
    x = law.velocity(np.array([law.time_at(at) for at in s])) ** 2
    feed = np.minimum(speed**2, ((velocity / np.abs(rate)) ** 2).min(axis=1))
    feed[0], feed[-1] = min(feed[0], begin**2), min(feed[-1], end**2)
    limit = acceleration * (1 - IN_HAND)
    steady = np.minimum(feed, (limit / np.abs(bend)).min(axis=1))
    # the law keeps the rules at both nodes of every interval
    u = (np.diff(x) / (2 * np.diff(s)))[:, None]
    assert np.all(x <= steady * (1 + FEASIBLE) + 1e-12)
    for node in (slice(None, -1), slice(1, None)):
        assert np.all(np.abs(rate[node] * u + bend[node] * x[node, None]) <= limit * (1 + FEASIBLE))
    return 1 - x.sum() / programme(s, steady, rate, bend, limit).sum()


@given(path=waves(), length=st.floats(30, 150), speed=st.floats(20, 300), seed=st.integers(0, 2**31))
@examples(30)
def test_no_profile_on_the_same_nodes_is_faster(path, length, speed, seed):
    assert -FEASIBLE <= shortfall(path, length, speed, seed) <= OPTIMUM


@pytest.mark.soak
def test_hardly_any_profile_on_the_same_nodes_is_faster_at_all():
    found = []
    for seed in range(100):
        random = np.random.default_rng(seed)
        path = random_waves(random, random.integers(1, 4))
        found.append(shortfall(path, random.uniform(30, 150), random.uniform(20, 300), seed))
    assert min(found) >= -FEASIBLE
    assert np.quantile(found, 0.95) <= USUAL
    assert max(found) <= OPTIMUM


def test_the_cost_of_the_bound_at_constant_speed():
    """Along 40 paths: nothing to speak of as a rule; a sharp bend may be passed faster by a law that brakes in it."""
    cost = []
    for seed in range(40):
        random = np.random.default_rng(seed)
        path = random_waves(random, axes := random.integers(1, 4))
        acceleration = 10 ** random.uniform(2, 3.7, axes)
        speed, s = random.uniform(20, 300), np.linspace(0, 60, 301)
        law = fastest(Derivatives(s, path.rate(s), path.bend(s)), speed, [math.inf] * axes, acceleration)
        feed = np.full(s.size, speed**2)
        feed[[0, -1]] = 0.0
        freest = Limited(s, np.sqrt(programme(s, feed, path.rate(s), path.bend(s), acceleration)))
        cost.append(law.duration / freest.duration - 1)
    assert min(cost) >= -1e-6
    assert np.median(cost) < MEDIAN_COST
    assert np.quantile(cost, 0.9) < USUAL_COST


@given(path=waves(), length=st.floats(5, 100), speed=st.floats(20, 300), seed=st.integers(0, 2**31))
@examples(50)
def test_the_time_of_a_distance_is_the_inverse_of_the_distance_at_a_time(path, length, speed, seed):
    s = nodes([0.4 * length, length], 0.1)[0]
    halts = np.where(s == s[np.searchsorted(s, 0.4 * length)], 0.0, speed)
    law = fastest(
        Derivatives(s, path.rate(s), path.bend(s)),
        halts,
        [math.inf] * path.amplitude.shape[0],
        [900.0] * path.amplitude.shape[0],
    )
    asked = np.concatenate([np.random.default_rng(seed).uniform(0, length, 50), s])
    t = np.array([law.time_at(at) for at in asked])
    assert law.position(t) == pytest.approx(asked, abs=WAY)
    assert law.time_at(0.0) == 0
    assert law.time_at(length) == pytest.approx(law.duration, rel=1e-12)
    times = np.linspace(0, law.duration, 100)
    moving = law.velocity(times) > 1e-3 * speed
    back = np.array([law.time_at(at) for at in law.position(times)])
    assert back[moving] == pytest.approx(times[moving], abs=1e-9)
    # speed is the slope of the way
    middle = times[:-1][moving[:-1]]
    h = 1e-7 * law.duration
    slope = (law.position(middle + h) - law.position(middle)) / h
    assert slope == pytest.approx(law.velocity(middle + 0.5 * h), abs=1e-4 * speed)


def test_position_is_constant_before_the_start_and_after_the_end():
    law = straight(10, 50, 500)
    T = law.duration  # noqa: N806
    assert law.position([-1, 0, T, T + 1]) == pytest.approx([0, 0, 10, 10], abs=WAY)
    assert law.velocity([-1, 0, T, T + 1]) == pytest.approx([0, 0, 0, 0], abs=1e-6)
    moving = straight(10, 50, 500, begin=50, end=50)
    assert moving.velocity([-1, 0, moving.duration + 1]).tolist() == [0, 50, 0]


def test_begins_and_ends_at_the_requested_speeds():
    a = 500 * (1 - IN_HAND)
    law = straight(100, 50, 500, begin=20, end=30)
    assert law.velocity([0, law.duration]) == pytest.approx([20, 30], rel=1e-12)
    assert law.duration == pytest.approx(
        30 / a + 20 / a + (100 - (50**2 - 20**2) / 2 / a - (50**2 - 30**2) / 2 / a) / 50, rel=TIME
    )
    # an end speed that cannot be reached is not
    short = straight(1, 50, 500, end=50)
    assert short.velocity(short.duration) == pytest.approx(math.sqrt(2 * a), rel=1e-9)
    # without any acceleration limit neither is looked at
    assert straight(100, 50, math.inf, begin=20).velocity(0) == 50


def test_an_initial_speed_too_high_to_brake_is_refused():
    most = math.sqrt(2 * 500 * (1 - IN_HAND))
    assert straight(1, 50, 500, begin=most).velocity(0) == pytest.approx(most, rel=1e-9)
    with pytest.raises(InputError, match=r"^speed at the start = 32 mm/s: must be at most 31\.6\d* mm/s$"):
        straight(1, 50, 500, begin=32)
    with pytest.raises(InputError, match=r"^speed at the start = 60 mm/s: must be at most 50 mm/s$"):
        straight(100, 50, 500, begin=60)


def test_limits_that_allow_no_motion_are_refused():
    s = nodes([5.0, 10.0], 0.5)[0]
    rate = np.ones((s.size, 1))
    for speed, velocity, acceleration, place in (
        (0.0, math.inf, 500, "0"),
        (np.where(s >= 5, 0.0, 20.0), math.inf, 500, "5"),
        (20.0, 0.0, 500, "0"),
        (20.0, math.inf, 0.0, "0"),
    ):
        with pytest.raises(
            InputError, match=rf"^speed = 0 mm/s at {place} mm of the path: the limits allow no motion$"
        ):
            fastest(Derivatives(s, rate, 0 * rate), speed, [velocity], [acceleration])


def test_a_path_without_any_limit_is_refused():
    s = nodes([5.0, 10.0], 0.5)[0]
    rate = np.stack([s <= 5, s > 5], axis=1).astype(float)
    with pytest.raises(InputError, match=r"^speed = inf mm/s at 6 mm of the path: must be finite$"):
        fastest(Derivatives(s, rate, 0 * rate), math.inf, [math.inf] * 2, [500, math.inf])
    with pytest.raises(InputError, match=r"^speed = inf mm/s at 0 mm of the path: must be finite$"):
        fastest(Derivatives(s, rate, 0 * rate), math.inf, [math.inf] * 2, [math.inf] * 2)


def test_the_limit_of_a_stationary_axis_has_no_effect():
    s = nodes([10.0], 0.05)[0]
    rate = np.tile([1.0, 0.0], (s.size, 1))
    law = fastest(Derivatives(s, rate, 0 * rate), 20.0, [math.inf, 0.0], [math.inf, 0.0])
    assert law.duration >= 0.5
    assert law.position(law.duration) == pytest.approx(10, abs=WAY)


@given(st.lists(st.floats(1e-7, 1e-3), min_size=1, max_size=30), st.booleans())
@examples(50)
def test_very_short_pieces_are_traversed(lengths, halts):
    ends = np.cumsum(lengths)
    s = nodes(ends, 0.05)[0]
    rate = np.ones((s.size, 1))
    joint = np.isin(s, ends[:-1])
    law = fastest(Derivatives(s, rate, 0 * rate), np.where(joint & halts, 0.0, 100.0), [math.inf], [1000.0])
    a = 1000 * (1 - IN_HAND)
    parts = lengths if halts else [ends[-1]]
    expected = sum(2 * math.sqrt(part / a) for part in parts)
    # the switching point of eight intervals lies on a node; of pieces of unlike lengths between two
    assert law.duration == pytest.approx(expected, rel=1e-9 if halts else 0.05)
    assert np.isfinite(law.position(np.linspace(0, law.duration, 100))).all()
    assert law.position(law.duration) == pytest.approx(ends[-1], rel=1e-12)


@given(
    st.lists(st.one_of(st.just(0.0), st.floats(1e-6, 50)), min_size=1, max_size=12).filter(lambda x: sum(x) > 0),
    st.floats(0.01, 5),
)
@examples(100)
def test_nodes_include_the_ends_of_every_piece_and_are_within_the_step(lengths, step):
    ends = np.cumsum(lengths)
    s, piece = nodes(ends, step)
    starts = np.concatenate([[0.0], ends[:-1]])
    assert np.diff(s).min() >= 0
    assert np.diff(piece).min() >= 0
    assert np.unique(piece).tolist() == list(range(len(lengths)))
    for k in range(len(lengths)):
        own = s[piece == k]
        assert own[0] == starts[k]
        assert own[-1] == ends[k]
        assert own.size >= 9
        assert np.diff(own).max() <= step * (1 + 1e-9)
        assert np.ptp(np.diff(own)) <= 1e-9 * (1 + ends[k])


def test_a_path_of_too_many_nodes_is_refused():
    with pytest.raises(InputError, match=r"path of 1e\+09 mm in 1 pieces: needs 5e\+08 nodes .* at most 2e\+06"):
        nodes([1e9], 2.0)


def test_slowest_is_between_the_first_rise_and_the_last_fall():
    s = np.arange(7.0)

    def slowest(*speed):
        return Limited(s[: len(speed)], np.array(speed, float)).slowest

    assert slowest(0, 1, 3, 2, 4, 1, 0) == (2, 3)
    assert slowest(0, 1, 5, 1, 0) == (5, 2)
    assert slowest(0, 4, 4, 4, 0) == (4, 1)
    assert slowest(2, 2, 2) == (2, 0)
    assert slowest(0, 2, 3) == (3, 2)
    assert slowest(5, 4, 1) == (5, 0)
    assert slowest(0, 4, 0, 4, 0) == (0, 2)
