"""Codes of printers' firmware, those of the extruder among them; codes that are not here are counted as well."""

from __future__ import annotations

from gantrysim.base.errors import InputError, at_least
from gantrysim.controllers.gcode.codes.code_table import SLICER, action, auxiliary, command, without_effect
from gantrysim.controllers.gcode.extruder import LONGEST_ADVANCE, SMOOTH_TIME
from gantrysim.controllers.gcode.motion_limits import UNLIMITED, Three
from gantrysim.controllers.gcode.program_state import ProgramState, WordBlock

_SLICER = (SLICER,)
_VELOCITY_LIMITS = ("VELOCITY", "ACCEL", "SQUARE_CORNER_VELOCITY")

_EXTRUDER = "EXTRUDER"  # Klipper's name of the first


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


@auxiliary(_SLICER)
def m82(state: ProgramState, block: WordBlock) -> None:
    """Absolute extrusion."""
    state.extruder.set_relative(False)
    block.keeps_words = True


@auxiliary(_SLICER)
def m83(state: ProgramState, block: WordBlock) -> None:
    """Relative extrusion."""
    state.extruder.set_relative(True)
    block.keeps_words = True


@action(_SLICER)
def g10(state: ProgramState, block: WordBlock) -> None:
    """Retract the filament by the length of M207 or SET_RETRACTION; with P or L, settings of a tool."""
    if "P" in block.values or "L" in block.values:
        state.ignored["G10 of a tool"] += 1
        block.values.clear()
        return
    block.values.clear()
    _retract(state, "G10")


@action(_SLICER)
def g11(state: ProgramState, block: WordBlock) -> None:
    """Feed the retracted filament, and the extra length of M208 or SET_RETRACTION."""
    block.values.clear()
    _recover(state, "G11")


@action(_SLICER)
def g22(state: ProgramState, block: WordBlock) -> None:
    """As G10, in older firmware."""
    block.values.clear()
    _retract(state, "G22")


@action(_SLICER)
def g23(state: ProgramState, block: WordBlock) -> None:
    """As G11, in older firmware."""
    block.values.clear()
    _recover(state, "G23")


def _retract(state: ProgramState, name: str) -> None:
    retraction = state.extruder.retraction
    if retraction.length is None:
        state.ignored[f"{name}, whose length the program does not state"] += 1
    elif not retraction.is_on:
        state.feed_material(-retraction.length, retraction.speed)
        retraction.is_on = True


def _recover(state: ProgramState, name: str) -> None:
    retraction = state.extruder.retraction
    if retraction.length is None:
        state.ignored[f"{name}, whose length the program does not state"] += 1
    elif retraction.is_on:
        state.feed_material(retraction.length + retraction.extra, retraction.recover_speed)
        retraction.is_on = False


@auxiliary(_SLICER)
def m200(state: ProgramState, block: WordBlock) -> None:
    """E is a volume [mm³] of filament of the diameter D [mm]; a length again after D0 or S0."""
    diameter = at_least("M200: D", block.values.get("D", state.extruder.filament), 0, "mm")
    state.extruder.filament = 0.0 if block.values.get("S") == 0 else diameter


@auxiliary(_SLICER)
def m207(state: ProgramState, block: WordBlock) -> None:
    """Retraction of G10: length S [mm], feed F [mm/min]; in RepRapFirmware extra R and feed T of G11."""
    retraction = state.extruder.retraction
    values = block.values
    if "S" in values:
        retraction.length = at_least("M207: S", values["S"], 0, "mm")
    if "F" in values:
        retraction.speed = at_least("M207: F", values["F"], 0, "mm/min") / 60
        if state.extruder.firmware == "reprapfirmware":
            retraction.recover_speed = retraction.speed
    if "T" in values and state.extruder.firmware == "reprapfirmware":
        retraction.recover_speed = at_least("M207: T", values["T"], 0, "mm/min") / 60
    if "R" in values:
        retraction.extra = _extra("M207: R", values["R"], retraction.length)
    if values.get("Z"):
        state.ignored["Z of M207"] += 1


@auxiliary(_SLICER)
def m208(state: ProgramState, block: WordBlock) -> None:
    """Recovery of G11: length S on top of the retracted one [mm], feed F [mm/min]."""
    retraction = state.extruder.retraction
    if "S" in block.values:
        retraction.extra = _extra("M208: S", block.values["S"], retraction.length)
    if "F" in block.values:
        retraction.recover_speed = at_least("M208: F", block.values["F"], 0, "mm/min") / 60


def _extra(name: str, length: float, retracted: float | None) -> float:
    if length < -(retracted or 0.0):
        raise InputError(f"{name} = {length:g} mm: must be at least the retracted length with a minus")
    return length


@command()
def set_retraction(state: ProgramState, block: WordBlock) -> None:
    """Klipper's retraction of G10 and G11: RETRACT_LENGTH, RETRACT_SPEED, UNRETRACT_EXTRA_LENGTH, UNRETRACT_SPEED."""
    retraction = state.extruder.retraction
    values = block.named_numbers(
        ("RETRACT_LENGTH", "RETRACT_SPEED", "UNRETRACT_EXTRA_LENGTH", "UNRETRACT_SPEED"), least=0.0
    )
    retraction.length = values.get("RETRACT_LENGTH", retraction.length)
    retraction.speed = values.get("RETRACT_SPEED", retraction.speed)
    retraction.extra = values.get("UNRETRACT_EXTRA_LENGTH", retraction.extra)
    retraction.recover_speed = values.get("UNRETRACT_SPEED", retraction.recover_speed)


@auxiliary(_SLICER)
def m221(state: ProgramState, block: WordBlock) -> None:
    """Factor S on all that E feeds [%]."""
    if "S" in block.values:
        state.extruder.factor = at_least("M221: S", block.values["S"], 0, "%") / 100


@auxiliary(_SLICER)
def m572(state: ProgramState, block: WordBlock) -> None:
    """Pressure advance S of RepRapFirmware [s]."""
    if "S" in block.values:
        state.extruder.set_advance(advance=block.values["S"], smooth_time=0.0)


@auxiliary(_SLICER)
def m900(state: ProgramState, block: WordBlock) -> None:
    """Linear advance K of Marlin [s]."""
    if "K" not in block.values:
        return
    if block.values["K"] > LONGEST_ADVANCE:
        # a factor of another law, of Marlin before 1.1.9; later ones refuse it and go on as they were
        state.ignored[f"M900 K above {LONGEST_ADVANCE:g}"] += 1
        return
    state.extruder.set_advance(advance=block.values["K"], smooth_time=0.0)


@command()
def set_pressure_advance(state: ProgramState, block: WordBlock) -> None:
    """Klipper's pressure advance: ADVANCE, SMOOTH_TIME, and OFFSET and VELOCITY of its non-linear laws."""
    name = block.argument(_EXTRUDER)
    if name not in (None, _EXTRUDER):
        state.ignored[f"SET_PRESSURE_ADVANCE of {name}"] += 1
        return
    values = block.named_numbers(("ADVANCE", "SMOOTH_TIME", "OFFSET", "VELOCITY"), least=0.0)
    changes = {key.lower(): value for key, value in values.items()}
    if "smooth_time" not in changes and not state.extruder.advance.smooth_time:
        changes["smooth_time"] = SMOOTH_TIME
    state.extruder.set_advance(**changes)
