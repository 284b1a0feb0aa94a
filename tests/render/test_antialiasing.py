"""Edges smoothed after drawing, against pictures whose pixels are integrated exactly."""

import numpy as np
import pytest

from gantrysim.render.antialiasing import smoothed_picture

from support.soaked import suite_runs

SIZE = 120
DARK = 40
LIGHT = 220


def half_plane(degrees, fine):
    """A light half plane; every pixel the mean of fine x fine samples."""
    angle = np.radians(degrees)
    places = (np.arange(SIZE * fine) + 0.5) / fine - SIZE / 2
    inside = (places[None, :] * np.sin(angle) + places[:, None] * np.cos(angle)) > 0.13
    share = inside.reshape(SIZE, fine, SIZE, fine).mean(axis=(1, 3))
    return np.repeat((DARK + (LIGHT - DARK) * share)[..., None], 3, axis=2)


def error(picture, degrees):
    """RMS distance to the exact picture, away from the rim."""
    exact = half_plane(degrees, 16)
    return float(np.sqrt(np.mean((picture[5:-5, 5:-5].astype(float) - exact[5:-5, 5:-5]) ** 2)))


@pytest.mark.parametrize("degrees", suite_runs([7, 20, 33, 45, 60, 83, 110, 200], 1, 4, 7))
def test_an_edge_of_any_direction_comes_nearer_to_the_exact_picture(degrees):
    jagged = np.round(half_plane(degrees, 1)).astype(np.uint8)
    assert error(smoothed_picture(jagged), degrees) < 0.9 * error(jagged, degrees)


def test_flat_areas_and_straight_edges_along_the_pixels_stay():
    flat = np.full((SIZE, SIZE, 3), 90, np.uint8)
    np.testing.assert_array_equal(smoothed_picture(flat), flat)
    level = flat.copy()
    level[: SIZE // 2] = 200
    result = smoothed_picture(level)
    assert np.abs(result.astype(int) - level).max() <= 128  # blended across the edge at most
    np.testing.assert_array_equal(result[: SIZE // 2 - 2], level[: SIZE // 2 - 2])
    np.testing.assert_array_equal(result[SIZE // 2 + 2 :], level[SIZE // 2 + 2 :])


def test_the_mean_brightness_stays_and_no_colour_appears_that_was_not_there():
    generator = np.random.default_rng(1)
    blocks = generator.integers(0, 256, (12, 12, 3)).repeat(10, axis=0).repeat(10, axis=1).astype(np.uint8)
    result = smoothed_picture(blocks)
    assert result.mean() == pytest.approx(blocks.mean(), rel=0.01)
    for channel in range(3):
        assert blocks[..., channel].min() <= result[..., channel].min()
        assert result[..., channel].max() <= blocks[..., channel].max()


def test_a_mirrored_picture_gives_the_mirrored_result():
    jagged = np.round(half_plane(27, 1)).astype(np.uint8)
    mirrored = smoothed_picture(np.ascontiguousarray(jagged[:, ::-1]))[:, ::-1]
    assert np.abs(mirrored.astype(int) - smoothed_picture(jagged)).max() <= 1  # rounding
    upside_down = smoothed_picture(jagged[::-1])[::-1]
    assert np.abs(upside_down.astype(int) - smoothed_picture(jagged)).max() <= 1
