"""The height map: no glue lost, the bead's own section, round ends, what the nozzle pushes aside."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import Dispenser, InputError, Job, Machine
from gantrysim.engine.simulate import perfect_follower
from gantrysim.glue.bead import Bead, BeadSettings, HeightMap, Section, pushing
from gantrysim.glue.bead.height_map import _on_grid
from gantrysim.glue.bead.pushing import push_aside
from gantrysim.record.setpoints import Setpoints

from support.beads import AREA, GAP, PERIOD, PLATE, SPEED, laid, line, spiral
from support.soaked import examples

VOLUME = 1e-6  # relative, on the map against what flowed
WIDTH = 1e-3  # relative, of the wet width along a bead
SHAPE = 0.01  # of the gap, a section on the map against the section's formula
ROUNDING = 1e-12  # [mm]
FILM = 0.021  # of the gap, within which a film is even
FACE = 0.82  # [mm], of the needle of xy
XY = Machine("xy")


def nominal(area=AREA, gap=GAP, face=PLATE):
    return Section(np.array([area]), np.array([gap]), 60.0, face)


def wet_widths(bead, place, direction, reach):
    """Widths between the places on both sides at which the map falls to the height of a bead's edge, (m,) [mm]."""
    steps = np.linspace(0.0, reach, 4001)
    width = np.zeros(len(place))
    for side in (-1, 1):
        heights = bead.map.at(place[:, None] + side * steps[:, None] * direction[:, None])
        edge = (heights > bead.map.contact).argmin(axis=1)
        high, low = heights[np.arange(len(place)), edge - 1], heights[np.arange(len(place)), edge]
        width += steps[edge - 1] + steps[1] * (high - bead.map.contact) / (high - low)
    return width


@pytest.mark.validates(
    "volume on the height map",
    "integral of the flow",
    "1e-6 relative",
)
@examples(40)
@given(
    st.integers(0, 2**32 - 1),
    st.floats(0.1, 3.0),
    st.floats(10.0, 90.0),
    st.booleans(),
    st.floats(0.25, 2.0),
    st.sampled_from([0.3, FACE, 2.0, PLATE]),
)
def test_the_map_holds_what_flowed(seed, gap, angle, squashed, cell, face):
    """Of any trace, with rests, corners and loops, and any flow."""
    thinnest = Section(np.array([AREA]), np.array([gap if squashed else np.inf]), angle, face)
    cell = min(cell, 0.333 * float(thinnest.width[0]))
    random = np.random.default_rng(seed)
    n = 400
    heading = np.cumsum(random.normal(0.0, 0.3, n) + (random.random(n) < 0.02) * random.uniform(-3, 3, n))
    step = random.uniform(0.0, 0.3, n) * (random.random(n) < 0.9)
    nozzle = np.cumsum(step[:, None] * np.stack([np.cos(heading), np.sin(heading), 0 * heading], axis=1), axis=0)
    flow = np.repeat(random.uniform(0.0, 400.0, 8) * (random.random(8) < 0.8), 50)
    run = laid(XY, line(39.9), face=face).run
    bead = Bead(replace(run, nozzle=nozzle, flow=flow), BeadSettings(gap, angle, squashed, cell))
    assert bead.map.volume == pytest.approx(flow[:-1].sum() * PERIOD, rel=VOLUME, abs=1e-12)
    assert bead.map.height.min() > -ROUNDING


@pytest.mark.parametrize("squashed", [True, False])
@pytest.mark.parametrize("angle", [0.0, 0.4])
def test_the_section_on_the_map_is_that_of_the_bead(angle, squashed):
    bead = laid(XY, line(60.0, angle, (-20.0, -20.0)), squashed=squashed, cell=0.1)
    middle = np.array([-20.0, -20.0]) + 30.0 * np.array([np.cos(angle), np.sin(angle)])
    u = np.linspace(-3.5, 3.5, 141)
    heights = bead.map.at(middle + u[:, None] * np.array([-np.sin(angle), np.cos(angle)]))
    expected = nominal(gap=GAP if squashed else np.inf).profile(u)[0]
    # at the contact line the cells blur a kink of tan 60 deg
    inner = np.abs(np.abs(u) - 0.5 * float(bead.nominal_section.width[0])) > 0.25
    assert heights[inner] == pytest.approx(expected[inner], abs=SHAPE * GAP)


