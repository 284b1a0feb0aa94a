"""The body under a bead that climbs: against closed forms, and clear of bead and needle."""

import dataclasses
import math
from itertools import pairwise

import numpy as np
import pytest

from gantrysim import Dispenser, Job, Machine, perfect_follower
from gantrysim.job.loading import builtin_jobs
from gantrysim.metrics.analysis import Analysis
from gantrysim.paths.chain import Chain
from gantrysim.paths.pieces import Coil, Line
from gantrysim.record.setpoints import Setpoints
from gantrysim.render.scene import Scene
from gantrysim.render.workpiece import workpiece

from support.soaked import of_jobs, suite_runs

FLOW, SPEED = 150.0, 100.0  # [mm³/s], [mm/s]
ABOVE = 0.02  # that the body may stand above the bead's base [mm]
LEVEL = 0.06  # that a ledge may lie below the bead's base beside the path [mm]
VOLUME = 0.02  # relative
CLIMBING = ("an225-3d", "fanuc-conical", "softmc-helical")
NEEDLE = 0.41  # radius [mm]
# Of a bead of 1.5 mm² at 60 deg with a groove of the needle's width down to 0.5 mm: the halves hold 0.2047 w_s².
WIDTH = 2 * NEEDLE + math.sqrt((1.5 - 2 * NEEDLE * 0.5) / 0.2047)  # [mm]


def carried(machine, path, dispense=None, flow=FLOW):
    """A run that follows a path perfectly."""
    setpoints = Setpoints.along(path, SPEED, 1e-3, axes=("x", "y", "z"))
    if dispense is not None:
        setpoints = dataclasses.replace(setpoints, dispense=dispense(setpoints))
    return perfect_follower(machine, setpoints, dispenser=Dispenser(flow=flow))


def helix(radii, turns, rise, centre=(0.0, 0.0)):
    """Turns about a centre between two radii, climbing from 0 by so much."""
    return Chain([Coil((*centre, 0.0), radii, 0.0, 2 * np.pi * turns, rise)])


def corners(piece, run):
    """Corners of the triangles, in mm above the work, (f, 3, 3)."""
    found = 1e3 * piece.vertices[piece.faces]
    return found + np.array([0.0, 0.0, run.gap])


def volume(piece, run):
    """By the divergence theorem: the open base lies at height 0 and adds nothing."""
    a, b, c = np.moveaxis(corners(piece, run), 1, 0)
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


def top(piece, run, points):
    """Height of the body above the work at points in plan view, 0 where there is none, (n,) [mm]."""
    a, b, c = np.moveaxis(corners(piece, run), 1, 0)
    found = np.zeros(len(points))
    e, f = (b - a)[:, :2], (c - a)[:, :2]
    double = e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0]
    a, e, f, b, c = (part[double > 1e-9] for part in (a, e, f, b, c))
    double = double[double > 1e-9]
    for k, point in enumerate(points):
        d = point - a[:, :2]
        u = (d[:, 0] * f[:, 1] - d[:, 1] * f[:, 0]) / double
        v = (e[:, 0] * d[:, 1] - e[:, 1] * d[:, 0]) / double
        inside = (u > -1e-9) & (v > -1e-9) & (u + v < 1 + 1e-9)
        heights = a[inside, 2] + u[inside] * (b - a)[inside, 2] + v[inside] * (c - a)[inside, 2]
        found[k] = heights.max(initial=0.0)
    return found


def samples(run, every):
    """Points of the requested path where the program dispenses, and their left normals in plan view."""
    foot = Analysis(run).commanded.s[::every]
    local = run.requested.local(foot)
    left = local.normal[:, :2] / np.linalg.norm(local.normal[:, :2], axis=1)[:, None]
    return local.position, left


@pytest.fixture(scope="module")
def runs():
    return {name: Job.load(name).follow() for name in builtin_jobs()}


@pytest.mark.parametrize("name", of_jobs("an225", "an225-3d", "delta-arc"))
def test_a_body_stands_where_a_job_climbs_and_nowhere_else(runs, name):
    piece = workpiece(runs[name], level=426.0 if name == "delta-arc" else 0.0)
    assert (piece is not None) == (name in CLIMBING)


