"""Codes of printers' firmware. All that is not here, as of other firmware, is counted as well."""

from __future__ import annotations

from gantrysim.controllers.gcode.codes.code import SLICER, auxiliary, without_effect
from gantrysim.controllers.gcode.state import Block, State

_SLICER = (SLICER,)


@auxiliary(_SLICER)
def m82(state: State, block: Block) -> None:
    """Absolute extrusion."""
    state.relative_extruder = False
    block.keeps_words = True


@auxiliary(_SLICER)
def m83(state: State, block: Block) -> None:
    """Relative extrusion."""
    state.relative_extruder = True
    block.keeps_words = True


@without_effect(_SLICER)
def g10(state: State, block: Block) -> None:
    """Retract the material."""


@without_effect(_SLICER)
def g11(state: State, block: Block) -> None:
    """Feed the retracted material."""


@without_effect(_SLICER)
def g22(state: State, block: Block) -> None:
    """Retract the material."""


@without_effect(_SLICER)
def g28(state: State, block: Block) -> None:
    """Home the axes; the nozzle stays where it is."""


@without_effect(_SLICER)
def g29(state: State, block: Block) -> None:
    """Measure the bed."""


@without_effect(_SLICER)
def g31(state: State, block: Block) -> None:
    """Dock the probe, or report it."""


@without_effect(_SLICER)
def g32(state: State, block: Block) -> None:
    """Measure the bed with its screws."""


@without_effect(_SLICER)
def m84(state: State, block: Block) -> None:
    """Motors off."""


@without_effect(_SLICER)
def m104(state: State, block: Block) -> None:
    """Temperature of the nozzle."""


@without_effect(_SLICER)
def m106(state: State, block: Block) -> None:
    """Fan on."""


@without_effect(_SLICER)
def m107(state: State, block: Block) -> None:
    """Fan off."""


@without_effect(_SLICER)
def m109(state: State, block: Block) -> None:
    """Wait for the temperature of the nozzle."""


@without_effect(_SLICER)
def m117(state: State, block: Block) -> None:
    """Message on the display."""


@without_effect(_SLICER)
def m140(state: State, block: Block) -> None:
    """Temperature of the bed."""


@without_effect(_SLICER)
def m190(state: State, block: Block) -> None:
    """Wait for the temperature of the bed."""


@without_effect(_SLICER)
def m204(state: State, block: Block) -> None:
    """Acceleration; that of the job counts."""


@without_effect(_SLICER)
def m205(state: State, block: Block) -> None:
    """Jerk and corner velocity; those of the job count."""


@without_effect(_SLICER)
def m220(state: State, block: Block) -> None:
    """Override of the feed; that of the job counts."""


@without_effect(_SLICER)
def m221(state: State, block: Block) -> None:
    """Override of the material."""


@without_effect(_SLICER)
def set_velocity_limit(state: State, block: Block) -> None:
    """Limits of speed and acceleration; those of the job count."""
