"""What the plots draw, line by line."""

import copy
import errno
import io
import os
import re
from dataclasses import replace
from types import SimpleNamespace

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from gantrysim import Dispenser, Servo, plots, simulate
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.engine.simulate import perfect_follower
from gantrysim.glue.bead import Bead
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import LINKS, Budget
from gantrysim.record.setpoints import Setpoints
from gantrysim.report.plots import pictures
from gantrysim.report.plots.budget import draw_causes, stack_bars
from gantrysim.report.plots.spacing import draw_spacing
from gantrysim.report.plots.style import draw_limit, sheet

from support.blank_pictures import save_blank
from support.jobs import job_run
from support.runs import turn, turntable

matplotlib.use("agg")


@pytest.fixture(scope="module")
def analysis(xy):
    setpoints = MoveSpiral(60, 2, 10, 100, loop_period=0.05).setpoints(1e-3).hold(0.25)
    return Analysis(simulate(xy, Servo.derive(xy.axes), setpoints, dispenser=Dispenser(flow=200.0)))


def lines(figure, axes=0):
    return {line.get_label(): line.get_xydata() for line in figure.axes[axes].get_lines()}


def test_the_plan_magnifies_the_error_by_the_factor_in_its_legend(analysis):
    figure = Figure()
    plots.draw_plan(figure, analysis)
    drawn = lines(figure)
    label = next(name for name in drawn if name.startswith("nozzle"))
    factor = int(label.split()[-1])
    assert factor > 1
    foot = analysis.nozzle
    on_path = analysis.run.requested.position(foot.s)
    np.testing.assert_allclose(drawn[label], (on_path + factor * foot.offset)[:, :2], atol=1e-9)
    assert factor * np.percentile(foot.distance, 99) <= 0.2 * analysis.spacing.distance.mean()
    path = analysis.run.requested
    wanted = path.position(np.linspace(0, path.length, 4000))[:, :2]
    np.testing.assert_allclose(drawn["requested path"], wanted, atol=1e-9)
    (axes,) = figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_aspect()) == ("x [mm]", "y [mm]", 1.0)
    worst = next(name for name in drawn if name.startswith("largest"))
    assert worst == f"largest error: {1e3 * foot.distance.max():.0f} µm"


def test_the_errors_over_time_have_their_signs_and_sizes(analysis):
    figure = Figure()
    plots.draw_error(figure, analysis)
    run = analysis.run
    for a, name in enumerate(run.axes):
        np.testing.assert_allclose(lines(figure, 0)[name][:, 1], 1e3 * (run.commanded - run.encoder)[:, a], atol=1e-9)
    lower = lines(figure, 1)
    np.testing.assert_allclose(lower["program"][analysis.ticks, 1], 1e3 * analysis.commanded.lateral)
    np.testing.assert_allclose(lower["contour"][analysis.ticks, 1], 1e3 * analysis.nozzle.lateral)
    assert np.isnan(lower["contour"][~run.dispense, 1]).all()
    # the loop's spiral lies inside the requested one: to the right of a clockwise path
    assert analysis.commanded.lateral.min() < -0.05
    assert analysis.commanded.lateral.max() < 0.01


def test_a_fault_is_marked_up_to_the_last_tick_of_the_run(analysis):
    run = analysis.run
    last = float(run.time[-1])
    faults = tuple(SimpleNamespace(kind="stall", time=time) for time in (0.5 * last, last, 1.01 * last))
    panels = plots.draw_error(Figure(), Analysis(run.replaced(injected=faults)))
    for panel in panels:
        marked = [line.get_xdata()[0] for line in panel.lines if line.get_linestyle() == ":"]
        assert marked == [0.5 * last, last]
        assert [text.xy[0] for text in panel.texts if text.get_text() == "stall"] == marked


def test_the_spacing_is_drawn_turn_by_turn_with_the_requested_one(analysis):
    figure = Figure()
    plots.draw_spacing(figure, analysis)
    drawn = lines(figure)
    turns = analysis.spacing
    np.testing.assert_allclose(drawn["turn 1 to 2"][:, 1], turns.distance[turns.turn < 1])
    np.testing.assert_allclose(drawn["turn 1 to 2"][:, 0], 360 * turns.turn[turns.turn < 1])
    assert drawn["requested: 10 mm"][0, 1] == 10


