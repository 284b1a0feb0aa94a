"""The drawing of a machine in a notebook: parallel projection from 30 deg to the right and 25 deg above."""

import math
import re

import mujoco
import numpy as np
import pytest

from gantrysim.machine.scheme import scheme

TILT = math.radians(25)
TURN = math.radians(30)
# cosines between the direction of view and the axes: those of the faces that are seen
SEEN = {"x": math.cos(TILT) * math.sin(TURN), "y": math.cos(TILT) * math.cos(TURN), "z": math.sin(TILT)}
BOX = '<geom type="box" size="0.01 0.02 0.03" pos="{pos}" rgba="{rgba}"/>'
RED = "1 0 0 1"


def polygons(*geoms):
    """Corners of the polygons of a drawing in their order, (k, 2) each [mm], and their colours."""
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{''.join(geoms)}</worldbody></mujoco>")
    drawing = scheme(model, np.zeros(0), "drawn")
    found = re.findall(r'<polygon points="([^"]*)" fill="([^"]*)"', drawing)
    return [(np.array([p.split(",") for p in points.split()], float), colour) for points, colour in found]


def area(corners):
    x, y = corners.T
    return 0.5 * abs(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1)))


def test_of_a_box_the_faces_in_front_on_the_right_and_above_are_seen_at_their_angles():
    drawn = polygons(BOX.format(pos="0.1 -0.2 0.3", rgba=RED))
    assert len(drawn) == 3
    faces = {"x": 40 * 60, "y": 20 * 60, "z": 20 * 40}  # [mm²]
    expected = sorted(faces[axis] * SEEN[axis] for axis in "xyz")
    assert sorted(area(corners) for corners, _ in drawn) == pytest.approx(expected, rel=0.01)
    assert len({colour for _, colour in drawn}) == 3


def test_right_is_right_and_up_is_up():
    def middle(pos):
        return np.mean([corners.mean(axis=0) for corners, _ in polygons(BOX.format(pos=pos, rgba=RED))], axis=0)

    origin = middle("0 0 0")
    along = {axis: middle(pos) - origin for axis, pos in (("x", "0.1 0 0"), ("y", "0 0.1 0"), ("z", "0 0 0.1"))}
    # the picture's second coordinate grows downwards or upwards for all three alike
    up = np.sign(along["z"][1])
    # from the right: x comes nearer, which is lower
    assert along["x"] == pytest.approx((100 * math.cos(TURN), -up * 100 * math.sin(TURN) * math.sin(TILT)), abs=0.2)
    assert along["y"] == pytest.approx((100 * math.sin(TURN), up * 100 * math.cos(TURN) * math.sin(TILT)), abs=0.2)
    assert along["z"] == pytest.approx((0, up * 100 * math.cos(TILT)), abs=0.2)


def test_an_upright_cylinder_is_its_outline_with_both_rims():
    ((corners, _),) = polygons(f'<geom type="cylinder" size="0.02 0.05" rgba="{RED}"/>')
    # 100 mm of 40 mm seen from the side, and one rim of twelve sides
    expected = 100 * 40 * math.cos(TILT) + 0.5 * 12 * math.sin(2 * math.pi / 12) * 20**2 * math.sin(TILT)
    assert area(corners) == pytest.approx(expected, rel=0.02)


def test_what_is_further_is_drawn_before_and_what_has_no_body_or_is_not_seen_is_not():
    near = BOX.format(pos="0 -0.5 0", rgba="0 1 0 1")
    far = BOX.format(pos="0 0.5 0", rgba="1 0 0 1")
    alone = [colour for _, colour in polygons(far)]
    for geoms in ((near, far), (far, near)):
        assert {colour for _, colour in polygons(*geoms)[:3]} == set(alone)
    small = '<geom type="box" size="0.0029 0.001 0.001"/>'
    plane = '<geom type="plane" size="1 1 0.1"/>'
    hidden = BOX.format(pos="0 0 0.2", rgba="1 0 0 0")
    assert len(polygons(far, small, plane, hidden)) == 3
    assert len(polygons(far, '<geom type="box" size="0.0031 0.001 0.001"/>')) == 6
