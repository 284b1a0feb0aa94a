"""The bead's mesh against the bead's model: closed surface, volume, sections, ends."""

import dataclasses

import numpy as np
import pytest

from gantrysim import Dispenser, Servo, simulate
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.glue.bead import BeadSettings
from gantrysim.glue.bead.sweep import Sweep, TooFewRingsError

FLOW = 150.0  # [mm³/s]
SPEED = 100.0  # [mm/s]
SIDES = 13  # vertices of a ring
FACETS = 0.02  # of the volume, that flat facets cut off round sides
GAP = 0.5  # [mm]


@pytest.fixture(scope="module")
def run(xy):
    setpoints = MoveSpiral(100, 2, 15, SPEED).setpoints(1e-3).hold(0.05)
    return simulate(xy, Servo.derive(xy.axes), setpoints, dispenser=Dispenser(flow=FLOW))


def on_and_off(run, stretches):
    """The run with glue flowing between shares of its ticks alone."""
    share = np.linspace(0, 1, len(run.time))
    flowing = np.any([(low <= share) & (share < high) for low, high in stretches], axis=0)
    return dataclasses.replace(run, flow=FLOW * flowing, flow_demand=FLOW * flowing)


def volume(sweep, mesh):
    """What the mesh encloses above the surface, by the divergence theorem: its flat base closes it [mm³]."""
    corners = 1e3 * mesh.vertices[sweep.faces()].astype(float)
    corners[..., 2] += GAP
    return np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6


def rings_of(mesh):
    return 1e3 * mesh.vertices.reshape(-1, SIDES, 3).astype(float)


def drawn(mesh):
    """The rings that are sections, not the round ends nor those that wait."""
    rings = rings_of(mesh)
    base = rings[:, -1] - rings[:, 0]
    along = np.gradient(rings.mean(axis=1), axis=0)
    straight = np.linalg.norm(base, axis=1) > 0.2
    straight[:10] = straight[np.flatnonzero(np.linalg.norm(along, axis=1) > 0)[-1] - 18 :] = False
    return rings[straight]


@pytest.mark.validates(
    "bead mesh, every stretch, at any time",
    "volume of glue",
    "2 % or 0.8 mm³",
)
@pytest.mark.parametrize("tick_share", [0.0, 0.003, 0.01, 0.3, 0.7, 1.0])
@pytest.mark.parametrize("stretches", [[(0, 1)], [(0.1, 0.2), (0.205, 0.208), (0.4, 0.4005), (0.6, 0.9)]])
def test_the_mesh_holds_the_glue_that_is_laid(run, stretches, tick_share):
    run = on_and_off(run, stretches)
    tick = int(tick_share * (len(run.time) - 1))
    sweep = Sweep(run)
    mesh = sweep.mesh(tick)
    laid = float((run.flow[:-1] * np.diff(run.time))[:tick].sum())
    assert volume(sweep, mesh) == pytest.approx(laid * (1 - 0.5 * FACETS), rel=0.5 * FACETS, abs=0.8)
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-5)


def test_the_mesh_is_closed(run):
    """Every edge of a facet that has an area, but those on the surface, is shared by two facets."""
    run = on_and_off(run, [(0.1, 0.2), (0.6, 0.9)])
    sweep = Sweep(run)
    for tick in (len(run.time) // 8, len(run.time) // 2, len(run.time) - 1):
        vertices = np.round(1e6 * sweep.mesh(tick).vertices.astype(float)).astype(int)
        _, number = np.unique(vertices, axis=0, return_inverse=True)
        corners = number.ravel()[sweep.faces()]
        corners = corners[(corners != np.roll(corners, 1, axis=1)).all(axis=1)]
        edges = np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]), axis=1)
        edges, count = np.unique(edges, axis=0, return_counts=True)
        height = np.zeros(number.max() + 1)
        height[number.ravel()] = vertices[:, 2]
        on_surface = (np.abs(height[edges] + 1e3 * GAP) < 3).all(axis=1)
        assert (count[~on_surface] % 2 == 0).all()
        assert (~on_surface).sum() > 500


