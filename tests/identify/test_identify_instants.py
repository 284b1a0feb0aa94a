"""Instants of a log's rows: the period of its stamps, and where rows are missing."""

import numpy as np
import pytest

from gantrysim import InputError
from gantrysim.identify.instants import instants_of

PERIOD = 1e-3
WHOLE = np.ones(500, bool)
TIME = PERIOD * np.arange(500)


def test_the_period_is_that_of_all_stamps():
    assert instants_of(WHOLE, TIME, None).period == pytest.approx(PERIOD)
    assert instants_of(WHOLE, np.round(TIME, 4), None).period == pytest.approx(PERIOD)
    late = np.where(np.arange(500) > 250, TIME + 0.0123, TIME)
    found = instants_of(WHOLE, late, None)
    assert found.period == pytest.approx(PERIOD)
    assert found.pieces == (slice(0, 251), slice(251, 500))
    assert found.begins == pytest.approx((0.0, 0.2633))


def test_time_stamps_must_be_even():
    late = TIME + np.where(np.arange(500) == 200, 0.3 * PERIOD, 0.0)
    with pytest.raises(
        InputError, match=r"at t = 0\.2003 s one is off by 30 % of the period, 1 ms: must be within 10 % of it"
    ):
        instants_of(WHOLE, late, None)
    # a clock that runs 1 % faster in the end than at the start
    with pytest.raises(InputError, match="are not even"):
        instants_of(WHOLE, TIME + 0.01 * TIME**2 / TIME[-1], None)
    # the same in two pieces, each of which would be even with a period of its own
    two_clocks = np.where(np.arange(500) < 250, TIME, 1.0 + 1.02 * TIME)
    with pytest.raises(InputError, match="are not even"):
        instants_of(WHOLE, two_clocks, None)
    # every other row is of another time
    with pytest.raises(InputError, match=r"time does not rise: rows 2 and 3 have 0\.001 and 0\.001 s"):
        instants_of(WHOLE, PERIOD * ((np.arange(500) + 1) // 2), None)


def test_one_row_that_is_missing_ends_a_piece():
    found = instants_of(np.ones(499, bool), np.delete(TIME, 300), None)
    assert found.pieces == (slice(0, 300), slice(300, 499))
    assert found.notes == ("log: of 499 rows, 499 are used, in 2 pieces, as rows or values are missing after 0.299 s",)
    # stamps that need not be rounded show it too where the period is given
    assert instants_of(np.ones(499, bool), np.delete(TIME, 300), PERIOD).pieces == found.pieces


def test_many_pieces_are_counted():
    whole = WHOLE.copy()
    whole[[50, 100, 150, 200, 250, 255]] = False
    found = instants_of(whole, TIME, None)
    assert [piece.start for piece in found.pieces] == [0, 51, 101, 151, 201, 256]
    assert found.notes == (
        "log: of 500 rows, 490 are used, in 6 pieces, as rows or values are missing after 0.049 s, 0.099 s, 0.149 s "
        "and 2 times more",
    )


def test_a_gap_without_stamps_is_as_long_as_its_rows():
    whole = WHOLE.copy()
    whole[100:110] = False
    found = instants_of(whole, None, 2e-3)
    assert found.begins == pytest.approx((0.0, 0.22))
    assert found.period == 2e-3


def test_a_jittering_clock_is_said_where_the_period_is_given():
    jitter = TIME + 4e-4 * np.sin(np.arange(500.0))
    with pytest.raises(InputError, match="not even"):
        instants_of(WHOLE, jitter, None)
    (note,) = instants_of(WHOLE, jitter, PERIOD).notes
    assert note == (
        "log: its time stamps are off even ones by up to 40 % of the period; its samples are taken to be even, 1 ms "
        "apart, as the period is given"
    )


@pytest.mark.parametrize("period", [None, PERIOD])
def test_a_recording_that_begins_anew_is_another_piece(period):
    """As a scope's buffers one after the other, each with a time from zero on."""
    found = instants_of(WHOLE, np.concatenate([TIME[:200], TIME[:300]]), period)
    assert found.period == pytest.approx(PERIOD)
    assert found.pieces == (slice(0, 200), slice(200, 500))
    assert found.begins == (0.0, 0.0)
    assert "in 2 pieces, as rows or values are missing after 0.199 s" in found.notes[-1]
