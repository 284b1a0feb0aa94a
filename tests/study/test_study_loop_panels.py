"""The panels of a loop study: columns over the swept value, knees and failures marked, empty panels removed."""

import math

import numpy as np
import pytest
from matplotlib.figure import Figure

from gantrysim.results.colours import FAULT, INK
from gantrysim.study.loop.plots import Panels
from gantrysim.study.loop.study import AS_IT_IS, LOOP_ALONE, PERFECT

from support.figures import legend, marks


def row(value, variant=AS_IT_IS, status="ok", sweep="loop_period", **columns):
    return {"sweep": sweep, "variant": variant, "value": value, "status": status, **columns}


ROWS = [
    row(0.02, contour_rms_um=4.0, speed_ripple=0.02, spacing_mean_mm=10.002),
    row(0.01, contour_rms_um=2.0, speed_ripple=0.01, spacing_mean_mm=9.999),
    row(0.0, contour_rms_um=1.0, speed_ripple=0.01, spacing_mean_mm=10.0),
    row(0.04, contour_rms_um=0.0, speed_ripple=None, spacing_mean_mm=10.0),
    row(0.08, status="fault: travel"),
    row(0.16, variant=LOOP_ALONE, status="fault: travel"),
    row(0.01, variant=LOOP_ALONE, contour_rms_um=3.0, servo_rms_um=3.0, steady_following_along_rms_um=5.0),
    row(0.01, sweep="servo_period", contour_rms_um=7.0),
]


@pytest.fixture
def panels():
    figure = Figure()
    grid = figure.add_gridspec(2, 2)
    axes = [figure.add_subplot(grid[:, 0]), figure.add_subplot(grid[0, 1]), figure.add_subplot(grid[1, 1])]
    return Panels(axes, ROWS, "loop_period", 1e3, "loop period [ms]")


def test_points_are_the_columns_of_a_sweep_and_a_variant_without_what_a_logarithm_cannot_show(panels):
    panels.points(panels.errors, "contour_rms_um", AS_IT_IS, INK, "contour")
    panels.points(panels.errors, "contour_rms_um", LOOP_ALONE, INK, "alone")
    panels.points(panels.errors, "contour_rms_um", PERFECT, INK, "no row")
    found = marks(panels.errors)
    assert found == {"contour": ([10, 20], [2, 4], INK, "o"), "alone": ([10], [3], INK, "o")}
    filled, hollow = panels.errors.lines
    assert (filled.get_markerfacecolor(), hollow.get_markerfacecolor()) == (INK, "none")
    panels.points(panels.errors, "servo_rms_um", LOOP_ALONE, INK, "servo", 2.0)
    panels.points(panels.errors, "steady_following_along_rms_um", LOOP_ALONE, INK, "along")
    servo, along = panels.errors.lines[2:]
    # smaller, as it often lies on the contour error
    assert (servo.get_ydata().tolist(), servo.get_markersize()) == ([6], pytest.approx(0.55 * 5.5))
    assert (along.get_marker(), along.get_markersize()) == ("v", 5.5)


def test_ripples_are_in_percent_and_spacings_magnitudes_of_their_error(panels):
    panels.ripples(AS_IT_IS, LOOP_ALONE)
    panels.spacing_errors(10.0)
    assert marks(panels.ripple) == {AS_IT_IS: ([10, 20], [1, 2], INK, "o")}
    (x, y, *_) = marks(panels.spacing)["error of the mean, as it is"]
    assert (x, y) == ([10, 20], pytest.approx([1, 2]))


def test_lines_have_their_finite_points(panels):
    panels.line(panels.errors, np.array([0.01, 0.02, 0.04]), np.array([1.0, math.nan, 3.0]), INK, "theory", ":")
    panels.line(panels.errors, np.array([0.01]), np.array([math.nan]), INK, "none")
    assert marks(panels.errors) == {"theory": ([10, 40], [1, 3], INK, ":")}


@pytest.mark.parametrize(("knee", "side"), [(0.012, "left"), (0.09, "right")])
def test_a_knee_is_marked_with_its_value_on_the_side_with_room(panels, knee, side):
    panels.errors.set_xlim(10, 100)
    panels.mark(knee, "alone")
    (line,) = panels.errors.lines
    assert (list(line.get_xdata()), line.get_color()) == ([1e3 * knee] * 2, FAULT)
    (text,) = panels.errors.texts
    assert text.get_text() == f"alone: knee at {1e3 * knee:g} ms"
    assert (text.get_ha(), text.xyann[0]) == (side, 5 if side == "left" else -5)
    for none in (None, math.inf):
        panels.mark(none, "alone")
    assert len(panels.errors.lines) == 1


def test_failures_of_the_job_as_it_is_are_marked_at_the_top(panels):
    panels.failures()
    assert marks(panels.errors) == {"as it is: refused or fault": ([80], [0.985], FAULT, "x")}


def test_panels_without_values_leave_their_place_to_the_others(panels):
    figure = panels.errors.figure
    panels.points(panels.errors, "contour_rms_um", AS_IT_IS, INK, "contour")
    panels.ripples(AS_IT_IS)
    panels.finish()
    assert figure.axes == [panels.errors, panels.ripple]
    rows = panels.ripple.get_subplotspec().rowspan
    assert (rows.start, rows.stop) == (0, 2)
    assert panels.ripple.get_xlabel() == "loop period [ms]"
    assert legend(figure) == ["contour"]
    assert legend(panels.ripple) == [AS_IT_IS]
    # the swept values, and a decade of errors at least
    assert panels.errors.xaxis.get_major_locator()() == pytest.approx([10, 20, 40, 80, 160])
    low, high = panels.errors.get_ylim()
    assert (high / low, low * high) == pytest.approx((10, 8), rel=0.1)
    assert panels.errors.yaxis.get_major_formatter()(2.0) == "2"


def test_both_panels_keep_their_places_and_no_panel_leaves_the_errors_alone(panels):
    panels.ripples(AS_IT_IS)
    panels.spacing_errors(10.0)
    panels.finish()
    assert panels.errors.figure.axes == [panels.errors, panels.spacing, panels.ripple]
    assert panels.spacing.get_xlabel() == ""
    assert panels.ripple.get_xlabel() == "loop period [ms]"


def test_errors_alone_fill_the_figure(panels):
    panels.points(panels.errors, "contour_rms_um", AS_IT_IS, INK, "contour")
    panels.finish()
    assert panels.errors.figure.axes == [panels.errors]
    columns = panels.errors.get_subplotspec().colspan
    assert (columns.start, columns.stop) == (0, 2)
