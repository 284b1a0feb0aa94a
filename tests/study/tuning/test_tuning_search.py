"""The search: runs, ranking and termination, with functions in place of machines."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest

from gantrysim import Machine, Servo
from gantrysim.study.tuning.candidates import Candidate, SearchLimits, TrialResult
from gantrysim.study.tuning.rounds import Estimates, rounds
from gantrysim.study.tuning.search import _LESS_FEEDFORWARD, _first_points, search
from gantrysim.study.tuning.space import SearchSpace
from gantrysim.study.tuning.stability import Fastest, Stability

from support.soaked import suite_runs

PERIOD = 1e-3
RIPPLE = 0.02
FOUND = 1.02  # largest ratio of the metric found to the minimum
XY = Machine("xy")
DERIVED = Servo.derive(XY.axes, PERIOD)


@pytest.fixture(scope="module")
def stability():
    return Stability([XY], PERIOD, 0.0, 2.0)


@pytest.fixture(scope="module")
def unconstrained():
    """A margin that every loop keeps, so that the result depends on the function alone."""
    free = Stability([XY], PERIOD, 0.0, 2.0)
    free.fastest = lambda space, shape, guess: Fastest(np.zeros(space.groups))
    free.excess = lambda servo, machines=None: np.full(servo.axes, -1.0)
    return free


def detuned(factor):
    names = ("kp", "kd", "velocity_ff", "acceleration_ff")
    return DERIVED.with_values(**{name: tuple(factor * gain for gain in DERIVED.per_axis(name)) for name in names})


def space(start=DERIVED, law="pd", per_axis=False):
    return SearchSpace(law, XY.axes, DERIVED, start, per_axis)


def away(servo, best):
    """Decades from the best gains of one axis, feed-forwards in shares of the derived ones."""
    gains = [math.log10(servo.per_axis(name)[0] / (best[name] * DERIVED.per_axis(name)[0])) for name in ("kp", "kd")]
    shares = [
        servo.per_axis(name)[0] / DERIVED.per_axis(name)[0] - best[name] for name in ("velocity_ff", "acceleration_ff")
    ]
    return np.array([*gains, *shares])


BEST = {"kp": 0.3, "kd": 0.2, "velocity_ff": 0.6, "acceleration_ff": 0.9}


def bowl(servo, machine):
    return TrialResult(1.0 + float(np.sum(np.array([1.0, 4.0, 0.1, 1.0]) * away(servo, BEST) ** 2)), 0.001)


def run(own, stability, measure, machines=1, budget=200, seed=1, on_leader=lambda candidate: None):
    """Return the history of a search, and its trials by round."""
    rounds = []
    generator = search(own, stability, SearchLimits(machines, budget, RIPPLE, seed), on_leader)
    trials = next(generator)
    while True:
        rounds.append([(trial.candidate, trial.machine) for trial in trials])
        try:
            trials = generator.send([measure(trial.candidate.servo, trial.machine) for trial in trials])
        except StopIteration as stop:
            return stop.value, rounds


@pytest.mark.parametrize("factor", [1 / 30, 0.1, 1.0, 10.0, 30.0])
@pytest.mark.parametrize("seed", suite_runs([1, 2], 0))
def test_the_minimum_of_a_bowl_is_found_from_anywhere(unconstrained, factor, seed):
    history, _ = run(space(detuned(factor)), unconstrained, bowl, budget=100, seed=seed)
    assert history.best.metric < FOUND


def test_each_axis_finds_its_own_gains(unconstrained):
    def measure(servo, machine):
        errors = [math.log10(servo.gains[a].kp / (best * DERIVED.gains[a].kp)) for a, best in enumerate((0.2, 0.6))]
        return TrialResult(1.0 + sum(error**2 for error in errors))

    history, _ = run(space(per_axis=True), unconstrained, measure, budget=120)
    assert history.best.metric < FOUND
    assert history.best.servo.gains[0].kp / DERIVED.gains[0].kp == pytest.approx(0.2, rel=0.3)
    assert history.best.servo.gains[1].kp / DERIVED.gains[1].kp == pytest.approx(0.6, rel=0.3)
    shared, _ = run(space(), unconstrained, measure, budget=120)
    assert shared.best.metric > 1.1


def test_every_candidate_that_is_run_keeps_the_margin_and_the_edge_is_reached(stability):
    def measure(servo, machine):  # the faster the better
        return TrialResult(DERIVED.gains[0].kp / servo.gains[0].kp)

    history, rounds = run(space(detuned(0.1)), stability, measure, budget=80)
    tried = {id(candidate): candidate for lot in rounds for candidate, _ in lot if candidate.round}
    assert all(float(stability.excess(candidate.servo).max()) <= 0 for candidate in tried.values())
    assert -0.01 < float(stability.excess(history.best.servo).max()) <= 0


@pytest.mark.soak
def test_shapes_that_keep_the_margin_at_no_frequency_are_not_run(stability):
    hardly_damped = DERIVED.with_values(kd=tuple(0.15 * kd for kd in DERIVED.per_axis("kd")), ki=(17.0, 23.0))
    history, rounds = run(space(hardly_damped, "pid"), stability, bowl, budget=40)
    assert history.skipped > 0
    assert len(history.candidates) + history.skipped <= 1 + 5 * history.rounds
    assert sum(map(len, rounds)) == len(history.candidates) == history.runs


def test_a_feasible_start_is_never_replaced_by_a_worse_candidate(unconstrained):
    def measure(servo, machine):  # the start alone is good
        return TrialResult(1.0 if servo == DERIVED else 2.0)

    history, _ = run(space(), unconstrained, measure, budget=60)
    assert history.best is history.start
    assert history.leaders == [history.start]


@pytest.mark.parametrize("machines", [1, 3, 6])
@pytest.mark.parametrize("budget", [12, 13, 50, 99])
def test_the_runs_stay_within_the_budget(unconstrained, machines, budget):
    history, rounds = run(space(), unconstrained, bowl, machines=machines, budget=budget)
    made = sum(map(len, rounds))
    assert made == history.runs
    assert budget - machines < made <= budget
    assert history.ended == "budget"
    assert rounds[0] == [(history.start, k) for k in range(machines)]


def test_the_least_budget_tries_the_start_and_one_candidate_on_all_machines(unconstrained):
    history, rounds = run(space(detuned(0.1)), unconstrained, bowl, machines=4, budget=8)
    assert [len(lot) for lot in rounds] in ([4, 1, 3], [4, 1])
    assert len(history.candidates) == 2


def harder(servo, machine):
    """Two bowls apart: the first machine's least is where the second is bad, and the other way round."""
    centre = {0: 0.15, 1: 0.6, 2: 0.3}[machine]
    return TrialResult(1.0 + abs(math.log10(servo.gains[0].kp / (centre * DERIVED.gains[0].kp))))