def test_rare_peaks_are_annotated_and_do_not_set_the_scale(analysis):
    figure = Figure()
    plots.draw_error(figure, analysis)
    error = 1e3 * np.abs(analysis.run.commanded - analysis.run.encoder)[analysis.ticks]
    assert figure.axes[0].get_ylim()[1] < 0.8 * error.max()
    assert any(text.get_text().startswith("peak ") for text in figure.axes[0].texts)


def test_rotary_axes_have_a_panel_of_their_own_in_thousandths_of_a_degree(tmp_path):
    run = turn(turntable(tmp_path), 90.0)
    figure = Figure()
    plots.draw_error(figure, Analysis(run))
    assert [axes.get_ylabel() for axes in figure.axes] == [
        "following error [µm]",
        "following error [mdeg]",
        "lateral error, positive to the left [µm]",
    ]
    error = 1e3 * (run.commanded - run.encoder)
    for panel, (a, name) in enumerate(((1, "x"), (0, "th"))):
        drawn = lines(figure, panel)
        assert {label for label in drawn if not label.startswith("_")} == {name}
        np.testing.assert_allclose(drawn[name][:, 1], error[:, a], atol=1e-9)
    assert np.abs(error[:, 0]).max() > 10  # the start, without an acceleration limit
    peak = next(text.get_text() for text in figure.axes[1].texts if text.get_text().startswith("peak"))
    assert " mdeg at 0.0" in peak
    saved = plots.save_plots(Analysis(run), tmp_path)
    assert [file.name for file in saved] == ["plan.png", "error.png", "budget.png"]


@pytest.fixture(scope="module")
def budget(analysis):
    return Budget(analysis)


@pytest.fixture(scope="module")
def bead(analysis):
    return Bead(analysis.run, analysis=analysis)


def test_the_bar_has_the_links_shares_and_those_of_every_turn(budget):
    figure = Figure()
    plots.draw_budget(figure, budget)
    whole, turns = figure.axes
    widths = {bars.get_label(): [bar.get_width() for bar in bars] for bars in whole.containers}
    shares = {name: part.share for name, part in budget.values.parts.items()}
    assert widths == {name: [pytest.approx(100 * share)] for name, share in shares.items()}
    assert sum(shares.values()) == pytest.approx(1)
    named = [text.get_text() for text in whole.texts]
    assert named == [f"{100 * share:.1f} %" for share in shares.values() if share >= 0.07]
    heights = np.array([[bar.get_height() for bar in bars] for bars in turns.containers])
    rms = [1e3 * turn.parts["contour"].rms for turn in budget.values.turns]
    np.testing.assert_allclose(heights.sum(axis=0), rms)  # the shares of a turn add up
    assert [axes.get_xlabel() for axes in (whole, turns)] == ["share of the contour error's mean square [%]", "turn"]
    assert turns.get_ylabel() == "rms [µm]"
    here = budget.turn == 1
    part = budget.parts["servo"]
    error = budget.contour
    product = part.lateral * error.lateral + part.vertical * error.vertical + part.beyond * error.beyond
    share = product[here].mean() / np.mean(error.size[here] ** 2)
    assert heights[1, 1] == pytest.approx(rms[1] * share)


def test_negative_shares_extend_to_the_other_side_of_zero():
    figure = Figure()
    axes = figure.add_subplot()
    values = {"program": [30.0], "servo": [-10.0], "encoder": [-5.0], "structure": [85.0]}
    stack_bars(axes, np.zeros(1), {name: np.array(value) for name, value in values.items()}, upright=False)
    ends = {bars.get_label(): (bars[0].get_x(), bars[0].get_width()) for bars in axes.containers}
    assert ends == {
        "program": (0, 30),
        "servo": (0, -10),
        "encoder": (-10, -5),
        "structure": (30, 85),
    }
    # a line at zero parts the two sides, where there are two
    assert [list(line.get_xdata()) for line in axes.lines] == [[0, 0]]
    only = figure.add_subplot()
    stack_bars(only, np.zeros(1), {"program": np.array([30.0]), "servo": np.array([70.0])}, upright=False)
    assert not only.lines


def test_a_path_without_turns_has_the_bar_of_the_whole_alone(xy, circle):
    run = perfect_follower(xy, Setpoints.along(circle(20.0, 0.5), 50.0, 1e-3))
    figure = Figure()
    plots.draw_budget(figure, Budget(Analysis(run)))
    assert len(figure.axes) == 1
    along = Figure()
    plots.draw_budget_along(along, Budget(Analysis(run)))
    assert [axes.get_ylabel() for axes in along.axes] == ["all links"]  # no link has an error


