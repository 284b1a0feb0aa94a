"""What the plots draw, line by line."""

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure

from gantrysim import Dispenser, Servo, plots, simulate
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.metrics import Analysis

from runs import turn, turntable

matplotlib.use("agg")


@pytest.fixture(scope="module")
def analysis(xy):
    setpoints = MoveSpiral(60, 2, 10, 100, loop_period=0.05).setpoints(1e-3).hold(0.25)
    return Analysis(simulate(xy, Servo.derive(xy.axes), setpoints, dispenser=Dispenser(flow=200.0)))


def lines(figure, axes=0):
    return {line.get_label(): line.get_xydata() for line in figure.axes[axes].get_lines()}


def test_the_plan_magnifies_the_error_by_what_its_legend_says(analysis):
    figure = Figure()
    plots.draw_plan(figure, analysis)
    drawn = lines(figure)
    label = next(name for name in drawn if name.startswith("nozzle"))
    factor = int(label.split()[-2])
    assert factor > 1
    foot = analysis.nozzle
    on_path = analysis.run.requested.position(foot.s)
    np.testing.assert_allclose(drawn[label], (on_path + factor * foot.offset)[:, :2], atol=1e-9)
    assert factor * np.percentile(foot.distance, 99) <= 0.2 * analysis.spacing.distance.mean()
    worst = next(name for name in drawn if name.startswith("largest"))
    assert worst == f"largest error, {1e3 * foot.distance.max():.0f} µm"


def test_the_errors_over_time_have_their_signs_and_sizes(analysis):
    figure = Figure()
    plots.draw_error(figure, analysis)
    run = analysis.run
    for a, name in enumerate(run.axes):
        np.testing.assert_allclose(lines(figure, 0)[name][:, 1], 1e3 * (run.commanded - run.encoder)[:, a], atol=1e-9)
    lower = lines(figure, 1)
    np.testing.assert_allclose(lower["generation: commanded"][analysis.ticks, 1], 1e3 * analysis.commanded.lateral)
    np.testing.assert_allclose(lower["contour: nozzle"][analysis.ticks, 1], 1e3 * analysis.nozzle.lateral)
    assert np.isnan(lower["contour: nozzle"][~run.dispense, 1]).all()
    # the loop's spiral lies inside the requested one: to the right of a clockwise path
    assert analysis.commanded.lateral.min() < -0.05
    assert analysis.commanded.lateral.max() < 0.01


def test_the_spacing_is_drawn_turn_by_turn_with_what_was_asked_for(analysis):
    figure = Figure()
    plots.draw_spacing(figure, analysis)
    drawn = lines(figure)
    turns = analysis.spacing
    np.testing.assert_allclose(drawn["turn 1 to 2"][:, 1], turns.distance[turns.turn < 1])
    np.testing.assert_allclose(drawn["turn 1 to 2"][:, 0], 360 * turns.turn[turns.turn < 1])
    assert drawn["asked for: 10 mm"][0, 1] == 10


def test_rare_peaks_are_written_down_and_do_not_set_the_scale(analysis):
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
        "commanded - encoder [µm]",
        "commanded - encoder [mdeg]",
        "left of the requested path [µm]",
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
