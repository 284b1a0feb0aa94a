"""Dots: glue switched at rest, against closed forms of volume, cap, lag and string."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gantrysim import Dispenser, perfect_follower
from gantrysim.base.errors import InputError
from gantrysim.controllers.gcode import linuxcnc, slicer
from gantrysim.glue.bead import Bead, BeadSettings
from gantrysim.glue.bead.dots import Cap
from gantrysim.glue.bead.sweep import Sweep

PERIOD = 1e-3
FLOW = 5.0
PADS = "G21\nG90\nG0 Z4\n" + "".join(
    f"G0 X{x} Y10 Z2\nG1 Z0.2 F600\nM106\nG4 P{time}\nM107\nG1 Z2\n"
    for x, time in ((10, 130), (12.54, 130), (15.08, 210))
)


STROKE = "G0 Y0 Z2\nG0 X0\nG0 Z0\nM3\nG1 X{} F1200\nM5\nG0 Z2\n"
DOT = "G0 X{} Y10\nG0 Z0\nM3\nG4 P0.2\nM5\nG0 Z2\n"


def followed(machine, program, bead=None, **dispenser):
    setpoints = program.setpoints(PERIOD)
    values = {"flow": FLOW} | dispenser
    return Bead(perfect_follower(machine, setpoints.hold(0.5), dispenser=Dispenser(**values)), bead)


def mill(text):
    return linuxcnc.Program(text=f"G21 G90 G61\n{text}", start=(0, 0, 2))


def printer(text):
    return slicer.Program(text=text, corner_tolerance=1e-3, start=(0, 0, 4))


@pytest.mark.parametrize("angle", [5.0, 30.0, 60.0, 90.0])
def test_a_cap_has_the_volume_of_its_contact_angle(angle):
    """V = pi R^3 / 3 (2 + cos) (1 - cos)^2, a = R sin: another form than that of the code."""
    cap = Cap.of(0.65, BeadSettings(contact_angle=angle))
    theta = math.radians(angle)
    sphere = (3 * 0.65 / (math.pi * (2 + math.cos(theta)) * (1 - math.cos(theta)) ** 2)) ** (1 / 3)
    assert cap.radius == pytest.approx(sphere * math.sin(theta), rel=1e-12)
    assert cap.height == pytest.approx(sphere * (1 - math.cos(theta)), rel=1e-12)


def test_a_cap_has_the_height_that_is_given_up_to_a_hemisphere():
    cap = Cap.of(0.65, BeadSettings(dot_height=0.3))
    r = (np.arange(200_000) + 0.5) / 200_000 * cap.radius
    volume = float((2 * math.pi * r * cap.profile(r)).sum()) * cap.radius / 200_000
    assert cap.height == 0.3
    assert volume == pytest.approx(0.65, rel=1e-9)
    hemisphere = Cap.of(0.65, BeadSettings(dot_height=5.0))
    assert hemisphere.height == pytest.approx(hemisphere.radius, rel=1e-12)
    assert 2 / 3 * math.pi * hemisphere.radius**3 == pytest.approx(0.65, rel=1e-12)
    assert Cap.of(0.0, BeadSettings()) == Cap(0.0, 0.0)


def test_three_pads_of_a_paste_file_are_three_dots_and_a_plunge_lays_nothing(xyz):
    bead = followed(xyz, printer(PADS))
    assert [dot.volume for dot in bead.dots] == pytest.approx([0.65, 0.65, 1.05], rel=1e-9)
    assert [dot.string for dot in bead.dots] == pytest.approx([0, 0, 0], abs=1e-9)
    places = [(10, 10, 0.2), (12.54, 10, 0.2), (15.08, 10, 0.2)]
    assert [dot.place for dot in bead.dots] == [pytest.approx(place, abs=1e-6) for place in places]
    # nothing else is laid: 0.47 s of 5 mm³/s
    assert bead.run.flow.sum() * PERIOD == pytest.approx(2.35, rel=1e-9)
    assert not len(bead.stretches)
    assert bead.total_volume == 0
    assert bead.nominal == 0


@pytest.mark.parametrize("code", ["G82", "G89"])
def test_a_canned_cycle_lays_a_dot_at_each_place(xyz, code):
    bead = followed(xyz, mill(f"G99 {code} X5 Y5 Z0 R2 P0.15 F600\nX15\nX25 P0.3\nG80\nG0 Z5"))
    assert [dot.volume for dot in bead.dots] == pytest.approx([0.75, 0.75, 1.5], rel=1e-9)
    assert [dot.place[0] for dot in bead.dots] == pytest.approx([5, 15, 25], abs=1e-6)


def test_a_bead_and_dots_have_each_their_own_glue(xyz):
    """A bead beside dots has the values of the bead alone."""
    strokes = STROKE.format(40) + "{}" + STROKE.replace("Y0", "Y20").format(40)
    dots = "".join(DOT.format(x) for x in (10, 20, 30))
    both = followed(xyz, mill(strokes.format(dots)), flow=20.0)
    alone = followed(xyz, mill(strokes.format("")), flow=20.0)
    assert [dot.volume for dot in both.dots] == pytest.approx([4.0] * 3, rel=1e-9)
    assert not alone.dots
    assert len(both.stretches) == len(alone.stretches) == 2
    # the ticks lie elsewhere on the second stroke
    for name in ("nominal", "volume", "requested_volume"):
        assert getattr(both.values, name) == pytest.approx(getattr(alone.values, name), rel=1e-4)
    for name in ("volume_error", "ramp_error", "start_error", "running_error", "stop_error"):
        assert getattr(both.values, name) == pytest.approx(getattr(alone.values, name), abs=1e-2)
    assert both.values.width.max == pytest.approx(alone.values.width.max, rel=3e-3)


@pytest.mark.parametrize(
    "text",
    [
        # glue begins to flow at rest
        "G0 Z0\nM3\nG4 P0.5\nG1 X20 F1200\nM5",
        "G0 Z0\nM3\nG1 X3 F1200\nG4 P0.1\nG1 X20\nM5",
        # back to where it began
        "G0 Z0\nM3\nG4 P3\nG1 X15 F1200\nX0\nM5",
        # a pump gets going, the needle rises to its height and moves, and the pump stops again
        "G0 Z0\nM3\nG4 P0.5\nG1 Z0.2 F300\nG1 X20 F1200\nM5",
        "G0 Z0\nM3\nG1 X20 F1200\nG1 Z0.2 F300\nG4 P0.5\nM5",
        # a stroke shorter than the needle is wide
        "G0 Z0\nM3\nG1 X0.3 F60\nM5",
    ],
)
def test_glue_of_a_motion_is_no_dot(xyz, text):
    bead = followed(xyz, mill(text))
    assert not bead.dots
    assert len(bead.stretches) == (2 if "G1 Z" in text else 1)


def test_a_flow_in_proportion_to_the_speed_requests_nothing_of_a_dot(xyz):
    bead = followed(xyz, mill(DOT.format(10)), flow=0.0, area=1.0)
    (dot,) = bead.dots
    assert dot.demand == 0
    assert math.isnan(dot.volume_error_percent(dot.demand))


@pytest.mark.parametrize("wait", [0.0, 0.5])
def test_glue_that_flows_after_the_lift_is_a_string(xyz, wait):
    """After closing, q = Q exp(-t/T): from when the needle is a tenth of the dot above its top, Q T exp(-t/T) flows."""
    lag = 0.1
    text = f"G0 X10 Y10\nG1 Z0 F300\nM3\nG4 P0.2\nM5\nG4 P{wait}\nG1 Z5 F300\nG4 P1"
    bead = followed(xyz, mill(text.replace("G4 P0.0\n", "")), flow=FLOW, opening=0.0, closing=lag)
    run = bead.run
    (dot,) = bead.dots
    assert dot.volume + dot.string == pytest.approx(FLOW * (0.2 + lag), rel=1e-3)
    top = Cap.of(FLOW * (0.2 + lag), BeadSettings()).height
    height = 0.1 * top + max(top, bead.gap) - bead.gap
    closes = run.time[dot.stretch[1]]
    left = float(run.time[np.flatnonzero((run.time > closes) & (run.nozzle[:, 2] > height))[0]]) - closes
    assert left > wait
    expected = FLOW * lag * math.exp(-left / lag)
    assert dot.string == pytest.approx(expected, rel=0.02)
    assert (dot.string_percent > 5) == (wait == 0)


def test_the_place_of_a_dot_is_that_of_its_glue(xyz):
    bead = followed(xyz, mill(DOT.format(10)))
    moved = Bead(replace(bead.run, nozzle=bead.run.nozzle + np.array([0.3, -0.4, 0.05])))
    (dot,) = moved.dots
    assert dot.place_error == pytest.approx(0.5, rel=1e-9)
    assert dot.place == pytest.approx((10.3, 9.6, 0.05), abs=1e-6)
    # the work stays where it is
    assert dot.foot == pytest.approx((10.3, 9.6, -bead.gap), abs=1e-6)


@pytest.mark.parametrize(("share", "dots"), [(0.8, 0), (1.2, 1)])
def test_a_bead_that_begins_in_a_dot_has_its_glue(xyz, share, dots):
    """Also where the dot is wider than the needle's face."""
    radius = Cap.of(FLOW * 0.5, BeadSettings()).radius
    text = f"G0 X10 Y10\nG0 Z0\nM3\nG4 P0.5\nM5\nG0 X{10 + share * radius}\nM3\nG1 X30 F1200\nM5"
    bead = followed(xyz, mill(text))
    assert 0.8 * radius > 0.5 * bead.run.face
    assert len(bead.dots) == dots


