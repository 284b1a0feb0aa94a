"""The search: simplexes over shapes of the servo, each as fast as its margin admits.

Candidates are ranked, best first:

    1  feasible: margin and torque ripple kept, no fault on any machine; by the metric
    2  torque ripple too high, by the ratio to its limit
    3  margin too small (the start alone), by the excess
    4  ended by a fault, the later the better
    5  margin too small at every frequency, by the excess; not run

Metric and torque ripple of a candidate are the largest over all machines.

The first coordinates of a point are rho = log10(w / w_M) <= 0, where w_M is the highest frequency at which loops of
this shape (see `gantrysim.study.tuning.space`) keep the margin. So every candidate keeps the margin, and the edge of
the feasible region, at 0, is easily found; a shape that has no such frequency costs no run.

The first round has shapes at the edge: those of the start, of the derived gains, and the stiffest one, which
`MarginEdge` finds without a run; the last two also with less acceleration feed-forward. A simplex descends from the
best of these, see `gantrysim.study.tuning.rounds`. When it has become small, another one begins around the best
candidate.

A largest error has two valleys: friction at reversals causes it, and a velocity feed-forward far above the viscous
torque compensates friction. So the first round then has the stiffest shape with such feed-forwards too, and the first
two simplexes begin in different valleys.

A candidate is first run on one machine, the hardest for the best candidate so far: its metric over all machines is no
less. Only one that would become the best is run on all others. For the others, that metric is estimated by the ratio
of the two at the nearest candidate that was run on all.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from scipy.optimize import minimize

from gantrysim.base.arrays import Floats
from gantrysim.servo.gains import GAIN_NAMES
from gantrysim.servo.servo import Servo
from gantrysim.study.tuning.candidates import Candidate, SearchLimits, Trial, TrialResult
from gantrysim.study.tuning.rounds import rounds
from gantrysim.study.tuning.space import SearchSpace
from gantrysim.study.tuning.stability import Fastest, Stability

# The edge of the margin: the fastest loops of each shape, and the stiffest shape.

_SIMPLEX_STEP = 0.3  # of the first simplex of the scan
_SHAPES = 40  # of a scan, for each coordinate of the loop
_LAST_SIDE = 0.01  # side of the scan's last simplex
_FLAT_GAINS = 0.005  # and difference of the gains' logarithms there
_MISSED_MARGIN = 50.0  # in place of the negative logarithm of a gain where no frequency keeps the margin
_LEAST_GAIN = 1e-30  # of a gain


@dataclass(eq=False)
class MarginEdge:
    """The fastest loops of shapes, each sought from those of the nearest shape that is known.

    A shape with a strong integral term keeps the margin in a narrow band of frequencies alone, which a search from far
    would miss.

    Args:
        space: of the servos.
        stability: whose margin is kept.
    """

    space: SearchSpace
    stability: Stability
    _shapes: list[Floats] = field(default_factory=list)
    _loops: list[Fastest] = field(default_factory=list)

    @property
    def _loop_names(self) -> list[str]:
        """Letters of the coordinates of a shape on which the margin depends: feed-forwards close no loop."""
        return [name for name in self.space.coordinates[1:] if name not in "va"]

    def fastest(self, shape: Floats) -> Fastest:
        """Return the fastest loops of a shape, (shapes,), that keep the margin."""
        loop = shape[: len(self._loop_names) * self.space.groups]
        guess = Fastest(np.zeros(self.space.groups))
        if self._shapes:
            distances = ((np.array(self._shapes) - loop) ** 2).sum(axis=1)
            nearest = int(np.argmin(distances))
            guess = self._loops[nearest]
            if distances[nearest] == 0:
                return guess
        fastest = self.stability.fastest(self.space, shape, guess)
        if fastest.excess <= 0:
            self._shapes.append(loop)
            self._loops.append(fastest)
        return fastest

    def stiffest(self) -> Floats:
        """Return the shape whose fastest loops have the largest product of kp and ki, or kp where ki is not searched.

        No run is needed. The error that a disturbance such as friction makes is its share of the loop's gain at its
        frequency: of ki where it is slow, of kp where it is fast. The largest ki alone lies at the tip of the shapes
        that keep the margin, where any step leaves them. All axes have one shape; feed-forwards are the natural ones.
        """
        natural = self.space.natural
        groups = self.space.groups
        gains = ("kp", "ki") if "n" in self.space.coordinates else ("kp",)
        count = len(self._loop_names)

        def shape_at(loop: Floats) -> Floats:
            return np.concatenate([np.repeat(loop, groups), natural[count * groups :]])

        def softness(loop: Floats) -> float:
            shape = shape_at(loop)
            fastest = self.fastest(shape)
            if fastest.excess > 0:
                return _MISSED_MARGIN + fastest.excess
            servo = self.space.servo(fastest.frequencies, shape)
            values = np.array([servo.per_axis(name) for name in gains])
            return -float(np.log(np.maximum(values, _LEAST_GAIN)).sum(axis=0).mean())

        start = natural[: count * groups : groups]
        simplex = np.vstack([start, start - _SIMPLEX_STEP * np.eye(count)])
        options = {"initial_simplex": simplex, "xatol": _LAST_SIDE, "fatol": _FLAT_GAINS, "maxfev": _SHAPES * count}
        stiffest = minimize(softness, start, method="Nelder-Mead", options=options).x
        return np.clip(shape_at(stiffest), *self.space.bounds.T)


Ended = Literal["budget", "converged", "no candidate"]
Phase = Literal["start", "tuned"]

_RHO = -1.5  # lower bound of rho, relative to the start
_CONFIRMED_GAIN = 0.002  # share by which a candidate must be better on one machine to be run on the others
_LESS_FEEDFORWARD = 0.5  # coordinate of a smaller acceleration feed-forward: a third of the inertia
_FAR_MORE = (2.2, 3.1)  # coordinates of velocity feed-forwards: 11 and 68 times the viscous torque
_EQUAL_GAINS = 1e-3  # relative difference of gains that counts as none


@dataclass(frozen=True)
class History:
    """Course and result of a search.

    Attributes:
        candidates: that were run, in order; the start is the first.
        leaders: successive best candidates; the first is the start, the last the answer.
        skipped: number of candidates not run, as no frequency keeps their margin.
        runs: number of runs made.
        rounds: number of rounds.
        ended: why the search ended.
    """

    candidates: list[Candidate]
    leaders: list[Candidate]
    skipped: int
    runs: int
    rounds: int
    ended: Ended

    @property
    def start(self) -> Candidate:
        """The candidate with the gains of the start."""
        return self.candidates[0]

    @property
    def best(self) -> Candidate:
        """The best candidate: the start where nothing better was found."""
        return self.leaders[-1]

    @property
    def phases(self) -> dict[Phase, Candidate]:
        """Start and best candidate by the names under which reports compare them."""
        return {"start": self.start, "tuned": self.best}


_Trials = Generator[list[Trial], list[TrialResult], None]
Search = Generator[list[Trial], list[TrialResult], History]


@dataclass(eq=False)
class _Runs:
    """The runs of a search so far.

    Attributes:
        limits: of the search.
        on_leader: called with every candidate that becomes the best.
        candidates: that were run, in order.
        leaders: successive best candidates.
        count: number of runs.
    """

    limits: SearchLimits
    on_leader: Callable[[Candidate], None]
    candidates: list[Candidate] = field(default_factory=list)
    leaders: list[Candidate] = field(default_factory=list)
    count: int = 0

    @property
    def affordable(self) -> int:
        """Number of candidates that may be run so that a new best one can still be run on all machines."""
        return max(self.limits.budget - self.count - (self.limits.machines - 1), 0)

    def lead(self, candidate: Candidate) -> None:
        """Make a candidate the best so far."""
        self.leaders.append(candidate)
        self.on_leader(candidate)

    def on_all(self, candidate: Candidate, machines: Iterable[int]) -> _Trials:
        """Run a candidate on several machines."""
        trials = [Trial(candidate, machine) for machine in machines]
        results = yield trials
        candidate.results |= {trial.machine: result for trial, result in zip(trials, results, strict=True)}
        self.count += len(trials)
        candidate.runs = self.count

    def on_hardest(self, candidates: list[Candidate]) -> _Trials:
        """Run several candidates on the machine that is hardest for the best candidate so far."""
        if not candidates:
            return
        machine = self.leaders[-1].hardest
        results = yield [Trial(candidate, machine) for candidate in candidates]
        for candidate, result in zip(candidates, results, strict=True):
            self.count += 1
            candidate.results[machine] = result
            candidate.runs = self.count
        self.candidates += candidates

    def confirm(self, contenders: list[Candidate], *, last: bool) -> _Trials:
        """Run contenders on all machines, the best first, as long as they would become the best.

        Args:
            contenders: run on some machines.
            last: whether the budget ends with this round: any better candidate counts then.
        """
        ripple = self.limits.ripple
        while contenders:
            first = min(contenders, key=lambda candidate: candidate.order(ripple))
            others = [machine for machine in range(self.limits.machines) if machine not in first.results]
            if not _better(first, self.leaders[-1], ripple, 0.0 if last or not others else _CONFIRMED_GAIN):
                break
            if not others:
                self.lead(first)
                contenders.remove(first)
            elif self.limits.budget - self.count < len(others):
                break
            else:
                yield from self.on_all(first, others)


def search(
    space: SearchSpace,
    stability: Stability,
    limits: SearchLimits,
    on_leader: Callable[[Candidate], None] = lambda candidate: None,
) -> Search:
    """Yield the trials to be run next, receive their results in the same order, and return the history.

    The arguments and the results determine the search.

    Args:
        space: to be searched.
        stability: on these machines.
        limits: of the search.
        on_leader: called with every candidate that becomes the best.
    """
    runs = _Runs(limits, on_leader)
    start = Candidate(0, 1, space.start, float(stability.excess(space.start).max()))
    runs.candidates.append(start)
    yield from runs.on_all(start, range(limits.machines))
    runs.lead(start)
    edge = MarginEdge(space, stability)
    begin, bounds = box(edge)
    if start.excess <= 0 and _alike(space.start, space.servo(*space.begin)):
        start.point = begin
    considered = [start] if start.point.size else []
    valleys = [_first_points(edge, begin, start)]
    if limits.of_largest and "v" in space.coordinates:
        valleys.append(_against_friction(edge))
    proposals = rounds(valleys, bounds, limits)
    points = next(proposals)
    count = 0
    skipped = 0
    ended: Ended | None = None
    while ended is None:
        count += 1
        candidates = []
        for number, point in enumerate(points, 1):
            candidate = candidate_at(count, number, edge, point)
            candidates.append(candidate)
        stable = [candidate for candidate in candidates if candidate.excess <= 0]
        skipped += len(candidates) - len(stable)
        chosen = stable[: runs.affordable]
        yield from runs.on_hardest(chosen)
        last = len(chosen) < len(stable)
        # in the last round an earlier candidate, better by less than a new one had to be, may still become the best
        yield from runs.confirm(list(runs.candidates if last else chosen), last=last)
        considered += [candidate for candidate in candidates if candidate.results or candidate.excess > 0]
        if last:
            ended = "budget"
        else:
            try:
                points = proposals.send(considered)
            except StopIteration:
                ended = "converged" if len(runs.candidates) > 1 else "no candidate"
    return History(runs.candidates, runs.leaders, skipped, runs.count, count, ended)


def _first_points(edge: MarginEdge, begin: Floats, start: Candidate) -> list[Floats]:
    """Return the points of the first round: shapes at the edge of the margin, and the start if it was not run there."""
    space = edge.space
    shapes = [begin[space.groups :], space.natural, edge.stiffest()]
    # the metric may have another valley there
    if "a" in space.coordinates:
        shapes += [
            np.concatenate([shape[: -space.groups], np.full(space.groups, _LESS_FEEDFORWARD)]) for shape in shapes[1:]
        ]
    edges = [np.concatenate([np.zeros(space.groups), shape]) for shape in shapes]
    if start.point.size or np.array_equal(begin, edges[0]):
        return edges
    return [begin, *edges]


def _against_friction(edge: MarginEdge) -> list[Floats]:
    """Return points with the stiffest shape and a velocity feed-forward far above the viscous torque."""
    space = edge.space
    is_feedforward = np.repeat([name == "v" for name in space.coordinates[1:]], space.groups)
    shapes = [np.where(is_feedforward, coordinate, edge.stiffest()) for coordinate in _FAR_MORE]
    return [np.concatenate([np.zeros(space.groups), shape]) for shape in shapes]


def _better(candidate: Candidate, leader: Candidate, ripple: float, share: float) -> bool:
    """Return whether a candidate, by the machines it was run on, is better than the leader by a share of its metric."""
    rank, amount = candidate.order(ripple)
    least_rank, least = leader.order(ripple)
    if rank == least_rank == 1:
        least *= 1 - share
    return (rank, amount) < (least_rank, least)


def _alike(servo: Servo, other: Servo) -> bool:
    """Return whether servos have equal gains, but for rounding."""
    return all(np.allclose(servo.per_axis(name), other.per_axis(name), _EQUAL_GAINS) for name in GAIN_NAMES)


def box(edge: MarginEdge) -> tuple[Floats, Floats]:
    """Return the start and the bounds of all coordinates, (n,) and (n, 2)."""
    space = edge.space
    frequencies, shape = space.begin
    fastest = edge.fastest(shape)
    rho = np.zeros(space.groups)
    if fastest.excess <= 0:
        rho = np.minimum(frequencies - fastest.frequencies, 0.0)
    bounds = np.concatenate([np.stack([rho + _RHO, np.zeros(space.groups)], axis=1), space.bounds])
    return np.concatenate([rho, shape]), bounds


def candidate_at(count: int, number: int, edge: MarginEdge, point: Floats) -> Candidate:
    """Return the candidate at a point.

    Args:
        count: number of the round.
        number: within the round.
        edge: of the margin that is kept.
        point: rho, at most 0, and shape.
    """
    space = edge.space
    rho = point[: space.groups]
    shape = point[space.groups :]
    fastest = edge.fastest(shape)
    if fastest.excess > 0:
        return Candidate(count, number, space.servo(fastest.frequencies, shape), fastest.excess, point=point)
    servo = space.servo(fastest.frequencies + rho, shape)
    return Candidate(count, number, servo, float(edge.stability.excess(servo).max()), point=point)