def test_the_result_is_the_best_on_its_worst_machine_and_was_run_on_all(unconstrained):
    history, _ = run(space(detuned(0.1)), unconstrained, harder, machines=3, budget=200)
    best = history.best
    assert set(best.results) == {0, 1, 2}
    assert best.metric == max(harder(best.servo, machine).metric for machine in range(3))
    assert best.servo.gains[0].kp / DERIVED.gains[0].kp == pytest.approx(0.3, rel=0.1)  # half way on the logarithm
    assert best.metric == pytest.approx(1.301, abs=0.03)
    once = [len(candidate.results) for candidate in history.candidates]
    assert once.count(1) > 0.3 * len(once)  # even where the hardest machine changes all the time
    for leader in history.leaders:
        assert len(leader.results) == 3


def test_leaders_improve_in_order(unconstrained):
    leaders = []
    history, _ = run(space(detuned(0.1)), unconstrained, harder, machines=3, budget=200, on_leader=leaders.append)
    metrics = [leader.metric for leader in history.leaders]
    assert metrics == sorted(metrics, reverse=True)
    assert len(set(metrics)) == len(metrics)
    assert leaders == history.leaders
    runs = [leader.runs for leader in history.leaders]
    assert runs == sorted(runs)


def test_the_same_seed_searches_the_same_and_another_one_does_not(unconstrained):
    first, again, other = (
        [c.servo for c in run(space(), unconstrained, bowl, budget=60, seed=seed)[0].candidates] for seed in (7, 7, 8)
    )
    assert first == again
    assert first != other


