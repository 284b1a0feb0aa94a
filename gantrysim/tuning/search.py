"""The search: CMA-ES over shapes of the servo, each as fast as its margin admits.

Candidates are ranked, best first:

    1  feasible: margin and torque ripple kept, no fault on any machine; by the metric
    2  torque ripple too high, by the ratio to its limit
    3  margin too small (the start alone), by the excess
    4  ended by a fault, the later the better
    5  margin too small at every frequency, by the excess; not run

Metric and torque ripple of a candidate are the largest over all machines. CMA-ES uses the ranks alone, so constraints
need no weights.

The first coordinates of the optimiser are rho = log10(w / w_M), where w_M is the highest frequency at which loops of
this shape (see `gantrysim.tuning.space`) keep the margin; above 0 they count as 0. So every candidate keeps the margin,
and the edge of the feasible region, at 0, is easily found.

A candidate is first run on one machine, the hardest for the best candidate so far: its metric over all machines is no
less. Only one that would become the best is run on all others.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

from gantrysim.arrays import Floats
from gantrysim.controllers.servo import Servo
from gantrysim.tuning.space import SearchSpace
from gantrysim.tuning.stability import Fastest, Stability

if TYPE_CHECKING:
    from cmaes import CMA

RANKS = {1: "feasible", 2: "torque ripple too high", 3: "margin too small", 4: "fault"}  # of candidates that are run

Ended = Literal["budget", "converged", "no progress", "no candidate"]
Phase = Literal["start", "tuned"]

_SIGMA = 0.3  # initial standard deviation of every coordinate
_RHO = (-1.5, 0.3)  # bounds of rho, the lower one relative to the start
_CONVERGED = 0.01  # standard deviation of a generation's coordinates, 2 % of a gain
_PATIENCE, _PROGRESS = 25, 0.002  # generations in which the metric must fall by this share
_FRUITLESS = 200  # generations without a candidate that keeps the margin


@dataclass(frozen=True)
class TrialResult:
    """Result of a run.

    Attributes:
        metric: to be minimised; inf where a fault ended the run.
        ripple: torque ripple as a share of the peak torque, the largest of all axes.
        fault: time of the fault that ended the run, or None [s].
    """

    metric: float
    ripple: float = 0.0
    fault: float | None = None


@dataclass(eq=False)
class Candidate:
    """A servo considered by the search.

    Attributes:
        generation: 0 of the start.
        number: within its generation, from 1.
        servo: with its gains.
        excess: of the margin, as in `Stability`; above 0 the margin is not kept.
        results: by the number of the machine.
        runs: number of runs the search had made when the candidate was last run.
    """

    generation: int
    number: int
    servo: Servo
    excess: float = 0.0
    results: dict[int, TrialResult] = field(default_factory=dict)
    runs: int = 0

    def order(self, ripple: float) -> tuple[int, float]:
        """Return rank and amount from the results so far; `ripple` is the largest allowed, a share of peak torque."""
        faults = [result.fault for result in self.results.values() if result.fault is not None]
        if faults:
            return 4, -min(faults)
        if self.excess > 0:
            return 3 if self.results else 5, self.excess
        if self.ripple > ripple:
            return 2, math.log(self.ripple / ripple)
        return 1, self.metric

    @property
    def metric(self) -> float:
        """The largest over the machines run so far."""
        return max((result.metric for result in self.results.values()), default=math.inf)

    @property
    def ripple(self) -> float:
        """The largest over the machines run so far."""
        return max((result.ripple for result in self.results.values()), default=math.inf)

    @property
    def hardest(self) -> int:
        """Number of the machine with the earliest fault, or else the largest metric."""
        faults = {machine: math.inf if one.fault is None else one.fault for machine, one in self.results.items()}
        return max(self.results, key=lambda machine: (-faults[machine], self.results[machine].metric))


@dataclass(frozen=True)
class Trial:
    """A run to be made: a candidate on a machine, by its number."""

    candidate: Candidate
    machine: int


@dataclass(frozen=True)
class History:
    """What a search did.

    Attributes:
        candidates: that were run, in order; the start is the first.
        leaders: successive best candidates; the first is the start, the last the answer.
        skipped: number of candidates not run, as no frequency keeps their margin.
        runs: number of runs made.
        generations: number of generations.
        ended: why the search ended.
    """

    candidates: list[Candidate]
    leaders: list[Candidate]
    skipped: int
    runs: int
    generations: int
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


Search = Generator[list[Trial], list[TrialResult], History]


def search(
    space: SearchSpace,
    stability: Stability,
    *,
    machines: int,
    budget: int,
    ripple: float,
    seed: int,
    on_leader: Callable[[Candidate], None] = lambda candidate: None,
) -> Search:
    """Yield the trials to be run next, receive their results in the same order, and return the history.

    The arguments and the results determine the search.

    Args:
        space: to be searched.
        stability: on these machines.
        machines: number of them.
        budget: maximum number of runs, at least 2 for each machine: the start and one candidate.
        ripple: largest torque ripple allowed, a share of the peak torque.
        seed: of the random numbers.
        on_leader: called with every candidate that becomes the best.
    """
    start = Candidate(0, 1, space.start, float(stability.excess(space.start).max()))
    tried, leaders = [start], [start]
    runs = yield from _run(start, range(machines), 0)
    on_leader(start)
    guess = stability.fastest(space, space.begin[1], Fastest(np.zeros(space.groups)))
    optimiser = _optimiser(space, guess, seed)
    generation, skipped, fruitless, improved = 0, 0, 0, (0, math.inf)
    ended: Ended | None = None
    while ended is None:
        generation += 1
        points = [optimiser.ask() for _ in range(optimiser.population_size)]
        candidates = []
        for number, point in enumerate(points, 1):
            candidate, guess = _candidate(generation, number, space, stability, point, guess)
            candidates.append(candidate)
        stable = [candidate for candidate in candidates if candidate.excess <= 0]
        skipped += len(candidates) - len(stable)
        room = budget - runs - (machines - 1)  # leaves enough to run a new best candidate on all machines
        if stable and room <= 0:
            ended = "budget"
            break
        chosen = stable[:room]
        if chosen:
            machine = leaders[-1].hardest
            results = yield [Trial(candidate, machine) for candidate in chosen]
            for candidate, result in zip(chosen, results, strict=True):
                runs += 1
                candidate.results[machine], candidate.runs = result, runs
            tried += chosen
        contenders = list(chosen)
        while contenders:
            first = min(contenders, key=lambda candidate: candidate.order(ripple))
            if first.order(ripple) >= leaders[-1].order(ripple):
                break
            others = [machine for machine in range(machines) if machine not in first.results]
            if not others:
                leaders.append(first)
                on_leader(first)
                contenders.remove(first)
            elif budget - runs < len(others):
                break
            else:
                runs = yield from _run(first, others, runs)
        if len(chosen) < len(stable):
            ended = "budget"
            break
        ranks = {id(c): rank for rank, c in enumerate(sorted(candidates, key=lambda c: c.order(ripple)))}
        optimiser.tell([(point, ranks[id(c)]) for point, c in zip(points, candidates, strict=True)])
        fruitless = 0 if stable else fruitless + 1
        rank, metric = leaders[-1].order(ripple)
        if rank > 1 or metric < improved[1] * (1 - _PROGRESS):
            improved = (generation, metric if rank == 1 else math.inf)
        if _converged(points, space.groups):
            ended = "converged"
        elif generation - improved[0] >= _PATIENCE:
            ended = "no progress"
        elif fruitless >= _FRUITLESS:
            ended = "no candidate"
    return History(tried, leaders, skipped, runs, generation, ended)


def _run(candidate: Candidate, machines: Iterable[int], runs: int) -> Generator[list[Trial], list[TrialResult], int]:
    """Run a candidate on machines, and return the number of all runs so far."""
    trials = [Trial(candidate, machine) for machine in machines]
    results = yield trials
    candidate.results |= {trial.machine: result for trial, result in zip(trials, results, strict=True)}
    candidate.runs = runs + len(trials)
    return candidate.runs


def _optimiser(space: SearchSpace, fastest: Fastest, seed: int) -> CMA:
    """Return the optimiser at the start, given the fastest loops of its shape."""
    from cmaes import CMA  # slow to import

    frequencies, shape = space.begin
    rho = np.minimum(frequencies - fastest.frequencies, 0.0) if fastest.excess <= 0 else np.zeros(space.groups)
    bounds = np.concatenate([np.stack([rho + _RHO[0], np.full(space.groups, _RHO[1])], axis=1), space.bounds])
    return CMA(np.concatenate([rho, shape]), _SIGMA, bounds=bounds, seed=seed)


def _candidate(
    generation: int, number: int, space: SearchSpace, stability: Stability, point: Floats, guess: Fastest
) -> tuple[Candidate, Fastest]:
    """Return the candidate at a point of the optimiser, and the fastest loops of its shape as the next guess."""
    rho, shape = point[: space.groups], point[space.groups :]
    fastest = stability.fastest(space, shape, guess)
    if fastest.excess > 0:
        return Candidate(generation, number, space.servo(fastest.frequencies, shape), fastest.excess), guess
    servo = space.servo(fastest.frequencies + np.minimum(rho, 0.0), shape)
    return Candidate(generation, number, servo, float(stability.excess(servo).max())), fastest


def _converged(points: list[Floats], groups: int) -> bool:
    """Return whether the points of a generation nearly coincide."""
    places = np.array(points)
    places[:, :groups] = np.minimum(places[:, :groups], 0.0)
    return bool(places.std(axis=0).max() < _CONVERGED)
