"""Checks of the errors of a run against distances alone, made in every run.

    |point, path|   <=  |point before it in the chain, path| + l
    |link|          <=  l + kappa l^2 / 2
    |nozzle, path|  >=  distance to the nearest point of the whole path

l is the distance of two neighbouring points of the chain from command to nozzle, kappa the curvature of the path at
their feet. The first holds for feet that lie on one stretch of the path, and is broken by a foot that is lost; the
budget itself then bounds the link, see `gantrysim.metrics.links`, so that the second is broken by a wrong frame alone.
Whatever the program and the machine, a run satisfies all three; one that does not has been measured wrongly, and
neither its errors nor their causes are known.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from gantrysim.base.arrays import Floats, at_rows, lengths
from gantrysim.base.columns import blocks
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.links import Trace, largest_link
from gantrysim.metrics.parts import Part

_ROUNDING = 1e-6  # of distances and links [mm]
_PLACES = 256  # at which the whole path is searched for a nearer point


def contradictions(analysis: Analysis, chain: list[Trace], links: dict[str, Part]) -> Iterator[str]:
    """Yield which of the three bounds a run breaks, each where it is broken most.

    Args:
        analysis: of the run.
        chain: the traces between which the links lie.
        links: the links between each trace and the next, by name.
    """
    run = analysis.run
    for block in blocks(analysis.ticks.size):
        for (before, after), (name, part) in zip(pairwise(chain), links.items(), strict=True):
            apart = lengths(after.at(block) - before.at(block))
            excess = np.abs(after.foot.distance[block] - before.foot.distance[block]) - apart
            what = f"the change of distance by the link {name}"
            yield from _worst(what, excess, "its two points are apart", analysis, block)
            excess = part.at(block).size - largest_link(run.requested, before, after, block)
            yield from _worst(f"the link {name}", excess, "its two points are apart", analysis, block)
    distance = chain[-1].foot.distance
    rows = np.unique(np.append(np.linspace(0, distance.size - 1, _PLACES).astype(np.intp), distance.argmax()))
    nearest = run.requested.project(at_rows(run.nozzle, analysis.ticks[rows])).distance
    excess = np.full(distance.size, -np.inf)
    excess[rows] = nearest - distance[rows]
    yield from _worst(
        "the distance of the nearest point of the path", excess, "the contour error", analysis, slice(0, distance.size)
    )


def _worst(what: str, excess: Floats, bound: str, analysis: Analysis, block: slice) -> Iterator[str]:
    k = int(excess.argmax())
    if excess[k] > _ROUNDING:
        time = float(analysis.run.time[analysis.ticks[block][k]])
        yield f"{what} is {1e3 * excess[k]:.3g} µm larger than {bound} at t = {time:.3f} s"
