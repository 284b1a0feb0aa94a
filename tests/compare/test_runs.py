"""Runs beside one another, against closed forms: the same run, a known error, other paths, other machines."""

import json
import math
import os
import shutil
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from gantrysim import Fault, InputError, Job, SavedRun
from gantrysim.cli import terminal
from gantrysim.cli.compare import comparison_tables
from gantrysim.compare.runs.common_path import Track, parting_of
from gantrysim.compare.runs.compared_run import names_of_folders, names_of_jobs
from gantrysim.compare.runs.compared_runs import _losses, answer, is_better
from gantrysim.compare.runs.differences import CheckChange, check_changes
from gantrysim.compare.runs.overlay_data import OverlayData
from gantrysim.compare.runs.overlays import draw_compared_budgets, draw_overlaid_errors
from gantrysim.compare.runs.runs_page import budget_cells, compare_runs, run_sections, value_cells
from gantrysim.paths.arcs import ArcChain
from gantrysim.report.folder import output_folder, write_run
from gantrysim.results.checks import Check
from gantrysim.results.colours import BAD

from support.compared import RADIUS, START, TEXT, circle_job, on_circle, recorded
from support.pages import Page

BEFORE = (0.030, 0.010)  # mean error and its swing [mm]
AFTER = (0.010, -0.005)
PERIODS = (0.001, 0.0016)
UM = 1e3
GAIN = {"name": "gain_margin", "quantity": "gain margin", "unit": "", "source": "given"}


@pytest.fixture(scope="module")
def comparison():
    """Two circles with known errors, sampled at different periods."""
    return compare_runs(on_circle(*BEFORE, PERIODS[0]), on_circle(*AFTER, PERIODS[1]), names=["before", "after"])


@pytest.fixture(scope="module")
def folders(comparison, tmp_path_factory):
    """Both runs as `gantrysim run` saves them."""
    places = []
    for compared in comparison.runs:
        place = tmp_path_factory.mktemp("runs") / compared.name
        with output_folder(place) as scratch:
            write_run(scratch, compared.results)
        places.append(place)
    return places


def test_a_run_beside_itself_differs_in_nothing():
    run = on_circle(*BEFORE)
    same = compare_runs(run, run)
    assert same.are_same
    assert same.best is None
    assert "are the same: no value differs" in same.sentence
    assert same.differences == ()
    assert same.apart[1].max == 0.0
    assert same.apart[1].length == pytest.approx(2 * math.pi * RADIUS, rel=1e-3)
    assert all(value.change(1) in (0.0, None) for value in same.values)
    assert {check.judgement(1) for check in same.checks} <= {"same", ""}
    budgets = next(section for section in run_sections(same) if section.title == "Error budgets")
    assert {row[-1] for row in budgets.table.rows} == {"0"}


def test_errors_at_the_same_place_have_the_closed_form(comparison):
    """The difference of two errors a + b cos(angle) over the whole circle, whatever the periods are."""
    mean = AFTER[0] - BEFORE[0]
    swing = AFTER[1] - BEFORE[1]
    apart = comparison.apart[1]
    assert apart.rms == pytest.approx(math.hypot(mean, swing / math.sqrt(2)), rel=2e-3)
    assert apart.max == pytest.approx(abs(mean) + abs(swing), rel=2e-3)
    # the mean over time would weigh the slow start and stop of the motion more
    assert len(comparison.tracks[0].place) != len(comparison.tracks[1].place)


def test_rows_of_the_viewer_have_the_closed_form(comparison):
    places, columns = OverlayData(comparison).columns()
    assert np.all(np.diff(places) >= 0)
    angle = (places - START) / RADIUS
    for (mean, swing), table in zip((BEFORE, AFTER), columns, strict=True):
        known = ~np.isnan(table["contour"])
        assert np.count_nonzero(known) > 0.99 * places.size
        expected = UM * (mean + swing * np.cos(angle))
        assert np.abs(table["contour"] - expected)[known].max() < 0.05
    extremes = [1e3 * np.abs(run.results.budget.contour.lateral).max() for run in comparison.runs]
    assert [np.nanmax(np.abs(table["contour"])) for table in columns] == pytest.approx(extremes, abs=1e-9)


