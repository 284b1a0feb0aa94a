"""What LinuxCNC refuses of a block as a whole: two codes of one modal group, words without the code that needs them."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from gantrysim.base.errors import InputError
from gantrysim.controllers.gcode.codes import Code, Kind
from gantrysim.controllers.gcode.program_state import ProgramState, WordBlock

# M codes that exclude one another, by what they act on

_M_GROUPS = {
    "stops": (0, 1, 2, 30, 60),
    "the spindle and saved modes": (3, 4, 5, 19, 70, 71, 72, 73),
    "the tool": (6, 61),
    "coolant": (7, 8, 9),
    "overrides": tuple(range(48, 54)),
    "outputs and inputs": tuple(range(62, 69)),
}
_GROUP_OF = {f"M{number}": group for group, numbers in _M_GROUPS.items() for number in numbers}

# Codes that are no motion, but use the axis words of their block.

SHIFTS = frozenset({"G52", "G92"})
_AXIS_USERS = SHIFTS | {"G10", "G28", "G30"}
_AXES = frozenset("XYZABCUVW@^")

# Codes that are refused without an axis word: shifts, splines and canned cycles.

NEEDING_AXES = SHIFTS | {"G5", "G5.1", "G73", "G74", *(f"G{number}" for number in (*range(81, 87), 89))}

# Codes that cutter compensation allows: all else would change what the offset path refers to.

_COMPENSATED_MOTIONS = {"G0", "G1", "G2", "G3", "G80"}
_COMPENSATED_ACTIONS = {"G4", "G10", "G28.1", "G30.1"}
_ORIGIN_GROUPS = {"tool length", "coordinate system", "shift", "machine coordinates"}


def check_block(names: Collection[str], block: WordBlock, table: Mapping[str, Code]) -> None:
    """Check that the codes of a block go together.

    Args:
        names: of its G and M codes.
        block: with its other words.
        table: of the codes, by name.

    Raises:
        InputError: two codes of a modal group, two that use the same axis words, or one without the words it needs.
    """
    seen: dict[tuple[Kind, str], str] = {}
    motion = user = None
    for name in names:
        code = table.get(name)
        group = _GROUP_OF.get(name, code.group if code else "")
        # G80 ends a cycle, not the motion that stands beside it
        if code is None or name == "G80":
            continue
        if code.kind is Kind.MOTION:
            motion = name
        if name in _AXIS_USERS:
            user = name
        other = seen.setdefault((code.kind, group), name) if group else name
        if other != name:
            both = f"{other} and {name} in one block"
            raise InputError(f"{both}: are of one modal group ({group}), must be in two blocks")
    if motion and user:
        raise InputError(f"{user} and {motion} in one block: both use its axis words, must be in two blocks")
    for name in names:
        if name in NEEDING_AXES and _AXES.isdisjoint(block.values):
            raise InputError(f"{name}: must have a word of an axis")
    if motion in ("G2", "G3") and "G4" in names:
        raise InputError(f"G4 and {motion} in one block: both use its P, must be in two blocks")


def check_inverse_time(code: Code) -> None:
    """Raise InputError for a motion at feed that has no F in G93, where F is of its own block."""
    if not code.is_cycle and code.name not in ("G0", "G80"):
        raise InputError(f"{code.name} in G93: must have an F in its block, the inverse of its time in minutes")


def check_compensation(state: ProgramState, code: Code) -> None:
    """Check that a code does not change what the path of cutter compensation refers to.

    Raises:
        InputError: a code that does.
    """
    if state.compensation.is_on and _needs_plain_path(code):
        raise InputError(f"{code.name} under cutter compensation: must follow G40")


def _needs_plain_path(code: Code) -> bool:
    """Return whether a code is refused under cutter compensation."""
    match code.kind:
        case Kind.MOTION:
            return code.name not in _COMPENSATED_MOTIONS
        case Kind.ACTION:
            return code.name not in _COMPENSATED_ACTIONS
        case _:
            return code.group in _ORIGIN_GROUPS
