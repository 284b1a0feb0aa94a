"""Speeds of the moves of a text, by its lines: FORCE_SPEED and STARTMOVE_SPEED of moves whose names end in SP."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from gantrysim.controllers.trio.basic.interpreter import Trace

_MOVE = re.compile(r"\b(MOVEABS|MOVECIRC|MOVE|MHELICAL)(?:SP)?(?=[ \t]*\()", re.IGNORECASE)
_TEXT_OR_COMMENT = re.compile(r"(\"[^\"\n]*\"|'[^\n]*)")
_DIGITS = 8  # of a speed


def with_move_speeds(text: str, speeds: Mapping[int, float]) -> str:
    """Return a text whose moves have speeds of their own.

    A move buffers FORCE_SPEED, its speed, and STARTMOVE_SPEED, to which the move before brakes; SPEED would act at once
    on the move that runs when the program sets it.

    Args:
        text: of the program.
        speeds: path speeds of the moves by their lines [mm/s].
    """
    lines = text.split("\n")
    for number, speed in speeds.items():
        parts = _TEXT_OR_COMMENT.split(lines[number - 1])
        # splitting at a group leaves texts and comments at every second place
        parts[::2] = [_MOVE.sub(lambda match: f"{match[1]}SP", part) for part in parts[::2]]
        line = "".join(parts)
        match = _MOVE.search(line)
        # speeds stay set until the next ones
        if match is None or (speeds.get(number - 1) == speed and _MOVE.search(lines[number - 2])):
            lines[number - 1] = line
            continue
        words = f"FORCE_SPEED={speed:.{_DIGITS}g}: STARTMOVE_SPEED={speed:.{_DIGITS}g}: "
        lines[number - 1] = line[: match.start()] + words + line[match.start() :]
    return "\n".join(lines)


def speeds_of_moves(trace: Trace) -> dict[int, float]:
    """Return the path speeds of the moves of a run by their lines: that which each forces, else the fastest one [mm/s].

    A line that runs several times is as fast as its slowest pass.
    """
    steps = np.sqrt((np.diff(trace.position[:, :3], axis=0) ** 2).sum(axis=1)) / trace.period
    reached = np.zeros(int(trace.lines.max(initial=0)) + 1)
    np.maximum.at(reached, trace.lines[1:], steps)
    speeds: dict[int, float] = {}
    for move in trace.state.motion.loaded:
        speed = float(reached[move.line]) if move.line < reached.size else 0.0
        if move.speeds is not None and move.speeds.force is not None:
            speed = move.speeds.force
        speeds[move.line] = min(speed, speeds.get(move.line, np.inf))
    return speeds
