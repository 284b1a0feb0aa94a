"""The axes of the controller and their buffers of moves: what is ordered, loaded, linked and cancelled."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from gantrysim.base.errors import InputError
from gantrysim.controllers.trio.basic.moves import (
    CONNECT,
    FULL_SPEED,
    IDLE,
    STATED_MOVES,
    CornerRules,
    Move,
    MoveSpeeds,
    Straight,
)
from gantrysim.controllers.trio.basic.profile import Speed

MOST_AXES = 64  # numbers of axes: 0 to 63
MOST_MOVES = 200_000


@dataclass(frozen=True)
class MotionSettings:
    """Settings of the motion generator.

    Attributes:
        period: servo period [s].
        starts: positions of axes at the beginning by their numbers, else 0 [units].
        speed: of an axis until the program sets it [units/s].
        acceleration: of an axis, and its deceleration, until the program sets them [units/s²].
        buffers: moves that an axis holds besides the one it executes.
        real: numbers of the axes with a drive, which must be enabled.
        ratio_bits: fractional bits of CONNECT's ratio, None for an exact one.
    """

    period: float
    starts: dict[int, float]
    speed: float
    acceleration: float
    buffers: int
    real: tuple[int, ...]
    ratio_bits: int | None


class Buffers:
    """All axes with the moves that they hold.

    Attributes:
        axes: those that programs have named, by number.
        loaded: moves that state their path, in the order in which they began.
        drivers: axes that others were linked to.
        unstated: axes with other moves than those that state their path.
        enabled: whether WDOG is on.
        buffers: moves that an axis holds besides the one it executes.
    """

    def __init__(self, settings: MotionSettings) -> None:
        self.period = settings.period
        self.axes: dict[int, Axis] = {}
        self.loaded: list[Move] = []
        self.drivers: set[int] = set()
        self.unstated: set[int] = set()
        self.enabled = True
        self.buffers = settings.buffers
        self._settings = settings
        # whose move has ended in the period that runs
        self._ended: list[Axis] = []

    def axis(self, number: float) -> Axis:
        """Return an axis by its number."""
        n = int(number)
        if n != number or not 0 <= n < MOST_AXES:
            raise InputError(f"axis {number:g}: must be a whole number from 0 to {MOST_AXES - 1}")
        if n not in self.axes:
            settings = self._settings
            speed = float(settings.speed)
            acceleration = float(settings.acceleration)
            self.axes[n] = Axis(n, settings.starts.get(n, 0.0), speed, acceleration, acceleration)
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
        if move is None or move.has_profile:
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
            if axis.member.has_profile and base.along.value > 0 and math.isfinite(base.deceleration):
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

    def wind_down(self) -> None:
        """Empty the buffers and slow down the axes with a profile; linked axes follow them to rest."""
        for axis in self.axes.values():
            axis.queue.clear()
        for axis in self.axes.values():
            if axis.move is not None and axis.move.has_profile:
                self.cancel(axis.number, 0)

    def _free(self, move: Move) -> bool:
        return all(self.axis(n).member is None for n in move.axes)

    def _load(self, base: Axis, move: Move, start: tuple[float, ...] | None = None) -> None:
        """Begin a move, where its axes are or at a start that they reach in this period."""
        axes = [self.axis(n) for n in move.axes]
        move.start = tuple(axis.position for axis in axes) if start is None else start
        self._aim(move, move.start)
        move.displaced = (0.0,) * len(axes)
        bits = self._settings.ratio_bits
        if move.kind == CONNECT and bits is not None:
            move.ratio = round(move.ratio * 2.0**bits) / 2.0**bits
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
        if move.kind in STATED_MOVES:
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
                move.shape = Straight(tuple(goal - place for goal, place in zip(goals, start, strict=True)))
            except InputError as error:
                raise InputError(f"line {move.line}: {error}") from None

    def _end(self, base: Axis) -> None:
        """End the move that an axis holds, and load the next one, between two periods."""
        self._release(base)
        self._load_next(base)

    def _release(self, base: Axis) -> None:
        """End the move that an axis holds."""
        if base.move is not None:
            for n in base.move.axes:
                self.axes[n].member = None
        base.move = None
        base.along = Speed()

    def _can_begin(self, base: Axis) -> bool:
        """Whether the next move of an axis can begin."""
        return base.move is None and bool(base.queue) and self._free(base.queue[0])

    def _load_next(self, base: Axis) -> None:
        if base.queue and self._can_begin(base):
            self._load(base, base.queue.pop(0))


@dataclass
class Axis:
    """An axis of the controller, real or virtual.

    Attributes:
        number: of the axis.
        position: demanded, in the machine's coordinates [units].
        zero: the machine's coordinate of DPOS = 0 [units].
        speed, acceleration, deceleration: SPEED, ACCEL, DECEL.
        units: UNITS, edges per unit.
        merge, servo: MERGE, SERVO.
        type: ATYPE, None unless the program sets it.
        superimposed: the axis that ADDAX adds, None for none.
        queue: buffered moves.
        move: the move that the axis holds, and executes.
        member: the move that moves it, which this axis or another one holds.
        along: speed along the path of its move.
        step: its motion in the last period [units].
        moved: whether it has ever moved.
        values: of the parameters without an effect.
        corners: CORNER_MODE, DECEL_ANGLE, STOP_ANGLE, FULL_SP_RADIUS.
        speeds: FORCE_SPEED, STARTMOVE_SPEED, ENDMOVE_SPEED.
    """

    number: int
    position: float
    speed: float
    acceleration: float
    deceleration: float
    zero: float = 0.0
    units: float = 1.0
    merge: bool = False
    servo: bool = True
    type: float | None = None
    superimposed: int | None = None
    queue: list[Move] = field(default_factory=list)
    move: Move | None = None
    member: Move | None = None
    along: Speed = field(default_factory=Speed)
    step: float = 0.0
    moved: bool = False
    values: dict[str, float] = field(default_factory=dict)
    corners: CornerRules = FULL_SPEED
    speeds: MoveSpeeds = field(default_factory=MoveSpeeds)

    @property
    def idle(self) -> bool:
        return self.member is None and not self.queue

    @property
    def mtype(self) -> int:
        return IDLE if self.member is None else self.member.kind

    @property
    def ntype(self) -> int:
        return self.queue[0].kind if self.queue else IDLE
