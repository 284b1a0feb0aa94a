"""Positioning after ISO 230-2 of deviations that are known."""

import numpy as np
import pytest

from gantrysim.base.errors import InputError
from gantrysim.metrics import Positioning

TARGETS = np.linspace(-100, 100, 9)
EXACT = 1e-12  # [mm]


def test_play_is_the_reversal_and_a_slope_the_systematic_deviation():
    slope = 1e-4 * TARGETS
    found = Positioning(TARGETS, np.tile(slope, (3, 1)), np.tile(slope + 0.016, (3, 1)))
    assert found.reversal == pytest.approx(0.016, abs=EXACT)
    assert found.unidirectional_repeatability == pytest.approx(0, abs=EXACT)
    assert found.repeatability == pytest.approx(0.016, abs=EXACT)
    assert found.systematic == pytest.approx(0.02 + 0.016, abs=EXACT)
    assert found.accuracy == pytest.approx(0.02 + 0.016, abs=EXACT)


def test_scatter_counts_four_standard_deviations_one_way_and_both():
    up, down = np.zeros((5, 9)), np.zeros((5, 9))
    up[:, 3] = [0.002, -0.002, 0.002, -0.002, 0.0]  # s = 0.002
    down[:, 3] = [0.001, -0.001, 0.001, -0.001, 0.0]  # s = 0.001
    down += 0.003
    found = Positioning(TARGETS, up, down)
    assert found.unidirectional_repeatability == pytest.approx(0.008, abs=EXACT)
    assert found.repeatability == pytest.approx(2 * 0.002 + 2 * 0.001 + 0.003, abs=EXACT)
    assert found.accuracy == pytest.approx((0.003 + 0.002) - (-0.004), abs=EXACT)
    assert found.systematic == pytest.approx(0.003, abs=EXACT)
    wide = Positioning(TARGETS, up, up)
    assert wide.repeatability == pytest.approx(0.008, abs=EXACT)


def test_one_cycle_has_no_scatter():
    with pytest.raises(InputError, match="n at least 2"):
        Positioning(TARGETS, np.zeros((1, 9)), np.zeros((1, 9)))
