"""Modal groups of settings: plane, units, distances, feed, corners, tool length, cutter compensation."""

from __future__ import annotations

from gantrysim.base.errors import InputError, at_least
from gantrysim.controllers.gcode.codes.code_table import LINUXCNC, SLICER, refused_code, setting, without_effect
from gantrysim.controllers.gcode.coordinate_systems import INCH
from gantrysim.controllers.gcode.move_table import EXACT_PATH, EXACT_STOP
from gantrysim.controllers.gcode.program_state import ProgramState, WordBlock, tool_number

_COMPENSATION = "cutter compensation"
_LINUXCNC = (LINUXCNC,)
_SLICER = (SLICER,)
_SUBJECT = "cutter compensation"
_PROGRAM_THE_PATH = "; program the nozzle's path"
_LEFT = 1.0
_RIGHT = -1.0
_PLANES = 2  # G17 and G18, the first of the planes


@setting("diameter")
def g7(state: ProgramState, block: WordBlock) -> None:
    """X is a diameter."""
    state.frames.diameter = True


@setting("diameter")
def g8(state: ProgramState, block: WordBlock) -> None:
    """X is a radius."""
    state.frames.diameter = False


@setting("plane")
def g17(state: ProgramState, block: WordBlock) -> None:
    """Arcs in the XY plane."""
    _choose_plane(state, 0)


@setting("plane")
def g18(state: ProgramState, block: WordBlock) -> None:
    """Arcs in the ZX plane."""
    _choose_plane(state, 1)


@setting("plane")
def g19(state: ProgramState, block: WordBlock) -> None:
    """Arcs in the YZ plane."""
    _choose_plane(state, 2)


def _choose_plane(state: ProgramState, plane: int) -> None:
    if plane != state.modes.plane and state.compensation.is_on:
        raise InputError(f"G{17 + plane} under cutter compensation in G{17 + state.modes.plane}: must follow G40")
    state.modes.plane = plane


@setting("units")
def g20(state: ProgramState, block: WordBlock) -> None:
    """Lengths in inches."""
    state.frames.unit = INCH


@setting("units")
def g21(state: ProgramState, block: WordBlock) -> None:
    """Lengths in millimetres."""
    state.frames.unit = 1.0


@setting("tool length")
def g43(state: ProgramState, block: WordBlock) -> None:
    """Tool length of the tool H, by default of the one in the spindle."""
    state.frames.tool = _length_of_tool(state, block)


@setting("tool length")
def g43_1(state: ProgramState, block: WordBlock) -> None:
    """Tool length Z; those along X and Y do not matter to a nozzle that points down."""
    state.frames.tool = state.frames.unit * block.values.pop("Z", 0.0)
    block.drop("XY")


@setting("tool length")
def g43_2(state: ProgramState, block: WordBlock) -> None:
    """Tool length of the tool H, by default of the one in the spindle, added to that in force."""
    state.frames.tool = _length_of_tool(state, block) + state.frames.tool


@setting("tool length")
def g49(state: ProgramState, block: WordBlock) -> None:
    """No tool length."""
    state.frames.tool = 0.0


def _length_of_tool(state: ProgramState, block: WordBlock) -> float:
    number = tool_number("H", block.values.pop("H", state.tools.in_spindle))
    # the tool 0 is an empty spindle
    if number and number not in state.frames.tools:
        state.tools.without_length.add(number)
    return state.frames.tools.get(number, 0.0)


@setting("corners")
def g61(state: ProgramState, block: WordBlock) -> None:
    """Exact path."""
    state.modes.path = EXACT_PATH
    state.modes.naive = 0.0


@setting("corners")
def g61_1(state: ProgramState, block: WordBlock) -> None:
    """Exact stop."""
    state.modes.path = EXACT_STOP
    state.modes.naive = 0.0


@setting("corners")
def g64(state: ProgramState, block: WordBlock) -> None:
    """Corners rounded within P, by default as far as the lines reach, and lines merged within Q, by default P."""
    unit = state.frames.unit
    tolerance = block.values.pop("P", None)
    naive = block.values.pop("Q", None)
    block.drop("R")
    # P0 is no tolerance, as without P
    state.modes.blend(tolerance * unit if tolerance else state.setup.path_mode)
    if naive is not None:
        state.modes.naive = naive * unit
    for letter, length in (("P", tolerance), ("Q", naive)):
        if length is not None:
            at_least(f"G64: {letter}", length * unit, 0, "mm")


