"""The page of a study or a tuning: answer, chart and table, then folded details."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from gantrysim.report.document import Section
from gantrysim.study.study import Plot, Report


def page_sections(report: Report, origin: Iterable[Section] = ()) -> list[Section]:
    """Return the sections of a report's page, whose title is the question.

    Args:
        report: to show.
        origin: sections on the cases and the job, the last of the details.
    """
    first = [Section("Answer", report.answer)]
    details = []
    if report.chart is not None:
        # the tables of the chart are details: the answer has one table
        first.append(_plot_section(replace(report.chart, tables=())))
        if report.chart.tables:
            details.append(Section(f"{report.chart.title}: details", table=report.chart.tables))
    if report.table is not None:
        first.append(Section("Table", table=report.table))
    if report.details.tables:
        details.append(Section("More tables", table=report.details.tables))
    details += map(_plot_section, report.details.plots)
    if report.details.notes:
        details.append(Section("Notes", report.details.notes))
    return [*first, *(replace(section, folded=True) for section in (*details, *origin))]


def _plot_section(plot: Plot) -> Section:
    if plot.viewer is None:
        return Section(plot.title, plot.text, plot.figure, plot.tables or None)
    return Section(plot.title, plot.text, table=plot.tables or None, viewer=plot.viewer, still=plot.figure)
