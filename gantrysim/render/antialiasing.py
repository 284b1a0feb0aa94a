"""Edges of a picture smoothed after it is drawn: in software a fifth of the time of drawing every pixel four times.

The method is fast approximate anti-aliasing (T. Lottes, 2009). Where the luma of a pixel's neighbours differs, the edge
runs at right angles to the gradient of luma; the pixel becomes the mean of samples a little further along the edge on
both sides of it, unless these lie outside the range of luma around the pixel, as then they belong to something else.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.jit import jit
from gantrysim.render.encoding import Picture

_CONTRAST = 0.08  # of luma around a pixel, relative to the largest, below which there is no edge
_DARK = 8.0  # least difference of luma that is an edge in the dark, of 255
_FURTHEST = 6.0  # of the samples along the edge [pixels]
# distances of the two pairs of samples, relative to the furthest
_NEAR = 1 / 6
_FAR = 1 / 2
_SLACK = 0.03  # of the gradient, so that no direction is undefined
_LEAST_SLACK = 0.5
_LUMA = (0.299, 0.587, 0.114)  # of red, green and blue
_SINGLE_LUMA = tuple(np.float32(share) for share in _LUMA)
_SINGLE_CONTRAST = np.float32(_CONTRAST)
_SINGLE_DARK = np.float32(_DARK)


Luma = NDArray[np.float32]
Pixel = tuple[float, float, float]


def smoothed(picture: Picture) -> Picture:
    """Return a picture with smooth edges, (height, width, 3)."""
    drawn = np.ascontiguousarray(picture)
    luma = np.empty(drawn.shape[:2], np.float32)
    result = drawn.copy()
    _smooth(drawn, luma, np.empty(drawn.shape[1], np.bool_), result)
    return result


@jit
def _smooth(picture: Picture, luma: Luma, edges: NDArray[np.bool_], result: Picture) -> None:
    """Write the smoothed pixels of all edges, but for those at the rim of the picture; luma and edges are scratch.

    All edges of a row are found before any is smoothed: that loop has no branch, so it runs on many pixels at once.
    """
    height, width = luma.shape
    for row in range(height):
        for column in range(width):
            luma[row, column] = (
                _SINGLE_LUMA[0] * np.float32(picture[row, column, 0])
                + _SINGLE_LUMA[1] * np.float32(picture[row, column, 1])
                + _SINGLE_LUMA[2] * np.float32(picture[row, column, 2])
            )
    for row in range(1, height - 1):
        for column in range(1, width - 1):
            least, largest = _range(luma, row, column)
            edges[column] = largest - least >= max(_SINGLE_CONTRAST * largest, _SINGLE_DARK)
        for column in range(1, width - 1):
            if edges[column]:
                _smooth_pixel(picture, luma, row, column, result)


@jit
def _range(luma: Luma, row: int, column: int) -> tuple[float, float]:
    """Return the least and the largest luma of a pixel and its neighbours at its corners."""
    middle = luma[row, column]
    above_left = luma[row - 1, column - 1]
    above_right = luma[row - 1, column + 1]
    below_left = luma[row + 1, column - 1]
    below_right = luma[row + 1, column + 1]
    least = min(middle, min(min(above_left, above_right), min(below_left, below_right)))
    largest = max(middle, max(max(above_left, above_right), max(below_left, below_right)))
    return least, largest


@jit
def _smooth_pixel(picture: Picture, luma: Luma, row: int, column: int, result: Picture) -> None:
    """Write a smoothed pixel."""
    down, across = _along(luma, row, column)
    near = _pair(picture, row, column, _NEAR * down, _NEAR * across)
    far = _pair(picture, row, column, _FAR * down, _FAR * across)
    red = np.uint8(0.5 * (near[0] + far[0]) + 0.5)
    green = np.uint8(0.5 * (near[1] + far[1]) + 0.5)
    blue = np.uint8(0.5 * (near[2] + far[2]) + 0.5)
    mean = _LUMA[0] * red + _LUMA[1] * green + _LUMA[2] * blue
    least, largest = _range(luma, row, column)
    if mean < least or mean > largest:
        red = np.uint8(near[0] + 0.5)
        green = np.uint8(near[1] + 0.5)
        blue = np.uint8(near[2] + 0.5)
    result[row, column, 0] = red
    result[row, column, 1] = green
    result[row, column, 2] = blue


@jit
def _along(luma: Luma, row: int, column: int) -> tuple[float, float]:
    """Return the way along the edge at a pixel, square to the gradient: rows and columns, at most the furthest."""
    above_left = luma[row - 1, column - 1]
    above_right = luma[row - 1, column + 1]
    below_left = luma[row + 1, column - 1]
    below_right = luma[row + 1, column + 1]
    across = (below_left + below_right) - (above_left + above_right)
    down = (above_left + below_left) - (above_right + below_right)
    slack = max(0.25 * _SLACK * (above_left + above_right + below_left + below_right), _LEAST_SLACK)
    scale = 1.0 / (min(abs(across), abs(down)) + slack)
    across = min(max(across * scale, -_FURTHEST), _FURTHEST)
    down = min(max(down * scale, -_FURTHEST), _FURTHEST)
    return down, across


@jit
def _pair(picture: Picture, row: int, column: int, down: float, across: float) -> Pixel:
    """Return the mean of the colours at two places on both sides of a pixel, so many rows and columns away from it."""
    before = _sample(picture, row - down, column - across)
    after = _sample(picture, row + down, column + across)
    return 0.5 * (before[0] + after[0]), 0.5 * (before[1] + after[1]), 0.5 * (before[2] + after[2])


@jit
def _sample(picture: Picture, row: float, column: float) -> Pixel:
    """Return the colour between four pixels; beyond the rim that of the rim."""
    height, width, _ = picture.shape
    row = min(max(row, 0.0), height - 1.001)
    column = min(max(column, 0.0), width - 1.001)
    r = int(row)
    c = int(column)
    y = row - r
    x = column - c
    return (
        _between(picture, r, c, y, x, 0),
        _between(picture, r, c, y, x, 1),
        _between(picture, r, c, y, x, 2),
    )


@jit
def _between(picture: Picture, r: int, c: int, y: float, x: float, channel: int) -> float:
    """Return a channel at shares y and x of the way to the next row and column."""
    above = (1 - x) * picture[r, c, channel] + x * picture[r, c + 1, channel]
    below = (1 - x) * picture[r + 1, c, channel] + x * picture[r + 1, c + 1, channel]
    return (1 - y) * above + y * below
