"""The entries of a table that are nearer to a point than their neighbours, against a search by NumPy."""

import numpy as np
import pytest

from gantrysim.base.jit import plain_jit
from gantrysim.paths.minima import Minima, find_minima


@plain_jit
def minima_between(points, point, low, high, minima):
    return find_minima(points, point, low, high, minima)


def searched(points, point, low, high, buffer):
    numbers = np.full((3, buffer), np.nan)
    minima = Minima(np.zeros(buffer, np.int64), *numbers)
    count = minima_between(points, point, low, high, minima)
    return minima.entry[:count].tolist(), minima.distance[:count], minima.place[:count]


@pytest.mark.parametrize("window", [(0, 59), (0, 0), (59, 59), (7, 41), (58, 59)])
@pytest.mark.parametrize("buffer", [60, 24, 11])
def test_minima_in_windows_longer_and_shorter_than_the_buffer(window, buffer):
    """Far fewer minima than a buffer holds: long waves."""
    low, high = window
    for seed in range(20):
        rng = np.random.default_rng(seed)
        along = np.linspace(0.0, 1.0, 60)
        waves = rng.normal(size=(3, 3)) @ np.cos(np.outer(np.arange(1, 4), 3.0 * along))
        points = np.asfortranarray(waves.T)
        point = rng.normal(size=3)
        squares = np.concatenate([[np.inf], ((points - point) ** 2).sum(axis=1), [np.inf]])
        here = squares[1:-1]
        before = squares[:-2]
        after = squares[2:]
        expected = [k for k in range(low, high + 1) if here[k] <= before[k] and here[k] < after[k]]
        is_minimum = bool(expected)
        expected = expected or [low + int(here[low : high + 1].argmin())]
        entry, distance, place = searched(points, point, low, high, buffer)
        assert entry == expected
        assert distance == pytest.approx(np.sqrt(here[expected]), rel=1e-14)
        for k, at in zip(entry, place, strict=True):
            vertex = 0.0
            if is_minimum and 0 < k < 59:  # the vertex of a parabola
                vertex = 0.5 * (before[k] - after[k]) / (before[k] - 2 * here[k] + after[k])
            assert at == pytest.approx(k + vertex, abs=1e-9)


def test_minima_without_room_are_left_out():
    points = np.asfortranarray(np.column_stack([np.arange(40.0) % 2, np.zeros(40), np.zeros(40)]))
    entry, distance, _ = searched(points, np.zeros(3), 0, 39, 6)
    assert entry == [0, 2, 4, 6, 8, 10]
    assert not distance.any()
