"""Beads that others measured, beside the bead's section; the page says how far they are apart."""

import math
import re

import numpy as np
import pytest

from gantrysim.glue.bead.section import BeadSettings, Section

from support.doc_pages import read_pages

# mean of each publication on its first day, as collected by Tian et al., Micromachines 12 (2021) 780: flow [mm³/s],
# speed [mm/s], inner diameter of the needle [mm], width of the filament [mm]
FILAMENTS = {
    "Colosi 2016": (0.0833, 4.0, 0.21, 0.2188),
    "Ouyang 2017": (6.67, 5.0, 0.337, 0.5825),
    "Kosik-Koziol 2019": (0.085, 3.9, 0.25, 0.0987),
    "Chen 2019": (0.833, 5.0, 0.21, 0.153),
    "Fisch 2021": (2.24, 13.33, 0.41, 1.0638),
}
# flow [mm³/s] and needle [mm] of two more
IMPOSSIBLE = {"Li 2018": (150.0, 0.26), "Liu 2017": (1666.7, 0.21)}
# single beads of ceramic paste by Mediukh et al., doi:10.5281/zenodo.17782507: heights and widths at three places [mm]
PASTE = [
    (1.55, 1.83, 1.82, 5.49, 6.21, 5.38),
    (1.46, 1.4, 1.6, 4.14, 4.38, 3.92),
    (1.6, 1.6, 1.69, 2.29, 2.63, 2.49),
    (1.53, 1.43, 1.58, 2.53, 2.41, 2.79),
    (1.39, 1.27, 1.32, 2.13, 2.04, 2.47),
    (1.4, 1.42, 1.46, 1.63, 1.6, 1.63),
    (0.82, 1.05, 0.95, 2.36, 1.97, 1.93),
    (0.53, 0.43, 0.61, 1.89, 1.86, 2.19),
    (1.81, 2.03, 1.93, 6.54, 5.85, 6.45),
    (2.1, 2.37, 1.96, 5.74, 6.59, 6.94),
    (1.65, 1.75, 1.49, 4.36, 4.08, 4.63),
    (1.71, 1.57, 1.69, 2.89, 2.38, 3.45),
    (1.77, 1.69, 1.78, 3.1, 3.26, 3.33),
    (1.57, 1.8, 1.75, 3.37, 3.29, 4.02),
    (1.65, 1.67, 1.82, 3.27, 3.52, 4.78),
    (1.68, 1.78, 1.85, 3.36, 3.19, 3.51),
]
PASTE_GAP = 1.5  # layer height [mm]
PASTE_BORE = 2.0  # of the nozzle, the least that its face can be [mm]
# heights of beads of resin with 25 % TEGDMA, github.com/leanfried/in-situ-monitoring-of-direct-ink-writing, means of up
# to three, nan for none [µm]: by gap [µm] a row for each speed of the flow, and in it one for each of the nozzle
FLOW_SPEEDS = (1.5, 2.5, 3.5, 4.5, 5.5)  # [mm/s]
NOZZLE_SPEEDS = (1.5, 2.5, 3.5, 4.5, 5.5, 6.5)  # [mm/s]
NONE = math.nan
RESIN = {
    100: [
        (38, 40, 28, 32, 32, 22),
        (91, 56, 45, 39, 46, 38),
        (109, 81, 64, 61, 60, 57),
        (136, 96, 83, 62, 63, 57),
        (157, 94, 62, 71, 59, 69),
    ],
    150: [
        (91, 66, 63, NONE, NONE, NONE),
        (108, 78, 81, 48, 49, 50),
        (129, 106, 94, 65, 70, 62),
        (154, 104, 99, 69, 75, 69),
        (168, 123, 112, 88, 82, 83),
    ],
    200: [
        (61, 57, NONE, NONE, NONE, NONE),
        (90, 73, 62, 53, 50, 47),
        (120, 92, 86, 62, 74, 48),
        (156, 111, 86, 75, 77, 66),
        (175, 136, 102, 89, 83, 75),
    ],
    250: [
        (59, 47, NONE, NONE, NONE, NONE),
        (93, 72, 61, NONE, NONE, NONE),
        (139, 108, 84, 64, 65, 56),
        (173, 129, 108, 79, 78, 74),
        (182, 127, 98, 97, 91, 76),
    ],
}


