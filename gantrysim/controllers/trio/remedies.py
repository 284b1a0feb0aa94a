"""What to change in a spiral that the controller refuses, as ends of messages."""

from __future__ import annotations

import math


def fewer_turns(diameter: float, thickness: float) -> str:
    """Return the advice to use fewer turns, up to which the inner diameter is positive; empty where none are."""
    turns = math.ceil(diameter / (2 * thickness)) - 1
    return f"turns at most {turns} or " if turns >= 1 else ""


def for_late_axes(*, has_ramps: bool, rounds_waits: bool, speed_in_space: bool) -> str:
    """Return what makes the virtual axes faster, so that their circles end before the ratio is zero."""
    remedies = {
        "a greater acceleration, ": has_ramps,
        "a loop_period longer against wait_resolution, ": rounds_waits,
        "mhelical_mode 1, ": speed_in_space,
    }
    helpful = "".join(remedy for remedy, helps in remedies.items() if helps)
    return f"the virtual axes are late, use {helpful}fewer turns or a smaller thickness"