def test_candidates_with_too_much_torque_ripple_rank_behind(unconstrained):
    """The minimum of the bowl has too much ripple: the result stays at the limit."""

    def measure(servo, machine):
        kd = servo.gains[0].kd / DERIVED.gains[0].kd
        return dataclasses.replace(bowl(servo, machine), ripple=RIPPLE * kd / 0.15)

    history, _ = run(space(detuned(0.1)), unconstrained, measure, budget=100)
    assert history.best.ripple <= RIPPLE
    assert history.best.servo.gains[0].kd / DERIVED.gains[0].kd == pytest.approx(0.15, rel=0.1)
    free, _ = run(space(detuned(0.1)), unconstrained, bowl, budget=100)
    assert free.best.servo.gains[0].kd / DERIVED.gains[0].kd == pytest.approx(0.2, rel=0.1)


def test_the_search_leaves_torque_ripple_and_faults_behind(unconstrained):
    """From a start that faults, through high ripple, to feasible gains."""

    def measure(servo, machine):
        far = float(np.abs(away(servo, BEST)[:2]).max())
        if far > 0.8:
            return TrialResult(math.inf, math.inf, 5.0 - far)
        return TrialResult(bowl(servo, machine).metric, RIPPLE * (far + 0.8))

    history, _ = run(space(detuned(30.0)), unconstrained, measure, budget=100)
    assert history.start.order(RIPPLE)[0] == 4
    assert history.best.order(RIPPLE)[0] == 1
    assert history.best.metric < 1.1


def candidate(*measured, excess=-1.0):
    return Candidate(1, 1, DERIVED, excess, dict(enumerate(measured)))


def test_the_order_of_candidates():
    good, better = candidate(TrialResult(2.0, 0.01), TrialResult(3.0, 0.01)), candidate(TrialResult(2.9, 0.02))
    restless, very = candidate(TrialResult(0.1, 0.03)), candidate(TrialResult(0.1, 0.01), TrialResult(0.1, 0.04))
    near, far = candidate(excess=0.1), candidate(excess=12.0)
    late, early = (
        candidate(TrialResult(1.0, 0.01), TrialResult(math.inf, math.inf, time), TrialResult(math.inf, math.inf, 9.0))
        for time in (3.0, 2.0)
    )
    missed = candidate(TrialResult(0.001, 0.001), excess=20.0)  # as a start may
    wanted = [better, good, restless, very, missed, late, early, near, far]
    mixed = [good, late, far, better, missed, very, early, restless, near]
    assert sorted(mixed, key=lambda one: one.order(RIPPLE)) == wanted
    assert [one.order(RIPPLE)[0] for one in wanted] == [1, 1, 2, 2, 3, 4, 4, 5, 5]
    assert good.metric == 3.0
    assert (good.hardest, very.ripple, early.hardest) == (1, 0.04, 1)


@pytest.mark.parametrize("seed", suite_runs([1, 2], 0))
def test_a_start_far_from_any_good_loop_is_left_behind(stability, seed):
    """Slow loops of its shape fault, and most other shapes keep the margin at no frequency."""

    def measure(servo, machine):
        if servo.gains[0].kp < 0.2 * DERIVED.gains[0].kp and servo.gains[0].kp != start.gains[0].kp:
            return TrialResult(math.inf, math.inf, 5.0 * servo.gains[0].kp / DERIVED.gains[0].kp)
        return TrialResult(DERIVED.gains[0].kp / servo.gains[0].kp)

    start = detuned(0.1).with_values(ki=(1.7, 2.3))
    history, _ = run(space(start, "pid"), stability, measure, budget=60, seed=seed)
    assert history.start.order(RIPPLE)[0] == 3
    assert history.best.order(RIPPLE)[0] == 1
    assert history.ended == "budget"


