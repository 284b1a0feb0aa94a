"""Codes of printers' firmware. All that is not here, as of other firmware, is counted as well."""

from __future__ import annotations

from gantrysim.controllers.gcode.codes.code_table import SLICER, auxiliary, without_effect
from gantrysim.controllers.gcode.program_state import ProgramState, WordBlock

_SLICER = (SLICER,)


@auxiliary(_SLICER)
def m82(state: ProgramState, block: WordBlock) -> None:
    """Absolute extrusion."""
    state.relative_extruder = False
    block.keeps_words = True


@auxiliary(_SLICER)
def m83(state: ProgramState, block: WordBlock) -> None:
    """Relative extrusion."""
    state.relative_extruder = True
    block.keeps_words = True


@without_effect(_SLICER)
def g10(state: ProgramState, block: WordBlock) -> None:
    """Retract the material."""


@without_effect(_SLICER)
def g11(state: ProgramState, block: WordBlock) -> None:
    """Feed the retracted material."""


@without_effect(_SLICER)
def g22(state: ProgramState, block: WordBlock) -> None:
    """Retract the material."""


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


@without_effect(_SLICER)
def m204(state: ProgramState, block: WordBlock) -> None:
    """Acceleration; that of the job counts."""


@without_effect(_SLICER)
def m205(state: ProgramState, block: WordBlock) -> None:
    """Jerk and corner velocity; those of the job count."""


@without_effect(_SLICER)
def m220(state: ProgramState, block: WordBlock) -> None:
    """Override of the feed; that of the job counts."""


@without_effect(_SLICER)
def m221(state: ProgramState, block: WordBlock) -> None:
    """Override of the material."""


@without_effect(_SLICER)
def set_velocity_limit(state: ProgramState, block: WordBlock) -> None:
    """Limits of speed and acceleration; those of the job count."""
