"""What a run's feet must satisfy, at every tick while glue flows, whatever the program: checks of an error budget.

Three invariants of distances alone, and the contour error by brute force:

    |nozzle, path| <= |commanded, path| + |nozzle - commanded|
    |link|         <= l + kappa l^2 / 2,   with l the distance of the two points that it lies between
    |contour|      >= distance from the nearest point of the whole path
    contour and program error, rms and largest, within bounds by `support.brute_force_feet`

The lower bound is the distance in the order of motion with the widest reach, twice the distance of nozzle and command,
where skipped cells cost nothing; but no more than the upper bound, as the least sum of squares may have a larger
largest value. The upper bound is the one with no reach, or that from the stretch of the path near
the command's own progress where it is larger: at a rounded corner of nearly 180 degrees a nozzle beside one leg belongs
as well to the other, whose command it follows. Where legs are shorter than roundings or than the lag, the order of
motion alone leaves progress open by some legs; the upper bound counts skipped cells more, and a value is wrong by 15 %
of the rms, or 20 % of the largest.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gantrysim import Budget

from support.brute_force_feet import SKIPPED, Polyline, coupled, dense, near_progress

ROUNDING = 1e-6  # [mm]
SAMPLED = 5e-5  # of a distance from the sampled path [mm]
LEAST_WRONG = 1e-3  # by which an error is wrong: more than a micrometre, and more than a share of it
WRONG = {"rms": 0.15, "max": 0.2}
UPPER_SKIPPED = 0.1  # weight of skipped cells for the upper bound
LEAST_REACH = 0.1  # [mm]


@dataclass(frozen=True)
class FeetChecks:
    """How far a run breaks what its feet must satisfy; nothing is broken where all are below `ROUNDING`, or within.

    Attributes:
        triangle: largest distance of the nozzle beyond that of the command and that between both [mm].
        links: largest size of each link beyond the distance of its points and the path's curvature, by name [mm].
        below: largest distance of the nearest point of the whole path beyond the contour error [mm].
        total: largest difference of the sum of all links from the contour error [mm].
        contour: rms and largest contour error of the package [mm].
        lower: rms and largest contour error by brute force with the widest reach [mm].
        upper: the same with no reach, or near the command's progress, whichever is largest [mm].
        nearest: rms and largest distance from the nearest point of the whole path [mm].
        program: rms and largest program error of the package [mm].
        program_lower: rms and largest distance of the command by brute force, with a short reach [mm].
        program_upper: the same with no reach [mm].
    """

    triangle: float
    links: dict[str, float]
    below: float
    total: float
    contour: tuple[float, float]
    lower: tuple[float, float]
    upper: tuple[float, float]
    nearest: tuple[float, float]
    program: tuple[float, float]
    program_lower: tuple[float, float]
    program_upper: tuple[float, float]

    @property
    def broken(self):
        """What is broken, a text each."""
        told = []
        if self.triangle > ROUNDING:
            told.append(f"triangle: nozzle {self.triangle:.6f} mm further from the path than command and lag allow")
        for name, excess in self.links.items():
            if excess > ROUNDING:
                told.append(f"link {name}: {excess:.6f} mm larger than the distance of its points")
        if self.below > SAMPLED:
            told.append(f"below: contour {self.below:.6f} mm less than the distance of the nearest point")
        if self.total > ROUNDING:
            told.append(f"total: links add up to the contour but for {self.total:.6f} mm")
        told += outside("contour", self.contour, self.lower, self.upper)
        return told + outside("program", self.program, self.program_lower, self.program_upper)


def outside(error, found, lower, upper):
    """What is wrong of the rms and the largest value of an error, a text each."""
    rows = zip(WRONG.items(), found, lower, upper, strict=True)
    return [
        f"{error} {name}: {value:.6f} mm, by brute force {low:.6f} to {high:.6f} mm"
        for (name, share), value, low, high in rows
        if not low - max(LEAST_WRONG, share * low) <= value <= high + max(LEAST_WRONG, share * high)
    ]


def sizes(distance):
    return float(np.sqrt(np.mean(distance**2))), float(distance.max())


def feet_checks(run):
    """Check the error budget of a run."""
    budget = Budget(run)
    analysis = budget.analysis
    on = analysis.ticks
    contour = budget.contour.size
    path = Polyline(run.requested)
    points, ticks = dense(run.nozzle, path.cell)
    apart = path.distances(points)
    rows = ticks[on]
    nearest = apart.min(axis=1)[rows].astype(float)
    lag = np.linalg.norm(run.nozzle - run.commanded_tip, axis=1)
    reach = max(2 * float(lag.max()), LEAST_REACH)
    commands, command_ticks = dense(run.commanded_tip, path.cell)
    commanded = path.distances(commands)
    command_rows = command_ticks[on]
    progress = coupled(commanded, path.cell, 0.0).progress[command_rows]
    # progress is known to a cell or two
    beside = near_progress(apart[rows], path.cell, progress, lag[on] + 2 * path.cell)
    strict = [coupled(apart, path.cell, 0.0, weight).distance[rows] for weight in (SKIPPED, UPPER_SKIPPED)]
    wide = coupled(apart[ticks], path.cell, reach, 0.0).distance[on]
    upper = tuple(map(max, *map(sizes, (*strict, beside))))
    return FeetChecks(
        triangle=float((analysis.nozzle.distance - analysis.commanded.distance - lag[on]).max()),
        links=link_excess(budget),
        below=float((nearest - contour).max()),
        total=remainder(budget),
        contour=sizes(contour),
        lower=tuple(map(min, sizes(wide), upper)),
        upper=upper,
        nearest=sizes(nearest),
        program=sizes(analysis.commanded.distance),
        program_lower=sizes(coupled(commanded[command_ticks], path.cell, LEAST_REACH, 0.0).distance[on]),
        program_upper=sizes(coupled(commanded, path.cell, 0.0, UPPER_SKIPPED).distance[command_rows]),
    )


def link_excess(budget):
    """Largest size of each link beyond what the distance of its points and the path's curvature allow, by name [mm]."""
    analysis = budget.analysis
    run = analysis.run
    on = analysis.ticks
    chain = [(run.commanded_tip, analysis.commanded), (run.encoder_tip, analysis.encoder)]
    chain.append((run.motor_tip, analysis.motor))
    if run.geometric_tip is not None:
        chain.append((run.geometric_tip, analysis.geometric))
    chain.append((run.nozzle, analysis.nozzle))
    bends = [np.abs(run.requested.curvature(foot.s)) for _, foot in chain]
    names = [name for name in budget.parts if name != "program"]
    found = {}
    ends = zip(pairwise(chain), pairwise(bends), strict=True)
    for name, (((before, _), (after, _)), bend) in zip(names, ends, strict=True):
        length = np.linalg.norm((after - before)[on], axis=1)
        bound = length + 0.5 * np.maximum(*bend) * length**2
        found[name] = float((budget.parts[name].size - bound).max())
    return found


def remainder(budget):
    parts = [*budget.parts.values(), *([] if budget.corner is None else [budget.corner])]
    names = ("lateral", "vertical", "beyond")
    return max(np.abs(sum(getattr(p, name) for p in parts) - getattr(budget.contour, name)).max() for name in names)
