"""Beads of perfect followers that several test files ask for."""

import math
from dataclasses import replace

import numpy as np

from gantrysim import Dispenser
from gantrysim.engine.simulate import perfect_follower
from gantrysim.glue.bead import Bead, BeadSettings
from gantrysim.paths.arcs import ArcChain
from gantrysim.paths.spirals import Involute
from gantrysim.record.setpoints import Setpoints

PERIOD = 1e-3
SPEED = 100.0  # [mm/s]
AREA = 2.0  # [mm²]
GAP = 0.5  # [mm], of the machine xy
PLATE = math.inf  # [mm], a face under which a whole bead is flat


def line(length=100.0, angle=0.0, start=(-50.0, 0.0)):
    return ArcChain(start, angle, [0.0], [length])


def spiral(pitch, radius=30.0, turns=2.5):
    return Involute(radius, pitch, turns, start=(-radius, 0.0))


def laid(machine, path, dispenser=None, speed=SPEED, on=None, wait=0.0, settings=None, face=PLATE, **bead):
    """The bead of a perfect follower along a path at constant speed; `on` are the times between which it dispenses."""
    setpoints = Setpoints.along(path, speed, PERIOD).wait(wait)
    if on is not None:
        dispense = (setpoints.time > on[0] - 1e-9) & (setpoints.time < on[1] - 1e-9)
        setpoints = replace(setpoints, dispense=dispense)
    run = perfect_follower(machine, setpoints, dispenser=dispenser or Dispenser(flow=AREA * speed))
    return Bead(replace(run, face=face), settings or BeadSettings(**bead))


def away_from_ends(bead, reach=10.0):
    """Stations at least so far from both ends [mm], (r,)."""
    return (bead.place > reach) & (bead.place < bead.place[-1] - reach)


def volume_of(bead):
    """Volume of the sections along the trace: the trapezoidal sum."""
    return np.trapezoid(bead.area, bead.place)