def test_rows_of_the_viewer_are_about_as_many_as_asked_for(comparison):
    """Fewer rows keep the extremes of what is drawn."""
    few, columns = OverlayData(comparison, most=400).columns()
    assert 100 < few.size <= 400
    all_columns = OverlayData(comparison).columns()[1]
    for table, whole in zip(columns, all_columns, strict=True):
        for name in ("contour", "speed"):
            assert np.nanmax(table[name]) == np.nanmax(whole[name])
            assert np.nanmin(table[name]) == np.nanmin(whole[name])


def test_what_is_better_and_by_how_much(comparison):
    largest = [UM * (abs(mean) + abs(swing)) for mean, swing in (BEFORE, AFTER)]
    check = next(check for check in comparison.checks if check.known.name == "path_max")
    assert [check.value(run) for run in range(2)] == pytest.approx(largest, rel=2e-3)
    assert check.change(1) == pytest.approx(largest[1] - largest[0], rel=2e-3)
    assert check.judgement(1) == "better"
    assert comparison.best == 1
    assert comparison.sentence.startswith("after is better than before")
    assert [difference.key for difference in comparison.differences if difference.kind == "job"] == ["servo.period"]
    assert comparison.differences[0].texts == ("0.001", "0.0016")


def test_bars_are_as_long_as_what_they_show(comparison):
    """In micrometres; a link that a run does not have is a bar without length or number."""
    figure = Figure()
    axes = draw_compared_budgets(figure, comparison)
    names = [label.get_text() for label in axes.get_yticklabels()]
    assert names == list(comparison.budgets)
    for number, bars in enumerate(axes.containers):
        expected = [parts[number] for parts in comparison.budgets.values()]
        widths = [0.0 if part is None else UM * part.rms for part in expected]
        assert [bar.get_width() for bar in bars] == pytest.approx(widths)
        assert max(widths) > 1.0
    contour = list(comparison.budgets).index("contour")
    for bars, (mean, swing) in zip(axes.containers, (BEFORE, AFTER), strict=True):
        rms = UM * math.hypot(mean, swing / math.sqrt(2))
        assert bars[contour].get_width() == pytest.approx(rms, rel=0.05)


def test_the_tables_of_values_hold_each_group_by_itself(comparison):
    """At first what changes by a hundredth, then all."""
    groups = list(dict.fromkeys(value.group for value in comparison.values))
    assert len(groups) > 2
    for large_only in (False, True):
        for group in groups:
            heads, rows = value_cells(comparison, group, large_only=large_only)
            assert heads == ["value", "before", "after", "change"]
            members = [value for value in comparison.values if value.group == group]
            shown = [value for value in members if value.is_large or not large_only]
            assert rows == [[value.quantity.head, *value.texts, value.change_text(1)] for value in shown]


def test_the_table_of_links_has_the_change_of_each_in_micrometres(comparison):
    heads, rows = budget_cells(comparison)
    assert heads == ["link", "before", "after", "change"]
    contour = next(row for row in rows if row[0] == "contour")
    before, after = (UM * math.hypot(mean, swing / math.sqrt(2)) for mean, swing in (BEFORE, AFTER))
    assert [float(cell) for cell in contour[1:3]] == pytest.approx([before, after], rel=0.05)
    change, share = contour[3].replace("−", "-").split(" ", 1)
    assert float(change) == pytest.approx(after - before, rel=0.05)
    assert share == f"({100 * float(change) / float(contour[1]):+.0f} %)"


