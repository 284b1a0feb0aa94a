"""How far the nozzle is from its command at each place of the path, against the record itself."""

import math
from functools import cache

import numpy as np
import pytest

from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.remedy.deviation import PARTS, Deviation, largest_of, part_of

from support.remedies import rubbing


@cache
def budget():
    """A circle, where friction turns round at four places."""
    return Budget(Analysis(rubbing().run()))


def distances():
    run = budget().analysis.run
    ticks = budget().analysis.ticks
    return np.linalg.norm(run.nozzle[ticks] - run.commanded_tip[ticks], axis=1)


def test_no_tick_deviates_more_than_its_part_and_the_next_ones():
    deviation = Deviation.of(budget())
    distance = distances()
    length = budget().analysis.run.requested.length
    for trace in (budget().analysis.nozzle, budget().analysis.commanded):
        assert np.all(distance <= deviation.largest[part_of(trace.s, length)] * (1 + 1e-12))
    assert deviation.largest.max() == pytest.approx(distance.max(), rel=1e-12)


def test_most_parts_deviate_far_less_than_the_worst():
    deviation = Deviation.of(budget())
    rms = math.sqrt(np.mean(distances() ** 2))
    assert deviation.largest.min() == pytest.approx(0.3 * rms, rel=1e-12)
    assert np.median(deviation.largest) < 0.5 * deviation.largest.max()


def test_on_another_path_any_part_may_deviate_most():
    deviation = Deviation.of(budget())
    assert deviation.on(deviation.length) is deviation
    other = deviation.on(1.01 * deviation.length)
    assert other.largest.tolist() == [deviation.largest.max()] * PARTS


def test_the_largest_of_several_is_that_of_each_part():
    low = Deviation(8.0, np.linspace(0, 1, PARTS))
    high = Deviation(8.0, np.linspace(1, 0, PARTS))
    assert np.array_equal(largest_of([low, high], 8.0), np.maximum(low.largest, high.largest))
    assert np.isinf(largest_of([low, Deviation.unknown()], 8.0)).all()


def test_parts_divide_the_path_evenly():
    s = (np.arange(PARTS) + 0.5) / PARTS * 8.0
    assert part_of(s, 8.0).tolist() == list(range(PARTS))
    assert part_of(np.array([-1e-9, 8.0]), 8.0).tolist() == [0, PARTS - 1]
    assert part_of(np.array([0.0]), 0.0).tolist() == [0]
