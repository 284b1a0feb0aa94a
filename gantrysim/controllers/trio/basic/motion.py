"""The motion generator: one servo period of motion of all axes, or many at once."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise, takewhile

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.base.jit import jit
from gantrysim.controllers.trio.basic.buffers import Axis, Buffers
from gantrysim.controllers.trio.basic.moves import CONNECT, Arc, Move, Shape, Straight
from gantrysim.controllers.trio.basic.profile import Speed

# Linked axes: how far CONNECT, ADDAX, CAMBOX and MOVELINK move an axis when others move.

End = Callable[[Axis], None]


def follow(axes: dict[int, Axis], linked: dict[int, Move], steps: dict[int, float], end: End) -> None:
    """Add the motion of linked axes within a period.

    Args:
        axes: by their numbers.
        linked: moves linked to another axis at the beginning of the period, by the numbers of their axes.
        steps: of the axes with a profile, to which those of the others are added [units].
        end: ends the move of an axis, and loads the next.
    """
    done: set[int] = set()

    def total(axis: Axis) -> float:
        if axis.number not in done:
            done.add(axis.number)
            move = linked.get(axis.number)
            if move is not None and move.driver is not None:
                link = axes[move.driver]
                steps[axis.number] += _linked_motion(axis, move, total(link), link.units / axis.units, end)
            if axis.superimposed is not None:
                added = axes[axis.superimposed]
                steps[axis.number] += total(added) * added.units / axis.units
        return steps[axis.number]

    for axis in axes.values():
        total(axis)


def _linked_motion(axis: Axis, move: Move, driven: float, edges: float, end: End) -> float:
    """Motion of a linked axis, given that of its link axis, and the ratio of their UNITS."""
    if move.kind == CONNECT:
        return move.ratio * driven * edges
    s = move.s + (max(driven, 0.0) if move.forward_only else driven)
    step = 0.0
    while move.link_start is None or s >= 0:
        move.link_start = None
        full = move.shape.length
        if move.repeats:
            rounds = math.floor(s / full)
            step += rounds * move.shape.displacement(full)[0]
            s -= rounds * full
        if s < full:
            break
        step += move.shape.displacement(full)[0] - move.displaced[0]
        move.finished = True
        move.s = full
        follows = axis.queue[0] if axis.queue else None
        end(axis)
        if axis.move is None or axis.move is not follows or follows.driver != move.driver or follows.kind == CONNECT:
            return step
        # nothing of the link axis' motion is lost
        s = s - full
        move = follows
        move.start = (axis.position + step,)
    displaced = move.shape.displacement(s)
    step += displaced[0] - move.displaced[0]
    move.s = s
    move.displaced = displaced
    return step


# Speeds along merged moves: what limits them on a circle, at a corner, and where one SP move joins the next.


def speed_along(move: Move, speed: float) -> float:
    """Return the speed of a move along its path, given SPEED of its axis [units/s]."""
    programmed = _programmed_speed(move, speed)
    if isinstance(move.shape, Arc):
        return programmed * move.corners.share_on_circle(move.shape.radius)
    return programmed


def joint_speed(before: Move, after: Move, speed: float) -> float:
    """Return the largest speed where two merged moves join, inf for no limit, given SPEED of their axis [units/s].

    It is the least of ENDMOVE_SPEED of the first, STARTMOVE_SPEED of the second, the lower of their speeds reduced for
    the corner, and the speed on a small circle, which holds from its first point to its last.
    """
    limits = [math.inf]
    if before.speeds is not None:
        limits.append(before.speeds.end)
    if after.speeds is not None:
        limits.append(after.speeds.start)
    share = after.corners.share_at_corner(angle_between(before.shape, after.shape))
    if share < 1:
        limits.append(share * min(_programmed_speed(before, speed), _programmed_speed(after, speed)))
    for move in (before, after):
        along = speed_along(move, speed)
        if along < _programmed_speed(move, speed):
            limits.append(along)
    return min(limits)


def distance_to_stop(chain: Sequence[Move], speed: float, deceleration: float) -> float:
    """Return the distance from the start of merged moves at which braking from now on would bring them to rest.

    Braking with DECEL reaches a joint at its speed v just where it would stop at v^2 / (2 DECEL) beyond the joint: the
    nearest of these places, and the end of the last move, is where the profile has to be able to stop.

    Args:
        chain: moves that follow one another without a stop, the first of which runs.
        speed: SPEED of their axis [units/s].
        deceleration: DECEL, inf for no limit: joints then need no way to brake [units/s²].
    """
    distance = chain[0].shape.length
    stops = []
    for before, after in pairwise(chain):
        limit = joint_speed(before, after, speed)
        if math.isfinite(limit) and math.isfinite(deceleration):
            stops.append(distance + 0.5 * limit**2 / deceleration)
        distance += after.shape.length
    return min([*stops, distance])


def angle_between(before: Shape, after: Shape) -> float:
    """Return the change of direction where one path ends and the next begins [rad], 0 where one has no direction."""
    first = direction(before, before.length)
    second = direction(after, 0.0)
    if first is None or second is None:
        return 0.0
    # exact for small angles and for those near pi
    return 2 * math.atan2(math.dist(first, second), math.hypot(*(a + b for a, b in zip(first, second, strict=True))))


def direction(shape: Shape, s: float) -> tuple[float, ...] | None:
    """Return the unit vector along a path at the distance s, None for a path without a length."""
    if isinstance(shape, Arc):
        psi = shape.begin + (-1 if shape.clockwise else 1) * shape.angle * min(s / shape.length, 1.0)
        turn = -shape.angle if shape.clockwise else shape.angle
        plane = (-turn * shape.radius * math.sin(psi), turn * shape.radius * math.cos(psi))
        vector: tuple[float, ...] = plane if shape.rise is None else (*plane, shape.rise)
    elif isinstance(shape, Straight) and shape.length > 0:
        vector = shape.deltas
    else:
        return None
    length = math.hypot(*vector)
    return tuple(component / length for component in vector)


def _programmed_speed(move: Move, speed: float) -> float:
    if move.speeds is None or move.speeds.force is None:
        return speed
    return move.speeds.force


FARTHEST_POSITION = 1e12  # position of an axis, still exact to 0.0002 [units]
_PERIODS_AT_ONCE = 8  # periods that take longer one by one than at once


class Motion(Buffers):
    """All axes, stepped together.

    Within a period every axis follows its link axis' motion of the same period, whatever their numbers.
    """

    def step(self) -> None:
        """Move all axes for a servo period."""
        axes = list(self.axes.values())
        for axis in axes:
            self._load_next(axis)
        steps = dict.fromkeys(self.axes, 0.0)
        self._ended = []
        linked: dict[int, Move] = {}
        is_superimposed = False
        for axis in axes:
            is_superimposed |= axis.superimposed is not None
            if axis.move is not None and axis.move.has_profile:
                self._advance(axis, axis.move, steps)
            elif axis.move is not None:
                linked[axis.number] = axis.move
        if linked or is_superimposed:
            follow(self.axes, linked, steps, self._end_link)
        for axis in axes:
            axis.step = steps[axis.number]
            if axis.step:
                axis.position += axis.step
                axis.moved = True
                self._check(axis)
        # not before all axes are where the period ends: a MOVEABS starts from there
        for axis in self._ended:
            self._load_next(axis)

    def _end_path(self, base: Axis) -> None:
        """End a move within a period; the next one is loaded at its end."""
        self._release(base)
        self._ended.append(base)

    def _end_link(self, axis: Axis) -> None:
        """End a linked move within a period; one with the same link axis goes on in it, others at its end."""
        driver = None if axis.move is None else axis.move.driver
        self._end_path(axis)
        if axis.queue and axis.queue[0].driver == driver and axis.queue[0].kind != CONNECT:
            self._load_next(axis)

    def glide(self, most: int, recorded: tuple[int, ...]) -> Floats:
        """Move all axes for the periods, at most `most`, in which no move begins or ends, each to the same last bit.

        Returns the positions of the axes `recorded` after each of them, (n, recorded) [units]; n is 0 where such a
        period is next, where an axis is linked, has its move cancelled or its drive off, and for a few periods.
        """
        axes = self.axes.values()
        if most < _PERIODS_AT_ONCE or not all(map(self._steady, axes)):
            return np.empty((0, len(recorded)))
        moves = [(axis, axis.move) for axis in axes if axis.move is not None]
        glides = [self._glide(base, move, most) for base, move in moves]
        # the speeds of all at the end of the shortest
        if len(glides) > 1:
            count = min(len(s) for s, _ in glides)
            glides = [self._glide(base, move, count) for base, move in moves]
        count = len(glides[0][0]) if glides else most
        positions = np.empty((count, len(recorded)))
        if count == 0:
            return positions
        columns: dict[int, Floats] = {}
        for axis in axes:
            axis.step = 0.0
        for (base, move), (s, speed) in zip(moves, glides, strict=True):
            moved = [self.axes[n] for n in move.axes]
            places = self._run_along(move, moved, s)
            base.along = speed
            for axis, column in zip(moved, places, strict=True):
                self._check(axis)
                columns[axis.number] = column
        for k, n in enumerate(recorded):
            positions[:, k] = columns[n] if n in columns else self.axes[n].position
        return positions

    def _run_along(self, move: Move, moved: list[Axis], s: Floats) -> Floats:
        """Advance the axes of a move to the distances s; return their positions there, (axes, n) [units]."""
        places = move.shape.displacements(s)
        displaced = []
        for axis, column, before in zip(moved, places, move.displaced, strict=True):
            axis.moved = axis.moved or bool((column != before).any())
            last, axis.position, axis.step = _add_steps(column, before, axis.position)
            displaced.append(last)
        move.s = float(s[-1])
        move.displaced = tuple(displaced)
        return places

    def _steady(self, axis: Axis) -> bool:
        """Whether no move begins on an axis in the next period, and the one that moves it has a profile."""
        if self._can_begin(axis) or self._is_off(axis) or axis.superimposed is not None:
            return False
        return axis.member is None or (axis.member.has_profile and not axis.member.stopping)

    def _is_off(self, axis: Axis) -> bool:
        """Whether the axis has a drive, and that is not enabled."""
        return axis.number in self._settings.real and not (axis.servo and self.enabled)

    def _glide(self, base: Axis, move: Move, most: int) -> tuple[Floats, Speed]:
        """Return the distances that a move covers by itself, until it ends or passes into the next, and its speed."""
        down = base.deceleration if move.shape.brakes else math.inf
        speed = base.speed
        followers = self._followers(base, move)
        lengths = [move.shape.length, *[follower.shape.length for follower in followers]]
        if self._has_limits(base, move, followers):
            speed = speed_along(move, base.speed)
            stop = distance_to_stop([move, *followers], base.speed, down)
            lengths = [move.shape.length, stop - move.shape.length]
        return base.along.glide(move.s, np.array(lengths), (speed, base.acceleration, down, self.period), most)

    def _check(self, axis: Axis) -> None:
        """Check an axis that has moved."""
        off = self._is_off(axis)
        if not off and abs(axis.position) <= FARTHEST_POSITION:
            return
        where = "" if axis.member is None else f"line {axis.member.line}: "
        if off:
            switch = "WDOG" if axis.servo else f"SERVO AXIS({axis.number})"
            raise InputError(f"{where}axis {axis.number} is to move while {switch} = OFF: must be ON")
        raise InputError(
            f"{where}axis {axis.number} is at {axis.position:g}: must stay within {FARTHEST_POSITION:g} units"
        )

    def _followers(self, base: Axis, move: Move) -> list[Move]:
        """The buffered moves after a move up to the next end of the merged path."""
        if not base.merge:
            return []
        followers = list(takewhile(partial(_merge, move), base.queue))
        if any(follows.targets is not None for follows in followers):
            place = _plus(move.start, move.shape.displacement(move.shape.length))
            for follows in followers:
                self._aim(follows, place)
                place = _plus(place, follows.shape.displacement(follows.shape.length))
        return followers

    def _has_limits(self, base: Axis, move: Move, followers: list[Move]) -> bool:
        """Whether more than SPEED may limit the speed of a move and of those merged with it."""
        return move.has_limits or (bool(followers) and any(follows.has_limits for follows in base.queue))

    def _advance_with_limits(self, base: Axis, move: Move, steps: dict[int, float]) -> None:
        """Advance moves with speeds of their own, joint by joint within the period."""
        speed = base.along
        time_left = self.period
        while True:
            chain = [move, *self._followers(base, move)]
            down = base.deceleration
            remaining = distance_to_stop(chain, base.speed, down) - move.s
            target = 0.0 if move.stopping else speed_along(move, base.speed)
            to_joint = move.shape.length - move.s if len(chain) > 1 else math.inf
            rates = (target, base.acceleration, down, time_left)
            distance, time_left = speed.advance_to(to_joint, remaining, rates)
            if len(chain) == 1 and distance >= remaining:
                self._place(move, move.shape.length, steps)
                move.finished = True
                self._end_path(base)
                return
            if len(chain) == 1 or distance < to_joint:
                self._place(move, move.s + distance, steps)
                break
            follows = chain[1]
            if math.isinf(down):
                speed.value = min(speed.value, joint_speed(move, follows, base.speed))
            self._place(move, move.shape.length, steps)
            self._pass_on(base, move, follows, steps)
            move = follows
        if move.stopping and speed.value <= 0:
            self._end_path(base)

    def _pass_on(self, base: Axis, move: Move, follows: Move, steps: dict[int, float]) -> None:
        """End a move at its place, and load the merged one in the same period."""
        move.finished = True
        follows.stopping = move.stopping
        base.queue.pop(0)
        self._load(base, follows, tuple(self.axes[n].position + steps[n] for n in follows.axes))

    def _advance(self, base: Axis, move: Move, steps: dict[int, float]) -> None:
        """Advance the move with a profile that an axis holds, and those merged with it."""
        followers = self._followers(base, move)
        if self._has_limits(base, move, followers):
            self._advance_with_limits(base, move, steps)
            return
        remaining = move.shape.length - move.s
        speed = base.along
        for follower in followers:
            remaining += follower.shape.length
        braked = move.shape.brakes or move.stopping
        down = base.deceleration if braked else math.inf
        target = 0.0 if move.stopping else base.speed
        distance = speed.advance(remaining, (target, base.acceleration, down, self.period))
        s = move.s + distance
        for follows in followers:
            if s < move.shape.length:
                break
            self._place(move, move.shape.length, steps)
            s -= move.shape.length
            self._pass_on(base, move, follows, steps)
            move = follows
        else:  # the last move of the path
            if distance >= remaining:
                self._place(move, move.shape.length, steps)
                move.finished = True
                self._end_path(base)
                return
        self._place(move, s, steps)
        if move.stopping and speed.value <= 0:
            self._end_path(base)

    def _place(self, move: Move, s: float, steps: dict[int, float]) -> None:
        displaced = move.shape.displacement(s) if move.shape.length > 0 else move.displaced
        for n, now, before in zip(move.axes, displaced, move.displaced, strict=True):
            steps[n] += now - before
        move.s = s
        move.displaced = displaced


@jit
def _add_steps(column: Floats, before: float, place: float) -> tuple[float, float, float]:
    """Write an axis' positions over its displacements, each by the step to it, as `Motion.step` adds them.

    Args:
        column: displacements, then positions, (n,) [units].
        before: displacement before them [units].
        place: position there [units].

    Returns:
        The last displacement, position and step [units].
    """
    step = 0.0
    for k in range(column.size):
        step = column[k] - before
        before = column[k]
        place += step
        column[k] = place
    return before, place, step


def _merge(move: Move, follows: Move) -> bool:
    return follows.has_profile and follows.axes == move.axes and move.shape.brakes and follows.shape.brakes


def _plus(a: tuple[float, ...], b: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(x + y for x, y in zip(a, b, strict=True))
