"""The report of a study of laws."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from gantrysim.base.quantity import MAX, RMS, Quantity
from gantrysim.metrics.error_quantities import CONTOUR, FOLLOWING_ALONG
from gantrysim.report.document import Column, Table
from gantrysim.report.plots.style import sheet
from gantrysim.results.checks import FAIL
from gantrysim.results.colours import BAD, INK, RUNS
from gantrysim.results.quantities import TORQUE_RIPPLE
from gantrysim.results.verdict import GLUE, MACHINE, PATH, STABILITY
from gantrysim.servo.stability.margins import GAIN_MARGIN, PHASE_MARGIN, SENSITIVITY
from gantrysim.study.acceptance import Acceptance, Scope, improve_command, settings_text
from gantrysim.study.cases import ASPECTS, LIMIT_USE, OK, Row, state_column, use_column
from gantrysim.study.drawing import logarithmic
from gantrysim.study.laws.study import (
    EXACT_ENCODER,
    FOLLOWING_TOGETHER,
    LOADED,
    MORE_FRICTION,
    NOMINAL,
    REPEATED_RUNS,
    REVERSAL,
    LawsStudy,
    chosen,
)
from gantrysim.study.study import Details, Plot, Report

if TYPE_CHECKING:
    from matplotlib.figure import Figure


# The answer of a study of laws: the cheapest law that keeps the job's limits, or the one that comes nearest.

QUESTION = "Which law of the servo does this job need?"


def laws_answer(study: LawsStudy, nominal: dict[str, Row]) -> str:
    """Return the answer from the rows of the laws on the nominal machine that have values, by law."""
    judged = judged_laws(study, nominal)
    if not judged:
        return "No law has a run that was judged by the job's tolerance, so none is recommended."
    scope = _scope(study, judged)
    sufficient = [law for law, acceptance in judged.items() if scope.keeps(acceptance)]
    if not sufficient:
        return _none(study, judged, scope)
    law = sufficient[0]
    cheapest = f"the cheapest of {len(judged)} laws that keeps {scope.words}, with {scope.usage(judged[law])}"
    remark = scope.remark(judged[law])
    present = _present(study)
    if present in sufficient and present != law:
        usage = f"{judged[present].use(scope.aspects):.3g} % used"
        return (
            f"{law} ({_change(study, law)}) is {cheapest}{remark}; the job's own law {present} keeps the same limits, "
            f"with {usage}, and need not change."
        )
    verb = "Keep" if present == law else "Set"
    return f"{verb} {_change(study, law)}: {law} is {cheapest}{remark}."


def _scope(study: LawsStudy, judged: dict[str, Acceptance]) -> Scope:
    """Return the limits by which laws are compared; glue that fails with all is no worse than with the job's own."""
    return Scope.of(judged.values(), judged.get(_present(study)))


def judged_laws(study: LawsStudy, nominal: dict[str, Row]) -> dict[str, Acceptance]:
    """Return the verdicts by law, the cheapest law first: with the fewest parts, then in the order of the ladder."""
    judged = {}
    # a stable sort: the ladder's order remains
    for rung in sorted(study.ladder, key=lambda rung: len(rung.law)):
        acceptance = Acceptance.of(nominal[rung.name]) if rung.name in nominal else None
        if acceptance is not None:
            judged[rung.name] = acceptance
    return judged


def _none(study: LawsStudy, judged: dict[str, Acceptance], scope: Scope) -> str:
    nearest = min(judged, key=lambda law: judged[law].use(scope.aspects))
    present = _present(study)
    against = ""
    if present in judged and present != nearest:
        against = f", and the job's own law {present} has {scope.excess(judged[present])}"
    return (
        f"None of {len(judged)} laws keeps {scope.words}: {nearest} ({_change(study, nearest)}) comes nearest, at "
        f"{scope.excess(judged[nearest])}{against}; {improve_command(study.job)} tries what else can be changed."
    )


def _change(study: LawsStudy, law: str) -> str:
    return settings_text(study.overrides(*next(rung for rung in study.ladder if rung.name == law)))


def _present(study: LawsStudy) -> str:
    """Return the rung that is the job's own law; empty if it has another."""
    names = study.job.built_servo.laws.names
    return next((rung.name for rung in study.ladder if rung.law == names and rung.integral == 1), "")


