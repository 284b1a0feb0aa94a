"""Computations over whole grids equal loops from cell to cell, to the last bit."""

import math

import numpy as np
import pytest

from gantrysim.glue.bead import contacts, pushing
from gantrysim.glue.bead.footprint import footprint, headroom, wet_where_pushed
from gantrysim.glue.bead.laying import Layer
from gantrysim.metrics.spacing import forward

SHAPES = [(17, 20), (18, 23), (33, 1), (1, 7), (2, 2)]


def grids(seed, count, shape):
    rng = np.random.default_rng(seed)
    return [np.where(rng.random(shape) < 0.3, 0.0, rng.random(shape)) for _ in range(count)]


@pytest.mark.parametrize("angle", [0, 33, 90, 118, 180, 251, 270, 345])
def test_the_footprint_of_a_pass_is_the_strip_with_round_ends_about_it(angle):
    """Of one interval of any length and direction: half a cell and more within it 1, without it 0, linear growth."""
    shape = (64, 60)
    centre = 30 + 31j
    along = np.exp(1j * math.radians(angle))
    start, stop = centre - 15 * along, centre + 15 * along
    half = np.array([3.0, 6.0])
    stations = np.array([start, stop])
    share = footprint(shape, stations.real, stations.imag, half, np.ones(1), np.empty((0, 3)))
    rows, columns = np.indices(shape)
    place = columns + 1j * rows
    way = np.clip(((place - start) * along.conjugate()).real / 30, 0, 1)
    beyond = np.abs(place - (start + 30 * way * along)) - (half[0] + 3.0 * way)
    assert np.all(share[beyond < -1.0] == 1.0)
    assert np.all(share[beyond > 1.0] == 0.0)
    edge = np.abs(beyond) < 1.0
    # a hat two cells wide: half of it lies within at the edge
    within = np.where(beyond < 0, 1 - 0.5 * (1 + beyond) ** 2, 0.5 * (1 - beyond) ** 2)
    np.testing.assert_allclose(share[edge], within[edge], atol=1e-12)
    back = footprint(shape, stations.real[::-1], stations.imag[::-1], half[::-1], np.ones(1), np.empty((0, 3)))
    np.testing.assert_allclose(back, share, atol=1e-12)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("size", [2, 3, 8])
def test_means_over_blocks(shape, size):
    (values,) = grids(1, 1, shape)
    means = pushing.means(values, size, 0.7)
    for (row, column), mean in np.ndenumerate(means):
        total = 0.0
        for j in range(row * size, (row + 1) * size):
            for i in range(column * size, (column + 1) * size):
                total += values[j, i] if j < shape[0] and i < shape[1] else 0.7
        assert mean == total / size**2


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("size", [2, 8])
def test_means_over_blocks_with_the_values_of_the_rim(shape, size):
    (values,) = grids(2, 1, shape)
    for (row, column), mean in np.ndenumerate(pushing.means(values, size)):
        total = 0.0
        for j in range(row * size, (row + 1) * size):
            for i in range(column * size, (column + 1) * size):
                total += values[min(j, shape[0] - 1), min(i, shape[1] - 1)]
        assert mean == total / size**2


def interpolated(coarse, j, i):
    q = j // 2
    m = i // 2
    p = min(max(q + (1 if j % 2 else -1), 0), coarse.shape[0] - 1)
    n = min(max(m + (1 if i % 2 else -1), 0), coarse.shape[1] - 1)
    near = 0.75 * coarse[q, m] + 0.25 * coarse[p, m]
    far = 0.75 * coarse[q, n] + 0.25 * coarse[p, n]
    return 4.0 * (0.75 * near + 0.25 * far)


