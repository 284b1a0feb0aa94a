"""Fitted values in a plot: each in percent of the machine's, with its interval, hollow where it is not identified."""

import matplotlib as mpl
import numpy as np
import pytest

from gantrysim.identify.identification import IdentifiedValue
from gantrysim.identify.plots import draw_values
from gantrysim.report.plots.style import sheet

mpl.use("agg")


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
