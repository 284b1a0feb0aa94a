"""A softMC program: text or commands in, setpoints out."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from gantrysim.base.errors import InputError, finite
from gantrysim.controllers.controller import Controller
from gantrysim.controllers.softmc.commands import Circle, Command, Move, SoftMCError
from gantrysim.controllers.softmc.geometry import AXES, segment
from gantrysim.controllers.softmc.group import Group
from gantrysim.controllers.softmc.record import Record
from gantrysim.controllers.softmc.stream import Leg, leg_of, stream
from gantrysim.controllers.softmc.text import SPEEDS, SourceLine, read
from gantrysim.paths.chain import Chain
from gantrysim.record.run import Run
from gantrysim.record.setpoints import Setpoints


@dataclass(frozen=True)
class Program(Controller):
    """A program of CIRCLE and MOVE commands for one group of axes x, y[, z[, r]].

    Every command runs from rest to rest; the next one starts at the first servo tick after its end, and with a
    `settle_error` after settling. The linear axes move with the group's path speed and ramps; the orientation r
    turns in proportion to the path length, and the path slows where r would exceed its limits. A command that
    moves r alone turns it in place.

    In text every line is a command:

        Circle G1 Angle=180 CircleCenter={0, 0, 5} CirclePlane=0 Vtran=500   ' comment
        Circle G1 CirclePoint={0, 100} TargetPoint={-100, 0}
        Move G1 {25, 0, 0}

    Source: softMC, MC-Basic reference, CIRCLE and the properties of elements; `Circle` and `Group` state the
    assumptions where it leaves something open.

    Args:
        program: text of the program, or commands.
        group: properties of the group.
        start: initial position, 2 to 4 numbers, one per axis [mm, mm, mm, deg].
        record: samples that the controller records.

    Raises:
        SoftMCError: a command that cannot be run, with its line and text.
    """

    speed_scaling: ClassVar[str] = "the group's velocity and every command's own Vtran, changed in one proportion"
    ramp_arguments: ClassVar[tuple[str, ...]] = ("group.acceleration", "group.deceleration", "group.jerk")

    program: str | tuple[Circle | Move, ...]
    group: Group = field(default_factory=Group)
    start: tuple[float, ...] = (0.0, 0.0)
    record: Record | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.program, str):
            object.__setattr__(self, "program", tuple(self.program))
        if not hasattr(self.start, "__iter__") or isinstance(self.start, str) or not 2 <= len(self.start) <= len(AXES):
            raise InputError(f"start = {self.start!r}: must be 2 to 4 numbers, x, y[, z[, r]]")
        start = tuple(finite(f"start {name}", value) for name, value in zip(AXES, self.start, strict=False))
        object.__setattr__(self, "start", start)
        if all(leg.path.piece is None for leg in self.legs):
            raise SoftMCError("program moves none of x, y, z: must have at least one command that does")

    @property
    def axes(self) -> tuple[str, ...]:
        return tuple(AXES[: len(self.start)])

    @cached_property
    def legs(self) -> tuple[Leg, ...]:
        """The motions of the commands."""
        here = np.zeros(len(AXES))
        here[: len(self.start)] = self.start
        legs = []
        for line in self._lines():
            try:
                group = self.group.overridden(line.command)
                path = segment(line.command, here, len(self.start), group.absolute)
                leg = leg_of(path, here, group, line.command.dispense is not False)
            except InputError as error:
                raise SoftMCError(f"{line.where}: {error}") from None
            legs.append(leg)
            here = leg.path.end
        return tuple(legs)

    def _lines(self) -> tuple[SourceLine, ...]:
        if isinstance(self.program, str):
            return read(self.program)
        for k, command in enumerate(self.program, 1):
            if not isinstance(command, Circle | Move):
                raise SoftMCError(f"command {k} = {command!r}: must be a Circle or a Move")
        return tuple(
            SourceLine(f"command {k} {_command_text(command)}", command) for k, command in enumerate(self.program, 1)
        )

    @cached_property
    def requested(self) -> Chain:
        """The path of all commands."""
        return Chain(leg.path.piece for leg in self.legs if leg.path.piece is not None)

    @property
    def duration(self) -> float:
        """Duration of the motion, without waits for the next servo tick and for settling [s]."""
        return sum(leg.profile.duration for leg in self.legs)

    def with_speeds(self, change: Callable[[float], float]) -> dict[str, Any]:
        """As VelocityOverride on the controller does; ramps and limits stay."""
        program = SPEEDS.changed(self.arguments()["program"], change)
        return {"group.velocity": change(self.group.velocity), "program": program}

    def write_record(self, run: Run, file: str | os.PathLike[str]) -> bool:
        if self.record is None:
            return False
        self.record.write(run, file, self.group.position_error_delay)
        return True

    def setpoints(self, period: float) -> Setpoints:
        streamed = stream(self.legs, period)
        dispense = streamed.dispense.copy()
        ends = np.unique(streamed.ends)
        gates = ends[(ends > 0) & (self.group.settle_error < np.inf)]
        dispense[gates] = dispense[gates - 1]  # the dispenser stays as it is while a command settles
        return Setpoints(
            period,
            self.axes,
            streamed.position[:, : len(self.start)],
            dispense,
            self.requested,
            self.group.supervision,
            gates,
            progress=streamed.progress,
        )


def _command_text(command: Command) -> str:
    given = {f.name: getattr(command, f.name) for f in fields(command) if getattr(command, f.name) != f.default}
    return f"{type(command).__name__}({', '.join(f'{name}={value}' for name, value in given.items())})"
