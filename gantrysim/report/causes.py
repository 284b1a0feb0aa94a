"""The causes of a job's error in its report and summary."""

from __future__ import annotations

import math
from typing import Any

from gantrysim.base.quantity import contents
from gantrysim.job.causes import CELL_FORM, Causes, Errors
from gantrysim.metrics.parts import ERROR, ERROR_SIZES
from gantrysim.report.document import Column, Section, Table
from gantrysim.report.headline import glue_cause_sentences
from gantrysim.report.plots.budget import draw_causes
from gantrysim.report.sections import drawn_plot
from gantrysim.results.checks import finite
from gantrysim.results.glue_causes import GlueCauses

# of the plot [inch]
_PLOT_WIDTH = 10.7
_HEIGHT = 2.4


def causes_section(causes: Causes) -> Section:
    """Return the section of the causes."""
    unknown = dict.fromkeys(causes.errors, math.nan)
    worth = {
        effect.cause.name: {name: size.rms for name, size in effect.worth.items()} or unknown
        for effect in causes.effects
    }
    columns: list[str | Column] = [
        causes.heads[0],
        *(Column(f"{head} [{ERROR.unit}]", CELL_FORM) for head in causes.heads[1:]),
        "without it",
    ]
    without = ["the job unchanged", *(effect.cause.off for effect in causes.effects)]
    rows = [[name, *cells, off] for (name, cells), off in zip(causes.rows, without, strict=True)]
    return Section(
        "Causes",
        [
            "The links of the error budget locate the error on the chain; this section finds its causes. "
            "The job was run again with one cause at a time switched off, with the same gains and all else equal.",
            "Worth is the rms contour error of the job minus that without the cause: negative where the cause offsets "
            "others. Effects do not add up.",
            *(f"{note[0].upper()}{note[1:]}." for note in causes.notes),
        ],
        figure=drawn_plot(draw_causes, worth, _PLOT_WIDTH, _HEIGHT),
        table=Table(columns, rows, "Contour error, what the cause is worth of its rms, and rms by link"),
    )


def glue_causes_section(causes: GlueCauses) -> Section:
    """Return the section of the causes of the bead's error."""
    return Section(
        "Causes of the glue's error",
        [
            "The glue was laid again along the recorded motion with one cause at a time switched off, and judged. "
            "Worth is the value of the job minus that without the cause: negative where the cause offsets others. "
            "Effects do not add up.",
            *glue_cause_sentences(causes),
            *(f"{note[0].upper()}{note[1:]}." for note in causes.notes),
        ],
        table=Table(
            [*causes.heads, "without it"],
            [
                [*cells, off]
                for cells, off in zip(
                    causes.rows, ["the job unchanged", *(effect.cause.off for effect in causes.effects)], strict=True
                )
            ],
            "Values of the glue without one cause at a time",
        ),
    )


def glue_causes_summary(causes: GlueCauses) -> dict[str, Any]:
    """Return the causes of the bead's error for summary.json: by cause the checks without it."""
    return {
        effect.cause.name: {
            "checks": None if effect.row is None else [check.content() for check in effect.row.checks],
            "worth": finite(causes.worth(effect)),
            "failure": effect.failure or None,
        }
        for effect in causes.effects
    }


def causes_summary(causes: Causes) -> dict[str, Any]:
    """Return the causes for summary.json: by cause the errors without it and what it is worth; null if it failed."""
    return {
        effect.cause.name: {
            "without": _errors(effect.without),
            "worth": _errors(effect.worth),
            "failure": effect.failure or None,
        }
        for effect in causes.effects
    }


def _errors(errors: Errors) -> dict[str, dict[str, float | None]] | None:
    return {name: contents(ERROR_SIZES, size) for name, size in errors.items()} or None