@pytest.mark.parametrize("first", [True, False])
def test_the_run_that_ended_in_a_fault_is_named_as_such(first):
    whole = on_circle(*BEFORE)
    faulty = on_circle(*AFTER).replaced(fault=Fault("following error", "x", 0.5, 12.0, 10.0, "mm"))
    runs, names = ((faulty, whole), ("broken", "sound")) if first else ((whole, faulty), ("sound", "broken"))
    sentence = compare_runs(*runs, names=names).sentence
    assert sentence.startswith("sound is better than broken: broken ended in a fault, sound did not")


def test_the_other_order_has_the_other_signs(comparison):
    swapped = compare_runs(*(run.results for run in reversed(comparison.runs)), names=["after", "before"])
    assert swapped.best == 0
    assert swapped.sentence.startswith("after is better than before")
    assert (swapped.apart[1].rms, swapped.apart[1].max) == (comparison.apart[1].rms, comparison.apart[1].max)
    changes = {value.quantity.key: value.change(1) for value in comparison.values}
    for value in swapped.values:
        change = changes[value.quantity.key]
        assert value.change(1) == (None if change is None else -change)
    opposite = {"better": "worse", "worse": "better"}
    judged = {check.known.name: check.judgement(1) for check in comparison.checks}
    for check in swapped.checks:
        judgement = judged[check.known.name]
        assert check.judgement(1) == opposite.get(judgement, judgement)


def test_a_limit_is_said_once_and_of_each_run_where_they_differ():
    def change(*limits, at_least=False):
        checks = [Check(**GAIN, value=3.0, limit=limit, at_least=at_least) for limit in limits]
        return CheckChange("stability", (None, *checks))

    assert change(2.0, 2.0, at_least=True).limit == "at least 2.0"
    assert change(2.0, 1.5).limit == "at most 2.0 / at most 1.5"


def test_of_three_runs_all_must_be_the_same():
    run = on_circle(*BEFORE)
    other = on_circle(*AFTER)
    assert compare_runs(run, run, run).are_same
    for runs in ((run, run, other), (run, other, run), (other, run, run)):
        compared = compare_runs(*runs)
        assert not compared.are_same
        assert "are the same" not in compared.sentence


def test_runs_are_named_by_as_little_as_tells_them_apart(tmp_path):
    places = [tmp_path / name for name in ("monday/a", "tuesday/a", "tuesday/b")]
    assert names_of_folders(places[1:]) == ["a", "b"]
    assert names_of_folders(places[:2]) == ["monday/a", "tuesday/a"]
    assert names_of_folders([places[0], places[0]]) == [str(places[0].resolve())] * 2
    assert names_of_jobs(["ring", "square"]) == ["ring", "square"]
    assert names_of_jobs(["ring", "ring"]) == ["ring (1)", "ring (2)"]


def test_a_place_between_two_stretches_of_dispensing_has_no_value():
    track = Track(np.array([0.0, 1.0, 5.0, 6.0]), np.array([10, 11, 20, 21]))
    values = track.at(np.array([-1.0, 0.0, 0.25, 1.0, 3.0, 5.5, 6.0, 7.0]), np.array([0.0, 4.0, 8.0, 10.0]))
    np.testing.assert_array_equal(values, [np.nan, 0.0, 1.0, 4.0, np.nan, 9.0, 10.0, np.nan])