def test_a_candidate_run_on_one_machine_is_estimated_by_the_nearest_run_on_all():
    def at(place, *measured, **more):
        return dataclasses.replace(candidate(*measured, **more), point=np.array([place]))

    two = [TrialResult(2.0, 0.004), TrialResult(3.0, 0.012)]  # 1.5 and 3 times the first machine's
    four = [TrialResult(5.0, 0.001), TrialResult(4.0, 0.001)]
    fault = TrialResult(math.inf, math.inf, 1.0)
    all_of = [at(0.0, *two), at(1.0, *four), at(0.2, two[0]), at(0.9, two[0]), at(0.1, fault), at(0.0, excess=0.3)]
    own = Estimates(all_of, SearchLimits(machines=2, budget=100, ripple=RIPPLE, seed=1))
    assert np.exp(own.metric) == pytest.approx([3.0, 5.0, 3.0, 2.0, math.inf, math.inf])
    assert RIPPLE * np.exp(own.ripple) == pytest.approx([0.012, 0.001, 0.012, 0.004, math.inf, math.inf])
    assert [rank for rank, _ in own.keys] == [1, 1, 1, 1, 4, 5]
    assert own.best() == 3
    assert own.falls(0, 3, 0.1)
    assert not own.falls(0, 3, 0.5)  # log(3/2) is less


def least_of_rounds(valleys):
    """The least value that rounds find of a function with minima of 1 at (0, 0) and of 0.5 at (2, 0)."""

    def value(point):
        x, y = point
        return min(1 + x**2 + y**2, 0.5 + 4 * (x - 2) ** 2 + y**2)

    limits = SearchLimits(machines=1, budget=1000, ripple=RIPPLE, seed=1)
    proposals = rounds(valleys, np.array([[-3.0, 3.0], [-3.0, 3.0]]), limits)
    considered = []
    points = next(proposals)
    while points:
        considered += [dataclasses.replace(candidate(TrialResult(value(point))), point=point) for point in points]
        try:
            points = proposals.send(considered)
        except StopIteration:
            points = []
    return min(one.metric for one in considered)


def test_a_simplex_descends_in_every_valley_before_one_returns_to_the_best():
    """The second valley begins worse, at 1.75 against 1.18, and ends better."""
    first, second = [np.array([0.3, 0.3])], [np.array([2.5, 0.5])]
    assert least_of_rounds([first]) == pytest.approx(1.0, rel=1e-2)
    assert least_of_rounds([first, second]) == pytest.approx(0.5, rel=1e-2)
    assert least_of_rounds([first + second]) == pytest.approx(1.0, rel=1e-2)


def test_a_start_below_the_margin_gains_no_rank_by_its_metric():
    start = candidate(TrialResult(0.001, 0.001), excess=0.2)
    assert start.order(RIPPLE) == (3, 0.2)


def test_the_search_ends_when_its_candidates_converge(unconstrained):
    history, _ = run(space(), unconstrained, bowl, budget=5000)
    assert history.ended == "converged"
    assert history.runs < 2000
    assert history.best.metric < 1.001


def test_the_search_ends_without_progress(unconstrained):
    flat = np.random.default_rng(1)
    history, _ = run(space(), unconstrained, lambda servo, machine: TrialResult(1.0 + flat.random()), budget=5000)
    assert history.ended == "converged"
    assert history.rounds < 300


def test_the_search_ends_if_no_candidate_keeps_the_margin(stability):
    excess = np.random.default_rng(1)

    class Lost(Stability):
        def __init__(self):
            self.peak = 2.0

        def fastest(self, space, shape, guess):
            return Fastest(np.zeros(space.groups), 0.1 + excess.random())

        def excess(self, servo, machines=None):
            return np.full(servo.axes, 0.5)

    history, rounds = run(space(), Lost(), bowl, budget=100)
    assert history.ended == "no candidate"
    assert history.best is history.start
    assert [len(lot) for lot in rounds] == [1]
    assert history.skipped >= history.rounds > 1


