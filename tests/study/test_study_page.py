"""The sections of a study's page: what each holds, and in which order."""

import pytest
from matplotlib.figure import Figure

from gantrysim.report.document import Table
from gantrysim.study import Details, Plot, Report
from gantrysim.study.run import _failed_cases, _plot_section, page_sections

TABLE = Table(["a"], [[1.0]])


def test_a_plot_with_a_viewer_is_what_the_page_prints_of_it():
    figure = Figure()
    plain = _plot_section(Plot("p", "Title", "Words", figure, [TABLE]))
    assert (plain.title, plain.text, plain.figure, plain.table) == ("Title", "Words", figure, [TABLE])
    assert not plain.viewer
    assert not plain.still
    seen = _plot_section(Plot("p", "Title", "Words", figure, [TABLE], viewer="{}"))
    assert (seen.title, seen.text, seen.figure, seen.table) == ("Title", "Words", None, [TABLE])
    assert (seen.viewer, seen.still) == ("{}", figure)
    assert _plot_section(Plot("p", "Title", "Words", figure)).table is None


def test_failed_cases_are_listed_with_what_identifies_them_alone():
    rows = [
        {"speed": 1.0, "tag": "a", "status": "ok", "error": 5.0, "curve": [1.0]},
        {"speed": 2.0, "tag": "b", "status": "fault: x", "error": None},
        {"speed": 3.0, "tag": "c", "status": "refused: y"},
    ]
    (section,) = _failed_cases(rows)
    assert section.title == "Failed cases"
    assert list(section.table.columns) == ["speed", "tag", "status"]
    assert section.table.rows == [[2.0, "b", "fault: x"], [3.0, "c", "refused: y"]]
    assert _failed_cases(rows[:1]) == []


def test_what_is_not_the_answer_is_folded():
    chart = Plot("chart", "Chart", "Words", Figure())
    details = Details(["A note."], [TABLE], [Plot("more", "More", "Words", Figure())])
    report = Report("Question?", "An answer.", chart, TABLE, details)
    sections = page_sections(report, [])
    folded = [section.title for section in sections if section.folded]
    assert folded == ["More tables", "More", "Notes"]
    shown = [section for section in sections if not section.folded]
    assert any(section.figure is chart.figure for section in shown)
    assert sections.index(shown[-1]) < sections.index(next(section for section in sections if section.folded))
    bare = page_sections(Report("Question?", "An answer."), [])
    assert not [section for section in bare if section.folded]


@pytest.mark.parametrize("columns", [["status"], ["x", "status"]])
def test_a_failed_case_without_values_still_has_its_row(columns):
    row = dict(zip(columns, [2.0, "fault: z"][-len(columns) :], strict=True))
    (section,) = _failed_cases([row])
    assert section.table.rows == [list(row.values())]