def test_page_gives_each_measured_filament_as_a_multiple_of_its_prediction():
    flow, speed, _, width = np.array(list(FILAMENTS.values())).T
    no_plate = np.full(len(FILAMENTS), np.inf)
    predicted = Section(flow / speed, no_plate, BeadSettings().contact_angle, np.inf).width
    # the segment's area by its radius, w / 2 sin(theta): r² (theta - sin theta cos theta)
    theta = math.radians(BeadSettings().contact_angle)
    radius = predicted / (2 * math.sin(theta))
    assert radius**2 * (theta - math.sin(theta) * math.cos(theta)) == pytest.approx(flow / speed)
    said = re.search(r"was measured is ([\d., and]+) times", read_pages()["validation.md"])
    assert [float(number) for number in re.findall(r"\d+\.\d+", said[1])] == pytest.approx(width / predicted, abs=5e-3)


def test_page_gives_the_speed_in_the_needle_of_flows_that_cannot_be():
    speeds = [1e-3 * flow / (math.pi / 4 * needle**2) for flow, needle in IMPOSSIBLE.values()]
    said = re.search(r"needle at ([\d.]+) and ([\d.]+) m/s", read_pages()["validation.md"].replace("\n", " "))
    assert [float(number) for number in said.groups()] == pytest.approx(speeds, rel=0.02)


def numbers_in(pattern):
    """The numbers of a place of the page."""
    said = re.search(pattern, read_pages()["validation.md"].replace("\n", " "))
    return [float(number) for number in re.findall(r"\d+(?:\.\d+)?", said[1])]


def paste_widths(contact_angle):
    """Measured over predicted widths, for an ellipse of the measured width and height, (16,)."""
    height, width = np.array(PASTE).reshape(-1, 2, 3).mean(axis=2).T
    area = math.pi / 4 * width * height
    return width / Section(area, np.full(area.size, PASTE_GAP), contact_angle, PASTE_BORE).width


def test_page_gives_the_shape_of_a_paste_that_holds_it():
    height, width = np.array(PASTE).reshape(-1, 2, 3).mean(axis=2).T
    said = numbers_in(r"\| height / width = ([\d. to]+) \|")
    assert said == pytest.approx([(height / width).min(), (height / width).max()], abs=5e-3)
    free = Section(np.ones(1), np.full(1, np.inf), BeadSettings().contact_angle)
    assert numbers_in(r"height / width = ([\d.]+), or less") == pytest.approx(free.height / free.width, abs=5e-3)
    steep = 2 * np.degrees(np.arctan(2 * height / width)) > 90
    assert numbers_in(r"steeper still, as (\d+ of the \d+) beads") == [np.count_nonzero(steep), len(PASTE)]


def test_page_gives_the_width_of_a_paste_at_two_contact_angles():
    default = paste_widths(BeadSettings().contact_angle)
    said = numbers_in(r"contact angle of 60° \| ([\d. to]+) times that")
    assert said == pytest.approx([default.min(), default.max()], abs=5e-3)
    assert numbers_in(r"it is up to ([\d.]+) times too wide") == pytest.approx([1 / default.min()], abs=0.05)
    upright = paste_widths(90)
    said = numbers_in(r"contact angle 90° \| ([\d. to]+) times that")
    assert said == pytest.approx([upright.min(), upright.max()], abs=5e-3)
    number, of, share = numbers_in(r"times that; (\d+ of \d+ within \d+) %")
    assert number == np.count_nonzero(np.abs(upright - 1) <= share / 100 + 5e-3)
    assert of == len(PASTE)


def test_page_gives_how_the_height_of_a_resin_goes_with_flow_and_speed():
    ratio = np.divide.outer(FLOW_SPEEDS, NOZZLE_SPEEDS)
    powers = []
    heights = []
    above = []
    for gap, rows in RESIN.items():
        height = np.array(rows, float)
        some = ~np.isnan(height)
        power, constant = np.polyfit(np.log(ratio[some]), np.log(height[some]), 1)
        powers.append(power)
        heights.append(math.exp(constant))
        above += (height[some] / gap).tolist()
    # a sessile bead of four times the area is twice as high
    free = Section(np.array([1.0, 4.0]), np.full(2, np.inf), BeadSettings().contact_angle).height
    assert numbers_in(r"speed\) to the power ([\d.]+)") == pytest.approx([math.log(free[1] / free[0], 4)])
    assert numbers_in(r"powers ([\d., ]+)") == pytest.approx(powers, abs=5e-3)
    assert numbers_in(r"\| ([\d., ]+) µm") == pytest.approx(heights, abs=0.5)
    number, of, percent = numbers_in(r"wide face \| (\d+ of \d+, by up to \d+) %")
    assert (number, of) == (np.count_nonzero(np.array(above) > 1), len(above))
    assert percent == pytest.approx(100 * (max(above) - 1), abs=0.5)
