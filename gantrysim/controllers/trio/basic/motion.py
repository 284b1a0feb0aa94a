"""The motion generator: the axes of the controller, their buffers of moves, and one servo period of motion."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.controllers.trio.basic.axis import Axis
from gantrysim.controllers.trio.basic.links import follow
from gantrysim.controllers.trio.basic.moves import CONNECT, STATED, Move, Straight
from gantrysim.controllers.trio.basic.profile import Glide, Speed

MOST_AXES = 64  # numbers of axes: 0 to 63
MOST_MOVES = 200_000
FARTHEST = 1e12  # position of an axis, still exact to 0.0002 [units]
_FEWEST = 8  # periods that take longer one by one than at once


class Motion:
    """All axes, stepped together.

    Within a period every axis follows its link axis' motion of the same period, whatever their numbers.

    Args:
        period: servo period [s].
        starts: positions of axes at the beginning by their numbers, else 0 [units].
        speed, acceleration, deceleration: of an axis until the program sets them.
        buffers: moves that an axis holds besides the one it executes.
        real: numbers of the axes with a drive, which must be enabled.
        ratio_bits: fractional bits of CONNECT's ratio, None for an exact one.
    """

    def __init__(
        self,
        period: float,
        starts: dict[int, float],
        speed: float,
        acceleration: float,
        deceleration: float,
        buffers: int,
        real: tuple[int, ...],
        ratio_bits: int | None,
    ) -> None:
        self.period = period
        self.buffers = buffers
        self.real = real
        self._bits = ratio_bits
        self._starts = starts
        self._defaults = (float(speed), float(acceleration), float(deceleration))
        self.axes: dict[int, Axis] = {}
        self.loaded: list[Move] = []  # those of STATED
        self.drivers: set[int] = set()  # axes that others were linked to
        self.unstated: set[int] = set()  # axes with other motions than those of STATED
        self.enabled = True

    def axis(self, number: float) -> Axis:
        """Return an axis by its number."""
        n = int(number)
        if n not in self.axes:
            if n != number or not 0 <= n < MOST_AXES:
                raise InputError(f"axis {number:g}: must be a whole number from 0 to {MOST_AXES - 1}")
            self.axes[n] = Axis(n, self._starts.get(n, 0.0), *self._defaults)
        return self.axes[n]

    @property
    def idle(self) -> bool:
        return all(axis.idle for axis in self.axes.values())

    def resting(self, numbers: tuple[int, ...]) -> bool:
        """Whether these axes stay where they are: idle, or linked to axes that do."""
        return all(self._rests(self.axes[n]) for n in numbers if n in self.axes)

    def _rests(self, axis: Axis) -> bool:
        if axis.superimposed is not None and not self._rests(self.axes[axis.superimposed]):
            return False
        move = axis.member
        if move is None or move.profiled:
            return axis.idle
        return self._rests(self.axis(move.driver or 0))

    def order(self, move: Move) -> bool:
        """Hand a move to its axis; return False where the buffer is full."""
        base = self.axis(move.axes[0])
        if move.driver is not None:
            self._check_link(move.axes[0], move.driver)
            self.drivers.add(move.driver)
        running = base.move
        if move.kind == CONNECT and running is not None and running.kind == CONNECT:
            self._load(base, move)
            return True
        if self._free(move) and not base.queue:
            self._load(base, move)
            return True
        if len(base.queue) >= self.buffers:
            return False
        base.queue.append(move)
        return True

    def superimpose(self, number: int, added: int | None) -> None:
        """Run ADDAX: add the motion of an axis to that of another, None to end it."""
        if added is not None:
            self._check_link(number, added)
            self.drivers.add(added)
            self.unstated.add(number)
        self.axis(number).superimposed = added

    def _check_link(self, number: int, driver: int) -> None:
        waiting = [driver]
        seen = set()
        while waiting:
            n = waiting.pop()
            if n == number:
                raise InputError(f"axis {number} would follow itself through axis {driver}: links must have no circle")
            if n not in seen:
                axis = self.axis(n)
                links = [move.driver for move in (axis.member, *axis.queue) if move is not None]
                waiting += [link for link in (*links, axis.superimposed) if link is not None]
                seen.add(n)

    def cancel(self, number: int, mode: int) -> None:
        """Cancel the executing move (mode 0), the buffered ones (1), or both (2)."""
        axis = self.axis(number)
        if mode in (1, 2):
            axis.queue.clear()
        if mode in (0, 2) and axis.member is not None:
            base = self.axis(axis.member.axes[0])
            if axis.member.profiled and base.along.value > 0 and math.isfinite(base.deceleration):
                axis.member.stopping = True
            else:
                self._end(base)

    def stop_all(self, mode: int) -> None:
        """Cancel on all axes at once."""
        holders = [axis.number for axis in self.axes.values() if axis.move is not None]
        if mode in (1, 2):
            for axis in self.axes.values():
                axis.queue.clear()
        if mode in (0, 2):
            for number in holders:
                self.cancel(number, 0)

    def _free(self, move: Move) -> bool:
        return all(self.axis(n).member is None for n in move.axes)

    def _load(self, base: Axis, move: Move, start: tuple[float, ...] | None = None) -> None:
        axes = [self.axis(n) for n in move.axes]
        move.start = tuple(axis.position for axis in axes) if start is None else start
        self._aim(move, move.start)
        move.at = (0.0,) * len(axes)
        if move.kind == CONNECT and self._bits is not None:
            move.ratio = round(move.ratio * 2.0**self._bits) / 2.0**self._bits
        if move.link_start is not None:
            link = self.axis(move.driver or 0)
            move.s = link.position - link.zero - move.link_start
            if move.s > 0:
                raise InputError(
                    f"line {move.line}: axis {link.number} is {move.s:g} past the link position: must be before it"
                )
        base.move = move
        for axis in axes:
            axis.member = move
        if move.kind in STATED:
            move.beside = tuple(axis.number for axis in self.axes.values() if axis.member not in (None, move))
            self.loaded.append(move)
            if len(self.loaded) > MOST_MOVES:
                raise InputError(f"line {move.line}: more than {MOST_MOVES} moves are run: must be fewer")
        else:
            self.unstated.update(move.axes)

    def _aim(self, move: Move, start: tuple[float, ...]) -> None:
        """Give a MOVEABS the shape that follows from where it starts."""
        if move.targets is not None:
            goals = (self.axis(n).zero + target for n, target in zip(move.axes, move.targets, strict=True))
            try:
                move.shape = Straight(tuple(goal - at for goal, at in zip(goals, start, strict=True)))
            except InputError as error:
                raise InputError(f"line {move.line}: {error}") from None

    def _end(self, base: Axis) -> None:
        """End the move that an axis holds, and load the next one."""
        if base.move is not None:
            for n in base.move.axes:
                self.axes[n].member = None
        base.move = None
        base.along = Speed()
        self._load_next(base)

    def _load_next(self, base: Axis) -> None:
        if base.move is None and base.queue and self._free(base.queue[0]):
            self._load(base, base.queue.pop(0))

    def step(self) -> None:
        """Move all axes for a servo period."""
        axes = list(self.axes.values())
        for axis in axes:
            self._load_next(axis)
        steps = dict.fromkeys(self.axes, 0.0)
        linked = {axis.number: axis.move for axis in axes if axis.move is not None and not axis.move.profiled}
        for axis in axes:
            if axis.move is not None and axis.move.profiled:
                self._advance(axis, axis.move, steps)
        if linked or any(axis.superimposed is not None for axis in axes):
            follow(self.axes, linked, steps, self._end)
        for axis in axes:
            axis.step = step = steps[axis.number]
            if step:
                axis.position += step
                axis.moved = True
                self._check(axis)

    def glide(self, most: int, recorded: tuple[int, ...]) -> Floats:
        """Move all axes for the periods, at most `most`, in which no move begins or ends, each to the same last bit.

        Returns the positions of the axes `recorded` after each of them, (n, recorded) [units]; n is 0 where such a
        period is next, where an axis is linked, has its move cancelled or its drive off, and for a few periods.
        """
        axes = self.axes.values()
        if most < _FEWEST or not all(self._steady(axis) for axis in axes):
            return np.empty((0, len(recorded)))
        glides = [(axis, axis.move, self._glide(axis, axis.move, most)) for axis in axes if axis.move is not None]
        count = min((len(glide.s) for _, _, glide in glides), default=most)
        positions = np.empty((count, len(recorded)))
        positions[:] = [self.axes[n].position for n in recorded]
        if count == 0:
            return positions
        for axis in axes:
            axis.step = 0.0
        for base, move, glide in glides:
            moved = [self.axes[n] for n in move.axes]
            at, sums = np.empty((2, count + 1, len(moved)))
            at[0], at[1:] = move.at, move.shape.displacements(glide.s[:count])
            steps = at[1:] - at[:-1]
            sums[0], sums[1:] = [axis.position for axis in moved], steps
            places = sums.cumsum(axis=0)[1:]
            base.along = Speed(float(glide.speed[count - 1]), bool(glide.braking[count - 1]))
            move.s = float(glide.s[count - 1])
            move.at = tuple(at[-1].tolist())
            for k, axis in enumerate(moved):
                axis.step = float(steps[-1, k])
                axis.position = float(places[-1, k])
                axis.moved = axis.moved or bool(steps[:, k].any())
                self._check(axis)
                if axis.number in recorded:
                    positions[:, recorded.index(axis.number)] = places[:, k]
        return positions

    def _steady(self, axis: Axis) -> bool:
        """Whether no move begins on an axis in the next period, and the one that moves it has a profile."""
        begins = axis.move is None and axis.queue and self._free(axis.queue[0])
        off = axis.number in self.real and not (axis.servo and self.enabled)
        if begins or off or axis.superimposed is not None:
            return False
        return axis.member is None or (axis.member.profiled and not axis.member.stopping)

    def _glide(self, base: Axis, move: Move, most: int) -> Glide:
        """Periods of a move by itself, until it ends or passes into the next."""
        lengths = np.array([move.shape.length, *self._merged_lengths(base, move)])
        down = base.deceleration if move.shape.brakes else math.inf
        return base.along.glide(move.s, lengths, base.speed, base.acceleration, down, self.period, most)

    def _check(self, axis: Axis) -> None:
        """Check an axis that has moved."""
        off = axis.number in self.real and not (axis.servo and self.enabled)
        if not off and abs(axis.position) <= FARTHEST:
            return
        where = "" if axis.member is None else f"line {axis.member.line}: "
        if off:
            switch = "WDOG" if axis.servo else f"SERVO AXIS({axis.number})"
            raise InputError(f"{where}axis {axis.number} is to move while {switch} = OFF: must be ON")
        raise InputError(f"{where}axis {axis.number} is at {axis.position:g}: must stay within {FARTHEST:g} units")

    def _merged(self, base: Axis, move: Move) -> Move | None:
        """The buffered move that follows a move without a stop, if any."""
        follows = base.queue[0] if base.merge and base.queue else None
        return follows if follows is not None and _merge(move, follows) else None

    def _merged_lengths(self, base: Axis, move: Move) -> Iterator[float]:
        """Lengths of the buffered moves up to the next stop."""
        if self._merged(base, move) is None:
            return
        place = _plus(move.start, move.shape.displacement(move.shape.length))
        for follows in base.queue:
            if not _merge(move, follows):
                break
            self._aim(follows, place)
            yield follows.shape.length
            place = _plus(place, follows.shape.displacement(follows.shape.length))

    def _advance(self, base: Axis, move: Move, steps: dict[int, float]) -> None:
        """Advance the move with a profile that an axis holds, and those merged with it."""
        left = move.shape.length - move.s
        speed = base.along
        for length in self._merged_lengths(base, move):
            left += length
        braked = move.shape.brakes or move.stopping
        down = base.deceleration if braked else math.inf
        gone = speed.advance(left, 0.0 if move.stopping else base.speed, base.acceleration, down, self.period)
        s = move.s + gone
        stopped = gone >= left
        while True:
            follows = self._merged(base, move)
            if follows is None and stopped:
                self._place(move, move.shape.length, steps)
                move.finished = True
                self._end(base)
                return
            if follows is None or s < move.shape.length:
                break
            self._place(move, move.shape.length, steps)
            move.finished = True
            follows.stopping = move.stopping
            s -= move.shape.length
            base.queue.pop(0)
            self._load(base, follows, tuple(self.axes[n].position + steps[n] for n in follows.axes))
            move = follows
        self._place(move, s, steps)
        if move.stopping and speed.value <= 0:
            self._end(base)

    def _place(self, move: Move, s: float, steps: dict[int, float]) -> None:
        at = move.shape.displacement(s) if move.shape.length > 0 else move.at
        for n, now, before in zip(move.axes, at, move.at, strict=True):
            steps[n] += now - before
        move.s = s
        move.at = at


def _merge(move: Move, follows: Move) -> bool:
    return follows.profiled and follows.axes == move.axes and move.shape.brakes and follows.shape.brakes


def _plus(a: tuple[float, ...], b: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(x + y for x, y in zip(a, b, strict=True))
