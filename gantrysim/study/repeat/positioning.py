"""Test of the positioning of a machine's linear axes, each approaching its targets from below and from above."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.engine.simulate import simulate
from gantrysim.job.job import Job
from gantrysim.machine.perturbation import Perturbation
from gantrysim.metrics import Positioning
from gantrysim.paths.chain import Chain
from gantrysim.paths.pieces import Line
from gantrysim.record.setpoints import Setpoints

CYCLES = 5
TARGETS = 11
_SHARE = 0.9  # of the travel that the targets span
_OVERRUN = 0.02  # of the travel, beyond the outer targets
# mean speed between targets, at most [mm/s], and of the axis' limit
_SPEED = 100.0
_SHARE_OF_LIMIT = 0.5
# of a motion and of a stop [s]
_SHORTEST = 0.2
_DWELL = 0.2
_GOLDEN = 0.6180339887498949


def linear_axes(job: Job) -> tuple[str, ...]:
    """Return the names of the axes in mm with a bounded travel."""
    return tuple(a.name for a in job.built_machine.axes if a.unit == "mm" and np.isfinite(a.travel).all())


def targets_of(travel: tuple[float, float]) -> Floats:
    """Return the targets, each at another place within its interval so that they meet all phases of a screw's turn."""
    low, high = travel
    edge = 0.5 * (1 - _SHARE) * (high - low)
    step = (high - low - 2 * edge) / TARGETS
    return low + edge + step * (np.arange(TARGETS) + (_GOLDEN * np.arange(TARGETS)) % 1.0)


def positioning(job: Job, axis: str, perturbations: Sequence[Perturbation]) -> Positioning:
    """Return the deviations of an axis with the others at zero, at the job's servo.

    Deviations are those of the nozzle from the commanded position, along the axis, at the end of a stop.

    Args:
        job: of the machine and servo.
        axis: name of one of `linear_axes`.
        perturbations: of the machine in each cycle.

    Raises:
        InputError: a cycle ends in a fault.
    """
    machine = job.built_machine
    servo = job.built_servo
    moved_axis = machine.axes[machine.axis_names.index(axis)]
    targets = targets_of(moved_axis.travel)
    over = _OVERRUN * (moved_axis.travel[1] - moved_axis.travel[0])
    # the outer targets too are approached from both sides
    ends = np.array([targets[0] - over, targets[-1] + over])
    stops = np.concatenate([ends[:1], targets, ends[1:], targets[::-1]])
    speed = min(_SPEED, _SHARE_OF_LIMIT * moved_axis.speed_limit)
    position, stopped = _motion(stops, speed, servo.period)
    named = {name: np.zeros(position.size) for name in machine.axis_names} | {axis: position}
    rows = np.stack(list(named.values()), axis=1)
    first, last = machine.tip(rows[stopped[[0, TARGETS + 1]]])
    along = (last - first) / np.linalg.norm(last - first)
    setpoints = Setpoints(
        period=servo.period,
        axes=machine.axis_names,
        position=rows,
        dispense=np.zeros(position.size, bool),
        requested=Chain([Line(tuple(first.tolist()), tuple(last.tolist()))]),
    )
    cycles = []  # deviations at all stops, in the order of the motion
    for perturbation in perturbations:
        run = simulate(machine.perturbed(perturbation), servo, setpoints, physics_step=job.simulation.physics_step)
        if run.fault is not None:
            raise InputError(f"positioning of {axis}: {run.fault}")
        cycles.append((run.nozzle[stopped] - run.commanded_tip[stopped]) @ along)
    deviation = np.array(cycles)
    return Positioning(targets, deviation[:, 1 : TARGETS + 1], deviation[:, TARGETS + 2 :][:, ::-1])


def _motion(stops: Floats, speed: float, period: float) -> tuple[Floats, Floats]:
    """Return positions that stop at some, and the index at the end of each stop.

    Between stops d apart they follow x = d (10 s^3 - 15 s^4 + 6 s^5) over the share s of the time.
    """
    pieces = [np.full(round(_DWELL / period), stops[0])]
    stopped = [pieces[0].size - 1]
    for begin, end in pairwise(stops.tolist()):
        count = max(round(max(abs(end - begin) / speed, _SHORTEST) / period), 1)
        s = np.arange(1, count + 1) / count
        pieces += [begin + (end - begin) * s**3 * (10 - 15 * s + 6 * s**2), np.full(round(_DWELL / period), end)]
        stopped.append(sum(piece.size for piece in pieces) - 1)
    return np.concatenate(pieces), np.array(stopped)
