"""Parser of MC-Basic lines."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from gantrysim.base.errors import InputError, unknown
from gantrysim.controllers.softmc.commands import Circle, Command, Move, SoftMCError
from gantrysim.controllers.softmc.group import PROFILE_TYPES
from gantrysim.controllers.speeds import SpeedWords

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
_POINTS = ("CircleCenter", "CirclePoint", "TargetPoint")
_SWITCHES = ("Abs", "Dispense")


SPEEDS = SpeedWords(word=r"\b(?:Vtran|VCruise)\s*=", comment=r"'[^\n]*", key="velocity")


@dataclass(frozen=True)
class SourceLine:
    """A command, and its name in error messages."""

    where: str
    command: Command


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
        commands.append(SourceLine(where, command))
    return tuple(commands)


def _command(text: str) -> tuple[Command, str | None]:
    tokens = _tokens(text)
    verb = _known("command", tokens.pop(0)[1], _WORDS)
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
        word = _known("word", text_of_word, words)
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


def _known(kind: str, name: str, words: dict[str, Any]) -> str:
    for word in words:
        if word.lower() == name.lower():
            return word
    raise unknown(kind, name, words)


def _value(word: str, kind: str, text: str) -> Any:
    if (kind == "point") != (word in _POINTS):
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
    if word in _POINTS:
        return "a point in braces, as in {0, 0, 5}"
    return "0 or 1" if word in _SWITCHES else "a number"
