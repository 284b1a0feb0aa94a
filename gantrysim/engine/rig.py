"""What a run was simulated with, kept beside its record."""

from __future__ import annotations

from dataclasses import dataclass, field

from gantrysim.engine.arguments import check_argument
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.machine.machine import Machine
from gantrysim.servo.servo import Servo


@dataclass(frozen=True)
class Rig:
    """Machine, servo and dispenser of a run that no job describes; they judge, report and film it.

    A record that was saved, pickled, or sent to another process has none; `run.replaced(rig=rig)` gives it one.

    Attributes:
        machine: the machine.
        servo: the servo.
        dispenser: dispenser of the glue, by default one that lays nothing.
        has_own_law: whether a law in plain Python ran in place of the servo's, so that its margins are not known.
    """

    machine: Machine
    servo: Servo
    dispenser: Dispenser = field(default_factory=Dispenser)
    has_own_law: bool = False

    def __post_init__(self) -> None:
        for name in ("machine", "servo", "dispenser"):
            check_argument(name, getattr(self, name))
