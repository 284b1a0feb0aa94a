"""The plots of a search show its numbers: every mark, step and bar is that of a candidate or a gain."""

import math
from types import SimpleNamespace

import matplotlib as mpl
import numpy as np
import pytest

from gantrysim import Machine
from gantrysim.study.tuning.candidates import Candidate, TrialResult
from gantrysim.study.tuning.plots import draw_gains, draw_loops, draw_machines, draw_search
from gantrysim.study.tuning.search import History

from support.runs import plain

mpl.use("agg")


@pytest.fixture(scope="module")
def servos():
    start = plain(Machine("xy"), kp=[40.0, 30.0], kd=[1.0, 2.0], ki=[0.0, 0.0], acceleration_ff=0.0)
    tuned = start.with_values(kp=[60.0, 60.0], kd=[1.5, 1.0])
    return start, tuned


@pytest.fixture(scope="module")
def history(servos):
    start, tuned = servos

    def candidate(number, metric, runs, servo=tuned, ripple=0.0, excess=0.0, fault=None):
        results = {0: TrialResult(metric, ripple, fault)}
        return Candidate(1, number, servo, excess=excess, results=results, runs=runs)

    first = candidate(1, 30.0, 5, start)
    ripples = candidate(2, 12.0, 10, ripple=0.3)
    fault = candidate(3, math.inf, 15, fault=0.2)
    near = candidate(4, 15.0, 20, excess=0.1)
    best = candidate(5, 20.0, 25)
    return History([first, ripples, fault, near, best], [first, best], 0, 40, 1, "budget")


def lines_of(axes):
    return {line.get_label(): np.array(line.get_data()) for line in axes.get_lines()}


def test_every_candidate_is_a_mark_of_its_rank_at_its_runs(history):
    above, below = draw_search(history, "contour error", 0.1).axes
    lines = lines_of(above)
    assert lines["feasible"].tolist() == [[5, 25], [30, 20]]
    assert lines["torque ripple too high"].tolist() == [[10], [12]]
    assert lines["margin too small"].tolist() == [[20], [15]]
    assert lines["fault"][0].tolist() == [15]
    # the last candidate stays the best until the end
    assert lines["best so far"].tolist() == [[5, 25, 40], [30, 20, 20]]
    assert above.get_ylabel() == "contour error [µm]"
    low, high = above.get_ylim()
    assert low < 12 < 30 < high
    assert below.get_xlim() == pytest.approx((0, 40.8))


def test_gains_of_leaders_are_shares_of_the_tuned_ones(history):
    lines = lines_of(draw_search(history, "contour error", 0.1).axes[1])
    assert lines["kp"].tolist() == [[5, 25, 40], pytest.approx([40 / 60, 1, 1])]
    assert lines["kd"].tolist() == [[5, 25, 40], pytest.approx([1 / 1.5, 1, 1])]
    # a gain that the tuned servo has not
    assert "ki" not in lines


def test_a_bar_is_the_ratio_of_a_gain_to_that_at_the_start(servos):
    (panel,) = draw_gains(*servos, ("x", "y")).axes
    bars = {container.get_label(): list(container) for container in panel.containers}
    names = [label.get_text() for label in panel.get_xticklabels()]
    assert names == ["kp", "ki", "kd", "velocity_ff", "acceleration_ff"]
    for axis, ratios, side in (("x", {0: 1.5, 2: 1.5, 3: 1.0}, -1), ("y", {0: 2.0, 2: 0.5, 3: 1.0}, 1)):
        tops = {round(bar.get_x() + bar.get_width() / 2): bar.get_y() + bar.get_height() for bar in bars[axis]}
        assert tops == pytest.approx(ratios)
        for bar in bars[axis]:
            middle = bar.get_x() + bar.get_width() / 2
            assert middle - round(middle) == pytest.approx(0.2 * side)
    assert {text.get_text() for text in panel.texts} == {"1.5", "2", "0.5", "1"}
    low, high = panel.get_ylim()
    assert low < 0.5 < 2 < high


def test_the_share_of_machines_rises_to_those_without_a_fault():
    unseen = {"start": np.array([30.0, 10.0, math.inf, 20.0]), "tuned": np.array([4.0, 2.0])}
    searched = {"start": [25.0, math.inf], "tuned": [3.0]}
    (axes,) = draw_machines(unseen, searched, "error [µm]").axes
    lines = lines_of(axes)
    assert lines["start, unseen machines"].tolist() == [[10, 10, 20, 30], [0, 25, 50, 75]]
    assert lines["tuned, unseen machines"].tolist() == [[2, 2, 4], [0, 50, 100]]
    assert lines["start, machines of the search"][0].tolist() == [25]
    assert lines["tuned, machines of the search"][0].tolist() == [3]
    assert axes.get_xlabel() == "error [µm]"


def test_open_loops_are_drawn_with_their_sensitivities(servos):
    """Of L = -g / 2 on all frequencies, S = 1 / (1 - g / 2)."""
    gain = {(40.0, 0): 0.5, (60.0, 0): 1.0, (60.0, 1): 1.2}

    def loop(servo, frequency, machine):
        value = -0.5 * gain[servo.per_axis("kp")[0], machine]
        return np.tile([value + 0j, 0.5 * value + 0j], (frequency.size, 1))

    stability = SimpleNamespace(peak=2.0, machines=2, loop=loop)
    near_point, peaks = draw_loops(stability, *servos, ("x", "y")).axes
    drawn = [line.get_xdata()[0] for line in near_point.get_lines()[1:]]
    assert sorted(drawn) == pytest.approx(sorted([-0.25, -0.125, -0.5, -0.25, -0.6, -0.3, 0.0]))
    sensitivities = lines_of(peaks)
    assert sensitivities["start"][1] == pytest.approx(1 / 0.75)
    assert sensitivities["x, tuned"][1] == pytest.approx(2.0)
    assert sensitivities["y, tuned"][1] == pytest.approx(1 / 0.75)
    frequency = sensitivities["start"][0]
    nyquist = 0.5 / servos[0].period
    assert (frequency[0], frequency[-1]) == pytest.approx((1e-3 * nyquist, nyquist))
    # the circle about -1 that the loops of a peak of 2 keep off
    corners = near_point.patches[0].get_xy()
    assert np.hypot(corners[:, 0] + 1, corners[:, 1]) == pytest.approx(0.5)
    assert near_point.get_lines()[0].get_xydata().tolist() == [[-1, 0]]
