"""The page of an identification: log and fit, friction, values, what is not identified and why, what to record next."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from gantrysim.identify.checks.judgement import INTERVAL, Judgement
from gantrysim.identify.checks.parameters import BALANCE, PARTS_OF_LOG, PLAUSIBILITY
from gantrysim.identify.checks.residual import CLIPPED_TORQUE, COUNTS, RESIDUAL, SMOOTHED
from gantrysim.identify.checks.sampling import CHECK as SAMPLING
from gantrysim.identify.identification import Identification, IdentifiedValue, friction_words, verdict
from gantrysim.identify.log import Log
from gantrysim.identify.plots import draw_course, draw_friction, draw_moves_response, draw_residuals, draw_values
from gantrysim.identify.result import EDGE, KNOWN_INTERVAL, LABELS, MODE, AxisFit
from gantrysim.identify.sizes import share_words
from gantrysim.identify.whole_run import WholeRun
from gantrysim.report.document import Column, Section, Table
from gantrysim.report.drawn_page import DrawnPage, draw_page
from gantrysim.report.sections import drawn_plot
from gantrysim.report.summary import versions
from gantrysim.tables.units import TORQUE

REPORT = "report.html"
_WIDTH = 10.7  # of a plot across the page [inch]
_ROW = 0.3  # height of a value in the plot of all
_FACTS = ("inertia", "viscous", "coulomb", "offset")  # shown large where they are identified

# What another log must have, by the check that forbids a value, and by value where its interval is too wide.

_SPEEDS = "moves at constant speeds, slow ones and up to the speed limit, forwards and back alike"
_QUICK_STROKES = "short, quick strokes, which sweep the spectrum, with the torque demand at every servo tick"
_BY_VALUE = {
    "inertia": "strokes with more acceleration: the torque must be well above friction",
    "viscous": _SPEEDS,
    "viscous_forward": _SPEEDS,
    "viscous_back": _SPEEDS,
    "coulomb": "moves at constant slow speeds, forwards and back alike, over the same travel",
    "static": "creeping moves below the Stribeck speed, with reversals, and an encoder of finer counts",
    "offset": "moves at equal speeds forwards and back, over the same travel",
    "delay": _QUICK_STROKES,
    **dict.fromkeys((*MODE, "gap"), _QUICK_STROKES),
}
_BY_CHECK = {
    **dict.fromkeys(
        (SAMPLING, RESIDUAL), "torque demand and encoder counts, unfiltered, at every servo tick, by one clock"
    ),
    COUNTS: "a log without missing rows, once the encoder counts reliably",
    CLIPPED_TORQUE: "a wider range of the recorder, or weaker moves: the torque must not be cut",
    SMOOTHED: "the counts of the encoder, neither filtered nor interpolated",
    PARTS_OF_LOG: "a longer log: each speed, torque and place of the travel several times, forwards and back",
    BALANCE: "a longer log of a warm machine: the same moves several times, over the whole travel",
    PLAUSIBILITY: "the same moves, once unit, gear, payload and the order of the columns are checked",
}
_STATIC = "static"


def identification_page(identification: Identification, log: Log, runs: Sequence[WholeRun] = ()) -> DrawnPage:
    """Return the page of an identification, ready to be written.

    Args:
        identification: of the log.
        log: of the axes.
        runs: of the fitted machine under the log's torque, by axis.
    """
    time = log.time
    pieces = f" in {len(log.starts)} pieces" if len(log.starts) > 1 else ""
    unidentified = "; ".join(identification.unidentified)
    return draw_page(
        f"{identification.machine.name}, identified from a log",
        f"{len(time):,} samples{pieces}, {1e3 * log.period:g} ms apart, over {time[-1] - time[0]:.4g} s; "
        f"{'axis' if len(log.axes) == 1 else 'axes'} {', '.join(log.axes)}",
        list(_sections(identification, log, runs)),
        warning=f"Not identified: {unidentified}." if unidentified else None,
    )


def _sections(identification: Identification, log: Log, runs: Sequence[WholeRun]) -> Iterator[Section]:
    fits = identification.fits
    judgements = identification.judgements
    values = identification.values
    known = sum(value.identified for value in values)
    yield Section(
        "Summary",
        f"{known} of {len(values)} values are identified: half their 95 % interval is within {KNOWN_INTERVAL:.0%} of "
        "the value.",
        figure=drawn_plot(draw_values, values, _WIDTH, 1.2 + _ROW * len(values)),
        facts=list(_facts(values, runs)),
    )
    yield Section(
        "Identified values",
        [
            *_headlines(identification),
            "Inertia, viscous friction, stiffness and damping are those of the axis, other torques those at the motor "
            "shaft. The interval holds the value with 95 % confidence.",
        ],
        table=_values(identification),
    )
    yield _not_identified(identification, values)
    yield Section("What to record next", table=_next_log(identification))
    yield Section(
        "Log and fit",
        "Each position is predicted from all samples before it. The residual is what the model does not know of the "
        "next position; where the model is right, it is noise of encoder and torque.",
        figure=[drawn_plot(draw_course, (fit, log), _WIDTH, 8.0) for fit in fits],
        table=_remainder_table(fits),
    )
    yield Section(
        "Friction",
        [
            "Torque of the log less those of acceleration and constant torque, low-passed, where the axis slides.",
            *(f"{friction_words(fit)}." for fit in fits),
        ],
        figure=[drawn_plot(draw_friction, (fit, log), _WIDTH, 4.6) for fit in fits],
    )
    if runs:
        yield Section("Whole run", [f"{run.sentence}." for run in runs])
    yield Section(
        "Residual and response",
        [
            f"{verdict(fit, log.period, doubted=bool(judgement.findings))}."
            for fit, judgement in zip(fits, judgements, strict=True)
        ],
        figure=[lambda: draw_residuals(fits, log.period), lambda: draw_moves_response(fits, log.period)],
    )
    if notes := _notes(identification, log):
        yield Section("Notes", notes)
    table = Table(["", "version"], [list(item) for item in versions(identification.machine).items()])
    yield Section("Versions", table=table)


def _headlines(identification: Identification) -> list[str]:
    """Return what is identified of each axis, and what is not, in a sentence."""
    lines = []
    for fit in identification.fits:
        values = [value for value in identification.values if value.axis == fit.axis]
        known = [f"{_label(value)} {_Shown.of(value).text}" for value in values if value.identified]
        unknown = [_label(value) for value in values if not value.identified]
        text = f"Axis {fit.axis}: {len(known)} of {len(values)} values identified"
        text += f": {', '.join(known)}" if known else ""
        lines.append(f"{text}; not identified: {', '.join(unknown)}." if unknown else f"{text}.")
    return lines


def _label(value: IdentifiedValue) -> str:
    return LABELS.get(value.name, value.name)


class _Shown(NamedTuple):
    """A value with its interval in a unit of a handy size."""

    unit: str
    nominal: float
    value: float
    low: float
    high: float

    @classmethod
    def of(cls, value: IdentifiedValue) -> _Shown:
        """Return torques below 0.1 N·m in mN·m, delays in ms, backlash in µm or mdeg, and stiffness in N/µm."""
        numbers = (value.nominal, value.value, value.low, value.high)
        large = value.unit == TORQUE and max(map(abs, numbers)) >= _SMALL_TORQUE
        unit, factor = (value.unit, 1.0) if large else _SMALLER_UNITS.get(value.unit, (value.unit, 1.0))
        return cls(unit, *(factor * number for number in numbers))

    @property
    def text(self) -> str:
        """The value with half its interval, to the place of that interval's second digit."""
        half = 0.5 * (self.high - self.low)
        if not (math.isfinite(half) and half > 0):
            return f"{self.value:.4g} {self.unit}".rstrip()
        places = max(1 - math.floor(math.log10(half)), 0)
        if places > _MOST_PLACES:
            return f"{self.value:.4g} ± {half:.2g} {self.unit}".rstrip()
        return f"{self.value:,.{places}f} ± {half:,.{places}f} {self.unit}".rstrip()


