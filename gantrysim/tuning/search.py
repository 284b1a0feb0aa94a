"""The search for the best gains: CMA-ES over shapes of the servo, every one as fast as its margin lets it be.

Candidates are compared in this order, the lowest first:

    1  those that keep margin and torque ripple and go through on every machine, by the figure
    2  those whose torque ripple is too much, by how much
    3  a start whose margin is too small, by how much
    4  those that a fault ends, the later the better
    5  those whose margin is too small at every frequency, by how much; they are not run

A candidate's figure and torque ripple are the largest over all machines. CMA-ES learns from the order alone, so nothing
else is to be weighed against the figure.

What is moved besides the shape (see `gantrysim.tuning.laws`) is rho = log10(w / w_M), where w_M is the frequency at
which loops of this shape have no more than the margin: above 0 it counts as 0. So every candidate keeps the margin, and
the edge of what may be is where it can be found, at 0.

Most candidates need not be run on every machine. Each is run on that machine which is the hardest for the best one so
far; its figure over all machines is no less. One that would be the best by this is run on all others too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

from gantrysim.arrays import Floats
from gantrysim.controllers.servo import Servo
from gantrysim.tuning.laws import Space
from gantrysim.tuning.stability import Fastest, Stability

if TYPE_CHECKING:
    from cmaes import CMA

Ended = Literal["budget", "converged", "no progress", "no candidate"]

_SIGMA = 0.3  # first standard deviation of every coordinate
_RHO = (-1.5, 0.3)  # bounds of rho, the lower one from the start on
_CONVERGED = 0.01  # standard deviation of a generation's coordinates, 2 % of a gain
_PATIENCE, _PROGRESS = 25, 0.002  # generations, in which the figure must become better by this share
_FRUITLESS = 200  # generations without a candidate that keeps the margin


@dataclass(frozen=True)
class Measured:
    """What a run has shown.

    Attributes:
        figure: to be made small; inf where there is none.
        ripple: of the torque, its share of the peak torque, the largest of all axes.
        fault: time of the fault that ended the run, or None [s].
    """

    figure: float
    ripple: float = 0.0
    fault: float | None = None


@dataclass(eq=False)
class Candidate:
    """A servo that the search has come upon.

    Attributes:
        generation: 0 of the start.
        number: within its generation, from 1.
        servo: with its gains.
        excess: of the margin, as of `Stability`; above 0 it is not kept.
        measured: by the number of the machine.
        runs: that the search had made when it was last run.
    """

    generation: int
    number: int
    servo: Servo
    excess: float = 0.0
    measured: dict[int, Measured] = field(default_factory=dict)
    runs: int = 0

    def order(self, ripple: float) -> tuple[int, float]:
        """Return its place in the order of candidates, by what is known of it.

        Args:
            ripple: of the torque, the most that may be.
        """
        faults = [one.fault for one in self.measured.values() if one.fault is not None]
        if faults:
            return 4, -min(faults)
        if self.excess > 0:
            return 3 if self.measured else 5, self.excess
        if self.ripple > ripple:
            return 2, math.log(self.ripple / ripple)
        return 1, self.figure

    @property
    def figure(self) -> float:
        """Of the hardest machine that it was run on."""
        return max((one.figure for one in self.measured.values()), default=math.inf)

    @property
    def ripple(self) -> float:
        """The largest on any machine that it was run on."""
        return max((one.ripple for one in self.measured.values()), default=math.inf)

    @property
    def hardest(self) -> int:
        """Number of the machine with the earliest fault, or else the largest figure."""

        def hardness(machine: int) -> tuple[float, float]:
            one = self.measured[machine]
            return (-math.inf if one.fault is None else -one.fault, one.figure)

        return max(self.measured, key=hardness)


@dataclass(frozen=True)
class Trial:
    """A run that the search asks for: a candidate on a machine, by its number."""

    candidate: Candidate
    machine: int


@dataclass(frozen=True)
class History:
    """What a search has done.

    Attributes:
        candidates: that were run, in their order; the start is the first.
        leaders: the best candidate of each moment, the first being the start and the last the answer.
        unstable: number of candidates that were not run, as no frequency keeps their margin.
        runs: that were made.
        generations: that were asked for.
        ended: why the search ended.
    """

    candidates: list[Candidate]
    leaders: list[Candidate]
    unstable: int
    runs: int
    generations: int
    ended: Ended

    @property
    def start(self) -> Candidate:
        """The candidate that the search began at."""
        return self.candidates[0]

    @property
    def best(self) -> Candidate:
        """The best candidate, which is the start where nothing better was found."""
        return self.leaders[-1]


Search = Generator[list[Trial], list[Measured], History]


def least_budget(machines: int) -> int:
    """Return the number of runs that a search needs: the start, and one candidate, on all machines."""
    return 2 * machines


def search(
    space: Space,
    stability: Stability,
    *,
    machines: int,
    budget: int,
    ripple: float,
    seed: int,
    leads: Callable[[Candidate], None] = lambda candidate: None,
) -> Search:
    """Yield the runs to be made next, be sent what they have shown in the same order, and return the history.

    It follows from the arguments and from what is sent alone.

    Args:
        space: in which to search.
        stability: on these machines.
        machines: number of them.
        budget: most runs, at least `least_budget`.
        ripple: most torque ripple, a share of the peak torque.
        seed: of the random numbers.
        leads: called with every candidate that is the best so far.
    """
    start = Candidate(0, 1, space.start, float(stability.excess(space.start).max()))
    known, leaders = [start], [start]
    runs = yield from _run(start, range(machines), 0)
    leads(start)
    guess = stability.fastest(space, space.begin[1], Fastest(np.zeros(space.groups)))
    optimiser = _optimiser(space, guess, seed)
    generation, unstable, fruitless, improved = 0, 0, 0, (0, math.inf)
    ended: Ended | None = None
    while ended is None:
        generation += 1
        asked = [optimiser.ask() for _ in range(optimiser.population_size)]
        candidates = []
        for number, place in enumerate(asked, 1):
            candidate, guess = _placed(space, stability, place, guess)
            candidate.generation, candidate.number = generation, number
            candidates.append(candidate)
        kept = [candidate for candidate in candidates if candidate.excess <= 0]
        unstable += len(candidates) - len(kept)
        room = budget - runs - (machines - 1)  # so that one which would be the best can be run on all machines
        if kept and room <= 0:
            ended = "budget"
            break
        going = kept[:room]
        if going:
            machine = leaders[-1].hardest
            found = yield [Trial(candidate, machine) for candidate in going]
            for candidate, measured in zip(going, found, strict=True):
                runs += 1
                candidate.measured[machine], candidate.runs = measured, runs
            known += going
        contenders = list(going)
        while contenders:
            first = min(contenders, key=lambda candidate: candidate.order(ripple))
            if first.order(ripple) >= leaders[-1].order(ripple):
                break
            others = [machine for machine in range(machines) if machine not in first.measured]
            if not others:
                leaders.append(first)
                leads(first)
            elif budget - runs < len(others):
                break
            else:
                runs = yield from _run(first, others, runs)
                continue
            contenders.remove(first)
        if len(going) < len(kept):
            ended = "budget"
            break
        ranks = {id(c): rank for rank, c in enumerate(sorted(candidates, key=lambda c: c.order(ripple)))}
        optimiser.tell([(place, ranks[id(c)]) for place, c in zip(asked, candidates, strict=True)])
        fruitless = 0 if kept else fruitless + 1
        rank, figure = leaders[-1].order(ripple)
        if rank > 1 or figure < improved[1] * (1 - _PROGRESS):
            improved = (generation, figure if rank == 1 else math.inf)
        if _narrow(asked, space.groups):
            ended = "converged"
        elif generation - improved[0] >= _PATIENCE:
            ended = "no progress"
        elif fruitless >= _FRUITLESS:
            ended = "no candidate"
    return History(known, leaders, unstable, runs, generation, ended)


def _run(candidate: Candidate, machines: Iterable[int], runs: int) -> Generator[list[Trial], list[Measured], int]:
    """Run a candidate on machines, and return the number of all runs after that."""
    trials = [Trial(candidate, machine) for machine in machines]
    found = yield trials
    candidate.measured |= {trial.machine: one for trial, one in zip(trials, found, strict=True)}
    candidate.runs = runs + len(trials)
    return candidate.runs


def _optimiser(space: Space, fastest: Fastest, seed: int) -> CMA:
    """Return the optimiser at the start, given the fastest loops of its shape."""
    from cmaes import CMA  # slow to import

    frequencies, shape = space.begin
    rho = np.minimum(frequencies - fastest.frequencies, 0.0) if fastest.excess <= 0 else np.zeros(space.groups)
    bounds = np.concatenate([np.stack([rho + _RHO[0], np.full(space.groups, _RHO[1])], axis=1), space.bounds])
    return CMA(np.concatenate([rho, shape]), _SIGMA, bounds=bounds, seed=seed)


def _placed(space: Space, stability: Stability, place: Floats, guess: Fastest) -> tuple[Candidate, Fastest]:
    """Return the candidate at a place of the search, and the fastest of its shape where the margin can be kept."""
    rho, shape = place[: space.groups], place[space.groups :]
    fastest = stability.fastest(space, shape, guess)
    if fastest.excess > 0:
        return Candidate(0, 0, space.servo(fastest.frequencies, shape), fastest.excess), guess
    servo = space.servo(fastest.frequencies + np.minimum(rho, 0.0), shape)
    return Candidate(0, 0, servo, float(stability.excess(servo).max())), fastest


def _narrow(asked: list[Floats], groups: int) -> bool:
    """Return whether the candidates of a generation are all but one."""
    places = np.array(asked)
    places[:, :groups] = np.minimum(places[:, :groups], 0.0)
    return bool(places.std(axis=0).max() < _CONVERGED)
