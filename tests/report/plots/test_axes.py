"""Plots drawn on axes, or on a part of a figure, of one's own."""

import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gantrysim import Budget, Job, plots
from gantrysim.glue.bead import Bead
from gantrysim.metrics import Analysis

from support.jobs import job_run


@pytest.fixture(scope="module")
def analysis():
    return Analysis(job_run("fanuc-spiral"))


def test_single_plots_draw_on_given_axes_and_return_them(analysis):
    figure = Figure(layout="constrained")
    own = [*figure.subplots(1, 3), figure.add_subplot(projection="polar")]
    bead = Bead(analysis.run, Job.load("fanuc-spiral").bead)
    draws = [plots.draw_plan, plots.draw_spacing, plots.draw_height_map, plots.draw_polar_spacing]
    for axes, draw in zip(own, draws, strict=True):
        assert draw(axes, bead if draw is plots.draw_height_map else analysis) is axes
        assert axes.has_data()
    assert not figure.legends  # but in the axes
    assert own[0].get_legend() is not None


def test_plots_of_several_panels_draw_on_a_part_of_a_figure(analysis):
    figure = Figure(layout="constrained")
    for part, draw in zip(figure.subfigures(1, 3), ("error", "budget", "budget_along"), strict=True):
        of = analysis if draw == "error" else Budget(analysis)
        panels = getattr(plots, f"draw_{draw}")(part, of)
        assert all(isinstance(panel, Axes) and panel.get_figure(root=False) is part for panel in panels)
        assert list(panels) == part.axes
    assert isinstance(plots.draw_plan(Figure(), analysis), Axes)
