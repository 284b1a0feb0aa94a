"""What AN-225's published listing does otherwise than the method it describes, in words."""

from __future__ import annotations

import numpy as np

from gantrysim.controllers.trio.loop import Passes

LITERAL_CIRCLES = 4  # in the turn counter


def differences(passes: Passes, turns: int, height: float) -> tuple[str, ...]:
    """Return the differences, each a sentence with what it does to this very spiral.

    Args:
        passes: of the listing's loop.
        turns: number of circles asked for.
        height: climbed over them, 0 for two axes [mm].
    """
    said = [
        "listing: a BASE statement names an axis that does not exist; no controller runs it, "
        "so the virtual axes are taken here",
        _turn_counter(turns),
        _guard(passes),
        "listing: a trailing comma in the first MOVECIRC is a syntax error; it is left out here",
    ]
    if height:
        said.append("listing: MHELIX is no command of the controller; MHELICAL is taken here")
    return tuple(said)


def _turn_counter(turns: int) -> str:
    said = "listing: the turn counter is compared with a literal 4, not with the number of turns"
    if turns == LITERAL_CIRCLES:
        return f"{said}: with 4 turns nothing changes"
    return f"{said}: {LITERAL_CIRCLES} circles are run instead of {turns}"


def _guard(passes: Passes) -> str:
    said = "listing: the guard lets x = 0 and negative x pass"
    ratio, time = passes.ratio, passes.time
    negative = np.flatnonzero(ratio < 0)
    if passes.halted:
        return (
            f"{said}: x is 0 on pass {ratio.size + 1}, SPEED = V / x divides by zero, the program stops there and "
            f"the axes run on with x = {ratio[-1]:.4g}"
        )
    if negative.size:
        first = int(negative[0])
        return (
            f"{said}: from pass {first + 1}, at {time[first]:.3f} s, the real axes run backwards, "
            f"down to x = {ratio[-1]:.4g}, and WA of a negative time does not wait"
        )
    return f"{said}: here x ends at {ratio[-1]:.4g}, nothing changes"
