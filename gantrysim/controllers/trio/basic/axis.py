"""An axis of the controller, real or virtual."""

from __future__ import annotations

from dataclasses import dataclass, field

from gantrysim.controllers.trio.basic.corner_rules import FULL_SPEED, CornerRules, MoveSpeeds
from gantrysim.controllers.trio.basic.moves import IDLE, Move
from gantrysim.controllers.trio.basic.profile import Speed


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