def test_paths_part_where_they_part():
    straight = ArcChain((0.0, 0.0), 0.0, [0.0], [50.0])
    bent = ArcChain((0.0, 0.0), 0.0, [0.0, 0.1], [30.0, 20.0])
    parting = parting_of(straight, bent, 1)
    # the arc of 10 mm radius leaves the line by SAME_PLACE after sqrt(2 * 10 * 0.001) mm
    assert parting.s == pytest.approx(30.0 + math.sqrt(0.02), abs=0.25)
    assert parting.point == pytest.approx((parting.s, 0.0, 0.0))
    # within 0.2 mm on a long path, and a 500th of a short one
    for length, within in ((1990.0, 0.2), (3.0, 0.006)):
        whole = ArcChain((0.0, 0.0), 0.0, [0.0], [length])
        corner = ArcChain((0.0, 0.0), 0.0, [0.0, 1e3], [0.7131 * length, 1e-3 * math.pi / 2])
        assert 0 <= corner.length - parting_of(whole, corner, 1).s <= within + 1.6e-3
    assert parting_of(straight, ArcChain((0.0, 0.0), 0.0, [0.0], [40.0]), 1).s == 40.0
    assert parting_of(straight, ArcChain((0.0, 0.0), 0.0, [0.0, 0.0], [20.0, 30.0]), 1) is None
    # nowhere the same
    beside = parting_of(straight, ArcChain((0.0, 1.0), 0.0, [0.0], [50.0]), 2)
    assert (beside.run, beside.s, beside.point, beside.lengths) == (2, 0.0, (0.0, 0.0, 0.0), (50.0, 50.0))


def test_runs_of_other_paths_and_machines_are_compared_over_time():
    other = circle_job(text=TEXT.replace("X20.0 Y0 I-20.0", "X0 Y20 I-20.0"), machine="xyz").run()
    parted = compare_runs(recorded(), other, names=["xy", "xyz"])
    assert not parted.by_path
    assert parted.apart == (None, None)
    assert parted.summary()["contour_difference"] == [None, None]
    assert "no difference at the same place is given" in parted.notes[-2]
    assert "different axes" in parted.notes[-1]
    keys = [difference.key for difference in parted.differences]
    assert "machine" in keys
    assert "program.text, line 6" in keys
    places, _ = OverlayData(parted).columns()
    assert places[-1] <= max(recorded().time[-1], other.time[-1])


def test_runs_that_cannot_be_compared(comparison):
    run = comparison.runs[0].run
    with pytest.raises(InputError, match="1 run: name another"):
        compare_runs(run)
    with pytest.raises(InputError, match="5 runs: must be 2 to 4"):
        compare_runs(*[run] * 5)
    with pytest.raises(InputError, match=r"run b: its dispenser is never on"):
        compare_runs(run, run.replaced(dispense=np.zeros(len(run), bool)), names=["a", "b"])
    with pytest.raises(InputError, match=r"run b: has no job"):
        compare_runs(run, run.replaced(job=None), names=["a", "b"])


def test_a_run_without_glue_is_no_better_for_having_no_bead_to_judge(comparison):
    """Of the same motion, one lays a bead that fails and one lays none: only what both have is compared."""
    strict = recorded().job.changed({"tolerance.bead_width": 1e-6})
    run = recorded().replaced(job=strict)
    none = {"job": strict.changed({"dispenser.flow": 0.0}), "flow": 0 * run.flow, "flow_demand": 0 * run.flow_demand}
    dry = run.replaced(**none)
    both = compare_runs(run, dry, names=["glued", "dry"])
    assert both.verdicts[0]["glue"].state == "fail"
    assert both.best is None
    assert both.sentence.startswith(
        "None is better than the others by its verdict: glued ✗ fail: glue; dry ! warn: glue."
    )
    assert "The glue is not compared: dry has none judged" in both.sentence
    glued = on_circle(*AFTER).replaced(job=strict)
    other = compare_runs(glued, on_circle(*BEFORE).replaced(**none), names=["glued", "dry"])
    assert other.best == 0
    assert "The glue is not compared: dry has none judged (nothing was laid" in other.sentence


