"""Table and files of an identification, as `gantrysim identify` shows and writes them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import tomli_w
from rich.table import Table

from gantrysim.identify.identification import Identification
from gantrysim.identify.log import Log
from gantrysim.identify.page import REPORT, identification_page
from gantrysim.identify.plots import save_plots
from gantrysim.identify.result import LABELS
from gantrysim.identify.whole_run import WholeRun, fitted_machine, write_machine
from gantrysim.report.folder import Output, output_folder

VALUES = "identified.toml"
MACHINE = "machine.xml"
_PLOTS = ("residuals", "friction", "response")
OUTPUT = Output("identification", VALUES, (REPORT, VALUES, MACHINE, *(f"{name}.png" for name in _PLOTS)))


def values_table(identification: Identification) -> Table:
    """Return the fitted values with their intervals."""
    caption = (
        "inertia, viscous friction, stiffness and damping at the axis, other torques at the motor shaft; 95 % "
        "confidence; not identified (interval): half the interval exceeds 15 % of the value, 40 % of a damping; not "
        "identified otherwise: the check named, see the notes; the machine written takes what is identified, "
        "friction and mode each as a whole; all else stays nominal"
    )
    table = Table(title="identified", title_justify="left", caption=caption, caption_justify="left")
    table.add_column("axis", no_wrap=True)
    table.add_column("quantity")
    for column in ("nominal", "fitted", "±", "unit"):
        table.add_column(column, justify="left" if column == "unit" else "right", no_wrap=True)
    table.add_column("")
    last = ""
    for value in identification.values:
        if last and value.axis != last:
            table.add_section()
        table.add_row(
            value.axis if value.axis != last else "",
            LABELS.get(value.name, value.name),
            f"{value.nominal:.4g}",
            f"{value.value:.4g}",
            f"{0.5 * (value.high - value.low):.2g}",
            value.unit,
            "identified" if value.identified else f"not identified ({value.reason})",
        )
        last = value.axis
    return table


def content(identification: Identification, runs: Sequence[WholeRun] = ()) -> dict[str, Any]:
    """Return the fitted values as tables of TOML, a table per axis.

    Args:
        identification: of a log.
        runs: of the fitted machine under the log's torque, by axis.
    """
    axes: dict[str, Any] = {}
    for value in identification.values:
        axes.setdefault(value.axis, {})[value.name] = {
            "value": float(value.value),
            "interval": [float(value.low), float(value.high)],
            "nominal": float(value.nominal),
            "unit": value.unit,
            "identified": value.identified,
            **({} if value.identified else {"reason": value.reason}),
        }
    for fit in identification.fits:
        if fit.model.share:
            axes[fit.axis]["mode"] = {"frequency": fit.model.resonance, "damping_ratio": fit.model.damping_ratio}
    whole: dict[str, Any] = {}
    for run in runs:
        sizes = {
            "torque": run.torque,
            "written": run.written,
            "fitted": run.fitted,
            "nominal": run.nominal,
            "counts": run.counts,
        }
        table = {name: size for name, size in sizes.items() if math.isfinite(size)}
        whole[run.axis] = {"missing": run.missing} if run.missing else {**table, "repeats": run.repeats}
    shown = {"machine": str(identification.machine.source), "notes": identification.notes, "axes": axes}
    return {**shown, "whole_run": whole} if whole else shown


def write_all(identification: Identification, log: Log, folder: Path, runs: Sequence[WholeRun] = ()) -> list[str]:
    """Write page, values, fitted machine and plots to a folder, replaced as a whole; return their names.

    Args:
        identification: of the log.
        log: of the axes.
        folder: to write to.
        runs: of the fitted machine under the log's torque, by axis.

    Raises:
        InputError: the folder holds other files of these names or cannot be written, or no machine has the values.
    """
    machine = fitted_machine(identification)
    page = identification_page(identification, log, runs)
    with output_folder(folder, OUTPUT) as scratch:
        (scratch / VALUES).write_text(tomli_w.dumps(content(identification, runs)), encoding="utf-8")
        write_machine(machine, scratch / MACHINE)
        save_plots(identification.fits, log, scratch)
        page.write(scratch / REPORT)
    return list(OUTPUT.files)
