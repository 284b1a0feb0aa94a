"""The search: a trust region over shapes of the servo, each as fast as its margin admits.

Candidates are ranked, best first:

    1  feasible: margin and torque ripple kept, no fault on any machine; by the metric
    2  torque ripple too high, by the ratio to its limit
    3  margin too small (the start alone), by the excess
    4  ended by a fault, the later the better
    5  margin too small at every frequency, by the excess; not run

Metric and torque ripple of a candidate are the largest over all machines.

The first coordinates of a point are rho = log10(w / w_M) <= 0, where w_M is the highest frequency at which loops of
this shape (see `gantrysim.tuning.space`) keep the margin. So every candidate keeps the margin, and the edge of the
feasible region, at 0, is easily found; a shape that has no such frequency costs no run.

The first round has the start, its shape at the edge, and the natural shape at the edge; the second a simplex around the
best of these. From then on `gantrysim.tuning.region` proposes the points. When its region has become small, another
begins: in turn around the best candidate, and around the best of some random points.

A candidate is first run on one machine, the hardest for the best candidate so far: its metric over all machines is no
less. Only one that would become the best is run on all others. For the others, that metric is estimated by the ratio
of the two at the nearest candidate that was run on all.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.servo.gains import GAIN_NAMES
from gantrysim.servo.servo import Servo
from gantrysim.tuning.candidates import Candidate, Trial, TrialResult
from gantrysim.tuning.rounds import BATCH, rounds
from gantrysim.tuning.space import SearchSpace
from gantrysim.tuning.stability import Fastest, Stability

Ended = Literal["budget", "converged", "no candidate"]
Phase = Literal["start", "tuned"]

_RHO = -1.5  # lower bound of rho, relative to the start
_CONFIRMED = 0.002  # share by which a candidate must be better on one machine to be run on the others
_ROUNDED = 1e-3  # relative difference of gains that counts as none


@dataclass(frozen=True)
class History:
    """What a search did.

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


Search = Generator[list[Trial], list[TrialResult], History]


def search(
    space: SearchSpace,
    stability: Stability,
    *,
    machines: int,
    budget: int,
    ripple: float,
    seed: int,
    batch: int = BATCH,
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
        batch: number of candidates of a round.
        on_leader: called with every candidate that becomes the best.
    """
    start = Candidate(0, 1, space.start, float(stability.excess(space.start).max()))
    tried = [start]
    leaders = [start]
    runs = yield from _run(start, range(machines), 0)
    on_leader(start)
    begin, bounds, guess = box(space, stability)
    if start.excess <= 0 and _alike(space.start, space.servo(*space.begin)):
        start.point = begin
    seen = [start] if start.point.size else []
    proposals = rounds(
        begin, bounds, space.natural, known=bool(seen), machines=machines, ripple=ripple, seed=seed, batch=batch
    )
    points = next(proposals)
    count = 0
    skipped = 0
    ended: Ended | None = None
    while ended is None:
        count += 1
        candidates = []
        for number, point in enumerate(points, 1):
            candidate, guess = candidate_at(count, number, space, stability, point, guess)
            candidates.append(candidate)
        stable = [candidate for candidate in candidates if candidate.excess <= 0]
        skipped += len(candidates) - len(stable)
        room = budget - runs - (machines - 1)  # leaves enough to run a new best candidate on all machines
        chosen = stable[: max(room, 0)]
        if chosen:
            machine = leaders[-1].hardest
            results = yield [Trial(candidate, machine) for candidate in chosen]
            for candidate, result in zip(chosen, results, strict=True):
                runs += 1
                candidate.results[machine], candidate.runs = result, runs
            tried += chosen
        last = len(chosen) < len(stable)
        contenders = list(tried if last else chosen)
        while contenders:
            first = min(contenders, key=lambda candidate: candidate.order(ripple))
            others = [machine for machine in range(machines) if machine not in first.results]
            if not _better(first, leaders[-1], ripple, 0.0 if last or not others else _CONFIRMED):
                break
            if not others:
                leaders.append(first)
                on_leader(first)
                contenders.remove(first)
            elif budget - runs < len(others):
                break
            else:
                runs = yield from _run(first, others, runs)
        seen += [one for one in candidates if one.results or one.excess > 0]
        if last:
            ended = "budget"
        else:
            try:
                points = proposals.send(seen)
            except StopIteration:
                ended = "converged" if len(tried) > 1 else "no candidate"
    return History(tried, leaders, skipped, runs, count, ended)


def _better(candidate: Candidate, leader: Candidate, ripple: float, share: float) -> bool:
    """Return whether a candidate, by the machines it was run on, is better than the leader by a share of its metric."""
    (rank, amount), (best, least) = candidate.order(ripple), leader.order(ripple)
    return (rank, amount) < (best, least * (1 - share) if rank == best == 1 else least)


def _alike(servo: Servo, other: Servo) -> bool:
    """Return whether servos have the same gains, but for rounding."""
    return all(np.allclose(getattr(servo, name), getattr(other, name), _ROUNDED) for name in GAIN_NAMES)


def _run(candidate: Candidate, machines: Iterable[int], runs: int) -> Generator[list[Trial], list[TrialResult], int]:
    """Run a candidate on machines, and return the number of all runs so far."""
    trials = [Trial(candidate, machine) for machine in machines]
    results = yield trials
    candidate.results |= {trial.machine: result for trial, result in zip(trials, results, strict=True)}
    candidate.runs = runs + len(trials)
    return candidate.runs


def box(space: SearchSpace, stability: Stability) -> tuple[Floats, Floats, Fastest]:
    """Return the start and the bounds of all coordinates, (n,) and (n, 2), and a guess of fastest loops."""
    frequencies, shape = space.begin
    natural = Fastest(np.zeros(space.groups))
    fastest = stability.fastest(space, shape, natural)
    keeps = fastest.excess <= 0
    rho = np.minimum(frequencies - fastest.frequencies, 0.0) if keeps else np.zeros(space.groups)
    bounds = np.concatenate([np.stack([rho + _RHO, np.zeros(space.groups)], axis=1), space.bounds])
    return np.concatenate([rho, shape]), bounds, fastest if keeps else natural


def candidate_at(
    count: int, number: int, space: SearchSpace, stability: Stability, point: Floats, guess: Fastest
) -> tuple[Candidate, Fastest]:
    """Return the candidate at a point, and the fastest loops of its shape as the next guess.

    Args:
        count: number of the round.
        number: within the round.
        space: of the servos.
        stability: whose margin is kept.
        point: rho, at most 0, and shape.
        guess: the fastest loops of another shape.
    """
    rho = point[: space.groups]
    shape = point[space.groups :]
    fastest = stability.fastest(space, shape, guess)
    if fastest.excess > 0:
        return Candidate(count, number, space.servo(fastest.frequencies, shape), fastest.excess, point=point), guess
    servo = space.servo(fastest.frequencies + rho, shape)
    return Candidate(count, number, servo, float(stability.excess(servo).max()), point=point), fastest
