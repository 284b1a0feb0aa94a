"""A softMC program: text or commands in, setpoints out."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from gantrysim.base.errors import InputError, finite, unknown
from gantrysim.controllers.controller import Controller
from gantrysim.controllers.softmc.basic.recording import Record
from gantrysim.controllers.softmc.commands import Circle, Command, Move, SoftMCError
from gantrysim.controllers.softmc.group import PROFILE_TYPES, Group
from gantrysim.controllers.softmc.stream import AXES, Leg, leg_of, segment, stream
from gantrysim.controllers.speeds import SpeedWords, Stretches
from gantrysim.paths.chain import Chain
from gantrysim.record.run import Run
from gantrysim.record.setpoints import Setpoints

# Parser of MC-Basic lines.

_TOKEN = re.compile(r"\s*(?:(?P<word>[A-Za-z_]\w*)|(?P<point>\{[^{}]*\})|(?P<equals>=)|(?P<number>[^\s={}]+))")

_NODAL = {
    "Vtran": "velocity",
    "VCruise": "velocity",
    "Acc": "acceleration",
    "Dec": "deceleration",
    "Jerk": "jerk",
    "PrfType": "profile",
    "Smooth": "smooth",
    "Abs": "absolute",
    "Dispense": "dispense",
}
_CIRCLE = {
    "Angle": "angle",
    "CircleCenter": "centre",
    "CirclePlane": "plane",
    "CirclePoint": "via",
    "TargetPoint": "target",
}
_WORDS = {"Circle": {**_CIRCLE, **_NODAL}, "Move": _NODAL}
_POINT_KEYWORDS = ("CircleCenter", "CirclePoint", "TargetPoint")
_SWITCHES = ("Abs", "Dispense")


SPEEDS = SpeedWords(word=r"\b(?:Vtran|VCruise)\s*=", comment=r"'[^\n]*", key="velocity")


@dataclass(frozen=True)
class SourceLine:
    """A command, its name in error messages, and its line in the text or its place in the list."""

    where: str
    command: Command
    number: int


def read(program: str) -> tuple[SourceLine, ...]:
    """Return the commands of a text of MC-Basic lines.

    A line is a command, optionally the group's name, and words with values; a comment begins with an apostrophe.

    Raises:
        SoftMCError: a line that is not a command.
    """
    commands = []
    group = None
    for number, line in enumerate(program.splitlines(), 1):
        text = line.partition("'")[0].strip()
        if not text:
            continue
        where = f'line {number} "{text}"'
        try:
            command, named = _command(text)
            if named is not None and group is not None and named.lower() != group.lower():
                raise SoftMCError(f"group {named}: must be {group}, as in the lines before; a program moves one group")
        except InputError as error:
            raise SoftMCError(f"{where}: {error}") from None
        group = group or named
        commands.append(SourceLine(where, command, number))
    return tuple(commands)


def _command(text: str) -> tuple[Command, str | None]:
    tokens = _tokens(text)
    verb = _known_word("command", tokens.pop(0)[1], _WORDS)
    words = _WORDS[verb]
    named = None
    is_name = tokens and tokens[0][0] == "word" and tokens[1:2] != [("equals", "=")]
    if is_name and tokens[0][1].lower() not in map(str.lower, words):
        named = tokens.pop(0)[1]
    arguments: dict[str, Any] = {}
    if verb == "Move":
        if not tokens or tokens[0][0] != "point":
            raise SoftMCError("target is missing: must follow as {x, y, ...}")
        arguments["target"] = _point("target", tokens.pop(0)[1])
    while tokens:
        kind, text_of_word = tokens.pop(0)
        if kind != "word":
            raise SoftMCError(f"{text_of_word!r}: must be one of the words {', '.join(words)}, with = and a value")
        word = _known_word("word", text_of_word, words)
        if len(tokens) < 2 or tokens[0][0] != "equals" or tokens[2:3] == [("equals", "=")]:
            raise SoftMCError(f"{word} has no value: must be {_example(word)}, after an =")
        if words[word] in arguments:
            raise SoftMCError(f"{word}: {words[word]} is given twice, must be once")
        arguments[words[word]] = _value(word, *tokens[1])
        del tokens[:2]
    return (Circle if verb == "Circle" else Move)(**arguments), named


def _tokens(text: str) -> list[tuple[str, str]]:
    tokens = []
    position = 0
    while position < len(text):
        match = _TOKEN.match(text, position)
        if match is None:
            raise SoftMCError(
                f"{text[position:].strip()!r}: must be words, numbers and points in braces, as in {{0, 0, 5}}"
            )
        tokens.append((str(match.lastgroup), match[str(match.lastgroup)]))
        position = match.end()
    return tokens


def _known_word(kind: str, name: str, words: dict[str, Any]) -> str:
    for word in words:
        if word.lower() == name.lower():
            return word
    raise unknown(kind, name, words)


def _value(word: str, kind: str, text: str) -> Any:
    if (kind == "point") != (word in _POINT_KEYWORDS):
        raise SoftMCError(f"{word} = {text}: must be {_example(word)}")
    if kind == "point":
        return _point(word, text)
    value = _number(word, text)
    if word == "PrfType":
        if value not in PROFILE_TYPES:
            known = ", ".join(f"{number} ({name})" for number, name in sorted(PROFILE_TYPES.items()))
            raise SoftMCError(f"PrfType = {text}: must be one of {known}")
        return PROFILE_TYPES[int(value)]
    if word in _SWITCHES:
        if value not in (0, 1):
            raise SoftMCError(f"{word} = {text}: must be 0 or 1")
        return value == 1
    return int(value) if word == "CirclePlane" and value.is_integer() else value


def _point(word: str, text: str) -> tuple[float, ...]:
    return tuple(_number(f"coordinate of {word}", item) for item in text.strip("{}").split(","))


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise SoftMCError(f"{name} = {text.strip()!r}: must be a number") from None


def _example(word: str) -> str:
    if word in _POINT_KEYWORDS:
        return "a point in braces, as in {0, 0, 5}"
    return "0 or 1" if word in _SWITCHES else "a number"


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
                group = self.group.with_overrides(line.command)
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
            SourceLine(f"command {k} {_command_text(command)}", command, k) for k, command in enumerate(self.program, 1)
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

    @property
    def program_text(self) -> str:
        return self.program if isinstance(self.program, str) else ""

    @property
    def program_suffix(self) -> str:
        return ".prg"

    def stretches(self, period: float) -> Stretches:
        """As `Controller.stretches`: the commands, each with a Vtran of its own."""
        moving = [(k, leg) for k, leg in enumerate(self.legs) if leg.path.piece is not None]
        lines = self._lines()
        return Stretches.of(
            [leg.profile.length for _, leg in moving],
            [lines[k].number for k, _ in moving],
            [lines[k].command.velocity or self.group.velocity for k, _ in moving],
        )

    def with_stretch_speeds(self, speeds: Mapping[int, float]) -> dict[str, Any]:
        """As `Controller.with_stretch_speeds`: Vtran of the commands whose speed is not the group's."""
        words = {line: None if speed == self.group.velocity else speed for line, speed in speeds.items()}
        if not isinstance(self.program, str):
            commands = self.arguments()["program"]
            for number, speed in words.items():
                commands[number - 1].pop("velocity", None)
                if speed is not None:
                    commands[number - 1]["velocity"] = speed
            return {"program": commands}
        lines = self.program.split("\n")
        for number, speed in words.items():
            lines[number - 1] = SPEEDS.with_word(lines[number - 1], "Vtran=", speed)
        return {"program": "\n".join(lines)}

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
        # the dispenser stays as it is while a command settles
        dispense[gates] = dispense[gates - 1]
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