def test_the_faces_look_outwards(run):
    sweep = Sweep(run)
    mesh = sweep.mesh(len(run.time) - 1)
    corners = mesh.vertices[sweep.faces()].astype(float)
    face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(face, axis=1)
    normal = mesh.normals[sweep.faces()].mean(axis=1)
    visible = area > 1e-9
    cosine = np.einsum("ij,ij->i", face[visible], normal[visible]) / area[visible]
    assert visible.sum() > 10_000
    walls = np.abs(face[visible, 2]) < 0.1 * area[visible]  # of the groove, whose rims are shaded round
    assert 0.1 < walls.mean() < 0.2
    assert (cosine[~walls] > 0.8).mean() > 0.99
    assert (cosine > -1e-4).all()  # the fold at a tip is upright, inside the bead


def test_a_straight_bead_has_round_ends(run):
    """In plan view an end is half a disc about a point that leaves the glue of its stretch where it was laid."""
    straight = np.zeros((len(run.time), 3))
    straight[:, 0] = SPEED * run.time
    line = dataclasses.replace(on_and_off(run, [(0, 1)]), nozzle=straight, commanded_tip=straight)
    sweep = Sweep(line)
    mesh = sweep.mesh(2000)
    rings = rings_of(mesh)
    section = sweep.bead_trace.section
    width = section.width[0]
    taken = section.half_body()[0] / (FLOW / SPEED)  # length of bead that its end holds [mm]
    for centre, sign in ((taken, -1), (SPEED * line.time[2000] - taken, 1)):
        beyond = sign * (rings[..., 0] - centre)
        rim = rings[np.isclose(rings[..., 2], -GAP, atol=1e-4) & (beyond > -1e-3)]
        assert np.hypot(rim[:, 0] - centre, rim[:, 1]) == pytest.approx(width / 2, abs=0.02)
        assert beyond.max() == pytest.approx(width / 2, abs=0.02)
    assert rings[..., 1].max() == pytest.approx(width / 2, abs=1e-3)


def test_a_dot_is_a_round_drop(run):
    dot = on_and_off(run, [(0.5, 0.503)])
    sweep = Sweep(dot)
    rings = rings_of(sweep.mesh(len(run.time) - 1))
    plan = rings[:, :, :2].reshape(-1, 2)
    middle = 0.5 * (plan.min(axis=0) + plan.max(axis=0))
    radius = np.linalg.norm(plan - middle, axis=1).max()
    ticks = np.flatnonzero(dot.flow)
    assert np.linalg.norm(middle - dot.nozzle[ticks, :2].mean(axis=0)) < 0.3
    assert np.ptp(plan, axis=0) == pytest.approx(2 * radius, rel=0.05)


def section_areas(rings):
    """Areas of polygons across a trace, (r,), of rings (r, v, 3): by strips between the vertices."""
    across = np.einsum("rvi,ri->rv", rings - rings[:, :1], rings[:, -1] - rings[:, 0])
    across /= np.linalg.norm(rings[:, -1] - rings[:, 0], axis=1)[:, None]
    height = rings[..., 2] - rings[:, :1, 2]
    return np.sum(0.5 * (height[:, 1:] + height[:, :-1]) * np.diff(across, axis=1), axis=1)


@pytest.mark.parametrize("face", [0.82, 1.6, np.inf])
def test_a_section_is_no_higher_than_the_gap_below_the_face_and_has_the_area_of_the_glue(run, face):
    area = FLOW / SPEED
    for gap in (0.3, 0.5, 5.0):
        sweep = Sweep(dataclasses.replace(run, face=face), BeadSettings(gap=gap))
        mesh = sweep.mesh(len(run.time) - 1)
        k = len(mesh.place) // 2
        middle = rings_of(mesh)[k]
        # a drop at 60 deg: A = w^2 / (8 sin^2 60) (2 pi / 3 - sin 120), h = w/2 tan 30
        drop = np.sqrt(area / 0.2047) * np.tan(np.pi / 6) / 2
        beside = np.sqrt(max(area - face * gap, 0.0) / 0.2047) * np.tan(np.pi / 6) / 2  # halves of a drop
        assert middle[:, 2].max() + gap == pytest.approx(min(max(beside, gap), drop), rel=1e-3)
        assert middle[6, 2] + gap == pytest.approx(min(gap, drop), rel=1e-3)
        under = np.linalg.norm(middle[7, :2] - middle[5, :2])  # the flat, from wall to wall
        assert under <= face * (1 + 1e-3)
        assert under == pytest.approx(face if beside > gap else under, rel=1e-3)
        assert section_areas(middle[None])[0] == pytest.approx(area, rel=0.02)
        station = np.abs(sweep.bead_trace.place - mesh.place[k]).argmin()
        assert np.linalg.norm(middle[0] - middle[-1]) == pytest.approx(sweep.bead_trace.width[station], rel=1e-3)
        top = mesh.normals.reshape(-1, SIDES, 3)[k][6]
        np.testing.assert_allclose(top, [0, 0, 1], atol=1e-6)