@pytest.mark.validates(
    "groove of a needle on the height map",
    "closed form of the section",
    "0.012 mm",
)
@pytest.mark.parametrize("angle", [0.0, 0.4, 0.785])
@pytest.mark.parametrize("cell", [0.05, 0.25])
def test_a_groove_on_the_map_is_as_wide_as_the_face_and_as_low_as_the_needle(angle, cell):
    """But for the cells at its walls, which are blurred; what is pushed aside there is less than the ripple."""
    bead = laid(XY, line(60.0, angle, (-20.0, -20.0)), cell=cell, face=FACE)
    middle = np.array([-20.0, -20.0]) + 30.0 * np.array([np.cos(angle), np.sin(angle)])
    u = np.linspace(-2.5, 2.5, 201)
    heights = bead.map.at(middle + u[:, None] * np.array([-np.sin(angle), np.cos(angle)]))
    shape = nominal(face=FACE)
    assert bead.nominal_section.flat[0] == FACE
    rims = np.array([0.5 * FACE, 0.5 * float(shape.width[0])])
    inner = np.abs(np.abs(u)[:, None] - rims).min(axis=1) > 4 * cell if cell < 0.1 else np.abs(np.abs(u) - 1.1) < 0.1
    assert heights[inner] == pytest.approx(shape.profile(u)[0][inner], abs=0.02 if cell > 0.1 else 0.012)
    assert heights[100] == pytest.approx(GAP, rel=FILM)
    assert bead.map.height.max() == pytest.approx(float(shape.height[0]), rel=0.05)
    area = np.trapezoid(heights, u)
    assert area == pytest.approx(AREA, rel=2e-3)


def test_overlapping_turns_rise_between_the_tracks_of_the_needle():
    """The glue of a turn stays between it and its neighbours, A / pitch high; a plate presses it over the rim."""
    pitch = 2.6
    assert pitch < float(nominal(face=FACE).width[0])
    mean, beyond = {}, {}
    for face in (FACE, PLATE):
        bead = laid(XY, spiral(pitch, radius=25.0, turns=4.5), cell=0.1, face=face)
        assert bead.map.volume == pytest.approx(bead.total_volume, rel=VOLUME)
        assert bead.map.ridge == 0
        link, s = bead.analysis.spacing.link, bead.analysis.spacing.s
        inner = (s > 15) & (bead.analysis.spacing.next_s < bead.place[-1] - 15)
        step = (link[inner, 1] - link[inner, 0])[:, :2]
        share = ((np.arange(40) + 0.5) / 40)[:, None, None]
        mean[face] = bead.map.at(link[inner, 0, :2] + share * step).mean()
        under = bead.map.at(link[inner, 0, :2] + np.linspace(-0.08, 0.08, 5)[:, None, None] * step)
        assert under.max() <= GAP * (1 + FILM)
        x, y = np.meshgrid(bead.map.x, bead.map.y)
        radius = np.hypot(x - bead.point[:, 0].mean(), y - bead.point[:, 1].mean())
        beyond[face] = bead.map.height[radius > 25.0 + 0.75 * float(bead.nominal_section.width[0])].sum()
    assert mean[FACE] == pytest.approx(AREA / pitch, rel=0.03)
    assert mean[PLATE] == pytest.approx(GAP, rel=FILM)
    assert beyond[FACE] < 0.01 * beyond[PLATE]