_PAYING_SHARE = 0.95  # of the value without a law's last addition, below which the addition pays
_PD = "pd"
_PID = "pid"
_SHOWN = {"following_rms_um": "following error", "reversal_max_um": "reversals", "contour_rms_um": "contour"}
# values of a row, with the format of their column
_SHOWN_VALUES: tuple[tuple[Quantity[Any], str], ...] = (
    (FOLLOWING_ALONG.statistic(RMS), ".3g"),
    (REVERSAL, ".3g"),
    (CONTOUR.statistic(RMS), ".4g"),
    (CONTOUR.statistic(MAX), ".4g"),
    (TORQUE_RIPPLE, ".2g"),
    (GAIN_MARGIN, ".3g"),
    (PHASE_MARGIN, ".3g"),
    (SENSITIVITY, ".3g"),
)
_ASPECT_COLOURS = {
    PATH: INK,
    GLUE: RUNS[0],
    STABILITY: RUNS[1],
    MACHINE: RUNS[2],
}
_LIMIT = 100.0  # [%]
_VALUES = {
    "following error, rms": ("following_rms_um", RUNS[0]),
    "largest after a reversal": ("reversal_max_um", RUNS[1]),
    "contour, rms": ("contour_rms_um", INK),
}
_CAPTION = (
    "Each law on the nominal machine. Lag is the following error along the path while glue flows; Ti/3 is a third of "
    "the job's integral time."
)
_LEFT_OUT = (
    "Margins are exact for pd, pid, p-pi and observer; those of contour hold where the path runs across the axis. "
    "Friction and its compensation, torques sent along, encoder counts and limits are not in them."
)


def report(study: LawsStudy, rows: Sequence[Row]) -> Report:
    """Return the law to choose, the gain of each law over PD, and the laws that do not pay."""
    nominal = chosen(rows, NOMINAL)
    if not nominal:
        return Report(QUESTION, f"Not known: no law has a run with values: {rows[0]['status']}.")
    chart = _chart(study, nominal)
    missing = [f"{row['law']}, {row['variation']}: {row['status']}" for row in rows if row["status"] != OK]
    details = Details(
        [_best(nominal), *_paying(nominal), _LEFT_OUT, *missing],
        [_variations(study, rows)],
        _plots(study, rows, nominal),
    )
    return Report(QUESTION, laws_answer(study, nominal), chart, _table(study, nominal), details)


def _best(nominal: dict[str, Row]) -> str:
    best = min(nominal, key=lambda law: _value(nominal[law], "following_rms_um"))
    least = _value(nominal[best], "following_rms_um")
    text = f"Law {best} tracks best: {least:.3g} µm rms"
    if _PD not in nominal:
        return f"{text}; PD, to compare with, has no run with values."
    of_pd = _value(nominal[_PD], "following_rms_um")
    return f"{text}, {of_pd / least:.3g} times better than PD at {of_pd:.3g} µm."


def _chart(study: LawsStudy, nominal: dict[str, Row]) -> Plot | None:
    """Return the use of the limits by law, the cheapest law on top; None where no run is judged."""
    judged = judged_laws(study, nominal)
    if not judged:
        return None
    shown = {}
    for aspect in ASPECTS:
        values = [_value(nominal[law], use_column(aspect)) for law in judged]
        if any(value > 0 for value in values):
            shown[aspect] = (values, _ASPECT_COLOURS[aspect])
    figure = _bars(list(judged), shown, LIMIT_USE.head)
    (axes,) = figure.axes
    axes.axvline(_LIMIT, color=BAD, lw=1.2, ls="--", zorder=1)
    return Plot(
        "limits",
        "Limits by law",
        "The largest use of a limit by each law, cheapest on top, for each row of the verdict; the run fails right of "
        "100 %, the dashed line.",
        figure,
    )


def _plots(study: LawsStudy, rows: Sequence[Row], nominal: dict[str, Row]) -> list[Plot]:
    plots = [
        Plot(
            "ladder",
            "Errors by law",
            "Following error of the linear axes together, its peak within 0.1 s after a reversal, and the distance of "
            "the nozzle from the requested path, with the job's own encoder.",
            _draw(nominal),
        ),
        Plot(
            "robustness",
            "Sensitivity",
            f"Following error on the nominal machine, with an exact encoder, with {study.payload:g} kg more, and with "
            f"{study.friction:g} times the friction.",
            _draw_variations(study, rows),
        ),
    ]
    repeats = [row for row in rows if row["variation"] == REPEATED_RUNS and row["status"] == OK]
    if repeats:
        plots.append(
            Plot(
                "repeats",
                "Learning over repeats",
                "With an exact encoder.",
                _draw_repeats(repeats, chosen(rows, EXACT_ENCODER)),
            )
        )
    return plots


def _value(row: Row, name: str) -> float:
    value = row.get(name)
    return float(value) if isinstance(value, float) else float("nan")


def _paying(nominal: dict[str, Row]) -> list[str]:
    """Return a note for each value with the laws whose last addition hardly reduces it."""
    without = {law: nominal[_without(law)] for law in nominal if _without(law) in nominal}
    notes = []
    for name, words in _SHOWN.items():
        idle = [
            law for law, row in without.items() if not _value(nominal[law], name) < _PAYING_SHARE * _value(row, name)
        ]
        if idle:
            notes.append(f"The last addition gains less than 5 % in {words}: {', '.join(idle)}.")
    return notes