def test_the_parts_are_drawn_along_the_path_on_one_scale_and_each_on_its_own(budget, analysis):
    figure = Figure()
    plots.draw_budget_along(figure, budget)
    assert [axes.get_ylabel() for axes in figure.axes] == ["all links", *LINKS]
    together = lines(figure)
    for k, (name, part) in enumerate((*budget.parts.items(), ("contour", budget.contour))):
        drawn = together[name]
        np.testing.assert_allclose(drawn[:, 0], analysis.nozzle.s)
        np.testing.assert_allclose(drawn[:, 1], 1e3 * part.lateral)
        if name != "contour":
            np.testing.assert_allclose(figure.axes[k + 1].get_lines()[0].get_ydata(), drawn[:, 1])
            assert figure.axes[k + 1].get_lines()[0].get_color() == plots.COLOURS[name]
    np.testing.assert_allclose(sum(together[name][:, 1] for name in LINKS), together["contour"][:, 1], atol=1e-9)
    starts = [turn.s[0] for turn in budget.values.turns]
    for axes in figure.axes:
        marks = [line.get_xdata()[0] for line in axes.get_lines() if len(set(line.get_xdata())) == 1]
        np.testing.assert_allclose(marks, starts)
    assert [text.get_text() for text in figure.axes[0].texts] == ["turn 1", "turn 2"]


def test_a_vertical_error_is_a_thin_line_on_its_own_panels_from_a_share_of_the_largest_on(analysis):
    """The nozzle swings by 30 µm up and down on a flat path; a hundredth of the largest error is not drawn."""
    run = analysis.run
    swing = 0.03 * np.sin(20 * run.time)
    raised = run.nozzle + swing[:, None] * [0.0, 0.0, 1.0]
    budget = Budget(Analysis(replace(run, nozzle=raised)))
    for height, is_drawn in ((1.0, True), (0.01 * budget.contour.size.max() / 0.03, False)):
        nozzle = run.nozzle + height * swing[:, None] * [0.0, 0.0, 1.0]
        swung = Budget(Analysis(replace(run, nozzle=nozzle)))
        figure = Figure()
        plots.draw_budget_along(figure, swung)
        dotted = [[line for line in axes.get_lines() if line.get_linestyle() == ":"] for axes in figure.axes]
        names = [axes.get_ylabel() for axes in figure.axes]
        # the structure's part has it: from the motors to the nozzle
        expected = {"all links", "structure"} if is_drawn else set()
        assert {name for name, found in zip(names, dotted, strict=True) if found} == expected
        for found in filter(None, dotted):
            (line,) = found
            np.testing.assert_allclose(line.get_ydata(), 1e3 * swing[analysis.ticks] * height, atol=1e-6)


def test_where_the_dispenser_is_off_no_error_is_drawn(xy, circle):
    setpoints = Setpoints.along(circle(20.0), 50.0, 1e-3)
    pause = (setpoints.time < 0.8) | (setpoints.time > 1.0)
    run = simulate(xy, Servo.derive(xy.axes), replace(setpoints, dispense=setpoints.dispense & pause))
    figure = Figure()
    plots.draw_budget_along(figure, Budget(Analysis(run)))
    drawn = lines(figure)["contour"]
    assert np.isnan(drawn[:, 1]).sum() == 1
    gap = int(np.flatnonzero(np.isnan(drawn[:, 1]))[0])
    assert drawn[gap + 1, 0] - drawn[gap - 1, 0] == pytest.approx(0.2 * 50.0, abs=0.2)


