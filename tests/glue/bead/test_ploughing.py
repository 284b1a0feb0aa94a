"""The needle's passes through its own bead, against areas that discs and rectangles sweep, by hand."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from gantrysim import Dispenser, Machine
from gantrysim.controllers.gcode.linuxcnc import Program
from gantrysim.controllers.valve import Dispense
from gantrysim.engine.simulate import perfect_follower
from gantrysim.glue.bead import Bead, BeadSettings, Ploughing
from gantrysim.glue.bead.contacts import Needle, Sections, cells_of, contacts
from gantrysim.glue.bead.ploughing import _surface
from gantrysim.paths.chain import Chain
from gantrysim.paths.pieces import Line
from gantrysim.record.setpoints import Setpoints

from support.beads import AREA, GAP, PERIOD, SPEED
from support.soaked import suite_runs

XYZ = Machine("xyz")
AXES = ("x", "y", "z")
FACE = 0.82  # outer diameter of the needle [mm]
END = 4.0  # start and end of a stretch that may overlap [mm]
SESSILE = BeadSettings(contact_angle=90.0, squashed=False)  # a half circle
RADIUS = math.sqrt(2 * AREA / math.pi)  # of that half circle, whose top lies so high above the surface [mm]
STATION = 0.25  # [mm]
UP = 4.0  # of a lifted needle [mm]


def bead_of(*moves, turn=0.0, period=PERIOD, settings=SESSILE):
    """The bead of a perfect follower along moves: end point (x, y, z), and whether glue flows on the way there.

    The requested path is the wet one, whose surface the dry moves do not change; of several strokes it is all of it.
    """
    c = math.cos(turn)
    s = math.sin(turn)
    points = [(c * x - s * y, s * x + c * y, z) for (x, y, z), _ in moves]
    pieces = [Line(begin, end) for begin, end in pairwise(points)]
    lengths = np.cumsum([math.dist(begin, end) for begin, end in pairwise(points)])
    setpoints = Setpoints.along(Chain(pieces), SPEED, period, axes=AXES)
    piece = np.minimum(np.searchsorted(lengths, SPEED * setpoints.time, side="right"), len(pieces) - 1)
    on = np.array([wet for _, wet in moves[1:]])[piece]
    wet = [part for part, (_, flows) in zip(pieces, moves[1:], strict=True) if flows]
    strokes = sum(flows and not before for (_, before), (_, flows) in pairwise(moves))
    setpoints = replace(setpoints, dispense=on, requested=Chain(pieces if strokes > 1 else wet), progress=None)
    run = perfect_follower(XYZ, setpoints, dispenser=Dispenser(flow=AREA * SPEED))
    return Bead(replace(run, face=FACE, gap=GAP), settings)


def crossed(z, angle=90.0, **options):
    """A bead along x, from -40 to 40, that a dry move at a height crosses at an angle in the origin."""
    x = 10 * math.cos(math.radians(angle))
    y = 10 * math.sin(math.radians(angle))
    return bead_of(
        ((-40, 0, 0), False),
        ((40, 0, 0), True),
        ((40, 0, UP), False),
        ((-x, -y, UP), False),
        ((-x, -y, z), False),
        ((x, y, z), False),
        **options,
    )


def ploughed(bead):
    return Ploughing.of(bead, END, END)


def half_chord(z):
    """Half the width of the bead at a height of the needle; z = 0 lies the gap above the surface."""
    return math.sqrt(RADIUS**2 - (z + GAP) ** 2)


def test_a_bead_crossed_square_is_ploughed_by_a_diameter():
    ploughing = ploughed(crossed(0.0))
    assert ploughing.passes == 1
    assert ploughing.length == pytest.approx(FACE, abs=STATION)
    assert ploughing.depth == pytest.approx(RADIUS - GAP, abs=1e-3)


@pytest.mark.parametrize("angle", [30.0, 45.0, 150.0])
@pytest.mark.parametrize("z", [0.0, 0.5 * RADIUS - GAP])
def test_a_bead_crossed_at_an_angle_is_ploughed_by_the_swept_strip(z, angle):
    """The strip of width f meets the rectangle 2 w wide on (f + 2 w |cos|) / sin of its length."""
    turn = math.radians(angle)
    ploughing = ploughed(crossed(z, angle))
    expected = (FACE + 2 * half_chord(z) * abs(math.cos(turn))) / math.sin(turn)
    assert ploughing.length == pytest.approx(expected, abs=STATION)
    assert ploughing.depth == pytest.approx(RADIUS - GAP - z, abs=1e-3)


@pytest.mark.parametrize(("above", "passes"), [(0.05, 0), (0.008, 0), (0.003, 1), (-0.01, 1)])
def test_a_needle_above_the_top_is_free_and_one_that_touches_it_is_not(above, passes):
    """It touches within a hundredth of the gap, 5 µm."""
    ploughing = ploughed(crossed(RADIUS - GAP + above))
    assert ploughing.passes == passes
    assert (ploughing.length > 0) == bool(passes)
    assert ploughing.depth == pytest.approx(max(-above, 0.0) * passes, abs=1e-3)


@pytest.mark.parametrize(("turn", "period"), [(0.7, PERIOD), (math.pi, PERIOD), (0.0, PERIOD / 4), (0.0, 16 * PERIOD)])
def test_neither_a_turn_of_the_work_nor_the_period_matters(turn, period):
    """The longest period has steps of 1.6 mm, twice the needle's diameter."""
    ploughing = ploughed(crossed(0.0, 45.0, turn=turn, period=period))
    assert ploughing.passes == 1
    assert ploughing.length == pytest.approx(ploughed(crossed(0.0, 45.0)).length, abs=STATION)
    assert ploughing.depth == pytest.approx(RADIUS - GAP, abs=2e-3)


