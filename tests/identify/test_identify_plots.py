"""Fitted values in a plot: each in percent of the machine's, with its interval, hollow where it is not identified."""

from types import SimpleNamespace

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure

from gantrysim.identify.identification import IdentifiedValue
from gantrysim.identify.plots import Course, draw_course, draw_values, save_plots
from gantrysim.report.plots.style import sheet

mpl.use("agg")
COLUMNS = ("position", "predicted", "speed", "torque", "modelled", "friction", "residual")


def test_values_and_intervals_are_in_percent_of_the_machine_s():
    values = [
        IdentifiedValue("x", "inertia", "kg", 3.0, 2.7, 3.3, 2.0, True),
        IdentifiedValue("y", "gap", "mm", 0.1, 0.05, 0.15, 0.0, True),
        IdentifiedValue("y", "coulomb", "N", 1.0, 0.5, 2.0, 4.0, False, "too wide"),
    ]
    with sheet(8.0, 4.0) as figure:
        axes = draw_values(figure, values)
    machine, *lines = [line.get_xydata() for line in axes.get_lines()]
    assert machine[:, 0].tolist() == [100, 100]
    assert [line.tolist() for line in lines] == [
        [[pytest.approx(135), 0], [pytest.approx(165), 0]],
        [[pytest.approx(150), 0]],
        [[pytest.approx(12.5), 2], [pytest.approx(50), 2]],
        [[pytest.approx(25), 2]],
    ]
    filled = [line.get_markerfacecolor() != "white" for line in axes.get_lines()[2::2]]
    assert filled == [True, False]
    # 15 % of the value to both sides
    bars = [(bar.get_x(), bar.get_x() + bar.get_width()) for bar in axes.patches]
    assert np.array(bars) == pytest.approx(np.array([[127.5, 172.5], [21.25, 28.75]]))
    low, high = axes.get_ylim()
    assert low > 2 > 0 > high
    assert [label.get_text().split(":")[0] for label in axes.get_yticklabels()] == ["x", "y", "y"]


@pytest.mark.parametrize(("unit", "small"), [("mm", "µm"), ("deg", "mdeg")])
def test_the_course_of_a_log_has_a_panel_and_a_unit_for_each_quantity(monkeypatch, unit, small):
    """The residual in thousandths; of each line the samples of the log."""
    time = np.linspace(0.0, 1.0, 50)
    columns = {name: k + time**2 for k, name in enumerate(COLUMNS)}
    monkeypatch.setattr(Course, "of", lambda fit, log: Course(time=time, **columns))
    fit = SimpleNamespace(unit=unit, axis="y", starts=(0,))
    panels = draw_course(Figure(), (fit, SimpleNamespace(axes=("x", "y"))))
    assert [axes.get_ylabel() for axes in panels] == [
        f"position [{unit}]",
        f"speed [{unit}/s]",
        "torque [N·m]",
        f"residual [{small}]",
    ]
    drawn = [[line.get_ydata() for line in axes.get_lines()] for axes in panels]
    expected = [("position", "predicted"), ("speed",), ("torque", "modelled"), ("residual",)]
    for lines, names in zip(drawn, expected, strict=True):
        for line, name in zip(lines, names, strict=True):
            np.testing.assert_allclose(line, columns[name] * (1e3 if name == "residual" else 1.0))
    assert panels[0].get_title("right") == "axis y"
    assert panels[-1].get_xlabel() == "time of the log [s]"


def test_a_picture_has_a_row_of_the_same_height_for_each_axis(monkeypatch, tmp_path):
    """What two axes are higher than one is the height of a row, and of three twice that."""
    monkeypatch.setattr("gantrysim.identify.plots.draw_friction", lambda part, of: None)
    monkeypatch.setattr("gantrysim.identify.plots.draw_residuals", lambda fits, period: Figure())
    monkeypatch.setattr("gantrysim.identify.plots.draw_moves_response", lambda fits, period: Figure())
    heights = []
    for count in (1, 2, 3):
        save_plots((None,) * count, SimpleNamespace(period=1e-3), tmp_path)
        heights.append(len(plt.imread(tmp_path / "friction.png")))
    assert np.diff(heights, 2) == pytest.approx(0, abs=1)
    assert heights[1] > 1.5 * heights[0]
