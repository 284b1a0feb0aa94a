"""Coordinate systems, their shifts, and the stored positions."""

from __future__ import annotations

from gantrysim.base.errors import InputError
from gantrysim.controllers.gcode.codes.code_table import LINUXCNC, action, setting
from gantrysim.controllers.gcode.program_state import ProgramState, WordBlock, tool_number
from gantrysim.controllers.placement import higher

_AXES = "XYZ"
_TABLE_WORDS = "XYZABCUVWRIJQ"  # of a tool's table, of which only Z matters


@action((LINUXCNC,))
def g10(state: ProgramState, block: WordBlock) -> None:
    """Set what L says: the length Z and radius R of a tool, L1, or a coordinate system, L2 and L20."""
    frames = state.frames
    kind = block.values.pop("L", None)
    number = block.values.pop("P", 0.0)
    if kind in (2, 20):
        frames.set_offset(number, block.values, current=kind == 20)
    elif kind == 1:
        tool = tool_number("G10 L1 P", number)
        if "Z" in block.values:
            frames.tools[tool] = frames.unit * block.values.pop("Z")
        if "R" in block.values:
            state.tools.diameters[tool] = 2 * frames.unit * block.values.pop("R")
        block.drop(_TABLE_WORDS)
    elif kind in (0, 10, 11):
        state.ignored[f"G10 L{kind:g}"] += 1
        block.drop(_TABLE_WORDS)
    else:
        stated = "" if kind is None else f" L{kind:g}"
        raise InputError(f"G10{stated}: must be L1, L2, L10, L11 or L20")


@action((LINUXCNC,))
def g28(state: ProgramState, block: WordBlock) -> None:
    """Rapid move to the position that G28.1 stored, by way of the end, with the axes that are given."""
    _go_to_stored(state, block, "G28")


@action()
def g28_1(state: ProgramState, block: WordBlock) -> None:
    """Store the position for G28."""
    state.frames.stored["G28"] = list(state.frames.here)


@action()
def g30(state: ProgramState, block: WordBlock) -> None:
    """Rapid move to the position that G30.1 stored, by way of the end, with the axes that are given."""
    _go_to_stored(state, block, "G30")


@action()
def g30_1(state: ProgramState, block: WordBlock) -> None:
    """Store the position for G30."""
    state.frames.stored["G30"] = list(state.frames.here)


def _go_to_stored(state: ProgramState, block: WordBlock, name: str) -> None:
    frames = state.frames
    named = [letter in block.values for letter in _AXES]
    if any(named):
        state.rapid_to(frames.end(block.values, in_machine=False))
    else:
        named = [True] * 3
    place = list(frames.stored.get(name, frames.start))
    if name not in frames.stored:
        # the reference point of z is above the work: the needle does not go down to the start's height
        place[2] = higher(state.setup.upward, place[2], frames.here[2])
    stored = zip(place, frames.here, named, strict=True)
    state.rapid_to([target if moves else here for target, here, moves in stored])


@action()
def g52(state: ProgramState, block: WordBlock) -> None:
    """Local shift of the coordinates."""
    _set_extruder(state, block)
    state.frames.set_shift(block.values, local=True)


@action()
def g92(state: ProgramState, block: WordBlock) -> None:
    """Shift that gives the position these coordinates; with E the extruder's position."""
    # slicers reset E so that its numbers stay short: that sets a position and feeds nothing
    _set_extruder(state, block)
    state.frames.set_shift(block.values, local=False)


def _set_extruder(state: ProgramState, block: WordBlock) -> None:
    if "E" in block.values and state.dialect.extrudes:
        state.extruder.position = block.values.pop("E")


@setting("shift")
def g92_1(state: ProgramState, block: WordBlock) -> None:
    """No shift, also for G92.3."""
    state.frames.shift = [0.0] * 3
    state.frames.suspended_shift = [0.0] * 3


@setting("shift")
def g92_2(state: ProgramState, block: WordBlock) -> None:
    """No shift until G92.3."""
    state.frames.shift = [0.0] * 3


@setting("shift")
def g92_3(state: ProgramState, block: WordBlock) -> None:
    """The shift that G92.2 suspended."""
    state.frames.shift = list(state.frames.suspended_shift)


@setting("machine coordinates")
def g53(state: ProgramState, block: WordBlock) -> None:
    """Coordinates of the machine, in this block."""
    block.in_machine = True


@setting("coordinate system")
def g54(state: ProgramState, block: WordBlock) -> None:
    """Coordinate system 1."""
    state.frames.system = 1


@setting("coordinate system")
def g55(state: ProgramState, block: WordBlock) -> None:
    """Coordinate system 2."""
    state.frames.system = 2


@setting("coordinate system")
def g56(state: ProgramState, block: WordBlock) -> None:
    """Coordinate system 3."""
    state.frames.system = 3


@setting("coordinate system")
def g57(state: ProgramState, block: WordBlock) -> None:
    """Coordinate system 4."""
    state.frames.system = 4


@setting("coordinate system")
def g58(state: ProgramState, block: WordBlock) -> None:
    """Coordinate system 5."""
    state.frames.system = 5


@setting("coordinate system")
def g59(state: ProgramState, block: WordBlock) -> None:
    """Coordinate system 6."""
    state.frames.system = 6


@setting("coordinate system")
def g59_1(state: ProgramState, block: WordBlock) -> None:
    """Coordinate system 7."""
    state.frames.system = 7


@setting("coordinate system")
def g59_2(state: ProgramState, block: WordBlock) -> None:
    """Coordinate system 8."""
    state.frames.system = 8


@setting("coordinate system")
def g59_3(state: ProgramState, block: WordBlock) -> None:
    """Coordinate system 9."""
    state.frames.system = 9