def test_the_place_is_where_the_needle_enters():
    bead = crossed(0.0)
    nozzle = bead.run.nozzle[ploughed(bead).tick]
    assert abs(nozzle[0]) < 0.1
    assert -(half_chord(0.0) + FACE / 2) <= nozzle[1] <= 0.1


def test_a_pass_lasts_as_long_as_the_needle_is_in_the_bead():
    bead = crossed(0.0)
    (stretch,) = ploughed(bead).stretches
    first, after = stretch
    reach = half_chord(0.0) + FACE / 2
    step = SPEED * PERIOD
    across = bead.run.nozzle[:, 1]
    assert across[first] == pytest.approx(-reach, abs=step)
    assert across[after - 1] == pytest.approx(reach, abs=step)


@pytest.mark.parametrize("wet", [False, True])
def test_a_pass_in_a_dry_move_is_told_from_one_while_it_dispenses(wet):
    """A bead along x, crossed at x = -20 on the way back to a stroke that crosses it at x = 20."""
    bead = bead_of(
        ((-40, 0, 0), False),
        ((40, 0, 0), True),
        ((40, 0, UP), False),
        ((-20, 10, UP), False),
        ((-20, 10, 0), False),
        ((-20, -10, 0), False),
        ((20, -10, 0), False),
        ((20, 10, 0), wet),
    )
    ploughing = ploughed(bead)
    assert (ploughing.passes, ploughing.dry) == (2, 1 if wet else 2)


def test_a_lift_before_the_way_back_leaves_the_bead_alone():
    low = bead_of(((0, 0, 0), False), ((60, 0, 0), True), ((0, 0, 0), False))
    high = bead_of(((0, 0, 0), False), ((60, 0, 0), True), ((60, 0, UP), False), ((0, 0, UP), False))
    assert ploughed(high) == Ploughing()
    # it comes to glue that no longer counts as being laid after half of two widths and a diameter
    behind = 2 * 2 * RADIUS + FACE
    assert ploughed(low).length == pytest.approx(60 - behind / 2 + FACE / 2, abs=2 * STATION)


