"""Random figures for programs: moves in the XY plane that come near themselves, turn back, cluster and rest."""

import cmath
import math
from dataclasses import dataclass
from itertools import pairwise

ROOM = 60.0  # from the middle, within every machine's travel [mm]
LEAST_ARC = 0.3  # shortest arc [mm]


@dataclass(frozen=True)
class Stroke:
    """A straight move or an arc from one place to another, as complex numbers x + j y.

    Attributes:
        start: its first point [mm].
        end: its last point [mm].
        bend: angle that an arc turns, positive to the left; 0 for a line [rad].
        rest: dwell after it [s].
    """

    start: complex
    end: complex
    bend: float = 0.0
    rest: float = 0.0

    @property
    def centre(self):
        turn = cmath.exp(1j * self.bend)
        return (self.end - self.start * turn) / (1 - turn)

    @property
    def middle(self):
        return self.centre + (self.start - self.centre) * cmath.exp(0.5j * self.bend)

    @property
    def radius(self):
        return abs(self.start - self.centre)

    @property
    def length(self):
        return self.radius * abs(self.bend) if self.bend else abs(self.end - self.start)


def log_uniform(rng, low, high):
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def corners(rng):
    """Legs of any length with corners of 0 to 180 degrees."""
    heading = rng.uniform(0, 2 * math.pi)
    yield 0j
    place = 0j
    for _ in range(rng.integers(2, 10)):
        place += log_uniform(rng, 0.5, 30) * cmath.exp(1j * heading)
        yield place
        turns = [rng.uniform(-math.pi, math.pi), math.pi, rng.uniform(0.9, 1.1) * math.pi, math.pi / 2]
        heading += rng.choice(turns)


def cluster(rng):
    """Long legs with a crowd of short ones, 0.1 to 2 mm, between them or before them."""
    place = 0j
    yield place
    if rng.random() < 0.6:
        place += rng.uniform(5, 30)
        yield place
    size = log_uniform(rng, 0.1, 1)
    heading = rng.uniform(0, 2 * math.pi)
    for _ in range(rng.integers(5, 40)):
        heading += rng.normal(0, rng.choice([0.3, 1.0, 3.0]))
        place += size * rng.uniform(0.5, 2) * cmath.exp(1j * heading)
        yield place
    for _ in range(rng.integers(1, 3)):
        place += rng.uniform(5, 40) * cmath.exp(1j * rng.uniform(0, 2 * math.pi))
        yield place


def comb(rng):
    """Teeth, sharp or square, then long legs."""
    width = log_uniform(rng, 0.1, 15)
    pitch = log_uniform(rng, 0.05, 3)
    square = rng.random() < 0.5
    teeth = int(rng.integers(3, 25))
    yield 0j
    for k in range(1, teeth + 1):
        x = width if k % 2 else 0.0
        if square:
            yield complex(x, (k - 1) * pitch)
        yield complex(x, k * pitch)
    end = complex(width, teeth * pitch)
    if rng.random() < 0.7:
        yield end + complex(rng.uniform(5, 40), rng.uniform(-5, 5))
        yield end + complex(rng.uniform(5, 40), rng.uniform(10, 40))


def star(rng):
    """A star by chords, or spikes from a hub and back to it."""
    radius = log_uniform(rng, 0.5, 20)
    points = int(rng.integers(5, 14))
    if rng.random() < 0.5:
        step = int(rng.integers(2, points // 2 + 1))
        for k in range(points + 1):
            yield radius * cmath.exp(2j * math.pi * k * step / points)
        return
    hub = radius * log_uniform(rng, 0.001, 0.3)
    for k in range(points):
        yield hub * cmath.exp(2j * math.pi * k / points) if rng.random() < 0.7 else 0j
        yield radius * cmath.exp(2j * math.pi * (k + 0.5) / points)


def retrace(rng):
    """To and fro over one line, with some steps aside."""
    length = log_uniform(rng, 1, 30)
    aside = rng.choice([0.0, 0.0, 0.02, 0.1, 0.5])
    yield 0j
    for k in range(1, int(rng.integers(3, 8))):
        x = length if k % 2 else rng.choice([0.0, 0.0, 0.3 * length])
        yield complex(x, k * aside)


FIGURES = (corners, cluster, comb, star, retrace)


def random_strokes(rng, speed, duration):
    """Strokes of a random figure that take about so long at a speed, some of them arcs, some with a rest."""
    figure = FIGURES[rng.integers(len(FIGURES))]
    turn = cmath.exp(1j * rng.choice([0.0, 0.0, rng.uniform(0, 2 * math.pi)]))
    arcs = rng.choice([0.0, 0.0, 0.25])
    rests = rng.choice([0.0, 0.0, 0.2])
    places = [complex(round((place * turn).real, 4), round((place * turn).imag, 4)) for place in figure(rng)]
    begin = places[0]
    strokes = []
    left = duration
    for start, end in pairwise(places):
        if abs(end - start) < 1e-3:
            continue
        bend = rng.uniform(0.3, 5) * rng.choice([-1, 1]) if rng.random() < arcs else 0.0
        rest = round(rng.uniform(0.01, 0.08), 3) if rng.random() < rests else 0.0
        stroke = Stroke(start - begin, end - begin, bend, rest)
        if bend and (stroke.length < LEAST_ARC or abs(stroke.middle) > ROOM):
            stroke = Stroke(start - begin, end - begin, 0.0, rest)
        left -= stroke.length / speed + rest + 0.01
        if (strokes and left < 0) or abs(stroke.end) > ROOM:
            break
        strokes.append(stroke)
    return strokes
