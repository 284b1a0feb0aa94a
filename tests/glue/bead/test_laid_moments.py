"""Glue laid between two stations of a bead, against sums by hand."""

import numpy as np
import pytest

from gantrysim.glue.bead.laying import Layer, Sampling, Stations, lay

CELL = 0.5  # [mm]
STEPS = 4
VOLUME = 3.0  # [mm³]
MIDDLE = 40  # row and column of the trace [cells]


def laid(half, heading=0.0, curvature=0.0, samples=4.0):
    """A layer with what lies between two half circles 5 mm apart."""
    half = np.array(half, float)
    nothing = np.zeros(2)
    along = 5.0 / CELL * np.array([0.0, 1.0])
    stations = Stations(
        x=MIDDLE + along * np.cos(heading),
        y=MIDDLE + along * np.sin(heading),
        heading=nothing + heading,
        curvature=nothing + curvature,
        area=np.pi * half**2 / 2,
        half=half,
        flat=nothing,
        groove=nothing,
        radius=half,
        gap=np.array([1.0, 2.0]),
        top=np.array([3.0, 2.5]),
    )
    layer = Layer(*(np.zeros((100, 100)) for _ in range(3)))
    lay(layer, stations, np.array([VOLUME]), 0.0, Sampling(CELL, STEPS, samples))
    return layer


def shares(half):
    """Shares of the volume in each step, and where the steps lie from the first station to the second."""
    f = (np.arange(STEPS) + 0.5) / STEPS
    area = (1 - f) * half[0] ** 2 + f * half[1] ** 2
    return area / area.sum(), f


@pytest.mark.parametrize("half", [(6.0, 1.0), (1.0, 6.0), (2.0, 2.0)])
def test_a_piece_lies_about_its_trace_by_its_sections(half):
    """The wider end may be the first or the last station of all."""
    layer = laid(half)
    share, f = shares(half)
    assert layer.glue.sum() == pytest.approx(VOLUME)
    assert layer.glue.min() >= 0
    rows, columns = np.indices(layer.glue.shape)
    assert (layer.glue * columns).sum() / VOLUME == pytest.approx(MIDDLE + 10 * (share * f).sum())
    assert layer.glue[MIDDLE - 20 : MIDDLE] == pytest.approx(layer.glue[MIDDLE + 20 : MIDDLE : -1])
    # the variance of a half circle's height across it is a quarter of its radius squared
    widths = (1 - f) * half[0] + f * half[1]
    variance = (share * widths**2 / 4).sum() / CELL**2
    assert (layer.glue * (rows - MIDDLE) ** 2).sum() / VOLUME == pytest.approx(variance, rel=0.05, abs=0.2)
    assert np.abs(rows - MIDDLE)[layer.glue > 0].max() <= np.ceil(widths.max() / CELL)
    assert layer.moment.sum() == pytest.approx(VOLUME * (share * (1 + f)).sum())
    assert set(np.unique(layer.crest)) == {0.0, 3.0}
    assert np.all((layer.crest > 0) == (layer.glue > 0))


def test_a_turned_piece_is_the_piece_turned():
    flat = laid((2.0, 2.0)).glue
    upright = laid((2.0, 2.0), heading=np.pi / 2).glue
    assert upright == pytest.approx(flat.T, abs=1e-9)


def test_in_a_bend_less_glue_lies_on_the_inner_side():
    """To the left of a left turn of radius R: the mean of u (1 - u / R) over a half circle is -w² / 4 R."""
    w = 3.0
    radius = 10.0
    layer = laid((w, w), curvature=1 / radius, samples=16.0)
    rows, _ = np.indices(layer.glue.shape)
    offset = (layer.glue * (rows - MIDDLE)).sum() / VOLUME * CELL
    assert offset == pytest.approx(-(w**2) / 4 / radius, rel=0.02)