def test_the_command_writes_page_and_summary(gantrysim_command, comparison, folders, tmp_path):
    before, after = folders
    out = tmp_path / "compared"
    status, text, _ = gantrysim_command("compare", before, after, "--out", out)
    assert status == 0
    assert text.startswith("after is better than before")
    content = json.loads((out / "compare.json").read_text())
    assert content["better"] == "after"
    assert content["contour_difference"][1]["rms_um"] == pytest.approx(UM * comparison.apart[1].rms)
    contour = comparison.budgets["contour"]
    assert [part["rms_um"] for part in content["error_budgets"]["contour"]] == [UM * part.rms for part in contour]
    page = Page(out / "report.html")
    page.check()
    assert [name for name in page.sections if name != "in-full"][:3] == ["summary", "beads-and-errors", "what-differs"]
    assert content["answer"] in page.section("in-full" if "in-full" in page.sections else "summary")
    row = page.tables()["Error normal to the requested path by link, of every run"]["contour"]
    assert row["rms [µm], before"] == f"{UM * contour[0].rms:.1f}"
    assert row["rms [µm], after"] == f"{UM * contour[1].rms:.1f}"
    assert row["change of rms, after"].startswith(f"−{UM * (contour[0].rms - contour[1].rms):.1f}")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["{0}"], "compare: 1 run: name another to compare it with, or a log with --measured FILE"),
        (["{0}", "{0}"], "is given twice"),
        (["{0}", "{0}/nothing"], "no such folder"),
        (["{0}", "{0}/.."], "holds no run"),
        (["{0}", "{1}", "--measured", "log.csv"], "is compared with one run, 2 are given"),
        (["{0}", "{1}", "--circle", "20"], "--circle: describes a log: needs --measured FILE"),
    ],
)
def test_refusals_are_one_line(gantrysim_command, folders, arguments, message):
    status, out, err = gantrysim_command("compare", *(argument.format(*folders) for argument in arguments))
    assert (status, out) == (2, "")
    assert message in err
    assert len(err.splitlines()) == 1
    assert not (folders[0] / "compare").exists()


@pytest.mark.parametrize("width", [120, 80, 40])
def test_tables_lose_nothing_in_a_narrow_terminal(comparison, monkeypatch, capsys, width):
    def printed(columns):
        monkeypatch.setenv("COLUMNS", str(columns))
        for table in comparison_tables(comparison):
            terminal.show(table)
        return capsys.readouterr().out

    text = printed(width)
    assert sorted("".join(text.split())) == sorted("".join(printed(1000).split()))
    if width > 40:
        assert max(map(len, map(str.rstrip, text.splitlines()))) <= width


def test_saved_causes_come_along(folders):
    saved = [SavedRun.load(folder) for folder in folders]
    assert compare_runs(*saved).causes == {}
    for folder, worth in zip(folders, (12.0, 3.0), strict=True):
        file = folder / "summary.json"
        content = json.loads(file.read_text())
        content["causes"] = {"friction": {"worth": {"contour": {"rms_um": worth}}}, "counts": {"worth": None}}
        file.write_text(json.dumps(content))
    causes = compare_runs(*saved).causes
    assert causes.keys() == {"friction"}
    assert causes["friction"] == pytest.approx((0.012, 0.003))


@pytest.mark.parametrize("kind", ["pipe", "device", "deep", "long"])
def test_a_summary_that_is_none_is_no_summary(folders, tmp_path, kind):
    """Causes are not known, and nothing else happens."""
    folder = tmp_path / "stranger"
    shutil.copytree(folders[0], folder)
    file = folder / "summary.json"
    file.unlink()
    if kind == "pipe":
        os.mkfifo(file)
    elif kind == "device":
        file.symlink_to("/dev/zero")
    elif kind == "deep":
        file.write_text("[" * 100_000)
    else:
        file.write_text('{"causes": {}, "long": "' + "x" * (1 << 24) + '"}')
    comparison = compare_runs(SavedRun.load(folder), SavedRun.load(folders[1]))
    assert comparison.causes == {}


