"""Filaments of hydrogels that others measured, beside the bead's section; the page says how far they are apart."""

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