def test_of_many_turns_and_ticks_fewer_points_are_drawn_and_the_extremes_are_among_them(analysis, monkeypatch):
    monkeypatch.setattr("gantrysim.report.plots.spacing._MOST_LINES", 2)
    monkeypatch.setattr("gantrysim.report.plots.spacing._MOST_COLUMNS", 40)
    monkeypatch.setattr("gantrysim.report.plots.spacing._LEAST_COLUMNS", 10)
    monkeypatch.setattr("gantrysim.report.plots.plan._MOST_POINTS", 500)
    four = Analysis(job_run("an225"))
    number = np.floor(four.spacing.turn)
    turns = np.unique(number)
    assert turns.size > 2
    axes = plots.draw_spacing(Figure(), four)
    own = [line for line in axes.get_lines() if not str(line.get_label()).startswith("requested")]
    assert len(own) == turns.size
    assert all(line.get_rasterized() for line in own)
    for k, line in zip(turns, own, strict=True):
        distance = four.spacing.distance[number == k]
        assert len(line.get_ydata()) <= 60 < distance.size
        assert (line.get_ydata().min(), line.get_ydata().max()) == (distance.min(), distance.max())
    axes = plots.draw_plan(Figure(), analysis)
    drawn = next(line for line in axes.get_lines() if str(line.get_label()).startswith("nozzle")).get_xydata()
    assert 400 < len(drawn) < 600 < analysis.ticks.size
    trace, worst = analysis.run.nozzle[analysis.ticks], int(analysis.nozzle.distance.argmax())
    factor = int(re.search(r"× (\d+)", str(axes.get_lines()[1].get_label()))[1])
    place = trace[worst, :2] + (factor - 1) * analysis.nozzle.offset[worst, :2]
    assert np.abs(drawn - place).sum(axis=1).min() < 1e-12
    for end in (0, -1):
        assert drawn[end] == pytest.approx(trace[end, :2] + (factor - 1) * analysis.nozzle.offset[end, :2])


def test_the_polar_view_has_every_turn_in_its_direction(analysis):
    figure = Figure()
    plots.draw_polar_spacing(figure, analysis)
    (axes,) = figure.axes
    drawn = lines(figure)
    turns = analysis.spacing
    direction, spacing = drawn["turn 1 to 2"].T
    np.testing.assert_allclose(spacing, turns.distance[turns.turn < 1])
    points = analysis.run.requested.position(turns.s[turns.turn < 1])[:, :2] - (30.0, 10 / (2 * np.pi))
    expected = np.arctan2(points[:, 1], points[:, 0])  # from the true centre of the spiral
    off = np.angle(np.exp(1j * (direction - expected)))
    assert np.abs(off).max() < 0.1  # an involute's normal passes the centre at its base radius
    np.testing.assert_allclose(drawn["requested: 10 mm"][:, 1], 10)
    low, high = axes.get_ylim()
    shown = np.append(turns.distance, 10)
    assert low < 2 * shown.min() - shown.max() + 1e-9
    assert high > shown.max()


def test_of_many_turns_some_are_named():
    analysis = SimpleNamespace(
        spacing=SimpleNamespace(s=np.linspace(0, 1, 240), turn=np.linspace(0, 11.99, 240), distance=np.ones(240)),
        run=SimpleNamespace(requested=SimpleNamespace(turn_spacing=None)),
    )
    figure = Figure()
    plots.draw_spacing(figure, analysis)
    assert len(figure.axes[0].get_lines()) == 12
    assert [name for name in lines(figure) if not name.startswith("_")] == [
        f"turn {k} to {k + 1}" for k in (1, 4, 7, 10)
    ]


def test_the_map_shows_the_height_where_it_lies(bead):
    figure = Figure()
    plots.draw_height_map(figure, bead)
    (image,) = figure.axes[0].get_images()
    shown = image.get_array()
    wet = bead.map.height >= 1e-3 * bead.gap
    np.testing.assert_array_equal(np.ma.getmaskarray(shown), ~wet)
    np.testing.assert_array_equal(shown.data[wet], bead.map.height[wet])
    left, right, bottom, top = image.get_extent()
    rows, columns = bead.map.height.shape
    assert left + 0.5 * (right - left) / columns == pytest.approx(bead.map.x[0])
    assert top - 0.5 * (top - bottom) / rows == pytest.approx(bead.map.y[-1])
    assert image.origin == "lower"
    assert figure.axes[1].get_ylabel() == "height [mm]"


def test_width_and_clearance_are_drawn_along_the_trace(bead, analysis):
    figure = Figure()
    plots.draw_bead_along(figure, bead)
    drawn = lines(figure)
    np.testing.assert_allclose(drawn["width"], np.stack([bead.place, bead.width], axis=1))
    nominal = float(bead.nominal_section.width[0])
    assert drawn[f"nominal: {nominal:.3f} mm"][0, 1] == nominal
    at, clearance = figure.axes[1].get_lines()[0].get_xydata().T
    np.testing.assert_allclose(clearance, bead.clearance())
    np.testing.assert_allclose(at, analysis.spacing.s, atol=1.5)  # the loop's spiral is a little shorter
    assert {"gap", "overlap"} == {text.get_text() for text in figure.axes[1].get_legend().get_texts()}
    off = [patch.get_x() for patch in figure.axes[0].patches]
    assert off == [pytest.approx(bead.length[bead.stretches[0, 1]])]