def test_in_a_bend_the_section_is_the_same_on_its_inner_and_its_outer_side(circle):
    """The inner side is shorter: without the factor 1 - kappa u it would be a third higher here."""
    bead = laid(XY, circle(6.0, 0.75), cell=0.1)
    angle = np.linspace(1.0, 3.5, 40)
    u = np.linspace(-1.9, 1.9, 39)
    place = (6.0 + u)[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    heights = bead.map.at(place).mean(axis=1)
    assert heights == pytest.approx(nominal().profile(u)[0], abs=SHAPE * GAP)


def test_the_wet_width_is_constant_along_a_bead_of_constant_flow(circle):
    """In all directions over the grid; the error shrinks with its cells."""
    width, path = float(nominal().width[0]), circle(8.0, 0.9)
    s = np.linspace(10.0, path.length - 10.0, 200)
    off = {}
    for cell in (0.02, 0.08):
        bead = laid(XY, path, cell=cell)
        widths = wet_widths(bead, path.position(s)[:, :2], path.normal(s)[:, :2], 4.0)
        off[cell] = np.abs(widths / width - 1).max()
    assert off[0.02] < WIDTH
    assert off[0.02] < 0.4 * off[0.08]


def test_half_the_speed_doubles_the_glue_across_the_map():
    across = np.stack([np.zeros(801), np.linspace(-8, 8, 801)], axis=1)
    fast, slow = (laid(XY, line(60.0, start=(-30.0, 0.0)), Dispenser(flow=150.0), v) for v in (100.0, 50.0))
    areas = [np.trapezoid(bead.map.at(across), across[:, 1]) for bead in (fast, slow)]
    assert areas == pytest.approx([1.5, 3.0], rel=1e-3)


def test_turns_as_far_apart_as_they_are_wide_just_touch():
    """Slightly further apart they leave a gap, slightly closer none; beyond, w / pitch is covered."""
    width = float(nominal().width[0])
    covered = {}
    for ratio in (0.97, 1.03, 1.5, 2.5):
        values = laid(XY, spiral(ratio * width, radius=35.0, turns=1.5), cell=0.1).values
        covered[ratio] = values.coverage
        assert values.gap_share == pytest.approx(float(ratio > 1), abs=0.03)
    assert covered[0.97] == pytest.approx(1.0, abs=0.005)
    assert covered[1.03] == pytest.approx(1 / 1.03, abs=0.005)
    assert covered[1.5] == pytest.approx(1 / 1.5, abs=0.005)
    assert covered[2.5] == pytest.approx(1 / 2.5, abs=0.005)


def test_turns_a_pitch_of_area_over_gap_apart_fill_a_film_without_voids():
    """pitch = A / gap is less than the width, and the nozzle pushes the hills of the overlap into its valleys."""
    pitch = AREA / GAP
    assert pitch < float(nominal().width[0])
    for squashed in (True, False):
        bead = laid(XY, spiral(pitch, radius=25.0, turns=4.5), squashed=squashed)
        link = bead.analysis.spacing.link
        s = bead.analysis.spacing.s
        inner = (s > 15) & (bead.analysis.spacing.next_s < bead.place[-1] - 15)
        share = (np.arange(20)[:, None, None] + 0.5) / 20
        heights = bead.map.at(link[inner, 0, :2] + share * (link[inner, 1] - link[inner, 0])[:, :2])
        if squashed:
            assert heights.max() < GAP * (1 + FILM)
            assert heights.min() > GAP * (1 - 5 * FILM)
            assert np.quantile(heights, 0.05) > GAP * (1 - FILM)
        else:  # drops that stand higher leave dry ground between them
            assert heights.max() == pytest.approx(float(bead.nominal_section.height[0]), rel=FILM)
            assert heights.min() == 0
        assert heights.mean() == pytest.approx(GAP, rel=FILM)
        assert bead.values.coverage == pytest.approx(
            1.0 if squashed else float(bead.nominal_section.width[0]) / pitch, abs=0.01
        )


def cross(face=PLATE, **bead):
    """Two lines that cross at the origin, one after the other, with a dry motion between them."""
    along = np.concatenate([np.arange(400) * 0.1 - 20.0, np.full(400, 20.0), np.zeros(400)])
    other = np.concatenate([np.zeros(400), np.linspace(0, 20, 400), 20.0 - np.arange(400) * 0.1])
    along[400:800] = np.linspace(20.0, 0.0, 400)
    setpoints = laid(XY, line()).run
    dispense = np.repeat([True, False, True], 400)
    points = Setpoints(PERIOD, ("x", "y"), np.stack([along, other], axis=1), dispense, setpoints.requested)
    run = perfect_follower(XY, points, dispenser=Dispenser(flow=AREA * SPEED))
    return Bead(replace(run, face=face), BeadSettings(**bead))


def test_where_beads_cross_the_nozzle_pushes_the_excess_aside_and_without_it_they_add_up():
    pushed, free = cross(), cross(squashed=False)
    assert pushed.map.at([0.0, 0.0]) == pytest.approx(GAP, rel=FILM)
    assert pushed.map.height.max() <= GAP * (1 + FILM) + 1e-9
    single = float(nominal(gap=np.inf).height[0])
    assert free.map.at([0.0, 0.0]) == pytest.approx(2 * single, rel=FILM)
    # what is pushed lies round the crossing: it is wet further out in the corners than two squashed beads are
    width = float(pushed.nominal_section.width[0])
    corner = pushed.map.wet([[s * 0.55 * width, t * 0.55 * width] for s in (-1, 1) for t in (-1, 1)])
    assert corner.all()
    assert not free.map.wet([[0.55 * width, 0.55 * width]]).any()
    # glue wets where it is pushed to, and under a plate all of it is as high as the gap
    height = pushed.map.height
    covered = pushed.map.covered[0]
    assert height[covered == 0.0].sum() < 1e-5 * height.sum()
    near = np.hypot(*np.meshgrid(pushed.map.x, pushed.map.y)) < 4.0
    assert height[near].sum() == pytest.approx(GAP * covered[near].sum(), rel=5e-3)


def test_where_beads_cross_under_a_needle_both_grooves_stay_open_and_the_excess_stays_near():
    pushed, plate = cross(face=FACE, cell=0.1), cross(cell=0.1)
    s = np.linspace(-3.0, 3.0, 61)
    for track in (np.stack([s, 0 * s], axis=1), np.stack([0 * s, s], axis=1)):
        assert pushed.map.at(track).max() <= GAP * (1 + FILM)
    height = float(pushed.nominal_section.height[0])
    assert height < pushed.map.height.max() < 1.6 * height
    assert pushed.map.ridge == 0
    # within a width of the crossing lies what both beads have laid there
    x, y = np.meshgrid(pushed.map.x, pushed.map.y)
    reach = 1.5 * float(pushed.nominal_section.width[0])
    near = np.maximum(np.abs(x), np.abs(y)) < reach
    assert pushed.map.height[near].sum() * pushed.map.cell**2 == pytest.approx(4 * reach * AREA, rel=0.03)
    assert pushed.map.volume == pytest.approx(plate.map.volume, rel=VOLUME)


def test_excess_below_a_free_surface_spreads_as_far_as_its_rise_permits():
    """One row against the difference equation (u[i-1] - 2 u[i] + u[i+1]) / 4 = k u[i] - s[i]: u = U q^abs(i)."""
    rise, excess = 0.02, 0.3
    height, ceiling = np.ones((121, 121)), np.ones((121, 121))
    height[:, 60] += excess
    before = height.sum()
    assert push_aside(height, ceiling, np.full_like(height, rise), 1e-9, 5000) < 1e-8
    assert height.sum() == pytest.approx(before, rel=1e-12)
    q = 1 + 2 * rise - 2 * np.sqrt(rise * (1 + rise))
    u = excess / (0.5 * (1 - q) + rise) * q ** np.abs(np.arange(121) - 60)
    assert height[60] == pytest.approx(1 + rise * u, abs=1e-6)
    # a hard ceiling hands all of it on over the rim of the full cells; here there is none
    hard = np.ones((121, 121))
    hard[:, 60] += excess
    assert push_aside(hard, ceiling, np.zeros_like(hard), 1e-3, 200) > 1e-3


def test_pushing_aside_keeps_the_volume_and_makes_a_round_heap():
    height = np.zeros((121, 121))
    height[60, 60] = 2000.0
    push_aside(height, np.ones_like(height), np.zeros_like(height), 0.01, 1000)
    assert height.sum() == pytest.approx(2000.0, rel=1e-12)
    assert -ROUNDING < height.min() <= height.max() <= 1.01
    rows, columns = np.nonzero(height > 0.5)
    radius, distance = np.sqrt(2000.0 / np.pi), np.hypot(rows - 60, columns - 60)
    assert rows.size == pytest.approx(2000, rel=0.02)
    assert distance.max() < radius + 1.0
    # what fills is within; a full cell is no further than one that is not
    assert np.hypot(*(np.array(np.nonzero(height < 0.9)) - 60)).min() > radius - 1.5


def test_excess_finds_room_through_a_film_that_is_full():
    """Equally to all sides, and more over a nearer edge than over a further one."""
    height = np.zeros((81, 81))
    height[20:61, 20:61] = 1.0
    before = height.copy()
    height[40, 30] += 60.0
    push_aside(height, np.ones_like(height), np.zeros_like(height), 0.005, 2000)
    assert height.sum() == pytest.approx(41**2 + 60.0, rel=1e-12)
    assert height.max() <= 1.005
    gained = height - before
    np.testing.assert_allclose(gained, gained[::-1], atol=0.05)
    assert gained[:, :20].sum() > 3 * gained[:, 61:].sum() > 0


def test_what_finds_no_room_stays_as_a_ridge_and_is_returned():
    height = np.full((9, 9), 1.0)
    height[4, 4] = 5.0
    ridge = push_aside(height, np.ones_like(height), np.zeros_like(height), 0.01, 50)
    assert ridge == pytest.approx(height.max() - 1.0)
    assert ridge > 0.01
    assert height.sum() == pytest.approx(85.0, rel=1e-12)
    heap = np.zeros((15, 15))
    heap[7, 7] = 100.0
    assert push_aside(heap, np.ones_like(heap), np.zeros_like(heap), 0.01, 3) == pytest.approx(heap.max() - 1.0) != 0
    assert heap.sum() == pytest.approx(100.0, rel=1e-12)
    assert heap.max() > 2.0
    assert push_aside(heap, np.ones_like(heap), np.zeros_like(heap), 0.01, 1000) <= 0.01
    assert heap.max() <= 1.01
    single = np.full((1, 1), 3.0)
    assert push_aside(single, np.ones_like(single), np.zeros_like(single), 0.01, 5) == pytest.approx(2.0)
    assert single[0, 0] == 3.0


@pytest.mark.parametrize("shape", [(160, 160), (321, 333)])
def test_a_heap_settles_in_few_sweeps_however_wide_it_is(shape):
    """On one grid alone they would be twice as many as the grid has rows."""
    rim = 0.44 * shape[0]
    rows, columns = np.indices(shape)
    distance = np.hypot(rows - shape[0] // 2, columns - shape[1] // 2)
    heap = np.where(distance < 0.2 * rim, 25.0, 0.0)
    volume = heap.sum()
    assert push_aside(heap, np.ones_like(heap), np.zeros_like(heap), 0.02, 100) <= 0.02
    assert heap.sum() == pytest.approx(volume, rel=1e-12)
    assert heap.min() > -ROUNDING
    assert distance[heap > 0.5].max() == pytest.approx(rim, abs=1.5)
    assert (heap > 0.5).sum() == pytest.approx(volume, rel=0.01)


def test_an_overfull_bead_finds_room_around_its_map_and_is_a_film_of_the_gap():
    """At five times what the film between the turns holds; its area is the volume over the gap."""
    bead = laid(XY, spiral(4.0, radius=15.0, turns=2.5), Dispenser(flow=10 * AREA * SPEED))
    assert bead.map.ridge == 0
    assert bead.map.volume == pytest.approx(bead.total_volume, rel=VOLUME)
    assert bead.map.height.max() <= GAP * (1 + FILM)
    rim = np.concatenate([bead.map.height[[0, -1]].ravel(), bead.map.height[:, [0, -1]].ravel()])
    assert not rim.any()
    assert (bead.map.height > 0.5 * GAP).sum() * bead.map.cell**2 == pytest.approx(bead.total_volume / GAP, rel=0.02)
    x, y = np.meshgrid(bead.map.x, bead.map.y)
    middle = [float((place * bead.map.height).sum() / bead.map.height.sum()) for place in (x, y)]
    weight = bead.run.flow[:-1, None] / bead.run.flow[:-1].sum()
    assert np.hypot(*((weight * bead.run.nozzle[:-1, :2]).sum(axis=0) - middle)) < 1.0


def test_a_map_that_does_not_settle_reports_its_ridge(monkeypatch):
    monkeypatch.setattr("gantrysim.glue.bead.height_map._SWEEPS", 1)
    bead = laid(XY, spiral(4.0, radius=15.0, turns=2.5), Dispenser(flow=4 * AREA * SPEED))
    assert bead.map.ridge == pytest.approx(bead.map.height.max() / GAP - 1)
    assert bead.map.ridge > 0.04
    assert bead.values.ridge == bead.map.ridge


def test_pushing_aside_can_be_interrupted(monkeypatch):
    """The compiled code returns every few sweeps."""
    calls = []
    sweep = pushing._sweep

    def counted(*arguments):
        calls.append(arguments[-1])
        if len(calls) == 3:
            raise KeyboardInterrupt
        return sweep(*arguments)

    monkeypatch.setattr(pushing, "_sweep", counted)
    heap = np.zeros((12, 12))
    heap[6, 6] = 200.0  # more than there is room for
    with pytest.raises(KeyboardInterrupt):
        push_aside(heap, np.ones_like(heap), np.zeros_like(heap), 0.02, 5000)
    assert max(calls) <= 20


def test_under_a_nozzle_that_stands_higher_the_film_is_thicker():
    bead = laid(XY, line(60.0, start=(-30.0, 0.0)), Dispenser(flow=5 * SPEED))
    up = bead.run.nozzle + 0.2 * (bead.run.nozzle[:, :1] > 0) * [0, 0, 1]
    raised = Bead(replace(bead.run, nozzle=up))
    assert raised.map.at([[-15.0, 0.0], [15.0, 0.0]]) == pytest.approx([GAP, GAP + 0.2], rel=FILM)


def test_the_ends_of_a_bead_are_round():
    """Half a body of revolution about a point: the rim is a circle about it, of the bead's own width."""
    bead = laid(XY, line(40.0, start=(-20.0, 0.0)), cell=0.05)
    width = float(bead.nominal_section.width[0])
    into = float(bead.nominal_section.half_body()[0]) / AREA  # as far as the volume of half a body lies along the bead
    for sign in (-1, 1):
        centre = np.array([sign * (20.0 - into), 0.0])
        angle = np.linspace(-1.4, 1.4, 15)
        outward = np.stack([sign * np.cos(angle), np.sin(angle)], axis=1)
        steps = np.linspace(0, 4, 801)
        heights = bead.map.at(centre + steps[:, None, None] * outward)
        rim = steps[(heights > bead.map.contact).argmin(axis=0)]
        assert rim == pytest.approx(np.full(15, 0.5 * width), abs=0.13)  # half a station
        assert 20.0 < abs(centre[0]) + 0.5 * width < 20.0 + 0.2 * width


def test_a_stretch_too_short_for_two_ends_is_a_round_drop():
    """So is glue laid at rest: a drop of its volume, with the same second moments in all directions."""
    still = replace(laid(XY, line()).run, nozzle=np.zeros((1001, 3)))
    short = laid(XY, line(100.0), on=(0.5, 0.51))
    for bead, volume in ((Bead(still, BeadSettings(cell=0.1)), 200.0), (short, 2.0)):
        assert bead.map.volume == pytest.approx(volume, rel=VOLUME)
        x, y = np.meshgrid(bead.map.x, bead.map.y)
        weight = bead.map.height / bead.map.height.sum()
        x, y = x - (x * weight).sum(), y - (y * weight).sum()
        moments = [(x * x * weight).sum(), (y * y * weight).sum(), (x * y * weight).sum()]
        assert moments[1] == pytest.approx(moments[0], rel=0.02)
        assert moments[2] == pytest.approx(0.0, abs=0.01 * moments[0])
    # a squashed one is nearly a disc of the gap's height
    bead = Bead(still, BeadSettings(cell=0.1))
    assert bead.map.height.max() == pytest.approx(GAP, rel=FILM)
    rim = np.abs(bead.map.x[(bead.map.height > 0.5 * GAP).any(axis=0)]).max()
    assert rim == pytest.approx(np.sqrt(200.0 / (np.pi * GAP)), rel=0.05)


def test_a_drop_that_relaxes_is_the_body_of_its_section():
    """Against the spherical cap of its volume: V = pi h (3 r^2 + h^2) / 6, h = r tan(theta / 2)."""
    bead = laid(XY, line(100.0), on=(0.5, 0.51), squashed=False, cell=0.02)
    tangent = np.tan(np.pi / 6)
    rim = (2.0 * 6 / (np.pi * tangent * (3 + tangent**2))) ** (1 / 3)
    sphere = rim / np.sin(np.pi / 3)
    r = np.linspace(0.1, 0.9, 17) * rim
    centre = bead.map.x @ bead.map.height.sum(axis=0) / bead.map.height.sum()
    heights = np.mean([bead.map.at(np.stack([centre + s * r, 0 * r], axis=1)) for s in (-1, 1)], axis=0)
    assert heights == pytest.approx(np.sqrt(sphere**2 - r**2) - sphere * np.cos(np.pi / 3), abs=0.02 * rim)


def test_a_map_of_no_glue_is_flat():
    bead = laid(XY, line(), Dispenser())
    assert not bead.map.height.any()
    assert bead.map.volume == 0
    assert not bead.map.wet([[0.0, 0.0]]).any()


def test_off_the_map_there_is_nothing():
    map_ = laid(XY, line(20.0, start=(-10.0, 0.0))).map
    assert map_.at([[0.0, 50.0], [-500.0, 0.0], [0.0, 0.0]]) == pytest.approx([0, 0, GAP], rel=FILM)
    assert map_.at([0.0, 0.0, 7.0]) == pytest.approx(GAP, rel=FILM)  # height counts not


def test_cells_too_small_for_the_bead_are_refused():
    bead = laid(XY, line(), cell=0.001)
    text = r"cell = 0.001 mm: the height map of a bead 4.5\d+ mm wide, .* has .* cells, at most 2e\+07"
    with pytest.raises(InputError, match=text):
        HeightMap.of(bead)
    wide = laid(XY, line(), gap=1e-6)
    with pytest.raises(InputError, match=r"of a bead 2e\+06 mm wide, .* has .* cells"):
        HeightMap.of(wide)


def test_infinitely_many_cells_are_refused():
    """The product of their counts overflows; no cell size suits."""
    job = Job.load("an225", {"dispenser.flow": 1e-308})
    with pytest.raises(InputError, match=r"has inf cells, at most 2e\+07$"):
        job.plan()


def test_cells_too_large_for_the_bead_are_refused():
    width = float(nominal().width[0])
    with pytest.raises(
        InputError, match=r"cell = 50 mm: must be at most 1.5\d+ mm, a third of the bead's width of 4.5"
    ):
        HeightMap.of(laid(XY, line(), cell=50.0))
    assert laid(XY, line(), cell=0.333 * width).map.volume == pytest.approx(AREA * 100.0, rel=VOLUME)


@pytest.mark.parametrize("share", [1.0, 0.02])
def test_a_cell_that_is_not_given_is_a_quarter_of_a_narrow_bead(share):
    bead = laid(XY, line(), dispenser=Dispenser(flow=share * AREA * SPEED))
    width = float(bead.nominal_section.width[0])
    assert (width > 1.0) == (share == 1)
    assert bead.cell == (0.25 if share == 1 else pytest.approx(0.25 * width))
    assert bead.map.volume == pytest.approx(bead.run.flow[:-1].sum() * PERIOD, rel=VOLUME)


@pytest.mark.parametrize("cell", [0.5, 2.0])
def test_cells_keep_their_places_on_a_wider_grid(cell):
    def middles(first, count):
        return cell * (first + np.arange(count, dtype=float))

    values = 1.0 + np.arange(6.0).reshape(3, 2)
    wide = _on_grid(values, (middles(2, 2), middles(-5, 3)), (middles(0, 7), middles(-6, 9)), cell)
    assert wide.shape == (9, 7)
    np.testing.assert_array_equal(wide[1:4, 2:4], values)
    assert wide.sum() == values.sum()
    same = (middles(2, 2), middles(-5, 3))
    assert _on_grid(values, same, same, cell) is values
