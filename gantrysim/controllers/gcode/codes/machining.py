"""Codes that are not simulated: probing, threads, lathe cycles, and in printers' firmware milling cycles."""

from __future__ import annotations

from gantrysim.controllers.gcode.codes.code_table import LINUXCNC, SLICER, refused_code, without_effect
from gantrysim.controllers.gcode.program_state import ProgramState, WordBlock

_CYCLE = "milling cycle"
_LATHE = "lathe cycle"
_PROBING = "probing"


@refused_code("spline", dialects=(SLICER,))
def g5(state: ProgramState, block: WordBlock) -> None:
    """Spline."""


@refused_code("motion synchronised with the spindle", dialects=(LINUXCNC,))
def g33(state: ProgramState, block: WordBlock) -> None:
    """Move in step with the spindle's angle."""


@refused_code("rigid tapping", dialects=(LINUXCNC,))
def g33_1(state: ProgramState, block: WordBlock) -> None:
    """Rigid tapping."""


@refused_code(_PROBING)
def g38_2(state: ProgramState, block: WordBlock) -> None:
    """Probe towards the work, with an error without contact."""


@refused_code(_PROBING)
def g38_3(state: ProgramState, block: WordBlock) -> None:
    """Probe towards the work."""


@refused_code(_PROBING)
def g38_4(state: ProgramState, block: WordBlock) -> None:
    """Probe away from the work, with an error if contact stays."""


@refused_code(_PROBING)
def g38_5(state: ProgramState, block: WordBlock) -> None:
    """Probe away from the work."""


@refused_code(_LATHE, dialects=(LINUXCNC,))
def g70(state: ProgramState, block: WordBlock) -> None:
    """Finishing cycle."""


@refused_code(_LATHE, dialects=(LINUXCNC,))
def g71(state: ProgramState, block: WordBlock) -> None:
    """Roughing cycle along Z."""


@refused_code(_LATHE, dialects=(LINUXCNC,))
def g71_1(state: ProgramState, block: WordBlock) -> None:
    """Roughing cycle along Z, with pockets."""


@refused_code(_LATHE, dialects=(LINUXCNC,))
def g71_2(state: ProgramState, block: WordBlock) -> None:
    """Roughing cycle along Z, with pockets one after the other."""


@refused_code(_LATHE, dialects=(LINUXCNC,))
def g72(state: ProgramState, block: WordBlock) -> None:
    """Roughing cycle along X."""


@refused_code(_LATHE, dialects=(LINUXCNC,))
def g72_1(state: ProgramState, block: WordBlock) -> None:
    """Roughing cycle along X, with pockets."""


@refused_code(_LATHE, dialects=(LINUXCNC,))
def g72_2(state: ProgramState, block: WordBlock) -> None:
    """Roughing cycle along X, with pockets one after the other."""


@refused_code(_CYCLE, dialects=(SLICER,))
def g73(state: ProgramState, block: WordBlock) -> None:
    """Drilling cycle that breaks chips."""


@refused_code(_CYCLE, dialects=(SLICER,))
def g74(state: ProgramState, block: WordBlock) -> None:
    """Tapping cycle to the left."""


@refused_code(_CYCLE)
def g76(state: ProgramState, block: WordBlock) -> None:
    """Threading cycle."""


@without_effect((SLICER,))
def g80(state: ProgramState, block: WordBlock) -> None:
    """No cycle, as it always is."""


@refused_code(_CYCLE, dialects=(SLICER,))
def g81(state: ProgramState, block: WordBlock) -> None:
    """Drilling cycle."""


@refused_code(_CYCLE, dialects=(SLICER,))
def g82(state: ProgramState, block: WordBlock) -> None:
    """Drilling cycle with a dwell."""


@refused_code(_CYCLE, dialects=(SLICER,))
def g83(state: ProgramState, block: WordBlock) -> None:
    """Drilling cycle that clears chips."""


@refused_code(_CYCLE, dialects=(SLICER,))
def g84(state: ProgramState, block: WordBlock) -> None:
    """Tapping cycle to the right."""


@refused_code(_CYCLE, dialects=(SLICER,))
def g85(state: ProgramState, block: WordBlock) -> None:
    """Boring cycle, out at feed."""


@refused_code(_CYCLE, dialects=(SLICER,))
def g86(state: ProgramState, block: WordBlock) -> None:
    """Boring cycle, out with the spindle at rest."""


@refused_code(_CYCLE)
def g87(state: ProgramState, block: WordBlock) -> None:
    """Back boring cycle."""


@refused_code(_CYCLE)
def g88(state: ProgramState, block: WordBlock) -> None:
    """Boring cycle, out by hand."""


@refused_code(_CYCLE, dialects=(SLICER,))
def g89(state: ProgramState, block: WordBlock) -> None:
    """Boring cycle with a dwell, out at feed."""