def test_gaps_are_drawn_above_zero_and_overlaps_below_it(bead, analysis):
    clearance = 0.5 * np.sin(0.02 * np.arange(bead.clearance().size))
    other = copy.copy(bead)
    vars(other)["clearance"] = lambda: clearance
    figure = Figure()
    plots.draw_bead_along(figure, other)
    drawn = {area.get_label(): area for area in figure.axes[1].collections}
    for name, sign in (("gap", 1), ("overlap", -1)):
        heights = np.concatenate([path.vertices[:, 1] for path in drawn[name].get_paths()])
        assert (sign * heights).max() == pytest.approx(0.5, abs=0.01)
        assert (sign * heights).min() > -0.02
    assert not np.array_equal(drawn["gap"].get_facecolor(), drawn["overlap"].get_facecolor())


@pytest.mark.parametrize("signed", [True, False])
def test_a_limit_is_drawn_or_where_it_is_far_beyond_the_scale_said(signed):
    for largest, limit, is_near in ((50.0, 82.0, True), (5.0, 82.0, False)):
        axes = Figure().add_subplot()
        axes.plot([0, 1], [-largest if signed else 0, largest])
        draw_limit(axes, limit, signed=signed)
        drawn = [line.get_ydata()[0] for line in axes.lines[1:]]
        assert drawn == (([82, -82] if signed else [82]) if is_near else [])
        assert bool(axes.get_ylim()[1] > limit) is is_near
        texts = [text.get_text() for text in axes.texts]
        assert texts == ([] if is_near else [f"limit {'± ' if signed else ''}82 µm, beyond this scale"])


def test_the_height_of_a_plan_view_follows_its_content():
    assert plots.view_height(100.0, 50.0, 8.0) == pytest.approx(1.2 + 0.85 * 8.0 / 2)
    assert plots.view_height(100.0, 0.0, 8.0) == pytest.approx(1.2 + 2.0)
    assert plots.view_height(0.0, 100.0, 8.0) == pytest.approx(1.2 + 8.8)


def test_plots_of_a_bead_are_saved_with_it(analysis, bead, tmp_path, monkeypatch):
    shares = []
    saved = plots.save_plots(analysis, tmp_path, bead, shares.append)
    assert [file.name for file in saved] == ["plan.png", "error.png", "budget.png", "spacing.png", "bead.png"]
    assert shares == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0])
    dry = Bead(replace(bead.run, flow=0 * bead.run.flow, flow_demand=0 * bead.run.flow), analysis=analysis)
    # the others are drawn above
    monkeypatch.setattr(Figure, "savefig", save_blank)
    assert "bead.png" not in [file.name for file in plots.save_plots(analysis, tmp_path, dry)]


def test_a_rare_blob_is_annotated_and_does_not_set_the_scale(bead):
    last = np.flatnonzero(bead.run.dispense)[-1]
    flow = bead.run.flow * np.where(np.abs(np.arange(len(bead.run.time)) - last + 20) < 15, 10.0, 1.0)
    even, bead = bead, Bead(replace(bead.run, flow=flow), analysis=bead.analysis)
    figure = Figure()
    plots.draw_bead_along(figure, bead)
    axes = figure.axes[0]
    widest = int(bead.width.argmax())
    texts = [text.get_text() for text in axes.texts]
    assert bead.width[widest] > 2 * np.median(bead.width)
    assert axes.get_ylim()[1] < 0.9 * bead.width[widest]
    assert axes.get_ylim()[1] > 1.2 * np.median(bead.width)
    assert f"maximum {bead.width[widest]:.3g} mm at {bead.place[widest]:.4g} mm" in texts
    figure = Figure()
    plots.draw_bead_along(figure, even)
    assert not [text for text in figure.axes[0].texts if "maximum" in text.get_text()]
    assert figure.axes[0].get_ylim()[1] > even.width.max()