def test_the_beads_before_and_after_a_dot_take_it_whatever_else_is_laid(xyz):
    """A dot whose place is the end of the bead before it, or the beginning of the next, among dots that lie apart."""
    before = "G0 Z0\nM3\nG1 X5 F1200\nM5\nG4 P0.1\nM3\nG4 P0.2\nM5\nG0 Z2\n"
    after = "G0 X20 Y0\nG0 Z0\nM3\nG4 P0.2\nM5\nG4 P0.1\nM3\nG1 X25 F1200\nM5\nG0 Z2\n"
    apart = DOT.format(40) + DOT.format(50)
    for text, dots in ((before, 0), (after, 0), (before + apart, 2), (after + apart, 2), (apart + after + before, 2)):
        bead = followed(xyz, mill(text))
        assert len(bead.dots) == dots
        assert [dot.asked[0] for dot in bead.dots] == pytest.approx([40.0, 50.0][:dots], abs=1e-6)


@pytest.mark.parametrize(("share", "dots"), [(0.6, 1), (1.4, 0)])
def test_a_needle_that_stays_over_its_own_face_lays_a_dot(xyz, share, dots):
    """Also one that is narrower than the face: 0.001 mm³ in 0.2 s."""
    way = share * followed(xyz, mill(DOT.format(10))).run.face
    bead = followed(xyz, mill(f"G0 X10 Y10\nG0 Z0\nM3\nG4 P0.2\nG1 X{10 + way} F1200\nM5\nG0 Z2"), flow=0.005)
    assert 2 * Cap.of(0.005 * 0.3, BeadSettings()).radius < way
    assert len(bead.dots) == dots


