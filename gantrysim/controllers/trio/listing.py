"""The differences between AN-225's published listing and the method it describes."""

from __future__ import annotations

import numpy as np

from gantrysim.controllers.trio.loop import Passes

LITERAL_CIRCLES = 4  # to which the listing compares its turn counter


def differences(passes: Passes, turns: int, height: float) -> tuple[str, ...]:
    """Return the differences, each with its effect on this spiral.

    Args:
        passes: of the listing's loop.
        turns: programmed number of circles.
        height: climbed over them, 0 for two axes [mm].
    """
    notes = [
        "listing: a BASE statement names an axis that does not exist; the virtual axes are used instead",
        _turn_counter(turns),
        _guard(passes),
        "listing: a trailing comma in the first MOVECIRC is a syntax error; it is ignored",
    ]
    if height:
        notes.append("listing: MHELIX is not a command of the controller; MHELICAL is used instead")
    return tuple(notes)


def _turn_counter(turns: int) -> str:
    effect = "no effect" if turns == LITERAL_CIRCLES else f"{LITERAL_CIRCLES} circles are run instead of {turns}"
    return f"listing: the turn counter is compared with a literal 4, not with the number of turns: {effect}"


def _guard(passes: Passes) -> str:
    flaw = "listing: the guard accepts x = 0 and negative x"
    ratio = passes.ratio
    time = passes.time
    negative = np.flatnonzero(ratio < 0)
    if passes.halted:
        return (
            f"{flaw}: x is 0 on pass {ratio.size + 1}, SPEED = V / x divides by zero, the program stops and "
            f"the axes continue with x = {ratio[-1]:.4g}"
        )
    if negative.size:
        first = int(negative[0])
        return (
            f"{flaw}: from pass {first + 1}, at {time[first]:.3f} s, the real axes run backwards, "
            f"down to x = {ratio[-1]:.4g}, and WA of a negative time does not wait"
        )
    return f"{flaw}: no effect, x ends at {ratio[-1]:.4g}"