def test_the_colour_bar_of_the_height_marks_the_gap(bead):
    figure = Figure()
    plots.draw_height_map(figure, bead)
    bar = figure.axes[1]
    assert [text.get_text() for text in bar.texts] == ["gap"]
    assert [line.get_ydata()[0] for line in bar.get_lines() if len(set(line.get_ydata())) == 1] == [bead.gap]


def test_what_causes_are_worth_is_drawn_for_every_error():
    errors = ("contour", *LINKS)
    worth = {
        "friction": dict(zip(errors, [8e-3, 0.0, 7.5e-3, -1e-4, 2e-5], strict=True)),
        "winding": dict(zip(errors, [-2e-3, 0.0, -1e-3, 0.0, 0.0], strict=True)),
        "sampling": dict.fromkeys(errors, np.nan),
    }
    figure = Figure(figsize=(10.7, 2.4))
    draw_causes(figure, worth)
    assert [axes.get_title(loc="left") for axes in figure.axes] == list(errors)
    assert [text.get_text() for text in figure.axes[0].get_yticklabels()] == list(worth)
    for axes, error in zip(figure.axes, errors, strict=True):
        widths = [bar.get_width() for bar in axes.containers[0]]
        sizes = [1e3 * one[error] for one in worth.values()]
        np.testing.assert_allclose(widths, np.nan_to_num(sizes))
        numbers = [f"{size:z.1f}".replace("-", "−") if abs(size) >= 0.05 else "0" for size in sizes[:2]]
        assert [text.get_text() for text in axes.texts] == [*numbers, "–"]
        low, high = axes.get_xlim()
        assert low <= min(0, *sizes[:2])
        assert high > max(0, *sizes[:2])
    bottom, top = figure.axes[0].get_ylim()
    assert bottom > top  # the first cause is uppermost


def test_a_full_disk_names_each_plot_once(analysis, tmp_path, monkeypatch):
    def full(_, file, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(file))

    monkeypatch.setattr(Figure, "savefig", full)
    with pytest.raises(plots.PlotError) as refused:
        plots.save_plots(analysis, tmp_path)
    for sentence in str(refused.value).split("; "):
        assert sentence.count(".png") == 1
        assert sentence.endswith(".png: cannot be written: No space left on device")
    assert not list(tmp_path.iterdir())


def test_a_plot_on_a_page_is_the_one_that_is_saved(analysis, tmp_path):
    """Its picture is written on the way; where that fails, it is left to be saved."""
    plot = pictures.spacing_plot(analysis)
    saved = plot.save(tmp_path)
    content = saved.read_bytes()
    saved.unlink()
    figure = plot.figure(tmp_path)
    assert saved.read_bytes() == content
    plain = io.BytesIO()
    with sheet(plot.width, plot.height) as usual:
        draw_spacing(usual, analysis)
        usual.savefig(plain, dpi=plot.resolution)
    np.testing.assert_array_equal(*(np.asarray(Image.open(file).convert("RGB")) for file in (plain, saved)))
    assert Image.open(saved).info["dpi"] == pytest.approx((plot.resolution, plot.resolution), abs=0.01)
    assert figure.axes[0].get_position().bounds == pytest.approx(usual.axes[0].get_position().bounds)
    assert plot.figure(tmp_path / "missing").axes
    assert not replace(plot, fault="axis x").figure(tmp_path / "missing").texts


def test_lines_are_coarser_on_a_page_than_in_the_picture(budget, tmp_path):
    plot = replace(pictures.budget_plot(budget), columns=50)
    fine = Figure()
    plot.draw(fine)
    for before, after in zip(fine.axes, plot.figure().axes, strict=True):
        for line, coarse in zip(before.get_lines(), after.get_lines(), strict=True):
            y, thinner = line.get_ydata(), coarse.get_ydata()
            assert len(thinner) <= 4 * 50
            assert (np.nanmin(thinner), np.nanmax(thinner)) == (np.nanmin(y), np.nanmax(y))


@pytest.mark.soak
def test_plots_that_exist_are_left_alone(analysis, tmp_path):
    (tmp_path / "error.png").write_bytes(b"as it is")
    saved = plots.save_plots(analysis, tmp_path, only_missing=True)
    assert [file.name for file in saved] == ["plan.png", "budget.png", "spacing.png"]
    assert (tmp_path / "error.png").read_bytes() == b"as it is"