def test_few_candidates_are_run_on_more_than_the_hardest_machine(unconstrained):
    def measure(servo, machine):
        return TrialResult(bowl(servo, machine).metric * (1.0 + 0.1 * machine))

    history, _ = run(space(detuned(0.1)), unconstrained, measure, machines=5, budget=120)
    assert history.best.hardest == 4
    assert sum(len(one.results) == 1 for one in history.candidates) > 0.6 * len(history.candidates)


@pytest.mark.parametrize("coordinates", [("k", "i", "d", "a"), ("k", "i", "d")])
def test_the_first_points_are_shapes_at_the_edge_each_also_with_less_of_the_last_coordinate(coordinates):
    """Two groups of axes: the start's, the natural and the stiffest shape, each of which the frequency 0 precedes."""
    size = 2 * (len(coordinates) - 1)
    natural, stiffest = np.arange(size) + 0.5, np.arange(size) + 10.5
    space = SimpleNamespace(groups=2, natural=natural, coordinates=coordinates)
    edge = SimpleNamespace(space=space, stiffest=lambda: stiffest)
    begin = np.arange(size + 2) + 20.0
    shapes = [begin[2:], natural, stiffest]
    if "a" in coordinates:
        shapes += [np.append(shape[:-2], [_LESS_FEEDFORWARD, _LESS_FEEDFORWARD]) for shape in (natural, stiffest)]
    points = _first_points(edge, begin, SimpleNamespace(point=np.zeros(0)))
    expected = [begin, *(np.append([0.0, 0.0], shape) for shape in shapes)]
    assert [point.tolist() for point in points] == [point.tolist() for point in expected]
    # it was run there already
    points = _first_points(edge, begin, SimpleNamespace(point=np.zeros(1)))
    assert [point.tolist() for point in points] == [point.tolist() for point in expected[1:]]


def ranked(metric, ripple, point, machines=(0,)):
    """A candidate with one value of metric and ripple on each machine."""
    results = {m: TrialResult(metric * (1 + m), ripple) for m in machines}
    return Candidate(1, 1, DERIVED, results=results, point=np.array([point]))


def test_candidates_beyond_the_ripple_come_after_all_within_it_by_how_far_they_are_beyond():
    """From just above the limit on: the logarithm of the excess orders them, that of the metric all others."""
    candidates = [ranked(5.0, 0.99 * RIPPLE, 0.0), ranked(1.0, 1.01 * RIPPLE, 1.0), ranked(1.0, 9 * RIPPLE, 2.0)]
    estimates = Estimates(candidates, SearchLimits(1, 100, RIPPLE, 1))
    assert [rank for rank, _ in estimates.keys] == [1, 2, 2]
    assert [amount for _, amount in estimates.keys] == pytest.approx([math.log(x) for x in (5.0, 1.01, 9.0)])
    assert estimates.best() == 0
    assert estimates.best([np.array([2.0]), np.array([1.0])]) == 1


def test_a_candidate_run_on_some_machines_is_scaled_by_the_nearest_one_run_on_all():
    """On the second machine the metric is twice as large: one that was run on the first alone counts as much."""
    whole = [ranked(4.0, 0.001, 0.0, (0, 1)), ranked(3.0, 0.001, 5.0, (0, 1))]
    part = ranked(3.5, 0.001, 1.0)
    estimates = Estimates([*whole, part], SearchLimits(2, 100, RIPPLE, 1))
    assert np.exp(estimates.metric) == pytest.approx([8.0, 6.0, 7.0])
    # nobody was run on all: the values stand as they are
    alone = Estimates([part], SearchLimits(2, 100, RIPPLE, 1))
    assert np.exp(alone.metric) == pytest.approx([3.5])