def _without(law: str) -> str:
    """Return a law without its last addition: PID before P-PI, PD before PID, nothing before PD."""
    before, _, last = law.rpartition("+")
    return before or {_PD: "", _PID: _PD}.get(last, _PID)


def _table(study: LawsStudy, nominal: dict[str, Row]) -> Table:
    judged = judged_laws(study, nominal)
    scope = _scope(study, judged)
    columns: list[str | Column] = [
        "law",
        Column(FOLLOWING_TOGETHER.head, ".3g"),
        Column("PD / law", ".3g"),
        *(Column(quantity.head, form) for quantity, form in _SHOWN_VALUES),
        Column(f"closest limit [{LIMIT_USE.unit}]", LIMIT_USE.form),
        "fails",
    ]
    pd = _value(nominal.get(_PD, {}), "following_rms_um")
    cells = []
    for law, row in nominal.items():
        following = _value(row, "following_rms_um")
        others = [None if row[quantity.key] is None else _value(row, quantity.key) for quantity, _ in _SHOWN_VALUES]
        failed = ", ".join(aspect for aspect in ASPECTS if row.get(state_column(aspect)) == FAIL)
        use = None if law not in judged else judged[law].use(scope.aspects)
        cells.append([law, following, None if _PD not in nominal else pd / following, *others, use, failed or "–"])
    caption = f"{_CAPTION} Closest limit: largest use of {scope.words}."
    return Table(columns, cells, caption=caption)


def _variations(study: LawsStudy, rows: Sequence[Row]) -> Table:
    variations = {variation: chosen(rows, variation) for variation in (NOMINAL, EXACT_ENCODER, LOADED, MORE_FRICTION)}
    columns: list[str | Column] = [
        "law",
        Column("nominal", ".3g"),
        Column("exact encoder", ".3g"),
        Column(f"{study.payload:g} kg more", ".3g"),
        Column(f"friction x {study.friction:g}", ".3g"),
    ]
    cells: list[list[Any]] = []
    for law in variations[NOMINAL]:
        errors = [_value(by_law[law], "following_rms_um") if law in by_law else None for by_law in variations.values()]
        cells.append([law, *errors])
    return Table(columns, cells, caption="Following error, rms [µm], on machines that differ from the laws' models.")


def _draw(nominal: dict[str, Row]) -> Figure:
    shown = {}
    for label, (name, colour) in _VALUES.items():
        shown[label] = ([_value(row, name) for row in nominal.values()], colour)
    return _bars(list(nominal), shown, "error [µm]")


def _draw_variations(study: LawsStudy, rows: Sequence[Row]) -> Figure:
    labels = {
        NOMINAL: "nominal",
        EXACT_ENCODER: "exact encoder",
        LOADED: f"{study.payload:g} kg more",
        MORE_FRICTION: f"friction x {study.friction:g}",
    }
    laws = list(chosen(rows, NOMINAL))
    shown = {}
    for (variation, label), colour in zip(labels.items(), RUNS, strict=False):
        by_law = chosen(rows, variation)
        values = [_value(by_law[law], "following_rms_um") if law in by_law else float("nan") for law in laws]
        shown[label] = (values, colour)
    return _bars(laws, shown, "following error, rms [µm]")


def _bars(laws: list[str], shown: dict[str, tuple[list[float], str]], label: str) -> Figure:
    """Return points by law, from the top, on a logarithmic scale."""
    with sheet(9.0, 0.42 * len(laws) + 1.6) as figure:
        axes = figure.add_subplot()
        places = np.arange(len(laws))[::-1]
        drawn = []
        # a shape for each, as colours alone are alike to some eyes
        for shape, (name, (values, colour)) in zip("oDs^", shown.items(), strict=False):
            axes.plot(values, places, shape, ms=6, color=colour, label=name)
            drawn += [value for value in values if value > 0]
        axes.set_yticks(places, laws)
        logarithmic(axes, "x", drawn)
        axes.set(xlabel=label)
        figure.legend(loc="outside lower center", ncols=len(shown))
    return figure


def _draw_repeats(rows: Sequence[Row], exact: dict[str, Row]) -> Figure:
    with sheet(9.0, 4.2) as figure:
        axes = figure.add_subplot()
        counts = [0, *(int(str(row["repeats"])) for row in rows)]
        values = [_value(exact.get(_PID, {}), "following_rms_um"), *(_value(row, "following_rms_um") for row in rows)]
        axes.plot(counts, values, "o-", color=INK)
        logarithmic(axes, "y", [value for value in values if value > 0])
        axes.set(xlabel="repeats learnt from", ylabel="following error, rms [µm]")
    return figure
