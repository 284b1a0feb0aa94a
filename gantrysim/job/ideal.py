"""Setpoints with one imperfection removed: errors of the program's path, or the servo's sampling."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.memory import check_ticks
from gantrysim.engine.positions import axis_positions, program_positions
from gantrysim.machine.machine import Machine
from gantrysim.record.setpoints import Setpoints, periods
from gantrysim.servo.servo import Servo

# longest period of a servo whose sampling hardly matters; shorter ones amplify the encoder's counts [s]
FINE_PERIOD = 62.5e-6

_ON_THE_PATH = 1e-9  # largest distance of a command that needs no correction [mm]
_FOOT_SPEED = 1.5  # largest speed of a foot, in units of the command's own


def on_the_path(machine: Machine, setpoints: Setpoints) -> Setpoints:
    """Return setpoints whose commanded positions are moved onto the requested path while the dispenser is on.

    A position moves to its foot on the path, so that the progress stays that of the command; the slides move it, rotary
    axes keep their angles. Where the foot jumps, as it does across a corner that the command rounds, the jump is spread
    over the time around it. While the dispenser is off, the correction is interpolated, so that the command does not
    jump. Setpoints that are on the path are returned as they are.

    Args:
        machine: the machine, with the axes of the setpoints.
        setpoints: commanded positions.
    """
    kinematics = machine.kinematics
    position = program_positions(machine, setpoints).copy()
    tip = machine.tip(kinematics.inverse(position))
    on = np.flatnonzero(setpoints.dispense)
    foot = setpoints.requested.follow(tip[on], None if setpoints.progress is None else setpoints.progress[on])
    if foot.distance.max() < _ON_THE_PATH:
        return setpoints
    spans = np.split(np.arange(on.size), np.flatnonzero(np.diff(on) > 1) + 1)
    places = np.concatenate([unhurried_feet(foot.s[span], tip[on[span]]) for span in spans])
    correction = setpoints.requested.position(places) - tip[on]
    progress = setpoints.progress
    if progress is not None:
        progress = progress.copy()
        progress[on] = places
        progress = np.maximum.accumulate(np.clip(progress, 0.0, setpoints.requested.length))
    shift = np.stack([np.interp(np.arange(len(tip)), on, component) for component in correction.T], axis=1)
    slides = [
        k for k, along in enumerate(kinematics.coordinates) if along.unit == "mm" and along.name in setpoints.axes
    ]
    if kinematics.axes_are_coordinates:
        # at given angles of the rotary axes the nozzle's position in the work frame is linear in the slides
        moved = [machine.tip(position + unit) - tip for unit in np.eye(position.shape[1])[slides]]
    else:  # x, y and z are the nozzle's
        moved = [np.tile(np.eye(3)["xyz".index(kinematics.names[k])], (len(tip), 1)) for k in slides]
    position[:, slides] += np.einsum("nai,ni->na", np.linalg.pinv(np.stack(moved, axis=2)), shift)
    columns = [kinematics.names.index(name) for name in setpoints.axes]
    return replace(setpoints, position=position[:, columns], progress=progress)


def unhurried_feet(s: Floats, tip: Floats) -> Floats:
    """Return the mean of the latest and the earliest feet that advance at most `_FOOT_SPEED` times as fast as the tip.

    Args:
        s: arc lengths of the feet, (n,) [mm].
        tip: commanded positions of the nozzle, (n, 3) [mm].
    """
    furthest = _FOOT_SPEED * np.append(0.0, np.cumsum(np.linalg.norm(np.diff(tip, axis=0), axis=1)))
    ahead = s - furthest
    latest = np.minimum.accumulate(ahead)
    earliest = np.maximum.accumulate(ahead[::-1])[::-1]
    return furthest + 0.5 * (latest + earliest)


def finely_sampled(machine: Machine, servo: Servo, setpoints: Setpoints) -> tuple[Servo, Setpoints]:
    """Return servo and setpoints at a period of at most `FINE`, a whole fraction of theirs, without the servo's delays.

    A servo whose drives close loops themselves is sampled as often as they are.
    The gains are those of the continuous law. The command is a cubic spline through the setpoints, at rest before the
    first and after the last: velocity and acceleration, from which the feed-forward comes, are continuous, where those
    of a staircase or a polyline would be pulses as high as the period is short. It is a straight line where the spline
    would exceed the machine's speed limit, and keeps within its travel. The dispenser is on between two setpoints at
    which it is on.
    """
    n = periods(servo.period, max(FINE_PERIOD, servo.inner_period))
    check_ticks(
        n * len(setpoints.position), f"the run with a servo period of {servo.period / n:g} s", "use a shorter program"
    )
    # travel and speed are limits of the axes
    if not machine.kinematics.axes_are_coordinates:
        setpoints = replace(setpoints, axes=machine.axis_names, position=axis_positions(machine, setpoints))
    period = servo.period / n
    knots = setpoints.position
    axes = [machine.axes[machine.axis_names.index(name)] for name in setpoints.axes]
    low, high = np.array([axis.travel for axis in axes]).T
    limit = np.array([axis.speed_limit for axis in axes])
    tick = np.arange((len(knots) - 1) * n + 1) / n
    position = spline_through(knots, n)
    line = np.stack([np.interp(tick, np.arange(len(knots)), knot) for knot in knots.T], axis=1)
    speed = np.abs(np.diff(position, axis=0)).reshape(-1, n, len(axes)).max(axis=1) / period
    position[:-1] = np.where(np.repeat(speed > limit, n, axis=0), line[:-1], position[:-1])
    position[::n] = knots
    dispense = np.append(np.repeat(setpoints.dispense[:-1] & setpoints.dispense[1:], n), False)
    dispense[::n] = setpoints.dispense
    delay = n * setpoints.supervision.position_error_delay
    fine = Setpoints(
        period=period,
        axes=setpoints.axes,
        position=np.clip(position, low, high),
        dispense=dispense,
        requested=setpoints.requested,
        supervision=replace(setpoints.supervision, position_error_delay=delay),
        gates=n * setpoints.gates,
        torque=None if setpoints.torque is None else np.repeat(setpoints.torque, n, axis=0)[: len(position)],
        progress=None if setpoints.progress is None else np.interp(tick, np.arange(len(knots)), setpoints.progress),
        **{name: np.interp(tick, np.arange(len(knots)), fed) for name, fed in setpoints.material.items()},
    )
    inner = min(period, servo.drive_period) if servo.inner_period else servo.drive_period
    return replace(servo, period=period, delay=0.0, feedback_delay=0, drive_period=inner), fine


def spline_through(knots: Floats, n: int) -> Floats:
    """Return a cubic spline through knots at equal distances, at rest at both ends, at n points per interval.

    Its slopes m follow from the continuity of the second derivative: m[k-1] + 4 m[k] + m[k+1] = 3 (y[k+1] - y[k-1]).
    SciPy's CubicSpline gives the same, but its import takes longer than most of the runs that need one.

    Args:
        knots: values y, (k, axes).
        n: number of points per interval, the knot at its start included.

    Returns:
        Values, ((k - 1) n + 1, axes).
    """
    from scipy.linalg import solve_banded  # slow to import

    slope = np.zeros_like(knots)
    inner = len(knots) - 2
    if inner > 0:
        bands = np.tile([[1.0], [4.0], [1.0]], (1, inner))
        slope[1:-1] = solve_banded((1, 1), bands, 3 * (knots[2:] - knots[:-2]))
    u = (np.arange(n) / n)[:, None]
    # Hermite's basis on an interval of length 1
    values = (
        (1 + 2 * u) * (1 - u) ** 2 * knots[:-1, None]
        + u * (1 - u) ** 2 * slope[:-1, None]
        + u**2 * (3 - 2 * u) * knots[1:, None]
        + u**2 * (u - 1) * slope[1:, None]
    )
    return np.concatenate([values.reshape(-1, knots.shape[1]), knots[-1:]])
