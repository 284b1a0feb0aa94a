"""A bead shorter than it is wide is one round drop, whose width follows from its volume."""

import dataclasses

import numpy as np
import pytest

from gantrysim import Dispenser, perfect_follower
from gantrysim.glue.bead import Bead, BeadSettings
from gantrysim.paths.arcs import ArcChain
from gantrysim.record.setpoints import Setpoints

ANGLE = 60.0
SESSILE = BeadSettings(gap=50.0, contact_angle=ANGLE, squashed=False)


def line(xy, length, settle=0.0, settings=SESSILE, flow=10.0):
    setpoints = Setpoints.along(ArcChain((0, 0), 0.3, [0.0], [length]), 10.0, 1e-3).hold(settle)
    return Bead(perfect_follower(xy, setpoints, dispenser=Dispenser(flow=flow)), settings)


def cap_width(volume):
    """Width of a spherical cap: V = pi/3 R^3 (2 - 3 cos + cos^3), w = 2 R sin."""
    cosine = np.cos(np.radians(ANGLE))
    radius = (3 * volume / (np.pi * (2 - 3 * cosine + cosine**3))) ** (1 / 3)
    return 2 * radius * np.sin(np.radians(ANGLE))


@pytest.mark.parametrize("length", [1e-3, 0.01, 0.1, 0.5])
@pytest.mark.parametrize("settle", [0.0, 0.25])
def test_a_short_trace_lays_a_drop(xy, length, settle):
    bead = line(xy, length, settle)
    values = bead.values
    assert values.width.max == pytest.approx(cap_width(values.volume), rel=1e-9)
    assert values.width.min == pytest.approx(values.width.max, rel=1e-9)
    assert values.section.max < 10 * values.volume ** (2 / 3)
    assert bead.map.volume == pytest.approx(values.volume, rel=1e-9)


def test_glue_laid_at_rest_behind_a_micrometre_is_a_dot(xy):
    setpoints = Setpoints.along(ArcChain((0, 0), 0.3, [0.0], [1e-3]), 10.0, 1e-3)
    at_rest = dataclasses.replace(
        setpoints,
        position=np.concatenate([setpoints.position, np.repeat(setpoints.position[-1:], 2000, axis=0)]),
        dispense=np.ones(len(setpoints.position) + 2000, bool),
        progress=None,
    )
    bead = Bead(perfect_follower(xy, at_rest, dispenser=Dispenser(flow=10.0)), SESSILE)
    (dot,) = bead.dots
    assert dot.volume == pytest.approx(20.01, rel=1e-3)
    assert dot.diameter == pytest.approx(cap_width(dot.volume), rel=1e-9)


def test_the_width_grows_with_the_trace_up_to_that_of_a_long_bead(xy):
    long = line(xy, 40.0).values.width.mean
    lengths = np.concatenate([np.geomspace(0.01, 4, 25), [8.0, 20.0]])
    widths = np.array([line(xy, length).width.max() for length in lengths])
    assert (np.diff(widths) > -0.01 * long).all()
    assert widths[0] < 0.2 * long
    np.testing.assert_allclose(widths[lengths > 3], long, rtol=3e-3)
    # the last drop and the first bead with two ends are nearly as wide: nothing jumps
    assert np.diff(widths).max() < 0.2 * long


def test_pressed_by_the_needle_it_is_no_wider_than_a_long_bead(xy):
    settings = BeadSettings(gap=0.3)
    assert line(xy, 1e-3, settings=settings).values.width.max < 1.0
    assert line(xy, 0.3, settings=settings).values.width.max < line(xy, 20.0, settings=settings).values.width.max
