"""M codes: the end of the program, saved modes, and what switches something else than the nozzle."""

from __future__ import annotations

from gantrysim.base.errors import InputError, between
from gantrysim.controllers.gcode.codes.code_table import LINUXCNC, auxiliary, without_effect
from gantrysim.controllers.gcode.program_state import ProgramState, WordBlock, tool_number

_LINUXCNC = (LINUXCNC,)
_OUTPUT_WORDS = "PQERL"  # of outputs, inputs and commands of the user's own


@auxiliary()
def m2(state: ProgramState, block: WordBlock) -> None:
    """End of the program."""
    block.ends = True


@auxiliary()
def m30(state: ProgramState, block: WordBlock) -> None:
    """End of the program."""
    block.ends = True


@auxiliary(_LINUXCNC)
def m70(state: ProgramState, block: WordBlock) -> None:
    """Save the modes."""
    state.save_modes(restored=False)


@auxiliary(_LINUXCNC)
def m71(state: ProgramState, block: WordBlock) -> None:
    """Forget the saved modes."""
    state.forget_modes()


@auxiliary(_LINUXCNC)
def m72(state: ProgramState, block: WordBlock) -> None:
    """Return to the saved modes."""
    state.restore_modes()


@auxiliary(_LINUXCNC)
def m73(state: ProgramState, block: WordBlock) -> None:
    """Save the modes, and return to them at the end of the subroutine."""
    state.save_modes(restored=True)


@without_effect(_LINUXCNC, halts=True)
def m0(state: ProgramState, block: WordBlock) -> None:
    """Pause."""


@without_effect(_LINUXCNC, halts=True)
def m1(state: ProgramState, block: WordBlock) -> None:
    """Pause, if the operator wants it."""


@without_effect(_LINUXCNC, halts=True)
def m3(state: ProgramState, block: WordBlock) -> None:
    """Spindle clockwise."""


@without_effect(_LINUXCNC, halts=True)
def m4(state: ProgramState, block: WordBlock) -> None:
    """Spindle counter-clockwise."""


@without_effect(_LINUXCNC, halts=True)
def m5(state: ProgramState, block: WordBlock) -> None:
    """Spindle off."""


@auxiliary(_LINUXCNC, halts=True)
def m6(state: ProgramState, block: WordBlock) -> None:
    """Change to the tool T: no motion, but its diameter and length are those in force."""
    _put_in_spindle(state, state.tools.selected, "M6")
    state.take_place()


@without_effect(_LINUXCNC, halts=True)
def m7(state: ProgramState, block: WordBlock) -> None:
    """Mist on."""


@without_effect(_LINUXCNC, halts=True)
def m8(state: ProgramState, block: WordBlock) -> None:
    """Coolant on."""


@without_effect(_LINUXCNC, halts=True)
def m9(state: ProgramState, block: WordBlock) -> None:
    """Mist and coolant off."""


@auxiliary(_LINUXCNC, halts=True)
def m19(state: ProgramState, block: WordBlock) -> None:
    """Spindle to the angle R, in the direction P."""
    between("M19: R", block.values.get("R", 0.0), 0, 360, "deg")
    if block.values.get("P", 0) not in (0, 1, 2):
        raise InputError(f"M19: P = {block.values['P']:g}: must be 0, 1 or 2")
    state.ignored["M19"] += 1
    block.drop(_OUTPUT_WORDS)


@without_effect(_LINUXCNC)
def m48(state: ProgramState, block: WordBlock) -> None:
    """Overrides of speed and feed on."""


@without_effect(_LINUXCNC)
def m49(state: ProgramState, block: WordBlock) -> None:
    """Overrides of speed and feed off."""


@without_effect(_LINUXCNC, takes=_OUTPUT_WORDS)
def m50(state: ProgramState, block: WordBlock) -> None:
    """Override of the feed on or off."""


@without_effect(_LINUXCNC, takes=_OUTPUT_WORDS)
def m51(state: ProgramState, block: WordBlock) -> None:
    """Override of the spindle's speed on or off."""


@without_effect(_LINUXCNC, takes=_OUTPUT_WORDS, halts=True)
def m52(state: ProgramState, block: WordBlock) -> None:
    """Adaptive feed on or off."""