@pytest.mark.parametrize(("overlap", "counts"), [(0.0, False), (3.0, False), (12.0, True)])
def test_an_outline_may_run_onto_its_start_by_the_lengths_of_start_and_end(overlap, counts):
    corners = [((30, 0, 0), True), ((30, 30, 0), True), ((0, 30, 0), True), ((0, 0, 0), True)]
    # it begins amid a side
    around = [((10, 0, 0), False), *corners, ((10 + overlap, 0, 0), True), ((10 + overlap, 0, UP), False)]
    ploughing = ploughed(bead_of(*around))
    assert bool(ploughing.passes) == counts
    if counts:
        assert ploughing.length == pytest.approx(overlap + FACE / 2, abs=END)


def zigzag(pitch):
    return bead_of(
        ((0, 0, 0), False), ((40, 0, 0), True), ((40, pitch, 0), True), ((0, pitch, 0), True), ((0, pitch, UP), False)
    )


def test_neighbouring_turns_that_the_face_brushes_are_a_matter_of_clearance():
    """The face reaches into the neighbour below a pitch of half a chord and its radius, the axis below half a chord."""
    brushing = half_chord(0.0) + FACE / 4
    assert half_chord(0.0) < brushing < half_chord(0.0) + FACE / 2
    assert ploughed(zigzag(brushing)) == Ploughing()
    assert ploughed(zigzag(0.5 * half_chord(0.0))).length > 30


def test_a_path_that_crosses_its_bead_while_it_dispenses_ploughs_it():
    bead = bead_of(
        ((-30, 0, 0), False), ((30, 0, 0), True), ((30, 30, 0), True), ((0, 30, 0), True), ((0, -30, 0), True)
    )
    ploughing = ploughed(bead)
    assert ploughing.passes == 1
    assert ploughing.length == pytest.approx(FACE, abs=STATION)
    assert abs(bead.run.nozzle[ploughing.tick, 1]) < half_chord(0.0) + FACE


def test_the_place_of_a_pass_while_it_dispenses_is_not_in_the_dry_move_behind_it():
    """The needle sinks on its way back along the bead, and is deepest where it no longer dispenses."""
    bead = bead_of(((-20, 0, 0.2), False), ((20, 0, 0.1), True), ((-15, 0, 0), True), ((-16, 0, -0.05), False))
    assert bead.run.dispense[ploughed(bead).tick - 1]


def test_a_pressed_bead_has_its_top_at_the_needle_which_touches_it():
    """Less glue than the face presses flat is no higher than the gap: a dry move at this height touches it."""
    pressed = BeadSettings(contact_angle=60.0)
    bead = crossed(0.0, settings=pressed)
    thin = Bead(replace(bead.run, flow=bead.run.flow * 0.45, flow_demand=bead.run.flow_demand * 0.45), pressed)
    assert float(thin.nominal_section.height[0]) == pytest.approx(GAP)
    ploughing = ploughed(thin)
    assert ploughing.passes == 1
    assert ploughing.depth == pytest.approx(0.0, abs=1e-9)


def joined(angle, *, at=0.0, beyond=0.0, length=30.0):
    """A bead along x, and a second stroke that begins on it, or so far before it, and leaves at an angle."""
    c = math.cos(math.radians(angle))
    s = math.sin(math.radians(angle))
    return bead_of(
        ((0, 0, 0), False),
        ((40, 0, 0), True),
        ((40, 0, UP), False),
        ((at - beyond * c, -beyond * s, UP), False),
        ((at - beyond * c, -beyond * s, 0), False),
        ((at + length * c, length * s, 0), True),
        ((at + length * c, length * s, UP), False),
    )