def test_the_answer_and_what_decides_fit_on_one_screen(gantrysim_command, comparison, folders, tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    before, after = folders
    status, text, _ = gantrysim_command("compare", before, after, "--out", tmp_path / "screen")
    assert status == 0
    assert len(text.splitlines()) <= 30
    assert "checks that a run does not pass" in text
    assert "worth of causes" not in text
    _, whole, _ = gantrysim_command("compare", before, after, "--out", tmp_path / "whole", "-v")
    assert len(whole.splitlines()) > 30
    assert "worth of causes" in whole or not any(run.results.causes for run in comparison.runs)
    assert all(set(value.known.quantity.split()) <= set(whole.split()) for value in comparison.checks)


def test_the_overlay_begins_where_the_first_run_is_worst_by_its_verdict(comparison):
    overlay = OverlayData(comparison)
    verdict = comparison.verdicts[0]
    assert verdict.worst_row is not None
    row = overlay.content()["worst"]
    _, (first, _) = overlay.columns()
    assert first["time"][row] == pytest.approx(verdict.worst_place.time, abs=2 * PERIODS[0])


def test_the_overlay_begins_nowhere_where_the_first_run_passes():
    program = {"controller": "linuxcnc.Program", "text": "G21 G90 G1 X20 F600\nY10\nM2\n"}
    tolerance = {"path_max": 5.0, "bead_width": 99.0, "start_length": 5.0, "stop_length": 5.0}
    content = {"name": "corner", "machine": "xy", "program": program, "dispenser": {"area": 1.0}}
    job = Job.of_content({**content, "tolerance": tolerance}, "job corner")
    run = job.follow()
    passed = compare_runs(run, run.replaced(nozzle=run.nozzle + 1e-3))
    assert passed.verdicts[0].state == "pass"
    assert passed.verdicts[0].worst_place is not None
    assert OverlayData(passed).content()["worst"] is None


def test_the_errors_of_runs_over_one_another_have_the_limit(comparison):
    panel = draw_overlaid_errors(Figure(), comparison)[0]
    limit = 1e3 * comparison.verdicts[0].tolerance.path_max
    limits = [line.get_ydata()[0] for line in panel.lines if line.get_linestyle() == "--" and line.get_color() == BAD]
    texts = [text.get_text() for text in panel.texts]
    assert limits == pytest.approx([limit, -limit]) or texts == [f"limit ± {limit:.3g} µm, beyond this scale"]


def test_what_is_worse_in_the_better_run_is_told_with_the_largest_loss_first():
    def change(name, best, rival):
        checks = (
            Check(name=name, quantity=name, value=value, limit=10.0, unit="mm", source="given")
            for value in (best, rival)
        )
        return CheckChange("glue", tuple(checks))

    changes = [change("a", 12.0, 11.0), change("b", 30.0, 11.0), change("c", 5.0, 4.0), change("d", 20.0, 11.0)]
    texts = _losses(changes, 0, 1).split("; ")
    assert [text.partition(":")[0] for text in texts] == ["b", "d", "a"]
    assert texts[0] == "b: 30.0 against 11.0 mm (at most 10.0 mm)"


def test_a_machine_without_a_closed_loop_has_no_better_margins():
    """A machine of steppers has an infinite gain margin, a servo's a finite one: neither is better."""
    run = recorded()
    servo = compare_runs(run, on_circle(*BEFORE), names=["one", "other"]).verdicts[0]
    (gain,) = (check for check in servo["stability"].checks if check.name == "gain_margin")
    (peak,) = (check for check in servo["stability"].checks if check.name == "sensitivity")
    none = replace(servo["stability"], checks=(replace(gain, value=math.inf), replace(peak, value=1.0)))
    rows = tuple(none if row.name == "stability" else row for row in servo.rows)
    stepper = replace(servo, rows=rows)
    names = {check.known.name: check for check in check_changes([servo, stepper])}
    for name in ("gain_margin", "sensitivity"):
        assert names[name].judgement(1) == ""
        assert names[name].cell(1) == "–"
    assert names["path_max"].judgement(1) == "same"
    assert not is_better(stepper, servo)
    assert not is_better(servo, stepper)
    sentence = answer(("servo", "stepper"), (servo, stepper), tuple(check_changes([servo, stepper])), (), False)
    assert "The stability is not compared: stepper has none judged (no loop is closed)." in sentence