def test_what_flows_late_belongs_to_the_dot_that_was_switched_off(xyz):
    """Up to the middle between two dots, of which the first has 0.2 s, the other 0.1 s."""
    lag = 0.02
    text = DOT.format(10) + DOT.replace("P0.2", "P0.1").format(30)
    bead = followed(xyz, mill(text), closing=lag)
    glue = [dot.volume + dot.string for dot in bead.dots]
    assert glue == pytest.approx([FLOW * (0.2 + lag), FLOW * (0.1 + lag)], rel=1e-3)


def test_dots_lie_on_the_map_as_caps_with_their_volume(xyz):
    bead = followed(xyz, printer(PADS), BeadSettings(cell=0.05))
    assert bead.map.volume == pytest.approx(2.35, rel=1e-9)
    for dot in bead.dots:
        r = np.linspace(0, 0.9, 10) * dot.cap.radius
        points = np.stack([dot.place[0] + r, np.full(10, dot.place[1])], axis=1)
        assert bead.map.at(points) == pytest.approx(dot.cap.profile(r), abs=0.02 * dot.cap.height)
        x, y = np.meshgrid(bead.map.x, bead.map.y)
        near = np.hypot(x - dot.place[0], y - dot.place[1]) < 1.1
        area = float(bead.map.covered[0][near].sum()) * bead.map.cell**2
        assert area == pytest.approx(math.pi * dot.cap.radius**2, rel=0.01)


def test_a_film_grows_dots_to_their_caps(xyz):
    bead = followed(xyz, printer(PADS))
    sweep = Sweep(bead.run, bead)
    assert sweep.laid(bead.dots[0].stretch[0]).width.max() == 0
    before = 0
    for dot in bead.dots:
        halfway = sum(dot.stretch) // 2
        growing = sweep.laid(halfway)
        assert growing.place.size > before
        half = Cap.of(0.5 * dot.volume, bead.settings)
        assert growing.width[-1] == pytest.approx(2 * half.radius, rel=0.02)
        laid = sweep.laid(dot.share[1])
        assert laid.width[-1] == pytest.approx(dot.diameter, rel=1e-6)
        tips = 1e3 * laid.vertices.reshape(laid.place.size, -1, 3)
        surface = 1e3 * laid.centre[-1, 2]
        assert tips[-16:, :, 2].max() - surface == pytest.approx(dot.cap.height, rel=1e-4)
        assert tips[-16:, :, 0].mean() == pytest.approx(dot.place[0], abs=0.05)
        before = laid.place.size
    assert sweep.mesh(len(bead.run.time) - 1).place.size == sweep.rings


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"dot_height": 0.0}, "dot_height = 0 mm: must be at least 1e-06 mm"),
        ({"dot_target": -1.0}, r"dot_target = -1 mm³: must be greater than 0"),
    ],
)
def test_impossible_dots_are_refused(values, text):
    with pytest.raises(InputError, match=text):
        BeadSettings(**values)