@pytest.mark.parametrize("at", [0.0, 20.0, 40.0])
@pytest.mark.parametrize("angle", [30.0, 45.0, 90.0, 135.0, -60.0])
def test_a_stroke_that_begins_on_another_bead_is_a_joint(angle, at):
    """The axis leaves the bead after half its chord over the sine, within two widths and a diameter."""
    assert half_chord(0.0) / abs(math.sin(math.radians(angle))) < 4 * RADIUS + FACE
    assert ploughed(joined(angle, at=at)) == Ploughing()


def test_a_stroke_that_ends_on_another_bead_is_a_joint():
    for x in (0, 20, 40):
        bead = bead_of(
            ((0, 0, 0), False), ((40, 0, 0), True), ((40, 0, UP), False), ((x, 20, UP), False), ((x, 20, 0), False),
            ((x, 0, 0), True), ((x, 0, UP), False),
        )  # fmt: skip
        assert ploughed(bead) == Ploughing()


def test_a_bead_crossed_near_the_begin_of_a_stroke_is_ploughed():
    """The stroke begins where its glue does not reach the bead that it then crosses."""
    ploughing = ploughed(joined(90.0, at=20.0, beyond=2 * RADIUS + FACE))
    assert ploughing.passes == 1
    assert ploughing.length == pytest.approx(FACE, abs=STATION)


@pytest.mark.parametrize(("length", "expected"), [(3.0, 3.0), (12.0, 12.0)])
def test_a_stroke_that_lies_on_another_bead_is_no_joint(length, expected):
    """Half a diameter of the needle is added at both ends."""
    ploughing = ploughed(joined(0.0, at=10.0, length=length))
    assert ploughing.length == pytest.approx(expected + FACE, abs=2 * STATION)
    assert ploughing.depth == pytest.approx(RADIUS - GAP, abs=1e-3)


def test_a_second_layer_is_ploughed_where_the_needle_has_not_risen_above_the_first():
    low, high = (
        bead_of(
            ((0, 0, 0), False), ((40, 0, 0), True), ((40, 0, UP), False), ((0, 0, UP), False), ((0, 0, z), False),
            ((40, 0, z), True), ((40, 0, UP), False),
        )
        for z in (0.1, RADIUS)
    )  # fmt: skip
    assert ploughed(low).length == pytest.approx(40.0, abs=2 * STATION)
    assert ploughed(high) == Ploughing()


@pytest.mark.parametrize("dwell", ["", "G4 P0.3"])
def test_a_dwell_in_an_outline_that_closes_ploughs_nothing(dwell):
    text = f"""G64 P0.02 F{60 * SPEED}
        G0 Z{UP}
        G0 Z0
        G1 X30
        {dwell}
        G1 Y20
        G1 X0
        {dwell}
        G1 Y0
        G0 Z{UP}"""
    setpoints = Program(text=text).setpoints(PERIOD)
    assert np.count_nonzero(np.diff(setpoints.dispense.astype(int)) == 1) == (3 if dwell else 1)
    run = perfect_follower(XYZ, setpoints, dispenser=Dispenser(area=AREA))
    assert ploughed(Bead(replace(run, face=FACE, gap=GAP), SESSILE)) == Ploughing()


def test_no_face_is_deeper_in_a_bead_than_the_bead_is_high():
    """Glue laid 10 mm above the work, and the needle below it, on the work."""
    bead = bead_of(
        ((-20, 0, 10), False), ((20, 0, 10), True), ((20, 20, 10), False), ((0, 20, 10), False), ((0, 20, 0), False),
        ((0, -20, 0), False),
    )  # fmt: skip
    ploughing = ploughed(bead)
    assert ploughing.passes == 1
    assert ploughing.depth == pytest.approx(RADIUS, abs=1e-3)


def test_glue_that_flows_in_a_dive_lies_on_the_work_not_in_the_air():
    """A dry move at 6 mm crosses the place of a dive from 10 mm: the drop there is no higher than 6 mm."""
    bead = bead_of(
        ((0, 0, 10), False), ((0, 0, 0), True), ((40, 0, 0), True), ((40, 0, 6), False), ((-20, 0, 6), False)
    )
    assert float(bead.height.max()) < 4
    assert ploughed(bead) == Ploughing()