@pytest.mark.parametrize("name", suite_runs(CLIMBING, 0))
def test_the_body_ends_at_the_bead_and_clears_the_needle(runs, name):
    run = runs[name]
    piece = workpiece(run)
    points, left = samples(run, 23)
    # no point of the body, right down the needle and the bead's width beside it, stands above the bead's base
    for aside in (0.0, -NEEDLE, NEEDLE, -1.2, 1.2):
        base = points[:, 2]
        assert (top(piece, run, points[:, :2] + aside * left) - base).max() < ABOVE
    # and it carries the bead: everywhere but where the path passes over itself
    short = points[:, 2] - top(piece, run, points[:, :2])
    spanned = short > LEVEL
    assert spanned.mean() < 0.02
    assert spanned.any() == (name == "fanuc-conical")


@pytest.mark.parametrize("name", CLIMBING)
def test_the_ledge_is_level_across_the_bead(runs, name):
    run = runs[name]
    points, left = samples(run, 211)
    piece = workpiece(run)
    middle = top(piece, run, points[:, :2])
    on = points[:, 2] - middle < LEVEL
    for aside in (-1.2, 1.2):
        assert np.median(np.abs(top(piece, run, points[on, :2] + aside * left[on]) - middle[on])) < LEVEL


def test_the_body_of_a_cone_has_its_volume_and_heights(xyz):
    # a dense spiral up a cone: from radius 60 at z = 0 to 4 at z = 28, so h(r) = (60 - r) / 2
    run = carried(xyz, helix((60.0, 4.0), 14, 28.0), flow=20.0)
    piece = workpiece(run)
    cone = np.pi / 3 * 60**2 * 30
    tip = np.pi / 3 * 4**2 * 2  # missing above z = 28
    assert volume(piece, run) == pytest.approx(cone - tip, rel=VOLUME)
    angle = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    for radius in (10.0, 30.0, 50.0):
        heights = top(piece, run, radius * np.stack([np.cos(angle), np.sin(angle)], axis=1))
        assert heights.mean() == pytest.approx(30 - radius / 2, abs=0.2)
        assert np.ptp(heights) < 2.1  # one turn's rise
    # it stands on the work, and ends at the last turn
    assert corners(piece, run)[..., 2].min() == pytest.approx(0, abs=1e-6)
    assert corners(piece, run)[..., 2].max() == pytest.approx(28, abs=0.01)


def test_no_slab_is_invented_below_a_level_path_above_the_work(xyz):
    assert workpiece(carried(xyz, Chain([Line((-30.0, 0.0, 12.0), (30.0, 0.0, 12.0))]))) is None
    # nor where it is reached by a dry climb
    path = Chain([Line((-30.0, 0.0, 0.0), (-30.0, 0.0, 12.0)), Line((-30.0, 0.0, 12.0), (30.0, 0.0, 12.0))])
    assert workpiece(carried(xyz, path, lambda setpoints: setpoints.position[:, 2] > 12 - 1e-9)) is None


def test_only_what_is_dispensed_counts(xyz):
    path = Chain([Line((-30.0, 0.0, 0.0), (0.0, 0.0, 0.0)), Line((0.0, 0.0, 0.0), (40.0, 0.0, 30.0))])
    dry_above = carried(xyz, path, lambda setpoints: setpoints.position[:, 2] < 1e-9)
    assert workpiece(dry_above) is None
    assert workpiece(carried(xyz, path)) is not None
    assert workpiece(carried(xyz, path, lambda setpoints: np.zeros(len(setpoints.position), bool))) is None


@pytest.mark.parametrize("sense", [1, -1])
def test_turns_above_one_another_lean_on_a_wall_beside_them(xyz, sense):
    run = carried(xyz, helix((40.0, 40.0), 4 * sense, 40.0))
    piece = workpiece(run)
    found = corners(piece, run).reshape(-1, 3)
    radius = np.hypot(found[:, 0], found[:, 1])
    wall = found[:, 2] > 11  # above the first turn
    assert found[wall, 2].min() > 29.9  # the last turn's alone
    assert wall.sum() > 100
    assert found[:, 2].max() == pytest.approx(40.0)
    # inside the turns, clear of half the bead and of the needle, and thin
    assert radius[wall].max() < 40 - WIDTH / 2 - NEEDLE
    assert radius[wall].min() > 40 - WIDTH / 2 - NEEDLE - 2.5
    # as high as the last turn, which climbs from 30 to 40 mm, all the way round
    angle = np.linspace(0.1, 2 * np.pi - 0.1, 25)
    middle = 0.5 * (radius[wall].max() + radius[wall].min())
    heights = top(piece, run, middle * np.stack([np.cos(angle), sense * np.sin(angle)], axis=1))
    np.testing.assert_allclose(heights, 30 + 10 * angle / (2 * np.pi), atol=0.1)
    # its faces look away from it
    each = corners(piece, run)
    each = each[(each[..., 2] > 0).any(axis=1) & (each[..., 2].max(axis=1) > 11)]
    away = np.hypot(*each.mean(axis=1)[:, :2].T) - middle
    facing = np.cross(each[:, 1] - each[:, 0], each[:, 2] - each[:, 0])
    outward = np.einsum("ij,ij->i", facing[:, :2], each.mean(axis=1)[:, :2])
    upright = np.abs(facing[:, 2]) < 0.1 * np.linalg.norm(facing, axis=1)
    round_about = upright & (np.abs(away) > 0.5)
    assert round_about.sum() > 200
    assert (outward * away)[round_about].min() > 0
    assert facing[~upright, 2].min() > 0