@setting("distances")
def g90(state: ProgramState, block: WordBlock) -> None:
    """Absolute ends, and where E feeds material absolute extrusion."""
    state.frames.absolute = True
    if state.dialect.extrudes:
        state.extruder.set_distances(absolute=True)


@setting("distances")
def g91(state: ProgramState, block: WordBlock) -> None:
    """Incremental ends, and where E feeds material relative extrusion."""
    state.frames.absolute = False
    if state.dialect.extrudes:
        state.extruder.set_distances(absolute=False)


@setting("arc centres")
def g90_1(state: ProgramState, block: WordBlock) -> None:
    """I, J, K are the centre."""
    state.modes.centres = True


@setting("arc centres")
def g91_1(state: ProgramState, block: WordBlock) -> None:
    """I, J, K lead from the start to the centre."""
    state.modes.centres = False


@setting("feed")
def g93(state: ProgramState, block: WordBlock) -> None:
    """F is the inverse of a move's time."""
    state.modes.feed_mode = "G93"


@setting("feed")
def g94(state: ProgramState, block: WordBlock) -> None:
    """F is per minute."""
    state.modes.feed_mode = "G94"


@setting("feed")
def g95(state: ProgramState, block: WordBlock) -> None:
    """F is per revolution of the spindle."""
    state.modes.feed_mode = "G95"


@without_effect((LINUXCNC,), takes="D")
def g96(state: ProgramState, block: WordBlock) -> None:
    """Spindle at a constant surface speed."""


@without_effect((LINUXCNC,))
def g97(state: ProgramState, block: WordBlock) -> None:
    """Spindle at S revolutions per minute."""


@setting(_COMPENSATION)
def g40(state: ProgramState, block: WordBlock) -> None:
    """Cutter compensation off."""
    state.compensation.end()


@setting(_COMPENSATION, _LINUXCNC)
def g41(state: ProgramState, block: WordBlock) -> None:
    """Path on the left of the programmed one, by half the diameter of the tool D, or of the one in the spindle."""
    _begin_compensation(state, _LEFT * _diameter_of_tool(state, block))


@setting(_COMPENSATION, _LINUXCNC)
def g41_1(state: ProgramState, block: WordBlock) -> None:
    """Path on the left of the programmed one, by half the diameter D."""
    _begin_compensation(state, _LEFT * _diameter_given(state, block, "G41.1"))


@setting(_COMPENSATION, _LINUXCNC)
def g42(state: ProgramState, block: WordBlock) -> None:
    """Path on the right of the programmed one, by half the diameter of the tool D, or of the one in the spindle."""
    _begin_compensation(state, _RIGHT * _diameter_of_tool(state, block))


@setting(_COMPENSATION, _LINUXCNC)
def g42_1(state: ProgramState, block: WordBlock) -> None:
    """Path on the right of the programmed one, by half the diameter D."""
    _begin_compensation(state, _RIGHT * _diameter_given(state, block, "G42.1"))


def _diameter_of_tool(state: ProgramState, block: WordBlock) -> float:
    return state.tools.diameter(tool_number("D", block.values.pop("D", state.tools.in_spindle)))


def _diameter_given(state: ProgramState, block: WordBlock, name: str) -> float:
    if "D" not in block.values:
        raise InputError(f"{name}: must have a diameter D")
    # where a lathe's tool points
    block.drop("L")
    return block.values.pop("D") * state.frames.unit


def _begin_compensation(state: ProgramState, diameter: float) -> None:
    if state.compensation.is_on:
        raise InputError("cutter compensation is on already: must end with G40 before it begins again")
    if diameter and state.modes.plane >= _PLANES:
        raise InputError(f"cutter compensation in G{17 + state.modes.plane}: must be in G17 or G18")
    state.compensation.begin(0.5 * diameter, state.modes.plane)


@refused_code(_SUBJECT, _PROGRAM_THE_PATH, _SLICER, names=("G41", "G41.1", "G42", "G42.1"))
def printers_compensation(state: ProgramState, block: WordBlock) -> None:
    """Cutter compensation, which printers do not have."""
