"""Coverage between parallel straight beads, against its closed form: width over pitch, and all of it from there on."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import Dispenser, Machine
from gantrysim.engine.simulate import perfect_follower
from gantrysim.glue.bead import Bead, BeadSettings, Section
from gantrysim.paths.chain import Chain
from gantrysim.paths.pieces import Line
from gantrysim.record.setpoints import Setpoints

from support.beads import AREA, GAP, PERIOD, PLATE, SPEED, laid, spiral
from support.soaked import examples, suite_runs

COVERED = 2e-3  # of the area, of straight beads in any direction over the grid, of cells up to a third of the width
TURNS = 3e-3  # likewise of a spiral, whose last turn ends round
WIDTH = float(Section(np.array([AREA]), np.array([GAP]), 60.0, PLATE).width[0])
XY = Machine("xy")
LENGTH = 40.0  # [mm]
LINES = 4


def parallel(pitch, angle, offset, **bead):
    """Straight beads side by side, laid to and fro with dry motions between them; directions along and across."""
    along = np.array([math.cos(angle), math.sin(angle)])
    across = np.array([-along[1], along[0]])
    corners = []
    for k in range(LINES):
        ends = [k * pitch * across, k * pitch * across + LENGTH * along]
        corners += ends[:: -1 if k % 2 else 1]
    points = [(*(offset + corner), 0.0) for corner in corners]
    path = Chain([Line(a, b) for a, b in pairwise(points)])
    setpoints = Setpoints.along(path, SPEED, PERIOD)
    lengths = np.concatenate([[0.0], np.cumsum([math.dist(a, b) for a, b in pairwise(points)])])
    piece = np.searchsorted(lengths, SPEED * setpoints.time, side="right") - 1
    run = perfect_follower(XY, replace(setpoints, dispense=piece % 2 == 0), dispenser=Dispenser(flow=AREA * SPEED))
    return Bead(replace(run, face=PLATE), BeadSettings(**bead)), along, across


def share_between(bead, offset, along, across, pitch):
    """Wet share of the area from the middle of the first bead to that of the last, away from their ends."""
    u = np.linspace(0.3, 0.7, 301) * LENGTH
    v = (np.arange(1500) + 0.5) / 1500 * (LINES - 1) * pitch
    points = offset + u[:, None, None] * along + v[:, None] * across
    return float(bead.map.wet_share(points, 0).mean())


@pytest.mark.validates(
    "coverage of parallel straight beads",
    "width / pitch, at most 1",
    "0.2 % of the area",
)
@pytest.mark.parametrize("cell", suite_runs([0.1, 0.25, 0.5, 1.0, 1.5], 1, 4))
@pytest.mark.parametrize("ratio", [0.5, 0.7, 0.85, 0.9, 0.93, 0.96, 0.99, 1.0, 1.04, 1.1])
def test_parallel_beads_cover_the_share_of_their_width_in_the_pitch(ratio, cell):
    pitch = WIDTH / ratio
    bead, along, across = parallel(pitch, 0.0, np.zeros(2), cell=cell)
    share = share_between(bead, np.zeros(2), along, across, pitch)
    assert share == pytest.approx(min(ratio, 1.0), abs=COVERED)


@examples(25)
@given(
    st.floats(0.5, 1.1),
    st.sampled_from([0.1, 0.25, 0.5, 1.0]),
    st.floats(0.0, math.pi),
    st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0)),
    st.booleans(),
)
def test_coverage_does_not_depend_on_the_direction_and_place_of_the_grid(ratio, cell, angle, offset, squashed):
    width = WIDTH if squashed else float(Section(np.array([AREA]), np.array([np.inf]), 60.0, PLATE).width[0])
    pitch = width / ratio
    bead, along, across = parallel(pitch, angle, np.array(offset), cell=min(cell, width / 3.01), squashed=squashed)
    share = share_between(bead, np.array(offset), along, across, pitch)
    assert share == pytest.approx(min(ratio, 1.0), abs=COVERED)


@pytest.mark.parametrize("cell", [0.1, 0.25, 0.5, 1.0])
def test_turns_of_a_spiral_cover_the_share_of_their_width_in_the_pitch(cell):
    """Also where the gap is narrower than a cell."""
    for ratio in (0.85, 0.93, 0.97, 1.0):
        bead = laid(XY, spiral(WIDTH / ratio, radius=35.0, turns=1.5), cell=cell)
        assert bead.values.coverage == pytest.approx(ratio, abs=TURNS)
        assert bead.values.apart_share == 0


def test_a_gap_into_which_glue_is_pushed_is_covered():
    """Turns 1.05 widths apart leave a gap; with twice the glue under a needle that presses all of it, none."""
    pitch = 1.05 * WIDTH
    bead = laid(XY, spiral(pitch, radius=30.0, turns=2.5))
    assert bead.values.coverage == pytest.approx(1 / 1.05, abs=TURNS)
    run = replace(bead.run, flow=2.5 * bead.run.flow)
    assert Bead(run).values.coverage == pytest.approx(1.0, abs=TURNS)
