"""Every value of the list in summary.json, terminal, page and rows of studies against that of the API."""

import json
import math
import re
import runpy
from pathlib import Path

import pytest
from matplotlib.figure import Figure

import gantrysim as gs
from gantrysim.base.quantity import AXIS, NOTHING
from gantrysim.cli.tables import links_table, outcome_table
from gantrysim.metrics.parts import PART_COLUMNS
from gantrysim.report.page import write_run_page
from gantrysim.report.summary import summary
from gantrysim.results.quantities import GROUPS, LOSSES_GROUP
from gantrysim.results.run_results import RunResults
from gantrysim.study import values_row

from support.distinct import same
from support.pages import Page

DRY = [f"dispenser.{key}=0" for key in ("flow", "area", "pressure")]
GROUPS_OF_ALL_RUNS = [group for group in GROUPS if group is not LOSSES_GROUP]


@pytest.fixture(scope="module", params=[[], DRY], ids=["glue", "dry"])
def results(request):
    job = gs.Job.load("an225", ["diameter=40", "turns=2", "thickness=5", *request.param])
    run = job.run()
    budget = gs.Budget(run)
    return RunResults(job, job.built_machine, budget, gs.Bead(run, job.bead, budget.analysis))


@pytest.fixture(scope="module")
def page(results, tmp_path_factory):
    file = tmp_path_factory.mktemp("page") / "report.html"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gantrysim.report.sections.drawn_plot", lambda *_: Figure())
        write_run_page(file, results)
    return Page(file)


def numbers(group, results):
    return [number for quantity in group.of(results) for number in quantity.numbers]


@pytest.mark.parametrize("group", GROUPS_OF_ALL_RUNS, ids=lambda group: group.name)
def test_summary_has_every_value_in_the_unit_of_its_key(group, results):
    written = json.loads(json.dumps(summary(results), allow_nan=False))[group.name]
    subject = group.subject(results)
    if subject is None:
        assert group.name == "bead"
        assert written is None
        return
    shown = numbers(group, results)
    assert list(written) == [number.key for number in shown]
    scope = {"budget": results.budget, "bead": results.bead, "results": results}
    for number in shown:
        value = eval(number.code(group.code), scope) if number.get(subject) is not None else None
        assert value == number.get(subject)
        expected = None if value is None or not math.isfinite(value) else number.factor * value
        assert written[number.key] == expected


def test_keys_are_unique_and_every_value_has_a_meaning_and_a_unit_in_its_key(results):
    shown = [number for group in GROUPS for number in numbers(group, results)]
    keys = [number.key for number in shown]
    assert len(set(keys)) == len(keys)
    labels = [(number.label, number.unit) for number in shown]
    assert len(set(labels)) == len(labels)
    for number in shown:
        assert re.fullmatch(r"[a-zA-Z0-9_]+", number.key)
        assert number.meaning[0].isupper()
        assert not number.meaning.endswith(".")
        assert AXIS not in number.key
        assert number.label == number.label.strip()
        # values are in mm, s and N·m; a share is its number, the volume's error alone is in per cent already
        factors = {"µm": 1e3, "ms": 1e3, "%": 1.0 if number.key == "volume_error_percent" else 100.0}
        assert number.factor == factors.get(number.unit, 1.0)


def test_terminal_and_page_show_values_as_their_quantities_do(results, page):
    """What stands beside a label in the terminal or as a fact of the page is the value of that label."""
    analysis = results.budget.analysis
    table = outcome_table(analysis, results.bead_values, results.job.margins)
    terminal = {name: (value, remark) for name, value, remark in cells(table)}
    facts = {name.lower(): texts for name, texts in page.facts().items()}
    both = terminal | facts
    seen = set()
    for group in GROUPS_OF_ALL_RUNS:
        subject = group.subject(results)
        for quantity in group.of(results) if subject is not None else ():
            if quantity.label not in both or quantity.get(subject) is None:
                continue
            first, *rest = quantity.numbers
            for rows in (terminal, facts):
                if quantity.label in rows:
                    value, remark = (text.replace("−", "-") for text in rows[quantity.label])
                    assert value.endswith(f" {first.unit}")
                    assert same(value.split()[0], str(first.factor * first.get(subject)))
                    seen.add(quantity.label)
                    for number in rest:
                        if re.search(rf"\b{number.label.split(', ')[-1]} [-\d]", remark):
                            assert number.number(number.get(subject)) in remark
    expected = {"turn spacing", "path speed", "path length", "following error x", "following error y"}
    assert expected <= seen
    assert ({"bead width", "missing at start", "excess at stop", "volume"} <= seen) == (results.bead_values is not None)


def cells(table):
    return list(zip(*([*column.cells] for column in table.columns), strict=True))


def test_the_error_budget_is_one_in_terminal_text_frame_summary_and_page(results, page):
    rows = results.budget.values.rows
    frame = results.budget.to_frame()
    written = summary(results)["error_budget"]
    terminal = {row[0]: row[1:5] for row in cells(links_table("job", results.machine, results.budget))}
    text = {line.split()[0]: line.split()[1:6] for line in str(results.budget).splitlines()[2:]}
    title = "Error normal to the requested path, its share of the mean square, and where it is largest"
    shown = page.tables()[title]
    assert list(frame.index) == list(rows)
    for name, part in rows.items():
        for k, column in enumerate(PART_COLUMNS):
            value = column.get(part)
            assert frame.loc[name, column.key] == written[name][column.key] == column.factor * value
            assert terminal[name][k].split()[0] == text[name][k] == column.number(value)
            assert shown[name][column.head] == column.number(value)


def test_a_row_of_a_study_has_the_keys_and_values_of_the_summary(results):
    written = summary(results)
    row = values_row(results.budget.analysis.run, results.job.bead)
    known = {**written["errors"], **written["motion"], **(written["bead"] or {})}
    for key, value in row.items():
        assert value == (pytest.approx(known[key], rel=1e-12) if key in known and known[key] is not None else None)
    assert {*written["errors"], *written["motion"]} <= set(row)


def test_an_infinite_margin_is_shown_as_such_and_null_in_summary(results):
    margin = next(number for number in numbers(GROUPS[2], results) if number.key == "gain_margin_x")
    assert margin.text(math.inf) == "∞"
    assert margin.text(None) == NOTHING


def test_the_page_of_values_is_that_of_the_code():
    root = Path(__file__).parent.parent.parent
    page = runpy.run_path(str(root / "scripts" / "values_page.py"))["page"]
    assert page() == (root / "docs" / "values.md").read_text(encoding="utf-8")


def test_the_page_of_values_lists_every_key_of_a_summary_and_every_column_of_a_record(results):
    """Keys of the axis x stand for those of all axes, as x does for the coordinates of points."""
    text = (Path(__file__).parent.parent.parent / "docs" / "values.md").read_text(encoding="utf-8")
    keys = [number.key for group in GROUPS for number in numbers(group, results)]
    keys += [re.sub(r"_[yz]_", "_x_", name) for name in results.budget.analysis.run.columns]
    for key in keys:
        assert f"`{re.sub('_y(?=_|$)', '_x', key)}`" in text or f"`{key}`" in text
