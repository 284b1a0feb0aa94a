"""The headline of a run: what spoils it, by how much and where, and its main cause; or the faults that spoilt it."""

from __future__ import annotations

from collections.abc import Iterator

from gantrysim.job.causes import Causes, Effect
from gantrysim.job.losses import happened_events, reached_faults
from gantrysim.metrics.budget import DESCRIPTIONS, Budget
from gantrysim.metrics.error_quantities import CONTOUR, LAG
from gantrysim.results.run_results import RunResults
from gantrysim.results.verdict import GLUE, PATH

NO_ERROR = 1e-6  # rms below which an error counts as none [mm]

# of the mean square
_ALMOST_ALL = 0.9
_MOST_OF_SQUARE = 0.5
# worth of a cause, of the rms error
_CAUSE = 0.9
_MAIN_CAUSE = 0.5
_LEAST_WORTH = 1e-4  # below it effects are numerical noise [mm]


def headline(results: RunResults) -> str:
    """Return what spoils a run: the worst check of the row that is worst, with its cause; else the contour error.

    Of the path it is `contour_sentence`, as of a run that passes, and of one with faults, which says what happened.
    """
    verdict = results.verdict
    row = verdict.worst_row
    if row is None or row.name == PATH or verdict.unjudged or verdict.disturbances:
        return contour_sentence(results.budget, results.causes)
    check = row.worst_check
    if check is None:
        return f"{row.name.capitalize()}: {row.remark}."
    place = check.place.brief
    remark = f" {row.remark[0].upper()}{row.remark[1:]}." if row.remark and row.name != GLUE else ""
    return f"{row.name.capitalize()}: {check.brief}{f', {place}' if place else ''}.{remark}"


def contour_sentence(budget: Budget, causes: Causes | None = None) -> str:
    """Return the contour error with the link that has the largest share, and the error along the path if larger.

    Where the causes are known, it names the one that is worth at least half of the error, or says that there is none.
    For a run that ended in a fault, or came to a deliberate fault, it states what happened. Such a run's error has its
    cause in the fault, in whatever link it lies, so no link is named.
    """
    contour = budget.values.contour
    run = budget.analysis.run
    if run.fault is not None or reached_faults(run):
        return f"{happened_events(run)} {_error_with_faults(budget)}"
    if budget.contradictions:
        return "The errors of this run are not known: they contradict one another, see the verdict."
    along = _along(budget)
    if contour.rms < NO_ERROR:
        exactly = "" if along else " exactly"
        return f"Contour error: none, the nozzle follows the requested path{exactly}.{along}"
    link, part = max(budget.values.parts.items(), key=lambda item: item[1].share)
    portion = _portion(part.share)
    where = f"Contour error: {CONTOUR.text(contour.rms)} rms, {portion} in {link} ({DESCRIPTIONS[link]})."
    sentences = [where] if causes is None else [where, *cause_sentences(causes)]
    return " ".join(sentences) + along


def cause_sentences(causes: Causes) -> Iterator[str]:
    """Yield what causes the error: one cause, where it is worth at least half of it, else that no single one is.

    Effects do not add up, so that several causes may be worth half each; the largest is named.
    """
    known = [effect for effect in causes.effects if effect.worth]
    failed = [effect.cause.name for effect in causes.effects if not effect.worth]
    by_worth = sorted(known, key=_share, reverse=True)
    if by_worth and _share(by_worth[0]) >= _MAIN_CAUSE:
        main = by_worth[0]
        kind = "Cause" if _share(main) >= _CAUSE else "Main cause"
        worth = CONTOUR.text(main.worth["contour"].rms)
        whole = CONTOUR.text(main.before["contour"].rms)
        remaining = CONTOUR.text(main.without["contour"].rms)
        yield f"{kind}: {main.cause.name}, worth {worth} of {whole}; without it {remaining} are left."
    else:
        largest = [effect for effect in by_worth[:2] if effect.worth["contour"].rms > _LEAST_WORTH]
        names = " and ".join(f"{effect.cause.name} ({CONTOUR.text(effect.worth['contour'].rms)})" for effect in largest)
        remark = f"; worth most: {names}" if names else ""
        yield f"No single cause is worth half of it{remark}."
    if failed:
        yield f"Not known, as the run without it failed: {', '.join(failed)}."


def _share(effect: Effect) -> float:
    """Return what a cause is worth of the rms error."""
    whole = effect.before["contour"].rms
    return effect.worth["contour"].rms / whole if whole > 0 else 0.0


def _portion(share: float) -> str:
    if share >= _ALMOST_ALL:
        return "almost all"
    return "mostly" if share > _MOST_OF_SQUARE else "the largest share"


def _error_with_faults(budget: Budget) -> str:
    """Return the size of the contour error of a run with faults, in a sentence."""
    contour = budget.values.contour
    until = "" if budget.analysis.run.fault is None else " until then"
    if contour.rms < NO_ERROR:
        return f"Contour error{until}: none."
    return f"Contour error{until}: {CONTOUR.text(contour.rms)} rms, max {CONTOUR.text(contour.max)}."


def _along(budget: Budget) -> str:
    """Return a sentence on the error along the path, where it is larger than the one normal to it."""
    values = budget.values
    if values.lag.max <= max(values.contour.max, NO_ERROR):
        return ""
    largest = LAG.text(values.lag.max)
    return f" Along the path it is up to {largest} from its command, {LAG.text(values.lag.rms)} rms."