@without_effect(_LINUXCNC, takes=_OUTPUT_WORDS, halts=True)
def m53(state: ProgramState, block: WordBlock) -> None:
    """Feed stop on or off."""


@without_effect(_LINUXCNC, halts=True)
def m60(state: ProgramState, block: WordBlock) -> None:
    """Pause for a change of the pallet."""


@auxiliary(_LINUXCNC)
def m61(state: ProgramState, block: WordBlock) -> None:
    """Number Q of the tool in the spindle."""
    if "Q" not in block.values:
        raise InputError("M61: must have Q, the number of the tool in the spindle")
    _put_in_spindle(state, tool_number("M61 Q", block.values["Q"]), "M61")
    block.drop(_OUTPUT_WORDS)


def _put_in_spindle(state: ProgramState, tool: int, name: str) -> None:
    if state.compensation.is_on:
        raise InputError(f"{name} under cutter compensation: must follow G40")
    state.tools.in_spindle = tool
    state.ignored[name] += 1


@auxiliary(_LINUXCNC)
def m62(state: ProgramState, block: WordBlock) -> None:
    """Output on, with the next motion."""
    _switch_output(state, block, "M62")


@auxiliary(_LINUXCNC)
def m63(state: ProgramState, block: WordBlock) -> None:
    """Output off, with the next motion."""
    _switch_output(state, block, "M63")


@auxiliary(_LINUXCNC, halts=True)
def m64(state: ProgramState, block: WordBlock) -> None:
    """Output on at once."""
    _switch_output(state, block, "M64")


@auxiliary(_LINUXCNC, halts=True)
def m65(state: ProgramState, block: WordBlock) -> None:
    """Output off at once."""
    _switch_output(state, block, "M65")


def _switch_output(state: ProgramState, block: WordBlock, name: str) -> None:
    _check_number(block, name, "P", "output")
    state.ignored[name] += 1
    block.drop(_OUTPUT_WORDS)


def _check_number(block: WordBlock, name: str, letter: str, subject: str) -> None:
    if round(block.values.get(letter, -1)) < 0:
        stated = f" {letter}{block.values[letter]:g}" if letter in block.values else ""
        raise InputError(f"{name}{stated}: must have {letter}, the number of an {subject}, at least 0")


@auxiliary(_LINUXCNC, halts=True)
def m66(state: ProgramState, block: WordBlock) -> None:
    """Wait for the input P or E, as L says, for at most Q."""
    values = block.values
    if "P" in values and "E" in values:
        raise InputError("M66 with P and E: must have one of them, a digital or an analogue input")
    _check_number(block, "M66", "E" if "E" in values else "P", "input")
    waits = round(values.get("L", 0)) != 0
    if waits and "E" in values:
        raise InputError(f"M66 E with L{values['L']:g}: must be without L, as analogue inputs are read at once")
    if waits and values.get("Q", 0) <= 0:
        raise InputError(f"M66 with L{values['L']:g}: must have Q, the longest wait, above 0 s")
    state.ignored["M66"] += 1
    block.drop(_OUTPUT_WORDS)


@auxiliary(_LINUXCNC)
def m67(state: ProgramState, block: WordBlock) -> None:
    """Analogue output E at the value Q, with the next motion."""
    _set_analogue(state, block, "M67")


@auxiliary(_LINUXCNC, halts=True)
def m68(state: ProgramState, block: WordBlock) -> None:
    """Analogue output E at the value Q, at once."""
    _set_analogue(state, block, "M68")


def _set_analogue(state: ProgramState, block: WordBlock, name: str) -> None:
    _check_number(block, name, "E", "output")
    number = block.values["E"]
    if not state.set_flow(f"M67 E{number:g}", block.values.get("Q", 0.0)):
        state.ignored[name] += 1
    # R and P of an arc in the same block stay
    block.drop("EQ")


@without_effect(_LINUXCNC, takes=_OUTPUT_WORDS, names=[f"M{number}" for number in range(100, 200)], halts=True)
def user_defined(state: ProgramState, block: WordBlock) -> None:
    """M100 to M199: commands of the user's own."""
