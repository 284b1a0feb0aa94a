"""The speed of a job's program, and the same program at another speed.

Every controller has its own way of running a program faster:

- trio.MoveSpiral, stage.OutlineTrace: their `speed`
- softmc.Program: the group's `velocity` and every command's own Vtran or VCruise, all in one proportion, as
  VelocityOverride on the controller does
- fanuc.Program: every F, all in one proportion, and the feed of the dry run, as the feed override on the operator's
  panel does; rapid moves and the clamp of the feed stay

What limits the speed on the way, as ramps, clamps and the axes' limits, stays as it is.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from gantrysim.errors import InputError, positive
from gantrysim.job.job import Job

_NUMBER = r"\s*\+?([0-9]+\.?[0-9]*|\.[0-9]+)"
_FEED = re.compile(r"(\bF|(?<=[0-9.\s])F)" + _NUMBER, re.IGNORECASE)
_VELOCITY = re.compile(r"(\b(?:Vtran|VCruise)\s*=)" + _NUMBER, re.IGNORECASE)
_FANUC_COMMENT = re.compile(r"(\([^)]*\)?)")
_SOFTMC_COMMENT = re.compile(r"('[^\n]*)")
_PER_MINUTE = 60.0


def programmed_speed(job: Job) -> float:
    """Return the fastest path speed that a job's program asks for [mm/s].

    Raises:
        InputError: a program that says no speed.
    """
    speeds: list[float] = []

    def note(speed: float) -> float:
        speeds.append(speed)
        return speed

    _each_speed(job, note)
    if not speeds:
        raise InputError(f"job {job.name}: its program says no speed")
    return max(speeds)


def speed_overrides(job: Job, speed: float) -> dict[str, Any]:
    """Return the values that make a job's program run at another speed, by their dotted keys.

    Args:
        job: as it is.
        speed: that its fastest motion is to have [mm/s]; slower ones keep their proportion to it.

    Raises:
        InputError: a program that says no speed, or a speed that is none.
    """
    share = positive("speed", speed, "mm/s") / programmed_speed(job)
    return _each_speed(job, lambda one: one * share)


def _each_speed(job: Job, change: Callable[[float], float]) -> dict[str, Any]:
    """Return what the program holds of speeds, each one changed [mm/s]."""
    controller, program = job.program["controller"], job.program
    if controller == "fanuc.Program":
        text = _texts(program["program"], _FEED, _FANUC_COMMENT, "feed", lambda feed: _per_minute(feed, change))
        dry = program.get("dry_run")
        return {"program.program": text} | ({} if dry is None else {"program.dry_run": _per_minute(dry, change)})
    if controller == "softmc.Program":
        velocity = change(program["group"]["velocity"])
        text = _texts(program["program"], _VELOCITY, _SOFTMC_COMMENT, "velocity", change)
        return {"program.group.velocity": velocity, "program.program": text}
    return {"program.speed": change(program["speed"])}


def _per_minute(feed: float, change: Callable[[float], float]) -> float:
    return _PER_MINUTE * change(feed / _PER_MINUTE)


def _texts(
    program: Any,
    word: re.Pattern[str],
    comment: re.Pattern[str],
    key: str,
    change: Callable[[float], float],
) -> Any:
    """A program with every speed in it changed: a text, or a list of commands."""
    if not isinstance(program, str):
        return [
            {name: change(value) if name == key else value for name, value in dict(command).items()}
            for command in program
        ]

    def replace(match: re.Match[str]) -> str:
        return f"{match[1]}{_plain(change(float(match[2])))}"

    # what the pattern of comments splits off comes at every second place
    parts = comment.split(program)
    parts[::2] = [word.sub(replace, part) for part in parts[::2]]
    return "".join(parts)


def _plain(number: float) -> str:
    """A number without an exponent, as controllers read it: at most eight digits."""
    whole = len(str(int(number)))
    text = f"{number:.{max(8 - whole, 0)}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text