def test_glue_that_flows_at_rest_in_the_air_lies_on_the_work():
    """A dry move at 6 mm crosses the place where the needle rested 10 mm above the work, and then dived."""
    text = f"""G64 P0.02 F{60 * SPEED}
        G0 Z10
        M62 P0
        G4 P0.1
        G1 Z0
        G1 X40
        M63 P0
        G0 Z6
        G0 X-20"""
    setpoints = Program(text=text, dispense=Dispense(by="codes", on=("M62",), off=("M63",))).setpoints(PERIOD)
    run = perfect_follower(XYZ, setpoints, dispenser=Dispenser(flow=AREA * SPEED))
    bead = Bead(replace(run, face=FACE, gap=GAP), SESSILE)
    assert run.flow[run.nozzle[:, 2] > 9].max() > 0
    assert float(bead.height.max()) < 6
    assert ploughed(bead) == Ploughing()


@pytest.mark.parametrize(
    ("away", "dispense", "touches"), suite_runs([(0.3, True, False), (0.2, True, True), (0.3, False, True)], 1)
)
def test_a_dispensing_needle_passes_a_section_only_where_its_axis_does(away, dispense, touches):
    """A section 0.8 mm wide in the origin; the needle, 0.5 mm in radius, passes it so far along the trace."""
    one = np.ones(1)
    sections = Sections(
        place=0 * one,
        x=0 * one,
        y=0 * one,
        cosine=one,
        sine=0 * one,
        surface=0 * one,
        top=0.4 * one,
        steep=one,
        radius=0.4 * one,
        drop=0 * one,
        flat=0 * one,
        half=0.4 * one,
        is_dot=one < 0,
        thickness=0.0,
    )
    y = np.linspace(-2.0, 2.0, 101)
    needle = Needle(
        nozzle=np.column_stack([np.full(y.size, away), y, np.full(y.size, 0.1)]),
        length=np.linspace(10.0, 14.0, y.size),
        dispense=np.full(y.size, dispense),
        counted=np.ones(y.size, bool),
        radius=0.5,
        behind=1.0,
        touching=0.0,
    )
    depth, touched = contacts(needle, sections, cells_of(sections, needle))
    assert touched.tolist() == [touches]
    assert depth.max() == (pytest.approx(0.3) if touches else -math.inf)
    if touches:
        # half the chord at that height, and in a dry pass the reach of the disc beside it
        half = math.sqrt(0.4**2 - 0.1**2) + (0.0 if dispense else math.sqrt(0.5**2 - away**2))
        assert np.abs(y[depth > -math.inf]).max() == pytest.approx(half, abs=0.05)


@pytest.mark.parametrize("back", [1.5, 2.5, 3.5, 6.0, 12.0])
def test_a_stroke_that_turns_back_doubles_its_bead_beyond_what_counts_as_being_laid(back):
    """Glue being laid is the last two widths and a diameter, half of which lies on either side of the turn."""
    ploughing = ploughed(bead_of(((-20, 0, 0), False), ((20, 0, 0), True), ((20 - back, 0, 0), True)))
    free = 2 * RADIUS + FACE / 2
    assert ploughing.passes == (back > free)
    if back > free:
        assert ploughing.length == pytest.approx(back - free + FACE / 2, abs=2 * STATION)


def test_the_surface_of_a_climbing_bead_is_linear_between_ticks_far_apart():
    """The gap below a line of slope 1/4; where it ends, it is that of the last tick from which the nozzle moves."""
    bead = bead_of(((0, 0, 0), False), ((40, 0, 10), True), period=0.05)
    step = SPEED * 0.05
    assert step > 10 * STATION
    surface = _surface(bead)
    inside = bead.point[:, 0] < 40 - step
    assert surface[inside] == pytest.approx(bead.point[inside, 0] / 4 - GAP, abs=1e-9)
