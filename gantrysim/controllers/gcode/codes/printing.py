"""Codes of printers' firmware. All that is not here, as of other firmware, is counted as well."""

from __future__ import annotations

from gantrysim.controllers.gcode.codes.code_table import SLICER, auxiliary, command, without_effect
from gantrysim.controllers.gcode.motion_limits import UNLIMITED, Three
from gantrysim.controllers.gcode.program_state import ProgramState, WordBlock

_SLICER = (SLICER,)
_VELOCITY_LIMITS = ("VELOCITY", "ACCEL", "SQUARE_CORNER_VELOCITY")


@without_effect(_SLICER)
def g28(state: ProgramState, block: WordBlock) -> None:
    """Home the axes; the nozzle stays where it is."""


@without_effect(_SLICER)
def g29(state: ProgramState, block: WordBlock) -> None:
    """Measure the bed."""


@without_effect(_SLICER)
def g31(state: ProgramState, block: WordBlock) -> None:
    """Dock the probe, or report it."""


@without_effect(_SLICER)
def g32(state: ProgramState, block: WordBlock) -> None:
    """Measure the bed with its screws."""


@without_effect(_SLICER, names=("M0", "M1", "M400"), halts=True)
def m400(state: ProgramState, block: WordBlock) -> None:
    """Wait for the moves before, and with M0 and M1 for the operator."""


@without_effect(_SLICER)
def m84(state: ProgramState, block: WordBlock) -> None:
    """Motors off."""


@without_effect(_SLICER)
def m104(state: ProgramState, block: WordBlock) -> None:
    """Temperature of the nozzle."""


@without_effect(_SLICER)
def m106(state: ProgramState, block: WordBlock) -> None:
    """Fan on."""


@without_effect(_SLICER)
def m107(state: ProgramState, block: WordBlock) -> None:
    """Fan off."""


@without_effect(_SLICER)
def m109(state: ProgramState, block: WordBlock) -> None:
    """Wait for the temperature of the nozzle."""


@without_effect(_SLICER)
def m117(state: ProgramState, block: WordBlock) -> None:
    """Message on the display."""


@without_effect(_SLICER)
def m140(state: ProgramState, block: WordBlock) -> None:
    """Temperature of the bed."""


@without_effect(_SLICER)
def m190(state: ProgramState, block: WordBlock) -> None:
    """Wait for the temperature of the bed."""


@auxiliary(_SLICER)
def m201(state: ProgramState, block: WordBlock) -> None:
    """Largest acceleration of X, Y and Z [mm/s²]."""
    before = state.limits.now.axis_accelerations or UNLIMITED
    state.limits.change(axis_accelerations=_by_axis(block, before))


@auxiliary(_SLICER)
def m203(state: ProgramState, block: WordBlock) -> None:
    """Largest speed of X, Y and Z [mm/s]."""
    state.limits.change(axis_speeds=_by_axis(block, state.limits.now.axis_speeds))


def _by_axis(block: WordBlock, before: Three) -> Three:
    x, y, z = (block.values.get(letter, value) for letter, value in zip("XYZ", before, strict=True))
    return x, y, z


@auxiliary(_SLICER)
def m204(state: ProgramState, block: WordBlock) -> None:
    """Acceleration: S of all moves, P of those that feed material, T of the others [mm/s²]."""
    both = block.values.get("S")
    state.limits.accelerate(block.values.get("P", both), block.values.get("T", both))


@auxiliary(_SLICER)
def m205(state: ProgramState, block: WordBlock) -> None:
    """Speed of corners: the jump X or Y of an axis [mm/s], or J, the deviation from the corner [mm]."""
    if "J" in block.values:
        state.limits.change(deviation=block.values["J"], corner_speed=None)
        return
    jumps = [block.values[letter] for letter in "XY" if letter in block.values]
    # at a right angle one axis stops, and its velocity jumps by the path speed
    if jumps:
        state.limits.change(corner_speed=min(jumps), deviation=None)


@without_effect(_SLICER)
def m220(state: ProgramState, block: WordBlock) -> None:
    """Override of the feed; that of the job counts."""


@command()
def set_velocity_limit(state: ProgramState, block: WordBlock) -> None:
    """Klipper's limits: VELOCITY, ACCEL, SQUARE_CORNER_VELOCITY; others have no effect."""
    values = block.named_numbers(_VELOCITY_LIMITS)
    if "ACCEL" in values:
        state.limits.accelerate(values["ACCEL"], values["ACCEL"])
    if "VELOCITY" in values:
        state.limits.change(speed=values["VELOCITY"])
    if "SQUARE_CORNER_VELOCITY" in values:
        state.limits.change(corner_speed=values["SQUARE_CORNER_VELOCITY"], deviation=None)
