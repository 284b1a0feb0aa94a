"""A program's text as a table of moves.

`interpret` runs a program line by line. The flow of the program, `ProgramFlow`, yields one line after the other, with
its expressions evaluated; `Interpreter` applies the words of a line to the state of the program, whose codes add moves
to the table. From the table follows when the valve is open.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Set
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import AxisError, InputError, at_least
from gantrysim.controllers.gcode.block_rules import NEEDING_AXES, check_block, check_compensation, check_inverse_time
from gantrysim.controllers.gcode.codes import CODES, Code, Kind
from gantrysim.controllers.gcode.extruder import PressureAdvance
from gantrysim.controllers.gcode.lines import FirmwareCommand, Words
from gantrysim.controllers.gcode.motion_limits import MotionLimits
from gantrysim.controllers.gcode.move_table import FLOW, MoveTable, valve_of
from gantrysim.controllers.gcode.o_words import ProgramFlow, ProgramText
from gantrysim.controllers.gcode.program_state import UNSTATED_FEED, ProgramSetup, ProgramState, WordBlock, tool_number
from gantrysim.controllers.valve import SPEED_CODES, Valve

# Codes that change an origin, for which LinuxCNC and grbl wait for the moves before them; G10 is another one, for the
# system in force.

_RESTING_GROUPS = {"tool length", "coordinate system", "shift"}
_RESTING_CODES = {"G52", "G92"}

_LINEAR_AXES = frozenset("XYZ")
_ROTARY_AND_PARALLEL_AXES = "ABCUVW"
_FAN_ON = 106
_FAN_OFF = 107
# set point of a fan by M106 without S
_FULL_FAN = 255.0
# names of codes that are kept in memory: a program may have any number of unknown ones
_KEPT_NAMES = 1000


def interpret(program: ProgramText, start: tuple[float, float, float], setup: ProgramSetup) -> Interpreted:
    """Run a program.

    Args:
        program: its text.
        start: initial position [mm].
        setup: what it is run with.

    Raises:
        InputError: a line that is refused, with its number.
    """
    moves = MoveTable(start)
    state = ProgramState(moves, setup)
    interpreter = Interpreter(state)

    def system(key: float | str) -> float | None:
        # of the expression that reads #<_line>, before the words of its line are run
        state.line = flow.line
        return provided_parameter(state, key)

    flow = ProgramFlow(program, system, state.subprogram_ends)
    subroutines = tuple(str(label) for label in flow.places.labels("SUB"))
    try:
        for line in flow.run():
            state.line = flow.line
            state.depth = flow.depth
            if not interpreter.run(line):
                break
        if state.curve is not None:
            raise InputError(f"{state.curve.name}: the program ends before the curve does")
    except InputError as error:
        kind = AxisError if isinstance(error, AxisError) else InputError
        raise kind(f"{flow.where}: {error}") from None
    except OverflowError:
        raise InputError(f"{flow.where}: a number is too large") from None
    called_files = flow.called_files
    # the flow and its parameters refer to one another, and would keep them until a collection
    flow.lines.clear()
    table = moves.table
    valve = valve_of(table, start, state.outputs, setup.upward)
    for code in valve.switching_codes:
        state.ignored.pop(code, None)
    return Interpreted(
        start=start,
        moves=table,
        glue=valve.laid,
        valve=valve,
        ignored=state.ignored,
        without_feed=state.without_feed,
        limits=tuple(state.limits.rows),
        assumed_feeds=tuple(sorted(state.assumed_feeds)),
        subroutines=subroutines,
        called_files=called_files,
        without_diameter=tuple(sorted(state.tools.without_diameter)),
        without_length=tuple(sorted(state.tools.without_length)),
        advances=tuple(state.extruder.advances),
        sets_advance=state.extruder.sets_advance,
        filament=state.extruder.filament,
        lost_relative=state.extruder.lost,
        halt_lines=frozenset(state.halt_lines),
        power_stops=state.power_stops,
        unused_set_points=state.unused_set_points,
        unclosed=tuple(flow.unclosed),
    )


@dataclass(frozen=True)
class Interpreted:
    """A program that was run.

    Attributes:
        start: initial position [mm].
        moves: rows of `MoveTable`, (m, WIDTH).
        glue: whether glue is laid in them, (m,).
        valve: what opens it.
        ignored: words without an effect on the path, and how often they were met.
        without_feed: moves at a feed that the program has not stated.
        limits: to which the moves refer.
        assumed_feeds: names of the machine's feeds that the program reads and that nobody gave.
        subroutines: names of those that the text holds.
        called_files: names of the files of subprograms that were called.
        without_diameter: tools of cutter compensation whose diameter nobody gave.
        without_length: tools of G43 whose length nobody gave.
        advances: pressure advances to which the moves refer.
        sets_advance: whether the program sets its pressure advance.
        filament: diameter by which E was a volume; 0 where it was a length [mm].
        lost_relative: words E that were absolute after G90, though M83 had made E relative.
        halt_lines: lines at which the motion stops for a code that is no dwell.
        power_stops: moves before which it stops for their S.
        unused_set_points: values of the words that might set the flow, but do not.
        unclosed: notes on the branches and loops that ran without an end.
    """

    start: tuple[float, float, float]
    moves: Floats
    glue: NDArray[np.bool_]
    valve: Valve
    ignored: Counter[str]
    without_feed: int = 0
    limits: tuple[MotionLimits, ...] = (MotionLimits(),)
    assumed_feeds: tuple[str, ...] = ()
    subroutines: tuple[str, ...] = ()
    called_files: frozenset[str] = frozenset()
    without_diameter: tuple[int, ...] = ()
    without_length: tuple[int, ...] = ()
    advances: tuple[PressureAdvance, ...] = (PressureAdvance(),)
    sets_advance: bool = False
    filament: float = 0.0
    lost_relative: int = 0
    halt_lines: frozenset[int] = frozenset()
    power_stops: int = 0
    unused_set_points: Mapping[str, Set[float]] = field(default_factory=dict)
    unclosed: tuple[str, ...] = ()

    @property
    def feeds_material(self) -> bool:
        """Whether E feeds material anywhere."""
        return bool((self.moves[:, FLOW] > 0).any())

    @property
    def without_moves(self) -> str:
        """What a program without moves lacks, in words."""
        if not self.subroutines:
            return "must have a block that does"
        return f"its subroutines ({', '.join(self.subroutines[:3])}) run where another program calls them"


class Interpreter:
    """Applies the words of blocks one after the other.

    Args:
        state: of the program, which is changed.
    """

    def __init__(self, state: ProgramState) -> None:
        self._state = state
        self._dialect = state.dialect
        self._codes = CODES[state.dialect.name]

    def run(self, line: Words | FirmwareCommand) -> bool:
        """Apply a line; return whether the program goes on.

        Raises:
            InputError: a word, or a combination of words, that the dialect refuses.
        """
        if isinstance(line, FirmwareCommand):
            return self._run_command(line)
        codes: list[str] = []
        auxiliary: list[int] = []
        block = self._sort_words(line, codes, auxiliary)
        if (len(codes) + len(auxiliary) > 1 or not NEEDING_AXES.isdisjoint(codes)) and not self._dialect.lenient:
            check_block([*codes, *(f"M{number}" for number in auxiliary)], block, self._codes)
        if "T" in block.values and not self._dialect.extrudes:
            self._state.tools.selected = tool_number("T", block.values["T"])
        if self._halts(auxiliary, codes, block):
            self._state.halt()
        if auxiliary or "S" in block.values:
            self._switch_outputs(auxiliary, codes, block)
        for number in auxiliary:
            self._apply_auxiliary(number, block)
        if auxiliary and self._dialect.extrudes:
            # in firmware a line is one command: its words belong to its M code
            if not block.keeps_words:
                block.values.clear()
            if not codes:
                return not block.ends
        self._apply(codes, block)
        return not block.ends

    def _run_command(self, line: FirmwareCommand) -> bool:
        code = self._codes.get(line.name)
        block = WordBlock(arguments=line.arguments)
        if code is None or code.handler is None:
            self._state.ignored[line.name] += 1
        else:
            code.handler(self._state, block)
        return not block.ends

    def _sort_words(self, line: Words, codes: list[str], auxiliary: list[int]) -> WordBlock:
        """Add the G codes of a line to `codes` and its M codes to `auxiliary`; return its other words, without N."""
        block = WordBlock()
        for letter, value in line:
            if letter == "G":
                codes.append(_code_name(value))
            elif letter == "M":
                auxiliary.append(self._auxiliary_number(value))
            elif letter in block.values and letter != "N":
                raise InputError(f"{letter} is given twice in the block")
            else:
                block.values[letter] = value
        block.values.pop("N", None)
        return block

    def _auxiliary_number(self, value: float) -> int:
        number = round(value)
        if number != value and not self._dialect.lenient:
            raise InputError(f"M{value:g}: must be a whole number")
        return number

    def _halts(self, auxiliary: list[int], codes: list[str], block: WordBlock) -> bool:
        """Return whether a block waits for the moves before it: for some M codes, and for another spindle speed."""
        of_block = (self._codes.get(f"M{number}") for number in auxiliary)
        if any(code is not None and code.halts for code in of_block):
            return True
        state = self._state
        if self._dialect.extrudes or block.values.get("S", state.modes.spindle) == state.modes.spindle:
            return False
        moves = not _LINEAR_AXES.isdisjoint(block.values) and not any(map(self._is_action, codes))
        if moves and (state.setup.laser == "always" or (state.setup.laser == "M4" and state.outputs.is_reverse)):
            # S is the power of a laser, which grbl in laser mode changes with the motion
            return False
        state.power_stops += moves
        return True

    def _is_action(self, name: str) -> bool:
        code = self._codes.get(name)
        return code is not None and code.kind is Kind.ACTION

    def _switch_outputs(self, auxiliary: list[int], codes: list[str], block: WordBlock) -> None:
        """Switch outputs by M codes, and take the set point of the flow from S, of a spindle or a fan."""
        state = self._state
        # in firmware S is a speed in few blocks, and a time, a temperature or other in most
        is_speed = not self._dialect.extrudes or (SPEED_CODES.issuperset(auxiliary) and "G4" not in codes)
        speed = block.values.get("S") if is_speed else None
        state.outputs.switch(auxiliary, block.values.get("P"), speed, block.values.get("S"))
        if _FAN_ON in auxiliary:
            state.set_flow("M106", _FULL_FAN if speed is None else speed)
        elif _FAN_OFF in auxiliary:
            state.set_flow("M106", 0.0)
        elif speed is not None:
            state.set_flow("S", speed)

    def _apply_auxiliary(self, number: int, block: WordBlock) -> None:
        state = self._state
        name = f"M{number}"
        code = self._codes.get(name)
        if code is None and not self._dialect.lenient:
            raise InputError(f"{name}: is not a word of {self._dialect.name}")
        if code is not None and code.handler is not None:
            code.handler(state, block)
            return
        state.ignored[name] += 1
        if code is not None:
            block.drop(code.takes)

    def _apply(self, codes: list[str], block: WordBlock) -> None:
        """Apply the G codes of a block, then F, then the action or the motion in force."""
        state = self._state
        action: Code | None = None
        moves = False
        for name in codes:
            code = self._codes.get(name)
            if code is None or code.handler is None:
                self._ignore(name, code, block)
                continue
            check_compensation(state, code)
            if self._moves_origin(code, block):
                state.halt()
            if code.kind is Kind.MOTION:
                # G80 ends a cycle, not the motion that stands beside it
                if moves and name == "G80":
                    continue
                self._check_curve(name)
                state.motion = name
                moves = True
                if not code.is_cycle:
                    state.cycle = None
            elif code.kind is Kind.ACTION:
                if action:
                    raise InputError(f"{action.name} and {name} in one block: must be in blocks of their own")
                action = code
            else:
                code.handler(state, block)
        if "S" in block.values and not self._dialect.extrudes:
            # before the motion of its block, whose feed per revolution it may be
            state.modes.spindle = at_least("S", block.values["S"], 0)
        has_feed = "F" in block.values
        if has_feed:
            self._take_feed(block)
        for letter in state.setup.skip_axes:
            if letter in block.values:
                block.drop(letter)
                state.ignored[f"axis {letter}"] += 1
        if action and action.handler:
            action.handler(state, block)
        # the words of a block are those of its action, if it has one
        if block.values and (action is None or (action.shares_words and moves)):
            self._move(block, has_feed)
        if block.values:
            self._ignore_words(block)

    def _take_feed(self, block: WordBlock) -> None:
        modes = self._state.modes
        modes.feed = block.values.pop("F")
        if modes.feed < 0:
            raise InputError(f"F = {modes.feed:g}: must be at least 0")

    def _moves_origin(self, code: Code, block: WordBlock) -> bool:
        """Return whether a code changes what coordinates refer to, for which LinuxCNC waits for the moves before it."""
        if self._dialect.extrudes:
            return False
        frames = self._state.frames
        match code.group, code.name:
            case "coordinate system", name:
                return name != frames.system_name
            case _, "G10":
                # L2 and L20 of the system in force
                return block.values.get("L") in (2, 20) and block.values.get("P", 0.0) in (0, frames.system)
            case group, name:
                return group in _RESTING_GROUPS or name in _RESTING_CODES

    def _check_curve(self, motion: str) -> None:
        """Check that no other motion begins between the control points of a NURBS."""
        curve = self._state.curve
        if curve is not None and curve.name != motion:
            end = "G5.3" if curve.name == "G5.2" else f"{curve.order} equal knots"
            raise InputError(f"{motion} among the control points of {curve.name}: must follow {end}")

    def _ignore(self, name: str, code: Code | None, block: WordBlock) -> None:
        """Count a G code without an effect on the path."""
        if code is None and not self._dialect.lenient:
            raise InputError(f"{name}: is not a word of {self._dialect.name}")
        self._state.ignored[name] += 1
        if self._dialect.lenient:
            block.values.clear()
        elif code is not None:
            block.drop(code.takes)

    def _move(self, block: WordBlock, has_feed: bool) -> None:
        """Run the motion in force with the words of a block, which has an F or not."""
        state = self._state
        code = self._codes[state.motion]
        moves = not block.values.keys().isdisjoint(code.moved_by)
        if self._dialect.extrudes and "E" in block.values:
            # E is a position that counts in any case, also where no axis moves
            block.fed = state.material_fed(block.values.pop("E"))
        if not moves:
            # a retraction: the nozzle stands for the time that the feed takes
            if code.straight:
                state.feed_material(block.fed)
            return
        if state.modes.feed_mode == "G93" and not has_feed and not self._dialect.lenient:
            check_inverse_time(code)
        check_compensation(state, code)
        if block.in_machine and not code.straight:
            raise InputError("G53: must be with G0 or G1")
        if block.in_machine and not (state.frames.absolute or self._dialect.lenient):
            raise InputError("G53 in G91: must be in G90")
        assert code.handler is not None
        code.handler(state, block)

    def _ignore_words(self, block: WordBlock) -> None:
        """Count words without an effect on the path; refuse others."""
        state = self._state
        for letter in [letter for letter in block.values if letter in self._dialect.letters]:
            del block.values[letter]
            # no effect here, but G95 feeds per revolution
            if letter != "S":
                state.ignored[letter] += 1
        # an axis that the machine lacks stands at 0, in either distance mode
        for letter in [
            letter for letter, value in block.values.items() if letter in _ROTARY_AND_PARALLEL_AXES and value == 0
        ]:
            block.drop(letter)
            state.ignored[f"axis {letter}, which stands"] += 1
        if not block.values:
            return
        letter, value = next(iter(block.values.items()))
        if letter in _ROTARY_AND_PARALLEL_AXES:
            raise AxisError(
                f"{letter}{value:g} moves an axis that a program of {self._dialect.name} cannot have here: "
                f"must be x, y or z; skip_axes = {letter!r} skips the word"
            )
        if not self._dialect.lenient:
            raise InputError(f"{letter}{value:g}: is not used in this block")
        state.ignored[letter] += 1


@lru_cache(_KEPT_NAMES)
def _code_name(value: float) -> str:
    """Return the name of a G code; its number is rounded, as an expression in brackets may have computed it."""
    tenths = round(10 * value)
    if abs(tenths - 10 * value) > 1e-6:
        raise InputError(f"G{value:g}: must have one decimal at most")
    return f"G{tenths / 10:g}"


# The parameters that the controller provides: what a program reads of its own state.

# of LinuxCNC, whose words these are
_LINUXCNC_VERSION = 2.9

# by name
_NAMED_PARAMETERS: dict[str, Callable[[ProgramState], float]] = {
    "_line": lambda state: float(state.line),
    "_feed": lambda state: state.modes.feed,
    "_rpm": lambda state: state.modes.spindle,
    # G17 to G19, and the code of the motion in force, each times ten
    "_plane": lambda state: 170.0 + 10 * state.modes.plane,
    "_motion_mode": lambda state: float(round(10 * float(state.motion[1:]))),
    "_vmajor": lambda state: _LINUXCNC_VERSION,
    # as of a program that runs, outside any call
    "_vminor": lambda state: 0.0,
    "_task": lambda state: 0.0,
    "_call_level": lambda state: 0.0,
    "_remap_level": lambda state: 0.0,
    "_value": lambda state: 0.0,
    "_value_returned": lambda state: 0.0,
}

# of tools, by number and by name
_TOOL_PARAMETERS: dict[float | str, Callable[[ProgramState], float]] = {
    5400: lambda state: float(state.tools.in_spindle),
    5410: lambda state: state.tools.diameters.get(state.tools.in_spindle, 0.0) / state.frames.unit,
    "_current_tool": lambda state: float(state.tools.in_spindle),
    "_selected_tool": lambda state: float(state.tools.selected),
}

# names of a pin of the machine's hardware layer, and of a value of its configuration
_MACHINE_PREFIXES = ("_hal[", "_ini[")


def provided_parameter(state: ProgramState, key: float | str) -> float | None:
    """Return a parameter of the controller; None for others.

    Raises:
        InputError: a value of the machine that the program is not given, but for a feed.
    """
    if isinstance(key, str):
        if key in state.setup.parameters:
            return state.setup.parameters[key]
        if key in _NAMED_PARAMETERS:
            return _NAMED_PARAMETERS[key](state)
        if key.startswith(_MACHINE_PREFIXES):
            if "feed" not in key:
                raise InputError(f"#<{key}> is a value of the machine: must be given in parameters, by that name")
            state.assumed_feeds.add(key)
            return UNSTATED_FEED / state.frames.unit
    if key in _TOOL_PARAMETERS:
        return _TOOL_PARAMETERS[key](state)
    return state.frames.shown(key)
