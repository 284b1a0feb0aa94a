"""What AN-225's published listing does otherwise than the method it describes, in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from gantrysim.controllers.trio.spiral import MoveSpiral

__all__ = ["differences"]


def differences(spiral: MoveSpiral) -> tuple[str, ...]:
    """Return the differences, each a sentence with what it does to this very spiral."""
    said = [
        "listing: a BASE statement names an axis that does not exist; no controller runs it, "
        "so the virtual axes are taken here",
        _turn_counter(spiral),
        _guard(spiral),
        "listing: a trailing comma in the first MOVECIRC is a syntax error; it is left out here",
    ]
    if spiral.height:
        said.append("listing: MHELIX is no command of the controller; MHELICAL is taken here")
    return tuple(said)


def _turn_counter(spiral: MoveSpiral) -> str:
    said = "listing: the turn counter is compared with a literal 4, not with the number of turns"
    if spiral.circles == spiral.turns:
        return f"{said}: with 4 turns nothing changes"
    return f"{said}: {spiral.circles} circles are run instead of {spiral.turns}"


def _guard(spiral: MoveSpiral) -> str:
    said = "listing: the guard lets x = 0 and negative x pass"
    ratio, time = spiral.passes.ratio, spiral.passes.time
    negative = np.flatnonzero(ratio < 0)
    if spiral.passes.halted:
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