_SMALLER_UNITS = {
    TORQUE: ("mN·m", 1e3),
    "s": ("ms", 1e3),
    "mm": ("µm", 1e3),
    "deg": ("mdeg", 1e3),
    "N/m": ("N/µm", 1e-6),
}
_SMALL_TORQUE = 0.1  # [N·m]
_MOST_PLACES = 6


def _facts(values: Sequence[IdentifiedValue], runs: Sequence[WholeRun]) -> Iterator[tuple[str, str, str]]:
    for value in values:
        if value.name in _FACTS and value.identified:
            shown = _Shown.of(value)
            nominal = f"nominal {shown.nominal:.4g} {shown.unit}"
            yield f"{value.axis}: {_label(value)}", shown.text, nominal
    for run in runs:
        if not run.missing and run.torque > 0:
            remark = "of the log's torque is missing in the whole run" if run.repeats else "is missing: too much"
            yield f"{run.axis}: torque not explained", share_words(run.written / run.torque).removesuffix(" of"), remark


def _values(identification: Identification) -> Table:
    heads: list[str | Column] = ["axis", "quantity", *map(Column, ("nominal", "fitted", "from", "to"))]
    pairs = zip(identification.fits, identification.judgements, strict=True)
    adopted = {fit.axis: judgement.adopted(fit) for fit, judgement in pairs}
    rows = []
    for value in identification.values:
        shown = _Shown.of(value)
        words = "identified" if value.identified else f"not identified: {value.reason}"
        written = "fitted" if value.name in adopted[value.axis] else "nominal"
        rows.append(
            [
                *(value.axis, _label(value), shown.nominal, shown.value, shown.low, shown.high, shown.unit, words),
                "no part of it" if value.name in _OF_NO_MACHINE else written,
            ]
        )
    return Table([*heads, "unit", "by the log", "in the machine written"], rows)