def test_a_path_that_passes_over_itself_leaves_the_lower_turn_free(xyz):
    low = Line((-40.0, 0.0, 5.0), (40.0, 0.0, 5.0))
    over = [Line((40.0, 0.0, 5.0), (40.0, 40.0, 25.0)), Line((40.0, 40.0, 25.0), (-40.0, -40.0, 25.0))]
    run = carried(xyz, Chain([low, *over]))
    piece = workpiece(run)
    beside = np.array([[0.0, 0.0], [0.0, NEEDLE], [0.0, -NEEDLE], [0.3, 0.0]])
    assert (top(piece, run, beside) < 5 + ABOVE).all()
    assert top(piece, run, np.array([[20.0, 20.0], [-20.0, -20.0]])) == pytest.approx([25.0, 25.0], abs=ABOVE)


def test_the_faces_look_outward(runs):
    for name in CLIMBING:
        a, b, c = np.moveaxis(corners(workpiece(runs[name]), runs[name]), 1, 0)
        assert np.cross(b - a, c - a)[:, 2].min() > -1e-9  # no face of what carries these looks down
        assert volume(workpiece(runs[name]), runs[name]) > 1e4
        assert np.stack([a, b, c])[..., 2].max(axis=0).min() > 0  # and nothing lies flush with the work


def test_the_scene_shows_the_body_and_keeps_the_machine(runs):
    machine = Machine("xyz")
    scene = Scene(machine, runs["an225-3d"])
    geom = scene.model.geom("gantrysim work piece")
    assert scene.model.geom_bodyid[geom.id] == machine.work
    # the compiler moves a mesh to its own frame; it is drawn where it was built
    scene.pose(len(runs["an225-3d"].time) - 1)
    mesh = scene.model.mesh("gantrysim work piece")
    vertices = scene.model.mesh_vert[mesh.vertadr[0] :][: mesh.vertnum[0]]
    drawn = scene.data.geom_xpos[geom.id] + vertices @ scene.data.geom_xmat[geom.id].reshape(3, 3).T
    built = workpiece(runs["an225-3d"]).vertices
    np.testing.assert_allclose(drawn - scene.data.xpos[machine.work], built, atol=1e-6)
    flat = Scene(Machine("xy"), runs["an225"])
    assert "gantrysim work piece" not in [flat.model.geom(g).name for g in range(flat.model.ngeom)]


@pytest.mark.soak
def test_no_path_is_cut_however_it_crosses_itself(xyz):
    random = np.random.default_rng(1)
    for _ in range(12):
        count = random.integers(3, 9)
        places = np.column_stack([random.uniform(-100, 100, (count, 2)), random.uniform(0, 70, count)])
        places[0, 2] = 0
        lines = [Line(tuple(a), tuple(b)) for a, b in pairwise(places)]
        run = carried(xyz, Chain(lines))
        piece = workpiece(run)
        points, left = samples(run, 13)
        middle = top(piece, run, points[:, :2])
        assert (middle - points[:, 2]).max() < ABOVE
        # beside it, too, but for what a sharp corner of a steep path asks
        beside = np.concatenate([top(piece, run, points[:, :2] + aside * left) for aside in (-1.0, 1.0)])
        assert (beside - np.tile(points[:, 2], 2) > ABOVE).mean() < 0.01
        # and most of it is carried
        assert (points[:, 2] - middle > LEVEL).mean() < 0.2
