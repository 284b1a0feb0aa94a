"""What a search has found, in words."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gantrysim.controllers.servo import GAIN_NAMES, Servo
from gantrysim.metrics.budget import LINKS, Budget
from gantrysim.study.cases import OK, Row
from gantrysim.tuning.laws import SEARCHED
from gantrysim.tuning.objective import column
from gantrysim.tuning.search import Candidate, History
from gantrysim.tuning.servo import TUNED, unit_of
from gantrysim.tuning.stability import Stability

if TYPE_CHECKING:
    from gantrysim.tuning.study import TuningStudy

NOTHING = 1e-3  # rms of an error that is none [µm]

_UM = 1e3
_AT_LIMIT = 0.98  # of a bound, from which it holds the gains back
_ROUNDED = 2e-3  # relative, between factors that differ by the rounding of gains alone
_MOSTLY, _ALL = 0.5, 0.995  # of the mean square
_BEYOND = 1.1  # times the figure of the search, which a machine not seen may have
_ENDED = {
    "budget": "It ended with its budget.",
    "converged": "It ended where the candidates of a generation differed by less than 2 %.",
    "no progress": "It ended after 25 generations in which the figure became better by less than 0.2 %.",
    "no candidate": "It ended after 200 generations without a candidate that keeps the margin.",
}


def findings(study: TuningStudy, rows: list[Row]) -> list[str]:
    """Return what has become better and what has not, the gains, and how they do on machines not seen."""
    history = study.history(rows)
    start, best = history.start, history.best
    paragraphs = [_outcome(study, start, best), *_links(study, start, best), *_gains(study, start.servo, best.servo)]
    paragraphs.append(_bounds(study, start, best))
    if study.unseen:
        paragraphs.append(_unseen(study, rows, best))
    return [*paragraphs, _search(study, history)]


def label(figure: str) -> str:
    """Return a figure in words, as in "rms contour error"."""
    link, _, statistic = figure.partition("_")
    return f"{ {'rms': 'rms', 'p95': '95 %', 'max': 'largest'}[statistic] } {link} error"


def least_margins(stability: Stability, servo: Servo, machines: int) -> tuple[float, float, float]:
    """Return the least gain margin, the least phase margin [deg] and the largest peak of |S| of axes and machines.

    A loop that is not stable has the factor at which it would be, no phase margin, and inf.
    """
    found = [margins for k in range(machines) for margins in stability.margins(servo, k)]
    return (
        min(margins.gain for margins in found),
        min(margins.phase for margins in found),
        max(margins.sensitivity for margins in found),
    )


def unseen_values(study: TuningStudy, rows: list[Row], stage: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the figure on the machines not seen, before or after, (unseen,) [µm]; inf where there is none."""
    name = column(study.figure)
    return np.array([float(row[name]) if row["status"] == OK else math.inf for row in study.checked(rows, stage)])  # type: ignore[arg-type]


def _outcome(study: TuningStudy, start: Candidate, best: Candidate) -> str:
    what = label(study.figure)
    over = (
        "" if not study.robust else f", the largest over the job's own machine and {study.robust} that differ from it"
    )
    rank, was = best.order(0.01 * study.ripple), start.order(0.01 * study.ripple)
    if best is start:
        text = "No gains were found that are better than the job's own, with which the "
        text += f"{what} is {_um(best.figure)}{over}."
        return f"{text} {_wanting(study, rank)}".rstrip()
    if not math.isfinite(start.figure):
        text = f"With the job's own gains a fault ends the run. Those found go through, with a {what} of "
        text += f"{_um(best.figure)}{over}."
    elif best.figure > start.figure:
        text = f"The job's own gains, with a {what} of {_um(start.figure)}, {_misses(was)}. The best gains found that "
        text += f"are in order have {_um(best.figure)}{over}."
    else:
        text = f"The gains found bring the {what} from {_um(start.figure)} to {_um(best.figure)}"
        text += f", {100 * best.figure / start.figure:.3g} % of what it was{over}."
        if was[0] > 1:
            text += f" The job's own gains {_misses(was)}."
    return f"{text} {_wanting(study, rank)}".rstrip()


def _wanting(study: TuningStudy, rank: tuple[int, float]) -> str:
    return "" if rank[0] == 1 else f"They {_misses(rank)}: within the budget none were found that are in order."


def _misses(rank: tuple[int, float]) -> str:
    """What gains do that are not in order, by their place in the order of candidates."""
    kind, amount = rank
    if kind == 4:
        return "end in a fault"
    if kind == 3:
        by = "their loop is not stable" if amount >= 10 else f"peak of |S| {math.exp(amount):.3g} times the bound"
        return f"miss the margin ({by})"
    return f"exceed the torque ripple {math.exp(amount):.3g} times"


def _links(study: TuningStudy, start: Candidate, best: Candidate) -> list[str]:
    """Say what of the error is left, and of which link."""
    before, after = study.run(start.servo), study.run(best.servo)
    if after.fault is not None:
        return []
    now = Budget(after).values
    was = None if before.fault is not None else Budget(before).values
    if was is None:
        text = f"On the job's own machine the contour error is {_UM * now.contour.rms:.4g} µm rms: "
    else:
        text = (
            f"On the job's own machine the contour error goes from {_UM * was.contour.rms:.4g} to "
            f"{_UM * now.contour.rms:.4g} µm rms and at most from {_UM * was.contour.max:.4g} to "
            f"{_UM * now.contour.max:.4g} µm: "
        )
    parts = []
    for link in LINKS:
        sizes = [_UM * figures.parts[link].rms for figures in (was, now) if figures is not None]
        parts.append(f"{link} {' to '.join(f'{size:.3g}' for size in sizes)}" if max(sizes) > NOTHING else f"no {link}")
    text += ", ".join(parts)
    text += " µm."
    most = max(now.parts, key=lambda link: now.parts[link].share)
    share = now.parts[most].share
    if most == "generation" and share > _MOSTLY:
        much = "All" if share > _ALL else f"{100 * share:.0f} %"
        text += f" {much} of what is left, by its mean square, is generation: the controller's program, which no gain "
        text += "mends."
        if study.figure.startswith("contour"):
            text += (
                " Gains that make this figure smaller have tracking errors make good for it; tracking_rms is the "
                "figure that tells how well the servo does."
            )
    elif share > _MOSTLY:
        text += f" Most of what is left is the {most} part."
    return [text]


