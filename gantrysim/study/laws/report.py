"""The report of a study of laws."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from gantrysim.plots.style import AXIS_COLOURS, COLOURS, INK, sheet
from gantrysim.report.document import Column, Table
from gantrysim.study.cases import OK, Row
from gantrysim.study.drawing import logarithmic
from gantrysim.study.laws.study import EXACT, LOADED, NOMINAL, REPEATED, RUBBING, LawsStudy, chosen
from gantrysim.study.study import Plot, Report

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PAYS = 0.95  # of the value without a law's last addition, below which the addition pays
_PD = "pd"
_PID = "pid"
_SHOWN = {"following_rms_um": "following error", "reversal_max_um": "reversals", "contour_rms_um": "contour"}
_VALUES = {
    "following error, rms": ("following_rms_um", COLOURS["servo"]),
    "largest after a reversal": ("reversal_max_um", COLOURS["program"]),
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


def report(study: LawsStudy, rows: list[Row]) -> Report:
    """Return the gain of each law over PD, and the laws that do not pay."""
    nominal = chosen(rows, NOMINAL)
    if _PD not in nominal:
        failed = next(row for row in rows if row["law"] == _PD)
        return Report(f"PD has no values to compare with: {failed['status']}")
    pd = nominal[_PD]
    best = min(nominal, key=lambda law: _value(nominal[law], "following_rms_um"))
    least = _value(nominal[best], "following_rms_um")
    of_pd = _value(pd, "following_rms_um")
    headline = (
        f"Law {best} tracks best: {least:.3g} µm rms, {of_pd / least:.3g} times better than PD at {of_pd:.3g} µm."
    )
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
    repeats = [row for row in rows if row["variation"] == REPEATED and row["status"] == OK]
    if repeats:
        plots.append(
            Plot(
                "repeats",
                "Learning over repeats",
                "With an exact encoder.",
                _draw_repeats(repeats, chosen(rows, EXACT)),
            )
        )
    missing = [f"{row['law']}, {row['variation']}: {row['status']}" for row in rows if row["status"] != OK]
    return Report(
        headline, [_table(nominal), _variations(study, rows)], [*_paying(nominal), _LEFT_OUT, *missing], plots
    )


def _value(row: Row, name: str) -> float:
    value = row.get(name)
    return float(value) if isinstance(value, float) else float("nan")


def _paying(nominal: dict[str, Row]) -> list[str]:
    """Return a note for each value with the laws whose last addition hardly reduces it."""
    without = {law: nominal[_without(law)] for law in nominal if _without(law) in nominal}
    notes = []
    for name, words in _SHOWN.items():
        idle = [law for law, row in without.items() if not _value(nominal[law], name) < _PAYS * _value(row, name)]
        if idle:
            notes.append(f"The last addition gains less than 5 % in {words}: {', '.join(idle)}.")
    return notes


def _without(law: str) -> str:
    """Return a law without its last addition: PID before P-PI, PD before PID, nothing before PD."""
    before, _, last = law.rpartition("+")
    return before or {_PD: "", _PID: _PD}.get(last, _PID)


def _table(nominal: dict[str, Row]) -> Table:
    columns: list[str | Column] = [
        "law",
        Column("following rms [µm]", ".3g"),
        Column("PD / law", ".3g"),
        Column("along the path, rms [µm]", ".3g"),
        Column("reversals max [µm]", ".3g"),
        Column("contour rms [µm]", ".4g"),
        Column("contour max [µm]", ".4g"),
        Column("torque ripple [mN·m]", ".3g"),
        Column("gain margin", ".3g"),
        Column("phase margin [deg]", ".3g"),
        Column("peak of |S|", ".3g"),
    ]
    shown = {  # value and factor from its unit to the column's
        "following_along_rms_um": 1.0,
        "reversal_max_um": 1.0,
        "contour_rms_um": 1.0,
        "contour_max_um": 1.0,
        "torque_ripple_Nm": 1e3,
        "gain_margin": 1.0,
        "phase_margin_deg": 1.0,
        "sensitivity": 1.0,
    }
    pd = _value(nominal[_PD], "following_rms_um")
    cells = []
    for law, row in nominal.items():
        following = _value(row, "following_rms_um")
        others = [None if row[name] is None else factor * _value(row, name) for name, factor in shown.items()]
        cells.append([law, following, pd / following, *others])
    return Table(columns, cells, caption=_CAPTION)


def _variations(study: LawsStudy, rows: list[Row]) -> Table:
    variations = {variation: chosen(rows, variation) for variation in (NOMINAL, EXACT, LOADED, RUBBING)}
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


def _draw_variations(study: LawsStudy, rows: list[Row]) -> Figure:
    labels = {
        NOMINAL: "nominal",
        EXACT: "exact encoder",
        LOADED: f"{study.payload:g} kg more",
        RUBBING: f"friction x {study.friction:g}",
    }
    laws = list(chosen(rows, NOMINAL))
    shown = {}
    for (variation, label), colour in zip(labels.items(), AXIS_COLOURS, strict=False):
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
        for name, (values, colour) in shown.items():
            axes.plot(values, places, "o", ms=6, color=colour, label=name)
            drawn += [value for value in values if value > 0]
        axes.set_yticks(places, laws)
        logarithmic(axes, "x", drawn)
        axes.set(xlabel=label)
        figure.legend(loc="outside lower center", ncols=len(shown))
    return figure


def _draw_repeats(rows: list[Row], exact: dict[str, Row]) -> Figure:
    with sheet(9.0, 4.2) as figure:
        axes = figure.add_subplot()
        counts = [0, *(int(str(row["repeats"])) for row in rows)]
        values = [_value(exact.get(_PID, {}), "following_rms_um"), *(_value(row, "following_rms_um") for row in rows)]
        axes.plot(counts, values, "o-", color=COLOURS["servo"])
        logarithmic(axes, "y", [value for value in values if value > 0])
        axes.set(xlabel="repeats learnt from", ylabel="following error, rms [µm]")
    return figure