def test_rings_have_their_place_on_the_trace(run):
    sweep = Sweep(run)
    mesh = sweep.mesh(len(run.time) // 2)
    laid = sweep.bead_trace.length[len(run.time) // 2]
    assert (np.diff(mesh.place) >= 0).all()
    assert laid - 3 < mesh.place[-1] < laid
    on_trace = np.stack([np.interp(mesh.place, sweep.bead_trace.length, run.nozzle[:, i]) for i in range(2)], axis=1)
    sections = slice(8, np.flatnonzero(mesh.place < mesh.place[-1])[-1] + 1)
    base = rings_of(mesh)[:, [0, -1], :2].mean(axis=1)
    np.testing.assert_allclose(base[sections], on_trace[sections], atol=0.03)


def test_rings_stand_where_the_trace_is_long_or_turns(run):
    long = dataclasses.replace(run, nozzle=run.nozzle * [20, 20, 1], commanded_tip=run.commanded_tip * [20, 20, 1])
    for record, most in ((run, 0.7), (long, 2.5)):
        sweep = Sweep(record)
        place = sweep.mesh(len(run.time) - 1).place
        steps = np.diff(np.unique(place))
        assert 0.7 * steps.max() < np.median(steps) < most
    angle = np.full((len(run.time), 3), [1.0, 0.0, 0.0])
    angle[len(angle) // 2 :] = [0.0, 1.0, 0.0]
    corner = 0.1 * np.cumsum(angle, axis=0) - [0.1, 0, 0]
    bent = dataclasses.replace(on_and_off(run, [(0, 1)]), nozzle=corner, commanded_tip=corner)
    sweep = Sweep(bent)
    mesh = sweep.mesh(len(run.time) - 1)
    at = 0.1 * (len(angle) // 2)
    assert np.count_nonzero(np.abs(mesh.place - at) < 0.5) >= 6  # 90 degrees at 15
    # the outer side of the corner is round: no further from the corner than half the bead's width
    rings = rings_of(mesh)[np.abs(mesh.place - at) < 0.6]
    away = np.linalg.norm(rings[..., :2] - [at, 0.0], axis=2)
    assert away.max() < 0.5 * sweep.bead_trace.width[len(sweep.bead_trace.width) // 4] + 0.6


def test_dashes_have_the_length_and_width_of_the_model(run):
    """However short: on a straight trace each is its length by glue and a round end, at either side."""
    straight = np.zeros((len(run.time), 3))
    straight[:, 0] = SPEED * run.time
    dashes = [(0.05 * k, 0.05 * k + 0.02) for k in range(20)]
    line = dataclasses.replace(on_and_off(run, dashes), nozzle=straight, commanded_tip=straight)
    sweep = Sweep(line)
    rings = rings_of(sweep.mesh(len(run.time) - 1))
    section = sweep.bead_trace.section
    width = np.median(section.width[section.width > 1])
    taken = np.median(section.half_body()[section.width > 1]) / (FLOW / SPEED)
    ticks = np.flatnonzero(np.diff(np.concatenate([[0], line.flow > 0, [0]])))
    x = rings[..., 0]
    for first, last in ticks.reshape(-1, 2):
        start, stop = straight[first, 0], straight[min(last, len(straight) - 1), 0]
        own = x[(x > start - width) & (x < stop + width)]
        assert own.min() == pytest.approx(start + taken - width / 2, abs=0.4)  # of stations 0.25 mm apart
        assert own.max() == pytest.approx(stop - taken + width / 2, abs=0.4)
    assert rings[..., 1].max() == pytest.approx(width / 2, abs=0.05)


def test_a_mesh_like_another_has_as_many_rings(run):
    like = Sweep(run)
    rings = like.rings
    several = [(k / 10, k / 10 + 0.05) for k in range(10)]
    for other in (run, on_and_off(run, several), on_and_off(run, [(0, 0)])):
        sweep = Sweep(other, None, like)
        for tick in (0, 1, len(run.time) - 1):
            mesh = sweep.mesh(tick)
            assert mesh.vertices.shape == mesh.normals.shape == (rings * SIDES, 3)
            assert mesh.place.shape == (rings,)
            assert np.isfinite(mesh.vertices).all()


def test_more_stretches_than_the_rings_suffice_for_are_refused(run):
    many = on_and_off(run, [(k / 80, k / 80 + 0.005) for k in range(80)])
    with pytest.raises(TooFewRingsError, match=r"rings of the mesh = \d+: must be more than \d+, for the bead's ends"):
        Sweep(many, None, Sweep(run))
    assert volume(Sweep(many), Sweep(many).mesh(len(run.time) - 1)) == pytest.approx(many.flow.sum() * 1e-3, rel=0.04)


def test_a_trembling_trace_is_drawn_with_the_rings_of_a_calm_one(run):
    """It needs many more rings, and has them further apart."""
    shake = 0.3 * np.random.default_rng(2).uniform(-1, 1, run.nozzle.shape) * [1, 1, 0]
    trembling = run.nozzle + shake
    shaken = dataclasses.replace(run, nozzle=trembling)
    calm = Sweep(run)
    sweep = Sweep(shaken, None, calm)
    mesh = sweep.mesh(len(run.time) - 1)
    assert sweep.rings == calm.rings
    assert mesh.place[-1] > 0.99 * sweep.bead_trace.length[-1] - 10
    assert np.isfinite(mesh.vertices).all()


@pytest.mark.soak
def test_a_mesh_depends_on_its_tick_alone(run):
    """Not on the ticks that were drawn before."""
    dots = on_and_off(run, [(k / 20, k / 20 + 0.02) for k in range(20)])
    ticks = np.random.default_rng(1).permutation(np.linspace(0, len(run.time) - 1, 40).astype(int))
    sweep = Sweep(dots)
    for tick in (*ticks, *sorted(ticks)):
        np.testing.assert_array_equal(sweep.mesh(tick).vertices, Sweep(dots).mesh(tick).vertices)


def test_glue_of_a_dwell_is_drawn_where_it_was_laid(run):
    dwell = 200
    nozzle = np.concatenate([np.repeat(run.nozzle[:1], dwell, axis=0), run.nozzle])
    flow = np.concatenate([np.full(dwell, FLOW), run.flow])
    still = dataclasses.replace(
        run,
        time=np.arange(len(nozzle)) * run.period,
        nozzle=nozzle,
        commanded_tip=np.concatenate([np.repeat(run.commanded_tip[:1], dwell, axis=0), run.commanded_tip]),
        flow=flow,
        flow_demand=flow,
    )
    sweep = Sweep(still)
    laid = 1e-3 * flow[:-1].cumsum()
    # the drop grows while the nozzle stands
    for tick in (50, 100, 200):
        assert volume(sweep, sweep.mesh(tick)) == pytest.approx(laid[tick - 1], rel=0.05)
    mesh = sweep.mesh(len(nozzle) - 1)
    assert volume(sweep, mesh) == pytest.approx(laid[-1], rel=FACETS)
    width = sweep.bead_trace.width
    area = section_areas(drawn(mesh))
    # the heap spreads no further than it is wide, to either side twice
    usual = np.median(area)
    assert area[:5].mean() > 2 * usual
    near = np.linspace(0, sweep.bead_trace.place[-1], len(area)) < 2.5 * width.max()
    assert area[~near][:-9] == pytest.approx(np.full((~near).sum() - 9, usual), rel=0.05)