def _gains(study: TuningStudy, before: Servo, after: Servo) -> list[str]:
    """Say what has become of the gains, of axes together where it is the same."""
    if before == after:
        return []
    alike: list[tuple[str, dict[str, float], list[str]]] = []
    for a, axis in enumerate(study.job.built_machine.axes):
        parts, times = [], {}
        for name in GAIN_NAMES:
            old, new = getattr(before, name)[a], getattr(after, name)[a]
            if old > 0 and new > 0:
                times[name] = new / old
                parts.append(f"{name} times {new / old:.3g}")
            elif old != new:  # one of them none
                parts.append(f"{name} from {old:.3g} to {new:.3g} {unit_of(name, [axis.unit])}")
        for _, others, names in alike:
            same = others.keys() == times.keys() and len(times) == len(parts)
            if same and all(math.isclose(others[name], times[name], rel_tol=_ROUNDED) for name in times):
                names.append(axis.name)
                break
        else:
            alike.append((", ".join(parts), times, [axis.name]))
    said = [f"of {_listed(names)} {parts}" for parts, _, names in alike]
    return [f"The gains {'; '.join(said)}. {TUNED} holds them, for gantrysim run --servo."]


def _bounds(study: TuningStudy, start: Candidate, best: Candidate) -> str:
    machines = study.robust + 1
    gain, phase, peak = least_margins(study.stability, best.servo, machines)
    old_gain, old_phase, old_peak = least_margins(study.stability, start.servo, machines)
    over = "axes and machines" if study.robust else "axes"
    text = (
        f"Of all {over} the least gain margin is {gain:.2f}, the least phase margin {phase:.0f} deg and the largest "
        f"peak of |S| {peak:.2f}, where {study.stability.peak:.2f} is the most that a margin of {study.margin:g} lets "
        f"through; before "
    )
    if math.isfinite(old_peak):
        text += f"they were {old_gain:.2f}, {old_phase:.0f} deg and {old_peak:.2f}."
    else:
        text += "there was a loop that is not stable, Coulomb friction apart."
    text += f" The torque ripple is {100 * best.ripple:.2g} % of the peak torque"
    text += f", before {100 * start.ripple:.2g} %" if math.isfinite(start.ripple) else ""
    text += f", and {study.ripple:g} % is the most that may be."
    held = [
        name
        for name, share in (
            ("margin", peak / study.stability.peak),
            ("torque ripple", 100 * best.ripple / study.ripple),
        )
        if _AT_LIMIT <= share <= 1
    ]
    if held:
        text += f" It is the {' and the '.join(held)} that {'holds' if len(held) == 1 else 'hold'} the gains back."
    return text


def _unseen(study: TuningStudy, rows: list[Row], best: Candidate) -> str:
    before, after = (unseen_values(study, rows, stage) for stage in ("before", "after"))
    count, limit = study.unseen, _BEYOND * best.figure
    faults = int(np.sum(~np.isfinite(after)))
    good = [row for row in study.checked(rows, "after") if row["status"] == OK]
    quiet = sum(float(row["torque_ripple_percent"]) <= study.ripple for row in good)  # type: ignore[arg-type]
    stability = study.unseen_stability
    assert stability is not None
    steady = sum(float(stability.excess(best.servo, [k]).max()) <= 0 for k in range(count))
    gain, phase, peak = least_margins(stability, best.servo, count)
    text = (
        f"On {count} machines that the search has not seen the {label(study.figure)} is {_um(_median(after))} on the "
        f"median one (before {_um(_median(before))}) and {_um(float(after.max()))} on the worst "
        f"({_um(float(before.max()))}): {int(np.sum(after <= limit))} of them have no more than 1.1 times that of the "
        f"search."
    )
    if faults:
        text += f" {faults} of them end in a fault."
    return (
        f"{text} {steady} of {count} keep the margin: the largest peak of |S| is {peak:.2f}, the least gain margin "
        f"{gain:.2f} and the least phase margin {phase:.0f} deg. {quiet} keep the torque ripple."
    )


def _median(values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> float:
    return float(np.percentile(values, 50, method="inverted_cdf"))


def _search(study: TuningStudy, history: History) -> str:
    numbers = "each axis by itself" if study.per_axis else "one factor for all axes"
    moved = ", ".join(name for name in SEARCHED if name != "ki" or study.searched_law == "pid")
    ran = len(history.candidates)
    text = (
        f"Law {study.searched_law}: {moved} were searched, {numbers}, by CMA-ES with the seed {study.seed}: "
        f"{history.runs} runs of {ran} candidates in {history.generations} generations, the budget being "
        f"{study.budget} runs"
    )
    if history.unstable:
        more = "one more was" if history.unstable == 1 else f"{history.unstable} more were"
        text += f"; {more} not run, for want of a frequency at which the margin is kept"
    return f"{text}. {_ENDED[history.ended]}"


def _um(figure: float) -> str:
    return f"{figure:.4g} µm" if math.isfinite(figure) else "none (a fault)"


def _listed(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
