"""Cutter compensation: the path at half of a tool's diameter beside the programmed one."""

from __future__ import annotations

from gantrysim.base.errors import InputError
from gantrysim.controllers.gcode.codes.code_table import LINUXCNC, SLICER, refused_code, setting
from gantrysim.controllers.gcode.program_state import ProgramState, WordBlock

_GROUP = "cutter compensation"
_LINUXCNC = (LINUXCNC,)
_SLICER = (SLICER,)
_SUBJECT = "cutter compensation"
_PROGRAM_THE_PATH = "; program the nozzle's path"
_LEFT = 1.0
_RIGHT = -1.0
_PLANES = 2  # G17 and G18, the first of the planes


@setting(_GROUP)
def g40(state: ProgramState, block: WordBlock) -> None:
    """Cutter compensation off."""
    state.compensation.end()


@setting(_GROUP, _LINUXCNC)
def g41(state: ProgramState, block: WordBlock) -> None:
    """Path on the left of the programmed one, by half the diameter of the tool D, or of the one in the spindle."""
    _begin(state, _LEFT * _diameter_of_tool(state, block))


@setting(_GROUP, _LINUXCNC)
def g41_1(state: ProgramState, block: WordBlock) -> None:
    """Path on the left of the programmed one, by half the diameter D."""
    _begin(state, _LEFT * _diameter_given(state, block, "G41.1"))


@setting(_GROUP, _LINUXCNC)
def g42(state: ProgramState, block: WordBlock) -> None:
    """Path on the right of the programmed one, by half the diameter of the tool D, or of the one in the spindle."""
    _begin(state, _RIGHT * _diameter_of_tool(state, block))


@setting(_GROUP, _LINUXCNC)
def g42_1(state: ProgramState, block: WordBlock) -> None:
    """Path on the right of the programmed one, by half the diameter D."""
    _begin(state, _RIGHT * _diameter_given(state, block, "G42.1"))


def _diameter_of_tool(state: ProgramState, block: WordBlock) -> float:
    number = block.values.pop("D", state.tools.in_spindle)
    if number < 0 or number != int(number):
        raise InputError(f"D{number:g}: must be the number of a tool")
    return state.tools.diameter(int(number))


def _diameter_given(state: ProgramState, block: WordBlock, name: str) -> float:
    if "D" not in block.values:
        raise InputError(f"{name}: must have a diameter D")
    # where a lathe's tool points
    block.drop("L")
    return block.values.pop("D") * state.frames.unit


def _begin(state: ProgramState, diameter: float) -> None:
    if state.compensation.is_on:
        raise InputError("cutter compensation is on already: must end with G40 before it begins again")
    if diameter and state.modes.plane >= _PLANES:
        raise InputError(f"cutter compensation in G{17 + state.modes.plane}: must be in G17 or G18")
    state.compensation.begin(0.5 * diameter, state.modes.plane)


@refused_code(_SUBJECT, _PROGRAM_THE_PATH, _SLICER, names=("G41", "G41.1", "G42", "G42.1"))
def printers_compensation(state: ProgramState, block: WordBlock) -> None:
    """Cutter compensation, which printers do not have."""
