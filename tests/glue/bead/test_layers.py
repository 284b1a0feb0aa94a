"""Layers of a bead: passes over the same place at other heights do not merge, and no glue is lost."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gantrysim as gs
from gantrysim import Dispenser, InputError, Machine
from gantrysim.engine.simulate import perfect_follower
from gantrysim.glue.bead import Bead, BeadSettings
from gantrysim.glue.bead.layers import _below, _Piece, merging_height
from gantrysim.paths.chain import Chain
from gantrysim.paths.pieces import Coil, Line
from gantrysim.record.setpoints import Setpoints

from support.beads import AREA, GAP, PERIOD, PLATE, SPEED
from support.soaked import examples

VOLUME = 1e-6  # relative, on the map against what flowed
FILM = 0.021  # of the gap, within which a film is even
XYZ = Machine("xyz")
AXES = ("x", "y", "z")
RADIUS = 20.0  # of the rings [mm]
LIFT = 1.0  # between rings [mm]
RING = 2 * math.pi * RADIUS


def run_along(pieces, wet=None):
    """The record of a perfect follower along pieces in space; `wet` says of each whether glue flows."""
    path = Chain(pieces)
    setpoints = Setpoints.along(path, SPEED, PERIOD, axes=AXES)
    if wet is not None:
        lengths = np.cumsum([Chain([piece]).length for piece in pieces])
        piece = np.minimum(np.searchsorted(lengths, SPEED * setpoints.time, side="right"), len(pieces) - 1)
        setpoints = replace(setpoints, dispense=np.array(wet)[piece])
    run = perfect_follower(XYZ, setpoints, dispenser=Dispenser(flow=AREA * SPEED))
    return replace(run, face=PLATE, gap=GAP)


def rings(heights, radius=RADIUS):
    """Rings about the origin, each from and to y = 0, with dry motions between their ends."""
    pieces, wet = [], []
    for k, z in enumerate(heights):
        if k:
            pieces.append(Line((radius, 0.0, heights[k - 1]), (radius, 0.0, z + LIFT)))
            pieces.append(Line((radius, 0.0, z + LIFT), (radius, 0.0, z)))
            wet += [False, False]
        pieces.append(Coil((0.0, 0.0, z), (radius, radius), 0.0, 2 * math.pi))
        wet.append(True)
    return run_along(pieces, wet)


def helix(pitch, turns=3.0, radius=RADIUS, grows=0.0):
    """A coil that climbs by a pitch, or falls down to 0 by a negative one, and grows by another a turn."""
    far = radius + grows * turns
    return run_along(
        [Coil((0.0, 0.0, max(-pitch * turns, 0.0)), (radius, far), 0.0, 2 * math.pi * turns, rise=pitch * turns)]
    )


def height_opposite(bead):
    """Height of the glue over its surface, opposite the ends of the rings."""
    return float(bead.map.at([[-RADIUS, 0.0]])[0])


@pytest.mark.validates(
    "glue of rings stacked above each other",
    "volume of each ring",
    "0.5 %",
)
@pytest.mark.parametrize("step", [GAP, 2.0, 21.5])
def test_stacked_rings_are_layers_each_as_high_as_one_ring(step):
    count = 4
    bead = Bead(rings([k * step for k in range(count)]))
    single = Bead(rings([0.0]))
    assert bead.map.layers.shape[0] == count
    volumes = bead.map.layers.sum(axis=(1, 2)) * bead.map.cell**2
    assert volumes == pytest.approx(np.full(count, RING * AREA), rel=5e-3)
    assert bead.map.volume == pytest.approx(bead.total_volume, rel=VOLUME)
    assert height_opposite(bead) == pytest.approx(height_opposite(single), rel=5e-3)
    away = np.hypot(bead.map.x[None, :] - RADIUS, bead.map.y[:, None]) > 5.0  # from the rings' ends
    assert bead.map.height[away].max() == pytest.approx(GAP, rel=FILM)
    assert bead.map.ridge == 0


def test_rings_on_one_surface_merge():
    """Twice the glue under the same nozzle is twice as wide, not twice as high."""
    bead = Bead(rings([0.0, 0.0]))
    assert len(bead.map.layers) == 1
    assert bead.map.volume == pytest.approx(bead.total_volume, rel=VOLUME)
    free = Bead(bead.run, BeadSettings(squashed=False))
    assert height_opposite(free) > 1.9 * height_opposite(Bead(rings([0.0]), BeadSettings(squashed=False)))


def test_passes_merge_up_to_three_quarters_of_the_bead_height():
    limit = merging_height(Bead(rings([0.0])))
    assert limit == pytest.approx(0.75 * GAP)
    for step, count in ((0.95 * limit, 1), (1.05 * limit, 2)):
        assert len(Bead(rings([0.0, step])).map.layers) == count
    low = Bead(rings([0.0]), BeadSettings(squashed=False))
    assert merging_height(low) == pytest.approx(0.75 * min(GAP, float(low.nominal_section.height[0])))


@pytest.mark.parametrize("pitch", [1.0, 6.0, 25.0])
def test_a_helix_has_a_layer_for_every_turn(pitch):
    bead = Bead(helix(pitch))
    assert len(bead.map.layers) in (3, 4)  # the last end may touch the turn below
    assert bead.map.volume == pytest.approx(bead.total_volume, rel=VOLUME)
    away = np.abs(np.arctan2(bead.map.y[:, None], bead.map.x[None, :])) > 0.6
    climb = math.hypot(1.0, pitch / RING)
    assert bead.map.height[away].max() == pytest.approx(GAP * climb, rel=3 * FILM)


@pytest.mark.parametrize("upwards", [1, -1])
def test_coverage_of_turns_that_lie_apart_in_height_is_not_given(upwards):
    """On a cone, laid up or down, whose turns are a width apart in plan view, and on a flat spiral of the same plan."""
    flat, cone = (Bead(helix(upwards * pitch, grows=5.0)) for pitch in (0.0, 5.0))
    assert flat.values.coverage == pytest.approx(float(flat.nominal_section.width[0]) / 5.0, abs=0.01)
    assert flat.values.apart_share == 0
    assert cone.values.coverage is None
    assert cone.values.apart_share == 1
    assert cone.values.height_apart == pytest.approx(5.0, rel=0.02)
    assert "mm apart in height: the height map, in plan view, has no coverage" in cone.values.apart_note
    gentle = Bead(helix(upwards * 0.2, grows=5.0))
    assert gentle.values.coverage == pytest.approx(flat.values.coverage, abs=0.01)


def test_a_climb_is_one_layer_however_high():
    """A pass does not conflict with itself, nor with one beside it that climbs the same slope the other way."""
    bead = Bead(run_along([Line((-30.0, 0.0, 0.0), (30.0, 0.0, 50.0))]))
    assert len(bead.map.layers) == 1
    for lift, count in ((0.0, 1), (5.0, 2)):
        pieces = [
            Line((-20.0, 0.0, 0.0), (16.0, 0.0, 27.0)),
            Line((16.0, 0.0, 27.0), (20.0, 0.0, 30.0)),
            Line((20.0, 0.0, 30.0), (20.0, 2.0, 30.0 + lift)),
            Line((20.0, 2.0, 30.0 + lift), (16.0, 2.0, 27.0 + lift)),
            Line((16.0, 2.0, 27.0 + lift), (-20.0, 2.0, lift)),
        ]
        assert len(Bead(run_along(pieces, [True, False, False, False, True])).map.layers) == count


def test_passes_that_cross_on_a_slope_are_one_layer_and_at_two_heights_two():
    first = Line((-20.0, -20.0, 0.0), (20.0, 20.0, 40.0))
    for lift, count in ((0.0, 1), (8.0, 2)):
        pieces = [
            first,
            Line((20.0, 20.0, 40.0), (-20.0, 20.0, lift)),
            Line((-20.0, 20.0, lift), (20.0, -20.0, 40.0 + lift)),
        ]
        assert len(Bead(run_along(pieces, [True, False, True])).map.layers) == count


def test_passes_do_not_creep_upwards_in_one_layer():
    """Each ring lies within the limit above the one before, the third not above the first."""
    step = 0.6 * merging_height(Bead(rings([0.0])))
    assert len(Bead(rings([0.0, step])).map.layers) == 1
    assert len(Bead(rings([0.0, step, 2 * step])).map.layers) == 2


def test_a_small_circle_that_climbs_is_no_single_layer():
    """Narrower than its own bead, so that the pass never leaves the cells in the middle."""
    bead = Bead(helix(2.0, turns=5.0, radius=1.0))
    assert len(bead.map.layers) > 2
    assert bead.map.volume == pytest.approx(bead.total_volume, rel=VOLUME)


@examples(25)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 1.0), st.booleans())
def test_no_glue_is_lost_among_layers(seed, steepness, squashed):
    random = np.random.default_rng(seed)
    corners = np.cumsum(random.uniform(-15.0, 15.0, (8, 3)) * [1.0, 1.0, steepness], axis=0)
    corners[:, 2] = np.abs(corners[:, 2])
    pieces = [Line(tuple(a), tuple(b)) for a, b in pairwise(corners)]
    bead = Bead(run_along(pieces, random.random(7) < 0.7), BeadSettings(squashed=squashed))
    assert bead.map.volume == pytest.approx(bead.total_volume, rel=VOLUME, abs=1e-9)
    assert bead.map.layers.min() > -1e-12
    assert bead.map.covered.min() >= 0
    assert bead.map.covered.max() <= 1


def test_too_many_layers_for_the_cells_are_refused():
    run = helix(6.0, turns=3.0)
    bead = Bead(run, BeadSettings(cell=0.012))
    with pytest.raises(InputError, match=r"cells in \d layers, at most 2e\+07"):
        _ = bead.map


def test_the_cone_of_the_built_in_job_keeps_its_beads_apart():
    """Its last line crosses two turns from above, 21.5 mm and more."""
    bead = gs.Bead(gs.Job.load("fanuc-conical").run())
    assert len(bead.map.layers) == 2
    assert bead.map.volume == pytest.approx(bead.total_volume, rel=VOLUME)
    assert bead.values.coverage is None
    line = bead.map.layer == 1
    assert np.abs(bead.point[:-1][line, 2] - 62.5).max() < 0.1


@pytest.mark.parametrize(
    ("cell", "over", "likely", "doubt"),
    [
        ((2, 1), True, 2.0, 0.5),  # half way along, one cell beside it
        ((-1, 0), True, 1.0, 0.5),  # before its begin
        ((6, 0), True, 3.0, 1.0),  # beyond its end, as far as it reaches
        ((6, 1), False, 3.0, 0.5 * math.sqrt(5)),
        ((1, -2), True, 1.5, 1.0),
        ((1, 3), False, 1.5, 1.5),
    ],
)
def test_the_surface_below_a_piece_is_known_by_the_distance_from_it(cell, over, likely, doubt):
    """Of a piece of four cells that rises from 1 to 3, two cells wide to either side, and of slope 1/2."""
    piece = _Piece(0.0, 0.0, 4.0, 0.0, 2.0, 1.0, 2.0, 0.5, (0, 9), (0, 9))
    assert _below.py_func(piece, *cell) == (over, pytest.approx(likely - doubt), likely, pytest.approx(likely + doubt))


def test_a_piece_without_length_lies_half_way_up():
    piece = _Piece(0.0, 0.0, 0.0, 0.0, 2.0, 1.0, 2.0, 0.5, (0, 9), (0, 9))
    assert _below.py_func(piece, 0, 1) == (True, 1.5, 2.0, 2.5)
