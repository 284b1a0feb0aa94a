"""The table of colours: what each scale means, and that all eyes tell its colours apart."""

import itertools
import re
from pathlib import Path

import numpy as np
import pytest

import gantrysim
from gantrysim.report.plots.style import DASHES
from gantrysim.results.colours import (
    AXES,
    BAD,
    FAULT,
    GOOD,
    INK,
    LINKS,
    MAGNITUDE,
    NEAR,
    REQUESTED,
    RIGHT,
    RUNS,
    SHARE,
    WIDTH,
    css_variables,
)

from support.colour_vision import EYES, contrast, distance

FAR = 20.0  # least distance of colours that have to be told apart
OTHER = 14.0  # least distance of colours of different groups, to eyes with all cones
DARK_INK = "#e4e7eb"  # page.css
PAPERS = ("#ffffff", "#1d2127", "#2e3136")  # of the page in light and in dark, and of a film's table
SOURCES = Path(gantrysim.__file__).parent
# what a page, a film and the viewer are drawn on, and the paint of a machine
PAPER_SOURCES = {"results/colours.py", "report/page.css", "report/web/uplot.css", "render/fonts.py", "render/panel.py"}


def apart(colours, eyes):
    return min(distance(first, second, eyes) for first, second in itertools.combinations(colours, 2))


@pytest.mark.parametrize("eyes", EYES)
def test_every_eye_tells_the_colours_of_a_group_apart(eyes):
    for ink in (INK, DARK_INK):
        assert apart([*LINKS.values(), ink], eyes) > FAR
    assert apart(RUNS, eyes) > FAR
    assert apart(AXES, eyes) > FAR


def test_okabe_and_itos_green_and_pink_are_alike_to_eyes_without_green_cones():
    assert distance("#cc79a7", "#009e73", "deuteranopia") < FAR < distance("#cc79a7", "#009e73")


def test_links_runs_and_axes_share_no_colour():
    for first, second in itertools.combinations((tuple(LINKS.values()), RUNS, AXES, (FAULT, REQUESTED, INK)), 2):
        for one, other in itertools.product(first, second):
            assert distance(one, other) > OTHER, (one, other)


def test_no_link_is_known_by_its_colour_alone():
    dashes = [DASHES.get(name) for name in LINKS if name != "program"]
    assert None not in dashes
    assert len(set(map(tuple, dashes))) == len(dashes)


@pytest.mark.parametrize("eyes", EYES)
def test_every_eye_sees_whether_a_width_is_too_narrow_right_or_too_wide(eyes):
    narrow, right, wide = ([WIDTH.colour(value) for value in values] for values in ((-3, -1.05), (0,), (1.05, 3)))
    for one, other in (*itertools.product(narrow, right), *itertools.product(right, wide)):
        assert distance(one, other, eyes) > 30.0, (one, other)
    for one, other in itertools.product(narrow, wide):
        assert distance(one, other, eyes) > 60.0, (one, other)
    # within the tolerance it is nearer to right than to any other
    for value in (-0.9, 0.9):
        inside = WIDTH.colour(value)
        assert distance(inside, RIGHT, eyes) < 0.6 * min(distance(inside, other, eyes) for other in (*narrow, *wide))


@pytest.mark.parametrize("eyes", EYES)
def test_every_eye_sees_whether_a_share_is_within_near_or_beyond_the_tolerance(eyes):
    within, near, beyond = ((0, 0.4, 0.79), (0.9,), (1.02, 2, 5, 10))
    groups = [[SHARE.colour(share) for share in shares] for shares in (within, near, beyond)]
    for first, second in itertools.combinations(groups, 2):
        for one, other in itertools.product(first, second):
            assert distance(one, other, eyes) > FAR, (one, other)


def test_blue_means_too_narrow_alone():
    """Hues of the share of a tolerance keep away from that of a bead that is too narrow."""
    narrow = [WIDTH.colour(value) for value in np.linspace(-3, -1.05, 9)]
    for share in np.linspace(0, 1, 21):
        assert min(distance(SHARE.colour(share), colour) for colour in narrow) > 30.0, share


@pytest.mark.parametrize("scale", [SHARE, WIDTH, MAGNITUDE])
def test_a_scale_is_seen_on_every_paper(scale):
    for red, green, blue in scale.table().tolist():
        colour = f"#{red:02x}{green:02x}{blue:02x}"
        assert min(contrast(colour, paper) for paper in PAPERS) > 1.4, colour


def test_places_and_colours_of_a_scale():
    assert SHARE.places(np.array([-1.0, 0.0, 0.4, 1.5, 10.0, 99.0])).tolist() == pytest.approx([0, 0, 0.16, 0.5, 1, 1])
    assert SHARE.colour(0) == RIGHT == WIDTH.colour(0)
    assert SHARE.colour(0.9) == NEAR
    assert [SHARE.colour(10), WIDTH.colour(-9), WIDTH.colour(9)] == [
        SHARE.stops[-1][2],
        WIDTH.stops[0][2],
        WIDTH.stops[-1][2],
    ]
    # a step on either side of the tolerance
    assert distance(SHARE.colour(0.79), GOOD) < 3 > distance(SHARE.colour(1.01), BAD)


def test_the_page_reads_the_scales_from_its_style():
    style = css_variables()
    for name, scale in (("share", SHARE), ("width", WIDTH)):
        listed = re.search(rf"--{name}-stops: (.*);", style)[1]
        stops = [stop.split() for stop in listed.split(", ")]
        assert [(float(value), colour) for value, _, colour in stops] == [(v, colour) for v, _, colour in scale.stops]
        assert [float(place) for _, place, _ in stops] == pytest.approx([p for _, p, _ in scale.stops], abs=1e-4)


def test_no_colour_is_typed_a_second_time():
    typed = {}
    for file in SOURCES.rglob("*"):
        name = file.relative_to(SOURCES).as_posix()
        if file.suffix in {".py", ".js", ".css"} and ".min." not in name and name not in PAPER_SOURCES:
            found = re.findall(r'["\s](#[0-9a-f]{6})\b', file.read_text(encoding="utf-8"))
            typed[name] = [colour for colour in found if colour not in ("#000000", "#ffffff", INK)]
    assert {name: colours for name, colours in typed.items() if colours} == {}
