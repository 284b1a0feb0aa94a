"""The headline of a run: what spoils it, by how much and where, and its main cause; or the faults that spoilt it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from gantrysim.base.quantity import RMS, number_text
from gantrysim.job.causes import Causes, Errors
from gantrysim.job.losses import happened_events, reached_faults
from gantrysim.metrics.budget import DESCRIPTIONS, Budget
from gantrysim.metrics.error_quantities import CONTOUR, LAG
from gantrysim.results.checks import FAIL, Check, Row
from gantrysim.results.glue import THROUGH_GLUE
from gantrysim.results.glue_causes import MAIN_CAUSE, GlueCauses
from gantrysim.results.run_results import RunResults
from gantrysim.results.verdict import GLUE, PATH
from gantrysim.results.verdict_quantities import PLOUGHED

NO_ERROR = 1e-6  # rms below which an error counts as none [mm]

# of the mean square
_ALMOST_ALL = 0.9
_MOST_OF_SQUARE = 0.5
# worth of a cause, of the rms error
_LITTLE_ERROR = 0.05  # of the error, below which what is left without the main cause is not explained
_NAMED = 2  # causes beside the main one
_CAUSES_OVERLAP = 0.05  # by which causes together exceed what is left, from which on that is said
_SHARE_OF_REST = 0.1  # of what is left without the main cause, from which on another one is named
_LEAST_WORTH = 1e-4  # below it effects are numerical noise [mm]
_STATISTICS = {"path_max": "max", "path_p95": "p95"}  # of the contour error, by the limits of the path
_LEAST_OF_GLUE = 0.01  # likewise, of the limit or the value


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
    what = f"{row.name.capitalize()}: {check.brief}{f', {place}' if place else ''}.{remark}"
    if row.name != GLUE:
        return what
    return " ".join([what, *glue_sentences(row, results.glue_causes)])


def contour_sentence(budget: Budget, causes: Causes | None = None) -> str:
    """Return the contour error with the link that has the largest share, and the error along the path if larger.

    Where the causes are known, it names the one that is worth at least half of the error, or says that there is none.
    For a run that ended in a fault, or came to a deliberate fault, it states what happened. Such a run's error has its
    cause in the fault, in whatever link it lies, so no link is named.
    """
    contour = budget.contour_values
    run = budget.analysis.run
    if run.fault is not None or reached_faults(run):
        return f"{happened_events(run)} {_error_with_faults(budget)}"
    if budget.contradictions:
        return "The errors of this run are not known: they contradict one another, see the verdict."
    along = _along(budget)
    if contour.rms < NO_ERROR:
        exactly = "" if along else " exactly"
        return f"Contour error: none, the nozzle follows the requested path{exactly}.{along}"
    link, part = max(budget.part_values.items(), key=lambda item: item[1].share)
    portion = _portion(part.share)
    where = f"Contour error: {CONTOUR.text(contour.rms)} rms, {portion} in {link} ({DESCRIPTIONS[link]})."
    sentences = [where] if causes is None else [where, *cause_sentences(causes)]
    return " ".join(sentences) + along


def cause_sentences(causes: Causes, check: Check | None = None) -> Iterator[str]:
    """Yield what causes the error: one cause, where it is worth at least half of it, else that no single one is.

    Effects do not add up, so that several causes may be worth half each; the largest is named.

    Args:
        causes: of the contour error.
        check: of the path, whose value they lower; None for the rms error.
    """
    statistic = _STATISTICS.get("" if check is None else check.name, RMS.name)
    worths = [
        _Worth(
            effect.cause.name,
            getattr(effect.before["contour"], statistic),
            getattr(effect.worth["contour"], statistic),
            effect.cause.meaning,
            _largest_link(effect.without, statistic),
        )
        for effect in causes.effects
        if effect.worth
    ]
    yield _main_cause(worths, CONTOUR.text, _LEAST_WORTH)
    if failed := [effect.cause.name for effect in causes.effects if not effect.worth]:
        yield f"Not known, as the run without it failed: {', '.join(failed)}."


def _largest_link(errors: Errors, statistic: str) -> str:
    """Return the link with the largest error, in words; empty where no link is known."""
    links = {name: getattr(size, statistic) for name, size in errors.items() if name in DESCRIPTIONS}
    links.pop("contour", None)
    if not links:
        return ""
    largest = max(links, key=lambda name: links[name])
    return f"{largest} ({DESCRIPTIONS[largest]})"


def glue_sentences(row: Row, causes: GlueCauses | None) -> Iterator[str]:
    """Yield what causes the worst value of a row on the glue, where it is known.

    A needle that passes through its bead is no matter of the dispenser: the row's remark says what it does.
    """
    check = row.worst_check
    if check is not None and check.name == PLOUGHED.name:
        yield f"{row.remark[row.remark.find(THROUGH_GLUE) :].capitalize()}."
        others = [check for check in row.checks if check.state == FAIL and check.name != PLOUGHED.name]
        if causes is not None and others:
            first, *further = glue_cause_sentences(causes, others[0])
            measured = others[0].measured
            yield f"{measured[0].upper()}{measured[1:]}: {first[0].lower()}{first[1:]}"
            yield from further
    elif causes is not None:
        yield from glue_cause_sentences(causes)


def glue_cause_sentences(causes: GlueCauses, check: Check | None = None) -> Iterator[str]:
    """Yield what causes a value of the glue, by default the worst one, as `cause_sentences`."""
    check = check or causes.check
    if check is None:
        return
    worths = [
        _Worth(effect.cause.name, check.value, causes.worth(effect, check), effect.cause.meaning)
        for effect in causes.effects
        if not math.isnan(causes.worth(effect, check))
    ]
    unit = f" {check.unit}" if check.unit else ""
    least = min((effect.value(check.name) for effect in causes.effects if effect.row is not None), default=math.nan)
    second_worths = [
        _Worth(effect.cause.name, least, least - effect.value(check.name), effect.cause.meaning)
        for effect in causes.second_effects
        if not math.isnan(effect.value(check.name))
    ]
    yield _main_cause(
        worths,
        lambda value: f"{number_text(value, check.form)}{unit}",
        _LEAST_OF_GLUE * max(check.limit, check.value),
        second_worths,
    )
    if failed := [f"{effect.cause.name} ({effect.failure})" for effect in causes.effects if effect.failure]:
        yield f"Not known: {', '.join(failed)}."


class _Worth(NamedTuple):
    """What a cause is worth of an error.

    Attributes:
        name: of the cause.
        whole: the error with it.
        worth: the error less that without it.
        meaning: of the cause, in a few words.
        largest_link: where on the chain most of the error lies without it, in words; empty where that is unknown.
    """

    name: str
    whole: float
    worth: float
    meaning: str = ""
    largest_link: str = ""

    @property
    def share(self) -> float:
        return self.worth / self.whole if self.whole > 0 else 0.0


def _main_cause(
    worths: Sequence[_Worth], text: Callable[[float], str], least: float, second_worths: Sequence[_Worth] = ()
) -> str:
    """Return the sentence on the cause that is worth most.

    Args:
        worths: of all causes.
        text: returns a value with its unit.
        least: worth below which a cause is not named.
        second_worths: of the other causes, of what is left without the main one; by default of all.
    """
    by_worth = sorted(worths, key=lambda cause: cause.share, reverse=True)
    if by_worth and by_worth[0].share >= MAIN_CAUSE:
        main, *others = by_worth
        name = f"{main.name} ({main.meaning})" if main.meaning else main.name
        rest_worths = sorted(second_worths, key=lambda cause: cause.worth, reverse=True) or others
        if text(main.worth) == text(main.whole):
            return f"All {text(main.whole)} due to {name}."
        return f"{_part(main, text)} due to {name}; {_rest(main, rest_worths, text, least)}."
    named = [cause for cause in by_worth if cause.worth > least][:_NAMED]
    names = " and ".join(
        f"{cause.name} ({text(cause.worth)}{f': {cause.meaning}' if cause.meaning else ''})" for cause in named
    )
    others = by_worth[len(named) :]
    largest = max((cause.worth for cause in others), default=0.0)
    less = (
        f"; none of the other {len(others)} is worth more than {text(max(largest, least))}" if len(others) > 1 else ""
    )
    whole = f"the {text(by_worth[0].whole)}" if by_worth else "it"
    largest_ones = f"; worth most: {names}{less}; what they are worth need not add up" if names else ""
    return f"No single cause is worth half of {whole}{largest_ones}."


def _part(main: _Worth, text: Callable[[float], str]) -> str:
    """Return what a cause is worth of the whole, their unit once: a percentage of percents would be ambiguous."""
    number, *unit = text(main.worth).split()
    whole = text(main.whole)
    return f"{number} of {whole}" if whole.split()[1:] == unit else f"{text(main.worth)} of {whole}"


def _rest(main: _Worth, others: Sequence[_Worth], text: Callable[[float], str], least: float) -> str:
    """Return what is left without the main cause, and of what it is."""
    remaining = main.whole - main.worth
    remainder = f"without it {text(remaining)} are left"
    if remaining < _LITTLE_ERROR * main.whole:
        return remainder
    named = [cause for cause in others if cause.worth > max(least, _SHARE_OF_REST * remaining)]
    # the first may explain it
    named = named[: 1 if named and named[0].worth >= _ALMOST_ALL * remaining else _NAMED]
    names = " and ".join(f"{cause.name} ({text(cause.worth)})" for cause in named)
    if sum(cause.worth for cause in named) > MAIN_CAUSE * remaining:
        overlap = "; causes overlap" if sum(cause.worth for cause in named) > (1 + _CAUSES_OVERLAP) * remaining else ""
        return f"{remainder}, next {names}{overlap}"
    if main.largest_link:
        return f"{remainder}, most of it in {main.largest_link}"
    if names:
        return f"{remainder} by several causes together, alone {names}"
    most = max(others[0].worth, least) if others else math.inf
    if most >= remaining:
        return remainder
    return f"{remainder} by several causes together, none alone more than {text(most)}"


def _portion(share: float) -> str:
    if share >= _ALMOST_ALL:
        return "almost all"
    return "mostly" if share > _MOST_OF_SQUARE else "the largest share"


def _error_with_faults(budget: Budget) -> str:
    """Return the size of the contour error of a run with faults, in a sentence."""
    contour = budget.contour_values
    until = "" if budget.analysis.run.fault is None else " until then"
    if contour.rms < NO_ERROR:
        return f"Contour error{until}: none."
    return f"Contour error{until}: {CONTOUR.text(contour.rms)} rms, max {CONTOUR.text(contour.max)}."


def _along(budget: Budget) -> str:
    """Return a sentence on the error along the path, where it is larger than the one normal to it."""
    lag = budget.lag_values
    if lag.max <= max(budget.contour_values.max, NO_ERROR):
        return ""
    return f" Along the path it is up to {LAG.text(lag.max)} from its command, {LAG.text(lag.rms)} rms."