@pytest.mark.parametrize("dry", [0.3, 0.95, 1.0])
@pytest.mark.parametrize("shape", SHAPES)
def test_the_start_from_a_coarse_grid(shape, dry):
    ny, nx = shape
    (coarse,) = grids(3, 1, ((ny + 1) // 2, (nx + 1) // 2))
    coarse[np.random.default_rng(10).random(coarse.shape) < dry] = 0.0
    height, ceiling = grids(4, 2, shape)
    surface = pushing._Surface(height, ceiling, np.zeros(shape), np.zeros(shape))
    listed = pushing.exceeds(height, ceiling, 0.02)
    expected = height.copy()
    for j, i in np.ndindex(shape):
        given = interpolated(coarse, j, i)
        around = (j > 0) + (j < ny - 1) + (i > 0) + (i < nx - 1)
        expected[j, i] -= given
        for p, q in ((j - 1, i), (j + 1, i), (j, i - 1), (j, i + 1)):
            if 0 <= p < ny and 0 <= q < nx:
                expected[p, q] += given / around
    total = height.sum()
    pushing._start_from(coarse, surface, listed, 0.02)
    for j, i in np.ndindex(shape):
        assert surface.handed[j, i] == interpolated(coarse, j, i)
        assert listed[j, i] == (surface.handed[j, i] > 0.0 or expected[j, i] > ceiling[j, i] * 1.02)
    assert np.array_equal(height, expected)
    assert height.sum() == pytest.approx(total, rel=1e-12)


@pytest.mark.parametrize("shape", SHAPES)
def test_cells_to_push(shape):
    height, ceiling = grids(5, 2, shape)
    expected = [[j, i] for j in range(shape[0]) for i in range(shape[1]) if height[j, i] > ceiling[j, i] * (1.0 + 0.02)]
    listed = pushing.exceeds(height, ceiling, 0.02)
    queue, count = pushing._to_push(listed)
    assert queue.cells[:count].tolist() == expected
    assert len(queue.cells) == queue.listed.size
    assert np.argwhere(queue.listed).tolist() == expected


@pytest.mark.parametrize("uneven", [False, True])
def test_headroom(uneven):
    shape = SHAPES[0]
    under, glue, moment, crest = grids(6, 4, shape)
    ceiling, rise = headroom(under, Layer(glue, moment if uneven else np.zeros((0, 0)), crest), 0.4, 0.1)
    for j, i in np.ndindex(shape):
        face = moment[j, i] / glue[j, i] if uneven and glue[j, i] > 0.0 else 0.4
        beside = 1.0 - under[j, i]
        assert ceiling[j, i] == under[j, i] * face + beside * max(crest[j, i], face)
        assert rise[j, i] == beside * 0.1


def test_shares_where_glue_was_pushed():
    shape = SHAPES[0]
    share, laid, pushed, ceiling = grids(7, 4, shape)
    expected = share.copy()
    for j, i in np.ndindex(shape):
        gain = pushed[j, i] - laid[j, i]
        room = ceiling[j, i] - laid[j, i]
        if gain > 0.0 and room > 0.0:
            expected[j, i] += (1.0 - expected[j, i]) * min(gain / room, 1.0)
    wet_where_pushed(share, laid, pushed, ceiling)
    assert np.array_equal(share, expected)


def test_arc_lengths_ahead_of_all_before():
    s = np.random.default_rng(8).integers(0, 50, 400) / 7.0
    assert forward(s).tolist() == [all(value > before for before in s[:k]) for k, value in enumerate(s)]
    assert forward(np.zeros(0)).size == 0


def test_sections_are_sorted_into_the_cells_of_their_boxes():
    rng = np.random.default_rng(9)
    count = 40
    x, y, half, top = rng.uniform(0.0, 30.0, (4, count))
    half /= 6.0
    one = np.ones(count)
    dots = np.zeros(count, bool)
    sections = contacts.Sections(one, x, y, one, one, one, top, one, one, one, one, half, dots, thickness=0.2)
    needle = contacts.Needle(np.zeros((1, 3)), np.zeros(1), np.zeros(1, bool), np.ones(1, bool), 0.5, 1.0, 0.1)
    cells = contacts.cells_of(sections, needle)
    reach = half + 0.7
    assert cells.first[0] == 0
    assert cells.first[-1] == cells.section.size
    for cell in range(cells.columns * cells.rows):
        low_x = cells.x + cells.size * (cell % cells.columns)
        low_y = cells.y + cells.size * (cell // cells.columns)
        meets = (x + reach >= low_x) & (x - reach < low_x + cells.size)
        meets &= (y + reach >= low_y) & (y - reach < low_y + cells.size)
        members = np.flatnonzero(meets)
        assert cells.section[cells.first[cell] : cells.first[cell + 1]].tolist() == members.tolist()
        assert cells.highest[cell] == (top[members].max() if members.size else -np.inf)
