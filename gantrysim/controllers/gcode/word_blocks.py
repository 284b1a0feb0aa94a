"""Blocks of words, applied one after the other by the functions of their codes."""

from __future__ import annotations

from functools import lru_cache

from gantrysim.base.errors import AxisError, InputError
from gantrysim.controllers.gcode.codes import CODES, Code, Kind
from gantrysim.controllers.gcode.lines import FirmwareCommand, Words
from gantrysim.controllers.gcode.program_state import ProgramState, WordBlock
from gantrysim.controllers.valve import SPEED_CODES

# what cutter compensation allows; all else would change what the offset path refers to
_OFFSET_MOTIONS = {"G0", "G1", "G2", "G3", "G80"}
_OFFSET_ACTIONS = {"G4", "G10", "G28.1", "G30.1"}
_ORIGINS = {"tool length", "coordinate system", "shift", "machine coordinates"}
_MOST_NAMES = 1000  # of codes, in memory: a program may have any number of unknown ones


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
            return self._command(line)
        block = WordBlock()
        codes: list[str] = []
        auxiliary: list[int] = []
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
        if "T" in block.values:
            self._state.tools.selected = int(block.values["T"])
        if auxiliary or "S" in block.values:
            state = self._state
            state.outputs.switch(auxiliary, block.values.get("P"), self._speed(block, codes, auxiliary))
        if auxiliary:
            for number in auxiliary:
                self._apply_auxiliary(number, block)
            if self._dialect.extrudes:
                # in firmware a line is one command: its words belong to its M code
                if not block.keeps_words:
                    block.values.clear()
                if not codes:
                    return not block.ends
        self._apply(codes, block)
        return not block.ends

    def _speed(self, block: WordBlock, codes: list[str], auxiliary: list[int]) -> float | None:
        """Return S where it is a speed: in firmware it is a time, a temperature or other in most blocks."""
        is_speed = SPEED_CODES.issuperset(auxiliary) and "G4" not in codes
        return block.values.get("S") if is_speed or not self._dialect.extrudes else None

    def _command(self, line: FirmwareCommand) -> bool:
        code = self._codes.get(line.name)
        block = WordBlock(arguments=line.arguments)
        if code is None or code.handler is None:
            self._state.ignored[line.name] += 1
        else:
            code.handler(self._state, block)
        return not block.ends

    def _auxiliary_number(self, value: float) -> int:
        number = round(value)
        if number != value and not self._dialect.lenient:
            raise InputError(f"M{value:g}: must be a whole number")
        return number

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
            self._check_compensation(code)
            if code.kind is Kind.MOTION:
                if moves and name == "G80":  # it ends a cycle, not the motion that stands beside it
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
        if "F" in block.values:
            state.modes.feed = block.values.pop("F")
            if state.modes.feed < 0:
                raise InputError(f"F = {state.modes.feed:g}: must be at least 0")
        for letter in state.setup.skip_axes:
            if letter in block.values:
                block.drop(letter)
                state.ignored[f"axis {letter}"] += 1
        if action and action.handler:
            action.handler(state, block)
        if block.values and (action is None or (action.shares_words and moves)):
            self._move(block)
        if block.values:
            self._ignore_words(block)

    def _check_compensation(self, code: Code) -> None:
        """Check that a code does not change what the path of cutter compensation refers to."""
        if self._state.compensation.is_on and _needs_plain_path(code):
            raise InputError(f"{code.name} under cutter compensation: must follow G40")

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

    def _move(self, block: WordBlock) -> None:
        """Run the motion in force with the words of a block."""
        state = self._state
        code = self._codes[state.motion]
        moves = not block.values.keys().isdisjoint(code.moved_by)
        if self._dialect.extrudes and "E" in block.values:
            # E is a position that counts in any case, also where no axis moves
            block.fed = state.material_fed(block.values.pop("E"))
        if not moves:
            if block.fed and code.straight:  # a retraction: the nozzle stands for the time that the feed takes
                feed = state.feed_per_minute
                state.pause(abs(block.fed) / feed if feed else 0.0)
            return
        self._check_compensation(code)
        if block.in_machine and not code.straight:
            raise InputError("G53: must be with G0 or G1")
        assert code.handler is not None
        code.handler(state, block)

    def _ignore_words(self, block: WordBlock) -> None:
        """Count words without an effect on the path; refuse others."""
        state = self._state
        for letter in [letter for letter in block.values if letter in self._dialect.letters]:
            value = block.values.pop(letter)
            if letter == "S":  # no effect here, but G95 feeds per revolution
                state.modes.spindle = value
            else:
                state.ignored[letter] += 1
        for letter in [letter for letter in block.values if letter in "ABCUVW" and self._stands(letter, block)]:
            block.drop(letter)
            state.ignored[f"axis {letter}, which stands"] += 1
        if not block.values:
            return
        letter, value = next(iter(block.values.items()))
        if letter in "ABCUVW":
            raise AxisError(
                f"{letter}{value:g} moves an axis that a program of {self._dialect.name} cannot have here: "
                f"must be x, y or z; skip_axes = {letter!r} skips the word"
            )
        if not self._dialect.lenient:
            raise InputError(f"{letter}{value:g}: is not used in this block")
        state.ignored[letter] += 1

    def _stands(self, letter: str, block: WordBlock) -> bool:
        """Return whether a word of an axis that the machine lacks does not move it."""
        state = self._state
        value = block.values[letter]
        if not state.frames.absolute:
            return value == 0
        return value == 0


def _needs_plain_path(code: Code) -> bool:
    """Return whether a code is refused under cutter compensation."""
    match code.kind:
        case Kind.MOTION:
            return code.name not in _OFFSET_MOTIONS
        case Kind.ACTION:
            return code.name not in _OFFSET_ACTIONS
        case _:
            return code.group in _ORIGINS


@lru_cache(_MOST_NAMES)
def _code_name(value: float) -> str:
    """Return the name of a G code; its number is rounded, as an expression in brackets may have computed it."""
    tenths = round(10 * value)
    if abs(tenths - 10 * value) > 1e-6:
        raise InputError(f"G{value:g}: must have one decimal at most")
    return f"G{tenths / 10:g}"
