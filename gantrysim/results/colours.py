"""The one table of colours: shares of a tolerance, signed widths, links, runs and axes.

Film, page, plots, studies and 3-D read it; the page by the style that `css_variables` returns. Links, runs and axes
share no colour. Within each group, and along the scales, colours stay apart for eyes without red or green cones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.results.checks import FAIL, PASS, UNJUDGED, WARN

INK = "#1b1f24"  # of text, axes of plots and the contour error
SOFT = "#5b6470"  # of secondary text
REQUESTED = "#8a8f98"
FAULT = "#d1203f"
RIGHT = "#c3c7c0"  # what is as requested, on both scales
GOOD = "#56b094"
BAD = "#e4572e"
NEAR = "#f2b53a"
# of a verdict, as text on paper; words and shapes stay without them
STATES = {PASS: "#1a7f4b", WARN: "#a65f00", FAIL: "#b3122d", UNJUDGED: SOFT}
BEAD = "#b87a00"  # width and height of the bead in plots

# From Okabe and Ito's palette, but for encoder and structure, which there become the same grey for eyes without green
# cones.
LINKS = {
    "program": "#e69f00",
    "servo": "#0072b2",
    "encoder": "#e484a8",
    "geometry": "#56b4e9",
    "structure": "#008060",
    "corner": "#a6761d",
}
RUNS = ("#9010f0", "#50b010", "#907090", "#107030", "#b0b090", "#b070f0")
AXES = ("#3050f0", "#f09090", "#b0b010", "#b01070", "#b090f0", "#905010")

_SHADES = 256


@dataclass(frozen=True)
class ColourScale:
    """Colours along a quantity, with a step where two stops share a value.

    Attributes:
        stops: value, place on the scale, 0 to 1, and colour of each stop; ascending.
        ticks: values that a legend names.
        middle: the one that it names where there is room for one between the ends.
    """

    stops: tuple[tuple[float, float, str], ...]
    ticks: tuple[float, ...]
    middle: float

    @property
    def low(self) -> float:
        """First value of the scale."""
        return self.stops[0][0]

    @property
    def high(self) -> float:
        """Last value of the scale."""
        return self.stops[-1][0]

    def places(self, values: Floats) -> Floats:
        """Return the places of values on the scale, 0 to 1; those beyond it have the first or the last place."""
        return np.interp(values, [value for value, _, _ in self.stops], [place for _, place, _ in self.stops])

    def table(self, shades: int = _SHADES) -> NDArray[np.uint8]:
        """Return colours at even places from the first to the last, (shades, 3), 0 to 255."""
        places = [place for _, place, _ in self.stops]
        parts = np.array([channels(colour) for _, _, colour in self.stops], float)
        even = np.linspace(0.0, 1.0, shades)
        return np.round(np.stack([np.interp(even, places, part) for part in parts.T], axis=1)).astype(np.uint8)

    def colour(self, value: float) -> str:
        """Return the colour of a value."""
        shade = int(np.rint((_SHADES - 1) * self.places(np.array(value))))
        return "#" + bytes(self.table()[shade].tolist()).hex()


def channels(colour: str) -> tuple[int, int, int]:
    """Return red, green and blue of a colour such as "#1b1f24", 0 to 255."""
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return red, green, blue


# Share of a tolerance: as requested to green within it, yellow near it, red to violet beyond, nearly by its logarithm.
SHARE = ColourScale(
    (
        (0.0, 0.0, RIGHT),
        (0.8, 0.32, GOOD),
        (0.8, 0.32, NEAR),
        (1.0, 0.4, NEAR),
        (1.0, 0.4, BAD),
        (2.0, 0.6, "#cf3a4d"),
        (5.0, 0.8, "#b3155c"),
        (10.0, 1.0, "#8a3cb5"),
    ),
    (0.0, 1.0, 2.0, 5.0, 10.0),
    1.0,
)
# Signed deviation of a width or a volume in tolerances: blue is too little, orange too much.
WIDTH = ColourScale(
    (
        (-3.0, 0.0, "#1f4fd1"),
        (-1.0, 1 / 3, "#7db2f2"),
        (-1.0, 1 / 3, "#c9cfd6"),
        (0.0, 0.5, RIGHT),
        (1.0, 2 / 3, "#d8c9b4"),
        (1.0, 2 / 3, "#f29a4a"),
        (3.0, 1.0, "#b8400c"),
    ),
    (-3.0, -1.0, 0.0, 1.0, 3.0),
    0.0,
)
# A quantity without a limit, from its least to its largest value.
MAGNITUDE = ColourScale(((0.0, 0.0, "#d5d8d0"), (0.5, 0.5, "#58a6b5"), (1.0, 1.0, "#0c5a6e")), (0.0, 0.5, 1.0), 0.5)


def css_variables() -> str:
    """Return the scales as variables of a style sheet.

    `--share-stops` and `--width-stops` are value, place and colour of each stop, which scripts interpolate;
    `--share-scale` and `--width-scale` are gradients.
    """
    lines = [f"  --near: {NEAR};", *(f"  --{state}: {STATES[state]};" for state in (PASS, WARN, FAIL))]
    for name, scale in (("share", SHARE), ("width", WIDTH)):
        stops = ", ".join(f"{value:g} {place:.4g} {colour}" for value, place, colour in scale.stops)
        gradient = ", ".join(f"{colour} {100 * place:.4g}%" for _, place, colour in scale.stops)
        lines.append(f"  --{name}-stops: {stops};\n  --{name}-scale: linear-gradient(to right, {gradient});")
    return ":root {\n" + "\n".join(lines) + "\n}\n"