_OF_NO_MACHINE = ("delay", "gap")


def _not_identified(identification: Identification, values: Sequence[IdentifiedValue]) -> Section:
    """Return which values are not identified and why: the checks that forbid them, each with its reason."""
    if all(value.identified for value in values):
        return Section("Not identified", "Every value that is fitted is identified.")
    rows = []
    judgements = {}
    for fit, judgement in zip(identification.fits, identification.judgements, strict=True):
        judgements[fit.axis] = judgement
        for finding in judgement.findings:
            names = [LABELS.get(name, name) for name in finding.values if name in fit.estimates]
            if names or not finding.values:
                rows.append([fit.axis, ", ".join(names) or "all", finding.check, finding.reason])
    for value in values:
        if not value.identified and value.reason == INTERVAL:
            share = share_words(0.5 * (value.high - value.low) / max(abs(value.value), 1e-300))
            rows.append([value.axis, _label(value), INTERVAL, f"half the 95 % interval is {share} the value"])
        elif not value.identified and not _is_named(value, judgements[value.axis]):
            rows.append([value.axis, _label(value), value.reason, "the log does not reach it"])
    return Section(
        "Not identified",
        "A value is not identified if a check forbids it, or if half its interval exceeds 15 % of it (40 %: damping).",
        table=Table(["axis", "values", "check", "reason"], rows),
    )


def _is_named(value: IdentifiedValue, judgement: Judgement) -> bool:
    return any(not finding.values or value.name in finding.values for finding in judgement.findings)


def _next_log(identification: Identification) -> Table:
    """Return what another log must have, and for which values."""
    wanted: dict[str, list[str]] = {}
    for value in identification.values:
        if value.identified:
            continue
        reasons = value.reason.split(", ")
        advice = [_BY_CHECK[reason] for reason in reasons if reason in _BY_CHECK]
        # a check of one value alone has found that the log does not show it
        if value.name == _STATIC and PLAUSIBILITY in reasons:
            advice = [_BY_VALUE[_STATIC]]
        for text in dict.fromkeys(advice) or [_BY_VALUE.get(value.name, _QUICK_STROKES)]:
            wanted.setdefault(text, []).append(f"{value.axis}: {_label(value)}")
    for fit, judgement in zip(identification.fits, identification.judgements, strict=True):
        for finding in judgement.findings:
            if finding.check in (CLIPPED_TORQUE, SMOOTHED):
                wanted.setdefault(_BY_CHECK[finding.check], []).append(f"{fit.axis}: all values")
        if fit.nominal.share and not fit.shows_mode:
            wanted.setdefault(_fast_log(fit), []).append(f"{fit.axis}: mode")
    rows = [[text, "; ".join(dict.fromkeys(names))] for text, names in wanted.items()]
    rows.append(["another log of other moves, for gantrysim replay", "a judgement of the machine written"])
    plan = "gantrysim identify --plan writes the program of moves that show every value"
    return Table(["record", "for"], rows, plan)


def _fast_log(fit: AxisFit) -> str:
    """Return what a log must have to show the mode of the machine's table: half the rate of torque demands is above."""
    rate = 2 * fit.nominal.resonance / EDGE
    rounded = math.ceil(rate / _ROUND_RATE) * _ROUND_RATE
    return f"the torque demand, which is known between samples too, at {rounded:,} samples per second or more"


_ROUND_RATE = 100  # [1/s]


def _remainder_table(fits: Sequence[AxisFit]) -> Table:
    rows = [
        [fit.axis, fit.law.size, fit.law.remainder, 100 * fit.law.remainder / max(fit.law.size, 1e-300)] for fit in fits
    ]
    heads: list[str | Column] = [
        "axis", Column("torque, sliding [N·m rms]"), Column("not fitted [N·m rms]", ".2g"), Column("share [%]", ".2g"),
    ]  # fmt: skip
    return Table(heads, rows, "Low-passed torque of the sliding axis, and what acceleration and friction leave of it")


def _notes(identification: Identification, log: Log) -> list[str]:
    """Return the notes that no other section has."""
    shown = {friction_words(fit) for fit in identification.fits}
    for fit, judgement in zip(identification.fits, identification.judgements, strict=True):
        shown |= {*judgement.notes(fit.axis), verdict(fit, identification.period, doubted=bool(judgement.findings))}
    notes = [*log.notes, *identification.notes]
    return [f"{note}." for note in notes if note not in shown]
